#!/usr/bin/env python3
"""Meniscus and pysplishsplash on the same dam breaks and the same resting columns, in one table.

    tools/bench/liquids.py --scene small --seconds 0.25 --rest-seconds 1      a try, under a minute
    tools/bench/liquids.py --scene 100k --json 100k.json                      the full comparison

Needs a release binary, Python 3.11, a network for the first run (pip fills a virtual environment, see --venv), and a
machine that does nothing else. Every run is a process of its own, on 1 and on 2 threads by default, in turn.

*Scenes*: a block of water of 0.8 × 1 × 1 m at one end of a tank of 3.2 × 1 × 2 m (x, y, z; z is up), and a column of
0.5 × 0.5 × 1 m that fills its tank's floor and should stay where it is (small: half a metre deep). Spacings divide the
metre, so both programs start from the same seeding lattice with the same number of particles: `small` 1/18 m, 4 536 particles;
`100k` 1/49 m, 93 639; `1M` 1/108 m, 1 003 104. The columns have the scene's spacing, that of `1M` the spacing of `100k`.

*Settings*: no artificial pressure; XSPH viscosity with c = --xsph (0.01) in both, applied once a step in both, and with its
default `rest` in Meniscus; no vorticity confinement and no surface tension, except in the row "presets", which has both as the
built-in presets do. Rows "surface tension" and "viscosity" have that term in both programs: half of density × gravity ×
spacing², and 10 Pa·s; in the peer the methods of Akinci et al. 2013 with its default coefficient and of Weiler et al. 2018
with 0.01 m²/s, on the walls too. Steps follow the programs' own rules: no particle moves farther than 0.8 spacings in Meniscus and 0.4
in the peer, and a step is at most 5.2 ms in Meniscus (8 substeps a frame at 24 fps), and 0.1 s/m · spacing but no more than
5 ms in the peer, whose deep columns burst with longer ones. Everything else as the programs have it by default; the
rows are `MENISCUS` and `PEERS` below.

*Energy* is the mechanical energy against that of the block at rest: what is lost at the end, the maximum lost between two
judged frames, and the maximum gained. It does not contain surface energy, which the row "presets" has.

*Quality* is judged for both programs by liquid_judge.py alone, from positions and velocities, and is never one
average: rows compare only where mean compression, two-sided deviation, the mean over the frames of the largest
compression, and the column's compression, height, volume and leftover speed are alike together. The errors that the
programs report themselves are shown next to it.

*Cost*: wall and CPU seconds a simulated second. Meniscus: wall is the sum of the passes in its log, without start-up and
files; CPU is the process's user and system time, less that of a run of the first frame alone, so packing and writing
the other frames is in it. Peer: both are those of the steps, without start-up, the first step and files
(liquid_peer.py). Memory: the peak of the process; for the peer that of the steps alone where the system reports it, and
"bytes a particle" excludes the memory of Python and its modules before the scene.
"""

import argparse
import json
import math
import os
import pathlib
import platform
import statistics
import subprocess
import sys
import tempfile

from shot import ROOT, run

HERE = pathlib.Path(__file__).resolve().parent
PACKAGES = ["pysplishsplash==2.19.0", "numpy", "scipy", "zstandard"]

