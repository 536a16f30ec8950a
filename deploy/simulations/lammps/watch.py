"""Hands LAMMPS's number density over: called by `fix python/invoke`, on every rank for its own subdomain."""

import os
import sys

import lamina
import numpy as np
from lammps import lammps

# Cells of the grid along x, y, z, a multiple of the ranks along x.
N = (48, 48, 48)

run = step = None


def cells(lmp):
    """The box's lower corner, and a cell's sides."""
    lo, hi = (np.array(end) for end in lmp.extract_box()[:2])
    return lo, (hi - lo) / N


def deposit(lmp):
    """Cloud in cell: each atom in the eight cells around it. Ghost atoms bring what neighbors' atoms have in own cells, so that
    nothing is sent. Index of the first own cell, the counts, and a cell's sides."""
    lo, d = cells(lmp)
    # The Python module does not say where a subdomain ends; the input cuts the box along x alone, into equal parts.
    rank, ranks = lmp.extract_setting("world_rank"), lmp.extract_setting("world_size")
    first, end = np.array([N[0] * rank // ranks, 0, 0]), np.array([N[0] * (rank + 1) // ranks, *N[1:]])
    atoms = lmp.extract_global("nlocal") + lmp.extract_global("nghost")
    g = (lmp.numpy.extract_atom("x", nelem=atoms) - lo) / d - 0.5
    near, density = np.floor(g).astype(int), np.zeros(end - first)
    for corner in np.ndindex(2, 2, 2):
        cell = near + corner - first
        weight = np.prod(np.where(corner, g - near, 1 - (g - near)), axis=1)
        own = np.all((cell >= 0) & (cell < end - first), axis=1)
        np.add.at(density, tuple(cell[own].T), weight[own])
    return first, density, d


def watch(pointer):
    global run, step
    lmp = lammps(ptr=pointer)
    if step is None:
        step = 0
        lo, d = cells(lmp)
        try:
            # Rank and ranks are the launcher's.
            run = lamina.Client(
                "droplet",
                "number density",
                N,
                "float64",
                generator=os.environ.get("LAMINA_GENERATOR", "http://127.0.0.1:7101"),
                spacing=d,
                origin=lo + d / 2,
            )
        except OSError as error:
            print(f"not shown: {error}", file=sys.stderr)
    try:
        # What the node goes without is not deposited.
        if run and run.wants(step):
            push(lmp)
    except OSError as lost:
        print(f"step {step} not shown: {lost}", file=sys.stderr)
    step += 1


def push(lmp):
    first, density, d = deposit(lmp)
    if "DEPOSITED" in os.environ:
        with open(f"{os.environ['DEPOSITED']}.{first[0]}", "a") as file:
            file.write(f"{step} {density.sum():.9f}\n")
    # Per volume, x, y, z as the array has them.
    run.push(step, lmp.extract_global("ntimestep"), density / d.prod(), start=first)
