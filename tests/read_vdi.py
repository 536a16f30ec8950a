"""Reads a VDI file, from the page proto/VDI-FORMAT.md alone, and prints it as JSON.
Usage: read_vdi.py FILE [--segments]    (adds [ray, start, end, red, green, blue, opacity code] of every supersegment)"""
import bz2, json, struct, sys, zlib

BLOCK = 899_900
FIELDS = "<3d3d3dd 3d3d dIddd Q3fBBII"


def header(data):
    if data[:4] != b"LVDI":
        sys.exit("not a VDI: the magic bytes are missing")
    version, length = struct.unpack_from("<HH", data, 4)
    if version != 1 or length != struct.calcsize(FIELDS):
        sys.exit(f"version {version} with a header of {length} bytes is not known to this reader")
    if zlib.crc32(data[:-4]) != struct.unpack("<I", data[-4:])[0]:
        sys.exit("damaged: the checksum differs")
    v = struct.unpack_from(FIELDS, data, 8)
    return {
        "version": version,
        "camera": {"position": v[0:3], "target": v[3:6], "up": v[6:9], "fov_y_deg": v[9]},
        "box": {"min": v[10:13], "max": v[13:16]},
        "step_length": v[16],
        "params": {"resolution": v[17], "gamma": v[18], "opacity_cutoff": v[19], "step_voxels": v[20]},
        "transfer_id": v[21], "background": v[22:25],
        "codec": ["bzip2", "zstd"][v[25]], "layout": ["columns", "plain"][v[26]],
        "segments": v[27], "occupied_rays": v[28],
    }


def sections(data, names_and_elements):
    at, table, found = 8 + struct.calcsize(FIELDS), [], {}
    for name, elements in names_and_elements:
        width, blocks = data[at], -(-elements * data[at] // BLOCK)
        table.append((name, elements, width, struct.unpack_from(f"<{blocks}I", data, at + 1)))
        at += 1 + 4 * blocks
    for name, elements, width, lengths in table:
        raw = b""
        for length in lengths:
            raw += bz2.decompress(data[at:at + length])
            at += length
        assert len(raw) == elements * width, name
        found[name] = (width, raw)
    assert at == len(data) - 4, "bytes between the last block and the checksum"
    return found


def integers(width, raw, elements, signed=False):
    value = 0
    for i in range(elements):
        stored = sum(raw[k * elements + i] << 8 * k for k in range(width))
        value = value + (stored >> 1 ^ -(stored & 1)) if signed else stored
        yield value


def columns(h, s, rays):
    n, m = h["segments"], h["occupied_rays"]
    firsts, gaps = integers(*s["first starts"], m, signed=True), integers(*s["gaps"], n - m)
    highs, bodies = integers(*s["high length bytes"], n), struct.iter_unpack("5B", s["bodies"][1])
    for ray, count in enumerate(integers(*s["counts"], rays, signed=True)):
        for k in range(count):
            start = next(firsts) if k == 0 else end + next(gaps)
            *rgba, low = next(bodies)
            end = start + 256 * next(highs) + low + 1
            yield [ray, start, end, *rgba]


def plain(h, s, rays):
    records = struct.iter_unpack("<2f4B", s["records"][1])
    for ray, (count,) in enumerate(struct.iter_unpack("<I", s["counts"][1])):
        for start, end, *rgba in (next(records) for _ in range(count)):
            yield [ray, round(start / h["step_length"]), round(end / h["step_length"]), *rgba]


data = open(sys.argv[1], "rb").read()
h = header(data)
rays, n, m = h["params"]["resolution"] ** 2, h["segments"], h["occupied_rays"]
if h["codec"] == "zstd":
    sys.exit("codec zstd: Python's standard library has no decoder for it; write the file with bzip2")
shapes = {"columns": [("counts", rays), ("first starts", m), ("gaps", n - m), ("high length bytes", n), ("bodies", n)],
          "plain": [("counts", rays), ("records", n)]}[h["layout"]]
found = sections(data, shapes)
h["sections"] = [{"name": k, "width": w, "bytes": len(b), "crc32": zlib.crc32(b)} for k, (w, b) in found.items()]
rows = list({"columns": columns, "plain": plain}[h["layout"]](h, found, rays))
assert len(rows) == n and len({r[0] for r in rows}) == m, "the counts do not add up"
if "--segments" in sys.argv[2:]:
    h["list"] = rows
print(json.dumps(h))
