"""What becomes of sheets at the ends of their settings: the last part of docs/stability.md (stability.py)."""

import json
import pathlib
import subprocess
import tempfile

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
    """A point that is carried so far in one frame."""
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
    ("Rest length, as a part of the length (`rest`, not held)", "", [0, 1e-3, 0.5, 1, 2],
     lambda value: {"terms": f"rest = [{value}, {value}]\nshear = 2", "pin": "", "stiffness": 5}),
    ("Cells along the two directions", "", [(0, 0), (1, 0), (0, 1), (100, 0), (1, 1), (1, 100)],
     lambda value: {"shape": grid(value), "terms": "shear = 3\nbending = 0.001"}),
    ("Points in one place: a grid so narrow, whose neighbours single precision puts together", "m", [1e-3, 1e-9, 1e-30, 0],
     lambda value: {"shape": grid().replace("first = [1, 0, 0]", f"first = [{value!r}, 0, 0]")}),
    ("A disc that is so many times heavier", "", [1, 1e3, 1e6], heavy),
    ("Frames so many times as long", "", [1, 10, 100, 1000],
     lambda value: {"fps": 24 / value, "terms": "damping = 1"}),
    ("Substeps of a frame of the implicit integrator, of springs of 1e6 N/m", "", [1, 8, 100],
     lambda value: {"stiffness": 1e6, "solver": f"substeps = {value}"}),
    ("Most substeps (`max_substeps`, at 1e5 N/m)", "", [3, 100, 1000],
     lambda value: {"stiffness": 1e5, "solver": f"max_substeps = {value}"}),
    ("Points of the 169 that are pinned", "", [0, 1, 168, 169], lambda value: held(value) if value else {"pin": ""}),
    ("A pin that is somewhere else a frame later, exact", "m", [1, 100, 1e4, 1e7], lambda value: led(value, 0)),
    ("The same of a spring of 500 N/m", "m", [1, 100, 1e4, 1e7], lambda value: led(value, 500)),
    ("A ball of this radius around the middle of the sheet at the start", "m", [0.05, 0.3, 2],
     lambda value: {"collider": solid(f"sphere = {{ center = [0, 0, 0], radius = {value} }}"), "pin": "", "common": REPULSION}),
    ("The same without repulsion", "m", [0.05, 0.3, 2],
     lambda value: {"collider": solid(f"sphere = {{ center = [0, 0, 0], radius = {value} }}"), "pin": ""}),
    ("A ball of 0.3 m 1 cm under the sheet, whose points stay this far off (`clearance`)", "m", [0, 0.009, 0.3, 1000],
     lambda value: {"collider": solid("sphere = { center = [0, 0, -0.31], radius = 0.3 }"), "pin": "", "common": f"clearance = {value}"}),
    ("A torus under the sheet whose hole has this radius; cells are of 0.083 m", "m", [0.3, 0.04, 0.001],
     lambda value: {"collider": torus(value, -0.16), "pin": "", "common": REPULSION}),
    ("What is no number, at this key", "", ["density", "stiffness", "origin", "velocity"], None),
]


def no_number(key):
    """A preset that says nan there."""
    if key == "origin":
        return {"shape": grid(height="nan")}
    return {"terms": "velocity = [0, 0, nan]"} if key == "velocity" else {key: "nan"}


# Where each is tested.
TESTS = [
    ("stiffness from 1e-3 to 1e9 N/m", "stiffness_from_a_thousandth_to_a_thousand_million"),
    ("rest length zero, points in one place, all points in one place", "rest_length_zero_and_points_in_one_place"),
    ("one point, one row, one column", "one_point_one_row_and_one_column"),
    ("a mass ratio of a million", "a_mass_ratio_of_a_million"),
    ("frames a hundred times as long", "frames_a_hundred_times_as_long"),
    ("a substep a hundred times the stable one", "a_substep_a_hundred_times_too_long"),
    ("substeps thousands of times as long", "energy_that_a_linearisation_makes_is_told"),
    ("all points pinned", "all_points_pinned_stay"),
    ("a pin that teleports", "a_pin_that_teleports"),
    ("an obstacle inside the sheet at the start, a torus with a hole smaller than a cell",
     "an_obstacle_that_starts_inside_the_sheet_or_wider_than_its_hole_is"),
    ("what is no number, in a preset and in a state", "what_has_no_meaning_is_refused_by_name"),
    ("a mesh with an edge of no length, a point of no face", "meshes_with_an_edge_of_no_length_or_a_point_of_no_face_are_refused"),
    ("one point, one row and a sheet that nothing holds", "a_point_that_nothing_holds_falls_freely"),
    ("the limit of substeps", "a_limit_of_substeps_is_told"),
    ("no sheet at all", "nothing_is_a_sheet_too"),
]


