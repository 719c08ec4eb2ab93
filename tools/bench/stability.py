#!/usr/bin/env python3
"""Writes docs/stability.md: at which values of each setting a shot is stable, degraded, wrong or refused.

    cargo build --release
    python3 tools/bench/stability.py target/release/meniscus > docs/stability.md
    python3 tools/bench/stability.py target/release/meniscus sheets     one system alone; couplings need numpy, zstandard

Systems: liquid (here), smoke (stability_smoke.py), sheets (stability_sheets.py), couplings (stability_couplings.py). One
setting changes at a time. Of the liquid, a block of 512 particles falls onto the floor of a tank for eight frames, with
the terms of the built-in presets, and without terms by both solvers. No row depends on wall-clock time.
"""
import pathlib
import sys

import stability_couplings
import stability_sheets
import stability_shots
import stability_smoke
from stability_run import simulated

# Terms of the built-in presets of splashes; the surface tension is in N/m per squared spacing.
PRESETS = {"implicitness": "0.25", "xsph": "{}", "vorticity": "{ strength = 0.5 }"}
TENSION = 0.5 * 9.81
# Name, solver, whether it has the terms of the presets.
VARIANTS = [("presets", "accelerated", True), ("accelerated", "accelerated", False), ("jacobi", "jacobi", False)]

# Lengths scale with the spacing, so that every shot has the same particles.
PRESET = """
title = "Stability"
frames = "1-9"

[world]
gravity = [{sideways}, 0, {gravity}]

[[world.collider]]
shape = {{ {collider} }}

[liquid]
spacing = {spacing}
density = {density}
solver = "{solver}"
{terms}

[[liquid.source]]
velocity = [0, 0, {speed}]
shape = {{ box = {{ min = [{at}, {at}, {low}], max = [{side}, {side}, {top}] }} }}
"""

TANK = "tank = {{ min = [{at}, {at}, 0], max = [{wide}, {side}, {high}] }}"
PLATE = "plane = {{ point = [0, 0, 0], normal = [0, 0, 1] }}"
NOTHING = "plane = {{ point = [0, 0, -1e5], normal = [0, 0, 1] }}"

USUAL = {"collider": TANK, "gravity": -9.81, "sideways": 0, "spacing": 0.1, "density": 1000, "speed": 0, "at": 0, "terms": {}}


def term(key):
    return lambda value: {"terms": {key: value}}


def substeps(value):
    return {"terms": {"min_substeps": value, "max_substeps": value}}


