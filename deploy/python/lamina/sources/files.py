"""One step of a file, by its ending. A file that cannot be read (yet) is a `NotReady` or an error of its own library."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy

from ..reader import Volume, read
from . import NotReady, Options, Step, Unfit, by_axes, check_size, choose, library, uniform, xdmf
from .amrex import is_plotfile, plotfile


def native(path: Path, options: Options) -> Step:
    """What Lamina reads itself; of a series its first step."""
    volume = read(path, field=options.field, dims=options.dims, dtype=options.dtype)
    if not isinstance(volume, Volume):
        raise NotReady(f"{path}: no volume")
    time = volume.time if len(volume) > 1 else None
    return Step(volume.array, volume.field, time, spacing=tuple(volume.spacing), origin=tuple(volume.origin))


def npy(path: Path, options: Options) -> Step:
    return Step(by_axes(numpy.load(path, mmap_mode="r", allow_pickle=False), options.axes))


def tiff(path: Path, options: Options) -> Step:
    """A stack of pages, the first at z = 0."""
    with library("tifffile", "tiff").TiffFile(path) as file:
        check_size(file.series[0].nbytes if file.series else 0, str(path))
        array = file.asarray()
        spacing = (file.imagej_metadata or {}).get("spacing", 1.0)
    return Step(by_axes(array, options.axes), spacing=(1.0, 1.0, float(spacing)))


def hdf5(path: Path, options: Options) -> Step:
    """VTKHDF, openPMD, netCDF-4 or plain HDF5."""
    h5py = library("h5py", "hdf5")
    with h5py.File(path, "r", locking=False) as file:
        if "VTKHDF" in file:
            return _vtkhdf(file["VTKHDF"], path, options)
        if "openPMD" in file.attrs:
            from .openpmd_series import first_step

            return first_step(str(path), options)
        names: list[str] = []
        file.visititems(lambda name, of: names.append(name) if isinstance(of, h5py.Dataset) and of.ndim == 3 else None)
        name = choose(names, options.field, str(path))
        data = file[name]
        check_size(data.nbytes, f"{path}: {name}")
        step = Step(by_axes(data[()], options.axes), name, _time(data, file), missing=_missing(data))
        scales = [data.dims[n][0][()] if len(data.dims[n]) else None for n in range(3)]
        if all(scale is not None and scale.ndim == 1 for scale in scales):
            placed = [uniform(scales[options.axes.index(axis)], axis) for axis in "xyz"]
            step.origin, step.spacing = tuple(p[0] for p in placed), tuple(p[1] for p in placed)
        elif "spacing" in data.attrs:
            given = [float(v) for v in numpy.ravel(data.attrs["spacing"])]
            step.spacing = tuple(given[options.axes.index(axis)] for axis in "xyz")
        return step


def _time(*places) -> float | None:
    for place in places:
        for name in ("time", "Time", "TIME"):
            if name in place.attrs:
                return float(numpy.ravel(place.attrs[name])[0])
    return None


def _missing(data) -> float | None:
    """By netCDF's conventions."""
    for name in ("_FillValue", "missing_value"):
        if name in data.attrs:
            return float(numpy.ravel(data.attrs[name])[0])
    return None


def _vtkhdf(group, path: Path, options: Options) -> Step:
    kind = group.attrs["Type"]
    kind = kind.decode() if isinstance(kind, bytes) else str(kind)
    if kind != "ImageData":
        raise Unfit(f"{path}: a VTKHDF {kind}; ImageData can be watched: resample it, such as by vtkResampleToImage")
    spacing, origin, extent = (numpy.asarray(group.attrs[name], float) for name in ("Spacing", "Origin", "WholeExtent"))
    arrays = {name: (group[data][name], data == "CellData") for data in ("PointData", "CellData") if data in group for name in group[data]}
    name = choose([name for name, (of, _) in arrays.items() if of.ndim == 3], options.field, str(path))
    data, is_of_cells = arrays[name]
    check_size(data.nbytes, f"{path}: {name}")
    first = origin + (extent[::2] + 0.5 * is_of_cells) * spacing
    return Step(data[()].transpose(), name, _time(group), spacing=tuple(spacing), origin=tuple(first))


def xarray(path: Path, options: Options) -> Step:
    """A netCDF file or a Zarr store without a time axis."""
    from .growing import opened, placed

    with opened(path) as data:
        names = [str(name) for name, of in data.data_vars.items() if of.squeeze().ndim == 3]
        name = choose(names, options.field, str(path))
        return placed(data[name].squeeze(), name, options)


READERS: dict[str, Callable[[Path, Options], Step]] = {
    **dict.fromkeys((".vti", ".nrrd", ".nhdr", ".raw", ".gz"), native),
    **dict.fromkeys((".h5", ".hdf5", ".hdf", ".vtkhdf"), hdf5),
    **dict.fromkeys((".nc", ".nc4", ".zarr"), xarray),
    **dict.fromkeys((".tif", ".tiff"), tiff),
    **dict.fromkeys(xdmf.SUFFIXES, xdmf.read_step),
    ".npy": npy,
}


def is_known(path: Path) -> bool:
    """Whether it has an ending that is read, or is a plotfile."""
    return path.suffix.lower() in READERS or is_plotfile(path)


def read_file(path: Path, options: Options) -> Step:
    """The step in `path`."""
    if is_plotfile(path):
        return plotfile(path, options)
    if path.suffix.lower() not in READERS:
        raise ValueError(f"{path}: none of {', '.join(READERS)}")
    return READERS[path.suffix.lower()](path, options)
