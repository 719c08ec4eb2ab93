#!/usr/bin/env python3
"""Measures the quality tiers of every built-in preset among other settings and writes docs/tiers.md.

    tools/bench/tiers.py                                  one second of every built-in preset
    tools/bench/tiers.py dam-break --frames 1-6 -o /dev/stdout
    tools/bench/tiers.py --again                          measures the disturbed rows again

Runs `meniscus tradeoff PRESET --tiers` with the release binary. What was measured is kept in target/tiers, so that the
same command continues where it stopped; --force measures all of it again, which is needed after a change of the code, since
rows are kept by the version alone. Needs only Python's standard library, and a machine that does nothing else: rows
whose threads got clearly less than a processor each are marked as disturbed.
"""

import argparse
import json
import os
import pathlib
import shutil
import statistics
import subprocess
import sys
import tomllib

ROOT = pathlib.Path(__file__).resolve().parents[2]
# Varied in addition to the tiers, which differ in spacing and target. The tool's own variations take a quarter of an hour a preset.
VARIED = {
    "liquid": ["liquid.density_dev=0.1%,0.3%,1%"],
    "smoke": ["smoke.flow.error=3e-3,1e-3,3e-4"],
    "sheets": [
        "sheets.solver.integrator+sheets.solver.courant=symplectic+0.9,symplectic+0.5,symplectic+0.25",
    ],
}
# The error that decides front and knee: densities of liquids of different spacings cannot be compared, those of smoke can.
JUDGE = {"liquid": "observable", "smoke": "density", "sheets": "distance"}
# The tables of a preset by which its kind is known.
KEYS = {"liquid": "liquid", "smoke": "smoke", "sheets": "sheet"}
# CPU seconds over wall seconds and threads: 0.9 to 1 on an idle machine, so below this other work was under way.
BUSY = 0.85


def disturbed(line, threads):
    """Whether a row's threads had to share their processors; no if the system does not report CPU time."""
    cpu = line["cpu_seconds"]
    return cpu is not None and cpu["median"] < BUSY * threads * line["seconds"]["median"]


def measured(binary, preset, options):
    """The table of a preset; with --again, after its disturbed rows were measured again."""
    found = table(binary, preset, options, options.force)
    lines = [line for line in found["lines"] + [found["reference"]] if disturbed(line, found["threads"])]
    if not options.again or not lines:
        return found
    medians = {line["seconds"]["median"] for line in lines}
    for row in (options.rows / preset / "rows").glob("*/row.json"):
        if statistics.median(json.loads(row.read_text())["seconds"]) in medians:
            shutil.rmtree(row.parent)
    return table(binary, preset, options, False)


def table(binary, preset, options, force):
    """The table of a preset; rows that are kept are not run again unless `force`."""
    kind = system(binary, preset)
    line = [binary, "tradeoff", preset, "--tiers", "--by", JUDGE[kind], "--json", "--output", options.rows / preset]
    line += ["--frames", options.frames, "--repeats", options.repeats, "--threads", options.threads]
    line += [word for vary in options.vary or VARIED[kind] for word in ("--vary", vary)]
    line += [word for key in options.set for word in ("--set", key)]
    line += ["--force"] if force else []
    done = subprocess.run([str(word) for word in line], stdout=subprocess.PIPE, text=True)
    if done.returncode != 0:
        sys.exit(f"{' '.join(map(str, line))} ended with {done.returncode}")
    return json.loads(done.stdout)


def system(binary, preset):
    """The system whose tiers a preset has."""
    shown = subprocess.run([binary, "presets", "show", preset], stdout=subprocess.PIPE, text=True, check=True).stdout
    # The tool compares the first of these that is there.
    return next(kind for kind, key in KEYS.items() if key in tomllib.loads(shown))


def markdown(preset, found):
    """One preset's section."""
    introduction, heads, cells = (liquid if "observable" in found else smoke if "cell" in found else sheets)(found)
    rows = [
        f"## {preset}",
        "",
        f"Frames {found['frames']}, {found['threads']} threads. The reference differs from its own refinement by {introduction}.",
        "",
        "| setting | " + " | ".join(heads) + " | |",
        "|---|" + "--:|" * len(heads) + "---|",
    ]
    for place, line in enumerate(found["lines"] + [found["reference"]]):
        marks = ["reference"] if place == len(found["lines"]) else []
        marks += ["diverged"] if line["diverged"] else []
        marks += ["front"] if line["front"] else []
        marks += ["outside"] if line["outside"] else []
        marks += ["**knee**"] if place == found["knee"] else []
        marks += ["disturbed"] if disturbed(line, found["threads"]) else []
        is_tier = any(word in ("draft", "preview", "final") for word in line["label"].split(" = "))
        name = f"**{line['label']}**" if is_tier else line["label"]
        rows.append("| " + " | ".join([name, *cells(line), ", ".join(marks)]) + " |")
    return "\n".join(rows) + "\n"


def times(line):
    """What a setting took."""
    cpu = line["cpu_seconds"]
    return [
        f"{line['seconds']['median']:.1f}",
        "–" if cpu is None else f"{cpu['median']:.1f}",
        f"{line['shot_seconds']:.0f} s",
    ]


def count(number):
    return f"{number:,}".replace(",", " ")


