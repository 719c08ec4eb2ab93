"""Inflow, forces, floating bodies, colliders that grow, and several viscosities at the ends of their settings: a part of docs/stability.md
(stability.py)."""

import math

from stability_run import refusal, simulated

SPACING = 0.1
PRESET = """
title = "Stability"
frames = "1-9"
fps = 24

[world]
gravity = [0, 0, {gravity!r}]
[[world.collider]]
shape = {{ tank = {{ min = [0, 0, 0], max = [1.6, 1.6, 3.2] }} }}
{collider}

[liquid]
spacing = 0.1
{liquid}
[[liquid.source]]
shape = {{ box = {{ min = [0, 0, 0], max = [1.6, 1.6, 0.8] }} }}
{source}
[liquid.surface_tension]
coefficient = 49
[liquid.xsph]
strength = 0.01
{more}
"""
USUAL = {"gravity": -9.81, "collider": "", "liquid": "", "source": "", "more": ""}


def body(side=0.4, height=1.2, density=500.0, speed=0.0, spin=0.0, rest="", at=0.8):
    half = 0.5 * side
    return f"""
[[body]]
shape = {{ box = {{ min = [{-half}, {-half}, {-half}], max = [{half}, {half}, {half}] }} }}
position = [{at}, 0.8, {height}]
density = {density!r}
velocity = [0, 0, {-speed!r}]
angular_velocity = [0, {spin!r}, {0.5 * spin!r}]
{rest}
"""


def stack(count):
    return "".join(body(side=0.3, height=1.0 + 0.31 * place, at=0.8 + 0.02 * (place % 3)) for place in range(count))


def nozzle(radius=0.2, height=2.0, speed=2.0, down=-1):
    return f"""
[[liquid.emitter]]
shape = {{ disc = {{ center = [0.8, 0.8, {height}], normal = [0, 0, {down}], radius = {radius!r} }} }}
velocity = [0, 0, {down * speed!r}]
"""


def force(kind, **values):
    text = ", ".join(f"{key} = {value}" for key, value in values.items())
    return f"[[force]]\nsystems = [\"liquid\"]\nkind = {{ {kind} = {{ {text} }} }}\n"


def growing(speed):
    """A ball under water whose surface moves outwards with `speed` [m/s] in the first four frames, to twice its radius at most."""
    grown = min(2.0, 1.0 + speed * 4 / 24 / 0.25)
    frames = (grown - 1.0) * 0.25 / speed * 24 if speed else 1.0
    return f"""
[[world.collider]]
shape = {{ sphere = {{ center = [0, 0, 0], radius = 0.25 }} }}
keyframes = [{{ frame = 1, position = [0.8, 0.8, 0.3] }}, {{ frame = {1 + max(1, round(frames))}, position = [0.8, 0.8, 0.3], scale = {grown!r} }}]
"""


def viscosities(ratio):
    return {"liquid": "viscosity = { dynamic = 1 }", "source": f"viscosity = {ratio!r}",
            "more": '[[liquid.source]]\nshape = { box = { min = [0.4, 0.4, 0.9], max = [1.2, 1.2, 1.4] } }\n'}


