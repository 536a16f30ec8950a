"""The installed package: checks.py ROOT FOLDER [NAME..]. Each door is given the same six steps, written by the library of its format
while it is watched; what is recorded is held to the closed form and to the pictures of the .vti door."""

import csv
import json
import math
import os
import re
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy

import lamina

ROOT, FOLDER, ONLY = Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3:]
ANGLE = math.radians(30)
DIMS, SPACING, ORIGIN, STEPS = (40, 36, 32), (0.05, 0.05, 0.05), (-1.0, -0.9, -0.8), 6
# Colors from the range of the data, no matter which step comes first.
SCENE = """
camera = { position = [2.4, 1.2, 3.2], target = [0.0, 0.0, 0.0], up = [0.0, 1.0, 0.0], fov_y_deg = 35.0 }
[transfer]
range = { lo = 0.0, hi = 1.0, scale = "linear" }
unit_length = 0.05
points = [
  { at = 0.0, color = [0.1, 0.1, 0.6], opacity = 0.002 },
  { at = 0.5, color = [0.9, 0.5, 0.2], opacity = 0.08 },
  { at = 1.0, color = [1.0, 1.0, 0.9], opacity = 0.6 },
]
"""


def blob(step):
    """A blob that drifts: axes x, y, z, x slowest in memory."""
    x, y, z = numpy.meshgrid(*(o + s * numpy.arange(n) for o, s, n in zip(ORIGIN, SPACING, DIMS)), indexing="ij")
    return (1.0 / (1.0 + 9.0 * ((x - 0.1 * step) ** 2 + y**2 + z**2))).astype(numpy.float32)


def as_zyx(step):
    return numpy.ascontiguousarray(blob(step).transpose())


def write_vti(path, step):
    """XML image data with an appended raw array, as VTK writes it."""
    extent = " ".join(f"0 {n - 1}" for n in DIMS)
    data = as_zyx(step).tobytes()
    head = (
        f'<VTKFile type="ImageData" version="1.0" byte_order="LittleEndian" header_type="UInt64">'
        f'<ImageData WholeExtent="{extent}" Origin="{ORIGIN[0]} {ORIGIN[1]} {ORIGIN[2]}" Spacing="{SPACING[0]} {SPACING[1]} {SPACING[2]}">'
        f'<Piece Extent="{extent}"><PointData><DataArray type="Float32" Name="rho" format="appended" offset="0"/></PointData></Piece>'
        f'</ImageData><AppendedData encoding="raw">_'
    )
    path.write_bytes(head.encode() + len(data).to_bytes(8, "little") + data + b"</AppendedData></VTKFile>")


class Vti:
    source = "vti"

    def write(self, folder):
        for step in range(STEPS):
            write_vti(folder / f"out_{step:03}.vti", step)
            yield


class Hdf5:
    """Scales give the grid, as netCDF-4 has it."""

    source = "hdf5/run_*.h5"

    def write(self, folder):
        import h5py

        for step in range(STEPS):
            with h5py.File(folder / f"run_{step}.h5", "w") as file:
                data = file.create_dataset("fields/rho", data=as_zyx(step), chunks=(8, 18, 20), compression="gzip")
                data.attrs["time"] = 0.5 * step
                for n, axis in enumerate("zyx"):
                    k = "xyz".index(axis)
                    scale = file.create_dataset(axis, data=ORIGIN[k] + SPACING[k] * numpy.arange(DIMS[k]))
                    scale.make_scale(axis)
                    data.dims[n].attach_scale(scale)
            yield


class VtkHdf:
    source = "vtkhdf"

    def write(self, folder):
        import h5py

        for step in range(STEPS):
            with h5py.File(folder / f"step{step}.vtkhdf", "w") as file:
                group = file.create_group("VTKHDF")
                group.attrs["Version"] = (1, 0)
                group.attrs.create("Type", b"ImageData", dtype=h5py.string_dtype("ascii", 9))
                group.attrs["WholeExtent"] = [0, DIMS[0] - 1, 0, DIMS[1] - 1, 0, DIMS[2] - 1]
                group.attrs["Origin"], group.attrs["Spacing"] = ORIGIN, SPACING
                group.create_dataset("PointData/rho", data=as_zyx(step))
            yield


def dataset(step):
    import xarray

    coords = {axis: ORIGIN[k] + SPACING[k] * numpy.arange(DIMS[k]) for k, axis in enumerate("xyz")}
    return xarray.Dataset({"rho": (("time", "z", "y", "x"), as_zyx(step)[None])}, {**coords, "time": [0.5 * step]})


class NetCdf:
    """A file a step, without a time axis."""

    source = "netcdf"

    def write(self, folder):
        for step in range(STEPS):
            dataset(step).isel(time=0).to_netcdf(folder / f"s{step}.nc", engine="h5netcdf")
            yield


class Zarr:
    """One store that grows."""

    source = "zarr/sim.zarr"

    def write(self, folder):
        for step in range(STEPS):
            path = folder / "sim.zarr"
            dataset(step).to_zarr(path, consolidated=False, **({"append_dim": "time"} if path.exists() else {}))
            yield


class Tiff:
    source, options, spacing = "tiff", ["--spacing", "0.05,0.05,0.05", "--origin=-1.0,-0.9,-0.8"], (0.05,) * 3

    def write(self, folder):
        import tifffile

        for step in range(STEPS):
            tifffile.imwrite(folder / f"stack{step}.tif", as_zyx(step))
            yield


class Npy:
    """x slowest, and said so."""

    source, options = "npy", ["--axes", "xyz", "--spacing", "0.05,0.05,0.05", "--origin=-1.0,-0.9,-0.8"]

    def write(self, folder):
        for step in range(STEPS):
            numpy.save(folder / f"a{step}.npy", blob(step))
            yield


