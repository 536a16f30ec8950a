"""Reads a VDI file, from the page proto/formats/vdi.md alone, and prints it as JSON.
Usage: read_vdi.py FILE [--segments]    (adds [ray, start, end, red, green, blue, opacity code] of every supersegment)"""
import bz2, json, struct, sys, zlib
from range_coder import SQUASH, STRETCH, Coder, clamp

BLOCK = 899_900
FIELDS = "<3d3d3dd 3d3d dIddd Q3fBBII"


def header(data):
    if data[:4] != b"LVDI":
        sys.exit("not a VDI: the magic bytes are missing")
    version, length = struct.unpack_from("<HH", data, 4)
    if version not in (1, 3) or length != struct.calcsize(FIELDS):
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
        "codec": ["bzip2", "zstd", "context-mixing"][v[25]], "layout": ["columns", "plain"][v[26]],
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


M32, NO_NEIGHBOR = 2**32 - 1, 2**32 - 1


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


def updated(v, bit):
    p, c = v - v % 16, v % 16
    change = ((32767 if bit else -32768) - v) * (65536 // (2 * c + 3)) + 2**18 >> 15
    return p + c + change // 16 * 16 + (c < 15)


class SymbolDecoder:
    def __init__(self, coder, lines):
        self.coder, self.shift, self.tables, self.mixers = coder, 32 - lines, [{} for _ in range(4)], {}

    def decode_bit(self, contexts, group, node, mixer):
        places = [((c ^ group * 0x9E3779B1 & M32) * 0x85EBCA6B % 2**32 >> self.shift, node) for c in contexts]
        values = [table.get(place, 0) for table, place in zip(self.tables, places)]
        weights, s = self.mixers.get(mixer, [6144] * 4), [STRETCH[(v >> 4) + 2048] for v in values]
        p = SQUASH[clamp(sum(w * x for w, x in zip(weights, s)) >> 14, -2047, 2047) + 2047]
        bit = self.coder.bit(p)
        e = (65536 - p if bit else -p) >> 1
        self.mixers[mixer] = [clamp(w + ((2 * x * e >> 16) + 1 >> 1), -32768, 32767) for w, x in zip(weights, s)]
        for table, place, v in zip(self.tables, places, values):
            table[place] = updated(v, bit)
        return bit

    def tree(self, contexts, bits, kind):
        node, group, within = 1, 0, 1
        for level in reversed(range(bits)):
            bit = self.decode_bit(contexts, group, within, (kind, level))
            node, within = node << 1 | bit, within << 1 | bit
            if within >= 32:
                group, within = node, 1
        return node - (1 << bits)

    def number(self, contexts, kind):
        n, found = 0, 1
        while n < 25 and self.decode_bit(contexts, 0, min(n + 1, 15), (kind, "length", min(n, 15))):
            n += 1
        group, more = (0, (0, 16, 17, 20)[n]) if n < 4 else (n, 0)
        for digit in range(min(n, 3)):
            found = found << 1 | self.decode_bit(contexts, group, more + found, (kind, min(n, 15), digit))
        return (found << max(n - 3, 0) | self.coder.uniform(max(n - 3, 0))) - 1


def palette(data):
    coder, same, lengths, colors = Coder(data), {}, {}, []
    opacities, last = [], False
    for o in range(256):
        last = coder.modeled_bit(same, last)
        opacities += [o] if last else []

    def exp_golomb(kind):
        n = 0
        while n < 9 and coder.modeled_bit(lengths, (kind, n)):
            n += 1
        return (1 << n | coder.uniform(n)) - 1

    red = green = blue = 0
    for _ in range(coder.uniform(32)):
        step = exp_golomb(0)
        red, green = red + step, green + unfold(exp_golomb(1 if step else 2))
        blue += unfold(exp_golomb(3))
        colors.append((red, green, blue))
    return colors, opacities


NONE = (0, 0, 0)


# Context that the first supersegment [start, end, opacity, color] of a ray gives: (color + 1, opacity + 1, bin of length).
def segment_context(ray):
    return (ray[0][3] + 1, ray[0][2] + 1, bin32(ray[0][1] - ray[0][0])) if ray else NONE


def beyond(ray, depth):
    return [s for s in ray if s[1] > depth]


class GeometryDecoder:
    def __init__(self, data, opacities, segments):
        lines = lambda less, most: clamp(bits(segments) - less, 5, most)
        self.coder, self.any, self.bits = Coder(data), {}, bits(opacities)
        kinds = {"more": (6, 10), "gap": (6, 14), "length": (4, 14), "opacity": (4, 14)}
        self.symbols = {name: SymbolDecoder(self.coder, lines(*of)) for name, of in kinds.items()}

    def ray(self, around):
        if not any(around) and not self.coder.modeled_bit(self.any, 0):
            return []
        code, found, end, before, previous, older = self.symbols, [], 0, 0, NONE, NONE
        gap_bin = lambda gap: 99 if gap == NO_NEIGHBOR else bin32(gap)
        difference_bin = lambda a, b: 99 if NO_NEIGHBOR in (a, b) else bin32(abs(a - b))
        while True:
            first, rest = not found, [beyond(ray, end) for ray in around]
            left, up, right = (min(len(ray), 7) for ray in rest)
            gaps = [max(ray[0][0] - end, 0) if ray else NO_NEIGHBOR for ray in rest]
            gl, gu, gr = (gap_bin(g) for g in gaps)
            both = 2 * min(left, 1) + min(up, 1)
            contexts = (hash3(gl, gu, first), hash3(right, gr, gu), hash3(previous[1], both, 0), hash3(min(len(found), 63), left, up))
            if not code["more"].decode_bit(contexts, 0, 0, (both, 0)):
                return found
            l, u, r = gaps
            middle = 0 if NO_NEIGHBOR in (l, u) else (l + u) // 2
            expected = 0 if min(gaps) == NO_NEIGHBOR else max(min(gaps), middle)
            kind = 2 * first + (expected >= 12)
            mixer = 3 * kind + (l == 0) + (u == 0)
            if expected >= 12:
                contexts = (hash3(difference_bin(l, u), kind, 0), hash3(gl, gu, kind), hash3(difference_bin(r, expected), kind, 0),
                            hash3(previous[1], kind, 0))
                gap = expected + unfold(code["gap"].number(contexts, mixer))
            else:
                a, b, c = (min(g, 40) for g in gaps)
                contexts = (hash3(a << 8 | b, c, kind), hash3(previous[1], 2 * (a == 0) + (b == 0), 0), hash3(b, c, 0),
                            hash3(previous[2], min(before, 40), 0))
                gap = code["gap"].number(contexts, mixer)
            start = end + gap
            rest = [beyond(ray, start) for ray in around]
            left, up, right = (min(ray[0][1] - start, 4000) if ray and ray[0][0] <= start else 0 for ray in rest)
            start_order = lambda ray: 3 if not ray else 1 + (ray[0][0] > start) - (ray[0][0] < start)
            contexts = (hash3(left, start_order(rest[0]) + 4 * start_order(rest[1]), bin32(up)), hash3(up, right, 0),
                        hash3(segment_context(rest[1])[1], up, 0), hash3(previous[1], previous[2], bin32(gap)))
            length = 1 + code["length"].number(contexts, (left == up) + 2 * (left > 0) + 4 * (up > 0))
            end, size = start + length, bin32(length)
            left, up = (segment_context(beyond(ray, start + length // 2)) for ray in around[:2])
            contexts = (hash3(left[1], left[2], size), hash3(up[1], up[2], size), hash3(previous[1], previous[2], size),
                        hash3(previous[1], older[1], size))
            mixer = 4 * min(size, 15) + 2 * (left[1] == up[1]) + (previous[1] == left[1])
            found.append([start, end, code["opacity"].tree(contexts, self.bits, mixer), 0])
            before, older, previous = gap, previous, segment_context(found[-1:])


class ColorDecoder:
    def __init__(self, data, colors, segments):
        self.code, self.bits = SymbolDecoder(Coder(data), clamp(bits(segments) - 3, 5, 15)), bits(colors)

    def ray(self, ray, around):
        previous = NONE
        for s in ray:
            o, size = s[2] + 1, bin32(s[1] - s[0])
            left, up = (segment_context(beyond(neighbor, s[0] + (s[1] - s[0]) // 2)) for neighbor in around)
            contexts = (hash3(previous[0], size, 0), hash3(left[0], o, size), hash3(up[0], o, 0), hash3(o, size, 0))
            s[3] = self.code.tree(contexts, self.bits, 4 * (left[0] == up[0]) + 2 * (left[1] == o) + (up[1] == o))
            previous = segment_context([s])


def context_mixing(h, data):
    n, r, at = h["segments"], h["params"]["resolution"], 8 + struct.calcsize(FIELDS)
    count = max(1, min(n // 131072, r // 16))
    lengths = struct.unpack_from(f"<{2 * count + 1}Q", data, at)
    at += 8 * len(lengths)
    parts = []
    for length in lengths:
        parts.append(data[at:at + length])
        at += length
    assert at == len(data) - 4, "bytes between the last part and the checksum"
    colors, opacities = palette(parts[0])
    for k in range(count):
        geometry, colors_of = GeometryDecoder(parts[2 * k + 1], len(opacities), n // count), ColorDecoder(parts[2 * k + 2], len(colors), n // count)
        above = [[]] * (r + 1)
        for y in range(k * r // count, (k + 1) * r // count):
            row = []
            for x in range(r):
                left = row[-1] if row else []
                row.append(geometry.ray([left, above[x], above[x + 1]]))
                colors_of.ray(row[-1], [left, above[x]])
                for start, end, o, c in row[-1]:
                    yield [y * r + x, start, end, *colors[c], opacities[o]]
            above = row + [[]]


data = open(sys.argv[1], "rb").read()
h = header(data)
rays, n, m = h["params"]["resolution"] ** 2, h["segments"], h["occupied_rays"]
if h["codec"] == "zstd":
    sys.exit("codec zstd: Python's standard library has no decoder for it; write the file with bzip2")
if h["codec"] == "context-mixing":
    rows = list(context_mixing(h, data))
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
