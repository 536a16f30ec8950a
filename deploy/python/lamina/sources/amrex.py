"""AMReX plotfiles: folders with a text header and boxes of raw numbers. Shown are values of cells, on the finest level or on `--level N`:
where a level has no box, the next coarser one's values are repeated.

Format: https://amrex-codes.github.io/amrex/docs_html/IO.html and the headers themselves, version HyperCLaw-V1.1."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy

from . import NotReady, Options, Step, Unfit, check_size, choose


@dataclass
class Header:
    """What a plotfile says of itself."""

    names: list[str]
    time: float
    finest: int
    low: list[float]
    high: list[float]
    ratios: list[int]
    domains: list[tuple[list[int], list[int]]]
    folders: list[str]


def is_plotfile(path: Path) -> bool:
    """Whether the folder is one."""
    return path.is_dir() and (path / "Header").is_file() and (path / "Level_0").is_dir()


def _box(text: str) -> tuple[list[int], list[int]]:
    numbers = [int(n) for n in re.findall(r"-?\d+", text)]
    return numbers[:3], numbers[3:6]


def header(path: Path) -> Header:
    """Reads the text header."""
    lines = iter((path / "Header").read_text().splitlines())
    if not next(lines, "").startswith("HyperCLaw"):
        raise Unfit(f"{path}: its Header is not that of an AMReX plotfile")
    try:
        names = [next(lines).strip() for _ in range(int(next(lines)))]
        if int(next(lines)) != 3:
            raise Unfit(f"{path}: not of three dimensions")
        time, finest = float(next(lines)), int(next(lines))
        low, high = ([float(v) for v in next(lines).split()] for _ in range(2))
        ratios = [int(v) for v in re.findall(r"\d+", next(lines))][:finest]
        domains = [_box(box) for box in re.findall(r"\(\(.*?\)\s*\(.*?\)\s*\(.*?\)\)", next(lines))]
        folders = [line.strip() for line in lines if re.fullmatch(r"Level_\d+/\S+", line.strip())]
    except (StopIteration, ValueError, IndexError) as error:
        # While it is written it is short.
        raise NotReady(f"{path}: its Header is not whole ({error})") from None
    if len(domains) <= finest or len(folders) <= finest or len(ratios) < finest:
        raise NotReady(f"{path}: its Header does not list all levels")
    return Header(names, time, finest, low, high, ratios, domains, folders)


def boxes(path: Path, folder: str, component: int) -> Iterator[tuple[list[int], numpy.ndarray]]:
    """The first cell of each box of a level, and the component's values in it: axes x, y, z."""
    text = (path / f"{folder}_H").read_text()
    for name, offset in re.findall(r"FabOnDisk: (\S+) (\d+)", text):
        with open(path / Path(folder).parent / name, "rb") as file:
            file.seek(int(offset))
            line = file.readline().decode("ascii", "replace")
            found = re.match(r"FAB \(\((\d+), \(([\d ]+)\)\),\s*\((\d+), \(([\d ]+)\)\)\)(.*) (\d+)\s*$", line)
            if not found:
                raise NotReady(f"{path}: {name} has no box at {offset}")
            width, order = int(found.group(3)), [int(n) for n in found.group(4).split()]
            if width not in (4, 8) or sorted(order) != list(range(1, width + 1)):
                raise Unfit(f"{path}: {name} holds numbers of {width} bytes in order {order}")
            # The order names the bytes of a number, 1 being the most significant.
            dtype = numpy.dtype(f"{'>' if order[0] == 1 else '<'}f{width}")
            low, high = _box(found.group(5))
            dims = [b - a + 1 for a, b in zip(low, high)]
            if min(dims) < 1 or component >= int(found.group(6)):
                raise NotReady(f"{path}: {name} holds a box of {dims} cells and {found.group(6)} components")
            count = dims[0] * dims[1] * dims[2]
            check_size(count * width, f"{path}: {name}")
            file.seek(component * count * width, 1)
            data = file.read(count * width)
        if len(data) < count * width:
            raise NotReady(f"{path}: {name} ends early")
        yield low, numpy.frombuffer(data, dtype).reshape(dims, order="F")


def plotfile(path: Path, options: Options) -> Step:
    """The field on one level, filled from coarser ones."""
    of = header(path)
    level = of.finest if options.level is None else min(options.level, of.finest)
    name = choose(of.names, options.field, str(path))
    component, (first, last) = of.names.index(name), of.domains[level]
    dims = [b - a + 1 for a, b in zip(first, last)]
    check_size(4 * dims[0] * dims[1] * dims[2], f"{path}: level {level}")
    values = numpy.full(dims, numpy.nan, numpy.float32, order="F")
    for n in range(level + 1):
        ratio = int(numpy.prod(of.ratios[n:level], dtype=int))
        for low, box in boxes(path, of.folders[n], component):
            start = [ratio * a - b for a, b in zip(low, first)]
            end = [s + ratio * d for s, d in zip(start, box.shape)]
            inside = [max(s, 0) for s in start], [min(e, d) for e, d in zip(end, dims)]
            fine = box.repeat(ratio, 0).repeat(ratio, 1).repeat(ratio, 2) if ratio > 1 else box
            cut = tuple(slice(a - s, b - s) for a, b, s in zip(*inside, start))
            values[tuple(slice(a, b) for a, b in zip(*inside))] = fine[cut]
    spacing = [(h - l) / d for l, h, d in zip(of.low, of.high, dims)]
    origin = [l + 0.5 * s for l, s in zip(of.low, spacing)]
    return Step(values, name, of.time, spacing=tuple(spacing), origin=tuple(origin))
