"""Fields computed by a generator-node against NumPy: derived.py GENERATOR VIEWER FOLDER, where a trigger keeps what is shown.

Prints each expression with its greatest error as a share of the values' range.
"""

import glob
import json
import sys
import time
import urllib.error
import urllib.request

import lamina
import numpy as np

generator, viewer, folder = sys.argv[1:]
n, spacing = (40, 33, 28), (0.5, 0.25, 2.0)
rng = np.random.default_rng(7)
names = [f"v.{axis}" for axis in "xyz"]


def smooth():
    """A few waves, and a little noise."""
    x = np.meshgrid(*(np.linspace(0, 2 * np.pi, m) for m in n), indexing="ij")
    waves = sum(rng.normal() * np.sin(rng.normal() * x[0] + rng.normal() * x[1] + rng.normal() * x[2] + rng.normal()) for _ in range(6))
    return (waves + 0.05 * rng.normal(size=n)).astype(np.float32)


rho, v = smooth() + 5, [smooth() for _ in names]
d = np.float64
gradient = lambda f: np.gradient(f.astype(d), *spacing)
jacobian = np.array([gradient(c) for c in v])
curl = [jacobian[(i + 2) % 3][(i + 1) % 3] - jacobian[(i + 1) % 3][(i + 2) % 3] for i in range(3)]
J = np.moveaxis(jacobian, (0, 1), (-2, -1))
S, R = (J + J.swapaxes(-1, -2)) / 2, (J - J.swapaxes(-1, -2)) / 2
norm = lambda parts: np.sqrt(sum(p.astype(d) ** 2 for p in parts))
expected = {
    "magnitude(v)": norm(v),
    "magnitude(gradient(density))": norm(gradient(rho)),
    "divergence(v)": np.trace(jacobian),
    "magnitude(curl(v))": norm(curl),
    "lambda2(v)": np.linalg.eigvalsh(S @ S + R @ R)[..., 1],
    "q_criterion(v)": ((R**2).sum((-1, -2)) - (S**2).sum((-1, -2))) / 2,
    "0.5 * density * dot(v, v) - log10(density)": 0.5 * rho.astype(d) * norm(v) ** 2 - np.log10(rho.astype(d)),
    "divergence(gradient(density))": sum(np.gradient(g.astype(np.float32).astype(d), *spacing)[a] for a, g in enumerate(gradient(rho))),
}


def ask(field):
    request = urllib.request.Request(f"{viewer}/api/show", json.dumps({"field": field}).encode(), {"content-type": "application/json"})
    try:
        return urllib.request.urlopen(request).status, ""
    except urllib.error.HTTPError as error:
        return error.code, error.read().decode()


run = lamina.Client(
    "derived", "density", n, "float32", generator=generator, spacing=spacing, more_fields=dict.fromkeys(names, "float32"), full_policy="block"
)
step, worst = 0, 0.0


def push():
    global step
    run.push(step, float(step), rho, more=dict(zip(names, v)))
    step += 1


def until(what, seconds=60):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        found = what()
        if found:
            return found
        time.sleep(0.05)
    sys.exit(f"nothing within {seconds} s; {run._library.lamina_error()}")


push()
# Of the field as it is.
until(lambda: glob.glob(f"{folder}/*.raw"))
known = set(glob.glob(f"{folder}/*.raw"))
for field, values in expected.items():
    assert until(lambda: ask(field)[0] == 204), field
    push()
    [file] = until(lambda: set(glob.glob(f"{folder}/*.raw")) - known)
    known.add(file)
    computed = np.fromfile(file, "<f4").reshape(n, order="F")
    error = np.abs(computed - values).max() / np.ptp(values)
    worst = max(worst, error)
    print(f"{field}: {error:.1e}")
for field, words in [("pressure", 'no field "pressure"'), ("v", "is a vector"), ("density +", "it ends"), ("", "it ends")]:
    status, said = ask(field)
    assert status == 400 and words in said, (field, status, said)
run.close()
assert worst < 1e-5, worst