# [m/s²], along −z; liquid_judge.py has it too, which runs in another Python.
GRAVITY = 9.81
# Rows: name, keys of the preset.
MENISCUS = [
    ("Meniscus, 1 %", {"liquid.density_dev": "1 %"}),
    ("Meniscus, 0.1 %", {"liquid.density_dev": "0.1 %"}),
    ("Meniscus, 0.1 %, presets", {
        "liquid.density_dev": "0.1 %",
        "liquid.implicitness": "0.25",
        "liquid.vorticity.strength": "0.5",
        "liquid.surface_tension.coefficient": "{tension:.3g}",
    }),
    ("Meniscus, 0.1 %, surface tension", {
        "liquid.density_dev": "0.1 %",
        "liquid.implicitness": "0.25",
        "liquid.surface_tension.coefficient": "{tension:.3g}",
    }),
    ("Meniscus, 0.1 %, viscosity", {"liquid.density_dev": "0.1 %", "liquid.viscosity.dynamic": "10"}),
]  # fmt: skip
# Surface tension of the built-in presets, over the squared spacing [N/m³]: half of density × gravity.
TENSION = 0.5 * 1000 * GRAVITY
# Rows: name, method, tolerance in per cent of the rest density, term of liquid_peer.py.
PEERS = [
    ("SPlisHSPlasH DFSPH, 1 %", "DFSPH", 1.0, None),
    ("SPlisHSPlasH DFSPH, 0.1 %", "DFSPH", 0.1, None),
    ("SPlisHSPlasH DFSPH, 0.1 %, surface tension", "DFSPH", 0.1, "surface tension"),
    ("SPlisHSPlasH DFSPH, 0.1 %, viscosity", "DFSPH", 0.1, "viscosity"),
    ("SPlisHSPlasH PBF, 1 %", "PBF", 1.0, None),
    ("SPlisHSPlasH PBF, 0.1 %", "PBF", 0.1, None),
]
# Not measured here: another method, with grids and markers, and no density constraint.
QUOTED = "Quoted, not measured: Blender's Mantaflow (FLIP) bakes 24 frames at a 100k fill in 5.8 s and at a 1M fill in 140 s."

# Name: particles a metre, particles of the block along x, particles a metre of its resting column.
SCENES = {"small": (18, 14, 18), "100k": (49, 39, 49), "1M": (108, 86, 49)}
TANK = [3.2, 1.0, 2.0]
# Which frames are judged: of a million particles one takes ten seconds and 1.3 GiB.
JUDGED = {"small": 1, "100k": 1, "1M": 2}
# Radii that the peer's walls lie outside of the tank, by how it models them; liquid_peer.py gives the reason.
WALLS = {"particles": 1.5, "volume-map": 2.5}


def dam(name):
    """The dam break of a scene: spacing [m], tank [m], particles along each axis."""
    metre, along, _ = SCENES[name]
    return {"spacing": 1 / metre, "tank": TANK, "counts": [along, metre, metre]}


def column(name):
    """The resting column of a scene; its tank is as wide as its particles and twice as high."""
    metre = SCENES[name][2]
    width, depth = round(metre / 2), metre // 2 if name == "small" else metre
    return {
        "spacing": 1 / metre,
        "tank": [width / metre, width / metre, 2 * depth / metre],
        "counts": [width, width, depth],
    }


def environment(folder):
    """The Python of the virtual environment, with all that is needed in it and the peer importable."""
    python = folder / "bin/python"
    if not python.exists():
        subprocess.run([sys.executable, "-m", "venv", folder], check=True)
    install = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *PACKAGES]
    if not all(
        list(folder.glob(f"lib/python*/site-packages/{name}-*.dist-info")) for name in map(distribution, PACKAGES)
    ):
        subprocess.run(install, check=True)
    if importable(python):
        return python
    # The wheel brings a libGLdispatch of its own, which crashes together with the system's other GL libraries.
    bundled = list(folder.glob("lib/python*/site-packages/pysplishsplash.libs/libGLdispatch-*"))
    systems = [
        path
        for pattern in ("lib/*", "lib64", "lib")
        for path in pathlib.Path("/usr").glob(f"{pattern}/libGLdispatch.so.0")
    ]
    if not systems:
        sys.exit("importing pysplishsplash crashes, and this system has no libGLdispatch.so.0 to put in the place of the\n"
                 "one that it brings: apt-get install libglvnd0 libgl1, then run this again")  # fmt: skip
    for path in bundled:
        path.write_bytes(systems[0].read_bytes())
    print(f"pysplishsplash: {systems[0]} put in the place of the one it brings", file=sys.stderr)
    if not importable(python):
        sys.exit(f"importing pysplishsplash fails even with {systems[0]}: try `{python} -c 'import pysplishsplash'`;\n"
                 "apt-get install libglvnd0 libgl1 may help")  # fmt: skip
    return python


