"""Spinodal decomposition (Cahn-Hilliard) with py-pde, watched while it runs: simulate.py [POINTS] [END] [SAVED.npy]."""

import os
import sys
import time

import numpy as np
import pde

# --- what watching it takes -----------------------------------------------------------------------------------------------
import lamina
from pde.trackers.base import TrackerBase


class Watch(TrackerBase):
    """Hands the state over each time the tracker is due."""

    def initialize(self, field, info=None):
        grid = field.grid
        self.step, self.run = 0, None
        try:
            self.run = lamina.Client(
                "cahn-hilliard",
                "concentration",
                grid.shape,
                field.data.dtype,
                generator=os.environ.get("LAMINA_GENERATOR", "http://127.0.0.1:7101"),
                spacing=grid.discretization,
                # Values are those of cells: the first one lies half a cell inside.
                origin=[low + d / 2 for (low, _), d in zip(grid.axes_bounds, grid.discretization)],
            )
        except OSError as error:
            print(f"not shown: {error}", file=sys.stderr)
        return super().initialize(field, info)

    def handle(self, field, t):
        try:
            self.run and self.run.push(self.step, t, field.data)
        except OSError as lost:
            print(f"step {self.step} not shown: {lost}", file=sys.stderr)
        self.step += 1

    def finalize(self, info=None):
        if self.run:
            ended = self.run.close()
            print(f"pushed {ended.pushed}, dropped {ended.dropped}, lost {ended.lost}")
        return super().finalize(info)


# ---------------------------------------------------------------------------------------------------------------------------

points = int(sys.argv[1]) if len(sys.argv) > 1 else 48
end = float(sys.argv[2]) if len(sys.argv) > 2 else 40
grid = pde.CartesianGrid([[0, points]] * 3, points, periodic=True)
state = pde.ScalarField.random_uniform(grid, -0.1, 0.1, rng=np.random.default_rng(7))
equation = pde.CahnHilliardPDE(interface_width=1)
trackers = [] if os.environ.get("ALONE") else [Watch(interrupts=end / 40)]
begun = time.perf_counter()
result = equation.solve(state, t_range=end, dt=0.01, adaptive=True, tracker=trackers)
print(f"seconds {time.perf_counter() - begun:.2f}, mass {state.integral:.9g} to {result.integral:.9g}")
if len(sys.argv) > 3:
    np.save(sys.argv[3], result.data)
