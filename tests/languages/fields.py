"""A velocity beside a density, of which its magnitude is shown: in the node's own memory, or from the process's: fields.py URL RANK 1."""

import sys

import lamina
import numpy as np

n, steps = (24, 20, 16), 3
names = [f"v.{axis}" for axis in "xyz"]
run = lamina.Client(
    "fields", "density", n, np.float32, generator=sys.argv[1], more_fields=dict.fromkeys(names, np.float64), shown="magnitude(v)"
)
i, j, k = np.ogrid[: n[0], : n[1], : n[2]]
for step in range(steps):
    assert run.wants(step)
    run.diagnostic("residual", 0.5 * step)
    if step == 0:
        arrays = [np.empty(n, np.float32), *(np.empty(n) for _ in names)]
    else:
        arrays = run.buffer(n)
    values = [1.0, 0.25 * i + step, 0.5 * j, 0.125 * k * i]
    for array, value in zip(arrays, values):
        array[:] = value
    assert run.push(step, 0.1 * step, arrays[0], more=dict(zip(names, arrays[1:])))
try:
    run.push(steps, 0.0, np.ones(n, np.float32), more={"v.x": np.ones(n)})
    sys.exit("arrays are missing, and nobody says so")
except ValueError as error:
    assert "more_fields" in str(error), error
summary = run.close()
print(f"pushed {summary.pushed} dropped {summary.dropped} lost {summary.lost}")
