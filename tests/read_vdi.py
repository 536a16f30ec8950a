"""Reads a VDI file, from the page proto/VDI-FORMAT.md alone, and prints it as JSON.
Usage: read_vdi.py FILE [--segments]    (adds [ray, start, end, red, green, blue, opacity code] of every supersegment)"""
import bz2, json, struct, sys, zlib
from decisions import Coder, clamp

BLOCK = 899_900
FIELDS = "<3d3d3dd 3d3d dIddd Q3fBBII"


def header(data):
    if data[:4] != b"LVDI":
        sys.exit("not a VDI: the magic bytes are missing")
    version, length = struct.unpack_from("<HH", data, 4)
    if version not in (1, 2) or length != struct.calcsize(FIELDS):
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
        "codec": ["bzip2", "zstd", "mixed"][v[25]], "layout": ["columns", "plain"][v[26]],
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


M32, NOWHERE, MIXING = 2**32 - 1, 2**32 - 1, ([40] * 6, 131072, 11)


def hash3(a, b, c):
    b, c = b * 0x85EBCA6B & M32, c * 0xC2B2AE35 & M32
    s = (a * 0x9E3779B1 & M32) ^ (b << 13 & M32 | b >> 19) ^ (c << 7 & M32 | c >> 25)
    return (s ^ s >> 15) * 0x2C1B3C6D & M32


def bin32(n):
    if n < 8:
        return n
    octave = n.bit_length() - 1
    return 2 * octave + (n >> octave - 1 & 1) + 2


def bits(n):
    return max(n - 1, 0).bit_length()


def unfold(n):
    return n >> 1 ^ -(n & 1)


class Symbols:
    def __init__(self, coder, bits):
        self.coder, self.shift, self.tables, self.mixers = coder, 32 - (bits - 4), [{} for _ in range(6)], {}

    def decide(self, contexts, group, node, mixer):
        line = [(c ^ group * 0x9E3779B1 & M32) * 0x85EBCA6B % 2**32 >> self.shift for c in contexts]
        return self.coder.mixed(MIXING, self.tables, self.mixers, [(i, node) for i in line], mixer)

    def tree(self, contexts, bits, kind):
        node, group, within = 1, 0, 1
        for level in reversed(range(bits)):
            bit = self.decide(contexts, group, within, (kind, level))
            node, within = node << 1 | bit, within << 1 | bit
            if within >= 16:
                group, within = node, 1
        return node - (1 << bits)

    def number(self, contexts, kind):
        n, found = 0, 1
        while n < 25 and self.decide(contexts, 0, min(n + 1, 15), (kind, "length", min(n, 15))):
            n += 1
        for digit in range(min(n, 3)):
            found = found << 1 | self.decide(contexts, n, found, (kind, min(n, 15), digit))
        return (found << max(n - 3, 0) | self.coder.even(max(n - 3, 0))) - 1


def palette(data):
    coder, same, lengths, colours = Coder(data), {}, {}, []
    opacities, last = [], False
    for o in range(256):
        last = coder.single(same, last)
        opacities += [o] if last else []

    def exp_golomb(kind):
        n = 0
        while n < 9 and coder.single(lengths, (kind, n)):
            n += 1
        return (1 << n | coder.even(n)) - 1

    red = green = blue = 0
    for _ in range(coder.even(32)):
        step = exp_golomb(0)
        red, green = red + step, green + unfold(exp_golomb(1 if step else 2))
        blue += unfold(exp_golomb(3))
        colours.append((red, green, blue))
    return colours, opacities


