#!/usr/bin/env python3
"""Measures what twenty rigid bodies add to the time of 100 000 particles, and prints a table in Markdown.

    tools/bench/bodies.py                         the table of docs/bodies.md: 24 frames, two runs, two threads; about ten minutes
    tools/bench/bodies.py MENISCUS --frames 1-3   a try

The preset dam-break as it is written, and the same with twenty balls of 6 to 8 spacings in its column; and both in a tank in which
the water stays at rest. Runs with and without balls take turns. Needs only Python's standard library, and a machine that does nothing else.
"""

import argparse
import json
import pathlib
import statistics
import subprocess
import tempfile

from shot import ROOT, run

# Spacing of the preset [m], and density of the balls [kg/m³].
SPACING, DENSITY = 0.02125, 1200
SCENES = {
    "the column collapses": [],
    "water at rest": ["--set", "world.collider.0.shape.tank={ min = [0, 0, 0], max = [1, 1, 2] }"],
}


def balls():
    """Twenty of the 27 places of a grid in the column of a cubic metre, as text of a preset."""
    text = []
    for k in range(20):
        # Two or three of each layer's nine places stay empty.
        layer, place = divmod(k, 7)
        row, column = divmod(place + layer, 3)
        centre = [(column + 0.5) / 3, (row % 3 + 0.5) / 3, (layer + 0.5) / 3]
        radius = (3 + 0.5 * (k % 3)) * SPACING
        shape = f"{{ sphere = {{ center = [0, 0, 0], radius = {radius:.5f} }} }}"
        text.append(f"[[body]]\nshape = {shape}\ndensity = {DENSITY}\nposition = {[round(x, 4) for x in centre]}\n")
    return "\n".join(text)


def measured(binary, preset, options, folder):
    """Seconds of a simulation in a new folder, and the records of its frames."""
    wall, _, _ = run([binary, "simulate", preset, "-o", folder, "--progress", "none", *options])
    return wall, [json.loads(line) for line in (folder / "log.jsonl").read_text().splitlines()]


def cells(name, walls, records):
    """What a run did, as cells of the table."""
    liquid = [record["liquid"] for record in records]
    sums = [sum(record[key] for record in liquid) for key in ("substeps", "iterations", "list_rebuilds")]
    volume = max((record["volume_change"] for record in liquid), key=abs)
    seconds = ", ".join(f"{wall:.1f}" for wall in walls)
    return [name, seconds, *map(str, sums), f"{records[-1]['particles']:,}".replace(",", " "), f"{100 * volume:+.2f} %"]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("binary", nargs="?", type=pathlib.Path, default=ROOT / "target/release/meniscus")
    parser.add_argument("--frames", default="1-25", help="frames of the preset")
    parser.add_argument("--repeats", type=int, default=2, help="runs of each")
    parser.add_argument("--threads", type=int, default=2)
    args = parser.parse_args()
    binary = args.binary.resolve()
    print("| scene | seconds | substeps | iterations | lists built again | particles | volume, largest change | ratio |")
    print("|---|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        alone = folder / "alone.toml"
        subprocess.run([binary, "presets", "copy", "dam-break", alone], check=True, stdout=subprocess.DEVNULL)
        with_balls = folder / "with-balls.toml"
        with_balls.write_text(alone.read_text() + "\n" + balls())
        for number, (scene, settings) in enumerate(SCENES.items()):
            options = ["--frames", args.frames, "--threads", args.threads, *settings]
            walls, records = {alone: [], with_balls: []}, {}
            for repeat in range(args.repeats):
                for preset in walls:
                    out = folder / f"{preset.stem}-{number}-{repeat}"
                    wall, records[preset] = measured(binary, preset, options, out)
                    walls[preset].append(wall)
            ratios = [with_one / without for without, with_one in zip(walls[alone], walls[with_balls])]
            print("| " + " | ".join(cells(scene, walls[alone], records[alone])) + " | |")
            ratio = ", ".join(f"{ratio:.2f}" for ratio in ratios) + f"; median {statistics.median(ratios):.2f}"
            print("| " + " | ".join([*cells("with twenty balls", walls[with_balls], records[with_balls]), ratio]) + " |", flush=True)


if __name__ == "__main__":
    main()
