"""Sheets at the ends of their settings: a part of docs/stability.md (stability.py)."""

from stability_run import refusal, simulated

INTEGRATORS = ["symplectic", "implicit"]

PRESET = """
title = "Stability"
frames = "1-9"
fps = {fps}
{collider}
[[sheet]]
name = "cloth"
shape = {shape}
density = {density}
stiffness = [{stiffness}, {stiffness}]
{pin}
{terms}
{more}
[sheets]
{common}
[sheets.solver]
integrator = "{integrator}"
{solver}
"""

GRID = "{{ grid = {{ origin = [-0.5, -0.5, {height}], first = [1, 0, 0], second = [0, 1, 0], cells = [{cells[0]}, {cells[1]}] }} }}"
CORNERS = 'pin = [{ at = "corners" }]'
REPULSION = "repulsion = { energy = 0.1, range = 0.01 }"


def grid(cells=(12, 12), height=0):
    return GRID.format(cells=cells, height=height)


def solid(shape):
    return f"[[world.collider]]\nshape = {{ {shape} }}\n"


def torus(hole, height):
    """A torus whose hole has this radius, below the sheet or through it."""
    return solid(f"torus = {{ center = [0, 0, {height}], axis = [0, 0, 1], radius = {hole + 0.15}, tube = 0.15 }}")


def led(metres, stiffness):
    """A pinned point that moves so far in one frame."""
    soft = f"stiffness = {stiffness}, " if stiffness else ""
    keys = f"{{ frame = 1 }}, {{ frame = 2 }}, {{ frame = 3, position = [{metres}, 0, 0] }}"
    return {"pin": f"pin = [{{ at = {{ points = [0] }}, {soft}keyframes = [{keys}] }}]", "stiffness": 200}


def heavy(ratio):
    """A disc in the middle that is so much heavier."""
    region = f"region = [{{ shape = {{ sphere = {{ center = [0, 0, 0], radius = 0.2 }} }}, density = {ratio!r} }}]"
    return {"terms": region, "density": 1e-3, "stiffness": 1e4}


def held(count):
    return {"pin": f"pin = [{{ at = {{ points = {list(range(count))} }} }}]"}


# (heading, unit, values, how a value changes the shot)
SWEEPS = [
    ("Stiffness of the springs (`stiffness`)", "N/m", [10.0**power for power in range(-3, 10)],
     lambda value: {"stiffness": value}),
    ("Rest length, as a fraction of the length (`rest`, without pins)", "", [0, 1e-3, 0.5, 1, 2],
     lambda value: {"terms": f"rest = [{value}, {value}]\nshear = 2", "pin": "", "stiffness": 5}),
    ("Cells along the two directions", "", [(0, 0), (1, 0), (0, 1), (100, 0), (1, 1), (1, 100)],
     lambda value: {"shape": grid(value), "terms": "shear = 3\nbending = 0.001"}),
    ("Coincident points: width of a grid whose neighbours single precision rounds to one place", "m", [1e-3, 1e-9, 1e-30, 0],
     lambda value: {"shape": grid().replace("first = [1, 0, 0]", f"first = [{value!r}, 0, 0]")}),
    ("Mass ratio of a disc to the rest of the sheet", "", [1, 1e3, 1e6], heavy),
    ("Length of frames, times 1/24 s", "", [1, 10, 100, 1000],
     lambda value: {"fps": 24 / value, "terms": "damping = 1"}),
    ("Substeps a frame of the implicit integrator, with springs of 1e6 N/m", "", [1, 8, 100],
     lambda value: {"stiffness": 1e6, "solver": f"substeps = {value}"}),
    ("Maximum number of substeps (`max_substeps`, at 1e5 N/m)", "", [3, 100, 1000],
     lambda value: {"stiffness": 1e5, "solver": f"max_substeps = {value}"}),
    ("Pinned points, of 169", "", [0, 1, 168, 169], lambda value: held(value) if value else {"pin": ""}),
    ("Distance that an exact pin moves in one frame", "m", [1, 100, 1e4, 1e7], lambda value: led(value, 0)),
    ("The same with a spring of 500 N/m", "m", [1, 100, 1e4, 1e7], lambda value: led(value, 500)),
    ("Radius of a ball around the middle of the sheet at the start", "m", [0.05, 0.3, 2],
     lambda value: {"collider": solid(f"sphere = {{ center = [0, 0, 0], radius = {value} }}"), "pin": "", "common": REPULSION}),
    ("The same without repulsion", "m", [0.05, 0.3, 2],
     lambda value: {"collider": solid(f"sphere = {{ center = [0, 0, 0], radius = {value} }}"), "pin": ""}),
    ("Distance that points keep from a ball of 0.3 m, 1 cm below the sheet (`clearance`)", "m", [0, 0.009, 0.3, 1000],
     lambda value: {"collider": solid("sphere = { center = [0, 0, -0.31], radius = 0.3 }"), "pin": "", "common": f"clearance = {value}"}),
    ("Radius of the hole of a torus below the sheet; cells of 0.083 m", "m", [0.3, 0.04, 0.001],
     lambda value: {"collider": torus(value, -0.16), "pin": "", "common": REPULSION}),
    ("NaN at a key", "", ["density", "stiffness", "origin", "velocity"], None),
]


