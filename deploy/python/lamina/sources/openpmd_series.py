"""An openPMD series of any backend, while it is written or streamed, through openpmd-api: grid, axis order, units and time are its
own."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy

from . import NotReady, Options, Step, by_axes, check_size, choose, library

POLL_SECS = 0.2


def says_so(path: Path) -> bool:
    """Whether an ADIOS2 file is one, by its attribute."""
    try:
        adios2 = library("adios2", "adios2")
        with adios2.FileReader(str(path)) as file:
            return "/openPMD" in file.available_attributes() or "openPMD" in file.available_attributes()
    except Exception:
        # Not written yet, or no ADIOS2: its own source says what is missing.
        return False


def _components(iteration: Any) -> dict[str, tuple[Any, Any]]:
    """Mesh components of three axes, by name: `rho`, `E/x`."""
    found = {}
    for mesh_name in iteration.meshes:
        mesh = iteration.meshes[mesh_name]
        for component_name in mesh:
            component = mesh[component_name]
            if len(component.shape) == 3:
                found[mesh_name if len(mesh) == 1 else f"{mesh_name}/{component_name}"] = mesh, component
    return found


def _step(iteration: Any, number: int, series: Any, options: Options, where: str) -> Step:
    components = _components(iteration)
    name = choose(sorted(components), options.field, where)
    mesh, component = components[name]
    check_size(8 * math.prod(component.shape), f"{where}: {name}")
    data = component.load_chunk()
    series.flush()
    # Labels name the axes of the array as it is stored, slowest first; a stream may not bring them.
    labels = [label.lower() for label in mesh.axis_labels]
    if sorted(labels) != ["x", "y", "z"]:
        labels = list(options.axes)
    spacing, offset = (dict(zip(labels, of)) for of in (mesh.grid_spacing, mesh.grid_global_offset))
    position = dict(zip(labels, component.position)) if len(component.position) == 3 else {}
    # Data of Fortran order is said to be stored the other way.
    axes = "".join(labels[::-1] if str(mesh.data_order) in ("F", "Data_Order.F") else labels)
    unit = mesh.grid_unit_SI if not isinstance(mesh.grid_unit_SI, list) else mesh.grid_unit_SI[0]
    placed = {label: (s * unit, (offset[label] + position.get(label, 0.0) * s) * unit) for label, s in spacing.items()}
    values = by_axes(numpy.asarray(data), axes)
    if component.unit_SI != 1.0:
        values = values * component.unit_SI
    step = Step(values, name, float(iteration.time) * iteration.time_unit_SI, number)
    step.spacing, step.origin = (tuple(float(placed[axis][n]) for axis in "xyz") for n in (0, 1))
    return step


def first_step(path: str, options: Options) -> Step:
    """Of a file of one iteration or more."""
    io = library("openpmd_api", "openpmd")
    series = io.Series(path, io.Access.read_only)
    for number in series.iterations:
        return _step(series.iterations[number], number, series, options, path)
    raise NotReady(f"{path}: no iteration yet")


def steps(source: str, options: Options) -> Iterator[Step]:
    """Iterations in the order they are written. A series of one file an iteration is looked at again for new ones; others end when
    their writer closes them."""
    io = library("openpmd_api", "openpmd")
    if not re.search(r"%\d*T", source):
        series = io.Series(source, io.Access.read_linear)
        for iteration in series.read_iterations():
            yield _step(iteration, iteration.iteration_index, series, options, source)
            iteration.close()
        return
    pattern = Path(re.sub(r"%\d*T", "*", source))
    given: set[int] = set()
    newest, before = time.monotonic(), ()
    while not options.stopped():
        now = tuple(sorted((str(file), file.stat().st_mtime_ns) for file in pattern.parent.glob(pattern.name)))
        # Two looks that find the same: the newest file is finished.
        if now and now == before:
            series = io.Series(source, io.Access.read_only)
            for number in sorted(set(series.iterations) - given):
                yield _step(series.iterations[number], number, series, options, source)
                given.add(number)
                newest = time.monotonic()
            del series
        before = now
        if time.monotonic() - newest > options.quiet_secs:
            return
        time.sleep(POLL_SECS)