def liquid(found):
    """The distance of the reference from its refinement, the columns, and the cells of a line."""
    unit = "J/kg" if found["observable"] == "kinetic_energy" else "m"
    known = found["uncertainty"]

    def cells(line):
        volume = line["volume_change"]
        return [
            count(line["particles"]),
            *times(line),
            percent(line["compression"]),
            percent(line["dilation"]),
            percent(line["density_dev_largest"]),
            "–" if volume is None else f"{100 * volume:+.1f} %",
            percent(line["apart"]["energy"], known["energy"]),
            figure(line["apart"]["observable"], known["observable"]),
        ]

    heads = ["particles", "seconds", "CPU", "whole shot", "compression", "dilation", "density, largest", "volume", "energy"]
    uncertainty = f"energy {percent(known['energy'])}, {found['observable']} {figure(known['observable'])} {unit}"
    return uncertainty, [*heads, f"{found['observable']} [{unit}]"], cells


def smoke(found):
    """The same of smoke."""
    known = found["uncertainty"]
    errors = {"density": "density", "center": "centre", "extent": "extent", "energy": "energy", "impulse": "impulse"}

    def cells(line):
        volume, memory = line["volume_seconds"], line["memory"]
        return [
            count(line["vortons"]),
            count(line["tracers"]),
            *times(line),
            "–" if volume is None else f"{volume['median']:.2f}",
            "–" if memory is None else f"{memory / 2**20:.0f}",
            percent(line["velocity"]),
            *(percent(line["apart"][key], known[key]) for key in errors),
            percent(line["voxel"]),
        ]

    heads = ["vortons", "tracers", "seconds", "CPU", "whole shot", "s a volume", "MiB", "velocity", *errors.values(), "voxel"]
    return ", ".join(f"{name} {percent(known[key])}" for key, name in errors.items()), heads, cells


def sheets(found):
    """The same of sheets."""
    known = found["uncertainty"]

    def length(value, floor=None):
        return "–" if value is None else figure(1e3 * value, None if floor is None else 1e3 * floor)

    def cells(line):
        memory = line["memory"]
        return [
            count(line["points"]),
            *times(line),
            "–" if memory is None else f"{memory / 2**20:.0f}",
            f"{line['substeps']:.0f}",
            f"{line['iterations']:.0f}",
            percent(line["strain"]),
            *(length(line["apart"][key], known[key]) for key in ("distance", "farthest")),
            percent(line["apart"]["energy"], known["energy"]),
        ]

    heads = ["points", "seconds", "CPU", "whole shot", "MiB", "substeps", "iterations", "strain", "distance [mm]", "farthest [mm]", "energy"]
    uncertainty = (f"distance {length(known['distance'])} mm, farthest {length(known['farthest'])} mm, "
                   f"energy {percent(known['energy'])}")
    return uncertainty, heads, cells


def figure(value, floor=None):
    if value is None:
        return "–"
    below = floor is not None and value < floor
    shown = floor if below else value
    return ("≤ " if below else "") + (f"{shown:.0f}" if abs(shown) >= 10 else f"{shown:.2g}")


def percent(value, floor=None):
    if value is None:
        return "–"
    return figure(100 * value, None if floor is None else 100 * floor) + " %"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("preset", nargs="*", help="default: every built-in preset")
    parser.add_argument("--frames", default="1-24")
    parser.add_argument("--repeats", default=1, type=int)
    parser.add_argument("--threads", default=os.cpu_count(), type=int)
    parser.add_argument("--vary", action="append", help="passed to the tool; default: density_dev alone, of smoke the error, of sheets the length of substeps")
    parser.add_argument("--set", action="append", default=[], help="passed to the tool")
    parser.add_argument("--rows", default=ROOT / "target/tiers", type=pathlib.Path, help="where runs are kept")
    parser.add_argument("--force", action="store_true", help="measure everything again")
    parser.add_argument("--again", action="store_true", help="measure the disturbed rows again, once")
    parser.add_argument("--binary", default=ROOT / "target/release/meniscus")
    parser.add_argument("-o", "--output", default=ROOT / "docs/tiers.md", type=pathlib.Path)
    options = parser.parse_args()
    listed = subprocess.run([options.binary, "presets"], stdout=subprocess.PIPE, text=True, check=True).stdout
    presets = options.preset or [line.split()[0] for line in listed.splitlines()]
    parts = [
        "# Quality tiers: time and error\n\n"
        "```sh\nmeniscus shot dam-break --quality draft     # to block the shot: seconds\n"
        "meniscus shot dam-break                     # as written: the tier `final`\n"
        "meniscus tradeoff dam-break --tiers         # the tiers among other settings, on your machine\n```\n\n"
        "Each table compares the tiers (bold) of a preset with other settings; [tradeoff.md](tradeoff.md) explains the columns.\n"
        "Written by `tools/bench/tiers.py`; do not edit.\n\n"
        "- Front and knee are by the observable for liquids, since densities of different spacings cannot be compared. For smoke\n"
        "  they are by the displaced fraction, for sheets by the distance of points from the reference's.\n"
        "- The time of whole shots of smoke includes volumes, and is extrapolated from these frames: growing smoke takes several\n"
        "  times as long.\n"
        "- Seconds are wall-clock time of the passes. CPU is that of the whole process, with start-up and files.\n"
        f"- *Disturbed*: less CPU than {100 * BUSY:.0f} % of the threads' time, so other programs ran and the seconds are too many.\n"
    ]
    parts += [markdown(preset, measured(options.binary, preset, options)) for preset in presets]
    options.output.write_text("\n".join(parts))


if __name__ == "__main__":
    main()
