"""Smoke at the ends of its settings: a part of docs/stability.md (stability.py)."""

from stability_run import simulated

PRESET = """
title = "Stability"
frames = "1-{last}"
{collider}
[smoke]
spacing = {spacing}
tracers = 1
sample_every = 1
{smoke}
{bodies}
[smoke.flow]
{flow}
"""

RING = """[[smoke.ring]]
center = [{x}, 0, 0]
radius = {radius}
thickness = {thickness}
circulation = {circulation}
density = {density}
"""

SOURCE = "[[smoke.source]]\nshape = {{ sphere = {{ center = [0, 0, 0], radius = 0.2 }} }}\ntemperature = {}\n"
EMITTER = "[[smoke.emitter]]\nshape = { sphere = { center = [0, 0, 0], radius = 0.1 } }\nvelocity = [0, 0, 1]\nrate = 20\n"
REMESH = "remesh = { spacing = 0.05 }\n"
VISCOSITY = 'viscosity = {{ nu = {}, scheme = "{}" }}\n'
WAKE = REMESH + "viscosity = { nu = 1e-4, eddies = 0.2 }\n"
WIRE = "[[world.collider]]\nshape = { capsule = { from = [0, 0, -0.5], to = [0, 0, 0.5], radius = 0.045 } }\n"


def ring(x=0, radius=0.3, thickness=0.05, circulation=1, density=1):
    return RING.format(x=x, radius=radius, thickness=thickness, circulation=circulation, density=density)


def ball(radius, moves=""):
    return f"[[world.collider]]\nshape = {{ sphere = {{ center = [0, 0, 0], radius = {radius} }} }}\n{moves}\n"


def flown(speed):
    """A ball that flies through the ring along its axis, so fast [m/s]."""
    reach = speed * 4 / 24
    keys = f"{{ frame = 1, position = [0, 0, {-reach}] }}, {{ frame = 9, position = [0, 0, {reach}] }}"
    return ball(0.1, f"keyframes = [{keys}]")


def resized(radius, scale, frames):
    """A ball on the axis of the ring that is `scale` times as large after so many frames."""
    place = "position = [0, 0, 0.3]"
    return ball(radius, f"keyframes = [{{ frame = 1, {place} }}, {{ frame = {1 + frames}, {place}, scale = {scale} }}]")


# (heading, unit, values, how a value changes the shot)
SWEEPS = [
    ("Step limits (`flow.strain` and `flow.displacement`), times the default", "", [1, 3, 10, 30, 100],
     lambda value: {"flow": f"strain = {min(0.3 * value, 100)}\ndisplacement = {min(value, 100)}\n"}),
    ("Maximum number of steps (`flow.max_substeps`, with a circulation of 10 m²/s)", "", [1, 10, 200],
     lambda value: {"flow": f"max_substeps = {value}\n", "bodies": ring(circulation=10)}),
    ("Viscosity ν in units of σ²/Δt, by particle strength exchange", "", [0, 0.1, 0.5, 10, 1000],
     lambda value: {"flow": VISCOSITY.format(value * 0.075**2 * 24, "exchange") + REMESH}),
    ("Viscosity ν, by particle strength exchange", "m²/s", [1e-5, 1e9],
     lambda value: {"flow": VISCOSITY.format(value, "exchange")}),
    ("Viscosity ν, by core spreading", "m²/s", [1e-5, 1, 1e9],
     lambda value: {"flow": VISCOSITY.format(value, "spreading")}),
    ("Circulation of the ring", "m²/s", [0, 1e-20, 1, 100, 1e4, 1e6, 1e30],
     lambda value: {"bodies": ring(circulation=value)}),
    ("Distance of a stray ring of a tenth the size", "m", [10, 1e3, 1e5, 1e6, 1e9],
     lambda value: {"bodies": ring() + ring(x=value, radius=0.03, thickness=0.01), "flow": REMESH}),
    ("Number of coincident copies of the ring", "", [1, 3, 10],
     lambda value: {"bodies": ring() * (value + 1), "flow": REMESH}),
    ("Cores σ in spacings (`overlap`)", "", [0.8, 1.5, 4], lambda value: {"smoke": f"overlap = {value}\n"}),
    ("Spacing of the remeshing grid, relative to that of the vortons", "", [0.1, 0.5, 1, 4, 10, 100],
     lambda value: {"flow": f"remesh = {{ spacing = {0.05 * value} }}\n"}),
    ("Temperature of a ball of smoke above the air's", "K", [-1e6, -293, 0, 300, 1e6],
     lambda value: {"bodies": SOURCE.format(value), "smoke": "[smoke.buoyancy]"}),
    ("Rate of dissolving and cooling", "1/s", [0.1, 24, 1e6], lambda value: {"smoke": f"dissolve = {value}\ncooling = {value}"}),
    ("Wind at a ball that sheds", "m/s", [0.1, 1, 10, 30],
     lambda value: {"smoke": f"wind = [{value}, 0, 0]\n[smoke.shedding]", "collider": ball(0.15), "flow": WAKE}),
    ("Radius of a ball that sheds in wind of 3 m/s, in spacings", "", [0.1, 0.3, 0.9, 2, 4],
     lambda value: {"smoke": "wind = [3, 0, 0]\n[smoke.shedding]", "collider": ball(value * 0.05), "flow": WAKE}),
    ("Layer in which a wire of a radius of 0.9 spacings sheds, in spacings", "", [0.25, 1, 4],
     lambda value: {"smoke": f"wind = [3, 0, 0]\n[smoke.shedding]\nlayer = {value}", "collider": WIRE, "flow": WAKE}),
    ("Radius of a ball around an emitter of a radius of 0.1 m", "m", [0.05, 0.1, 0.4],
     lambda value: {"bodies": EMITTER, "collider": ball(value)}),
    ("Speed of a ball that flies through a ring", "m/s", [1, 10, 100], lambda value: {"collider": flown(value)}),
    ("Speed of the surface of a ball of 0.05 m that grows for eight frames", "m/s", [0.1, 1, 10, 100],
     lambda value: {"collider": resized(0.05, 1 + value * 8 / 24 / 0.05, 8)}),
    ("Frames in which a ball of 0.25 m shrinks to a thousandth (in a single one, at 6 m/s)", "", [24, 8, 1],
     lambda value: {"collider": resized(0.25, 1e-3, value)}),
]