# (heading, unit, values, how a value changes the shot)
SWEEPS = [
    ("Bodies: density, of a box that falls onto water", "kg/m³", [1e-3, 1.0, 30.0, 100.0, 500.0, 1000.0, 1e4, 1e6, 1e9],
     lambda value: {"more": body(density=value)}),
    ("Bodies: speed of the fall", "m/s", [0.0, 5.0, 20.0, 100.0, 1e3, 1e5], lambda value: {"more": body(speed=value)}),
    ("Bodies: side of the box", "m", [0.05, 0.1, 0.2, 0.4, 1.2], lambda value: {"more": body(side=value, height=0.9 + 0.5 * value)}),
    ("Bodies: angular velocity", "deg/s", [0.0, 360.0, 3600.0, 1e5, 1e7], lambda value: {"more": body(spin=value)}),
    ("Bodies: restitution, of a box that falls onto a plate of the tank through shallow water", "", [0.0, 0.5, 1.0],
     lambda value: {"more": body(density=8000.0, speed=5.0, rest=f"restitution = {value}")}),
    ("Bodies: number in a stack above the water", "", [1, 2, 4, 6], lambda value: {"more": stack(value)}),
    ("Bodies: gravity", "m/s²", [0.0, 98.1, 981.0, 1e5], lambda value: {"gravity": -value, "more": body()}),
    ("Inflow: speed", "m/s", [0.1, 1.0, 10.0, 50.0], lambda value: {"more": nozzle(speed=value)}),
    ("Inflow: radius of the nozzle", "m", [0.03, 0.06, 0.1, 0.2, 0.6], lambda value: {"more": nozzle(radius=value)}),
    ("Inflow: height of the nozzle above the floor, in water below 0.8 m", "m", [0.05, 0.2, 0.5, 0.8, 1.5],
     lambda value: {"more": nozzle(height=value)}),
    ("Inflow: distance of the nozzle from a ceiling that it points at", "m", [0.05, 0.1, 0.3, 1.0],
     lambda value: {"more": nozzle(height=3.2 - value, down=1)}),
    ("Forces: uniform acceleration along x", "m/s²", [1.0, 100.0, 1e4, 1e6, 1e12],
     lambda value: {"more": force("uniform", acceleration=[value, 0.0, 0.0])}),
    ("Forces: strength of a point that attracts, 0.4 m deep", "m/s²", [1.0, 100.0, 1e4, 1e6],
     lambda value: {"more": force("point", center=[0.8, 0.8, 0.4], strength=-value, radius=0.3)}),
    ("Forces: strength of a vortex", "m/s²", [1.0, 100.0, 1e4, 1e6],
     lambda value: {"more": force("vortex", center=[0.8, 0.8, 0.4], axis=[0, 0, 1], strength=value, radius=0.3)}),
    ("Forces: strength of turbulence", "m/s²", [1.0, 100.0, 1e4, 1e6],
     lambda value: {"more": force("turbulence", strength=value, scale=0.4, period=0.5)}),
    ("Forces: rate of drag towards 5 m/s along x", "1/s", [0.1, 10.0, 1e3, 1e6, 1e12],
     lambda value: {"more": force("drag", velocity=[5.0, 0.0, 0.0], rate=value)}),
    ("Colliders that grow: speed of the surface of a ball under water", "m/s", [0.1, 0.5, 1.5, 5.0],
     lambda value: {"collider": growing(value)}),
    ("Viscosity by source: over that of liquid of 1 Pa·s that falls onto it", "", [1e-6, 1e-3, 1.0, 1e3, 1e6, 1e8], viscosities),
]


def verdict(tool, change):
    """(verdict, figures, reason) of one shot."""
    text = PRESET.format(**{**USUAL, **change})
    with simulated(tool, text) as (ran, frames, _):
        if ran.returncode in (2, 20):
            return "refused", ["", ""], refusal(ran.stderr)
        if ran.returncode != 0:
            raise SystemExit(f"exit {ran.returncode}: {' '.join(ran.stderr.split())}\n{text}")
    return judge(frames, "the liquid's volume is off by" in ran.stderr)


# Change of volume beyond which a finite result is wrong, and largest mean compression and dilation of a stable one, as for liquid alone.
MAX_VOLUME_CHANGE, MAX_DEVIATION = 0.03, 0.0101


