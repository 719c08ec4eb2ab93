#!/usr/bin/env python3
"""Isotropic and anisotropic surfaces side by side, in figures and pictures: writes docs/kernels.md and docs/images/kernels-*.png.

    tools/bench/kernels.py --bpy path/to/python        all of it, some minutes
    tools/bench/kernels.py --no-pictures -o /dev/stdout

Needs a release binary, numpy and scipy, and for the pictures an interpreter with bpy 4.5 (tools/test makes one). The scenes
are those of surface_scenes.py, and one frame of the dam break at its preview tier; the judge is surface_judge.py.
"""

import argparse
import json
import pathlib
import subprocess
import sys
import tempfile

import surface_scenes
from shot import ROOT
from surface_judge import judge

VOXEL = "surface.voxel=0.25"
SMOOTH, SMOOTHER = "surface.smoothing={}", "surface.smoothing.wavelength=12"
ANISOTROPIC = "surface.anisotropy={}"
# Columns: name, what the preset says. The first four have pictures.
WAYS = [
    ("isotropic", []),
    ("isotropic, smoothed", [SMOOTH]),
    ("anisotropic", [ANISOTROPIC]),
    ("anisotropic, smoothed", [ANISOTROPIC, SMOOTH]),
    ("isotropic, wavelength 12", [SMOOTHER]),
    ("anisotropic, wavelength 12", [ANISOTROPIC, SMOOTHER]),
]
# Rows: name, title, how the camera looks.
SCENES = [
    ("sheet1", "sheet, one particle thick", ["--zoom", "3"]),
    ("sheet2", "sheet, two particles thick", ["--zoom", "3"]),
    ("filament", "filament", ["--zoom", "4"]),
    ("droplet", "lone particle", []),
    ("ball", "ball of radius 40", ["--zoom", "2.5"]),
    ("splash", "dam break, frame 25", ["--zoom", "1.6", "--turn", "60"]),
]
PICTURED = ["sheet1", "filament", "ball", "splash"]
FRAME = 25


def meshes(options, scratch):
    """Every scene's mesh in every way: {scene: [(mesh, what is known, the mesh's log), …]}."""
    shot = scratch / "dam-break"
    meniscus(options, "simulate", "dam-break", "--quality", "preview", "--frames", f"1-{FRAME}", "-o", shot)
    made = {}
    for name, _, _ in SCENES:
        known = {"name": name, "spacing": 0.0}
        particles = scratch / f"{name}.xyz"
        if name != "splash":
            known = surface_scenes.write(name, particles)
        made[name] = []
        for place, (_, keys) in enumerate(WAYS):
            words = [word for key in [VOXEL, *keys] for word in ("--set", key)]
            out = scratch / f"{name}-{place}"
            if name == "splash":
                meniscus(options, "mesh", shot, "--frames", FRAME, "--force", *words)
                out.mkdir()
                found = next((shot / "mesh").glob(f"*{FRAME:04}.ply")).rename(out / "splash.ply")
                log = shot / "mesh.jsonl"
            else:
                meniscus(options, "mesh", particles, "--spacing", known["spacing"], "-o", out, *words)
                found, log = next(out.rglob("*.ply")), out / "mesh.jsonl"
            made[name].append((found, known, json.loads(log.read_text().splitlines()[-1])))
    return made


def meniscus(options, *words):
    line = [options.binary, *map(str, words), "--progress", "none"]
    done = subprocess.run(line, capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"{' '.join(line)} ended with {done.returncode}:\n{done.stderr}")


def tables(made):
    """The figures of every scene, a table each."""
    lines = []
    for name, title, _ in SCENES:
        found = [(way, judged(mesh, known, log)) for (way, _), (mesh, known, log) in zip(WAYS, made[name])]
        columns = list(found[0][1])
        lines += [f"### {title[0].upper()}{title[1:]}", "", "| | " + " | ".join(columns) + " |"]
        lines += ["|---|" + "--:|" * len(columns)]
        lines += [f"| {way} | " + " | ".join(figures.values()) + " |" for way, figures in found]
        lines += [""]
    return lines


