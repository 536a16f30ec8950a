"""Reads a reduced volume's file, from the page proto/formats/volume.md alone, and prints its points (`nx ny nz`), its error
bound, then a value a line, x fastest. A volume that is coded after another one needs that one's file, and so on.
Usage: read_volume.py FILE [FILE BEFORE ..]"""
import struct, sys, zlib
from ctypes import c_float
from range_coder import SQUASH, STRETCH, Coder, clamp, update

CLASSES = [(0,), (1,), (2,), (0, 1), (0, 2), (1, 2), (0, 1, 2)]
WEIGHTS = {1: (-8, 0), 2: (-4, -4, 0, 0), 3: (-3, -3, -3, 0, 0, 0, 0)}
LIMITS = 60, 90, 40, 90, 60, 60


def f32(x):
    return c_float(x).value


def bin8(n):
    return n if n < 3 else 3 if n < 5 else 4 if n < 8 else 5 if n < 13 else 6 if n < 21 else 7


def octave(x):
    return clamp((struct.unpack("<I", struct.pack("<f", abs(x)))[0] >> 22) - 243, 0, 15)


def sign3(x):
    return 0 if x <= -1 else 2 if x >= 1 else 1


class Mixer:
    def __init__(self, inputs=5):
        self.tables, self.mixers, self.first = [{} for _ in range(inputs)], {}, [65536 * 7 // 4 // inputs] * inputs

    # A bit whose probability mixes several models.
    def decode_bit(self, coder, indices, mixer):
        models = [table.setdefault(i, [1 << 21, 0]) for table, i in zip(self.tables, indices)]
        weights = self.mixers.setdefault(mixer, list(self.first))
        stretched = [STRETCH[c[0] >> 10] for c in models]
        p = SQUASH[clamp(sum(w * s for w, s in zip(weights, stretched)) >> 16, -2047, 2047) + 2047]
        found = coder.bit(p)
        e = (65536 if found else 0) - p >> 4
        for i, limit in zip(range(len(models)), LIMITS):
            weights[i] = clamp(weights[i] + (stretched[i] * e + 2048 >> 12), -196608, 196608)
            update(models[i], found, limit)
        return found


class Band:
    # `past`: the values of the moved volume before, if the band is coded after it. `integers`: all values are.
    def __init__(self, data, size, bound, past=None, integers=False):
        self.past, self.integers = past, integers
        self.low, self.high, first = struct.unpack_from("<3f", data)
        if not -float("inf") < self.low <= first <= self.high < float("inf"):
            sys.exit("damaged: a band's range is none")
        self.coder, self.size, self.bound = Coder(data[12:]), size, bound
        self.strides = (1, size[0], size[0] * size[1])
        self.values = [first] * (size[0] * size[1] * size[2])
        self.residuals = [0] * len(self.values)
        self.flags, self.own, self.larger, self.digit, self.signs = {}, {}, {}, {}, {}
        self.mixer = Mixer(6 if past else 5)
        before = None
        for self.level in reversed(range((max(size) - 1).bit_length())):
            before = self.one_level(1 << self.level, before)

    def within(self, v):
        return v if self.low <= v <= self.high else self.high if v > self.high else self.low

    def one_level(self, h, before):
        self.step = f32(f32(2 * self.bound) * ((self.coder.uniform(6) + 1) / 64))
        self.scale = f32(1 / self.step)
        self.bias = f32(self.step * (self.coder.uniform(5) / 64))
        active, (bx, by, bz) = {}, (-(-n // (8 * h)) for n in self.size)
        for z in range(bz):
            for y in range(by):
                for x in range(bx):
                    c = before[x // 2, y // 2, z // 2] if before else 1
                    for at in (x - 1, y, z), (x, y - 1, z), (x, y, z - 1), (x + 1, y - 1, z), (x, y + 1, z - 1):
                        c = 2 * c + active.get(at, 0)
                    active[x, y, z] = self.coder.modeled_bit(self.flags, 2 * c + (h == 1))
        for number, odd in enumerate(CLASSES):
            xs, ys, zs = (range(h if a in odd else 0, self.size[a], 2 * h) for a in range(3))
            if not (xs and ys and zs):
                continue
            weights = WEIGHTS[len(odd)]
            if self.coder.modeled_bit(self.own, 0):
                weights = [(self.coder.uniform(8) ^ 128) - 128 for _ in weights]
            weights = [w / 64 for w in weights]
            share = ((self.coder.uniform(8) ^ 128) - 128) / 64 if self.past else 0
            for z in zs:
                for y in ys:
                    for x in xs:
                        self.point((x, y, z), h, number, odd, weights, share, active[x // (8 * h), y // (8 * h), z // (8 * h)])
        return active

    def point(self, at, h, number, odd, weights, share, active):
        i = sum(c * s for c, s in zip(at, self.strides))
        expected, t0, slope, bend, near = self.expect(self.values, i, at, h, odd, weights)
        expected, missed = self.within(expected), 0.0
        if self.past:
            missed = f32(self.past[i] - self.expect(self.past, i, at, h, odd, weights)[0])
            expected = self.within(f32(expected + f32(share * missed)))
        expected = f32(round(expected)) if self.integers else expected
        self.values[i] = expected
        if not active:
            return
        q = self.residual(i, at, h, number, t0, slope, bend, missed, near)
        if isinstance(q, float):
            self.values[i], self.residuals[i] = self.within(q), 127
        elif q:
            self.values[i] = self.within(f32(expected + f32(f32(q * self.step) - (self.bias if q > 0 else -self.bias))))
            self.residuals[i] = clamp(q, -127, 127)

    def expect(self, v, i, at, h, odd, weights):
        half = lambda a, b: f32(f32(a + b) * 0.5)

        # Where the neighbors d before and after along an axis are, relative to the point.
        def places(a, d, after_outside):
            s = d * self.strides[a]
            return -s if at[a] >= d else 0, s if at[a] + d < self.size[a] else after_outside * s

        def mean4(a, b, i=i):
            return half(*(half(v[i + p + places2[b][0]], v[i + p + places2[b][1]]) for p in places2[a]))

        places2 = [places(a, h, -1) if a in odd else places(a, 2 * h, 0) for a in range(3)]
        m, t, near, slope = [], [], [], 0.0
        for a in odd:
            one, two = (i + p for p in places2[a])
            near += one, two
            m.append(half(v[one], v[two]))
            slope = max(slope, abs(f32(v[two] - v[one])))
            if at[a] >= 3 * h and at[a] + 3 * h < self.size[a]:
                one, two = i - 3 * h * self.strides[a], i + 3 * h * self.strides[a]
            t.append(f32(half(v[one], v[two]) - m[-1]))
        if len(odd) == 1:
            base, (e, g) = m[0], (a for a in range(3) if a not in odd)
            t.append(f32(half(mean4(*odd, e), mean4(*odd, g)) - base))
            bend = max(abs(t[0]), abs(t[1]))
        elif len(odd) == 2:
            base = half(*m)
            t += f32(m[0] - base), f32(mean4(*odd) - base)
            bend = max(abs(t[2]), abs(t[3]))
        else:
            third = f32(1 / 3)
            base = f32(f32(f32(m[0] + m[1]) + m[2]) * third)
            faces = f32(f32(f32(mean4(0, 1) + mean4(0, 2)) + mean4(1, 2)) * third)
            corners = half(*(mean4(0, 1, i + p) for p in places2[2]))
            t += f32(m[0] - base), f32(m[1] - base), f32(faces - base), f32(corners - base)
            bend = max(abs(t[3]), abs(t[4]), abs(f32(m[2] - base)), abs(t[5]))
        expected = base
        for w, difference in zip(weights, t):
            expected = f32(expected + f32(w * difference))
        return expected, t[0], slope, bend, near

    # The residual in steps, or a float: the value itself.
    def residual(self, i, at, h, number, t0, slope, bend, missed, places):
        coder, residuals, d = self.coder, self.residuals, [2 * h * s for s in self.strides]
        bx, by, bz = (residuals[i - d[a]] if at[a] >= 2 * h else 0 for a in range(3))
        diagonal, row = 0, 1 if at[1] >= 2 * h else 2
        if at[0] + 2 * h < self.size[0] and at[row] >= 2 * h:
            diagonal = abs(residuals[i + d[0] - d[row]])
        near, lean = min(sum(abs(residuals[p]) for p in places), 255), sum(residuals[p] for p in places)
        back, order = abs(bx) + abs(by) + abs(bz), len(places) // 2 - 1
        s, b = octave(f32(slope * self.scale)), octave(f32(bend * self.scale))
        k, total = 3 * min(self.level, 2) + order, bin8(near + 2 * (back + diagonal))
        x, y, z = (min(abs(n), 2) for n in (bx, by, bz))
        contexts = (
            (8 * k + bin8(near)) * 8 + bin8(back + diagonal),
            (16 * order + s) * 16 + b,
            (4 * number + min(self.level, 3)) * 16 + min(near + 2 * back + diagonal, 15),
            (16 * order + b) * 8 + total,
            ((9 * (3 * order + x) + 3 * y + z) * 4 + min(near, 3)) * 2 + min(diagonal, 1))
        if self.past:
            contexts += (16 * order + octave(f32(missed * self.scale))) * 8 + total,
        q = 0
        while q < 3 and self.mixer.decode_bit(coder, [(c, q) for c in contexts], (q, 2 * k + min(total, 1))):
            q += 1
        if q == 0:
            return 0
        if q == 3:
            n = 0
            while n < 20 and coder.modeled_bit(self.larger, (total // 4, n)):
                n += 1
            if 0 < n < 20:
                second = coder.modeled_bit(self.digit, n)
                q += ((2 + second) << n - 1 | coder.uniform(n - 1)) - 1
            if n == 20 or q == 1 << 20:
                return struct.unpack("<f", struct.pack("<I", coder.uniform(32)))[0]
        index = 27 * order + 9 * sign3(f32(t0 * self.scale) * 16) + 3 * sign3(lean) + sign3(bx + by + bz)
        return -q if coder.modeled_bit(self.signs, index) else q


# A band of wavelet coefficients.
class WaveletBand:
    STEPS, SCALE = [c_float(w).value for w in (-1.5861343, -0.05298012, 0.8829111, 0.44350685)], c_float(1.1496044).value

    def __init__(self, data, size):
        self.low, self.high, step = struct.unpack_from("<3f", data)
        if not (-float("inf") < self.low <= self.high < float("inf") and 0 < step < float("inf")):
            sys.exit("damaged: a band's range or step is none")
        self.coder, self.mixer, self.signs, self.lengths = Coder(data[12:]), Mixer(), {}, {}
        levels = [tuple(size)]
        while len(levels) < 7 and any(n >= 8 for n in levels[-1]):
            levels.append(tuple(-(-n // 2) if n >= 8 else n for n in levels[-1]))
        self.found, last = {}, len(levels) - 1
        self.subband(0, last, 0, (0, 0, 0), levels[last], None, None, {})
        above = {}
        for level in reversed(range(last)):
            whole, low = levels[level:level + 2]
            halved = [c != n for c, n in zip(levels[level + 2], low)] if level + 2 <= last else None
            seen, here = {}, {}
            for o in 1, 2, 4, 3, 5, 6, 7:
                high = [o >> a & 1 for a in range(3)]
                if any(h and n == m for h, n, m in zip(high, low, whole)):
                    continue
                origin = [n if h else 0 for h, n in zip(high, low)]
                sides = [m - n if h else n for h, n, m in zip(high, low, whole)]
                here[o] = self.subband(o, level, last - level, origin, sides, above.get(o), halved, seen), sides
                for at, q in here[o][0].items():
                    seen[at] = min(seen.get(at, 0) + abs(q), 127)
            above = here
        bias = f32(0.04)
        values = {at: f32(f32(f32(q) - (bias if q > 0 else -bias if q < 0 else 0.0)) * step) for at, q in self.found.items()}
        for (x, y, z), low in reversed(list(zip(levels, levels[1:]))):
            for axis in reversed(range(3)):
                if (x, y, z)[axis] == low[axis]:
                    continue
                others = [range(n) for a, n in enumerate((x, y, z)) if a != axis]
                for i in others[0]:
                    for j in others[1]:
                        place = lambda k: (i, j)[:axis] + (k,) + (i, j)[axis:]
                        self.inverse(values, [place(k) for k in range((x, y, z)[axis])])
        nx, ny, nz = size
        self.values = [self.within(values[x, y, z]) for z in range(nz) for y in range(ny) for x in range(nx)]

    within = Band.within

    # The line of values at these places.
    def inverse(self, values, places):
        half = -(-len(places) // 2)
        line = [0.0] * len(places)
        for k, at in enumerate(places):
            if k < half:
                line[2 * k] = f32(values[at] / self.SCALE)
            else:
                line[2 * (k - half) + 1] = f32(values[at] * self.SCALE)
        for n in reversed(range(4)):
            for i in range(1 - n % 2, len(line), 2):
                after = line[i + 1] if i + 1 < len(line) else line[i - 1]
                before = line[i - 1] if i else after
                line[i] = f32(line[i] + f32(-self.STEPS[n] * f32(before + after)))
        for at, value in zip(places, line):
            values[at] = value

    def subband(self, o, level, depth, origin, sides, above, halved, seen):
        coded = {}
        own = lambda *at: abs(coded.get(at, 0))
        axes, fine, kind = bin(o).count("1"), min(level, 3), 8 * o + min(depth, 7)
        around = lambda source, x, y, z: sum(abs(source.get(at, 0)) for at in (
            (x - 1, y, z), (x + 1, y, z), (x, y - 1, z), (x, y + 1, z), (x, y, z - 1), (x, y, z + 1)))
        for z in range(sides[2]):
            for y in range(sides[1]):
                for x in range(sides[0]):
                    parent = parents = 0
                    if above:
                        at = tuple(min(c // 2 if h else c, n - 1) for c, h, n in zip((x, y, z), halved, above[1]))
                        parent, parents = abs(above[0].get(at, 0)), around(above[0], *at)
                    other, others = seen.get((x, y, z), 0), around(seen, x, y, z)
                    near = own(x - 1, y, z) + own(x, y - 1, z) + own(x, y, z - 1)
                    diagonal = own(x + 1, y - 1, z) + own(x - 1, y - 1, z) + own(x + 1, y, z - 1) \
                        + own(x, y + 1, z - 1) + own(x - 1, y, z - 1) + own(x, y - 1, z - 1)
                    far = own(x - 2, y, z) + own(x, y - 2, z) + own(x, y, z - 2)
                    total = 2 * near + diagonal + 2 * parent + parents + 2 * other + others
                    contexts = (
                        (8 * axes + bin8(near)) * 8 + bin8(diagonal),
                        ((4 * o + fine) * 8 + bin8(parent)) * 8 + bin8(parents),
                        ((8 * axes + bin8(near + far)) * 8 + bin8(2 * parent + parents)) * 4 + fine,
                        ((8 * axes + bin8(other)) * 8 + bin8(others)) * 8 + bin8(near + diagonal),
                        32 * kind + min(total // 2, 31))
                    mixer = 4 * kind + 2 * (near + diagonal > 0) + (parent + parents > 0)
                    s = [sign3(coded.get(at, 0)) for at in ((x - 1, y, z), (x, y - 1, z), (x, y, z - 1))]
                    q = self.magnitude(contexts, mixer, bin8(near))
                    if q and self.coder.modeled_bit(self.signs, ((3 * o + s[0]) * 3 + s[1]) * 3 + s[2]):
                        q = -q
                    self.found[origin[0] + x, origin[1] + y, origin[2] + z] = q
                    coded[x, y, z] = clamp(q, -127, 127)
        return coded

    def magnitude(self, contexts, mixer, length):
        for stage in range(4):
            if not self.mixer.decode_bit(self.coder, [(c, stage) for c in contexts], (stage, mixer)):
                return stage
        n = 0
        while n < 29 and self.coder.modeled_bit(self.lengths, (length, n)):
            n += 1
        high = max(n - 16, 0)
        upper = self.coder.uniform(high) if high else 0
        return (1 << n | upper << 16 | (self.coder.uniform(n - high) if n else 0)) + 3


# The indices of the missing points.
def mask(data, size):
    coder, models, missing, state = Coder(data), {}, set(), {}
    nx, ny, nz = size
    bx, by, bz = (-(-n // 8) for n in size)
    for z in range(bz):
        for y in range(by):
            for x in range(bx):
                c = sum(n * state.get(at, 0) for n, at in ((1, (x - 1, y, z)), (3, (x, y - 1, z)), (9, (x, y, z - 1))))
                mixed = coder.modeled_bit(models, ("mixed", c))
                state[x, y, z] = 2 if mixed else 1 if coder.modeled_bit(models, ("missing", c)) else 0
    before = (-1, 0, 0), (-2, 0, 0), (0, -1, 0), (-1, -1, 0), (1, -1, 0), (0, 0, -1), (-1, 0, -1), (1, 0, -1), (0, -1, -1), (0, 1, -1)
    index = lambda x, y, z: (z * ny + y) * nx + x
    for z in range(nz):
        for y in range(ny):
            for x in range(nx):
                found = state[x // 8, y // 8, z // 8]
                if found == 2:
                    c = 0
                    for dx, dy, dz in before:
                        p = x + dx, y + dy, z + dz
                        inside = all(0 <= q < n for q, n in zip(p, size))
                        c = 2 * c + (inside and index(*p) in missing)
                    found = coder.modeled_bit(models, ("point", c))
                if found:
                    missing.add(index(x, y, z))
    return missing


# The fields of a protobuf message, the last one of each number.
def fields(message):
    found, at = {}, 0

    def varint():
        nonlocal at
        value, shift = 0, 0
        while True:
            byte, at = message[at], at + 1
            value |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                return value

    while at < len(message):
        key = varint()
        if key & 7 == 0:
            found[key >> 3] = varint()
        else:
            length = varint() if key & 7 == 2 else {1: 8, 5: 4}[key & 7]
            found[key >> 3], at = message[at:at + length], at + length
    return found


# Values between the points of a volume.
def sampled(values, size, place):
    base, weight = [], []
    for x, n in zip(place, size):
        x = clamp(x, 0.0, n - 1.0)
        base.append(min(int(x), max(n - 2, 0)))
        weight.append(f32(x - base[-1]))
    step = [n > 1 for n in size]
    lerp = lambda a, b, w: f32(a + f32(w * f32(b - a)))
    v = lambda x, y, z: values[((base[2] + z * step[2]) * size[1] + base[1] + y * step[1]) * size[0] + base[0] + x * step[0]]
    row = lambda y, z: lerp(v(0, y, z), v(1, y, z), weight[0])
    plane = lambda z: lerp(row(0, z), row(1, z), weight[1])
    return lerp(plane(0), plane(1), weight[2])


# The values of the volume before where the motion says that each point comes from.
def moved(data, values, old, size):
    if old != size:
        scale = [f32((m - 1) / max(n - 1, 1)) for m, n in zip(old, size)]
        places = ((x, y, z) for z in range(size[2]) for y in range(size[1]) for x in range(size[0]))
        values = [sampled(values, old, [f32(c * s) for c, s in zip(at, scale)]) for at in places]
    coder, control = Coder(data), [-(-(n - 1) // 16) + 1 for n in size]
    some, less, longer, vectors = {}, {}, {}, {}
    for z in range(control[2]):
        for y in range(control[1]):
            for x in range(control[0]):
                near = (x - 1, y, z) if x else (x, y - 1, z) if y else (x, y, z - 1)
                vector, changed = list(vectors.get(near, (0, 0, 0))), 0
                for axis in range(3):
                    if not coder.modeled_bit(some, (axis, changed)):
                        continue
                    changed += 1
                    negative, n = coder.modeled_bit(less, axis), 0
                    while n < 7 and coder.modeled_bit(longer, (axis, n)):
                        n += 1
                    change = 1 << n | coder.uniform(n)
                    vector[axis] = (vector[axis] + (-change if negative else change) + 128) % 256 - 128
                vectors[x, y, z] = vector
    lerp = lambda a, b, w: [f32(p + f32(w * f32(q - p))) for p, q in zip(a, b)]
    place = lambda i, n: (i // 16, min(i // 16 + 1, n - 1), i % 16 / 16)
    out = []
    for z in range(size[2]):
        for y in range(size[1]):
            (y0, y1, wy), (z0, z1, wz) = place(y, control[1]), place(z, control[2])
            at = lambda *p: [c / 4 for c in vectors[p]]
            row = [lerp(lerp(at(x, y0, z0), at(x, y1, z0), wy), lerp(at(x, y0, z1), at(x, y1, z1), wy), wz) for x in range(control[0])]
            for x in range(size[0]):
                x0, x1, wx = place(x, control[0])
                out.append(sampled(values, size, [f32(c + d) for c, d in zip((x, y, z), lerp(row[x0], row[x1], wx))]))
    return out


# Dimensions, error bound, values (None where missing) and checksum of the first of these files, which may be coded after the second.
def volume(paths):
    data = open(paths[0], "rb").read()
    if data[:4] != b"LVOL":
        sys.exit("not a reduced volume: the magic bytes are missing")
    if len(data) < 14 or zlib.crc32(data[:-4]) != int.from_bytes(data[-4:], "little"):
        sys.exit("damaged: the checksum differs")
    version, length = struct.unpack_from("<HI", data, 4)
    if version not in (1, 2, 3, 4, 5) or length > min(262144, len(data) - 14):
        sys.exit(f"version {version} with a header of {length} bytes is not known to this reader")
    header = fields(data[10:10 + length])
    grid, params = fields(header.get(1, b"")), fields(header.get(3, b""))
    nx, ny, nz = size = tuple(grid.get(k, 0) for k in (1, 2, 3))
    if params.get(5) != 1 or not nx * ny * nz:
        sys.exit("the header is not of a volume")
    bound = max(f32(struct.unpack("<d", params.get(2, bytes(8)))[0]), f32(1e-6))
    count = max(1, min(nx * ny * nz >> 22, nz // 16))
    at, missing, past = 10 + length, (), None
    if version > 1:
        part = int.from_bytes(data[at:at + 8], "little")
        missing = mask(data[at + 8:at + 8 + part], size) if part or version == 2 else ()
        at += 8 + part
    if version == 4:
        checksum, part = struct.unpack_from("<IQ", data, at)
        if len(paths) < 2:
            sys.exit(f"it is coded after the volume with the checksum {checksum:08x}: name that file too")
        old, _, values, found = volume(paths[1:])
        if found != checksum:
            sys.exit(f"it is coded after the volume with the checksum {checksum:08x}, not after {found:08x}")
        past = moved(data[at + 12:at + 12 + part], [v or 0.0 for v in values], old, size)
        at += 12 + part
    if version == 5:
        first, width = struct.unpack_from("<2f", data, at)
        at += 8
    lengths_at, at = at, at + 8 * count
    if at > len(data) - 4:
        sys.exit("damaged: the lengths of the bands are missing")
    lengths = struct.unpack_from(f"<{count}Q", data, lengths_at)
    if min(lengths) < 12 or at + sum(lengths) != len(data) - 4:
        sys.exit("damaged: the bands' lengths do not fit the file")
    values = []
    for k in range(count):
        low, high = (i * nz // count for i in (k, k + 1))
        sides, coded = (nx, ny, high - low), data[at:at + lengths[k]]
        kind, coded = (coded[0], coded[1:]) if version in (3, 4) else (0, coded)
        if kind > (2 if past else 1) or len(coded) < 12:
            sys.exit("damaged: a band's coding is not known")
        here = past[nx * ny * low:nx * ny * high] if kind == 2 else None
        if version == 5:
            values += [f32(first + f32(n * width)) for n in Band(coded, sides, 0.5, integers=True).values]
        else:
            values += (WaveletBand(coded, sides) if kind == 1 else Band(coded, sides, bound, here)).values
        at += lengths[k]
    for i in missing:
        values[i] = None
    return size, bound, values, int.from_bytes(data[-4:], "little")


size, bound, values, _ = volume(sys.argv[1:])
print(*size)
print("%.9g" % bound)
print("\n".join("nan" if v is None else "%.9g" % v for v in values))
