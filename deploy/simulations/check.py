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
# Infinite where a field has thinned out to nothing; not in all of them.
if not all(db > 25 for db in measured) or not any(db < math.inf for db in measured):
    fail(f"the quality of its steps is {measured}")
if rows[-1]["tuning"] not in ("provisional", "done"):
    fail(f"the last step was made with parameters of nobody's choice ({rows[-1]['tuning']})")


def pixels(path):
    """The rows of an RGB8 PNG, unfiltered (PNG specification, section 9)."""
    data, at, packed = path.read_bytes(), 8, b""
    while at < len(data):
        (length,) = struct.unpack(">I", data[at : at + 4])
        if data[at + 4 : at + 8] == b"IDAT":
            packed += data[at + 8 : at + 8 + length]
        at += 12 + length
    width, height, depth, color = struct.unpack(">IIBB", data[16:26])
    if (depth, color) != (8, 2):
        fail(f"{path} is not RGB8")
    raw, above = zlib.decompress(packed), bytes(3 * width)
    for row in range(height):
        kind, line = raw[row * (3 * width + 1)], bytearray(raw[row * (3 * width + 1) + 1 : (row + 1) * (3 * width + 1)])
        for i, byte in enumerate(line):
            left, up, corner = (line[i - 3], above[i], above[i - 3]) if i >= 3 else (0, above[i], 0)
            nearest = min((left, up, corner), key=lambda near: abs(left + up - corner - near))
            line[i] = (byte + (0, left, up, (left + up) // 2, nearest)[kind]) & 255
        yield line
        above = line


if max(max(row) - min(row) for row in pixels(folder / "picture.png")) < 32:
    fail("the picture shows nothing")
last = rows[-1]
print(
    f"{len(rows)} steps, {int(rows[0]['dropped_steps'])} to {int(last['dropped_steps'])} dropped; last: {last['representation']} of"
    f" {last['resolution']}, gamma {float(last['gamma']):.4g}, {int(last['size_bytes']) / 1000:.1f} kB, {measured[-1]:.1f} dB"
)
