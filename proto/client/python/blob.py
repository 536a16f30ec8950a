"""A blob that drifts, pushed in slabs by as many ranks as one likes: blob.py URL RANK RANKS."""

import array
import sys

import lamina

NX, NY, NZ, STEPS = 24, 20, 16, 3

url, rank, ranks = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
first, beyond = NZ * rank // ranks, NZ * (rank + 1) // ranks


def density(i, j, k, step):
    x, y, z = 0.1 * i - 0.8 - 0.2 * step, 0.1 * j - 1.0, 0.1 * k - 0.8
    return 1.0 / (1.0 + 9.0 * (x * x + y * y + z * z))


run = lamina.Client(
    "blob", "density", (NX, NY, NZ), "float64", generator=url, spacing=(0.1, 0.1, 0.1), rank=rank, ranks=ranks
)
for step in range(STEPS):
    # z fastest, as an array of shape (NX, NY, slab) lies in memory; NumPy's would do as well.
    values = array.array("d", (density(i, j, k, step) for i in range(NX) for j in range(NY) for k in range(first, beyond)))
    slab = memoryview(values).cast("B").cast("d", (NX, NY, beyond - first))
    try:
        run.push(step, 0.1 * step, slab, start=(0, 0, first))
    except OSError as lost:
        print(f"step {step} not shown: {lost}", file=sys.stderr)
summary = run.close()
print(f"pushed {summary.pushed} dropped {summary.dropped} lost {summary.lost}")
