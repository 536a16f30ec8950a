#!/usr/bin/env python3
"""What users would ship instead of what Lamina sends: SZ3, SPERR and zfp of the volume, and pictures of the six views.

Writes peers.csv, which `lamina-lab rd --peers` takes, and the decoded volumes beside it. Needs vtk, pysz, zfpy, h5py, hdf5plugin,
numpy and pillow: `python3 -m pip install vtk pysz zfpy h5py hdf5plugin numpy pillow`.
"""

import argparse
import io
import pathlib
import re
import subprocess
import sys
import time

import h5py
import hdf5plugin
import numpy as np
import zfpy
from PIL import Image
from pysz import sz, szConfig, szErrorBoundMode

ANGLES_DEG = [10, 20, 30, 40, 50, 60]
# Error bounds as shares of the range of values.
BOUNDS = [1.4, 1.0, 0.7, 0.45, 0.3, 0.2, 0.14, 0.1, 0.07, 0.05, 0.035, 0.025, 0.017, 0.012, 0.008, 0.005, 0.003]


def volume_of(path, time_step):
    """Scalars as float32, z first."""
    if path.suffix in (".pvd", ".vti"):
        import vtk
        from vtk.util.numpy_support import vtk_to_numpy

        if path.suffix == ".pvd":
            files = re.findall(r'file="([^"]+)"', path.read_text())
            path = path.parent / files[time_step]
        reader = vtk.vtkXMLImageDataReader()
        reader.SetFileName(str(path))
        reader.Update()
        image = reader.GetOutput()
        scalars = vtk_to_numpy(image.GetPointData().GetArray(0))
        return np.ascontiguousarray(scalars.reshape(image.GetDimensions()[::-1]), np.float32)
    if path.suffix == ".nhdr":
        header = dict(line.split(": ", 1) for line in path.read_text().splitlines() if ": " in line)
        sizes = [int(n) for n in header["sizes"].split()]
        return np.fromfile(path.parent / header["data file"], "<f4").reshape(sizes[::-1])
    match = re.search(r"_(\d+)x(\d+)x(\d+)_(u?int\d+|float\d+)\.raw", path.name)
    if not match:
        sys.exit(f"{path}: its name tells no dims and type")
    dims = [int(n) for n in match.groups()[:3]]
    data = path.read_bytes()
    if path.suffix == ".gz":
        import gzip

        data = gzip.decompress(data)
    return np.frombuffer(data, match.group(4)).reshape(dims[::-1]).astype(np.float32)


def stored(values, filters):
    """Bytes in an HDF5 file under `filters`, milliseconds of writing, and the values read back."""
    file = io.BytesIO()
    with h5py.File(file, "w") as packed:
        start = time.perf_counter()
        data = packed.create_dataset("values", data=values, chunks=values.shape, **filters)
        packed.flush()
        encode_ms = 1e3 * (time.perf_counter() - start)
        size = data.id.get_storage_size()
    with h5py.File(file, "r") as packed:
        return size, encode_ms, packed["values"][...]


def sz3(values, bound):
    """By pysz, or by hdf5plugin where that is smaller: their defaults differ."""
    config = szConfig()
    config.errorBoundMode = szErrorBoundMode.ABS
    config.absErrorBound = float(bound)
    start = time.perf_counter()
    packed = sz.compress(values, config)[0]
    encode_ms = 1e3 * (time.perf_counter() - start)
    one = len(packed), encode_ms, sz.decompress(packed, np.float32, values.shape)[0]
    return min(one, stored(values, hdf5plugin.SZ3(absolute=float(bound))), key=lambda coded: coded[0])


def sperr(values, bound):
    """With half the bound as root mean square error: the mode in which it is smallest."""
    psnr = 20 * np.log10(2 * float(values.max() - values.min()) / float(bound))
    return stored(values, hdf5plugin.Sperr(peak_signal_to_noise_ratio=psnr, swap=True))


def zfp(values, bound):
    start = time.perf_counter()
    packed = zfpy.compress_numpy(values, tolerance=float(bound))
    return len(packed), 1e3 * (time.perf_counter() - start), zfpy.decompress_numpy(packed)


def volumes(values, out):
    low, high = np.percentile(values, [0.1, 99.9])
    scales = [("", values, high - low, lambda v: v)]
    above = values[values > 0]
    floor = np.percentile(above, 1.0) if above.size else 0.0
    if floor > 0 and high / floor > 100:
        # Over more than two decades the logarithm is what is looked at.
        logs = np.log10(np.maximum(values, above.min())).astype(np.float32)
        scales.append((" of log10", logs, np.log10(high / floor), lambda v: np.power(np.float32(10), v)))
    for name, codec in (("SZ3", sz3), ("SPERR", sperr), ("zfp", zfp)):
        for what, scaled, width, back in scales:
            for share in BOUNDS:
                size, encode_ms, decoded = codec(np.ascontiguousarray(scaled), share * width)
                file = f"{name}{what}_{share}.raw".replace(" ", "_")
                (out / file).write_bytes(back(decoded).astype("<f4").tobytes())
                yield f"{name},{share} of the range{what},{size},,{encode_ms:.2f},{file}"


def pictures(arguments, out):
    views = []
    for angle in ANGLES_DEG:
        file = out / f"view_{angle}.png"
        command = [arguments.lamina, "raycast", str(arguments.input), "--time-step", str(arguments.time_step)]
        command += ["--view", str(angle), "--out", str(file)] + (["--scene", arguments.scene] if arguments.scene else [])
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        views.append(np.asarray(Image.open(file).convert("RGB")))
    for kind, setting in [("JPEG", {"quality": q}) for q in (30, 50, 75, 90, 95)] + [
        ("WebP", {"quality": q}) for q in (20, 50, 75, 90, 98)
    ]:
        size, error = 0, 0.0
        for view in views:
            packed = io.BytesIO()
            Image.fromarray(view).save(packed, kind, **setting)
            size += packed.tell()
            seen = np.asarray(Image.open(packed).convert("RGB"), np.float64)
            error += np.mean((seen - view) ** 2) / 255**2
        yield f"six {kind},quality {setting['quality']},{size},{-10 * np.log10(error / len(views)):.3f},,"
    lossless = sum((out / f"view_{a}.png").stat().st_size for a in ANGLES_DEG)
    yield f"six PNG,lossless,{lossless},inf,,"


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("input", type=pathlib.Path)
    parser.add_argument("--time-step", type=int, default=0)
    parser.add_argument("--scene")
    parser.add_argument("--volumes-only", action="store_true", help="codecs of volumes alone, no pictures")
    parser.add_argument("--lamina", default="target/release/lamina")
    parser.add_argument("--out", type=pathlib.Path, required=True)
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    values = volume_of(arguments.input, arguments.time_step)
    rows = ["coding,how,bytes,psnr_db,encode_ms,volume"]
    rows += volumes(values, arguments.out)
    if not arguments.volumes_only:
        rows += pictures(arguments, arguments.out)
    (arguments.out / "peers.csv").write_text("\n".join(rows) + "\n")


if __name__ == "__main__":
    main()