def preset(change, integrator):
    values = {
        "fps": 24, "collider": "", "shape": grid(), "density": 0.2, "stiffness": 50, "pin": CORNERS, "terms": "", "more": "",
        "common": "", "solver": "", "integrator": integrator, **change,
    }
    return PRESET.format(**values)


def verdict(tool, text):
    """(word, figures, how) of one shot."""
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder)
        (path / "shot.toml").write_text(text)
        ran = subprocess.run([tool, "simulate", "shot.toml", "-o", "out"], cwd=path, capture_output=True, text=True)
        log = path / "out" / "log.jsonl"
        frames = [json.loads(line)["sheets"] for line in log.read_text().splitlines()] if log.exists() else []
    words = " ".join(ran.stderr.split())
    if ran.returncode in (2, 20):
        return "refused", ["", "", ""], refusal(ran.stderr)
    if ran.returncode != 0:
        raise SystemExit(f"exit {ran.returncode}: {words}\n{text}")
    return judge(frames)


def refusal(said):
    """The error in one line; of a preset's, without the text that it points at."""
    if "error: " in said:
        return " ".join(said[said.rindex("error: ") + 7 :].split()).replace("|", "/")
    lines = said.strip().splitlines()
    found = [line.split("--")[-1].strip() for line in lines if "`--" in line and "found" in line]
    return "; ".join([lines[0].strip().lstrip("x×").strip(), *found[:1]]).replace("|", "/")


def judge(frames):
    """Stable if nothing was put back, cut in, left or folded; else what was."""
    assert len(frames) == 8, frames
    how = []
    total = lambda key: sum(frame[key] for frame in frames)
    steps = total("substeps")
    if total("unconverged"):
        how.append(f"{total('unconverged')} of {steps} substeps ended above `tolerance`, by {max(f['residual'] for f in frames):.1e} at most")
    if total("overshot"):
        how.append(f"{total('overshot')} of {steps} substeps gained {total('overshot_energy'):.2g} J by being too long for one linearisation")
    if total("caught"):
        how.append(f"points put out of solids {total('caught')} times")
    if frames[-1]["inside_solids"]:
        how.append(f"{frames[-1]['inside_solids']} points inside solids")
    most = max(frames, key=lambda frame: frame["cut_faces"])
    if most["cut_faces"]:
        how.append(f"{most['cut_faces']} faces cut into solids at most, by {max(f['cut_depth'] for f in frames):.2g} m")
    if frames[-1]["folded"]:
        how.append(f"{frames[-1]['folded']} springs of no length")
    last = frames[-1]
    energy = [f"{last[key]:.2g}" for key in ("kinetic_energy", "elastic_energy", "potential_energy")]
    assert all(abs(float(part)) < 1e300 for part in energy), frames
    figures = [f"{steps / len(frames):.0f}", f"{100 * last['strain_max']:.2g} %", ", ".join(energy)]
    return ("degraded" if how else "stable"), figures, "; ".join(how)


def write(tool):
    """Writes the tables of sheets."""
    print("# What sheets stand\n")
    print(
        "A square of 1 m of 12 × 12 cells, 0.2 kg/m² and 50 N/m, level at the start, hangs from its corners for eight frames of\n"
        "1/24 s. One setting changes at a time; every value is run by both integrators.\n\n"
        "- **stable**: nothing was put back, cut in or left over, and no linearisation made energy;\n"
        "- **degraded**: the shot is finite and complete, and its log tells what was limited;\n"
        "- **refused**: exit 2 or 20, with this message; the frames before it are kept.\n\n"
        "Strain is the largest of a spring at the end; energies are of motion, of springs and plates, and of height, at the end.\n\n"
        "In `tests/numerics/sheet/extremes.rs` these stand as tests:\n\n"
        "| extreme | test |\n|---|---|\n" + "\n".join(f"| {what} | `{test}` |" for what, test in TESTS) + "\n"
    )
    for heading, unit, values, change in SWEEPS:
        print(f"## {heading}\n")
        print(f"| value{f' [{unit}]' if unit else ''} | integrator | | substeps a frame | strain | energy [J] | how |")
        print("|---|---|---|--:|--:|---|---|")
        for value in values:
            for integrator in INTEGRATORS:
                changed = (change or no_number)(value)
                word, figures, how = verdict(tool, preset(changed, integrator))
                shown = f"{value:g}" if isinstance(value, (int, float)) else " × ".join(map(str, value)) if isinstance(value, tuple) else value
                print(f"| {shown} | {integrator} | {word} | {' | '.join(figures)} | {how} |", flush=True)
        print()