def judge(frames, has_warned):
    """Wrong if the volume changed, or what is not finite got into the log; stable if nothing was limited or left out; else degraded."""
    assert len(frames) == 8, frames
    liquids = [frame["liquid"] for frame in frames]
    steps = sum(liquid["substeps"] for liquid in liquids)
    how = []
    report = lambda count, what: how.append(f"{count:g} {what}") if count else None
    share = lambda count, what: how.append(f"{count} of {steps} substeps {what}") if count else None
    total = lambda read: sum(read(liquid) for liquid in liquids)
    share(total(lambda liquid: liquid["cfl_capped"]), "longer than the CFL rule")
    share(total(lambda liquid: liquid["unconverged"]), "above `density_dev`")
    share(total(lambda liquid: liquid["viscosity_unconverged"]), "above the tolerance of viscosity")
    share(total(lambda liquid: liquid["clamps"]["energy"]), "had energy removed")
    report(total(lambda liquid: liquid["clamps"]["corrections"]), "corrections shortened")
    report(max(liquid["particles_inside_solids"] for liquid in liquids), "particles inside solids")
    flow = lambda key: total(lambda liquid: sum_of(liquid.get("flow", {}).get(key, 0)))
    report(flow("blocked_by_solids"), "particles of nozzles left out at solids")
    report(flow("blocked_by_liquid"), "particles of nozzles left out at liquid")
    report(flow("left_by_accident"), "particles left the shot")
    report(total(lambda liquid: liquid.get("forces", {}).get("limited", 0)), "accelerations limited")
    bodies = [frame["bodies"] for frame in frames if "bodies" in frame]
    report(sum(record["capped"] for record in bodies), "substeps of bodies longer than their speed allows")
    depth = max((record["penetration"] for record in bodies), default=0.0)
    if depth > 0.05:
        how.append(f"bodies {100 * depth:.2g} % of their inner radius inside others")
    for key, word in [("compression_avg", "compressed"), ("dilation_avg", "dilated")]:
        largest = max(liquid[key] for liquid in liquids)
        if largest > MAX_DEVIATION:
            how.append(f"{word} by {100 * largest:.2g} % in the mean")
    change = max((liquid["volume_change"] for liquid in liquids), key=abs)
    figures = [f"{steps / len(frames):.0f}", f"{100 * change:+.2g} %"]
    energies = [record[key] for record in liquids + bodies for key in ("kinetic_energy", "potential_energy")]
    if not (abs(change) <= MAX_VOLUME_CHANGE and all(math.isfinite(energy) for energy in energies)):
        return "wrong", figures, "; ".join([*how, *([] if has_warned else ["no warning"])])
    return ("degraded" if how else "stable"), figures, "; ".join(how)


def sum_of(value):
    return sum(value) if isinstance(value, list) else value


def write(tool):
    """Writes the tables of what shots add to a liquid."""
    print("# Stability: shots\n")
    print(
        "A pool of 16 × 16 × 8 particles, 0.1 m apart, in a tank of 1.6 m, with the surface tension and XSPH of the presets of splashes; eight\n"
        "frames of 1/24 s. Each shot adds one thing to it, of which one setting changes. A body is a box of 0.4 m and 500 kg/m³ 0.2 m above the\n"
        "water; a nozzle has a radius of 0.2 m, 2 m above the floor, and pours with 2 m/s.\n\n"
        "- **stable**: nothing was limited or left out, and compression and dilation of the bulk each stayed within 1 % in every frame;\n"
        "- **degraded**: the shot is finite and complete, and its log reports what was limited;\n"
        "- **wrong**: the shot is finite and complete, but its volume changed by more than 3 % in some frame; the shot warns;\n"
        "- **refused**: exit 2 or 20, with this message; the frames before it are kept.\n"
    )
    for heading, unit, values, change in SWEEPS:
        print(f"## {heading}\n")
        print(f"| value{f' [{unit}]' if unit else ''} | | substeps a frame | volume | reason |")
        print("|---|---|--:|--:|---|")
        for value in values:
            word, figures, how = verdict(tool, change(value))
            print(f"| {value:g} | {word} | {' | '.join(figures)} | {how} |", flush=True)
        print()
