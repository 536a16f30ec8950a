"""Recorded steps, runs and volume files as arrays and pictures.

    step = lamina.read("step_000012.vdi")          # Vdi or Reduced
    volume = lamina.read("field.vti")           # Volume
    run = lamina.read("out/blast")              # Run: a folder that was recorded
    picture = step.render(azimuth=30)           # 512 x 512 x 3, red, green and blue in 0..1
"""

from __future__ import annotations

import csv
import ctypes
import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy

from .installed import load

Camera = dict[str, Any]


def _native() -> ctypes.CDLL:
    library = load("lamina_python", "LAMINA_READER", "lamina_read_depths")
    text, handle = ctypes.c_char_p, ctypes.c_void_p
    library.lamina_read_open.argtypes = [text, ctypes.POINTER(handle)]
    library.lamina_read_description.argtypes = [handle]
    library.lamina_read_description.restype = text
    library.lamina_read_array.argtypes = [handle, text, handle, ctypes.c_size_t]
    library.lamina_read_picture.argtypes = [handle, text, ctypes.c_uint32, ctypes.c_uint32, handle]
    library.lamina_read_depths.argtypes = library.lamina_read_picture.argtypes
    library.lamina_read_orbit.argtypes = [text, ctypes.c_double, ctypes.c_double, ctypes.c_double, ctypes.POINTER(text)]
    library.lamina_read_close.argtypes = [handle]
    library.lamina_read_close.restype = None
    library.lamina_read_error.restype = text
    return library


class Unfit(ValueError):
    """What was read is no step, and time will not make it one."""


def _check(library: ctypes.CDLL, code: int) -> None:
    if code:
        raise (Unfit if code == -2 else ValueError)(library.lamina_read_error().decode())


class _Opened:
    """An open file."""

    def __init__(self, path: Path, **request: Any) -> None:
        self.path, self._request = path, request
        self._library, self._handle = _native(), ctypes.c_void_p()
        text = json.dumps({"path": os.fspath(path), **request}).encode()
        _check(self._library, self._library.lamina_read_open(text, ctypes.byref(self._handle)))
        self.description = json.loads(self._library.lamina_read_description(self._handle))

    def __del__(self) -> None:
        if getattr(self, "_handle", None):
            self._library.lamina_read_close(self._handle)

    def _array(self, name: str) -> numpy.ndarray:
        """A copy of one of the file's arrays, slowest axis first."""
        dtype, shape = next((of[1], of[2]) for of in self.description["arrays"] if of[0] == name)
        array = numpy.empty(shape, dtype)
        copied = self._library.lamina_read_array(self._handle, name.encode(), array.ctypes.data, array.nbytes)
        _check(self._library, copied)
        return array

    @property
    def camera(self) -> Camera:
        """position, target, up and fov_y_deg: the recorded ones, or such as suit the data."""
        return self.description["camera"]

    @property
    def bounds(self) -> tuple[list[float], list[float]]:
        """Least and greatest corner of the data, world units."""
        return self.description["bounds"]["min"], self.description["bounds"]["max"]

    def orbit(self, azimuth: float = 0.0, elevation: float = 0.0, zoom: float = 1.0) -> Camera:
        """The camera turned about its target, degrees, and `zoom` times as near."""
        turned = ctypes.c_char_p()
        camera = json.dumps(self.camera).encode()
        _check(self._library, self._library.lamina_read_orbit(camera, azimuth, elevation, zoom, ctypes.byref(turned)))
        return json.loads(turned.value or b"")

    def render(
        self,
        azimuth: float = 0.0,
        elevation: float = 0.0,
        zoom: float = 1.0,
        size: int | tuple[int, int] = 512,
        camera: Camera | None = None,
    ) -> numpy.ndarray:
        """A picture of `size` (width, height) pixels: array of shape (height, width, 3), float32 in 0..1, from `camera`, or from the
        recorded one turned."""
        return self._drawn(self._library.lamina_read_picture, (3,), size, camera or self.orbit(azimuth, elevation, zoom))

    def depth(
        self,
        azimuth: float = 0.0,
        elevation: float = 0.0,
        zoom: float = 1.0,
        size: int | tuple[int, int] = 512,
        camera: Camera | None = None,
    ) -> numpy.ndarray:
        """How deep `render` sees: array of shape (height, width), float32, world units along the view to where half of the light from behind
        is gone; infinite where more comes through."""
        return self._drawn(self._library.lamina_read_depths, (), size, camera or self.orbit(azimuth, elevation, zoom))

    def _drawn(self, function: Any, channels: tuple[int, ...], size: int | tuple[int, int], camera: Camera) -> numpy.ndarray:
        width, height = (size, size) if isinstance(size, int) else size
        drawn = numpy.zeros((height, width, *channels), numpy.float32)
        _check(self._library, function(self._handle, json.dumps(camera).encode(), width, height, drawn.ctypes.data))
        return drawn

    def _repr_mimebundle_(self, **options: Any) -> Any:
        from .notebook import view

        return view(self)._repr_mimebundle_(**options)  # type: ignore[arg-type]


class Volume(_Opened):
    """A step of a volume file."""

    @property
    def array(self) -> numpy.ndarray:
        """Its voxels: axes x, y, z."""
        return self._array("values").transpose()

    @property
    def spacing(self) -> list[float]:
        """World length between neighbors, per axis."""
        return self.description["spacing"]

    @property
    def origin(self) -> list[float]:
        """World position of the first voxel."""
        return self.description["origin"]

    @property
    def field(self) -> str:
        """What the scalar is."""
        return self.description["field"]

    @property
    def time(self) -> float:
        """In the unit of the recording."""
        return self.description["time"]

    def __len__(self) -> int:
        """Steps of its series."""
        return self.description["steps"]

    def as_options(self) -> list[str]:
        """What a command of `lamina` is given to read the same."""
        of = self._request
        options = [os.fspath(self.path), "--time-step", str(of.get("step", 0))]
        if "field" in of:
            options += ["--field", of["field"]]
        if "dims" in of:
            options += ["--dims", "x".join(map(str, of["dims"]))]
        if "dtype" in of:
            options += ["--dtype", of["dtype"]]
        return options


