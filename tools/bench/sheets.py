#!/usr/bin/env python3
"""Cost and accuracy of sheets, as tables in Markdown.

    tools/bench/sheets.py cost                       seconds a substep from 1e3 to 1e6 points, about two minutes
    tools/bench/sheets.py cost --plot docs/images/sheets-cost.svg
    tools/bench/sheets.py cost --sides 32,100,316
    tools/bench/sheets.py precision                  integrators, steps and stiffness, about twenty minutes
    tools/bench/sheets.py precision --stiffness 1e2,1e4 --frames 13

*Cost*: a square of 1 m, held at its corners, in frames of sixteen symplectic substeps, so that they are as long as the
points are far apart. A substep of the implicit integrator is four of these; its cost is given for an iteration of the conjugate
gradients, since their number does not depend on the points. Wall seconds of the pass `sheet_step` of the tool's log on one
thread, best of the frames; `cargo bench --bench sheet -- threads` has them by threads.

*Precision*: a cloth of 64 × 64 cells, level at the start, hung at two corners, by stiffness, integrator and steps. Errors are
root mean squares of the distances of its points from those of a symplectic run with an eighth of the longest stable
substep, and *certain* is the distance of that run from one with a quarter. CPU seconds of the process on one thread, so other
work on the machine shows little.

Needs the release binary, Python's standard library, and a machine that does nothing else.
"""

import argparse
import array
import json
import math
import pathlib
import resource
import subprocess
import sys
import tempfile

from plot import plot
from shot import ROOT

PRESET = """
title = "Sheet"
frames = "1-{last}"
fps = {fps!r}

[[sheet]]
name = "cloth"
shape = {{ grid = {{ origin = [0, 0, 0], first = [1, 0, 0], second = [0, 1, 0], cells = [{cells}, {cells}] }} }}
density = {density}
stiffness = [{stiffness}, {stiffness}]
pin = [{{ at = {{ points = [{pins}] }} }}]
{terms}

[sheets.solver]
{solver}

[output]
sheet = ["pc2"]
"""

DENSITY = 0.2
KINDS = {"structural springs": "", "shear, bending, damping": "shear = 10\nbending = 1e-5\ndamping = 1"}
SUBSTEPS = 16


def preset(**changes):
    values = {"last": 5, "fps": 24, "cells": 64, "density": DENSITY, "stiffness": 50, "terms": "", "solver": "", **changes}
    if "pins" not in values:
        n = values["cells"]
        values["pins"] = f"0, {n}, {n * (n + 1)}, {(n + 1) ** 2 - 1}"
    return PRESET.format(**values)


