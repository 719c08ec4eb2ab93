"""Sheets coupled with liquid and with smoke at the ends of their settings: a part of docs/stability.md (stability.py).

Needs numpy and zstandard, to read where particles are."""

import pathlib
import sys

from stability_run import refusal, simulated
from stability_sheets import INTEGRATORS

ROOT = pathlib.Path(__file__).resolve().parents[2]

CELLS = 12
PRESET = """
title = "Stability"
frames = "1-9"
fps = {fps}

[world]
gravity = [0, 0, {gravity}]

{fluid}

[[sheet]]
name = "cloth"
shape = {{ grid = {{ origin = [-0.5, -0.5, 0], first = [1, 0, 0], second = [0, 1, 0], cells = [{cells}, {cells}] }} }}
density = {density!r}
stiffness = [{stiffness!r}, {stiffness!r}]
shear = {shear!r}
pin = [{{ at = {{ points = {border} }} }}]
[sheets.solver]
integrator = "{integrator}"

[[coupling]]
between = ["{system}", "cloth"]
{terms}
{more}
"""

SPACING = 0.05
LIQUID = """
[liquid]
spacing = {spacing}
density = {rest_density!r}
[[liquid.source]]
shape = {{ box = {{ min = [-0.15, -0.15, 0.05], max = [0.15, 0.15, 0.35] }} }}
velocity = [0, 0, {speed!r}]
"""

# A ring that rises to the sheet, in a wind along x.
SMOKE = """
[smoke]
spacing = 0.1
wind = [{wind!r}, 0, {lift!r}]
[[smoke.ring]]
center = [0, 0, -0.3]
radius = 0.2
thickness = 0.08
circulation = 1.0
direction = [0, 0, 1]
"""

# A second sheet that falls onto the water, which is then between the two.
LID = """
[[sheet]]
name = "lid"
shape = {{ grid = {{ origin = [-0.4, -0.4, 0.4], first = [0.8, 0, 0], second = [0, 0.8, 0], cells = [10, 10] }} }}
density = 5
stiffness = [2000, 2000]
shear = 400
velocity = [0, 0, {speed!r}]
[[coupling]]
between = ["liquid", "lid"]
"""


def drags(pair):
    across, wind = pair
    return {"terms": f"drag = {{ across = {across!r}, along = 0.02 }}", "wind": wind, "lift": 0.5 * wind}


# (heading, unit, values, how a value changes the shot)
LIQUID_SWEEPS = [
    ("Density of the sheet, under 300 kg/m² of water", "kg/m²", [1e-4, 1e-2, 0.5, 1e3, 1e6], lambda value: {"density": value}),
    ("Density of the liquid, on a sheet of 0.5 kg/m²", "kg/m³", [1e-3, 1.0, 1e3, 2e4, 1e9], lambda value: {"rest_density": value}),
    ("Speed of the water", "m/s", [0.0, 2.0, 20.0, 200.0, 2e3, 1e6], lambda value: {"speed": -value}),
    ("Stiffness of the springs, with a fifth of it against shear", "N/m", [1.0, 1e2, 1e4, 1e6],
     lambda value: {"stiffness": value, "shear": 0.2 * value}),
    ("Spacing of the liquid, with cells of 0.083 m", "m", [0.15, 0.1, 0.05, 0.03, 0.02], lambda value: {"spacing": value}),
    ("Cells along a side, with a spacing of 0.05 m: from the length of the sheet to a sixth of a spacing", "", [1, 2, 4, 40, 120],
     lambda value: {"cells": value}),
    ("Friction", "", [0.1, 1.0, 100.0, 1e9], lambda value: {"terms": f"friction = {value!r}"}),
    ("Gravity", "m/s²", [0.0, 98.1, 981.0, 1e5], lambda value: {"gravity": -value}),
    ("Length of frames, times 1/24 s", "", [1, 10, 100], lambda value: {"fps": 24 / value}),
    ("Speed of a second sheet that falls onto the water", "m/s", [0.0, 10.0, 100.0, 1e3],
     lambda value: {"more": LID.format(speed=-value)}),
]
SMOKE_SWEEPS = [
    ("Drag across the faces (`drag.across`) × wind along the sheet, with half of it upwards", "m/s", [
        (1.2, 0.0), (1.2, 10.0), (1.2, 100.0), (1.2, 1e3), (100.0, 10.0), (100.0, 100.0), (1e4, 10.0), (1e4, 1e3), (1e9, 1e3)], drags),
    ("Density of the sheet, in a wind of 30 m/s", "kg/m²", [1e-6, 1e-3, 1.0, 1e3], lambda value: {**drags((1.2, 30.0)), "density": value}),
]