def distribution(package):
    return package.split("==")[0]


def importable(python):
    command = [python, "-c", "import pysplishsplash, os; os._exit(0)"]
    return subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL).returncode == 0


def preset(scene, options):
    """The scene as a preset for Meniscus."""
    block = [count * scene["spacing"] for count in scene["counts"]]
    return "\n".join([
        f'title = "bench"\nframes = "1-2"\nfps = {options.fps}',
        f"[[world.collider]]\nshape = {{ tank = {{ min = [0, 0, 0], max = {json.dumps(scene['tank'])} }} }}",
        f"[liquid]\nspacing = {scene['spacing']!r}",
        *([f"[liquid.xsph]\nstrength = {options.xsph}"] if options.xsph else []),
        f"[[liquid.source]]\nshape = {{ box = {{ min = [0, 0, 0], max = {json.dumps(block)} }} }}",
    ])  # fmt: skip


def meniscus(scene, keys, frames, threads, options, folder):
    """Runs one row; returns its figures, the frames' files and the rest volume of a particle."""
    path = folder / "bench.toml"
    path.write_text(preset(scene, options))
    tension = TENSION * scene["spacing"] ** 2
    words = [word for key, value in keys.items() for word in ("--set", f"{key}={value.format(tension=tension)}")]
    words += [word for given in options.set for word in ("--set", given)]
    command = [options.binary, "simulate", path, "--threads", threads, "--progress", "none", *words]
    _, start_cpu, _ = run([*command, "--frames", "1", "-o", folder / "start"])
    _, cpu, memory = run([*command, "--frames", f"1-{frames + 1}", "-o", folder / "shot"])
    records = [json.loads(line) for line in (folder / "shot/log.jsonl").read_text().splitlines()]
    if len(records) != frames:
        sys.exit(f"the log has {len(records)} frames, expected {frames}")
    particles = records[0]["particles"]
    expect(particles, scene, "Meniscus")
    seconds = {}
    for record in records:
        for name, value in record["seconds"]:
            seconds[name] = seconds.get(name, 0.0) + value
    wall = sum(seconds.values())
    liquid = [record["liquid"] for record in records]
    iterations = sum(r["iterations"] for r in liquid)
    simulated = frames / options.fps
    figures = {
        "particles": particles,
        "wall": wall / simulated,
        "cpu": (cpu - start_cpu) / simulated,
        "steps": sum(r["substeps"] for r in liquid) / simulated,
        "iterations": iterations / simulated,
        "unconverged": sum(r["unconverged"] for r in liquid) / simulated,
        "iteration_ns": 1e9 * seconds["solve"] / (iterations * particles),
        "search_share": seconds["search"] / wall,
        "memory": memory,
        "bytes": memory / particles,
        "own_average": statistics.fmean(r["density_dev_avg"] for r in liquid),
        "own_max": statistics.fmean(r["density_dev_max"] for r in liquid),
        "passes": seconds,
    }
    files = [folder / f"shot/cache/frame_{frame + 1:04}.mcf" for frame in range(1, frames + 1)]
    return figures, files, scene["spacing"] ** 3


