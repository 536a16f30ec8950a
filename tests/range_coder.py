"""The range decoder and its adaptive bit models, from the section "Range coder" of proto/formats/volume.md; both readers use it."""
from bisect import bisect_left

RATE = [16384 // (2 * n + 3) for n in range(128)]


def clamp(x, low, high):
    return low if x < low else high if x > high else x


def squash_and_stretch():
    t, powers = 1 / 256, [1.0]
    while len(powers) < 2048:
        powers.append(powers[-1] * (1 + t * (1 + t / 2 * (1 + t / 3 * (1 + t / 4)))))
    shares = [1 / (1 + powers[-x]) if x < 0 else powers[x] / (1 + powers[x]) for x in range(-2047, 2048)]
    squash = [clamp(int(65536 * s), 32, 65504) for s in shares]
    return squash, [min(bisect_left(squash, 16 * i + 8) - 2047, 2047) for i in range(4096)]


SQUASH, STRETCH = squash_and_stretch()


class Coder:
    def __init__(self, data):
        self.data, self.at, self.range = data + bytes(16), 8, 2**64 - 1
        self.code = int.from_bytes(self.data[:8], "big")

    def renormalize(self):
        if self.range < 2**32:
            self.range <<= 32
            self.code = self.code << 32 | int.from_bytes(self.data[self.at:self.at + 4].ljust(4, b"\0"), "big")
            self.at += 4

    def bit(self, p):
        split = (self.range >> 16) * p
        found = self.code < split
        if found:
            self.range = split
        else:
            self.code -= split
            self.range -= split
        self.renormalize()
        return found

    def uniform(self, n):
        if n > 16:
            high = self.uniform(n - 16)
            return high << 16 | self.uniform(16)
        part = self.range >> n
        found = min(self.code // part, 2**n - 1)
        self.code -= found * part
        self.range = part
        self.renormalize()
        return found

    def modeled_bit(self, models, index):
        model = models.setdefault(index, [1 << 21, 0])
        found = self.bit(clamp(model[0] >> 6, 32, 65504))
        update(model, found, 24)
        return found


def update(model, bit, limit):
    p, count = model
    model[0] = (p << 10) + count + ((2**22 - 1 if bit else 0) - p >> 3) * RATE[count] >> 10
    model[1] = min(count + 1, limit)
