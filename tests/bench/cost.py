"""Measures how what Lamina does grows with volume, VDI, picture and cores, and draws it: out/bench/cost.csv and cost.svg.
Prints the exponent of each line: the slope of a straight line through its points, both axes logarithmic.
Usage: cost.py [--rounds 3] [--largest 1024] [--picture FILE.svg] [--redraw]    (--redraw: from the .csv there is)

The field of field.py under peers.toml, gamma 0.02. Where a panel does not vary them: 256^3 voxels, r = 256, pictures of
768 x 768 from 30 degrees aside; a study is `lamina tune --contract "size <= 100kB"`. Times are medians over rounds of
processor time, all threads; against cores, of wall time. Needs out/bench/venv (tests/bench/setup) and target/release/lamina."""
import argparse, csv, math, os, re, statistics, subprocess, sys
from compare import OUT, SCENE, HERE, LAMINA, at, bench

VOXELS, RAYS, PIXELS = (64, 128, 256, 512, 1024), (128, 192, 256, 384, 512, 768), (128, 256, 384, 512, 768, 1024)
CORES = tuple(2**k for k in range(10) if 2**k <= (os.cpu_count() or 1))
CAST, GENERATE, DECODE, MOTION, STILL, STUDY = "ray cast", "generate", "decode", "novel view", "still view", "study"
COLORS = {CAST: "#c2410c", GENERATE: "#4d7c0f", DECODE: "#a16207", MOTION: "#1d4ed8", STILL: "#7e22ce", STUDY: "#475569"}
PANELS = {"voxels": ("volume, voxels a side", VOXELS), "rays": ("VDI, rays a side (r)", RAYS),
          "pixels": ("picture, pixels a side", PIXELS), "cores": ("cores (wall time)", CORES)}


def field(n):
    path = at(f"vol{n}.raw")
    if not os.path.exists(path + ".nhdr"):
        subprocess.run([sys.executable, os.path.join(HERE, "field.py"), str(n), path], check=True)
    return path + ".nhdr"


def of_vdi(r, size):
    """The kernels that draw a VDI, with their names in `lamina-lab bench`."""
    return {GENERATE: f"generate {r}", DECODE: f"decode {r}", MOTION: f"render {r} at {size}", STILL: f"blend {r} at {size}"}


def study(n, rounds, figure):
    """Milliseconds of a study, of the processor or of the clock."""
    command = [LAMINA, "tune", field(n), *SCENE, "--contract", "size <= 100kB"]
    times = []
    for _ in range(rounds):
        begun = os.times().elapsed
        done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
        used = re.search(r"([\d.]+) s of processor time", done.stdout)
        times.append(1e3 * (float(used[1]) if figure == "cpu_ms" else os.times().elapsed - begun))
    return statistics.median(times)


def measure(rounds, largest):
    """Rows of (panel, at, kernel, ms)."""
    def run(panel, at, kernels, n=256, r=256, size=768, figure="cpu_ms"):
        figures = bench(field(n), *SCENE, "--rounds", rounds, "--resolution", r, "--size", size)
        for kernel, name in kernels.items():
            yield {"panel": panel, "at": at, "kernel": kernel, "ms": round(figures[name][figure], 3)}
        print(f"{panel} {at}", file=sys.stderr, flush=True)

    for n in (n for n in VOXELS if n <= largest):
        yield from run("voxels", n, {CAST: "raycast 768 from aside", **of_vdi(256, 768)}, n=n)
        yield {"panel": "voxels", "at": n, "kernel": STUDY, "ms": round(study(n, rounds, "cpu_ms"), 1)}
    for r in RAYS:
        yield from run("rays", r, of_vdi(r, 768), r=r)
    for px in PIXELS:
        drawn = {name: of_vdi(256, px)[name] for name in (MOTION, STILL)}
        yield from run("pixels", px, {CAST: f"raycast {px} from aside", **drawn}, size=px)
    for cores in CORES:
        available = os.sched_getaffinity(0)
        os.sched_setaffinity(0, set(sorted(available)[:cores]))
        yield from run("cores", cores, {CAST: "raycast 768 from aside", **of_vdi(256, 768)}, figure="wall_ms")
        yield {"panel": "cores", "at": cores, "kernel": STUDY, "ms": round(study(256, rounds, "wall_ms"), 1)}
        os.sched_setaffinity(0, available)


def points(rows, panel, kernel):
    return [(row["at"], row["ms"]) for row in rows if (row["panel"], row["kernel"]) == (panel, kernel)]


def exponent(line):
    """The slope of ln ms against ln of what varies, by least squares."""
    x, y = ([math.log(p[k]) for p in line] for k in (0, 1))
    mean_x, mean_y = statistics.fmean(x), statistics.fmean(y)
    return sum((a - mean_x) * (b - mean_y) for a, b in zip(x, y)) / sum((a - mean_x) ** 2 for a in x)


