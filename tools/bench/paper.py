#!/usr/bin/env python3
# SPDX-License-Identifier: MIT OR Apache-2.0
"""Repeats the plots and tables of [pbf] on the built-in presets and writes docs/paper.md and its plots in docs/images/.

    tools/bench/paper.py                    everything: a few minutes
    tools/bench/paper.py --only fig6 -o /some/where

Runs `meniscus simulate` with the release binary in a folder that is deleted afterwards. Figures are of drafts, about
10 000 particles; tables are of the presets as written, for a few frames. Needs numpy and zstandard, as
tools/python/meniscus_fx/cache.py does; plots are written as SVG by hand.
"""

import argparse
import json
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile
import time

import numpy as np

from plot import plot

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tools/python"))

from meniscus_fx import cache as meniscus_cache  # noqa: E402

# Of the presets [m/s²], along −z.
GRAVITY = 9.81
# The paper's frame of 16 ms. Its steps a frame and iterations a step are given row by row.
FRAME = ["fps=62.5"]
PRESSURE = "liquid.artificial_pressure.strength=0.1"
# The paper has no surface tension beyond its artificial pressure, and XSPH acts alike on all neighbours.
TERMS = ["liquid.surface_tension=none", "liquid.xsph.rest=0"]
PAPER = ["liquid.solver=jacobi", "liquid.kernel=poly6_spiky", "liquid.constraint=equality", PRESSURE, *TERMS]
JACOBI = ["liquid.solver=jacobi", "liquid.kernel=poly6_spiky", *TERMS]


def fixed(steps, iterations):
    """Settings for a fixed number of steps a frame and of iterations a step, as the paper has them."""
    ends = [f"liquid.min_substeps={steps}", f"liquid.max_substeps={steps}"] if steps else []
    return ends + ["liquid.density_dev=none", f"liquid.iterations={iterations}"]


class Bench:
    """Runs shots, each a process of its own, and remembers the binary and where they go."""

    def __init__(self, binary, folder, threads):
        self.binary, self.folder, self.threads, self.shots = binary, pathlib.Path(folder), threads, 0

    def run(self, preset, frames, settings, quality=None):
        """The log of a shot, one record a frame, and its folder."""
        self.shots += 1
        shot = self.folder / str(self.shots)
        line = command(preset, frames, settings, quality).split(" ")[1:]
        words = [self.binary, *line, "-o", shot, "--progress", "none", "--threads", self.threads]
        print(" ".join(line), file=sys.stderr)
        done = subprocess.run([str(word) for word in words], stdout=subprocess.DEVNULL)
        if done.returncode != 0:
            sys.exit(f"{' '.join(map(str, words))} ended with {done.returncode}")
        return [json.loads(text) for text in open(shot / "log.jsonl")], shot


def command(preset, frames, settings, quality=None):
    """The line that makes the shot."""
    words = ["meniscus", "simulate", preset, "--frames", frames]
    words += ["--quality", quality] if quality else []
    return " ".join(words + [word for key in settings for word in ("--set", key)])


def commands(lines):
    return "```sh\n" + "\n".join(lines) + "\n```\n"


def table(head, rows):
    """A Markdown table; the first column is text, the others are numbers."""
    lines = [head, ["---"] + ["--:"] * (len(head) - 1), *rows]
    return "\n".join("| " + " | ".join(map(str, line)) + " |" for line in lines) + "\n"


def number(count):
    return f"{count:,}".replace(",", " ")


