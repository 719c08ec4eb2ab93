#!/usr/bin/env python3
"""Runs every built-in preset in every tier and prints the table of presets of docs/gallery.md.

    tools/bench/gallery.py                        everything: simulate, mesh, write volumes and sheets, about an hour on two cores
    tools/bench/gallery.py dam-break --tiers draft,preview
    tools/bench/gallery.py smoke-ring --tiers draft --frames 1-4
    tools/bench/gallery.py --keep shots           leaves the shots there, to render pictures from
    tools/bench/gallery.py --large figure-drop    with about a million particles, half an hour or more each

Needs the release binary, Python's standard library, and a machine that does nothing else.
"""

import argparse
import json
import pathlib
import subprocess
import tempfile

from shot import ROOT, run

TIERS = ["draft", "preview", "final"]
# What gives a preset about a million particles. The tension of splashes is half of density × gravity × spacing².
LARGE = {
    "crown-splash": ["liquid.spacing=0.178 mm"],
    "dam-break-rocks": ["liquid.spacing=1.115 cm", "liquid.surface_tension.coefficient=0.61 N/m"],
    "figure-bath": ["liquid.spacing=1.11 cm", "liquid.surface_tension.coefficient=0.6 N/m"],
    "figure-drop": ["liquid.spacing=1.07 cm", "liquid.surface_tension.coefficient=0.56 N/m"],
    "honey": ["liquid.spacing=0.46 mm"],
}
# Pictures that were rendered from the shots.
PICTURES = ["docs/images/{}.jpg", "docs/images/{}.png"]


def presets(binary):
    """The names of the built-in presets."""
    listed = subprocess.run([binary, "presets", "list"], check=True, capture_output=True, text=True).stdout
    return [line.split()[0] for line in listed.splitlines() if line.strip()]


def size(folder):
    """The bytes of the files in a folder; none if it is not there."""
    return sum(file.stat().st_size for file in folder.iterdir()) if folder.is_dir() else 0


def row(binary, preset, tier, frames, folder):
    """One line of the table. Particles of smoke are vortons and tracers, those of sheets their points."""
    shot = folder / f"{preset}-{tier}"
    chosen = ["--frames", frames] if frames else []
    if tier == "large":
        chosen += [part for setting in LARGE[preset] for part in ("--set", setting)]
    else:
        chosen += ["--quality", tier]
    wall, _, memory = run([binary, "shot", preset, *chosen, "-o", shot, "--progress", "none"])
    records = [json.loads(line) for line in (shot / "log.jsonl").read_text().splitlines()]
    record = max(records, key=lambda record: record.get("frame", 0))
    peak_particles = max(record.get("particles", 0) for record in records)
    sizes = [size(shot / "cache"), sum(size(shot / kind) for kind in ("mesh", "volume", "sheet"))]
    first = tier in (TIERS[0], "large")
    pictures = [name for name in (form.format(preset) for form in PICTURES) if first and (ROOT / name).exists()]
    cells = [
        f"`{preset}`" if first else "",
        f"![]({pictures[0].removeprefix('docs/')})" if pictures else "",
        "as written" if tier == "final" else tier,
        f"{peak_particles:,}".replace(",", " "),
        str(record["frame"]),
        f"{wall:.{int(wall < 9.95)}f} s" if wall < 99.5 else f"{round(wall) // 60} min {round(wall) % 60} s",
        f"{memory / 2**20:.0f} MiB",
        *(f"{held / 1e6:,.{int(held < 1e7)}f} MB".replace(",", " ") for held in sizes),
    ]
    return "| " + " | ".join(cells) + " |"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("presets", nargs="*", help="names (default all)")
    parser.add_argument("--tiers", default=",".join(TIERS))
    parser.add_argument("--large", action="store_true", help="shots of about a million particles in place of tiers")
    parser.add_argument("--frames", help="only these, as the tool takes them")
    parser.add_argument("--keep", type=pathlib.Path, metavar="DIR", help="where the shots stay")
    parser.add_argument("--binary", default=ROOT / "target/release/meniscus")
    options = parser.parse_args()
    print("| preset | | tier | particles | frames | simulate and write | peak memory | cache | meshes, volumes or sheets |")
    print("|---|---|---|---|---|---|---|---|---|")
    unknown = set(options.presets) - set(LARGE)
    if options.large and unknown:
        parser.error(f"--large: found {', '.join(sorted(unknown))}, expected some of {', '.join(LARGE)}")
    tiers = ["large"] if options.large else options.tiers.split(",")
    for preset in options.presets or (LARGE if options.large else presets(options.binary)):
        for tier in tiers:
            with tempfile.TemporaryDirectory() as scratch:
                print(row(options.binary, preset, tier, options.frames, options.keep or pathlib.Path(scratch)), flush=True)


if __name__ == "__main__":
    main()
