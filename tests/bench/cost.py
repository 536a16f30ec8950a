"""Measures what Lamina's kernels take as volume, VDI and picture grow, and draws it: out/bench/cost.csv and cost.svg.
Usage: cost.py [--rounds 3] [--picture FILE.svg] [--redraw]    (--redraw: from the .csv there is)

The field of field.py under peers.toml, gamma 0.02. Where a panel does not vary them: 256^3 voxels, r = 256, pictures of
768 x 768 from 30 degrees aside. Times are medians over rounds of processor time, all threads: wall times depend on the
number of cores and on what else they do. Needs out/bench/venv (tests/bench/setup) and target/release/lamina."""
import argparse, csv, math, os, subprocess, sys
from compare import OUT, SCENE, HERE, at, bench

VOXELS, RAYS, PIXELS = (64, 128, 256, 512), (128, 192, 256, 384, 512, 768), (128, 256, 384, 512, 768, 1024)
GENERATE, CAST, RENDER = "generate", "ray cast", "novel view"
COLORS = {CAST: "#c2410c", GENERATE: "#4d7c0f", RENDER: "#1d4ed8"}
PANELS = {"voxels": ("volume, voxels a side", VOXELS), "rays": ("VDI, rays a side (r)", RAYS),
          "pixels": ("picture, pixels a side", PIXELS)}


def field(n):
    path = at(f"vol{n}.raw")
    if not os.path.exists(path + ".nhdr"):
        subprocess.run([sys.executable, os.path.join(HERE, "field.py"), str(n), path], check=True)
    return path + ".nhdr"


def measure(rounds):
    """Rows of (panel, at, kernel, cpu_ms, wall_ms)."""
    def run(panel, at, kernels, n=256, r=256, size=768):
        figures = bench(field(n), *SCENE, "--rounds", rounds, "--resolution", r, "--size", size)
        for kernel, name in kernels.items():
            yield {"panel": panel, "at": at, "kernel": kernel, "cpu_ms": round(figures[name]["cpu_ms"], 3),
                   "wall_ms": round(figures[name]["wall_ms"], 3)}

    for n in VOXELS:
        aside = "raycast 768 from aside"
        yield from run("voxels", n, {CAST: aside, GENERATE: "generate 256", RENDER: "render 256 at 768"}, n=n)
    for r in RAYS:
        yield from run("rays", r, {GENERATE: f"generate {r}", RENDER: f"render {r} at 768"}, r=r)
    for px in PIXELS:
        yield from run("pixels", px, {CAST: f"raycast {px} from aside", RENDER: f"render 256 at {px}"}, size=px)


class Log:
    """A map of values to pixels, both ends included."""

    def __init__(self, low, high, start, end):
        self.low, self.start, self.scale = math.log(low), start, (end - start) / math.log(high / low)

    def __call__(self, value):
        return round(self.start + self.scale * (math.log(value) - self.low), 1)


def text(x, y, words, anchor="middle", more=""):
    return f'<text x="{x}" y="{y}" text-anchor="{anchor}"{more}>{words}</text>'


def drawing(rows):
    """Three panels side by side with one scale of time: lines over log-log axes, named where they end."""
    width, height, top, bottom, left, gap = 960, 330, 30, 280, 60, 24
    panel_width = (width - left - 3 * gap) / 3
    values = [row["cpu_ms"] for row in rows]
    grid = [m * 10.0 ** e for e in range(-3, 7) for m in (1, 2, 5)]
    low, high = max(g for g in grid if g <= min(values)), min(g for g in grid if g >= max(values))
    y = Log(low, high, bottom, top)
    parts = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
             'font-family="sans-serif" font-size="12" fill="#222">',
             f'<rect width="{width}" height="{height}" fill="#fff"/>',
             text(14, (top + bottom) / 2, "CPU time, ms",
                  more=f' transform="rotate(-90 14 {(top + bottom) / 2})"')]
    for number, (panel, (title, ticks)) in enumerate(PANELS.items()):
        x0 = left + number * (panel_width + gap)
        x = Log(ticks[0], ticks[-1], x0 + 12, x0 + panel_width - 12)
        for value in grid[grid.index(low):grid.index(high) + 1]:
            parts.append(f'<path d="M{x0:.1f} {y(value)}h{panel_width:.1f}" stroke="#ddd"/>')
            if number == 0:
                parts.append(text(left - 6, y(value) + 4, f"{value:g}", "end"))
        parts += [text(x(tick), bottom + 18, tick) for tick in ticks]
        parts.append(text(round(x0 + panel_width / 2, 1), bottom + 40, title))
        for kernel, color in COLORS.items():
            shown = [row for row in rows if (row["panel"], row["kernel"]) == (panel, kernel)]
            points = [(x(row["at"]), y(row["cpu_ms"])) for row in shown]
            if points:
                line = " ".join(f"{a},{b}" for a, b in points)
                parts.append(f'<polyline points="{line}" fill="none" stroke="{color}" stroke-width="2"/>')
                parts += [f'<circle cx="{a}" cy="{b}" r="2.5" fill="{color}"/>' for a, b in points]
    for number, (kernel, color) in enumerate(COLORS.items()):
        x0 = left + 110 * number
        parts.append(f'<path d="M{x0} 14h22" stroke="{color}" stroke-width="2"/>')
        parts.append(text(x0 + 28, 18, kernel, "start"))
    return "\n".join([*parts, "</svg>", ""])


def main():
    usage = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    usage.add_argument("--rounds", type=int, default=3)
    usage.add_argument("--picture", default=at("cost.svg"))
    usage.add_argument("--redraw", action="store_true")
    given = usage.parse_args()
    table = at("cost.csv")
    if not given.redraw:
        os.makedirs(OUT, exist_ok=True)
        rows = list(measure(given.rounds))
        with open(table, "w", newline="") as file:
            writer = csv.DictWriter(file, list(rows[0]))
            writer.writeheader()
            writer.writerows(rows)
    with open(table, newline="") as file:
        rows = [{**row, "at": int(row["at"]), "cpu_ms": float(row["cpu_ms"])} for row in csv.DictReader(file)]
    with open(given.picture, "w") as file:
        file.write(drawing(rows))
    print(given.picture)


if __name__ == "__main__":
    main()
