"""One step of a file, by its ending. A file that cannot be read (yet) is a `NotReady` or an error of its own library."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy

from ..reader import Volume, is_plotfile, read
from . import NotReady, Options, Step, by_axes, choose, xdmf


def native(path: Path, options: Options) -> Step:
    """What Lamina reads itself; of a series its first step."""
    volume = read(path, field=options.field, dims=options.dims, dtype=options.dtype, axes=options.axes, level=options.level)
    if not isinstance(volume, Volume):
        raise NotReady(f"{path}: no volume")
    return Step(volume.array, volume.field, volume.time, spacing=tuple(volume.spacing), origin=tuple(volume.origin))


def npy(path: Path, options: Options) -> Step:
    return Step(by_axes(numpy.load(path, mmap_mode="r", allow_pickle=False), options.axes))


def xarray(path: Path, options: Options) -> Step:
    """A netCDF file or a Zarr store without a time axis."""
    from .growing import opened, placed

    with opened(path) as data:
        names = [str(name) for name, of in data.data_vars.items() if of.squeeze().ndim == 3]
        name = choose(names, options.field, str(path))
        return placed(data[name].squeeze(), name, options)


READERS: dict[str, Callable[[Path, Options], Step]] = {
    **dict.fromkeys((".vti", ".nrrd", ".nhdr", ".raw", ".gz", ".h5", ".hdf5", ".hdf", ".vtkhdf", ".tif", ".tiff"), native),
    **dict.fromkeys((".nc", ".nc4", ".zarr"), xarray),
    **dict.fromkeys(xdmf.SUFFIXES, xdmf.read_step),
    ".npy": npy,
}


def is_known(path: Path) -> bool:
    """Whether it has an ending that is read, or is a plotfile."""
    return path.suffix.lower() in READERS or is_plotfile(path)


def read_file(path: Path, options: Options) -> Step:
    """The step in `path`."""
    if is_plotfile(path):
        return native(path, options)
    if path.suffix.lower() not in READERS:
        raise ValueError(f"{path}: none of {', '.join(READERS)}")
    return READERS[path.suffix.lower()](path, options)