# Counts in a frame's record of the coupling with liquid, and how they are reported.
CONTACT = {
    "crossed": "particles crossed",
    "put_back": "particles projected without the sheet",
    "unfinished": "contact solves at their limit of iterations",
}


def border(cells):
    n = cells + 1
    return [i for i in range(n * n) if i % n in (0, cells) or i // n in (0, cells)]


def preset(change, integrator, system):
    values = {
        "fps": 24, "gravity": -9.81, "density": 0.5, "stiffness": 2000.0, "shear": 400.0, "cells": CELLS, "terms": "", "more": "",
        "spacing": SPACING, "rest_density": 1000.0, "speed": -2.0, "wind": 0.0, "lift": 0.0, "integrator": integrator, "system": system, **change,
    }
    fluid = (LIQUID if system == "liquid" else SMOKE).format(**values)
    return PRESET.format(**values, fluid=fluid, border=border(values["cells"]))


def below(path):
    """The number of particles in the last frame that are below the lowest face of the cloth on their vertical line."""
    import numpy

    sys.path.insert(0, str(ROOT / "tools/python"))
    from meniscus_fx import cache as meniscus_cache

    streams = meniscus_cache.read(path)["streams"]
    x = streams["liquid"]["channels"]["position"].astype(float)
    y = streams["sheet.cloth"]["channels"]["position"].astype(float)
    n = round(len(y) ** 0.5)
    grid = y.reshape(n, n, 3)
    a, b, c, d = grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]
    faces = numpy.concatenate([numpy.stack(corners, axis=2).reshape(-1, 3, 3) for corners in ((a, b, c), (a, c, d))])
    lowest = numpy.full(len(x), numpy.inf)
    for p, q, r in faces:
        (ux, uy), (vx, vy) = (q - p)[:2], (r - p)[:2]
        area = ux * vy - uy * vx
        if area == 0:
            continue
        dx, dy = x[:, 0] - p[0], x[:, 1] - p[1]
        s, t = (dx * vy - dy * vx) / area, (ux * dy - uy * dx) / area
        over = (s >= 0) & (t >= 0) & (s + t <= 1)
        height = p[2] + s * (q - p)[2] + t * (r - p)[2]
        lowest = numpy.where(over, numpy.minimum(lowest, height), lowest)
    return int((numpy.isfinite(lowest) & (x[:, 2] < lowest)).sum())


def verdict(tool, change, integrator, system):
    """(verdict, figures, reason) of one shot."""
    text = preset(change, integrator, system)
    with simulated(tool, text) as (ran, frames, out):
        if ran.returncode in (2, 20):
            return "refused", ["", "", ""], refusal(ran.stderr)
        if ran.returncode != 0:
            raise SystemExit(f"exit {ran.returncode}: {' '.join(ran.stderr.split())}\n{text}")
        through = below(out / "cache/frame_0009.mcf") if system == "liquid" else 0
    return judge(frames, change, through)