def xdmf_grid(step, first, planes, item):
    """Planes of the grid from z index `first` on, whose numbers `item` describes; XDMF has z, y, x."""
    zyx = lambda values: " ".join(str(v) for v in values[::-1])
    dims, origin = (*DIMS[:2], planes), (*ORIGIN[:2], ORIGIN[2] + first * SPACING[2])
    return (
        f'<Grid Name="g{first}"><Time Value="{0.5 * step}"/><Topology TopologyType="3DCoRectMesh" Dimensions="{zyx(dims)}"/>'
        f'<Geometry GeometryType="ORIGIN_DXDYDZ"><DataItem Dimensions="3" Format="XML">{zyx(origin)}</DataItem>'
        f'<DataItem Dimensions="3" Format="XML">{zyx(SPACING)}</DataItem></Geometry>'
        f'<Attribute Name="v" AttributeType="Vector"/><Attribute Name="rho" Center="Node">{item(zyx(dims))}</Attribute></Grid>'
    )


def write_whole(path, text):
    """So that nobody reads half of it."""
    path.with_suffix(".part").write_text(f'<?xml version="1.0"?><Xdmf Version="3.0"><Domain>{text}</Domain></Xdmf>')
    path.with_suffix(".part").rename(path)


class Xdmf:
    """A file a step, of two blocks that share a plane: one of a raw file's end, big-endian, the other a part of an HDF5 array."""

    source = "xdmf/*.xmf"

    def write(self, folder):
        import h5py

        for step in range(STEPS):
            values = as_zyx(step)
            (folder / f"low{step}.bin").write_bytes(b"head" + values[:13].astype(">f4").tobytes())
            with h5py.File(folder / f"high{step}.h5", "w") as file:
                file["all/rho"] = values
            low = lambda dims: f'<DataItem Dimensions="{dims}" Format="Binary" Endian="Big" Seek="4">low{step}.bin</DataItem>'
            part = f'<DataItem Dimensions="3 3" Format="XML">12 0 0 1 1 1 {DIMS[2] - 12} {DIMS[1]} {DIMS[0]}</DataItem>'
            whole = f'<DataItem Dimensions="{DIMS[2]} {DIMS[1]} {DIMS[0]}" Format="HDF">high{step}.h5:/all/rho</DataItem>'
            high = lambda dims: f'<DataItem ItemType="HyperSlab" Dimensions="{dims}">{part}{whole}</DataItem>'
            blocks = xdmf_grid(step, 0, 13, low) + xdmf_grid(step, 12, DIMS[2] - 12, high)
            write_whole(folder / f"step{step}.xmf", f'<Grid GridType="Collection" CollectionType="Spatial">{blocks}</Grid>')
            yield


class XdmfSeries:
    """A collection that gains steps, the XML ahead of the arrays."""

    source, options = "xdmf-series/run.xdmf", ["--field", "rho"]

    def write(self, folder):
        import h5py

        grids = ""
        for step in range(STEPS):
            item = lambda dims: f'<DataItem Dimensions="{dims}" Format="HDF">s{step}.h5:/rho</DataItem>'
            grids += xdmf_grid(step, 0, DIMS[2], item)
            write_whole(folder / "run.xdmf", f'<Grid GridType="Collection" CollectionType="Temporal">{grids}</Grid>')
            with h5py.File(folder / f"s{step}.h5", "w") as file:
                file["rho"] = as_zyx(step)
            yield


class Amrex:
    """Plotfiles of two levels, the finer over the whole; cells whose centers are the points."""

    source, options = "amrex", ["--field", "rho"]

    def write(self, folder):
        for step in range(STEPS):
            write_plotfile(folder / f"plt{step:05}", step)
            yield


