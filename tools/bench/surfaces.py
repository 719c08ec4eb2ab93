#!/usr/bin/env python3
"""Meniscus and splashsurf on the same particle files: time, memory and the quality of the surface, in one run.

    tools/bench/surfaces.py --scenes splash-10k,sheet1,droplet --repeats 1                a try, under a minute
    tools/bench/surfaces.py --json surfaces.json > surfaces.md                            everything
    tools/bench/surfaces.py --scenes splash-1M --rows plain --rows isotropic --repeats 5  one pair

Needs a release binary, Python with pip, a Rust tool chain and a network for the first run (cargo builds splashsurf from
crates.io, pip fills a virtual environment), and a machine that does nothing else.

*Scenes* are made by surface_scenes.py from fixed seeds: raw single-precision `.xyz`, the same file for every program.
`sequence` is ten frames of `splash-100k`.

*The peer at its best*: splashsurf built with link-time optimisation, one codegen unit, opt-level 3 and every instruction
of this processor (its own repository does the same), with its subdomain grid and its SIMD, writing binary PLY. Meniscus is
the ordinary release binary, which picks its instructions when it runs. `plain` is splashsurf without post-processing,
which writes no normals; `recommended` is what its README recommends for smooth surfaces: clean-up, feature weights, 25
smoothing iterations, normals with 10 smoothing iterations, threshold 0.6. Meniscus always writes normals, and checks its
mesh.

*The same work*: particles rest SPACING apart; splashsurf's particle radius is half of it, and its lengths are multiples
of that radius: voxel 0.25 spacings is `-c 0.5`, and `-l 2` is a smoothing length of one spacing whose kernel ends at
twice that, the 2 spacings of Meniscus' kernel_radius. The judge measures the grid that each program's vertices lie on.
Both normalise by the density at each particle, so the mass cancels. The level at which the surface lies is each
program's own: 0.6 as recommended there, here the level half a spacing beyond a filled half-space (0.586).

*Cost*: wall and CPU seconds (user and system) and peak memory of the whole process, from file to file. Rows take turns,
and every figure is the median over the repeats; the spread of wall is next to it.
"""

import argparse
import hashlib
import json
import os
import pathlib
import platform
import shutil
import statistics
import subprocess
import sys
import tempfile

from shot import ROOT, run

HERE = pathlib.Path(__file__).resolve().parent
PACKAGES = ["numpy", "scipy"]
SPLASHSURF = "0.14.1"
SPACING = 0.05  # m, of every scene

SMOOTH = ["--mesh-cleanup=on", "--mesh-smoothing-weights=on", "--mesh-smoothing-iters=25", "--normals=on",
          "--normals-smoothing-iters=10"]  # fmt: skip
# Rows: name, keys of the surface.
MENISCUS = [
    ("Meniscus, isotropic", {}),
    ("Meniscus, anisotropic", {"surface.anisotropy": "{}"}),
    ("Meniscus, anisotropic, smoothed", {"surface.anisotropy": "{}", "surface.smoothing": "{}"}),
]
# Rows: name, further flags.
PEERS = [("splashsurf, plain", []), ("splashsurf, recommended", SMOOTH)]
# Of a sequence the peer can also work on several files at once.
FILES = ("splashsurf, plain, file by file", ["--mt-files=on", "--mt-particles=off"])

SPLASHES = ["splash-100k", "splash-1M", "splash-4M"]
SHAPES = ["ball", "sheet1", "sheet2", "filament", "droplet", "drop"]
SCENES = [*SPLASHES, "spray", "sequence", *SHAPES]
SEQUENCE = 10  # frames


def environment(folder, packages=PACKAGES, modules="numpy, scipy"):
    """The Python of the virtual environment, with `packages` in it; they are installed if importing their `modules` fails."""
    python = folder / "bin/python"
    if not python.exists():
        subprocess.run([sys.executable, "-m", "venv", folder], check=True)
    if subprocess.run([python, "-c", f"import {modules}"], stderr=subprocess.DEVNULL).returncode != 0:
        pip = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
        subprocess.run([*pip, *packages], check=True)
    return python


def splashsurf(folder):
    """The peer's binary, built for this machine if it is not there."""
    binary = folder / "bin/splashsurf"
    if not binary.exists():
        best = {"RUSTFLAGS": "-C target-cpu=native", "CARGO_PROFILE_RELEASE_LTO": "fat",
                "CARGO_PROFILE_RELEASE_CODEGEN_UNITS": "1", "CARGO_PROFILE_RELEASE_OPT_LEVEL": "3"}  # fmt: skip
        command = ["cargo", "install", "splashsurf", "--version", SPLASHSURF, "--locked", "--root", folder]
        subprocess.run(command, env=os.environ | best, check=True, stdout=sys.stderr)
    return binary