def peer(scene, method, tolerance, term, frames, threads, options, folder):
    """The same for a row of the peer."""
    job = folder / "job.json"
    (folder / "frames").mkdir()
    job.write_text(json.dumps({
        **scene,
        "method": method,
        "tolerance": tolerance,
        "term": term,
        "radius": scene["spacing"] / 2,
        "boundary": options.peer_boundary,
        "wall": WALLS[options.peer_boundary],
        "xsph": options.xsph,
        "longest_step": min(0.005, options.peer_step * scene["spacing"]),
        "fps": options.fps,
        "frames": frames,
        "folder": str(folder / "frames"),
        "scenes": str(options.venv / "scenes"),
    }))  # fmt: skip
    threaded = ["env", f"OMP_NUM_THREADS={threads}", "OMP_DYNAMIC=false"]
    _, _, memory = run([*threaded, options.python, HERE / "liquid_peer.py", job])
    result = json.loads((folder / "frames/result.json").read_text())
    expect(result["particles"], scene, "the peer")
    simulated = result["simulated"]
    memory = result["memory"] if result["peak_without_start"] else memory
    figures = {
        "particles": result["particles"],
        "wall": result["wall"] / simulated,
        "cpu": result["cpu"] / simulated,
        "steps": result["steps"] / simulated,
        "iterations": result["iterations"] / simulated,
        "unconverged": result["unconverged"] / simulated,
        "iteration_ns": result["iteration_ns"],
        "search_share": result["search_share"],
        "memory": memory,
        "bytes": (memory - (result["memory_bare"] or 0)) / result["particles"],
        "passes": result["passes"],
    }
    files = [folder / f"frames/frame_{frame:04}.npz" for frame in range(1, frames + 1)]
    return figures, files, result["particle_volume"]


def expect(particles, scene, who):
    nx, ny, nz = scene["counts"]
    if particles != nx * ny * nz:
        sys.exit(f"{who} started with {particles} particles, expected {nx * ny * nz}")


def judge(files, volume, tank, options, folder):
    """The figures of liquid_judge.py, one a file."""
    job = folder / "judge.json"
    job.write_text(json.dumps({"frames": [str(f) for f in files], "spacing": volume ** (1 / 3), "tank": tank}))
    command = [options.python, HERE / "liquid_judge.py", job]
    return json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)


def mean(frames, key):
    """The mean over the frames that have this figure; None if none has (no bulk left, or nothing reported)."""
    values = [frame[key] for frame in frames if key in frame]
    return statistics.fmean(values) if values else None


BULK = ["compression", "two_sided", "signed", "max_bulk"]


# Front in the last frame before the wall at 3.2 m that all rows have [m].
NEAR_WALL = 2.9


def energy_quality(frames, first):
    """Shares of the mechanical energy `first` [m²/s²] that are lost and gained, how far the front has come in the last judged frame
    before the far wall, and how high the liquid splashes there."""
    energies = [first] + [frame["energy"] for frame in frames]
    changes = [(after - before) / first for before, after in zip(energies, energies[1:])]
    return {
        "lost": 1 - energies[-1] / first,
        "most_lost": max(-min(changes), 0.0),
        "most_gained": max(max(changes), 0.0),
        "front": max((frame["front"] for frame in frames if frame["front"] < NEAR_WALL), default=0.0),
        "top": max(frame["top"] for frame in frames),
    }


def dam_quality(frames):
    keys = [prefix + key for prefix in ("", "wide_") for key in [*BULK, "max_all", "bulk_share"]]
    figures = {key: mean(frames, key) for key in [*keys, "own_average", "own_max"]}
    return figures | {"outside": max(frame["outside"] for frame in frames)}


def rest_quality(frames, fps):
    """The state over the last half second, or the last frame of a shorter run."""
    last = frames[-max(round(fps / 2), 1) :]
    keys = [prefix + key for prefix in ("", "wide_") for key in [*BULK, "bulk_share"]]
    figures = {key: mean(last, key) for key in [*keys, "rms_speed"]}
    columns = [frame["column"] for frame in last]
    figures |= {key: statistics.fmean(c[key] for c in columns) for key in columns[0]}
    # How much the surface still moves in that time.
    heights = [c["surface"] for c in columns]
    return figures | {"swing": max(heights) - min(heights)}