# Extremes that need no preset or several, and where they are tested.
TESTS = [
    ("no vorton, one, two in one place and 1e-7 m apart", "tests/numerics/vortex_extremes.rs"),
    (
        "vortons that coincide, in heaps of two cores, collinear, coplanar, a million metres off; a heap is one source",
        "tests/numerics/vortex_extremes.rs`, `src/sim/vortex/octree.rs`, `src/sim/vortex/flow/gaussian_sums.rs",
    ),
    ("all of these in motion, with every term", "tests/numerics/vortex_dynamics/extremes.rs"),
    ("strengths over twelve decades, cores over three", "tests/numerics/vortex_extremes.rs"),
    ("thousands in one cell, strays at 1e6 m", "tests/numerics/vortex_dynamics/extremes.rs"),
    ("a step a hundred times too long", "tests/numerics/vortex_dynamics/extremes.rs"),
    ("ν = 0 and ν Δt/s² = 10", "tests/numerics/vortex_dynamics/viscosity.rs"),
    ("smoke so hot that ρ → 0, and below 0 K", "tests/numerics/smoke.rs"),
    ("rate · Δt > 1", "src/sim/smoke/tracers.rs"),
    ("an obstacle around the emitter", "tests/numerics/smoke.rs"),
    ("NaN in a state, and positions beyond the remeshing grid", "tests/numerics/vortex_dynamics/extremes.rs"),
    ("NaN in a preset", "tests/cli/smoke.rs"),
]

# Counts in a frame's record that make it degraded, and how they are reported.
LIMITED = {
    "capped": "steps longer than the limits",
    "clamped": "strengths cut",
    "smothered": "tracers not emitted, inside solids",
    "returned_vortons": "vortons projected out of solids",
    "returned_tracers": "tracers projected out of solids",
}


def preset(change):
    values = {"last": 9, "spacing": 0.05, "collider": "", "smoke": "", "bodies": ring(), "flow": "", **change}
    return PRESET.format(**values)


def verdict(tool, text):
    """(verdict, reason) of one shot."""
    with simulated(tool, text) as (ran, frames, _):
        words = " ".join(ran.stderr.split())
    if ran.returncode in (2, 20) and "error: " in words:
        return "refused", words[words.rindex("error: ") + 7 :].replace("|", "/")
    if ran.returncode != 0:
        raise SystemExit(f"exit {ran.returncode}: {words}\n{text}")
    return judge([frame["smoke"] for frame in frames])


def judge(frames):
    """Stable if nothing was limited and the velocity kept its error; else degraded, with the reasons."""
    assert len(frames) == 8, frames
    total = lambda key: sum(frame[key] for frame in frames)
    steps, how = total("substeps"), []
    for key, what in LIMITED.items():
        if total(key):
            how.append(f"{total(key)} {what}" if key != "capped" else f"{total(key)} of {steps} {what}")
    # Velocities next to zero have no relative error.
    error = max((frame.get("error") or 0) for frame in frames)
    if error > 5e-3:
        how.append(f"velocities off by {100 * error:.2g} %")
    for key, limit, what in (("through_flow", 0.5, "leakage of solids"), ("unsolved", 0.01, "of the flow through panels left")):
        part = max((frame.get(key) or 0) for frame in frames)
        if part > limit:
            how.append(f"{100 * part:.0f} % {what}")
    impulses = [abs(component) for frame in frames for component in frame["invariants"]["impulse"]]
    assert all(value < 1e300 for value in impulses), frames
    return ("degraded" if how else "stable"), "; ".join(how)


def write(tool):
    """Writes the tables of smoke."""
    print("# Stability: smoke\n")
    print(
        "A ring of a radius of 0.3 m and a circulation of 1 m²/s in vortons 0.05 m apart flies for eight frames of 1/24 s. One\n"
        "setting changes at a time.\n\n"
        "- **stable**: nothing was limited, and velocities are within 0.5 % of the sum over all pairs;\n"
        "- **degraded**: the shot is finite and complete, and its log reports what was limited, or what was projected out of\n"
        "  solids;\n"
        "- **refused**: exit 2 or 20, with this message; the frames before it are kept.\n\n"
        "Further extremes are tests:\n\n"
        "| extreme | test |\n|---|---|\n" + "\n".join(f"| {what} | `{test}` |" for what, test in TESTS) + "\n"
    )
    for heading, unit, values, change in SWEEPS:
        print(f"## {heading}\n")
        print(f"| value{f' [{unit}]' if unit else ''} | | reason |\n|---|---|---|")
        for value in values:
            word, how = verdict(tool, preset(change(value)))
            print(f"| {value:g} | {word} | {how} |", flush=True)
        print()