# (heading, unit, values, how a value changes the shot)
SWEEPS = [
    ("Substeps a frame of 1/24 s (`min_substeps` = `max_substeps`)", "", [1, 2, 4, 8, 16, 64, 256], substeps),
    ("Maximum number of substeps (`max_substeps`, at 50 m/s)", "", [8, 32, 100, 1000],
     lambda value: {"speed": -50, "terms": {"max_substeps": value}}),
    ("Spacing", "m", [1e-4, 1e-3, 1e-2, 0.1, 1, 10], lambda value: {"spacing": value}),
    ("Speed at the start", "m/s", [0, 1, 10, 100, 500, 1e4, 1e6, 1e9], lambda value: {"speed": -value}),
    ("Gravity", "m/s²", [0, 0.1, 9.81, 98.1, 981, 9810, 1e6, 1e12, 1e30], lambda value: {"gravity": -value}),
    ("Gravity upwards, over a plate", "m/s²", [9.81, 9810, 1e6, 1e9, 1e12, 1e30],
     lambda value: {"gravity": value, "collider": PLATE}),
    ("Gravity sideways, with 9.81 m/s² downwards", "m/s²", [0.1, 9.81, 98.1, 981], lambda value: {"sideways": value}),
    ("Speed in free flight, without gravity", "m/s", [0, 1, 10, 100, 500],
     lambda value: {"gravity": 0, "speed": value, "collider": NOTHING}),
    ("Free fall, frames of 1/24 s with a gravity of", "m/s²", [0.1, 9.81, 98.1], lambda value: {"gravity": -value, "collider": NOTHING}),
    ("Distance of the tank from the origin along x and y", "m", [1, 100, 1e4, 1e5, 1e6], lambda value: {"at": value}),
    ("Kernel support (`kernel_radius`)", "spacings", [1.8, 2, 2.2, 2.5], term("kernel_radius")),
    ("CFL number (`cfl`)", "", [0.01, 0.1, 0.8, 2, 10], term("cfl")),
    ("Density deviation (`density_dev`)", "", [1e-5, 1e-3, 1e-2, 0.1, 1], term("density_dev")),
    ("Implicitness of directions (`implicitness`)", "", [0, 0.1, 0.25, 0.5, 1], term("implicitness")),
    ("Surface tension (`surface_tension.coefficient`)", "N/m", [0, 0.072, 10, 50, 200, 1000],
     lambda value: {"terms": {"surface_tension": f"{{ coefficient = {value} }}"}}),
    ("Viscosity (`viscosity.dynamic`)", "Pa·s", [1e-3, 1, 100, 1e4], lambda value: {"terms": {"viscosity": f"{{ dynamic = {value} }}"}}),
    ("XSPH (`xsph.strength`)", "", [0, 0.01, 0.1, 0.5, 1], lambda value: {"terms": {"xsph": f"{{ strength = {value} }}"}}),
    ("Vorticity confinement (`vorticity.strength`)", "", [0, 0.5, 5, 10], lambda value: {"terms": {"vorticity": f"{{ strength = {value} }}"}}),
    ("Drops of water, 0.072 N/m, without gravity: spacing", "m", [1e-4, 1e-3, 1e-2],
     lambda value: {"spacing": value, "gravity": 0, "collider": NOTHING, "terms": {"surface_tension": "{ coefficient = 0.072 }", "kernel_radius": 2.5}}),
    ("Lakes: spacing", "m", [10, 100, 1000], lambda value: {"spacing": value}),
    ("Iterations a substep (`iterations`)", "", [1, 2, 4, 10, 50, 200, 1000], term("iterations")),
    ("Softening ε (`softening`)", "", [0, 1e-4, 1e-2, 1, 100, 1000], term("softening")),
    ("Density ρ₀ (`density`)", "kg/m³", [1e-3, 1, 1000, 2e4, 1e9], lambda value: {"density": value}),
]


def preset(change, solver, with_terms):
    values = {**USUAL, **change}
    s, at = values["spacing"], values["at"]
    usual = {**PRESETS, "surface_tension": f"{{ coefficient = {min(TENSION * values['density'] * s * s, 1000)} }}"} if with_terms else {}
    terms = "\n".join(f"{key} = {value}" for key, value in {**usual, **values["terms"]}.items())
    lengths = {"side": at + 8 * s, "wide": at + 16 * s, "high": 40 * s, "low": 2 * s, "top": 10 * s}
    numbers = {key: repr(float(value)) for key, value in {**values, **lengths}.items() if key not in ("terms", "collider")}
    collider = values["collider"].format(**numbers)
    return PRESET.format(**numbers, collider=collider, terms=terms, solver=solver)


def verdict(tool, text):
    """(verdict, reason) of one shot."""
    with simulated(tool, text) as (ran, lines, _):
        words = " ".join(ran.stderr.split())
    if ran.returncode == 20:
        return "refused", words[words.rindex("error: ") + 7:].replace("|", "/")
    if ran.returncode != 0:
        raise SystemExit(f"exit {ran.returncode}: {words}\n{text}")
    seeded = lines[0]["particles"]
    if seeded != 512:
        return "wrong", f"{seeded} of 512 particles seeded" + ("; warned" * ("world's origin" in words))
    return judge([line["liquid"] for line in lines])


# Change of volume beyond which a finite result is wrong; `shot` warns at the same.
MAX_VOLUME_CHANGE = 0.03

# Largest compression and largest dilation of the bulk, mean over the particles, of a stable shot.
MAX_DEVIATION = 0.0101


