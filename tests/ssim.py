"""SSIM and multi-scale SSIM of two PFM pictures, from the definitions: every window in two dimensions, variances as weighted
mean squares of differences from the window's own mean. Prints both."""

import sys

import numpy as np

SIDE, DEVIATION, C1, C2 = 11, 1.5, 0.01**2, 0.03**2
EXPONENTS = [0.0448, 0.2856, 0.3001, 0.2363, 0.1333]


def read_pfm(path):
    with open(path, "rb") as file:
        assert file.readline().strip() == b"PF"
        width, height = map(int, file.readline().split())
        order = "<f4" if float(file.readline()) < 0 else ">f4"
        # Rows are stored from the bottom up.
        return np.frombuffer(file.read(), order).reshape(height, width, 3)[::-1].astype(float)


def terms(a, b):
    """Means over all windows of luminance x structure and of structure, for one channel."""
    at = np.arange(SIDE) - SIDE // 2
    weights = np.exp(-(at[:, None] ** 2 + at[None, :] ** 2) / (2 * DEVIATION**2))
    weights /= weights.sum()
    windows = lambda plane: np.lib.stride_tricks.sliding_window_view(plane, (SIDE, SIDE))
    mean = lambda values: np.einsum("yxij,ij->yx", values, weights)
    wa, wb = windows(a), windows(b)
    ma, mb = mean(wa), mean(wb)
    da, db = wa - ma[..., None, None], wb - mb[..., None, None]
    structure = (2 * mean(da * db) + C2) / (mean(da * da) + mean(db * db) + C2)
    luminance = (2 * ma * mb + C1) / (ma * ma + mb * mb + C1)
    return (luminance * structure).mean(), structure.mean()


def halved(plane):
    height, width = (n // 2 * 2 for n in plane.shape)
    return plane[:height, :width].reshape(height // 2, 2, width // 2, 2).mean(axis=(1, 3))


def multi_scale(a, b):
    product = 1.0
    for scale, exponent in enumerate(EXPONENTS):
        both, structure = terms(a, b)
        product *= max(both if scale == len(EXPONENTS) - 1 else structure, 0.0) ** exponent
        a, b = halved(a), halved(b)
        if min(a.shape) < SIDE:
            assert scale == len(EXPONENTS) - 1
            break
    return product


first, second = (read_pfm(path) for path in sys.argv[1:3])
channels = [(first[..., c], second[..., c]) for c in range(3)]
print("ssim", np.mean([terms(a, b)[0] for a, b in channels]))
print("ms_ssim", np.mean([multi_scale(a, b) for a, b in channels]))
