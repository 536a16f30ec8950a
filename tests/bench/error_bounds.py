#!/usr/bin/env python3
"""Bytes of whole volumes under a bound on the error of each value, nothing hidden: Lamina's reduced volume beside SZ3, SPERR and zfp.

    tests/bench/setup; out/bench/venv/bin/python3 -m pip install pysz==1.1.0 zfpy==1.0.1.post0 h5py hdf5plugin==7.1.0
    out/bench/venv/bin/python3 tests/bench/error_bounds.py athena_snr.pvd@20 engine_256x256x128_uint8.raw.gz ...

Bounds are shares of the range of values. The error of what was decoded is checked; times are of encoding, Lamina's and zfp's on one
core or more as each chooses, the reduction's copy included.
"""

import argparse
import pathlib
import re
import subprocess
import sys
import tempfile

import h5py
import hdf5plugin
import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).parent))
from peers import stored, sz3, volume_of, zfp

BOUNDS = [1e-2, 1e-3, 1e-4]
# Every value is seen alike: the same opacity throughout, from black to white.
SCENE = """[transfer]
range = {{ lo = {low!r}, hi = {high!r}, scale = "linear" }}
unit_length = 1.0
points = [ {{ at = 0.0, color = [0.0, 0.0, 0.0], opacity = 0.1 }}, {{ at = 1.0, color = [1.0, 1.0, 1.0], opacity = 0.1 }} ]
"""


def lamina(command, source, step, values, share, folder):
    scene, packed, unpacked = folder / "scene.toml", folder / "volume.vdi", folder / "volume.vtkhdf"
    low, high = float(values.min()), float(values.max())
    scene.write_text(SCENE.format(low=low, high=high))
    words = [command, "generate", source, "--time-step", step, "--scene", scene, "--representation", "volume"]
    words += ["--resolution", max(values.shape), "--gamma", share, "--error", "maximum", "--out", packed]
    said = subprocess.run(list(map(str, words)), check=True, capture_output=True, text=True).stdout
    subprocess.run([command, "export", packed, "--out", unpacked], check=True, capture_output=True)
    with h5py.File(unpacked, "r") as file:
        data = file["VTKHDF/PointData"]
        decoded = data[next(iter(data))][...].reshape(values.shape)
    return packed.stat().st_size, float(re.search(r"generation_ms (\S+)", said)[1]), decoded


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("inputs", nargs="+", metavar="FILE[@STEP]")
    parser.add_argument("--lamina", default="target/release/lamina")
    arguments = parser.parse_args()
    print("| Data | bound | reduced volume | SZ3 | SPERR | zfp | of the least of them | ms |\n|---|---|---|---|---|---|---|---|")
    ratios = []
    for name in arguments.inputs:
        file, _, step = name.partition("@")
        values = volume_of(pathlib.Path(file), int(step or 0))
        width = float(values.max() - values.min())
        for share in BOUNDS:
            bound = share * width
            with tempfile.TemporaryDirectory() as folder:
                codings = {
                    "Lamina": lamina(arguments.lamina, file, step or 0, values, share, pathlib.Path(folder)),
                    "SZ3": sz3(values, bound),
                    "SPERR": stored(values, hdf5plugin.Sperr(absolute=bound, swap=True)),
                    "zfp": zfp(values, bound),
                }
            for coding, (_, _, decoded) in codings.items():
                error = float(np.abs(decoded.astype(np.float64) - values).max())
                # Values are of single precision: so is the last rounding.
                if error > bound * (1 + 1e-6) + width * 1e-7:
                    sys.exit(f"{name}: {coding} is off by {error / width} of the range; asked for were {share}")
            sizes = [codings[coding][0] for coding in ("Lamina", "SZ3", "SPERR", "zfp")]
            times = [codings[coding][1] for coding in ("Lamina", "SZ3", "SPERR", "zfp")]
            ratios.append(sizes[0] / min(sizes[1:]))
            shown = " | ".join(f"{size / 1e3:,.1f} kB" for size in sizes)
            spent = ", ".join(f"{time:.0f}" for time in times)
            print(f"| {pathlib.Path(file).name}{'@' + step if step else ''} | {share:g} | {shown} | {ratios[-1]:.2f} | {spent} |", flush=True)
    print(f"Geometric mean of the bytes beside the least of the others: {np.exp(np.mean(np.log(ratios))):.2f}")


if __name__ == "__main__":
    main()
