"""Steps of an ADIOS2 file that is being written (BP5), or of a stream (SST), through adios2."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy

from . import Options, Step, by_axes, check_size, choose, library

# A writer may take so long to a step until we ask whether anybody still wants it.
WAIT_SECS = 1.0


def steps(source: str, options: Options) -> Iterator[Step]:
    """Each step, until the writer closes it or none comes for so long as `options` allow."""
    adios2 = library("adios2", "adios2")
    io = adios2.Adios().declare_io("watch")
    io.set_engine("SST" if source.endswith(".sst") else "BP5")
    io.set_parameters({"OpenTimeoutSecs": str(min(options.quiet_secs, 3600.0))})
    name = source.removesuffix(".sst") if source.endswith(".sst") else source
    ready, over = adios2.bindings.StepStatus.OK, adios2.bindings.StepStatus.EndOfStream
    with adios2.Stream(io, name, "r") as stream:
        quiet = 0.0
        while not options.stopped():
            status = stream.engine.begin_step(adios2.bindings.StepMode.Read, WAIT_SECS)
            if status == ready:
                step = _step(stream, source, options)
                stream.engine.end_step()
                quiet = 0.0
                yield step
            elif status == over:
                return
            else:
                quiet += WAIT_SECS
                if quiet > options.quiet_secs:
                    return


def _step(stream, source: str, options: Options) -> Step:
    found = stream.available_variables()
    shapes = {name: [int(n) for n in of["Shape"].split(",") if n.strip()] for name, of in found.items()}
    name = choose(sorted(name for name, shape in shapes.items() if len(shape) == 3), options.field, source)
    check_size(8 * math.prod(shapes[name]), f"{source}: {name}")
    values = stream.read(name, start=[0, 0, 0], count=shapes[name])
    step = Step(by_axes(numpy.asarray(values), options.axes), name)
    step.number = int(stream.engine.current_step())
    step.time = next((float(numpy.ravel(stream.read(t))[0]) for t in ("time", "Time", "physical_time") if t in found), None)
    return step
