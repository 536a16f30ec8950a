"""Measures Lamina beside VTK's ray caster and beside itself, on the scene of peers.toml; tests/bench/run sets it up.
Usage: compare.py [--rounds 7] [--large-rounds 3] [--threads 2]

A round is one frame of VTK and one `lamina-lab bench` of each field, in turn, so that what else the machine does meets all;
before each counted measurement Lamina runs it once to warm up, and VTK drew frames at the start. Times are medians
over rounds; a ratio is the median of the rounds' own ratios, of wall and of processor time (all threads), and what is
wanted must hold for both: on a busy machine wall times say more of others than of the program. VTK's time
is its rays' casting alone, without the window. Fields: 256^3; the same with noise of 0.03; and 512^3 with that noise.

Memory is that of processes of their own (`lamina-lab bench --memory`): the most in use at once while a VDI is generated,
or read, decoded, prepared and drawn, less what such a process has in use after doing all that with 8 voxels and one ray
(code, threads, tables). Reading a volume's file takes more for a moment; that is not counted.

PSNR is that of pictures from the front against refcast.py, RGB, 768 x 768."""
import argparse, csv, json, os, statistics, subprocess, sys
import psnr, scene

HERE = os.path.dirname(os.path.abspath(__file__))
OUT = os.path.normpath(os.path.join(HERE, "../../out/bench"))
LAMINA = os.environ.get("LAMINA", os.path.normpath(os.path.join(HERE, "../../target/release/lamina")))
SCENE = ["--scene", os.path.join(HERE, "peers.toml"), "--backend", "cpu"]
FIELDS = {"plain": "vol256.raw", "noisy": "noisy256.raw", "large": "noisy512.raw"}
GAMMAS = "generate 256, 65 gammas"


def at(name):
    return os.path.join(OUT, name)


def lamina(*arguments, program=LAMINA):
    done = subprocess.run([program, *map(str, arguments)], stdout=subprocess.PIPE, text=True, check=True)
    return done.stdout


def bench(path, *options):
    """What `lamina-lab bench` says of a file: by name, one object each."""
    lines = map(json.loads, lamina("bench", path, "--json", *options, program=f"{LAMINA}-lab").splitlines())
    return {line["name"]: line for line in lines}


class Vtk:
    """vtk_frame.py, waiting for the next round."""

    def __init__(self, threads):
        command = [sys.executable, os.path.join(HERE, "vtk_frame.py"), at(FIELDS["plain"]), "--serve",
                   "--threads", str(threads)]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.version = self.answer()["ready"]

    def answer(self):
        line = self.process.stdout.readline()
        if not line:
            raise SystemExit("vtk_frame.py ended")
        return json.loads(line)

    def ask(self, text):
        print(text, file=self.process.stdin, flush=True)
        return self.answer()

    def quit(self):
        print("quit", file=self.process.stdin, flush=True)
        self.process.wait(60)


def measure(given, vtk):
    """Rounds of {name of a field, or vtk: {measurement: {wall_ms, cpu_ms}}}."""
    rounds = []
    for n in range(given.rounds):
        frame = vtk.ask("frame")
        # The processor time is of the whole frame, which is the casting but for a few milliseconds.
        rounds.append({"vtk": {"raycast 768": {"wall_ms": frame["cast_ms"], "cpu_ms": frame["cpu_ms"]}}})
        for field, name in FIELDS.items():
            if field == "plain" or n < given.large_rounds:
                more = ["--size", "768,512", "--gammas"] if field == "plain" else ["--size", "768"]
                rounds[-1][field] = bench(at(name + ".nhdr"), *SCENE, "--rounds", 1, *more)
        print(f"round {n + 1} of {given.rounds}", file=sys.stderr, flush=True)
    return rounds


def compared(rounds, figure, wanted, ours, theirs):
    """A row of the table: (field, measurement) beside another."""
    (our_field, our_name), (their_field, their_name) = ours, theirs
    pairs = [(r[our_field].get(our_name), r[their_field].get(their_name)) for r in rounds
             if our_field in r and their_field in r]
    pairs = [(a, b) for a, b in pairs if a and b]
    if not pairs:
        return {"figure": figure, "wanted": wanted}
    return {
        "figure": figure,
        "ours": f"{statistics.median(a['wall_ms'] for a, _ in pairs):.1f} ms",
        "theirs": f"{statistics.median(b['wall_ms'] for _, b in pairs):.1f} ms",
        "ratio": statistics.median(a["wall_ms"] / b["wall_ms"] for a, b in pairs),
        "cpu_ratio": statistics.median(a["cpu_ms"] / b["cpu_ms"] for a, b in pairs),
        "wanted": wanted,
    }