def nan_at(key):
    """The change that sets this key to NaN."""
    if key == "origin":
        return {"shape": grid(height="nan")}
    return {"terms": "velocity = [0, 0, nan]"} if key == "velocity" else {key: "nan"}


# Extremes that `tests/numerics/sheet/extremes.rs` covers.
TESTED = [
    "stiffness from 1e-3 to 1e9 N/m",
    "rest length zero, coincident points, all points in one place",
    "one point, one row, one column",
    "a mass ratio of a million",
    "frames a hundred times as long",
    "a substep a hundred or thousands of times the stable one",
    "all points pinned",
    "a pin that teleports",
    "an obstacle inside the sheet at the start, a torus with a hole smaller than a cell",
    "NaN in a preset and in a state",
    "a mesh with an edge of zero length, a point without a face",
    "one point, one row and a sheet without pins",
    "the limit of substeps",
    "no sheet at all",
]


def preset(change, integrator):
    values = {
        "fps": 24, "collider": "", "shape": grid(), "density": 0.2, "stiffness": 50, "pin": CORNERS, "terms": "", "more": "",
        "common": "", "solver": "", "integrator": integrator, **change,
    }
    return PRESET.format(**values)


def verdict(tool, text):
    """(verdict, figures, reason) of one shot."""
    with simulated(tool, text) as (ran, frames, _):
        words = " ".join(ran.stderr.split())
    if ran.returncode in (2, 20):
        return "refused", ["", "", ""], refusal(ran.stderr)
    if ran.returncode != 0:
        raise SystemExit(f"exit {ran.returncode}: {words}\n{text}")
    return judge([frame["sheets"] for frame in frames])


def judge(frames):
    """Stable if no limit changed a point and no face cut in; else degraded, with the reasons."""
    assert len(frames) == 8, frames
    how = []
    total = lambda key: sum(frame[key] for frame in frames)
    steps = total("substeps")
    if total("unconverged"):
        how.append(f"{total('unconverged')} of {steps} substeps ended above `tolerance`, by {max(f['residual'] for f in frames):.1e} at most")
    if total("overshot"):
        how.append(f"{total('overshot')} of {steps} substeps gained {total('overshot_energy'):.2g} J by being too long for one linearisation")
    projected = sum(frame["caught"] for frame in frames)
    if projected:
        how.append(f"points projected out of solids {projected} times")
    if frames[-1]["inside_solids"]:
        how.append(f"{frames[-1]['inside_solids']} points inside solids")
    cut_faces = max(frame["cut_faces"] for frame in frames)
    if cut_faces:
        how.append(f"{cut_faces} faces cut into solids at most, by {max(f['cut_depth'] for f in frames):.2g} m")
    if frames[-1]["folded"]:
        how.append(f"{frames[-1]['folded']} springs of zero length")
    last = frames[-1]
    energy = [f"{last[key]:.2g}" for key in ("kinetic_energy", "elastic_energy", "potential_energy")]
    assert all(abs(float(part)) < 1e300 for part in energy), frames
    figures = [f"{steps / len(frames):.0f}", f"{100 * last['strain_max']:.2g} %", ", ".join(energy)]
    return ("degraded" if how else "stable"), figures, "; ".join(how)


def write(tool):
    """Writes the tables of sheets."""
    print("# Stability: sheets\n")
    print(
        "A square of 1 m of 12 × 12 cells, 0.2 kg/m² and 50 N/m, level at the start, hangs from its corners for eight frames of\n"
        "1/24 s. One setting changes at a time; every value is run by both integrators.\n\n"
        "- **stable**: no point was projected out of a solid, no face cut in, every solve converged, and no linearisation added\n"
        "  energy;\n"
        "- **degraded**: the shot is finite and complete, and its log reports what was limited;\n"
        "- **refused**: exit 2 or 20, with this message; the frames before it are kept.\n\n"
        "Strain is the largest of a spring at the end. Energies at the end are kinetic, elastic and potential.\n\n"
        "`tests/numerics/sheet/extremes.rs` tests these extremes:\n\n" + "\n".join(f"- {what}" for what in TESTED) + "\n"
    )
    for heading, unit, values, change in SWEEPS:
        print(f"## {heading}\n")
        print(f"| value{f' [{unit}]' if unit else ''} | integrator | | substeps a frame | strain | energy [J] | reason |")
        print("|---|---|---|--:|--:|---|---|")
        for value in values:
            for integrator in INTEGRATORS:
                changed = (change or nan_at)(value)
                word, figures, how = verdict(tool, preset(changed, integrator))
                shown = f"{value:g}" if isinstance(value, (int, float)) else " × ".join(map(str, value)) if isinstance(value, tuple) else value
                print(f"| {shown} | {integrator} | {word} | {' | '.join(figures)} | {how} |", flush=True)
        print()