def measure(row, scene_name, threads, options):
    """One row on one number of threads: the dam break, and the column where it is requested."""
    name, *settings = row
    kind = meniscus if len(settings) == 1 else peer
    result = {"row": name, "scene": scene_name, "threads": threads}
    for part, scene, seconds in [
        ("dam", dam(scene_name), options.seconds),
        ("rest", column(scene_name), options.rest_seconds if threads == options.threads[-1] else 0),
    ]:
        frames = round(seconds * options.fps)
        if frames == 0:
            continue
        with tempfile.TemporaryDirectory(prefix="liquids-", dir=options.scratch) as folder:
            folder = pathlib.Path(folder)
            print(f"{scene_name}, {threads} threads, {name}: {part}, {frames} frames", file=sys.stderr, flush=True)
            figures, files, volume = kind(scene, *settings, frames, threads, options, folder)
            every = JUDGED[scene_name] if part == "dam" else 1
            chosen = files[every - 1 :: every] or files[-1:]
            if part == "rest":
                chosen = files[-max(round(options.fps / 2), 1) :]
            judged = judge(chosen, volume, scene["tank"], options, folder)
        if part == "dam":
            height = scene["counts"][2] * scene["spacing"]
            quality = dam_quality(judged) | energy_quality(judged, GRAVITY * height / 2)
        else:
            quality = rest_quality(judged, options.fps)
            quality["sag"] = 1 - quality["surface"] / (scene["counts"][2] * scene["spacing"])
        figures |= {key: value for key, value in quality.items() if value is not None}
        result[part] = figures
    return result


def percent(digits):
    return lambda value: f"{100 * value:.{digits}f} %"


# Column: title, part, key, form.
COST = [
    ("wall s/s", "wall", "{:.2f}".format),
    ("CPU s/s", "cpu", "{:.2f}".format),
    ("steps /s", "steps", "{:.0f}".format),
    ("iterations a step", None, "{:.1f}".format),
    ("capped steps /s", "unconverged", "{:.0f}".format),
    ("ns a particle and iteration", "iteration_ns", "{:.0f}".format),
    ("search", "search_share", percent(0)),
    ("peak MiB", "memory", lambda value: f"{value / 2**20:.0f}"),
    ("bytes a particle", "bytes", "{:.0f}".format),
]
DAM = [
    ("mean compression", "compression", percent(3)),
    ("two-sided", "two_sided", percent(3)),
    ("signed", "signed", percent(3)),
    ("largest, bulk", "max_bulk", percent(2)),
    ("largest, all", "max_all", percent(2)),
    ("mean compression, wide", "wide_compression", percent(3)),
    ("two-sided, wide", "wide_two_sided", percent(3)),
    ("largest, wide", "wide_max_bulk", percent(2)),
    ("share judged", "bulk_share", percent(0)),
    ("reported: mean", "own_average", percent(3)),
    ("reported: largest", "own_max", percent(2)),
    ("left the tank", "outside", "{}".format),
    ("energy lost", "lost", percent(1)),
    ("most lost at once", "most_lost", percent(1)),
    ("most gained at once", "most_gained", percent(2)),
    ("farthest m", "front", "{:.3f}".format),
    ("highest m", "top", "{:.3f}".format),
]
REST = [
    ("wall s/s", "wall", "{:.2f}".format),
    ("mean compression", "compression", percent(3)),
    ("two-sided", "two_sided", percent(3)),
    ("signed", "signed", percent(3)),
    ("largest, bulk", "max_bulk", percent(2)),
    ("mean compression, wide", "wide_compression", percent(3)),
    ("two-sided, wide", "wide_two_sided", percent(3)),
    ("largest, wide", "wide_max_bulk", percent(2)),
    ("surface m", "surface", "{:.4f}".format),
    ("its swing mm", "swing", lambda value: f"{1000 * value:.1f}"),
    ("footprint m²", "footprint", "{:.4f}".format),
    ("volume", "volume", percent(1)),
    ("leftover speed m/s", "rms_speed", "{:.4f}".format),
]