def judged(mesh, known, log):
    """What is shown of a mesh: title → figure."""
    if known["name"] == "splash":
        return {"pieces": str(log["pieces"]), "triangles": f"{log['triangles']:,}", "volume [m³]": f"{log['volume']:.3f}"}
    found = judge(mesh, known)
    shown = {"pieces": str(log["pieces"]), "volume off by": f"{100 * found['volume_error']:+.1f} %"}
    if "thickness" in found:
        shown["thickness [spacings]"] = f"{found['thickness']:.2f}"
        shown["thinnest, thickest"] = f"{found['thinnest']:.2f}, {found['thickest']:.2f}"
        shown["roughness [radii]"] = f"{found['sheet_roughness']:.3f}"
    if "roughness" in found:
        shown["volume off by"] = f"{100 * found['volume_error']:+.2f} %"
        shown["roughness [radii]"] = f"{found['roughness']:.3f}"
        shown["normals off by"] = f"{found['file_normals']:.2f}°"
        shown["Hausdorff [spacings]"] = f"{max(found['from_mesh'], found['to_mesh']):.2f}"
    if "round" in found:
        shown["radius varies by"] = f"{100 * found['round']:.1f} %"
    return shown


def pictures(made, options):
    """Renders what is pictured; returns the table."""
    ways = WAYS[:4]
    lines = ["| | " + " | ".join(way for way, _ in ways) + " |", "|---|" + "---|" * len(ways)]
    for name, title, camera in SCENES:
        if name not in PICTURED:
            continue
        files = [ROOT / f"docs/images/kernels-{name}-{place}.png" for place in range(len(ways))]
        outputs = [word for file in files for word in ("-o", file)]
        line = [options.bpy, ROOT / "tools/blender/clay.py", *[mesh for mesh, _, _ in made[name][:4]], *outputs, *camera]
        subprocess.run(list(map(str, line)), check=True, stdout=subprocess.DEVNULL)
        cells = [f"![{title}, {way}](images/{file.name})" for file, (way, _) in zip(files, ways)]
        lines.append(f"| {title} | " + " | ".join(cells) + " |")
    return [*lines, ""]


INTRODUCTION = f"""# What kernels and smoothing do to a surface

Written by `tools/bench/kernels.py`; do not edit. Voxels of a quarter of a spacing, particles moved off their lattice by up to
{surface_scenes.JITTER} spacings, which a liquid's are too. *Isotropic* is a preset's surface as it is; *anisotropic* has
`[surface.anisotropy]`, *smoothed* has `[surface.smoothing]`, both with their defaults, *wavelength 12* smooths twice as far.

"""

READING = """## What to take

- A sheet of one layer is flat with anisotropic kernels, as thick as the layer, and keeps its rim; one of two layers loses a
  tenth of its volume, twice what it loses without. Filaments and droplets have too few neighbours to shape anything; they
  are fuller by a sixth, since the level is lower.
- On a bulk of liquid the kernels take a fifth of the bumps away, smoothing nearly all; together they make the calmest
  picture. What smoothing takes is everything shorter than its wavelength; droplets that it would wear away stay as they are.
- Steps of the lattice, as on the ball, are longer than kernels reach. Particles that come from a simulation have none.
- The surface's level lies between those that planes along and across the lattice need, so that bodies have their volume to
  some tenths of a percent; a plane along the lattice lies 0.05 spacings too deep, see `src/field/threshold.rs`.

"""


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bpy", default=sys.executable, help="interpreter with bpy (this one)")
    parser.add_argument("--no-pictures", action="store_true")
    parser.add_argument("--binary", type=pathlib.Path, default=ROOT / "target/release/meniscus")
    parser.add_argument("-o", "--output", type=pathlib.Path, default=ROOT / "docs/kernels.md")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        made = meshes(options, pathlib.Path(scratch))
        shown = [] if options.no_pictures else pictures(made, options)
        text = INTRODUCTION + "\n".join(shown) + "\n" + READING + "## Figures\n\n" + "\n".join(tables(made))
    options.output.write_text(text.rstrip() + "\n")


if __name__ == "__main__":
    main()
