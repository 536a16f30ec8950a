"""`lamina watch SOURCE`: what others write, pushed step by step as it appears. Nothing is linked, no code changes.

    lamina watch results/                       # .vti .nrrd .raw .h5 .vtkhdf .nc .zarr .tif .npy, AMReX plotfiles: each when it is finished
    lamina watch "results/out_*.h5" --field rho # those that match
    lamina watch sim.zarr                       # a store whose time axis grows
    lamina watch "diag/openpmd_%T.bp"           # an openPMD series
    lamina watch sim.bp                         # an ADIOS2 file while it is written; sim.sst is a stream
    lamina watch openpmd:sim.sst                # a stream of openPMD
    lamina watch run.h5 --field rho --more-fields v.x=u,v.y=v,v.z=w --shown "magnitude(curl(v))"
"""

from __future__ import annotations

import argparse
import ctypes
import itertools
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy

from .client import TYPES, Client, Summary
from .installed import program
from .sources import Options, Step, Unfit, open_source
from .sources.folder import pass_over


# The nodes have done what they can when they say nothing for so long.
QUIET_NODES_SECS = 10.0


def fit(values: numpy.ndarray) -> numpy.ndarray:
    """`values` of a type that a run may have: wider integers become double precision."""
    if values.dtype.kind not in "biuf":
        raise Unfit(f"values of type {values.dtype}; real numbers are needed")
    native = values.astype(values.dtype.newbyteorder("="), copy=False)
    if native.dtype.name in TYPES:
        return native
    if native.dtype == bool:
        return native.view(numpy.uint8)
    return native.astype(numpy.int16 if native.dtype == numpy.int8 else numpy.float64)


def mark_missing(values: numpy.ndarray, missing: float | None) -> numpy.ndarray:
    """`values` with NaN where they are `missing`; integers become single precision."""
    if missing is None:
        return values
    values = values.astype(numpy.float64 if values.dtype == numpy.float64 else numpy.float32)
    values[values == values.dtype.type(missing)] = numpy.nan
    return values


class Feed:
    """Pushes steps; opens a run at the first, and another where the grid, the type or the field changes."""

    def __init__(self, generator: str, name: str, options: Options, settle: Callable[[int], None]) -> None:
        self.generator, self.name, self.options, self.settle = generator, name, options, settle
        self.client: Client | None = None
        self.run: tuple | None = None
        self.pushed, self.last = 0, -1

    def push(self, step: Step) -> None:
        missing = step.missing if self.options.missing is None else self.options.missing
        values = mark_missing(fit(step.values), missing)
        colors = None if step.colors is None else mark_missing(fit(step.colors), missing)
        more = {name: mark_missing(fit(of), missing) for name, of in step.more.items()}
        spacing, origin = self.options.spacing or step.spacing, self.options.origin or step.origin
        types = {name: of.dtype.name for name, of in more.items()}
        color_type = None if colors is None else colors.dtype.name
        run = step.field, values.shape, values.dtype.name, tuple(spacing), tuple(origin), color_type, tuple(types.items())
        if run != self.run:
            self.close()
            self.client = Client(
                self.name,
                step.field,
                values.shape,
                values.dtype.name,
                self.generator,
                spacing,
                origin,
                self.options.color_field,
                color_type,
                more_fields=types,
                shown=self.options.shown,
                # The files are there: whoever reads them waits, and the simulation does not.
                full_policy="block",
                deadline_secs=600.0,
            )
            self.run = run
        assert self.client is not None
        number = self.pushed if step.number is None else step.number
        arrays = [values, *more.values()] + ([] if colors is None else [colors])
        if any(stride <= 0 for stride in values.strides) or any(array.strides != values.strides for array in arrays):
            # All are to lie in memory alike.
            arrays = [numpy.ascontiguousarray(array) for array in arrays]
        time = float(number) if step.time is None else step.time
        beside = dict(zip(more, arrays[1:]))
        self.client.push(number, time, arrays[0], colors=None if colors is None else arrays[-1], more=beside)
        self.pushed, self.last = self.pushed + 1, number

    def close(self) -> Summary | None:
        if self.client is None:
            return None
        client, self.client = self.client, None
        summary = client.close()
        # Another run would take the node over.
        self.settle(self.last)
        return summary


