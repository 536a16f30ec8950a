"""Prints the PSNR of two pictures' RGB, in dB with peak 1 over all pixels: .npy (float 0..1, or 8 bits), .pfm or .png.
Usage: psnr.py A B"""
import math, sys
import numpy as np


def read_pfm(path):
    with open(path, "rb") as file:
        if file.readline().strip() != b"PF":
            raise SystemExit(f"{path}: not a color PFM")
        width, height = map(int, file.readline().split())
        scale = float(file.readline())
        return np.fromfile(file, "<f4" if scale < 0 else ">f4").reshape(height, width, 3)[::-1]


def read(path):
    """RGB in 0..1, rows from the top."""
    if path.endswith(".npy"):
        picture = np.load(path)
    elif path.endswith(".pfm"):
        picture = read_pfm(path)
    else:
        from PIL import Image
        picture = np.asarray(Image.open(path).convert("RGB"))
    return picture[..., :3] / (255.0 if picture.dtype == np.uint8 else 1.0)


def psnr(a, b):
    if a.shape != b.shape:
        raise SystemExit(f"pictures of {a.shape[1]} x {a.shape[0]} and {b.shape[1]} x {b.shape[0]} pixels")
    error = np.mean((a.astype(np.float64) - b) ** 2)
    return math.inf if error == 0 else -10 * math.log10(error)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        raise SystemExit(__doc__)
    print(f"psnr_db {psnr(read(sys.argv[1]), read(sys.argv[2])):.4f}")
