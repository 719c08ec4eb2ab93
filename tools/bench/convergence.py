#!/usr/bin/env python3
"""Measures the seconds that solvers take to a target, on a column at rest and on a dam break; prints Markdown.

    tools/bench/convergence.py                        both scenes, every row: about an hour
    tools/bench/convergence.py --scene dam --rows accelerated,jacobi --targets 1,0.1

*Scenes*: `column`, 8 × 8 × 64 particles, 1/64 m apart, in a tank as wide as they are: 64 layers of water at rest; `dam`,
32 × 32 × 32 particles in a tank of 3.2 × 1 × 2 m. Liquid alone, no viscosity, no confinement; 24 frames at 24 fps.

*Rows* differ in solver, kernels and steps. `steps` is many small substeps with one iteration each and no target: its
work is set by the number of substeps, so it has a row for each.

*Columns*: seconds of the passes on one thread; iterations and substeps in all; the average and the largest deviation
of its own kernel that the log reports, mean over the frames; for the column, twice the height of the centre of mass over the rest
height and the RMS speed in the last frame. A row that expands a column or leaves it jittering has not converged.
Needs the release binary, numpy and zstandard.
"""

import argparse
import json
import pathlib
import statistics
import subprocess
import sys
import tempfile

import numpy as np

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tools/python"))

from meniscus_fx import cache as meniscus_cache  # noqa: E402

SCENES = {
    "column": {"spacing": 1 / 64, "box": [0.125, 0.125, 1], "tank": [0.125, 0.125, 2]},
    "dam": {"spacing": 1 / 32, "box": [1, 1, 1], "tank": [3.2, 1, 2]},
}
ROWS = {
    "jacobi, paper's kernels": ["solver=jacobi", "kernel=poly6_spiky", "cfl=0.4"],
    "jacobi": ["solver=jacobi", "cfl=0.4"],
    "accelerated, cfl 0.4": ["cfl=0.4"],
    "accelerated": [],
}
STEPS = [64, 256, 1024]
FRAMES = 24


def preset(scene):
    """The scene as a preset."""
    return f"""title = "Convergence"
frames = "1-{FRAMES + 1}"
fps = 24
[[world.collider]]
shape = {{ tank = {{ min = [0, 0, 0], max = {scene["tank"]} }} }}
[liquid]
spacing = {scene["spacing"]}
max_iterations = 20000
[[liquid.source]]
shape = {{ box = {{ min = [0, 0, 0], max = {scene["box"]} }} }}
"""


def measure(options, name, settings, folder):
    """One row's cells."""
    shot = folder / "shot"
    (folder / "scene.toml").write_text(preset(SCENES[name]))
    words = [options.binary, "simulate", folder / "scene.toml", "-o", shot, "--force", "--threads", "1"]
    words += [word for key in settings for word in ("--set", f"liquid.{key}")]
    done = subprocess.run([*map(str, words), "--progress", "none"], capture_output=True, text=True)
    if done.returncode == 20:
        return ["diverged", *[""] * (6 if name == "column" else 4)]
    if done.returncode != 0:
        sys.exit(done.stderr)
    log = [json.loads(line) for line in (shot / "log.jsonl").read_text().splitlines()]
    liquid = [record["liquid"] for record in log]
    stream = meniscus_cache.read(shot / "cache" / f"frame_{FRAMES + 1:04}.mcf")["streams"]["liquid"]["channels"]
    position, velocity = stream["position"].astype(np.float64), stream["velocity"].astype(np.float64)
    cells = [
        f"{sum(seconds for record in log for _, seconds in record['seconds']):.1f}",
        str(sum(record["iterations"] for record in liquid)),
        str(sum(record["substeps"] for record in liquid)),
        f"{100 * statistics.fmean(record['density_dev_avg'] for record in liquid):.3f} %",
        f"{100 * statistics.fmean(record['density_dev_max'] for record in liquid):.2f} %",
    ]
    if name == "column":
        speed = np.sqrt((velocity**2).sum(axis=1).mean())
        cells += [f"{2 * position[:, 2].mean():.4f}", f"{speed:.3f} m/s"]
    return cells


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", default=",".join(SCENES))
    parser.add_argument("--rows", help="parts of the rows' names, with commas (default all)")
    parser.add_argument("--targets", default="1,0.1,0.01", help="in percent, with commas")
    parser.add_argument("--binary", default=ROOT / "target/release/meniscus")
    options = parser.parse_args()
    rows = {f"{name}, {target} %": [*keys, f"density_dev={float(target) / 100}"]
            for target in options.targets.split(",") for name, keys in ROWS.items()}
    for steps in STEPS:
        rows[f"steps, {steps} a frame of one iteration"] = [
            "solver=jacobi", "density_dev=none", "iterations=1", f"min_substeps={steps}", f"max_substeps={steps}"
        ]
    if options.rows:
        rows = {name: keys for name, keys in rows.items() if any(part in name for part in options.rows.split(","))}
    for scene in options.scene.split(","):
        heads = [scene, "seconds", "iterations", "substeps", "average", "mean of largest"]
        heads += ["height", "leftover"] if scene == "column" else []
        print("| " + " | ".join(heads) + " |\n|" + "---|" * len(heads), flush=True)
        for name, keys in rows.items():
            with tempfile.TemporaryDirectory() as folder:
                print("| " + " | ".join([name, *measure(options, scene, keys, pathlib.Path(folder))]) + " |", flush=True)
        print()


if __name__ == "__main__":
    main()
