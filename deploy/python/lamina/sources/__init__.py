"""Where steps come from that others write: files as they are finished, and streams. Each source is an iterator of `Step`.

`files` reads one step of a file, by its ending; `folder` finds files that are finished; `growing` follows an array that gains steps,
`xdmf` a collection; `openpmd_series` and `adios_stream` follow those through their own libraries."""

from __future__ import annotations

import dataclasses
import importlib
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy

from ..reader import Unfit


@dataclass
class Step:
    """A step as it was read. `values`: axes x, y, z, of any strides."""

    values: numpy.ndarray
    field: str = "scalar"
    time: float | None = None
    number: int | None = None
    spacing: tuple[float, float, float] = (1.0, 1.0, 1.0)
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    missing: float | None = None
    """The value that stands where there is none; NaN is missing in any case."""
    colors: numpy.ndarray | None = None
    """Of the second field, for colors."""
    more: dict[str, numpy.ndarray] = dataclasses.field(default_factory=dict)
    """Further fields by the names that expressions call them."""


@dataclass
class Options:
    """What the user says of a source that it does not say itself."""

    field: str | None = None
    """Array to read, where there are several."""
    color_field: str | None = None
    """Array that colors come from."""
    more_fields: dict[str, str] = dataclasses.field(default_factory=dict)
    """Further arrays to choose from: what expressions call them, and what the source does."""
    shown: str | None = None
    """What is shown first, a field or an expression; else `field`."""
    axes: str = "zyx"
    """Order of the axes of arrays that do not say, slowest first."""
    spacing: tuple[float, float, float] | None = None
    origin: tuple[float, float, float] | None = None
    quiet_secs: float = float("inf")
    """So long without a new step ends the run."""
    dims: tuple[int, int, int] | None = None
    """Of raw files, with their type."""
    dtype: str | None = None
    level: int | None = None
    """Of an adaptive mesh: the level whose cells are shown; the finest, if none is named."""
    missing: float | None = None
    """The value that stands where there is none, instead of the source's."""
    stopped: Callable[[], bool] = dataclasses.field(default=lambda: False)
    """Asked while nothing is new."""


class NotReady(Exception):
    """The file is not finished, or not one of this kind."""


def check_size(size_bytes: int, where: str) -> None:
    """Refuses what the memory here cannot hold before it is read: a small file may claim to be large."""
    try:
        lines = Path("/proc/meminfo").read_text().splitlines()
        free = 1024 * next(int(line.split()[1]) for line in lines if line.startswith("MemAvailable"))
    except (OSError, StopIteration, ValueError):
        return
    if size_bytes > free:
        raise Unfit(f"{where}: {size_bytes / 1e9:.1f} GB, more than the {free / 1e9:.1f} GB of memory that are free; write smaller steps")


def library(name: str, extra: str) -> Any:
    """The module `name`, which comes with an extra of the package."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise ImportError(f"{error}; pip install 'lamina-insitu[{extra}]'") from None


def by_axes(array: numpy.ndarray, axes: str) -> numpy.ndarray:
    """`array` with its axes in the order x, y, z."""
    if array.ndim != 3 or sorted(axes) != ["x", "y", "z"]:
        raise Unfit(f"an array of {array.ndim} axes, read as \"{axes}\"; three are needed: x, y and z")
    return array.transpose([axes.index(axis) for axis in "xyz"])


def choose(names: list[str], wanted: str | None, where: str) -> str:
    """The name wanted, whole or its last part; the first, where none is."""
    if not names:
        raise NotReady(f"{where}: no array of three axes")
    if wanted is None:
        return names[0]
    found = [name for name in names if name == wanted] or [name for name in names if re.split("[/.]", name)[-1] == wanted]
    if not found:
        raise Unfit(f"{where}: no field \"{wanted}\"; there are {', '.join(names)}")
    return found[0]


def uniform(points: numpy.ndarray, axis: str) -> tuple[float, float]:
    """First and spacing of coordinates, which must be evenly spaced."""
    points = numpy.asarray(points, numpy.float64)
    if len(points) < 2:
        return (float(points[0]) if len(points) else 0.0), 1.0
    spacing = (points[-1] - points[0]) / (len(points) - 1)
    if not (spacing > 0 and numpy.allclose(numpy.diff(points), spacing, rtol=1e-3, atol=0)):
        raise Unfit(f"coordinates along {axis} are not evenly spaced upwards; resample the field to a uniform grid")
    return float(points[0]), float(spacing)


def open_source(source: str, options: Options) -> Iterator[Step]:
    """The steps of `source`: a folder, a file or series that is being written, or a stream. Each with all fields that are asked for."""
    names = list(options.more_fields.values()) + ([options.color_field] if options.color_field else [])
    if not names:
        return open_field(source, options)
    if source.endswith(".sst"):
        raise Unfit(f"{source}: a stream is read once, for one field; let it be written to a file, and watch that")
    return _together(source, options, names)


def _together(source: str, options: Options, names: list[str]) -> Iterator[Step]:
    beside = [open_field(source, dataclasses.replace(options, field=name)) for name in names]
    for step, *others in zip(open_field(source, options), *beside):
        for name, other in zip(names, others):
            if (other.number, other.values.shape) != (step.number, step.values.shape):
                raise Unfit(f"{source}: field \"{name}\" of step {other.number} is on {other.values.shape} points, beside {step.values.shape}")
        values = [other.values for other in others]
        step.more = dict(zip(options.more_fields, values))
        step.colors = values[-1] if options.color_field else None
        yield step


def open_field(source: str, options: Options) -> Iterator[Step]:
    """The steps of `source` with the field that `options` name."""
    from . import adios_stream, files, folder, growing, openpmd_series, xdmf

    if source.startswith("openpmd:"):
        return openpmd_series.steps(source.removeprefix("openpmd:"), options)
    path = Path(source)
    if re.search(r"%\d*T", source):
        return openpmd_series.steps(source, options)
    if path.suffix in (".bp", ".bp4", ".bp5") and openpmd_series.says_so(path):
        return openpmd_series.steps(source, options)
    if path.suffix in (".bp", ".bp4", ".bp5", ".sst"):
        return adios_stream.steps(source, options)
    if growing.has_time(path):
        return growing.steps(path, options)
    if xdmf.has_time(path):
        return xdmf.steps(path, options)
    if path.exists() or any(path.parent.glob(path.name)):
        return folder.steps(path, options)
    raise FileNotFoundError(f"{source}: neither a file or folder nor a pattern that some match; a series of openPMD has %T in its name")
