"""A Zarr store or netCDF file whose time axis grows while it is written, through xarray."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy

from . import Options, Step, by_axes, check_size, choose, library, uniform

TIMES = ("time", "t", "step")
POLL_SECS, UNREADABLE_SECS = 0.2, 5.0


def opened(path: Path) -> Any:
    """The dataset as it is now; arrays are read when asked for. What is amiss in a writer's hands is looked at again."""
    deadline = time.monotonic() + UNREADABLE_SECS
    while True:
        try:
            return _opened(path)
        except (OSError, ValueError, KeyError):
            if time.monotonic() > deadline:
                raise
            time.sleep(POLL_SECS)


def _opened(path: Path) -> Any:
    xarray = library("xarray", "xarray")
    if path.suffix == ".zarr":
        library("zarr", "xarray")
        return xarray.open_zarr(path, chunks=None, decode_times=False, consolidated=False)
    return xarray.open_dataset(path, decode_times=False)


def placed(data: Any, name: str, options: Options) -> Step:
    """An array of three named axes as a step: coordinates give the grid."""
    short = {"lon": "x", "longitude": "x", "lat": "y", "latitude": "y", "lev": "z", "level": "z", "depth": "z", "height": "z"}
    dims = [short.get(str(dim).lower(), str(dim).lower()) for dim in data.dims]
    axes = "".join(dims) if sorted(dims) == ["x", "y", "z"] else options.axes
    check_size(data.nbytes, name)
    step = Step(by_axes(data.to_numpy(), axes), name)
    of = {axis: data.dims[axes.index(axis)] for axis in "xyz"}
    if all(dim in data.coords for dim in of.values()):
        both = [uniform(data.coords[of[axis]].to_numpy(), axis) for axis in "xyz"]
        step.origin, step.spacing = tuple(b[0] for b in both), tuple(b[1] for b in both)
    if "time" in data.coords and data.coords["time"].ndim == 0:
        step.time = float(data.coords["time"])
    return step


def has_time(path: Path) -> bool:
    """Whether it is a store of its own with a time axis."""
    if path.suffix not in (".zarr", ".nc", ".nc4") or not path.exists():
        return False
    with opened(path) as data:
        return any(time_axis(of) is not None for of in data.data_vars.values())


def time_axis(data: Any) -> str | None:
    """The time axis of an array of four."""
    return next((str(dim) for dim in data.dims if str(dim).lower() in TIMES), None) if data.ndim == 4 else None


def steps(path: Path, options: Options) -> Iterator[Step]:
    """Each step of the time axis, the newest of which is given when it is seen to be written: when the next look finds it as it was."""
    given, before, newest = 0, -1, time.monotonic()
    while not options.stopped():
        with opened(path) as data:
            names = [str(name) for name, of in data.data_vars.items() if time_axis(of)]
            name = choose(names, options.field, str(path))
            axis = time_axis(data[name])
            length = data.sizes[axis]
            # The last may be in the writer's hands: it waits for the one after it, or for two looks that find no other.
            ready = length if length == before else length - 1
            for n in range(given, ready):
                part = data[name].isel({axis: n})
                step = placed(part, name, options)
                at = part.coords[axis] if axis in part.coords else None
                step.number, step.time = n, (float(numpy.asarray(at)) if at is not None else step.time)
                newest, given = time.monotonic(), n + 1
                yield step
            before = length
        if time.monotonic() - newest > options.quiet_secs:
            return
        time.sleep(POLL_SECS)