class _Recorded(_Opened):
    """A recorded step."""

    @property
    def encoded(self) -> bytes:
        """Its bytes, with those of the steps that it was coded after: they decode without any other file."""
        return self._array("encoded").tobytes()


class Reduced(_Recorded):
    """A recorded step that is a reduced volume."""

    @property
    def units(self) -> numpy.ndarray:
        """Positions of the values in the range of the transfer function, 0 to 1 where they are in it: axes x, y, z."""
        return self._array("values").transpose()

    @property
    def array(self) -> numpy.ndarray:
        """The values, double precision: axes x, y, z. What the transfer function hides is mostly not recorded."""
        span = self.scene["transfer"]["range"]
        low, high = span["lo"], span["hi"]
        units = self.units.astype(numpy.float64)
        return low * (high / low) ** units if span["scale"] == "log10" else low + (high - low) * units

    spacing, origin = Volume.spacing, Volume.origin

    @property
    def scene(self) -> dict[str, Any]:
        """Transfer function, camera, background, sampling step and effects it was made for."""
        return self.description["scene"]

    @property
    def params(self) -> dict[str, Any]:
        """What it was made with."""
        return self.description["params"]


class Vdi(_Recorded):
    """A recorded step that is a Volumetric Depth Image: for each of r x r rays a list of supersegments, nearest first."""

    @property
    def offsets(self) -> numpy.ndarray:
        """Ray n, row by row from the upper left, owns the supersegments offsets[n] to before offsets[n + 1]."""
        return self._array("offsets")

    @property
    def depths(self) -> numpy.ndarray:
        """First step of each supersegment and the first beyond it, counted from the ray's entry into the bounds."""
        return self._array("depths")

    @property
    def colors(self) -> numpy.ndarray:
        """Red, green, blue (straight) and opacity of each supersegment, 0 to 1."""
        return self._array("colors")

    @property
    def ends(self) -> numpy.ndarray:
        """Where each supersegment begins and ends, world positions: shape (n, 2, 3). The ray is that of its pixel's center."""
        return self._array("ends")

    @property
    def step_length(self) -> float:
        """World length of a step."""
        return self.description["step_length"]

    params = Reduced.params


class Run:
    """A recorded run: the folder that `lamina live --out`, `lamina serve --out` or a viz-node's `store` has filled."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        # Of several runs the newest.
        tables = sorted(self.path.glob("**/steps.csv"), key=lambda table: table.stat().st_mtime)
        recorded = [table for table in tables if any(table.parent.glob("*.vdi"))]
        if not recorded:
            raise FileNotFoundError(f"{self.path}: no run was recorded here: no steps.csv beside .vdi files")
        self.path = recorded[-1].parent
        self._files = {int(file.stem.removeprefix("step_")): file for file in self.path.glob("step_*.vdi")}

    @property
    def table(self) -> list[dict[str, str]]:
        """steps.csv: a row a step, by the names of its columns."""
        with open(self.path / "steps.csv", newline="") as file:
            return list(csv.DictReader(file))

    @property
    def steps(self) -> list[int]:
        """Numbers of the recorded steps."""
        return sorted(self._files)

    def __getitem__(self, step: int) -> Vdi | Reduced:
        if step not in self._files:
            raise KeyError(f"step {step} was not recorded; {len(self._files)} others were")
        opened = read(self._files[step])
        assert isinstance(opened, (Vdi, Reduced))
        return opened

    def __iter__(self) -> Iterator[Vdi | Reduced]:
        return (self[step] for step in self.steps)

    def __len__(self) -> int:
        return len(self._files)

    def _repr_mimebundle_(self, **options: Any) -> Any:
        from .notebook import view

        return view(self)._repr_mimebundle_(**options)


def is_plotfile(path: Path) -> bool:
    """Whether the folder is one of AMReX; a checkpoint is none."""
    if not (path.is_dir() and (path / "Header").is_file() and (path / "Level_0").is_dir()):
        return False
    with open(path / "Header", "rb") as header:
        return header.read(9) == b"HyperCLaw"


def read(
    path: str | os.PathLike[str],
    step: int = 0,
    field: str | None = None,
    dims: tuple[int, int, int] | None = None,
    dtype: str | None = None,
    axes: str | None = None,
    level: int | None = None,
) -> Vdi | Reduced | Volume | Run:
    """A recorded step; step number `step` (from 0) of a .pvd, .vti, .nhdr, .nrrd, .raw, .raw.gz, .h5, .vtkhdf, .nc, .zarr, .tif or an AMReX
    plotfile, array `field` of it; or the run recorded in a folder. `dims` and `dtype` are those of a raw file, `axes` the order of those
    of an array that does not name them, such as "xyz", the slowest first, `level` is that of an adaptive mesh. ValueError names what is
    wrong with a file."""
    path = Path(path)
    if path.is_dir() and path.suffix != ".zarr" and not is_plotfile(path):
        return Run(path)
    request = {"step": step, "field": field, "dims": dims, "dtype": dtype, "axes": axes, "level": level}
    opened = _Opened(path, **{name: of for name, of in request.items() if of is not None})
    opened.__class__ = {"vdi": Vdi, "volume": Reduced, "file": Volume}[opened.description["kind"]]
    return opened  # type: ignore[return-value]
