"""Holds the last recorded step to Q by NumPy from the velocity that the simulation saved at its end: check_q.py FOLDER."""

import pathlib
import sys

import lamina
import numpy as np

folder = pathlib.Path(sys.argv[1])
velocity = np.load(folder / "last.npy")
run = lamina.Run(folder / "runs")
last = run[run.steps[-1]]
if not isinstance(last, lamina.Reduced):
    sys.exit(f"{folder}: the last step is a VDI; its values cannot be read")
gradient = np.array([[np.gradient(v, d, axis=a) for a, d in enumerate(last.spacing)] for v in velocity])
# Q = (|W|^2 - |S|^2) / 2 of the antisymmetric and the symmetric part of the gradient (Hunt, Wray, Moin 1988).
exact = -0.5 * np.einsum("ij...,ji...", gradient, gradient)
if last.array.shape != exact.shape:
    sys.exit(f"{folder}: the last step has {last.array.shape} of {exact.shape} points")
# Values that the transfer function hides are not recorded to any accuracy; at the faces differences are one-sided.
inner = (slice(1, -1),) * 3
correlation = np.corrcoef(exact[inner].ravel(), last.array[inner].ravel())[0, 1]
if correlation < 0.99:
    sys.exit(f"{folder}: what is recorded correlates by {correlation:.4f} with Q of the velocity")
print(f"correlation with Q by NumPy {correlation:.6f}")