class Log:
    """A map of values to pixels, both ends included."""

    def __init__(self, low, high, start, end):
        self.low, self.start, self.scale = math.log(low), start, (end - start) / math.log(high / low)

    def __call__(self, value):
        return round(self.start + self.scale * (math.log(value) - self.low), 1)


def text(x, y, words, anchor="middle", more=""):
    return f'<text x="{x}" y="{y}" text-anchor="{anchor}"{more}>{words}</text>'


def drawing(rows):
    """Panels side by side with one scale of time: lines over log-log axes, each with its exponent where it ends."""
    width, height, top, bottom, left, gap = 1100, 420, 34, 370, 60, 44
    panel_width = (width - left - len(PANELS) * gap) / len(PANELS)
    values = [row["ms"] for row in rows]
    grid = [m * 10.0 ** e for e in range(-3, 7) for m in (1, 2, 5)]
    low, high = max(g for g in grid if g <= min(values)), min(g for g in grid if g >= max(values))
    y = Log(low, high, bottom, top)
    parts = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
             'font-family="sans-serif" font-size="12" fill="#222">',
             f'<rect width="{width}" height="{height}" fill="#fff"/>',
             text(14, (top + bottom) / 2, "time, ms", more=f' transform="rotate(-90 14 {(top + bottom) / 2})"')]
    for number, (panel, (title, ticks)) in enumerate(PANELS.items()):
        x0 = left + number * (panel_width + gap)
        x = Log(ticks[0], max(ticks[-1], 2 * ticks[0]), x0 + 12, x0 + panel_width - 12)
        for value in grid[grid.index(low):grid.index(high) + 1]:
            parts.append(f'<path d="M{x0:.1f} {y(value)}h{panel_width:.1f}" stroke="#ddd"/>')
            if number == 0:
                parts.append(text(left - 6, y(value) + 4, f"{value:g}", "end"))
        parts += [text(x(tick), bottom + 18, tick) for tick in ticks]
        parts.append(text(round(x0 + panel_width / 2, 1), bottom + 38, title))
        labels = []
        for kernel, color in COLORS.items():
            line = points(rows, panel, kernel)
            if line:
                at_pixels = [(x(a), y(ms)) for a, ms in line]
                path = " ".join(f"{a},{b}" for a, b in at_pixels)
                parts.append(f'<polyline points="{path}" fill="none" stroke="{color}" stroke-width="2"/>')
                parts += [f'<circle cx="{a}" cy="{b}" r="2.5" fill="{color}"/>' for a, b in at_pixels]
            if len(line) > 1:
                a, b = at_pixels[-1]
                labels.append((b + 4, a + 6, f"{exponent(line):.2f}", color))
        free = -math.inf
        # None on another.
        for b, a, words, color in sorted(labels):
            free = max(free + 12, b)
            parts.append(text(a, round(free, 1), words, "start", f' fill="{color}"'))
    for number, (kernel, color) in enumerate(COLORS.items()):
        x0 = left + 110 * number
        parts.append(f'<path d="M{x0} 14h22" stroke="{color}" stroke-width="2"/>')
        parts.append(text(x0 + 28, 18, kernel, "start"))
    return "\n".join([*parts, "</svg>", ""])


def exponents(rows):
    """A table: kernels down, what varies across."""
    lines = ["| | " + " | ".join(title for title, _ in PANELS.values()) + " |", "|---" * (len(PANELS) + 1) + "|"]
    for kernel in COLORS:
        of = [points(rows, panel, kernel) for panel in PANELS]
        lines.append(f"| {kernel} | " + " | ".join(f"{exponent(p):.2f}" if len(p) > 1 else "" for p in of) + " |")
    return "\n".join(lines)


def main():
    usage = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    usage.add_argument("--rounds", type=int, default=3)
    usage.add_argument("--largest", type=int, default=VOXELS[-1], help="most voxels a side: 1024 take 14 GB of memory")
    usage.add_argument("--picture", default=at("cost.svg"))
    usage.add_argument("--redraw", action="store_true")
    given = usage.parse_args()
    table = at("cost.csv")
    if not given.redraw:
        os.makedirs(OUT, exist_ok=True)
        rows = list(measure(given.rounds, given.largest))
        with open(table, "w", newline="") as file:
            writer = csv.DictWriter(file, list(rows[0]))
            writer.writeheader()
            writer.writerows(rows)
    with open(table, newline="") as file:
        rows = [{**row, "at": int(row["at"]), "ms": float(row["ms"])} for row in csv.DictReader(file)]
    with open(given.picture, "w") as file:
        file.write(drawing(rows))
    print(exponents(rows))
    print(given.picture)


if __name__ == "__main__":
    main()