def _of_its_own() -> None:
    """Ctrl-C is this process's; the nodes are told by it, also when it is killed."""
    os.setsid()
    ctypes.CDLL(None).prctl(1, signal.SIGTERM)


class Nodes:
    """`lamina serve` as a process of its own, ended with this one."""

    def __init__(self, arguments: Sequence[str]) -> None:
        self.process = subprocess.Popen(
            [program("lamina"), "serve", "--listen", "127.0.0.1:0", *arguments], stdout=subprocess.PIPE, text=True, preexec_fn=_of_its_own
        )
        assert self.process.stdout is not None
        first = self.process.stdout.readline()
        found = re.search(r"connect to (\S+); open (\S+)", first)
        if not found:
            raise OSError(f"the nodes did not start: {first or 'see above'}")
        self.generator, self.page = found.groups()
        self.shown, self.heard = -1, time.monotonic()
        print(f"open {self.page}   (Ctrl-C ends)", flush=True)
        # Its lines are ours from here on.
        threading.Thread(target=self._forward, daemon=True).start()

    def _forward(self) -> None:
        for line in self.process.stdout or ():
            print(line, end="", flush=True)
            self.heard = time.monotonic()
            if line.startswith("watching "):
                self.shown = -1
            elif found := re.match(r"step\s+(\d+)", line):
                self.shown = int(found.group(1))

    def wait_for(self, step: int, stopped: Callable[[], bool]) -> None:
        """Until it was shown, or nothing has come for some seconds."""
        while not stopped() and self.shown < step and time.monotonic() - self.heard < QUIET_NODES_SECS and self.process.poll() is None:
            time.sleep(0.05)

    def stop(self) -> None:
        self.process.terminate()
        self.process.wait()


def watch(
    source: str | os.PathLike[str],
    generator: str | None = None,
    contract: str | None = None,
    out: str | os.PathLike[str] | None = None,
    viewer: str | None = None,
    scene: str | os.PathLike[str] | None = None,
    name: str | None = None,
    steps: int | None = None,
    linger: bool = False,
    options: Options | None = None,
) -> int:
    """Follows `source` until it ends, `steps` steps were pushed or `options.stopped`; how many were. The nodes run here, with `contract`,
    `scene` and the folder `out` for what is recorded, unless a generator-node runs at `generator`. `linger`: the page stays when the
    source has ended."""
    options = options or Options()
    # A source that is not there is refused before anything is started.
    found = open_source(os.fspath(source), options)
    print(f"waiting for the first step of {os.fspath(source)}", flush=True)
    first = next(found, None)
    if first is None:
        return 0
    nodes = None
    if generator is None:
        # Room for two steps that wait beside one that is worked on, as `lamina replay` has.
        nbytes = first.values.nbytes + sum(of.nbytes for of in [*first.more.values(), first.colors] if of is not None)
        # What is computed, and what derivatives of it are taken of.
        derived = 16 if first.more or options.shown else 0
        memory = str(max(2048, (4 * nbytes + (32 + derived) * first.values.size >> 20) + 64))
        given = {"--contract": contract, "--out": out, "--viewer": viewer, "--scene": scene, "--memory": memory}
        nodes = Nodes([part for key, of in given.items() if of is not None for part in (key, os.fspath(of))])
        generator = nodes.generator
    stem = re.sub(r"[^\w.-]+", "", Path(source).name.split(".")[0]) or "watched"
    feed = Feed(generator, name or stem, options, lambda last: nodes.wait_for(last, options.stopped) if nodes else None)
    try:
        for step in itertools.chain([first], found):
            first = None
            try:
                feed.push(step)
            except Unfit as error:
                pass_over(f"step {step.number}", error)
            if options.stopped() or (steps is not None and feed.pushed >= steps):
                break
        summary = feed.close()
        if nodes and linger and not options.stopped():
            print(f"{os.fspath(source)} has ended after {feed.pushed} steps; the page stays until Ctrl-C", flush=True)
            while not options.stopped() and nodes.process.poll() is None:
                time.sleep(0.2)
        if summary and summary.lost:
            print(f"{summary.lost} steps were lost", file=sys.stderr)
        return feed.pushed
    finally:
        feed.close()
        if nodes:
            nodes.stop()


