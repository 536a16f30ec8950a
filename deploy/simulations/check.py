"""Holds a recorded run to what every simulation here must show: check.py FOLDER LEAST_STEPS."""

import csv
import math
import pathlib
import struct
import sys
import zlib

folder, least = pathlib.Path(sys.argv[1]), int(sys.argv[2])


def fail(sentence):
    sys.exit(f"{folder}: {sentence}")


tables = sorted(folder.glob("runs/*/steps.csv"))
if len(tables) != 1:
    fail(f"{len(tables)} runs are recorded, not one")
rows = list(csv.DictReader(tables[0].open()))
if len(rows) < least:
    fail(f"{len(rows)} steps are recorded, fewer than {least}")
large = [row["step"] for row in rows if int(row["size_bytes"]) > 200_000]
if large:
    fail(f"steps {large} are larger than 200 kB")
measured = [float(row["psnr_db"]) for row in rows if row["psnr_db"]]
# Where nothing shows at the sampled pixels, as when the field has thinned out, the pictures are equal: infinite.
if min(measured, default=math.inf) == math.inf or min(measured) <= 25:
    fail(f"the quality of its steps is {measured}")
if rows[-1]["tuning"] not in ("provisional", "done"):
    fail(f"the last step was made with parameters of nobody's choice ({rows[-1]['tuning']})")


def pixels(path):
    """The bytes of a PNG's rows, filtered as they are: of one color they are all alike."""
    data, at, packed = path.read_bytes(), 8, b""
    while at < len(data):
        (length,) = struct.unpack(">I", data[at : at + 4])
        if data[at + 4 : at + 8] == b"IDAT":
            packed += data[at + 8 : at + 8 + length]
        at += 12 + length
    return zlib.decompress(packed)


if len(set(pixels(folder / "picture.png"))) < 8:
    fail("the picture shows nothing")
last = rows[-1]
print(
    f"{len(rows)} steps, {int(rows[0]['dropped_steps'])} to {int(last['dropped_steps'])} dropped; last: {last['representation']} of"
    f" {last['resolution']}, gamma {float(last['gamma']):.4g}, {int(last['size_bytes']) / 1000:.1f} kB, {measured[-1]:.1f} dB"
)
