"""XDMF 2 and 3: uniform grids, whole or cut into blocks, whose arrays lie in HDF5, raw binary files or the XML itself.

The format: https://www.xdmf.org/index.php/XDMF_Model_and_Format. Its axes are z, y, x, the slowest first."""

from __future__ import annotations

import time
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path

import numpy

from . import NotReady, Options, Step, Unfit, check_size, choose, library, uniform

SUFFIXES = (".xmf", ".xdmf")
POLL_SECS, UNREADABLE_SECS = 0.2, 10.0


def _root(path: Path) -> ElementTree.Element:
    try:
        root = ElementTree.parse(path).getroot()
    except ElementTree.ParseError as error:
        raise NotReady(f"{path}: {error}") from None
    domain = root.find("Domain") if root.tag == "Xdmf" else None
    if domain is None:
        raise Unfit(f"{path}: no XDMF with a Domain")
    return domain


def _numbers(text: str | None) -> list[int]:
    return [int(word) for word in (text or "").split()]


def _is(element: ElementTree.Element, key: str, *values: str) -> bool:
    return element.get(key, "").lower() in values


def _resolved(element: ElementTree.Element, domain: ElementTree.Element) -> ElementTree.Element:
    """The element that a Reference stands for: one of the form /Xdmf/Domain/..., as writers of series make them."""
    reference = element.get("Reference")
    if reference is None:
        return element
    target = (element.text or "").strip() if reference == "XML" else reference
    found = domain.find(target.removeprefix("/Xdmf/Domain/")) if target.startswith("/Xdmf/Domain/") else None
    if found is None:
        raise Unfit(f"a reference to \"{target}\"; those of the form /Xdmf/Domain/.. are followed")
    return found


def _dtype(item: ElementTree.Element) -> numpy.dtype:
    kind = item.get("NumberType", item.get("DataType", "Float")).lower()
    precision = int(item.get("Precision", 1 if kind in ("char", "uchar") else 4))
    code = {"float": "f", "int": "i", "uint": "u", "char": "i", "uchar": "u", "short": "i"}.get(kind)
    if code is None:
        raise Unfit(f"a DataItem of {kind}; Float, Int, UInt, Char and UChar are read")
    return numpy.dtype(f"{code}{precision}")


def _array(item: ElementTree.Element, path: Path, domain: ElementTree.Element) -> numpy.ndarray:
    """What a DataItem holds, of the shape it states."""
    item = _resolved(item, domain)
    shape = _numbers(item.get("Dimensions"))
    if _is(item, "ItemType", "hyperslab"):
        selection, source = item.findall("DataItem")
        start, stride, count = _array(selection, path, domain).astype(int).reshape(3, -1)
        slab = tuple(slice(s, s + d * c, d) for s, d, c in zip(start, stride, count))
        return _stored(source, path, slab).reshape(shape or count)
    if item.get("ItemType", "Uniform").lower() != "uniform":
        raise Unfit(f"{path}: a DataItem of ItemType {item.get('ItemType')}; Uniform and HyperSlab are read")
    return _stored(item, path, ()).reshape(shape)


def _stored(item: ElementTree.Element, path: Path, slab: tuple[slice, ...]) -> numpy.ndarray:
    """A DataItem's numbers, or a part of them."""
    words, shape = (item.text or "").strip(), _numbers(item.get("Dimensions"))
    form = item.get("Format", "XML").lower()
    if form == "xml":
        return numpy.array(words.split(), _dtype(item)).reshape(shape)[slab]
    if form == "hdf":
        name, _, inside = words.partition(":")
        with library("h5py", "hdf5").File(path.parent / name, "r", locking=False) as file:
            data = file[inside]
            check_size(data.nbytes, f"{path.parent / name}: {inside}")
            return data[slab]
    if form == "binary":
        order = {"little": "<", "big": ">"}.get(item.get("Endian", "Native").lower(), "=")
        size, file = int(numpy.prod(shape)), path.parent / words
        return numpy.fromfile(file, _dtype(item).newbyteorder(order), size, offset=int(item.get("Seek", 0))).reshape(shape)[slab]
    raise Unfit(f"{path}: a DataItem of format {item.get('Format')}; HDF, Binary and XML are read")


def _place(grid: ElementTree.Element, path: Path, domain: ElementTree.Element) -> tuple[numpy.ndarray, numpy.ndarray, numpy.ndarray]:
    """Points, first point and spacing of a block, each of z, y, x."""
    topology, geometry = grid.find("Topology"), grid.find("Geometry")
    if topology is None or geometry is None:
        raise Unfit(f"{path}: a grid without Topology or Geometry")
    topology, geometry = _resolved(topology, domain), _resolved(geometry, domain)
    points = _numbers(topology.get("Dimensions", topology.get("NumberOfElements")))
    kind = topology.get("TopologyType", topology.get("Type", "")).lower()
    items = geometry.findall("DataItem")
    if len(points) == 3 and kind == "3dcorectmesh" and len(items) == 2:
        origin, spacing = (_array(item, path, domain).astype(float).ravel() for item in items)
        return numpy.array(points), origin, spacing
    if len(points) == 3 and kind == "3drectmesh" and len(items) == 3:
        placed = [uniform(_array(item, path, domain), axis) for item, axis in zip(items, "xyz")][::-1]
        return numpy.array(points), numpy.array([p[0] for p in placed]), numpy.array([p[1] for p in placed])
    raise Unfit(f"{path}: a {kind or 'grid of no type'}; 3DCoRectMesh and evenly spaced 3DRectMesh are read: resample the field")


