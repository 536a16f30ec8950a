"""Writes the benchmark's field as a raw float32 cube, x fastest, and OUT.nhdr, which places it for peers.toml.
Usage: field.py N OUT [--noise SIGMA] [--seed SEED]

At N = 256 it is the field other renderers were measured on: a shell, roughened by six octaves of value noise, around
a core. Other N resample that field corner to corner: larger ones by a Catmull-Rom spline, smaller ones by averaging
over what a voxel covers. Noise is added last; values stay within 0..1. It is written slice by slice: whatever N, memory
is what making the 256^3 field takes, 0.6 GB."""
import argparse, hashlib, os
import numpy as np

BASE, SEED, OCTAVES = 256, 20160710, 6
KNOWN = "345d54b669f2742f63dbaa6ebce6468d7ab3aba3680ec086cbca806fae17673d"
f32 = np.float32


def octave(rng, cells):
    """Random values on the corners of cells^3 cells, blended smoothly (6t^5 - 15t^4 + 10t^3) to BASE^3 voxels."""
    values = rng.uniform(-1, 1, 3 * [cells + 1]).astype(f32)
    at = (np.arange(BASE, dtype=f32) + 0.5) * (cells / BASE)
    low = at.astype(int)
    t = at - low
    blend = (t * t * t * (t * (t * 6 - 15) + 10)).astype(f32)
    for axis in range(3):
        near, far = values.take(low, axis), values.take(low + 1, axis)
        values = near + (far - near) * np.expand_dims(blend, tuple({0, 1, 2} - {axis}))
    return values


def base_field():
    """The field at 256^3. The order of operations is kept: the file's checksum depends on it."""
    rng = np.random.default_rng(SEED)
    noise, ridges = np.zeros((2, BASE, BASE, BASE), f32)
    for k in range(OCTAVES):
        layer, gain = octave(rng, 4 << k), 0.5 ** k
        noise += f32(gain) * layer
        ridges += f32(gain) * (1 - np.abs(layer))
    total = f32(sum(0.5 ** k for k in range(OCTAVES)))
    noise /= total
    ridges /= total
    axis = (np.arange(BASE, dtype=f32) + 0.5) / BASE * 2 - 1
    square = axis * axis
    radius = np.sqrt(square[None, None, :] + square[None, :, None] + square[:, None, None]) + f32(0.35) * noise
    field = np.exp(-np.square((radius - 0.68) / 0.11)) * (0.15 + 1.1 * (ridges - 0.35))
    field = field + 0.9 * np.exp(-np.square(radius / 0.24)) * (0.6 + 0.8 * noise)
    field = field + 0.05 * np.maximum(noise, 0) * (radius < 0.8)
    return np.clip(field * f32(1.2), 0, 1).astype(f32)


def resampling(n):
    """An n x BASE matrix: every row the weights of one new voxel, first and last of them on the old corners."""
    at = np.linspace(0, BASE - 1, n)
    old = np.arange(BASE)
    if n == BASE:
        return np.eye(BASE, dtype=f32)
    if n > BASE:
        low = np.minimum(at.astype(int), BASE - 2)
        t = at - low
        weights = np.zeros((n, BASE))
        kernel = (t * (t * (2 - t) - 1), t * t * (3 * t - 5) + 2, t * (t * (4 - 3 * t) + 1), t * t * (t - 1))
        for offset, weight in zip((-1, 0, 1, 2), kernel):
            np.add.at(weights, (np.arange(n), np.clip(low + offset, 0, BASE - 1)), 0.5 * weight)
    else:
        half = 0.5 * (BASE - 1) / (n - 1)  # a new voxel covers at - half .. at + half, an old one its index +- 0.5
        high, low = np.minimum((at + half)[:, None], old + 0.5), np.maximum((at - half)[:, None], old - 0.5)
        weights = np.maximum(high - low, 0)
    return (weights / weights.sum(1, keepdims=True)).astype(f32)


def header(n, data):
    gap = 255.0 / (n - 1)
    lines = ["NRRD0004", "type: float", "dimension: 3", f"sizes: {n} {n} {n}", f"spacings: {gap!r} {gap!r} {gap!r}",
             "endian: little", "encoding: raw", f"data file: {data}"]
    return "\n".join(lines) + "\n\n"


def main():
    usage = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    usage.add_argument("n", type=int)
    usage.add_argument("out")
    usage.add_argument("--noise", type=float, default=0.0, metavar="SIGMA")
    usage.add_argument("--seed", type=int, default=1)
    given = usage.parse_args()
    if not 2 <= given.n <= 1024:
        usage.error("N must lie in 2..1024")
    n, field, rows = given.n, base_field(), resampling(given.n)
    rng, digest = np.random.default_rng(given.seed), hashlib.sha256()
    with open(given.out, "wb") as out:
        for along_z in rows:
            taps = np.flatnonzero(along_z)
            plane = np.tensordot(along_z[taps], field[taps], 1)
            plane = rows @ plane @ rows.T if n != BASE else plane
            if given.noise:
                plane = plane + f32(given.noise) * rng.standard_normal((n, n), f32)
            data = np.clip(plane, 0, 1).astype("<f4").tobytes()
            digest.update(data)
            out.write(data)
    with open(given.out + ".nhdr", "w") as out:
        out.write(header(n, os.path.basename(given.out)))
    print(f"{given.out}: {n}^3, sha256 {digest.hexdigest()}")
    if n == BASE and not given.noise and digest.hexdigest() != KNOWN:
        raise SystemExit("not the known field bit by bit: another numpy or processor may round exp differently")


if __name__ == "__main__":
    main()