WRITE = """import json, sys, surface_scenes
print(json.dumps([surface_scenes.write(*job) for job in json.load(sys.stdin)]))"""


def scene(name, options, folder):
    """Makes the files of a scene; returns its known figures."""
    if name == "sequence":
        of = "splash-10k" if options.small else "splash-100k"
        jobs = [(of, str(folder / f"frame_{k + 1:04}.xyz"), float(k)) for k in range(SEQUENCE)]
    else:
        jobs = [(name, str(folder / "particles.xyz"), 0.0)]
    done = subprocess.run([options.python, "-c", WRITE], input=json.dumps(jobs).encode(), cwd=HERE, check=True,
                          stdout=subprocess.PIPE)  # fmt: skip
    return json.loads(done.stdout)


def command(row, threads, name, options, folder, out):
    """What to run for a row; its meshes go to the folder `out`."""
    _, settings = row
    sequence = name == "sequence"
    if isinstance(settings, dict):
        files = sorted(folder.glob("*.xyz")) if sequence else [folder / "particles.xyz"]
        plain = {"surface.anisotropy": "none", "surface.smoothing": "none"}
        keys = {"surface.voxel": options.voxel, "surface.kernel_radius": options.kernel} | plain | settings
        words = [word for key, value in keys.items() for word in ("--set", f"{key}={value}")]
        return [options.binary, "mesh", *files, "--spacing", SPACING, *words, "-o", out, "--threads", threads,
                "--progress", "none"]  # fmt: skip
    # Its unit is the particle radius, and its kernel ends at twice its smoothing length.
    units = [f"-r={SPACING / 2}", f"-c={2 * options.voxel}", f"-l={options.kernel}", f"-t={options.threshold}"]
    files = [folder / "frame_{}.xyz" if sequence else folder / "particles.xyz"]
    output = ["-o", "frame_{}.ply" if sequence else "particles.ply", "--output-dir", out]
    return [options.peer, "reconstruct", "-q", *files, *output, *units, *settings, "-n", threads]


def meshes(out):
    return sorted(out.rglob("*.ply"))


def digest(out):
    """Names one set of meshes by its bytes."""
    total = hashlib.sha256()
    for path in meshes(out):
        total.update(path.read_bytes())
    return total.hexdigest()


def measure(name, rows, options):
    """The figures of every row and number of threads on one scene."""
    with tempfile.TemporaryDirectory(prefix="surfaces-", dir=options.scratch) as folder:
        folder = pathlib.Path(folder)
        known = scene(name, options, folder)
        runs = [{"row": row[0], "scene": name, "threads": threads, "known": known[0], "runs": [], "bytes": set()}
                for threads in options.threads for row in rows]  # fmt: skip
        # Of shapes the quality alone is shown.
        for repeat in range(1 if name in SHAPES else options.repeats):
            for result, row in zip(runs, rows * len(options.threads)):
                if "failed" in result:
                    continue
                print(f"{name}, {result['threads']} threads, {row[0]}: {repeat + 1}", file=sys.stderr, flush=True)
                out = folder / "out"
                shutil.rmtree(out, ignore_errors=True)
                out.mkdir()
                try:
                    figures = run(command(row, result["threads"], name, options, folder, out))
                    if len(meshes(out)) != len(known):
                        sys.exit(f"{row[0]} wrote {len(meshes(out))} meshes for {len(known)} files")
                    result["runs"].append(figures)
                    result["bytes"].add(digest(out))
                    if repeat == 0 and result["threads"] == options.threads[-1]:
                        result["quality"] = judge(meshes(out), known, options, folder)
                except (SystemExit, subprocess.CalledProcessError) as failure:
                    print(failure, file=sys.stderr)
                    result["failed"] = str(failure)
        for result in runs:
            digests = result.pop("bytes")
            if "failed" in result:
                continue
            result["digests"] = sorted(digests)
            for place, key in enumerate(["wall", "cpu", "memory"]):
                result[key] = statistics.median(figures[place] for figures in result["runs"])
            result["spread"] = [min(f[0] for f in result["runs"]), max(f[0] for f in result["runs"])]
    return runs


def judge(paths, known, options, folder):
    """The figures of surface_judge.py; of a sequence those of its last frame."""
    job = folder / "judge.json"
    job.write_text(json.dumps({"meshes": [[str(paths[-1]), known[-1]]]}))
    done = subprocess.run([options.python, HERE / "surface_judge.py", job], check=True, stdout=subprocess.PIPE)
    return json.loads(done.stdout)[0]


def thousands(value):
    return f"{value:,}".replace(",", " ")