def fig2(bench, images):
    """Artificial pressure: distances to the nearest neighbour."""
    rows, curves, lines = [], [], []
    for name, extra in (
        ("C = 0, without", ["liquid.constraint=equality"]),
        ("C = 0, with, as in the paper", ["liquid.constraint=equality", PRESSURE]),
        ("C ≥ 0 with the density at the free surface", []),
    ):
        settings = [*JACOBI, *FRAME, *fixed(2, 3), *extra]
        log, shot = bench.run("figure-splash", "1-64", settings, "draft")
        lines.append(command("figure-splash", "1-64", settings, "draft"))
        positions = meniscus_cache.read(shot / "cache/frame_0064.mcf")["streams"]["liquid"]["channels"]["position"]
        near = nearest(positions.astype(np.float64)) / 0.05
        quantiles = np.quantile(near, (0.01, 0.1, 0.5))
        share = (near < 0.5).mean()
        rows.append([name, *(f"{q:.2f}" for q in quantiles), f"{100 * share:.2f} %"])
        parts = np.linspace(0, 1, 101)
        curves.append((name, np.quantile(near, parts).clip(0, 1.5).tolist(), parts.tolist()))
    plot(images / "paper-fig2.svg", "Distance to the nearest neighbour, figure-splash, frame 64",
         "distance [spacings]", "share of particles below", curves, legend_top=240)
    size = number(log[-1]["particles"])
    return (
        "## Figure 2: artificial pressure\n\n"
        f"`figure-splash` as a draft ({size} particles), two steps of three Jacobi iterations a frame of 16 ms, one second "
        "after the figure is let go. Distances from each particle to its nearest neighbour, in spacings; 1 is the seeding lattice.\n\n"
        + table(["constraint, artificial pressure", "1 % below", "10 % below", "median", "under half a spacing"], rows)
        + "\n![](images/paper-fig2.svg)\n\n" + commands(lines)
    )


def nearest(points, block=512):
    """The distance from each point to the nearest other one, by looking at every pair."""
    found = np.empty(len(points))
    for first in range(0, len(points), block):
        some = points[first : first + block]
        squares = sum((some[:, None, k] - points[None, :, k]) ** 2 for k in range(3))
        squares[np.arange(len(some)), first + np.arange(len(some))] = np.inf
        found[first : first + block] = np.sqrt(squares.min(axis=1))
    return found