def times(rounds):
    def row(figure, wanted, ours, theirs):
        return compared(rounds, figure, wanted, ours, theirs)

    side = ("plain", "raycast 768 from aside")
    novel = "render 256 at 768"
    yield row("ray cast 768, 256^3 : VTK", None, ("plain", "raycast 768"), ("vtk", "raycast 768"))
    whole = ("plain", "raycast 768 to the end")
    yield row("generate r 768 : all rays cast to their end", 1.2, ("plain", "generate 768"), whole)
    yield row("65 gammas, r 256 : one generate", 4.0, ("plain", GAMMAS), ("plain", "generate 256"))
    yield row("novel view, r 256, 768 px : ray cast, 256^3", 0.5, ("plain", novel), side)
    aside = "raycast 768 from aside"
    still = "blend 256 at 768"
    yield row("the same, rays blended", None, ("plain", still), side)
    yield row("novel view, 256^3 with noise", None, ("noisy", novel), ("noisy", aside))
    yield row("the same, 512^3 with noise", 0.15, ("large", novel), ("large", aside))
    yield row("the same, rays blended", None, ("large", still), ("large", aside))
    yield row("novel view, 512^3 : 256^3, both with noise", None, ("large", novel), ("noisy", novel))
    yield row("ray cast, 512^3 : 256^3, both with noise", None, ("large", aside), ("noisy", aside))
    views = [r["plain"]["render 256 at 512"]["wall_ms"] for r in rounds]
    yield {"figure": "novel views a second, r 256, 512 px", "ours": f"{1e3 / statistics.median(views):.1f}"}


def quality(vtk):
    reference, ours, theirs = at("reference_00.npy"), at("lamina_00.pfm"), at("vtk_00.npy")
    if not os.path.exists(reference):
        subprocess.run([sys.executable, os.path.join(HERE, "refcast.py"), at(FIELDS["plain"]), reference,
                        "--angles", "0"], check=True, stdout=subprocess.DEVNULL)
    lamina("raycast", at(FIELDS["plain"] + ".nhdr"), *SCENE, "--size", scene.SIZE, "--out", ours)
    vtk.ask(f"save {theirs}")
    exact = psnr.read(reference)
    ours, theirs = (f"{psnr.psnr(psnr.read(p), exact):.1f} dB" for p in (ours, theirs))
    yield {"figure": "ray cast 768, against refcast.py : VTK", "ours": ours, "theirs": theirs}


def memory(field):
    """A VDI's generation may take the volume and 1.5 VDIs; drawing it from its file 4."""
    path, vdi = at(FIELDS[field] + ".nhdr"), at(f"{field}.vdi")
    for r in (256, 768):
        (made,) = bench(path, *SCENE, "--memory", "--resolution", r).values()
        beside = made["peak_bytes"] - made["volume_bytes"]
        yield part(f"memory of generate r {r} beside the volume : VDI, {field}", beside, made["vdi_bytes"], 1.5)
        lamina("generate", path, *SCENE, "--resolution", r, "--gamma", 0.02, "--codec", "zstd", "--out", vdi)
        (drawn,) = bench(vdi, "--memory").values()
        grown = made["peak_bytes"] - made["before_bytes"]
        figure = f"memory of generate r {r} beside all kept before : VDI, {field}"
        yield part(figure, grown, made["vdi_bytes"], None)
        figure = f"memory of decode and render r {r} : VDI, {field}"
        yield part(figure, drawn["peak_bytes"], drawn["vdi_bytes"], 4.0)


def part(figure, ours, theirs, wanted):
    ours_mb, theirs_mb = f"{ours / 1e6:.1f} MB", f"{theirs / 1e6:.1f} MB"
    return {"figure": figure, "ours": ours_mb, "theirs": theirs_mb, "ratio": ours / theirs, "wanted": wanted}


COLUMNS = ["figure", "ours", "theirs", "ratio", "cpu_ratio", "wanted", "met"]


def finished(row):
    """The row as text, and whether it is as wanted."""
    ratio, wanted = row.get("ratio"), row.get("wanted")
    text = {key: row.get(key) or "-" for key in ("figure", "ours", "theirs")}
    for key in ("ratio", "cpu_ratio"):
        text[key] = "-" if row.get(key) is None else f"{row[key]:.2f}"
    text["wanted"] = "-" if wanted is None else f"<= {wanted:g}"
    worse = None if ratio is None else max(ratio, row.get("cpu_ratio") or ratio)
    text["met"] = "-" if wanted is None else "not measured" if worse is None else "yes" if worse <= wanted else "NO"
    return text


def main():
    usage = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    usage.add_argument("--rounds", type=int, default=7)
    usage.add_argument("--large-rounds", type=int, default=3, help="rounds with the two noisy fields")
    usage.add_argument("--threads", type=int, default=len(os.sched_getaffinity(0)), help="of both")
    given = usage.parse_args()
    os.environ["RAYON_NUM_THREADS"] = str(given.threads)
    vtk = Vtk(given.threads)
    print(f"{vtk.version}, {given.threads} threads, {given.rounds} rounds")
    rows = list(times(measure(given, vtk)))
    rows += quality(vtk)
    vtk.quit()
    rows += memory("plain")
    rows += memory("noisy")
    rows = [finished(row) for row in rows]
    widths = {c: max(len(c), *(len(row[c]) for row in rows)) for c in COLUMNS}
    for row in [{c: c for c in COLUMNS}, *rows]:
        print("  ".join(row[c].ljust(widths[c]) if c == "figure" else row[c].rjust(widths[c]) for c in COLUMNS))
    with open(at("results.csv"), "w", newline="") as file:
        table = csv.DictWriter(file, COLUMNS)
        table.writeheader()
        table.writerows(rows)


if __name__ == "__main__":
    main()