def _three(text: str) -> tuple[float, float, float]:
    values = tuple(float(part) for part in re.split("[,x]", text))
    if len(values) != 3:
        raise argparse.ArgumentTypeError(f"{text}: three numbers are needed, such as 1,1,2.5")
    return values


def _dims(text: str) -> tuple[int, int, int]:
    x, y, z = (int(part) for part in text.split("x"))
    return x, y, z


def _names(text: str) -> dict[str, str]:
    pairs = [part.strip().partition("=") for part in text.split(",")]
    if any(not name for name, _, _ in pairs):
        raise argparse.ArgumentTypeError(f"{text}: names are needed, such as pressure,v.x=u")
    return {name: array or name for name, _, array in pairs}


def _axes(text: str) -> str:
    if sorted(text) != ["x", "y", "z"]:
        raise argparse.ArgumentTypeError(f"{text}: an order of x, y and z is needed, such as zyx")
    return text


def command(arguments: Sequence[str]) -> int:
    """The command line; its exit status."""
    parser = argparse.ArgumentParser("lamina watch", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add("source", metavar="SOURCE", help="folder, pattern of files, store, series or stream")
    add("--field", metavar="NAME", help="array to show, where there are several")
    add("--more-fields", type=_names, default={}, metavar="NAME=ARRAY,..", help="further arrays, to choose from on the page: v.x=u,v.y=v,v.z=w")
    add("--color-field", metavar="NAME", help="array that colors come from")
    add("--shown", metavar="EXPRESSION", help='what is shown first, such as "magnitude(v)"; default: the field')
    add("--contract", metavar="CONTRACT", help='such as "size <= 300kB, psnr >= 35dB"')
    add("--out", metavar="DIR", help="folder for what is recorded")
    add("--scene", metavar="FILE", help="scene file (TOML) that states camera and transfer function")
    add("--viewer", metavar="IP:PORT", help="address of the page; default: 127.0.0.1:7102")
    add("--generator", metavar="URL", help="push to this running generator-node instead of starting the nodes here")
    add("--name", help="name of the run; default: the source's")
    add("--steps", type=int, metavar="N", help="stop after N steps")
    add("--quiet", type=float, default=float("inf"), metavar="SECS", help="so long without a new step ends the run; default: never")
    add("--axes", type=_axes, default="zyx", help="axes of arrays that do not say, slowest first; default: zyx")
    add("--spacing", type=_three, metavar="X,Y,Z", help="distance of neighbors, instead of the source's")
    add("--origin", type=_three, metavar="X,Y,Z", help="position of the first value, instead of the source's")
    add("--level", type=int, metavar="N", help="level of an adaptive mesh whose cells are shown; default: the finest")
    add("--dims", type=_dims, metavar="NXxNYxNZ", help="points a side of raw files")
    add("--dtype", metavar="TYPE", help="type of raw files, such as uint8")
    add("--missing", type=float, metavar="VALUE", help="value that stands where there is none, instead of the source's; NaN in any case")
    add("--exit", action="store_true", help="end with the source; else the page stays")
    of = parser.parse_args(arguments)
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    options = Options(
        of.field,
        of.color_field,
        of.more_fields,
        of.shown,
        of.axes,
        of.spacing,
        of.origin,
        of.quiet,
        of.dims,
        of.dtype,
        of.level,
        of.missing,
        stop.is_set,
    )
    given = {key: getattr(of, key) for key in ("generator", "contract", "out", "viewer", "scene", "name", "steps")}
    try:
        pushed = watch(of.source, linger=not of.exit, options=options, **given)
    except (OSError, ValueError, KeyError, RuntimeError, ImportError) as error:
        where = "" if str(error).startswith(of.source) else f"{of.source}: "
        print(f"error: {where}{error}", file=sys.stderr)
        return 1
    print(f"pushed {pushed} steps", flush=True)
    return 0
