"""The blob of deploy/python/examples/blob.py in two bricks of rank 0, and none of rank 1: bricks.py URL RANK 2."""

import sys

import lamina
import numpy as np


class Comm:
    """As mpi4py's."""

    def Get_rank(self):
        return int(sys.argv[2])

    def Get_size(self):
        return int(sys.argv[3])


n, steps = (24, 20, 16), 3
kind = {"type": "float64", "color_field": "heat", "color_type": "float64"}
place = {"spacing": (0.1, 0.1, 0.1), "origin": (-1.2, -1.0, -0.8)}
run = lamina.Client("blob", "density", n, generator=sys.argv[1], comm=Comm(), **kind, **place)
i, j, k = np.ogrid[: n[0], : n[1], : n[2]]
for step in range(steps):
    x, y, z = 0.1 * i - 0.8 - 0.2 * step, 0.1 * j - 1.0, 0.1 * k - 0.8
    density = 1.0 / (1.0 + 9.0 * (x * x + y * y + z * z))
    heat = np.broadcast_to(x + step, n).copy()
    parts = [((0, 0, 0), density[:9], heat[:9]), ((9, 0, 0), density[9:], heat[9:])]
    assert run.push_bricks(step, 0.1 * step, parts if Comm().Get_rank() == 0 else [])
summary = run.close()
print(f"pushed {summary.pushed} dropped {summary.dropped} lost {summary.lost}")