def judge(frames):
    """Wrong if the volume changed; else stable if nothing was limited and every frame is near rest density; else degraded. With
    the reasons."""
    assert len(frames) == 8, frames
    total = lambda read: sum(read(frame) for frame in frames)
    steps = total(lambda frame: frame["substeps"])
    how = []
    share = lambda count, what: how.append(f"{count} of {steps} substeps {what}") if count else None
    share(total(lambda frame: frame["cfl_capped"]), "longer than the CFL rule")
    share(total(lambda frame: frame["unconverged"]), "above their deviation")
    share(total(lambda frame: frame["clamps"]["energy"]), "had energy removed")
    share(total(lambda frame: frame["clamps"]["confinement"]), "limited confinement")
    share(total(lambda frame: frame["clamps"]["micropolar"]), "limited the micropolar exchange")
    shortened = total(lambda frame: frame["clamps"]["corrections"])
    if shortened:
        made = 512 * total(lambda frame: frame["iterations"])
        how.append(f"{shortened} of {made} corrections shortened")
    slowed = total(lambda frame: frame["clamps"]["momentum"])
    if slowed:
        how.append(f"iteration slowed {slowed} time{'s' * (slowed > 1)}")
    contacts = total(lambda frame: frame["clamps"]["contacts"])
    if contacts:
        how.append(f"{contacts} contacts unresolved")
    inside = max(frame["particles_inside_solids"] for frame in frames)
    if inside:
        how.append(f"{inside} particles inside solids")
    for key, word in [("compression_avg", "compressed"), ("dilation_avg", "dilated")]:
        largest = max(frame[key] for frame in frames)
        if largest > MAX_DEVIATION:
            how.append(f"{word} by {100 * largest:.2g} % in the mean")
    change = max((frame["volume_change"] for frame in frames), key=abs)
    if not abs(change) <= MAX_VOLUME_CHANGE:
        return "wrong", "; ".join([f"volume {100 * change:+.2g} %", *how])
    return ("degraded" if how else "stable"), "; ".join(how)


def main():
    tool = str(pathlib.Path(sys.argv[1]).resolve())
    parts = {"liquid": write, "smoke": stability_smoke.write, "sheets": stability_sheets.write,
             "couplings": stability_couplings.write, "shots": stability_shots.write}
    for name in sys.argv[2:] or parts:
        parts[name](tool)


def summary(rows):
    """The values with each verdict, a line each; `rows` are (heading, value, variant, verdict)."""
    lines = []
    for word in ("stable", "degraded", "wrong", "refused"):
        found = [row for row in rows if row[3] == word]
        lines.append(f"- **{word}**: {len(found)} of {len(rows)} rows; of those with the terms of the presets "
                     f"{sum(variant == 'presets' for _, _, variant, _ in found)}.")
    wrong = {}
    for heading, value, variant, word in rows:
        if word == "wrong":
            wrong.setdefault(heading, []).append(f"{value:g} ({variant})")
    return [*lines, "", "Wrong are:" if wrong else "Nothing is wrong.", "", *(f"- {heading}: {', '.join(values)}" for heading, values in wrong.items())]


def write(tool):
    """Writes the tables of the liquid."""
    tables, rows = [], []
    for heading, unit, values, change in SWEEPS:
        tables.append(f"## {heading}\n")
        tables.append(f"| value{f' [{unit}]' if unit else ''} | terms or solver | | reason |\n|---|---|---|---|")
        for value in values:
            for name, solver, with_terms in VARIANTS:
                word, how = verdict(tool, preset(change(value), solver, with_terms))
                rows.append((heading, value, name, word))
                tables.append(f"| {value:g} | {name} | {word} | {how} |")
        tables.append("")
    print("# Stability: liquid\n")
    print("Look up a setting of [smoke](#stability-smoke), [sheets](#stability-sheets), [couplings](#stability-couplings), of\n"
          "[inflow, forces and bodies](#stability-shots), or of the liquid below. Written by `tools/bench/stability.py`; do not edit:\n")
    print("```sh\ncargo build --release\npython3 tools/bench/stability.py target/release/meniscus > docs/stability.md\n```\n")
    print(
        "A block of 8 × 8 × 8 particles falls by two spacings onto the floor of a tank twice as wide, for eight frames\n"
        "of 1/24 s. One setting changes at a time; the others are the defaults, with a spacing of 0.1 m. All lengths\n"
        "scale with the spacing. *Presets* has the terms of the built-in presets of splashes: XSPH, vorticity confinement, a surface\n"
        "tension of half of density × 9.81 m/s² × spacing² (at most 1000 N/m), and early directions; the other rows have no terms.\n\n"
        "- **stable**: nothing was limited, and compression and dilation of the bulk each stayed within 1 % in every frame;\n"
        "- **degraded**: the shot is finite and complete, and its log reports what was limited;\n"
        "- **wrong**: the shot is finite and complete, but its volume changed by more than 3 % in some frame; the shot warns;\n"
        "- **refused**: exit 20, with this message; the frames before it are kept.\n"
    )
    print("\n".join([*summary(rows), "", *tables]))


if __name__ == "__main__":
    main()