def table(title, columns, results, part, ratios=()):
    """A Markdown table; `ratios` names columns that get, in brackets, how many times the first row's they are."""
    rows = [result for result in results if part in result]
    if not rows:
        return []
    lines = ["", f"**{title}**", "", "| row | threads | " + " | ".join(c[0] for c in columns) + " |"]
    lines.append("|---|---|" + "---|" * len(columns))
    for result in rows:
        first = next(other for other in rows if other["threads"] == result["threads"])
        cells = []
        for _, key, form in columns:
            value = figure(result[part], key)
            text = "–" if value is None else form(value)
            if key in ratios and result is not first:
                text += f" (×{value / figure(first[part], key):.2f})"
            cells.append(text)
        lines.append(f"| {result['row']} | {result['threads']} | " + " | ".join(cells) + " |")
    return lines


# Figures that must be alike before two rows compare: title, part, key, and the value of the figure that should be small.
GATE = [
    ("mean compression", "dam", "compression", abs),
    ("two-sided", "dam", "two_sided", abs),
    ("largest", "dam", "max_bulk", abs),
    ("mean compression, wide", "dam", "wide_compression", abs),
    ("two-sided, wide", "dam", "wide_two_sided", abs),
    ("largest, wide", "dam", "wide_max_bulk", abs),
    ("energy lost", "dam", "lost", abs),
    ("energy lost at once", "dam", "most_lost", abs),
    ("energy gained at once", "dam", "most_gained", abs),
    ("mean compression at rest", "rest", "compression", abs),
    ("largest at rest", "rest", "max_bulk", abs),
    ("height at rest", "rest", "sag", abs),
    ("volume at rest", "rest", "volume", lambda volume: abs(volume - 1)),
    ("speed at rest", "rest", "rms_speed", abs),
]
# A figure up to this many times the other's counts as alike.
ALIKE = 1.1
# Differences below this are rounding.
ROUNDING = 1e-5


def gate(results):
    """Every Meniscus row against every row of the peer: cost, and where it is not as good."""
    quality = {}
    for result in results:
        for _, part, key, small in GATE:
            if key in result.get(part, {}):
                # The column runs on one number of threads only and speaks for the row.
                quality[result["row"], result["threads"] if part == "dam" else None, part, key] = small(
                    result[part][key]
                )
    lines = ["", f"**Against each other** (alike: within a factor of {ALIKE})", ""]
    lines += [
        "| row | peer | threads | peer's wall | its CPU | its bytes | not as good in | not judged |",
        "|---|---|---|---|---|---|---|---|",
    ]
    own = {name for name, *_ in MENISCUS}
    pairs = [(a, b) for a in results for b in results if a["row"] in own and b["row"] not in own]
    for ours, other in pairs:
        if ours["threads"] != other["threads"] or "dam" not in ours or "dam" not in other:
            continue
        worse, missing = [], []
        for title, part, key, _ in GATE:
            a, b = (
                quality.get((row["row"], row["threads"] if part == "dam" else None, part, key)) for row in (ours, other)
            )
            if a is None or b is None:
                missing.append(title)
            elif a > ALIKE * b + ROUNDING:
                worse.append(f"{title} (×{a / b:.1f})" if b > 0 else title)
        ratios = " | ".join(f"×{other['dam'][key] / ours['dam'][key]:.2f}" for key in ("wall", "cpu", "bytes"))
        lines.append(
            f"| {ours['row']} | {other['row']} | {ours['threads']} | {ratios} | {', '.join(worse) or 'nothing'} | {', '.join(missing) or 'nothing'} |"
        )
    return lines if pairs else []


def figure(figures, key):
    return figures["iterations"] / figures["steps"] if key is None else figures.get(key)