def percent(value):
    return f"{100 * value:.2f} %"


def cost(name, results):
    """Wall, CPU and memory, and how many times the first row's they are on as many threads."""
    known = results[0]["known"]
    title = f"{name}: {thousands(known['particles'])} particles"
    title += f" a frame, {SEQUENCE} frames" if name == "sequence" else ""
    if "outermost" in known:
        title += f", {percent(known['outermost'])} in the outermost layer"
        title += f", {percent(known['within_kernel'])} within a kernel of an empty site"
    lines = ["", f"**{title}**", ""]
    lines.append("| row | threads | wall s (from–to) | × | CPU s | × | peak MiB | × | speed-up by threads | same bytes |")
    lines.append("|---|---|---|---|---|---|---|---|---|---|")
    for result in results:
        if "failed" in result:
            lines.append(f"| {result['row']} | {result['threads']} | failed | | | | | | | |")
            continue
        cells = [result["row"], str(result["threads"])]
        first = next(other for other in results if other["threads"] == result["threads"])
        for key, form in [("wall", spread), ("cpu", lambda r: f"{r['cpu']:.2f}"), ("memory", mebibytes)]:
            cells += [form(result), "–" if "failed" in first else f"{result[key] / first[key]:.2f}"]
        single = [r for r in results if r["row"] == result["row"] and r["threads"] == 1 and "failed" not in r]
        cells.append(f"{single[0]['wall'] / result['wall']:.2f}" if single and result["threads"] > 1 else "")
        same = [r for r in results if r["row"] == result["row"] and "failed" not in r]
        digests = {d for r in same for d in r["digests"]}
        alike = "yes" if len(digests) == 1 else f"no, {len(digests)} sorts"
        cells.append(alike if sum(len(r["runs"]) for r in same) > 1 else "–")
        lines.append("| " + " | ".join(cells) + " |")
    return lines


def spread(result):
    return f"{result['wall']:.3f} ({result['spread'][0]:.3f}–{result['spread'][1]:.3f})"


def mebibytes(result):
    return f"{result['memory'] / 2**20:.0f}"


# Column: title, key, form. A column without a figure in any row is left out.
SOUND = [
    ("triangles", "triangles", thousands),
    ("grid m", "grid", "{:.6f}".format),
    ("open, crowded, turned edges, pinched", None, None),
    ("degenerate", "degenerate", thousands),
    ("slivers", "slivers", thousands),
    ("components", "components", thousands),
    ("handles", "handles", thousands),
    ("volume m³", "volume", "{:.5g}".format),
    ("area m²", "area", "{:.5g}".format),
    ("volume error", "volume_error", percent),
]
SHAPE = [
    ("volume error", "volume_error", percent),
    ("roughness, radii", "roughness", "{:.3f}".format),
    ("normals in the file", "file_normals", "{:.2f}°".format),
    ("not of unit length", "normals_off_unit", thousands),
    ("normals of faces", "face_normals", "{:.2f}°".format),
    ("Hausdorff from mesh, spacings", "from_mesh", "{:.3f}".format),
    ("to mesh", "to_mesh", "{:.3f}".format),
    ("thickness, spacings", "thickness", "{:.3f}".format),
    ("thinnest", "thinnest", "{:.3f}".format),
    ("thickest", "thickest", "{:.3f}".format),
    ("roughness of the top, radii", "sheet_roughness", "{:.3f}".format),
    ("not round", "round", "{:.3f}".format),
]


def quality(results, columns, title):
    """A table of the judge's figures, a row for each result."""
    judged = [result for result in results if "quality" in result]
    columns = [c for c in columns if c[1] is None or any(r["quality"].get(c[1]) is not None for r in judged)]
    if not judged or not columns:
        return []
    lines = ["", title, "", "| row | " + " | ".join(c[0] for c in columns) + " |", "|---|" + "---|" * len(columns)]
    for result in judged:
        cells = []
        for _, key, form in columns:
            found = result["quality"]
            if key is None:
                cells.append(", ".join(str(found[k]) for k in ("open", "crowded", "turned", "pinched")))
            else:
                cells.append("–" if found.get(key) is None else form(found[key]))
        lines.append(f"| {result['row']} | " + " | ".join(cells) + " |")
    return lines