def _blocks(grid: ElementTree.Element, domain: ElementTree.Element) -> list[ElementTree.Element]:
    """The uniform grids of one step."""
    grid = _resolved(grid, domain)
    if not _is(grid, "GridType", "collection", "tree"):
        return [grid]
    return [block for child in grid.findall("Grid") for block in _blocks(child, domain)]


def _attributes(block: ElementTree.Element) -> dict[str, ElementTree.Element]:
    """Scalars by name."""
    scalars = (a for a in block.findall("Attribute") if a.get("AttributeType", "Scalar").lower() == "scalar")
    return {a.get("Name", ""): a for a in scalars}


def _time(grid: ElementTree.Element) -> float | None:
    stated = grid.find(".//Time")
    return None if stated is None or stated.get("Value") is None else float(stated.get("Value"))


def _step(grid: ElementTree.Element, path: Path, domain: ElementTree.Element, options: Options) -> Step:
    """One step, put together of its blocks, which have one spacing and cover a box."""
    blocks = _blocks(grid, domain)
    if not blocks:
        raise NotReady(f"{path}: no grid")
    name = choose(list(_attributes(blocks[0])), options.field, str(path))
    parts = []
    for block in blocks:
        attribute = _attributes(block).get(name)
        if attribute is None:
            raise Unfit(f"{path}: a block without \"{name}\"")
        points, origin, spacing = _place(block, path, domain)
        if attribute.get("Center", "Node").lower() == "cell":
            points, origin = points - 1, origin + 0.5 * spacing
        values = _array(attribute.find("DataItem"), path, domain).reshape(points)
        parts.append((values, origin, spacing))
    return _joined(parts, path, name, _time(_resolved(grid, domain)))


def _joined(parts: list, path: Path, name: str, at: float | None) -> Step:
    spacing = parts[0][2]
    first = numpy.min([origin for _, origin, _ in parts], axis=0)
    if any(not numpy.allclose(s, spacing, rtol=1e-4, atol=0) for _, _, s in parts):
        raise Unfit(f"{path}: blocks of several spacings; write one level of the mesh, or resample it")
    starts = [numpy.rint((origin - first) / spacing).astype(int) for _, origin, _ in parts]
    shape = numpy.max([start + values.shape for start, (values, _, _) in zip(starts, parts)], axis=0)
    if len(parts) == 1:
        whole = parts[0][0]
    else:
        check_size(int(numpy.prod(shape)) * parts[0][0].dtype.itemsize, str(path))
        whole, filled = numpy.zeros(shape, parts[0][0].dtype), numpy.zeros(shape, bool)
        for start, (values, _, _) in zip(starts, parts):
            place = tuple(slice(s, s + n) for s, n in zip(start, values.shape))
            whole[place], filled[place] = values, True
        if not filled.all():
            raise Unfit(f"{path}: blocks that leave {numpy.count_nonzero(~filled)} of {filled.size} points open")
    return Step(whole.transpose(), name, at, spacing=tuple(spacing[::-1]), origin=tuple(first[::-1]))


def _series(domain: ElementTree.Element) -> list[ElementTree.Element] | None:
    """The steps of a temporal collection, if it is one."""
    for grid in domain.findall("Grid"):
        if _is(grid, "GridType", "collection") and _is(grid, "CollectionType", "temporal"):
            return grid.findall("Grid")
    return None


def has_time(path: Path) -> bool:
    """Whether it holds a series of steps."""
    if path.suffix.lower() not in SUFFIXES or not path.is_file():
        return False
    try:
        return _series(_root(path)) is not None
    except NotReady:
        return False


def read_step(path: Path, options: Options) -> Step:
    """The step of a file that holds one."""
    domain = _root(path)
    grid = domain.find("Grid")
    if grid is None:
        raise NotReady(f"{path}: no grid")
    return _step(grid, path, domain, options)


def steps(path: Path, options: Options) -> Iterator[Step]:
    """Each step of a temporal collection, also of one that gains them; one that is not whole yet is looked at again."""
    given, newest = 0, time.monotonic()
    while not options.stopped():
        try:
            domain = _root(path)
            for grid in (_series(domain) or [])[given:]:
                step = _step(grid, path, domain, options)
                step.number, given, newest = given, given + 1, time.monotonic()
                yield step
        except Unfit:
            raise
        except (OSError, ValueError, KeyError, NotReady):
            # The XML may be ahead of the arrays.
            if time.monotonic() - newest > UNREADABLE_SECS:
                raise
        if time.monotonic() - newest > options.quiet_secs:
            return
        time.sleep(POLL_SECS)
