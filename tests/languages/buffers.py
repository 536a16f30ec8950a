"""The blob of deploy/python/examples/blob.py by one rank, computed into the node's own memory: buffers.py URL."""

import sys

import lamina
import numpy as np

n, steps = (24, 20, 16), 3
run = lamina.Client(
    "blob",
    "density",
    n,
    np.float64,
    generator=sys.argv[1],
    spacing=(0.1, 0.1, 0.1),
    origin=(-1.2, -1.0, -0.8),
    color_field="heat",
    color_type=np.float64,
)
i, j, k = np.ogrid[: n[0], : n[1], : n[2]]
for step in range(steps):
    density, heat = run.buffer(n)
    x, y, z = 0.1 * i - 0.8 - 0.2 * step, 0.1 * j - 1.0, 0.1 * k - 0.8
    density[:] = 1.0 / (1.0 + 9.0 * (x * x + y * y + z * z))
    heat[:] = x + step
    assert run.push(step, 0.1 * step, density, colors=heat)
summary = run.close()
print(f"pushed {summary.pushed} dropped {summary.dropped} lost {summary.lost}")