def against(results):
    """Every Meniscus row against every row of the peer."""
    own = {row[0] for row in MENISCUS}
    lines = ["", "**Against each other** (above 1: Meniscus is faster, or takes less)", ""]
    lines.append("| scene | row | peer | threads | wall | CPU | memory | Meniscus' share of its memory |")
    lines.append("|---|---|---|---|---|---|---|---|")
    fine = [result for result in results if "failed" not in result]
    found = False
    for ours in fine:
        for other in fine:
            alike = ours["scene"] == other["scene"] and ours["threads"] == other["threads"]
            if alike and ours["row"] in own and other["row"] not in own:
                ratios = " | ".join(f"×{other[key] / ours[key]:.2f}" for key in ("wall", "cpu", "memory"))
                share = f"{100 * ours['memory'] / other['memory']:.0f} %"
                names = f"{ours['scene']} | {ours['row']} | {other['row']} | {ours['threads']}"
                lines.append(f"| {names} | {ratios} | {share} |")
                found = True
    return lines if found else []


def report(results, options):
    machine = f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores"
    given = f"voxel {options.voxel} and kernel {options.kernel} spacings"
    given += f"; splashsurf {SPLASHSURF}, threshold {options.threshold}"
    load = ", ".join(f"{value:.1f}" for value in options.load)
    lines = [f"{machine}; {given}; {options.repeats} repeats; load at the start {load}"]
    timed = []
    for name in options.scenes:
        chosen = [result for result in results if result["scene"] == name]
        if name in SHAPES:
            continue
        lines += cost(name, chosen)
        lines += quality(chosen, SOUND, "The mesh" + (" of the last frame:" if name == "sequence" else ":"))
        timed += chosen
    lines += against(timed)
    for name in options.scenes:
        chosen = [result for result in results if result["scene"] == name]
        if name in SHAPES:
            count = thousands(chosen[0]["known"]["particles"])
            lines += quality(chosen, SOUND[:7], f"**{name}**, {count} particles")
            lines += quality(chosen, SHAPE, f"{name}: how close")
    return "\n".join(lines)


def row(text):
    """A Meniscus row from `NAME: KEY=VALUE, KEY=VALUE`."""
    name, _, keys = text.partition(":")
    pairs = [pair.strip().partition("=") for pair in keys.split(",") if pair.strip()]
    return f"Meniscus, {name.strip()}", {key: value for key, _, value in pairs}


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", default=",".join(SCENES), help="with commas; also splash-10k, small-ball (all)")
    parser.add_argument("--threads", default="1,2", help="numbers of threads, with commas (1,2)")
    parser.add_argument("--repeats", type=int, default=5, help="of every row (5)")
    parser.add_argument("--rows", action="append", metavar="TEXT", help="only rows whose name contains it; may be repeated")
    parser.add_argument("--add", action="append", default=[], metavar="NAME:KEY=VALUE,…", help="a further Meniscus row")
    parser.add_argument("--voxel", type=float, default=0.25, help="spacings (0.25)")
    parser.add_argument("--kernel", type=float, default=2.0, help="where the kernel ends, spacings (2)")
    parser.add_argument("--threshold", type=float, default=0.6, help="the peer's (0.6, as it recommends)")
    parser.add_argument("--small", action="store_true", help="make the sequence of splash-10k")
    parser.add_argument("--venv", type=pathlib.Path, default=ROOT / "target/surface-venv", help="made and filled if missing")
    parser.add_argument("--peers", type=pathlib.Path, default=ROOT / "target/peers", help="where the peer is built if missing")
    parser.add_argument("--binary", type=pathlib.Path, default=ROOT / "target/release/meniscus")
    parser.add_argument("--scratch", type=pathlib.Path, help="where particles and meshes go")
    parser.add_argument("--json", type=pathlib.Path, help="write all figures there, after every scene")
    options = parser.parse_args()
    options.scenes = options.scenes.split(",")
    options.threads = [int(n) for n in options.threads.split(",")]
    MENISCUS.extend(row(text) for text in options.add)
    unknown = set(options.scenes) - {*SCENES, "splash-10k", "small-ball"}
    if unknown:
        parser.error(f"no scene {', '.join(sorted(unknown))}")
    if not options.binary.exists():
        parser.error(f"{options.binary} is not there: cargo build --release")
    return options


def main():
    options = arguments()
    options.load = os.getloadavg()
    options.python = environment(options.venv.resolve())
    options.peer = splashsurf(options.peers.resolve())
    results = []
    for name in options.scenes:
        every = [*MENISCUS, *PEERS, *([FILES] if name == "sequence" else [])]
        results += measure(name, [r for r in every if any(text in r[0] for text in options.rows or [""])], options)
        if options.json:
            options.json.write_text(json.dumps({"results": results}, indent=1))
    print(report(results, options))
    failed = [result for result in results if "failed" in result]
    for result in failed:
        print(f"\nFailed: {result['scene']}, {result['row']}, {result['threads']} threads: {result['failed']}")
    if failed:
        sys.exit(1)


if __name__ == "__main__":
    main()