class Rays:
    def __init__(self, data, colours, opacities, segments):
        size = lambda less, most: clamp(bits(segments) + 1 - less, 10, most)
        self.coder, self.any, self.colours, self.opacities = Coder(data), {}, colours, opacities
        names = {"more": (3, 14), "gap": (3, 18), "length": (1, 18), "opacity": (1, 18), "colour": (0, 19)}
        self.symbols = {name: Symbols(self.coder, size(*of)) for name, of in names.items()}

    # (colour, opacity, both, bin of length) of a supersegment (start, end, colour, opacity).
    def look(self, s):
        return (s[2] + 1, s[3] + 1, s[2] + 1 << 8 ^ s[3] + 1, bin32(s[1] - s[0])) if s else (0, 0, 0, 0)

    def ray(self, around):
        if not any(around) and not self.coder.single(self.any, 0):
            return []
        code, found, end, before, older = self.symbols, [], 0, 0, (0, 0, 0, 0)
        beside = lambda depth: [[s for s in ray if s[1] > depth] for ray in around]
        bin_of = lambda gap: 99 if gap == NOWHERE else bin32(gap)
        apart = lambda a, b: 99 if NOWHERE in (a, b) else bin32(abs(a - b))
        while True:
            previous, first = self.look(found[-1] if found else None), not found
            rest = beside(end)
            left, up, right = (min(len(ray), 7) for ray in rest)
            gaps = [max(ray[0][0] - end, 0) if ray else NOWHERE for ray in rest]
            gl, gu, gr = (bin_of(g) for g in gaps)
            both = 2 * min(left, 1) + min(up, 1)
            contexts = (hash3(left, up, first), hash3(gl, gu, first), hash3(right, gr, gu), hash3(previous[2], both, 0),
                        hash3(min(len(found), 63), left, up), hash3(previous[3], gl, right))
            if not code["more"].decide(contexts, 0, 0, (both, 0)):
                return found
            l, u, r = gaps
            middle = 0 if NOWHERE in (l, u) else (l + u) // 2
            expected = 0 if min(gaps) == NOWHERE else max(min(gaps), middle)
            kind = 2 * first + (expected >= 12)
            mixer = 3 * kind + (l == 0) + (u == 0)
            if expected >= 12:
                contexts = (hash3(apart(l, u), kind, 0), hash3(gl, gu, kind), hash3(apart(r, expected), kind, 0), hash3(kind, 0, 0),
                            hash3(apart(l, u), apart(r, l), 0), hash3(previous[2], kind, 0))
                gap = expected + unfold(code["gap"].number(contexts, mixer))
            else:
                a, b, c = (min(g, 40) for g in gaps)
                contexts = (hash3(a, b, 0), hash3(a, previous[2], 0), hash3(b, c, 0), hash3(previous[2], 2 * (a == 0) + (b == 0), 0),
                            hash3(previous[3], min(before, 40), 0), hash3(a << 8 | b, c, kind))
                gap = code["gap"].number(contexts, mixer)
            start = end + gap
            rest = beside(start)
            left, up, right = (min(ray[0][1] - start, 4000) if ray and ray[0][0] <= start else 0 for ray in rest)
            entered = lambda ray: 3 if not ray else 1 + (ray[0][0] > start) - (ray[0][0] < start)
            looks = [self.look(ray[0] if ray else None) for ray in rest]
            contexts = (hash3(left, up, 0), hash3(left, entered(rest[0]) + 4 * entered(rest[1]), bin32(up)), hash3(up, right, 0),
                        hash3(looks[0][1], left, 0), hash3(looks[1][1], up, 0), hash3(previous[2], previous[3], bin32(gap)))
            length = 1 + code["length"].number(contexts, (left == up) + 2 * (left > 0) + 4 * (up > 0))
            end, size = start + length, bin32(length)
            left, up, _ = (self.look(ray[0] if ray else None) for ray in beside(start + length // 2))
            contexts = (hash3(left[1], up[1], 0), hash3(left[1], left[3], size), hash3(up[1], up[3], size),
                        hash3(previous[1], previous[3], size), hash3(previous[2], older[2], size), hash3(left[2], up[2], size))
            mixer = 2 * (left[1] == up[1]) + (previous[1] == left[1])
            o = code["opacity"].tree(contexts, bits(len(self.opacities)), mixer)
            contexts = (hash3(previous[0], size, 0), hash3(left[0], o + 1, size), hash3(up[0], o + 1, 0),
                        hash3(previous[0], left[0], 0), hash3(o + 1, size, 0), hash3(left[0], up[0], 0))
            mixer = 4 * (left[2] == up[2]) + 2 * (left[1] == o + 1) + (up[1] == o + 1)
            c = code["colour"].tree(contexts, bits(len(self.colours)), mixer)
            before, older = gap, previous
            found.append((start, end, c, o))


def mixed(h, data):
    n, r, at = h["segments"], h["params"]["resolution"], 8 + struct.calcsize(FIELDS)
    count = max(1, min(n // 131072, r // 16))
    lengths = struct.unpack_from(f"<{count + 1}Q", data, at)
    at += 8 * (count + 1)
    parts = []
    for length in lengths:
        parts.append(data[at:at + length])
        at += length
    assert at == len(data) - 4, "bytes between the last band and the checksum"
    colours, opacities = palette(parts[0])
    for k in range(count):
        rays, above, y0, y1 = Rays(parts[k + 1], colours, opacities, n // count), [[]] * (r + 1), k * r // count, (k + 1) * r // count
        for y in range(y0, y1):
            row = []
            for x in range(r):
                row.append(rays.ray([row[-1] if row else [], above[x], above[x + 1]]))
                for start, end, c, o in row[-1]:
                    yield [y * r + x, start, end, *colours[c], opacities[o]]
            above = row + [[]]


data = open(sys.argv[1], "rb").read()
h = header(data)
rays, n, m = h["params"]["resolution"] ** 2, h["segments"], h["occupied_rays"]
if h["codec"] == "zstd":
    sys.exit("codec zstd: Python's standard library has no decoder for it; write the file with bzip2")
if h["codec"] == "mixed":
    rows = list(mixed(h, data))
else:
    shapes = {"columns": [("counts", rays), ("first starts", m), ("gaps", n - m), ("high length bytes", n), ("bodies", n)],
              "plain": [("counts", rays), ("records", n)]}[h["layout"]]
    found = sections(data, shapes)
    h["sections"] = [{"name": k, "width": w, "bytes": len(b), "crc32": zlib.crc32(b)} for k, (w, b) in found.items()]
    rows = list({"columns": columns, "plain": plain}[h["layout"]](h, found, rays))
assert len(rows) == n and len({r[0] for r in rows}) == m, "the counts do not add up"
if "--segments" in sys.argv[2:]:
    h["list"] = rows
print(json.dumps(h))