def outcome(log, shot, first):
    """What a shot did to the liquid: bulk deviation, volume, energy, height. `first` is the energy at the start [J]."""
    liquid = [record["liquid"] for record in log]
    bulk = [100 * (r["compression_avg"] + r["dilation_avg"]) for r in liquid]
    energy = [(r["kinetic_energy"] + r["potential_energy"]) / first for r in liquid]
    positions = [position(shot, record["frame"]) for record in log[:: max(len(log) // 12, 1)]]
    return {
        "bulk": statistics.fmean(bulk),
        "largest": 100 * max(r["density_dev_max"] for r in liquid),
        "volume": 100 * max((r["volume_change"] for r in liquid), key=abs),
        "energy": 100 * max(energy),
        "end": 100 * energy[-1],
        "clamps": sum(r["clamps"]["energy"] for r in liquid),
        "components": liquid[-1]["components"],
        "top": max(float(np.quantile(x[:, 2], 0.999)) for x in positions),
    }


def channel(shot, frame, name):
    path = shot / f"cache/frame_{frame:04}.mcf"
    return meniscus_cache.read(path)["streams"]["liquid"]["channels"][name].astype(np.float64)


def position(shot, frame):
    return channel(shot, frame, "position")


def first_energy(log, shot):
    """Kinetic and potential energy of frame 1 [J]; the log begins after it."""
    mass = log[0]["liquid"]["potential_energy"] / (GRAVITY * position(shot, log[0]["frame"])[:, 2].sum())
    speed2 = (channel(shot, 1, "velocity") ** 2).sum()
    return mass * (0.5 * speed2 + GRAVITY * position(shot, 1)[:, 2].sum())


OUTCOME = ["bulk, mean", "largest particle", "volume", "most energy", "energy at the end", "clamps", "components", "highest [m]"]
OUTCOME_TEXT = (
    "*Bulk* is the mean of |ρ/ρ₀ − 1| where the neighbourhood is filled, *largest particle* the largest deviation that the "
    "constraint corrects; *volume* is its largest change. Energies are kinetic and potential, over those of the first frame; "
    "*clamps* counts the steps in which the bound of the energy held the liquid back. *Highest* is the height that a "
    "thousandth of the particles exceeds. A row **holds** where no step was clamped, the volume stays within 3 % and the bulk "
    "within 2 %.\n\n"
)


def judged(name, figures):
    """A row of `OUTCOME`; the last cell: whether it holds."""
    holds = figures["clamps"] == 0 and abs(figures["volume"]) <= 3 and figures["bulk"] <= 2
    return [name, f"{figures['bulk']:.2f} %", f"{figures['largest']:.0f} %", f"{figures['volume']:+.1f} %",
            f"{figures['energy']:.0f} %", f"{figures['end']:.0f} %", figures["clamps"], figures["components"],
            f"{figures['top']:.2f}", "yes" if holds else "no"]  # fmt: skip


def rows_of(bench, preset, frames, variants):
    """The judged rows of a preset's draft with these settings, their commands, and the number of particles."""
    rows, lines, size = [], [], 0
    for name, settings in variants:
        log, shot = bench.run(preset, frames, settings, "draft")
        lines.append(command(preset, frames, settings, "draft"))
        rows.append(judged(name, outcome(log, shot, first_energy(log, shot))))
        size = log[-1]["particles"]
    return rows, lines, number(size)


def fig1(bench, _):
    """The setting of figure 1: two steps of three iterations."""
    variants = (
        ("the paper's method, 2 steps × 3 iterations", [*PAPER, *FRAME, *fixed(2, 3)]),
        ("the same without vorticity confinement", [*PAPER, *FRAME, *fixed(2, 3), "liquid.vorticity=none"]),
        ("the preset's terms, 2 steps × 3 iterations", [*FRAME, *fixed(2, 3)]),
        ("the preset's terms, to its density", [*FRAME]),
    )
    rows, lines, size = rows_of(bench, "figure-bath", "1-126", variants)
    return (
        "## Figure 1: two steps of three iterations\n\n"
        f"`figure-bath` as a draft ({size} particles), two seconds of frames of 16 ms. " + OUTCOME_TEXT
        + table(["", *OUTCOME, "holds"], rows) + "\n" + commands(lines)
    )  # fmt: skip


def step(bench, _):
    """The single step of 16 ms."""
    variants = [
        (f"{name}, {count} iterations", [*settings, *FRAME, *fixed(1, count)])
        for name, settings in (("the paper's method", PAPER), ("the preset's terms", []))
        for count in (4, 10, 40)
    ]
    variants.append(("the preset's terms, to its density", [*FRAME]))
    rows, lines, size = rows_of(bench, "figure-drop", "1-94", variants)
    return (
        "## Section 8: a single step of 16 ms\n\n"
        f"`figure-drop` as a draft ({size} particles), a step a frame of 16 ms for one and a half seconds, where the paper reports a "
        "stable simulation; the last row takes the steps that its CFL number wants. " + OUTCOME_TEXT
        + table(["", *OUTCOME, "holds"], rows) + "\n" + commands(lines)
    )  # fmt: skip


def fig4(bench, images):
    """Density over the drop of a figure."""
    rows, curves, lines = [], [], []
    variants = (
        ("the paper's: Jacobi, C = 0", [*PAPER, *FRAME, *fixed(4, 10)]),
        ("Jacobi, C ≥ 0", [*JACOBI, *FRAME, *fixed(4, 10)]),
        ("accelerated, C ≥ 0", [*TERMS, *FRAME, *fixed(4, 10)]),
    )
    for name, settings in variants:
        log, _ = bench.run("figure-drop", "1-150", settings, "draft")
        lines.append(command("figure-drop", "1-150", settings, "draft"))
        times = [(r["frame"] - 1) / 62.5 for r in log]
        bulk = [100 * (r["liquid"]["compression_avg"] + r["liquid"]["dilation_avg"]) for r in log]
        curves.append((name, times, bulk))
        rows.append([name, f"{statistics.fmean(bulk):.2f} %", f"{max(bulk):.2f} %",
                     f"{100 * statistics.fmean(r['liquid']['density_dev_avg'] for r in log):.2f} %",
                     f"{100 * max(r['liquid']['density_dev_max'] for r in log):.1f} %", sum(r["liquid"]["clamps"]["energy"] for r in log)])
    plot(images / "paper-fig4.svg", "Mean |ρ/ρ₀ − 1| in the bulk, figure-drop", "time [s]", "deviation [%]", curves)
    return (
        "## Figure 4: density over the drop of a figure\n\n"
        f"`figure-drop` as a draft ({number(log[-1]['particles'])} particles), four steps of ten iterations a frame of 16 ms, as the "
        "paper's own method in its Figure 4. *Bulk* is the mean of |ρ/ρ₀ − 1|, dilation and compression alike, where the "
        "neighbourhood is filled. *Constraint* is the mean of what the row's constraint corrects, over all particles. Each row "
        "measures density with its own kernel, so rows of different kernels compare only roughly. PCISPH, the paper's peer, "
        "is not run here.\n\n"
        + table(["", "bulk, mean", "bulk, largest frame", "constraint, mean", "constraint, largest particle", "energy clamps"], rows)
        + "\n![](images/paper-fig4.svg)\n\n" + commands(lines)
    )


def fig5(bench, images):
    """Vorticity confinement: energy over time."""
    rows, curves, lines = [], [], []
    for name, extra in (
        ("off", ["liquid.vorticity=none"]),
        ("0.5, the preset's", []),
        ("2", ["liquid.vorticity.strength=2"]),
    ):
        log, shot = bench.run("dam-break", "1-145", extra, "draft")
        lines.append(command("dam-break", "1-145", extra, "draft"))
        # The wave has run back and forth once when the paper's picture is taken, at t = 6 s.
        late = [position(shot, record["frame"])[:, 2] for record in log if record["frame"] > 49]
        splash = max(float(np.quantile(z, 0.999)) for z in late)
        times = [(r["frame"] - 1) / 24 for r in log]
        energy = [r["liquid"]["kinetic_energy"] for r in log]
        curves.append((f"confinement {name}", times, energy))
        at = {t: statistics.fmean(e for s, e in zip(times, energy) if abs(s - t) < 0.1) for t in (1, 2, 4, 5.9)}
        added = sum(r["liquid"]["confinement_energy"] for r in log)
        rows.append([name, *(f"{e:.0f}" for e in at.values()), f"{splash:.2f}", f"{added:.0f}", sum(r["liquid"]["clamps"]["confinement"] for r in log)])
    plot(images / "paper-fig5.svg", "Kinetic energy, dam-break", "time [s]", "energy [J]", curves)
    return (
        "## Figure 5: vorticity confinement\n\n"
        f"`dam-break` as a draft ({number(log[-1]['particles'])} particles) for six seconds, 24 frames a second. Kinetic energy in joules, a mean over "
        "0.2 s about each time; *added* is the energy that confinement added over all frames, as the log reports it. *Splash* is the greatest height after the first two "
        "seconds that a thousandth of the particles exceeds, in metres.\n\n"
        + table(["strength", "1 s", "2 s", "4 s", "5.9 s", "splash", "added", "substeps scaled down"], rows)
        + "\n![](images/paper-fig5.svg)\n\n" + commands(lines)
    )


def fig6(bench, images):
    """Convergence: the density error by iterations a step."""
    counts, rows, curves, lines = (1, 2, 4, 8, 16, 32), [], [], []
    variants = (
        ("Jacobi, poly6 and spiky", JACOBI),
        ("Jacobi, Wendland", ["liquid.solver=jacobi", *TERMS]),
        ("accelerated, Wendland", TERMS),
    )
    for name, extra in variants:
        left = []
        for count in counts:
            log, _ = bench.run("dam-break", "1-64", [*extra, *FRAME, *fixed(4, count)], "draft")
            left.append(100 * statistics.fmean(r["liquid"]["density_dev_avg"] for r in log[-6:]))
        lines.append(command("dam-break", "1-64", [*extra, *FRAME, *fixed(4, counts[-1])], "draft"))
        curves.append((name, list(counts), left))
        rows.append([name, *(f"{value:.3f} %" for value in left)])
    plot(images / "paper-fig6.svg", "Mean compression after a second, dam-break", "iterations a step", "mean compression [%]",
         curves, (True, True))
    return (
        "## Figure 6: convergence by iteration\n\n"
        f"`dam-break` as a draft ({number(log[-1]['particles'])} particles), four steps a frame of 16 ms, each with a fixed number of "
        "iterations from the start on. The mean of max(ρ/ρ₀ − 1, 0) over the bulk, averaged over the six frames before "
        "t = 1 s.\n\n"
        + table(["iterations a step", *counts], rows)
        + "\n![](images/paper-fig6.svg)\n\n"
        + commands(["# the last of each row; the others differ in liquid.iterations", *lines])
    )


def tables(bench, _):
    """Time a step, and the share of each pass."""
    scenes = (("figure-splash", 2, 3, 4.2), ("dam-break", 4, 3, 4.3), ("figure-drop", 4, 10, 7.8))
    rows, shares, lines = [], {}, []
    for preset, steps, iterations, theirs in scenes:
        for name, frames, settings in (
            ("paper's", "1-21", [*PAPER, *FRAME, *fixed(steps, iterations)]),
            ("as written", "1-5", []),
        ):
            log, _ = bench.run(preset, frames, settings)
            lines.append(command(preset, frames, settings))
            substeps = sum(r["liquid"]["substeps"] for r in log)
            seconds = {}
            for record in log:
                for what, value in record["seconds"]:
                    seconds[what] = seconds.get(what, 0) + value
            total = sum(seconds.values())
            rows.append([f"{preset}, {name}", number(log[-1]["particles"]), f"{substeps / len(log):.1f}",
                         f"{sum(r['liquid']['iterations'] for r in log) / substeps:.1f}", f"{1000 * total / substeps:.0f}",
                         f"{theirs}" if name == "paper's" else "–"])
            shares[f"{preset}, {name}"] = {what: 100 * value / total for what, value in seconds.items()}
    passes = list(dict.fromkeys(what for share in shares.values() for what in share))
    return (
        "## Tables 1 and 2: time a step, and its passes\n\n"
        f"The presets as written, {bench.threads} threads. *Paper's*: its settings, the first 20 frames of 16 ms. *As written*: the "
        "preset's own, the first four frames of 1/24 s. The paper's times are from a GTX 680, for its own scenes of 128k, "
        "100k and 80k particles.\n\n"
        + table(["scene, settings", "particles", "steps a frame", "iterations a step", "ms a step", "paper, ms a step"], rows)
        + "\nShare of the time by pass, in percent:\n\n"
        + table(["pass", *shares], [[what, *(f"{share.get(what, 0):.0f}" for share in shares.values())] for what in passes])
        + "\nThe same in the steps of the paper's Table 2, next to its percentages:\n\n"
        + table(["step", "splash, paper", *list(shares)[:2], "dam, paper", *list(shares)[2:4]],
                [[name, *(cell for k, theirs in enumerate(percent)
                          for cell in (theirs, *(f"{sum(share.get(p, 0) for p in own):.0f}" for share in list(shares.values())[2 * k : 2 * k + 2])))]
                 for name, own, percent in BREAKDOWN])
        + "\n" + commands(lines)
    )


# Steps of the paper's Table 2, the passes in them, and its percentages for its splash and its dam break.
BREAKDOWN = [
    ("integrate", ["predict", "velocity"], (1, 1)),
    ("create hash grid, detect neighbors", ["sort", "search"], (36, 34)),
    ("constraint solve", ["solve", "artificial_pressure", "surface_tension"], (38, 51)),
    ("velocity update", ["vorticity", "xsph"], (25, 14)),
]
PARTS = {"fig1": fig1, "fig2": fig2, "fig4": fig4, "fig5": fig5, "fig6": fig6, "step": step, "tables": tables}

HEAD = """# Comparison with [pbf]

```sh
tools/bench/paper.py                    # runs every shot below and writes this page
tools/bench/paper.py --only fig4        # one part
```

The figures and tables of [pbf] ([references.md](references.md)) on the built-in presets. **The figures are of drafts, about
10 000 particles**, a tenth of the paper's; the tables are of the presets as written. Each part ends with its commands.

Written by `tools/bench/paper.py` in {seconds:.0f} s on {threads} threads, with {cpu:.0f} s of CPU time; do not edit. Where the CPU
time is well below threads × seconds, other programs ran, and the times in the tables are too long. Everything else is the
same in every run.
"""


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=PARTS, action="append", help="one part; may be repeated")
    parser.add_argument("-o", "--output", type=pathlib.Path, default=ROOT / "docs")
    parser.add_argument("--threads", type=int, default=os.cpu_count())
    parser.add_argument("--binary", default=ROOT / "target/release/meniscus")
    options = parser.parse_args()
    images = options.output / "images"
    images.mkdir(parents=True, exist_ok=True)
    start, parts = time.monotonic(), []
    for name in options.only or PARTS:
        with tempfile.TemporaryDirectory() as folder:
            parts.append(PARTS[name](Bench(options.binary, folder, options.threads), images))
    used = os.times()
    cpu = used.children_user + used.children_system + used.user + used.system
    head = HEAD.format(cpu=cpu, seconds=time.monotonic() - start, threads=options.threads)
    (options.output / "paper.md").write_text("\n".join([head, *parts]))


if __name__ == "__main__":
    main()