def simulate(options, text, threads=1):
    """The log's records, the positions of the points in the last frame, and CPU seconds."""
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder)
        (path / "sheet.toml").write_text(text)
        line = [options.binary.resolve(), "shot", "sheet.toml", "-o", "out", "--threads", threads, "--progress", "none"]
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        done = subprocess.run([str(word) for word in line], cwd=path, capture_output=True, text=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        if done.returncode != 0:
            sys.exit(f"{done.stderr}\n{text}")
        records = [json.loads(line) for line in (path / "out/log.jsonl").read_text().splitlines()]
        bytes_ = (path / "out/sheet/cloth.pc2").read_bytes()
        points = int.from_bytes(bytes_[16:20], "little")
        places = array.array("f", bytes_[-12 * points :])
        if sys.byteorder == "big":
            places.byteswap()
        return records, places, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def substep_seconds(records):
    """Wall seconds of a substep, best of the frames."""
    return min(dict(record["seconds"])["sheet_step"] / record["sheets"]["substeps"] for record in records)


def iteration_seconds(records):
    """Wall seconds of an iteration of the conjugate gradients, best of the frames, and iterations a substep."""
    counted = [record for record in records if record["sheets"]["iterations"]]
    best = min(dict(record["seconds"])["sheet_step"] / record["sheets"]["iterations"] for record in counted)
    return best, counted[-1]["sheets"]["iterations"] / counted[-1]["sheets"]["substeps"]


def count(number):
    return f"{number:,}".replace(",", " ")


def cost(options):
    """Prints seconds a substep by points, and the deviation from a straight line through the origin."""
    points = [int(side) ** 2 for side in options.sides.split(",")]
    curves = []
    for kind, terms in KINDS.items():
        print(f"\n{kind[0].upper() + kind[1:]}:\n")
        print("| points | symplectic, ms a substep | ns a point | implicit, ms a substep | iterations | ns a point and iteration |")
        print("|--:|--:|--:|--:|--:|--:|")
        substeps, iterations = [], []
        for number in points:
            cells = math.isqrt(number) - 1
            # The longest stable substep of the bare grid at courant 0.5: frames of sixteen.
            longest = math.sqrt(4 * DENSITY / (8 * (50 + 2 * 10 * bool(terms)))) / cells
            fps = 1 / (SUBSTEPS * 0.5 * longest)
            last = 3 if number > 3e5 else 5 if number > 3e4 else 17
            common = {"cells": cells, "fps": fps, "terms": terms, "last": last}
            substeps.append(substep_seconds(simulate(options, preset(**common))[0]))
            records, *_ = simulate(options, preset(**common, solver="integrator = 'implicit'\nsubsteps = 4"))
            best, per_substep = iteration_seconds(records)
            iterations.append(best)
            row = [count(number), f"{1e3 * substeps[-1]:.3g}", f"{1e9 * substeps[-1] / number:.1f}"]
            row += [f"{1e3 * substep_seconds(records):.3g}", f"{per_substep:.1f}", f"{1e9 * best / number:.1f}"]
            print("| " + " | ".join(row) + " |", flush=True)
        lines = [[one / n for one, n in zip(seconds, points)] for seconds in (substeps, iterations)]
        spread = [f"{max(ns) / min(ns):.2f}" for ns in lines]
        print(f"\nLinear within a factor of {spread[0]} (symplectic) and {spread[1]} (implicit, an iteration).")
        curves += [(f"{what}, {kind}", points, [1e3 * value for value in seconds])
                   for what, seconds in (("substep", substeps), ("iteration", iterations))]
    if options.plot:
        plot(options.plot, "Cost of a sheet, one thread", "points", "milliseconds", curves, (True, True), legend_top=260)


def rms_distance(a, b):
    """Root mean square of the distances of points of the same number [m]."""
    return math.sqrt(sum((x - y) ** 2 for x, y in zip(a, b)) / (len(a) / 3))


def precision(options):
    """Error and seconds by stiffness, integrator and steps, and which is faster for an error."""
    rows = {}
    for stiffness in [float(value) for value in options.stiffness.split(",")]:
        shear, bend = 0.2 * stiffness, "bending = 1e-5\ndamping = 1"
        terms = f"shear = {shear}\n{bend}"

        def run(solver):
            n = options.cells
            text = preset(
                last=options.frames, stiffness=stiffness, terms=terms, cells=n, pins=f"{n * (n + 1)}, {(n + 1) ** 2 - 1}",
                solver=f"max_substeps = 10000000\nmax_iterations = 10000\n{solver}",
            )
            return simulate(options, text)

        (finest, exact, longest), (_, nearly, _) = run("courant = 0.125"), run("courant = 0.25")
        found = [(f"symplectic, courant {courant}", *run(f"courant = {courant}")) for courant in (0.9, 0.5)]
        for substeps in (1, 2, 4, 8, 16, 32, 64):
            solver = f"integrator = 'implicit'\nsubsteps = {substeps}\ntolerance = {options.tolerance}"
            found.append((f"implicit, {substeps}", *run(solver)))
        rows[stiffness] = [(name, cpu, rms_distance(places, exact)) for name, _, places, cpu in found]
        print(f"\n{stiffness:g} N/m, certain to {1e3 * rms_distance(exact, nearly):.2g} mm:\n")
        print("| integrator | substeps a frame | iterations a substep | CPU s | error [mm] | strain | energy at the end [J] |")
        print("|---|--:|--:|--:|--:|--:|--:|")
        for name, records, places, cpu in found + [("reference", finest, exact, longest)]:
            last = records[-1]["sheets"]
            steps = sum(record["sheets"]["substeps"] for record in records)
            iterations = sum(record["sheets"]["iterations"] for record in records)
            energy = last["kinetic_energy"] + last["elastic_energy"] + last["potential_energy"]
            far = "" if places is exact else f"{1e3 * rms_distance(places, exact):.2g}"
            cells = [name, f"{steps / len(records):.0f}", f"{iterations / steps:.0f}" if iterations else "", f"{cpu:.3g}"]
            cells += [far, f"{100 * last['strain_max']:.2g} %", f"{energy:.4f}"]
            print("| " + " | ".join(cells) + " |", flush=True)
    limits = [1e-3, 3e-3, 1e-2, 3e-2]
    print("\nCPU seconds of the fastest that keeps an error, symplectic (with its courant) and implicit (with its substeps):\n")
    print("| stiffness [N/m] | " + " | ".join(f"{1e3 * limit:g} mm" for limit in limits) + " |")
    print("|--:|" + "---|" * len(limits))
    for stiffness, row in rows.items():
        def fastest(kind, limit):
            times = [(took, name) for name, took, error in row if name.startswith(kind) and error <= limit]
            return f"{min(times)[0]:.2g} ({min(times)[1].split()[-1]})" if times else "none"

        cells = [f"{fastest('symplectic', limit)}, {fastest('implicit', limit)}" for limit in limits]
        print(f"| {stiffness:g} | " + " | ".join(cells) + " |")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("study", choices=["cost", "precision"])
    parser.add_argument("--sides", default="32,56,100,178,316,562,1000", help="points along a side")
    parser.add_argument("--plot", type=pathlib.Path, help="of costs, as SVG")
    parser.add_argument("--stiffness", default="1e1,1e2,1e3,1e4,1e5,1e6", help="of structural springs [N/m]; shear has a fifth")
    parser.add_argument("--cells", type=int, default=64, help="along a side")
    parser.add_argument("--frames", type=int, default=25, help="the last of the frames that are compared")
    parser.add_argument("--tolerance", default="1e-4", help="of the conjugate gradients")
    parser.add_argument("--binary", default=ROOT / "target/release/meniscus", type=pathlib.Path)
    options = parser.parse_args()
    cost(options) if options.study == "cost" else precision(options)


if __name__ == "__main__":
    main()