def judge(frames, change, through):
    """Stable if nothing was limited or got through, and the energy did not grow; else degraded, with the reasons."""
    assert len(frames) == 8, frames
    how = []
    total = lambda *keys: sum(value(frame, keys) for frame in frames)
    steps = total("sheets", "substeps")
    report = lambda count, what: how.append(f"{count:g} {what}") if count else None
    share = lambda count, what: how.append(f"{count} of {steps} substeps {what}") if count else None
    for key, what in CONTACT.items():
        report(total("coupling", "liquid", key), what)
    report(total("coupling", "smoke", "cut"), "drags of faces cut")
    share(total("liquid", "cfl_capped"), "longer than the CFL rule")
    share(total("liquid", "unconverged"), "above `density_dev`")
    share(total("liquid", "clamps", "energy"), "had energy removed")
    report(total("liquid", "clamps", "corrections"), "corrections shortened")
    share(total("sheets", "unconverged"), "above `tolerance` of the sheets")
    if total("sheets", "overshot"):
        how.append(f"{total('sheets', 'overshot')} linearisations of sheets gained {total('sheets', 'overshot_energy'):.2g} J")
    report(total("smoke", "capped"), "steps of smoke too long")
    report(through, "particles below the sheet")
    last = frames[-1]
    parts = [last.get("liquid", {}).get(key, 0) for key in ("kinetic_energy", "potential_energy")]
    parts += [last["sheets"][key] for key in ("kinetic_energy", "elastic_energy", "potential_energy")]
    assert all(abs(part) < 1e300 for part in parts), frames
    figures = [f"{steps / len(frames):.0f}", f"{100 * last['sheets']['strain_max']:.2g} %", f"{sum(parts):.2g}"]
    if "liquid" in last["coupling"]:
        begun = at_start(last["particles"], change)
        figures[2] = f"{begun:.2g} → {figures[2]}"
        # One per cent allows for the work of gravity between the frames in the log.
        if sum(parts) > begun + 0.01 * (abs(begun) + sum(abs(part) for part in parts)):
            how.append("energy gained")
    return ("degraded" if how else "stable"), figures, "; ".join(how)


def value(frame, keys):
    for key in keys:
        frame = frame.get(key, {})
    return frame or 0


def at_start(particles, change):
    """Energy of the first frame [J]: all of the liquid's, and of the second sheet's motion."""
    spacing, rest_density = change.get("spacing", SPACING), change.get("rest_density", 1000.0)
    lid = "lid" in change.get("more", "")
    points = (change.get("cells", CELLS) + 1) ** 2 + (121 if lid else 0)
    mass = (particles - points) * rest_density * spacing**3
    g = -change.get("gravity", -9.81)
    energy = mass * (0.5 * change.get("speed", -2.0) ** 2 + g * 0.2)
    if lid:
        speed = float(change["more"].split("velocity = [0, 0, ")[1].split("]")[0])
        energy += 5 * 0.64 * (0.5 * speed**2 + g * 0.4)
    return energy


def write(tool):
    """Writes the tables of couplings."""
    print("# Stability: couplings\n")
    print(
        "A sheet of 1 m of 12 × 12 cells, 0.5 kg/m² and 2000 N/m, is held at its border. With liquid, 27 kg of water (216\n"
        "particles) fall onto it with 2 m/s. With smoke, a vortex ring rises to it in a wind. Shots have eight frames of 1/24 s.\n"
        "One setting changes at a time; every value is run by both integrators.\n\n"
        "- **stable**: nothing was limited, no particle is below the sheet, and the energy did not grow;\n"
        "- **degraded**: the shot is finite and complete, and its log reports what was limited, or particles got through;\n"
        "- **refused**: exit 2 or 20, with this message; the frames before it are kept.\n\n"
        "*Below the sheet* is computed from the particles' positions in the last frame. Strain is the largest of a spring at the\n"
        "end. Energy is of liquid and sheets together, at the start and at the end.\n"
    )
    for system, sweeps in (("liquid", LIQUID_SWEEPS), ("smoke", SMOKE_SWEEPS)):
        for heading, unit, values, change in sweeps:
            print(f"## {'Liquid' if system == 'liquid' else 'Smoke'}: {heading[0].lower()}{heading[1:]}\n")
            print(f"| value{f' [{unit}]' if unit else ''} | integrator | | substeps a frame | strain | energy [J] | reason |")
            print("|---|---|---|--:|--:|---|---|")
            for value in values:
                for integrator in INTEGRATORS:
                    word, figures, how = verdict(tool, change(value), integrator, system)
                    shown = " × ".join(f"{part:g}" for part in value) if isinstance(value, tuple) else f"{value:g}"
                    print(f"| {shown} | {integrator} | {word} | {' | '.join(figures)} | {how} |", flush=True)
            print()
