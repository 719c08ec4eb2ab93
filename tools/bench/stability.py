#!/usr/bin/env python3
"""Writes docs/stability.md: at which values of each setting a shot is stable, degraded, wrong or refused.

    cargo build --release
    python3 tools/bench/stability.py target/release/meniscus > docs/stability.md
    python3 tools/bench/stability.py target/release/meniscus sheets     one system alone; couplings need numpy, zstandard

Systems: liquid (here), smoke (stability_smoke.py), sheets (stability_sheets.py), couplings (stability_couplings.py). One
setting changes at a time. Of the liquid, a block of 512 particles falls onto the floor of a tank for eight frames, with
both solvers. No row depends on wall-clock time.
"""
import json
import pathlib
import subprocess
import sys
import tempfile

import stability_couplings
import stability_sheets
import stability_smoke

SOLVERS = ["accelerated", "jacobi"]

# Lengths scale with the spacing, so that every shot has the same particles.
PRESET = """
title = "Stability"
frames = "1-9"

[world]
gravity = [0, 0, {gravity}]

[[world.collider]]
shape = {{ {collider} }}

[liquid]
spacing = {spacing}
density = {density}
solver = "{solver}"
{terms}

[[liquid.source]]
velocity = [0, 0, {speed}]
shape = {{ box = {{ min = [0, 0, {low}], max = [{side}, {side}, {top}] }} }}
"""

TANK = "tank = {{ min = [0, 0, 0], max = [{wide}, {side}, {high}] }}"
PLATE = "plane = {{ point = [0, 0, 0], normal = [0, 0, 1] }}"

USUAL = {"collider": TANK, "gravity": -9.81, "spacing": 0.1, "density": 1000, "speed": 0, "terms": {}}


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
    ("Iterations a substep (`iterations`)", "", [1, 2, 4, 10, 50, 200, 1000], term("iterations")),
    ("Softening ε (`softening`)", "", [0, 1e-4, 1e-2, 1, 100, 1000], term("softening")),
    ("Density ρ₀ (`density`)", "kg/m³", [1e-3, 1, 1000, 2e4, 1e9], lambda value: {"density": value}),
]


def preset(change, solver):
    values = {**USUAL, **change}
    s = values["spacing"]
    terms = "\n".join(f"{key} = {value}" for key, value in values["terms"].items())
    lengths = {"side": 8 * s, "wide": 16 * s, "high": 40 * s, "low": 2 * s, "top": 10 * s}
    numbers = {key: repr(float(value)) for key, value in {**values, **lengths}.items() if key not in ("terms", "collider")}
    collider = values["collider"].format(**numbers)
    return PRESET.format(**numbers, collider=collider, terms=terms, solver=solver)


def verdict(tool, text):
    """(verdict, reason) of one shot."""
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder)
        (path / "shot.toml").write_text(text)
        ran = subprocess.run([tool, "simulate", "shot.toml", "-o", "out"], cwd=path, capture_output=True, text=True)
        log = path / "out" / "log.jsonl"
        lines = [json.loads(line) for line in log.read_text().splitlines()] if log.exists() else []
    words = " ".join(ran.stderr.split())
    if ran.returncode == 20:
        return "refused", words[words.rindex("error: ") + 7:].replace("|", "/")
    if ran.returncode != 0:
        raise SystemExit(f"exit {ran.returncode}: {words}\n{text}")
    assert all(line["particles"] == 512 for line in lines), lines
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
    share(total(lambda frame: frame["unconverged"]), "above `density_dev`")
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
             "couplings": stability_couplings.write}
    for name in sys.argv[2:] or parts:
        parts[name](tool)


def write(tool):
    """Writes the tables of the liquid."""
    print("# Stability: liquid\n")
    print("Look up a setting of [smoke](#stability-smoke), [sheets](#stability-sheets), [couplings](#stability-couplings), or of\n"
          "the liquid below. Written by `tools/bench/stability.py`; do not edit:\n")
    print("```sh\ncargo build --release\npython3 tools/bench/stability.py target/release/meniscus > docs/stability.md\n```\n")
    print(
        "A block of 8 × 8 × 8 particles falls by two spacings onto the floor of a tank twice as wide, for eight frames\n"
        "of 1/24 s. One setting changes at a time; the others are the defaults, with a spacing of 0.1 m. All lengths\n"
        "scale with the spacing.\n\n"
        "- **stable**: nothing was limited, and compression and dilation of the bulk each stayed within 1 % in every frame;\n"
        "- **degraded**: the shot is finite and complete, and its log reports what was limited;\n"
        "- **wrong**: the shot is finite and complete, but its volume changed by more than 3 % in some frame; the shot warns;\n"
        "- **refused**: exit 20, with this message; the frames before it are kept.\n"
    )
    for heading, unit, values, change in SWEEPS:
        print(f"## {heading}\n")
        print(f"| value{f' [{unit}]' if unit else ''} | solver | | reason |\n|---|---|---|---|")
        for value in values:
            for solver in SOLVERS:
                word, how = verdict(tool, preset(change(value), solver))
                print(f"| {value:g} | {solver} | {word} | {how} |")
        print()


if __name__ == "__main__":
    main()