def write_plotfile(path, step, first=0):
    """As AMReX writes it (HyperCLaw-V1.1): two components, boxes of at most half the domain a side, the second level twice as fine."""
    domains = [[n // 2 for n in DIMS], list(DIMS)]
    low = [o - 0.5 * s for o, s in zip(ORIGIN, SPACING)]
    high = [l + s * n for l, s, n in zip(low, SPACING, DIMS)]
    text = lambda numbers: "(" + ",".join(str(n) for n in numbers) + ")"
    box = lambda a, b: f"({text(a)} {text(b)} (0,0,0))"
    fine = blob(step).astype(numpy.float64)
    coarse = fine.reshape(domains[0][0], 2, domains[0][1], 2, domains[0][2], 2).mean((1, 3, 5))
    lines = ["HyperCLaw-V1.1", "2", "other", "rho", "3", repr(0.5 * step), "1", " ".join(map(repr, low)), " ".join(map(repr, high)), "2"]
    lines += [" ".join(box([0, 0, 0], [n - 1 for n in d]) for d in domains), f"{step} {step}"]
    lines += [" ".join(repr((h - l) / n) for l, h, n in zip(low, high, d)) for d in domains] + ["0", "0"]
    path.mkdir()
    for level, (values, d) in enumerate(((coarse, domains[0]), (fine, domains[1]))):
        # The finer level covers all but the first cells along x.
        begin = first if level else 0
        cuts = [[begin, (begin + d[0]) // 2, d[0]], [0, d[1] // 2, d[1]], [0, d[2]]]
        found = [
            ([cuts[0][i], cuts[1][j], cuts[2][0]], [cuts[0][i + 1] - 1, cuts[1][j + 1] - 1, cuts[2][1] - 1]) for i in range(2) for j in range(2)
        ]
        folder = path / f"Level_{level}"
        folder.mkdir()
        entries = []
        with open(folder / "Cell_D_00000", "wb") as file:
            for a, b in found:
                entries.append(f"FabOnDisk: Cell_D_00000 {file.tell()}")
                file.write(f"FAB ((8, (64 11 52 0 1 12 0 1023)),(8, (8 7 6 5 4 3 2 1))){box(a, b)} 2\n".encode())
                part = values[tuple(slice(p, q + 1) for p, q in zip(a, b))]
                for component in (numpy.zeros_like(part), part):
                    file.write(component.tobytes(order="F"))
        (folder / "Cell_H").write_text("\n".join(["1", "1", "2", "0", f"({len(found)} 0", *(box(a, b) for a, b in found), ")", str(len(found)), *entries, ""]))
        lines += [f"{level} {len(found)} {0.5 * step!r}", str(step)]
        for a, b in found:
            lines += [f"{low[k] + a[k] * (high[k] - low[k]) / d[k]!r} {low[k] + (b[k] + 1) * (high[k] - low[k]) / d[k]!r}" for k in range(3)]
        lines.append(f"Level_{level}/Cell")
    (path / "Header").write_text("\n".join(lines) + "\n")


class OpenPmd:
    extension, source = "h5", "openpmd_h5/data_%T.h5"

    def write(self, folder):
        import openpmd_api as io

        series = io.Series(str(folder / f"data_%T.{self.extension}"), io.Access.create)
        for step in range(STEPS):
            write_iteration(io, series, step)
            yield
        series.close()


class OpenPmdBp(OpenPmd):
    extension, source = "bp", "openpmd_bp/data_%T.bp"


def write_iteration(io, series, step):
    """Stored z, y, x; grid in millimeters."""
    iteration = series.write_iterations()[step]
    iteration.time, iteration.dt, iteration.time_unit_SI = 0.5 * step, 0.5, 1.0
    mesh = iteration.meshes["rho"]
    mesh.axis_labels, mesh.grid_unit_SI = ["z", "y", "x"], 1e-3
    mesh.grid_spacing = [1e3 * s for s in SPACING[::-1]]
    mesh.grid_global_offset = [1e3 * o for o in ORIGIN[::-1]]
    values = as_zyx(step)
    component = mesh[io.Mesh_Record_Component.SCALAR]
    component.reset_dataset(io.Dataset(values.dtype, values.shape))
    component.position = [0.0, 0.0, 0.0]
    component[()] = values
    iteration.close()


class OpenPmdStream:
    """Through ADIOS2's SST, from this process to the one that watches."""

    source, stream = "openpmd:openpmd_sst/live.sst", True

    def write(self, folder):
        import openpmd_api as io

        config = {"adios2": {"engine": {"parameters": {"DataTransport": "WAN", "OpenTimeoutSecs": "60"}}}}
        series = io.Series(str(folder / "live.sst"), io.Access.create, json.dumps(config))
        for step in range(STEPS):
            write_iteration(io, series, step)
            yield
        series.close()


class Adios:
    """A BP5 file that is watched while it is written."""

    source, engine = "adios_bp/sim.bp", "BP5"
    options = ["--spacing", "0.05,0.05,0.05", "--origin=-1.0,-0.9,-0.8"]
    parameters: dict = {}
    stream = True

    def write(self, folder):
        import adios2

        io = adios2.Adios().declare_io("simulation")
        io.set_engine(self.engine)
        io.set_parameters(self.parameters)
        name = str(folder / Path(self.source).name).removesuffix(".sst")
        with adios2.Stream(io, name, "w") as stream:
            for step in range(STEPS):
                stream.begin_step()
                values = as_zyx(step)
                stream.write("rho", values, values.shape, [0, 0, 0], values.shape)
                stream.write("time", numpy.array(0.5 * step))
                stream.end_step()
                yield


class AdiosStream(Adios):
    source, engine, parameters = "adios_sst/sim.sst", "SST", {"DataTransport": "WAN", "OpenTimeoutSecs": "60"}


DOORS = {
    "vti": Vti,
    "hdf5": Hdf5,
    "vtkhdf": VtkHdf,
    "netcdf": NetCdf,
    "zarr": Zarr,
    "tiff": Tiff,
    "npy": Npy,
    "xdmf": Xdmf,
    "xdmf-series": XdmfSeries,
    "amrex": Amrex,
    "openpmd-h5": OpenPmd,
    "openpmd-bp": OpenPmdBp,
    "openpmd-sst": OpenPmdStream,
    "adios-bp": Adios,
    "adios-sst": AdiosStream,
}


def psnr(a, b):
    error = float(numpy.mean((a.astype(numpy.float64) - b) ** 2))
    return math.inf if error == 0 else 10 * math.log10(1 / error)


def watched(name, door):
    """Watches the door's source while it is written; the recorded run, and the seconds from the command to the first recorded step."""
    scheme, path = ("openpmd:", door.source[8:]) if door.source.startswith("openpmd:") else ("", door.source)
    source, out = FOLDER / path, FOLDER / "record" / name
    folder = source if "." not in source.name else source.parent
    folder.mkdir(parents=True, exist_ok=True)
    steps = door.write(folder)
    stream = getattr(door, "stream", False)
    if not stream:
        next(steps)
    command = ["lamina", "watch", scheme + str(source), "--out", str(out), "--scene", str(FOLDER / "scene.toml"), "--exit", "--quiet", "3"]
    command += ["--viewer", "127.0.0.1:0", "--contract", "size <= 60kB, psnr >= 30dB", *getattr(door, "options", [])]
    begun = time.monotonic()
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    first = []
    lines = []

    def follow():
        for line in process.stdout:
            lines.append(line)
            if line.startswith("step ") and not first:
                first.append(time.monotonic() - begun)

    reader = threading.Thread(target=follow)
    reader.start()
    try:
        # A stream's writer may wait for its reader.
        for _ in steps:
            time.sleep(0.4)
        process.wait(120)
    finally:
        process.kill()
        reader.join()
    assert process.returncode == 0, "".join(lines)
    return lamina.read(out), (first or [math.nan])[0], "".join(lines)


def check_doors():
    print(f"{'door':12} {'steps':>5} {'first after, s':>14} {'largest, kB':>11} {'off by':>9} {'from .vti, dB':>13}")
    reference = None
    for name, door in DOORS.items():
        if ONLY and name not in ONLY and name != "vti":
            continue
        run, first, said = watched(name, door())
        assert run.steps == list(range(STEPS)), (name, run.steps, said)
        rows = run.table
        sizes = [int(row["size_bytes"]) for row in rows]
        assert max(sizes) <= 60_000, (name, sizes)
        step = run[STEPS - 1]
        picture = step.render(azimuth=25, size=256)
        reference = picture if reference is None else reference
        assert picture.std() > 0.02, f"{name}: the picture shows nothing"
        if isinstance(step, lamina.Reduced):
            # On its own lattice over the same box the closed form holds to the error bound, where its points are those of the data.
            assert numpy.allclose(step.origin, ORIGIN, atol=1e-5), (name, step.origin)
            end = [o + s * (n - 1) for o, s, n in zip(step.origin, step.spacing, step.units.shape)]
            assert numpy.allclose(end, [o + s * (n - 1) for o, s, n in zip(ORIGIN, SPACING, DIMS)], atol=1e-5), (name, end)
            off = numpy.abs(step.array - blob(STEPS - 1)).max() if step.units.shape == DIMS else math.nan
        else:
            off = math.nan
        # What a notebook is sent needs no other file.
        alone = FOLDER / "alone.vdi"
        alone.write_bytes(step.encoded)
        assert numpy.array_equal(lamina.read(alone).render(azimuth=25, size=256), picture), name
        same = psnr(picture, reference)
        print(f"{name:12} {len(run):5} {first:14.1f} {max(sizes) / 1e3:11.1f} {off:9.5f} {same:13.1f}", flush=True)
        assert same >= 60, (name, same)
        if name not in ("tiff", "npy", "vti", "vtkhdf"):
            times = [float(row["time"]) for row in rows]
            assert numpy.allclose(times, [0.5 * n for n in range(STEPS)]), (name, times)


def check_reader():
    """Arrays against the closed form, pictures against the command line's, lists against the independent reader."""
    path = FOLDER / "one.vti"
    write_vti(path, 1)
    volume = lamina.read(path)
    assert numpy.array_equal(volume.array, blob(1)) and volume.field == "rho"
    assert numpy.allclose(volume.spacing, SPACING) and numpy.allclose(volume.origin, ORIGIN)
    encoded = {"vdi": FOLDER / "one.vdi", "volume": FOLDER / "one.lvol"}
    for kind, file in encoded.items():
        size = ["--scene", str(FOLDER / "scene.toml"), "--resolution", "48", "--gamma", "0.02"]
        subprocess.run(["lamina", "generate", str(path), "--representation", kind, *size, "--out", str(file)], check=True, capture_output=True)
    vdi, reduced = lamina.read(encoded["vdi"]), lamina.read(encoded["volume"])
    assert isinstance(vdi, lamina.Vdi) and isinstance(reduced, lamina.Reduced)
    # The independent reader of the format page gives the same lists.
    said = subprocess.run([sys.executable, str(ROOT / "tests/read_vdi.py"), str(encoded["vdi"]), "--segments"], check=True, capture_output=True)
    independent = json.loads(said.stdout)
    lists = independent["list"]
    counts = numpy.diff(vdi.offsets)
    rays = numpy.repeat(numpy.arange(len(counts)), counts)
    mine = numpy.column_stack([rays, vdi.depths])
    assert numpy.array_equal(mine, numpy.array([row[:3] for row in lists])), "lists differ from the independent reader's"
    check_geometry(vdi)
    # A reduced volume of all points is the data within its bound: 2 % of the range, all of which is shown.
    assert reduced.units.shape == DIMS and numpy.abs(reduced.array - blob(1)).max() <= 0.02
    for opened, file in ((vdi, encoded["vdi"]), (reduced, encoded["volume"])):
        subprocess.run(["lamina", "render", str(file), "--view", "30", "--size", "200", "--out", str(FOLDER / "view.png")], check=True, capture_output=True)
        pixels = read_png(FOLDER / "view.png")
        x, y, z = opened.camera["position"]
        turned = {**opened.camera, "position": [x * math.cos(ANGLE) + z * math.sin(ANGLE), y, z * math.cos(ANGLE) - x * math.sin(ANGLE)]}
        mine = numpy.rint(opened.render(camera=turned, size=200).clip(0, 1) * 255)
        assert psnr(mine / 255, pixels / 255) > 60, psnr(mine / 255, pixels / 255)
    page = lamina.view(vdi)
    assert "lamina-step" in page.html and "<iframe" in page._repr_html_()
    page.save(FOLDER / "view.html")
    assert "lamina-engine" in lamina.view(path).html
    widget = lamina.view(vdi, size=300).widget
    assert (widget.encoded, widget.steps, widget.size) == (vdi.encoded, [0], 300) and "application/vnd.jupyter.widget-view+json" in vdi._repr_mimebundle_()[0]
    for broken, words in ((FOLDER / "none.vti", "none.vti"), (FOLDER / "bad.vdi", "bad.vdi")):
        (FOLDER / "bad.vdi").write_bytes(b"LVDI and then nothing")
        try:
            lamina.read(broken)
            raise AssertionError(f"{broken} was read")
        except ValueError as error:
            assert words in str(error), error
    print("reader: arrays, lists, pictures, view")


def check_uneven():
    """A run on a rectilinear grid, as recorded: its function at the even points. Wrong coordinates are refused by name."""
    folder = FOLDER / "uneven"
    command = ["lamina", "serve", "--listen", "127.0.0.1:0", "--viewer", "127.0.0.1:0", "--representation", "volume", "--out", str(folder)]
    serve = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        address = serve.stdout.readline().split("connect to ")[1].split(";")[0]
        dims = (40, 30, 20)
        # A channel: denser towards its walls along y; denser at the beginning of x.
        x, y = numpy.linspace(0, 1, dims[0]) ** 2 * 4, 1 - numpy.cos(numpy.linspace(0, numpy.pi, dims[1]))
        z = numpy.arange(dims[2]) * 0.1
        function = lambda x, y, z: numpy.exp(-((x - 1.5) ** 2) - 3 * (y - 1) ** 2 - (z - 1) ** 2)
        of_run = {"dims": dims, "type": "float64", "generator": address, "spacing": (1, 1, 0.1)}
        for wrong, words in (((x[::-1], y, None), "descend"), ((x[:-1], y, None), "39 positions along x"), ((x, numpy.full(30, 1.0), None), "along y")):
            try:
                lamina.Client("uneven", "u", coordinates=wrong, **of_run)
                raise AssertionError(f"coordinates were taken: {words}")
            except ValueError as error:
                assert words in str(error), error
        with lamina.Client("uneven", "u", coordinates=(x, y, None), **of_run) as run:
            for step in range(3):
                values = function(x[None, None, :], y[None, :, None], z[:, None, None]).transpose()
                run.push(step, 0.1 * step, numpy.asfortranarray(values))
        deadline, tables = time.monotonic() + 60, []
        while not tables and time.monotonic() < deadline:
            time.sleep(0.1)
            tables = [table for table in folder.glob("*/steps.csv") if len(table.read_text().splitlines()) > 1]
        recorded = lamina.read(folder)
        step = recorded[recorded.steps[-1]]
        low, high = step.bounds
        assert numpy.allclose(low, (0, 0, 0)) and numpy.allclose(high, (4, 2, 1.9)), step.bounds
        axes = [o + numpy.arange(n) * s for o, s, n in zip(step.origin, step.spacing, step.array.shape)]
        wanted = function(axes[0][:, None, None], axes[1][None, :, None], axes[2][None, None, :])
        off = numpy.abs(step.array - wanted)
        assert off.mean() < 0.02 and numpy.quantile(off, 0.99) < 0.1, (off.mean(), off.max())
    finally:
        serve.terminate()
        serve.wait()
    print(f"uneven: a rectilinear grid, {off.mean():.4f} off its function in the mean")


def rays_of(camera, side):
    """Unit directions through the centers of side x side pixels, row by row from the upper left; and the view's."""
    position, target, up = (numpy.array(camera[name]) for name in ("position", "target", "up"))
    view = (target - position) / numpy.linalg.norm(target - position)
    right = numpy.cross(view, up)
    right /= numpy.linalg.norm(right)
    half = math.tan(math.radians(camera["fov_y_deg"]) / 2)
    across = half * ((2 * numpy.arange(side) + 1) / side - 1)
    directions = view + across[None, :, None] * right - across[:, None, None] * numpy.cross(right, view)
    return (directions / numpy.linalg.norm(directions, axis=2, keepdims=True)).reshape(-1, 3), view


def check_geometry(vdi):
    """Ends of supersegments, and how deep one sees, against the lists and the camera."""
    side = math.isqrt(len(vdi.offsets) - 1)
    directions, view = rays_of(vdi.camera, side)
    eye, (low, high) = numpy.array(vdi.camera["position"]), map(numpy.array, vdi.bounds)
    with numpy.errstate(divide="ignore"):
        walls = numpy.stack([(low - eye) / directions, (high - eye) / directions])
    entry, leave = walls.min(0).max(1).clip(0), walls.max(0).min(1)
    rays = numpy.repeat(numpy.arange(side * side), numpy.diff(vdi.offsets))
    along = numpy.minimum(entry[rays, None] + vdi.depths * vdi.step_length, leave[rays, None])
    assert numpy.allclose(vdi.ends, eye + along[:, :, None] * directions[rays, None], atol=1e-9), "ends of supersegments"
    # From where the VDI was made each pixel sees its own list: half of the light is gone within the supersegment that hides so much.
    depth, seen = vdi.depth(size=side).ravel(), 0
    for ray in range(side * side):
        of_ray = slice(vdi.offsets[ray], vdi.offsets[ray + 1])
        through = numpy.cumprod(1 - vdi.colors[of_ray, 3].astype(float))
        if numpy.any(abs(through - 0.5) < 1e-3):
            continue
        hidden = numpy.flatnonzero(through < 0.5)
        assert (len(hidden) > 0) == numpy.isfinite(depth[ray]), (ray, through)
        if len(hidden):
            near, far = along[of_ray][hidden[0]] * (directions[ray] @ view)
            assert near - 1e-5 <= depth[ray] <= far + 1e-5, (ray, near, depth[ray], far)
            seen += 1
    assert seen > 50, seen


def check_paraview():
    """ParaView's reader as an algorithm of plain VTK."""
    assert Path(lamina.paraview_path()).is_file()
    from lamina import paraview_plugin
    from vtk.util.numpy_support import vtk_to_numpy

    run = lamina.read(FOLDER / "blast/vdi")
    last = run.path / f"step_{run.steps[-1]:06}.vdi"
    reader = paraview_plugin.Reader()
    reader.SetFileName(str(last))
    reader.UpdateInformation()
    times = reader.GetTimestepValues()
    alike = [row for row in run.table if row["resolution"] == run.table[-1]["resolution"]]
    assert times == sorted(float(row["time"]) for row in alike) and len(times) >= 2, times
    for row in alike:
        reader.UpdateTimeStep(float(row["time"]))
        image, step = reader.GetOutputDataObject(0), run[int(row["step"])]
        values = vtk_to_numpy(image.GetPointData().GetArray("density")).reshape(image.GetDimensions(), order="F")
        assert numpy.array_equal(values, step.array) and numpy.allclose(image.GetOrigin(), step.origin)
        assert image.GetInformation().Get(image.DATA_TIME_STEP()) == float(row["time"])
    reader = paraview_plugin.Reader()
    reader.SetFileName(str(FOLDER / "one.vdi"))
    reader.Update()
    lines, vdi = reader.GetOutputDataObject(0), lamina.read(FOLDER / "one.vdi")
    assert lines.GetNumberOfLines() == len(vdi.depths)
    points = vtk_to_numpy(lines.GetPoints().GetData()).reshape(-1, 2, 3)
    assert numpy.array_equal(points, vdi.ends)
    opacity = vtk_to_numpy(lines.GetCellData().GetArray("rgba"))[:, 3]
    assert numpy.abs(opacity / 255 - vdi.colors[:, 3]).max() <= 0.5 / 255 + 1e-6
    print("paraview: a series of reduced volumes, a VDI's lines")


def check_movies():
    """Movies of the run's steps: WebP read by Pillow exactly, MP4 by ffmpeg nearly."""
    import shutil

    from PIL import Image, ImageSequence

    run = lamina.read(FOLDER / "blast/vdi")
    movie = FOLDER / "series.webp"
    turning = ["--size", "64", "--turn", "90", "--elevations=10"]
    subprocess.run(["lamina", "export", str(FOLDER / "blast"), "--out", str(movie), *turning], check=True, capture_output=True)
    with Image.open(movie) as opened:
        frames = [(numpy.asarray(frame.convert("RGB")), frame.info["duration"]) for frame in ImageSequence.Iterator(opened)]
    assert [duration for _, duration in frames] == [40] * len(run)
    for n, (step, (frame, _)) in enumerate(zip(run, frames)):
        mine = numpy.rint(step.render(azimuth=30 * n, elevation=10, size=64).clip(0, 1) * 255)
        assert psnr(mine / 255, frame / 255) > 60, n
    if shutil.which("ffmpeg"):
        movie = FOLDER / "step.mp4"
        command = ["lamina", "export", str(run.path / f"step_{run.steps[-1]:06}.vdi"), "--out", str(movie), "--size", "64", "--frames", "4"]
        subprocess.run(command, check=True, capture_output=True)
        raw = subprocess.run(["ffmpeg", "-loglevel", "error", "-i", str(movie), "-f", "rawvideo", "-pix_fmt", "rgb24", "-"], check=True, capture_output=True)
        frames = numpy.frombuffer(raw.stdout, numpy.uint8).reshape(-1, 64, 64, 3)
        assert len(frames) == 4
        for n, frame in enumerate(frames):
            assert psnr(run[run.steps[-1]].render(azimuth=90 * n, size=64).clip(0, 1), frame / 255) > 30, n
    print("movies: WebP" + (", MP4" if shutil.which("ffmpeg") else "; no ffmpeg here"))


def check_exports():
    """What `lamina export` writes: image data opened by VTK, a Cinema database held to its specification (D)."""
    import vtk
    from vtk.util.numpy_support import vtk_to_numpy

    options = ["--steps", "3", "--headless", "--cells", "40", "--representation", "volume", "--out", str(FOLDER / "blast")]
    subprocess.run(["lamina", "live", *options], check=True, capture_output=True)
    series, cinema = FOLDER / "series.pvd", FOLDER / "series.cdb"
    subprocess.run(["lamina", "export", str(FOLDER / "blast"), "--out", str(series)], check=True, capture_output=True)
    views = ["--azimuths", "4", "--elevations=-20,20", "--size", "64"]
    subprocess.run(["lamina", "export", str(FOLDER / "blast"), "--out", str(cinema), *views], check=True, capture_output=True)
    run = lamina.read(FOLDER / "blast/vdi")
    for n in run.steps:
        reader = vtk.vtkXMLImageDataReader()
        reader.SetFileName(str(FOLDER / f"series_steps/step_{n:06}.vti"))
        reader.Update()
        image = reader.GetOutput()
        array = image.GetPointData().GetArray("density")
        values = vtk_to_numpy(array).reshape(image.GetDimensions(), order="F")
        assert numpy.allclose(values, run[n].array, rtol=1e-5) and numpy.allclose(image.GetSpacing(), run[n].spacing)
    one = FOLDER / "step.vtkhdf"
    subprocess.run(["lamina", "export", str(run.path / f"step_{run.steps[-1]:06}.vdi"), "--out", str(one)], check=True, capture_output=True)
    reader = vtk.vtkHDFReader()
    reader.SetFileName(str(one))
    reader.Update()
    again = reader.GetOutput()
    assert again.GetDimensions() == image.GetDimensions() and numpy.allclose(again.GetSpacing(), image.GetSpacing())
    both = [vtk_to_numpy(of.GetPointData().GetArray("density")) for of in (again, image)]
    assert numpy.array_equal(*both) and numpy.allclose(lamina.read(one).array.ravel(order="F"), both[0])
    assert len(lamina.read(series)) == 3
    table = list(csv.reader((cinema / "data.csv").open()))
    assert table[0] == ["step", "time", "phi", "theta", "FILE"] and len(table) == 1 + 3 * 4 * 2, table[:2]
    assert all((cinema / row[4]).is_file() for row in table[1:]) and len({tuple(row[:4]) for row in table}) == len(table)
    name = next(row[4] for row in table[1:] if (row[0], float(row[2]), float(row[3])) == ("2", 90.0, 20.0))
    mine = numpy.rint(run[2].render(azimuth=90, elevation=20, size=64).clip(0, 1) * 255)
    assert psnr(mine / 255, read_png(cinema / name) / 255) > 60
    print("exports: .pvd, .vti and .vtkhdf opened by VTK, a Cinema database by its specification")


def read_png(path):
    """Rows of an RGB8 PNG, unfiltered (PNG specification, section 9)."""
    import struct
    import zlib

    data, at, packed = path.read_bytes(), 8, b""
    while at < len(data):
        (length,) = struct.unpack(">I", data[at : at + 4])
        kind, body = data[at + 4 : at + 8], data[at + 8 : at + 8 + length]
        if kind == b"IHDR":
            width, height = struct.unpack(">II", body[:8])
        packed += body if kind == b"IDAT" else b""
        at += 12 + length
    raw = numpy.frombuffer(zlib.decompress(packed), numpy.uint8).reshape(height, 1 + 3 * width)
    rows = numpy.zeros((height, 3 * width), numpy.int64)
    for n in range(height):
        kind, line = raw[n, 0], raw[n, 1:].astype(numpy.int64)
        above = rows[n - 1] if n else numpy.zeros(3 * width, numpy.int64)
        for k in range(3 * width):
            left, corner = (rows[n, k - 3], above[k - 3]) if k >= 3 else (0, 0)
            estimate = left + above[k] - corner
            nearest = min((abs(estimate - v), m) for m, v in enumerate((left, above[k], corner)))[1]
            guess = (0, left, above[k], (left + above[k]) // 2, (left, above[k], corner)[nearest])[kind]
            rows[n, k] = (line[k] + guess) % 256
    return rows.reshape(height, width, 3)


def check_levels():
    """Where the finer level of a plotfile has no box, the coarser one's cells are repeated; a level can be named."""
    from lamina.sources import Options, files

    write_plotfile(FOLDER / "plt", 3, first=8)
    fine = blob(3)
    coarse = fine.astype(numpy.float64).reshape(DIMS[0] // 2, 2, DIMS[1] // 2, 2, DIMS[2] // 2, 2).mean((1, 3, 5)).astype(numpy.float32)
    expected = fine.copy()
    expected[:8] = coarse.repeat(2, 0).repeat(2, 1).repeat(2, 2)[:8]
    read = files.read_file(FOLDER / "plt", Options(field="rho"))
    assert numpy.array_equal(read.values, expected) and read.time == 1.5 and numpy.allclose(read.origin, ORIGIN)
    read = files.read_file(FOLDER / "plt", Options(field="rho", level=0))
    assert numpy.array_equal(read.values, coarse) and numpy.allclose(read.spacing, [2 * s for s in SPACING])
    print("levels: a plotfile's, filled from coarser ones")


def check_missing():
    """Fill values, stated by the file or by the user, are missing points in what is recorded."""
    import h5py

    values = blob(3)
    x, y, _ = numpy.meshgrid(*(numpy.arange(n) for n in DIMS), indexing="ij")
    holes = (x - 20) ** 2 + (y - 18) ** 2 < 60
    filled = numpy.where(holes, -9999, values).astype(numpy.float32)
    (FOLDER / "missing").mkdir()
    with h5py.File(FOLDER / "missing/stated.h5", "w") as file:
        file.create_dataset("rho", data=filled.transpose()).attrs["_FillValue"] = numpy.float32(-9999)
    numpy.save(FOLDER / "missing/told.npy", numpy.ascontiguousarray(filled.transpose()))
    for name, options in {"stated.h5": [], "told.npy": ["--missing", "-9999"]}.items():
        out = FOLDER / "missing" / name.replace(".", "_")
        command = ["lamina", "watch", str(FOLDER / "missing" / name), "--out", str(out), "--scene", str(FOLDER / "scene.toml"), "--exit", "--quiet", "1"]
        command += ["--viewer", "127.0.0.1:0", "--contract", "size <= 60kB, psnr >= 30dB", *options]
        said = subprocess.run(command, check=True, capture_output=True, text=True, timeout=120)
        step = lamina.read(out)[0]
        if isinstance(step, lamina.Reduced) and step.units.shape == DIMS:
            assert numpy.array_equal(numpy.isnan(step.array), holes), (name, "holes elsewhere")
        else:
            assert step.render(size=128).std() > 0.02, (name, said.stdout)
        row = lamina.read(out).table[0]
        assert int(row["empty_voxels"]) == holes.sum(), (name, row)


def check_fields():
    """Several arrays of a file: an expression over them is shown, colored by another, as it would be of an array of its values."""
    import h5py

    folder = FOLDER / "fields"
    folder.mkdir()
    u, v, w = (numpy.ascontiguousarray(f.transpose()) for f in numpy.gradient(blob(2).astype(numpy.float64), *SPACING))
    with h5py.File(folder / "run.h5", "w") as file:
        for name, values in {"rho": as_zyx(2), "u": u.astype(numpy.float32), "v": v, "w": w}.items():
            file[name] = values
        file["speed"] = numpy.sqrt(u * u + v * v + w * w).astype(numpy.float32)
    more = ["--more-fields", "v.x=u,v.y=v,v.z=w"]
    pictures = {}
    for name, options in {
        "array": ["--field", "speed"],
        "computed": ["--field", "rho", *more, "--shown", "magnitude(v)"],
        "derivative": ["--field", "rho", "--shown", "magnitude(gradient(rho))"],
    }.items():
        command = ["lamina", "watch", str(folder / "run.h5"), "--out", str(folder / name), "--scene", str(FOLDER / "scene.toml"), "--exit"]
        command += ["--quiet", "1", "--viewer", "127.0.0.1:0", "--contract", "psnr >= 60dB", "--spacing", "0.05,0.05,0.05", *options]
        command += ["--origin=-1.0,-0.9,-0.8"]
        subprocess.run(command, check=True, capture_output=True, text=True, timeout=120)
        pictures[name] = lamina.read(folder / name)[0].render(azimuth=25, size=256)
        assert pictures[name].std() > 0.02, f"{name}: the picture shows nothing"
    for name in ("computed", "derivative"):
        same = psnr(pictures[name], pictures["array"])
        print(f"fields: {name}, {same:.1f} dB from the array of its values")
        assert same >= 55, (name, same)
    wrong = ["lamina", "watch", str(folder / "run.h5"), "--exit", "--quiet", "1", "--viewer", "127.0.0.1:0", "--field", "rho"]
    for options, words in [(["--shown", "magnitude(v)"], 'no field "v"'), (["--more-fields", "p"], 'no field "p"')]:
        ended = subprocess.run([*wrong, *options], capture_output=True, text=True, timeout=60)
        assert words in ended.stderr, (options, ended.stderr)


def check_hostile():
    """What is no step is passed over by name, and what comes after it is shown; small files that claim to be large are not read."""
    import h5py
    import zarr

    folder = FOLDER / "hostile"
    folder.mkdir()
    numpy.save(folder / "a0.npy", blob(0))
    (folder / "a1.npy").write_bytes(b"\x93NUMPY and then nothing")
    numpy.save(folder / "a2.npy", numpy.ones((4, 4)))
    numpy.save(folder / "a3.npy", numpy.ones((4, 4, 4), complex))
    numpy.save(folder / "a4.npy", numpy.array([[[{"pickled": 1}]]], dtype=object), allow_pickle=True)
    with h5py.File(folder / "a5.h5", "w") as file:
        file.create_dataset("rho", (100_000,) * 3, "f4", chunks=(64,) * 3, compression="gzip")
    zarr.open_group(folder / "a6.zarr", mode="w").create_array("rho", shape=(100_000,) * 3, dtype="f4", chunks=(64,) * 3, dimension_names="zyx")
    (folder / "a7.vti").write_text("<VTKFile><ImageData WholeExtent='0 99999 0 99999 0 99999'>")
    (folder / "a8.tif").write_bytes(b"II*\0\xff\xff\xff\xff")
    (folder / "a9").mkdir()
    (folder / "a9/Level_0").mkdir()
    (folder / "a9/Header").write_text("HyperCLaw-V1.1\n1\nrho\n3\n0.0\n0\n0 0 0\n1 1 1\n\n((0,0,0) (99999,99999,99999) (0,0,0))\n0\n1 1 1\n0\n0\n0 0 0.0\n0\nLevel_0/Cell\n")
    numpy.save(folder / "b10.npy", blob(1))
    for path in [*folder.rglob("*"), folder]:
        # Of an hour ago: nobody is writing them.
        os.utime(path, (time.time() - 3600,) * 2)
    command = ["lamina", "watch", str(folder), "--out", str(FOLDER / "record/hostile"), "--viewer", "127.0.0.1:0", "--exit", "--quiet", "2", "--axes", "xyz"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=200)
    assert done.returncode == 0, done.stderr
    for name in ("a1.npy", "a2.npy", "a4.npy", "a5.h5", "a6.zarr", "a7.vti", "a8.tif", "a9"):
        assert any(f"hostile/{name}: passed over" in line for line in done.stderr.splitlines()), (name, done.stderr)
    assert "complex128" in done.stderr and "GB of memory" in done.stderr and done.stderr.count("voxels") >= 2, done.stderr
    # The first and the last are one run: what lies between changes neither its grid nor its type.
    assert lamina.read(FOLDER / "record/hostile").steps == [0, 10], done.stdout
    print("hostile: nine files that are no steps passed over by name, two that are shown")


def check_client():
    """The example of a simulation, through what is installed."""
    serve = subprocess.Popen(
        ["lamina", "serve", "--listen", "127.0.0.1:0", "--viewer", "127.0.0.1:0", "--out", str(FOLDER / "served")], stdout=subprocess.PIPE, text=True
    )
    try:
        address = serve.stdout.readline().split("connect to ")[1].split(";")[0]
        environment = {key: of for key, of in os.environ.items() if key != "PYTHONPATH"}
        # From another folder, so that the installed package is imported.
        (FOLDER / "blob.py").write_text((ROOT / "deploy/python/examples/blob.py").read_text())
        subprocess.run([sys.executable, str(FOLDER / "blob.py"), address, "0", "1"], check=True, env=environment)
        reading, writing, pushing = re.findall(r"```python\n(.*?)```", (ROOT / "deploy/python/README.md").read_text(), re.S)
        rows, deadline = [], time.monotonic() + 60
        while not rows and time.monotonic() < deadline:
            time.sleep(0.1)
            rows = [row for table in (FOLDER / "served").glob("*/steps.csv") for row in csv.DictReader(table.open())]
        assert rows, "no step of the example was recorded"
        # The examples of the README, on this run and this node.
        exec(pushing.replace("http://127.0.0.1:7101", address), {})
        write_vti(FOLDER / "field.vti", 0)
        places = {'"record"': repr(str(FOLDER / "served")), '"field.vti"': repr(str(FOLDER / "field.vti"))}
        names: dict = {}
        exec(re.sub('"record"|"field.vti"', lambda found: places[found.group()], reading), names)
        exec(writing.replace("step.exr", str(FOLDER / "step.exr")), names)
        channels = names["OpenEXR"].File(str(FOLDER / "step.exr")).channels()
        assert numpy.array_equal(channels["Z"].pixels, names["step"].depth(azimuth=30)) and channels["RGB"].pixels.shape == (512, 512, 3)
        assert names["picture"].shape == (512, 512, 3) and names["volume"].array.shape == DIMS
    finally:
        serve.terminate()
        serve.wait()
    print(f"client: {len(rows)} steps of the example recorded by lamina serve")


(FOLDER / "scene.toml").write_text(SCENE)
assert Path(lamina.__file__).is_relative_to(sys.prefix), f"{lamina.__file__} is not the installed package"
subprocess.run([sys.executable, "-m", "lamina", "--version"], check=True, capture_output=True)
if not ONLY:
    check_reader()
    check_levels()
    check_missing()
    check_fields()
    check_hostile()
    check_client()
    check_uneven()
    check_exports()
    check_movies()
    check_paraview()
check_doors()