def report(results, options):
    """All tables of all scenes."""
    machine = f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores"
    given = f"XSPH {options.xsph}; peer's walls: {options.peer_boundary}; set: {', '.join(options.set) or 'nothing'}"
    lines = [f"{machine}; {given}"]
    for name in options.scene:
        chosen = [result for result in results if result["scene"] == name]
        if not chosen:
            continue
        count = f"{math.prod(dam(name)['counts']):,}".replace(",", " ")
        length = f"{round(options.seconds * options.fps)} frames at {options.fps} fps"
        lines += table(f"Dam break `{name}`, {count} particles, {length}: cost (in brackets: times the first row's)", COST, chosen,
                       "dam", ratios=("wall", "cpu", "bytes"))  # fmt: skip
        lines += table(f"Dam break `{name}`: quality, mean over the frames", DAM, chosen, "dam")
        lines += table(f"Column `{name}` after {options.rest_seconds:g} s, its last half second", REST, chosen, "rest",
                       ratios=("wall",))  # fmt: skip
        lines += gate(chosen)
    return "\n".join([*lines, "", QUOTED])


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", default="100k", help=f"with commas: {', '.join(SCENES)} (default 100k)")
    parser.add_argument("--seconds", type=float, default=1.0, help="simulated seconds of the dam break, 0: none (1)")
    parser.add_argument("--rest-seconds", type=float, default=4.0, help="of the column, on the last of --threads (4)")
    parser.add_argument("--threads", default="1,2", help="numbers of threads, with commas (1,2)")
    parser.add_argument(
        "--rows", action="append", metavar="TEXT", help="only rows whose name contains it; may be repeated"
    )
    parser.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", help="passed to every Meniscus row"
    )
    parser.add_argument("--xsph", type=float, default=0.01, help="viscosity of both programs, 0: none (0.01)")
    parser.add_argument(
        "--peer-step", type=float, default=0.1, metavar="S/M", help="the peer's longest step, times the spacing (0.1)"
    )
    parser.add_argument("--fps", type=int, default=24)
    parser.add_argument(
        "--peer-boundary", choices=list(WALLS), default="particles", help="the peer's walls (particles)"
    )
    parser.add_argument(
        "--venv", type=pathlib.Path, default=ROOT / "target/bench-venv", help="made and filled if missing"
    )
    parser.add_argument("--binary", type=pathlib.Path, default=ROOT / "target/release/meniscus")
    parser.add_argument("--scratch", type=pathlib.Path, help="where frames go until they are judged")
    parser.add_argument("--json", type=pathlib.Path, help="write all figures there, after every row")
    options = parser.parse_args()
    options.scene = options.scene.split(",")
    options.threads = [int(n) for n in options.threads.split(",")]
    options.venv = options.venv.resolve()
    unknown = set(options.scene) - set(SCENES)
    if unknown:
        parser.error(f"no scene {', '.join(sorted(unknown))}")
    if not options.binary.exists():
        parser.error(f"{options.binary} is not there: cargo build --release")
    return options


def main():
    options = arguments()
    options.python = environment(options.venv)
    rows = [row for row in [*MENISCUS, *PEERS] if any(text in row[0] for text in options.rows or [""])]
    results = []
    for scene in options.scene:
        for threads in options.threads:
            for row in rows:
                try:
                    results.append(measure(row, scene, threads, options))
                except (SystemExit, subprocess.CalledProcessError) as failure:
                    print(failure, file=sys.stderr)
                    results.append({"row": row[0], "scene": scene, "threads": threads, "failed": str(failure)})
                if options.json:
                    options.json.write_text(
                        json.dumps({"quoted": QUOTED, "set": options.set, "results": results}, indent=1)
                    )
    print(report(results, options))
    failed = [result for result in results if "failed" in result]
    for result in failed:
        print(f"\nFailed: {result['scene']}, {result['row']}, {result['threads']} threads: {result['failed']}")
    if failed:
        sys.exit(1)


if __name__ == "__main__":
    main()
