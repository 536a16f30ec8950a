"""Holds a recorded run to what the solver itself says: check_water.py FOLDER.

The share of points more than half full of water against interFoam's volume fraction at the same time; the share of points in no cell
against the obstacle's volume; the residual told with each step against that in the solver's log."""

import pathlib
import re
import sys

import lamina
import numpy as np

OBSTACLE = 0.1 * 0.2 * 0.25 / (1.2 * 0.6 * 0.6)

folder = pathlib.Path(sys.argv[1])
fractions, residuals, now = {}, {}, None
for line in (folder / "dam-break/log.interFoam").read_text().splitlines():
    if found := re.match(r"Time = (\S+)", line):
        now = float(found[1])
    elif found := re.match(r"Phase-1 volume fraction = (\S+)", line):
        fractions[now] = float(found[1])
    elif found := re.search(r"Solving for p_rgh, Initial residual = ([^,]+)", line):
        # That of the first corrector.
        residuals.setdefault(now, float(found[1]))

run = lamina.Run(folder / "runs")
times = {int(row["step"]): float(row["time"]) for row in run.table}
worst, held = 0.0, 0
for number in run.steps:
    step = run[number]
    if not isinstance(step, lamina.Reduced) or times.get(number) is None:
        continue
    near = min(fractions, key=lambda time: abs(time - times[number]))
    if abs(near - times[number]) > 1e-4:
        continue
    missing = np.isnan(step.array)
    if step.array.shape == (96, 48, 48) and abs(missing.mean() - OBSTACLE) > 1e-9:
        sys.exit(f"{folder}: {missing.mean():.6f} of step {number} is missing; the obstacle takes {OBSTACLE:.6f}")
    worst = max(worst, abs((step.array[~missing] > 0.5).mean() - fractions[near]))
    held += 1
if held < 3 or worst > 0.01:
    sys.exit(f"{folder}: the share of water is off by {worst:.4f} in {held} steps")
told = 0
for row in run.table:
    near = min(residuals, key=lambda time: abs(time - float(row["time"])))
    if abs(near - float(row["time"])) > 1e-6:
        continue
    of_step = dict(pair.split("=") for pair in row["diagnostics"].split(";"))
    if not np.isclose(float(of_step["residual_p_rgh"]), residuals[near], rtol=1e-4):
        sys.exit(f"{folder}: step {row['step']} tells {of_step}; the solver's log has {residuals[near]}")
    told += 1
if told < 3:
    sys.exit(f"{folder}: {told} steps tell a residual")
print(f"residuals of {told} steps are those of the solver's log")
print(f"share of water within {worst:.4f} of the solver's, {held} steps")
