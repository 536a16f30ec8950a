"""A blob that drifts, colored by its heat, pushed in slabs by 1 to 16 ranks: blob.py URL RANK RANKS."""

import array
import sys

import lamina

NX, NY, NZ, STEPS = 24, 20, 16, 3

url, rank, ranks = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
first, beyond = NZ * rank // ranks, NZ * (rank + 1) // ranks


def fields(step):
    """Density and heat of this rank's slab, z fastest, as arrays of shape (NX, NY, slab) lie in memory; NumPy's would do."""
    density, heat = array.array("d"), array.array("d")
    for i in range(NX):
        for j in range(NY):
            for k in range(first, beyond):
                x, y, z = 0.1 * i - 0.8 - 0.2 * step, 0.1 * j - 1.0, 0.1 * k - 0.8
                density.append(1.0 / (1.0 + 9.0 * (x * x + y * y + z * z)))
                heat.append(x + step)
    return (memoryview(values).cast("B").cast("d", (NX, NY, beyond - first)) for values in (density, heat))


try:
    run = lamina.Client(
        "blob",
        "density",
        (NX, NY, NZ),
        "float64",
        generator=url,
        spacing=(0.1, 0.1, 0.1),
        origin=(-1.2, -1.0, -0.8),
        color_field="heat",
        color_type="float64",
        rank=rank,
        ranks=ranks,
    )
except OSError as error:
    print(f"not shown: {error}", file=sys.stderr)
    run = None
for step in range(STEPS):
    density, heat = fields(step)
    try:
        run and run.push(step, 0.1 * step, density, start=(0, 0, first), colors=heat)
    except OSError as lost:
        print(f"step {step} not shown: {lost}", file=sys.stderr)
if run:
    summary = run.close()
    print(f"pushed {summary.pushed} dropped {summary.dropped} lost {summary.lost}")
