#!/usr/bin/env python3
"""Compares isotropic and anisotropic surfaces in figures and pictures: writes docs/kernels.md and docs/images/kernels-*.png.

    tools/bench/kernels.py --bpy path/to/python        everything, some minutes
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
# The preset names both tables.
PLAIN = ["surface.anisotropy=none", "surface.smoothing=none"]
# Columns: name, settings of the preset. The first four have pictures.
VARIANTS = [
    ("isotropic", []),
    ("isotropic, smoothed", [SMOOTH]),
    ("anisotropic", [ANISOTROPIC]),
    ("anisotropic, smoothed", [ANISOTROPIC, SMOOTH]),
    ("isotropic, wavelength 12", [SMOOTHER]),
    ("anisotropic, wavelength 12", [ANISOTROPIC, SMOOTHER]),
]
# Rows: name, title, options of the camera.
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
    """Every scene's mesh in every variant: {scene: [(mesh, known figures, the mesh's log), …]}."""
    shot = scratch / "dam-break"
    meniscus(options, "simulate", "dam-break", "--quality", "preview", "--frames", f"1-{FRAME}", "-o", shot)
    made = {}
    for name, _, _ in SCENES:
        known = {"name": name, "spacing": 0.0}
        particles = scratch / f"{name}.xyz"
        if name != "splash":
            known = surface_scenes.write(name, particles)
        made[name] = []
        for column, (_, keys) in enumerate(VARIANTS):
            words = [word for key in [VOXEL, *PLAIN, *keys] for word in ("--set", key)]
            out = scratch / f"{name}-{column}"
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
        found = [(variant, judged(mesh, known, log)) for (variant, _), (mesh, known, log) in zip(VARIANTS, made[name])]
        columns = list(found[0][1])
        lines += [f"### {title[0].upper()}{title[1:]}", "", "| | " + " | ".join(columns) + " |"]
        lines += ["|---|" + "--:|" * len(columns)]
        lines += [f"| {variant} | " + " | ".join(figures.values()) + " |" for variant, figures in found]
        lines += [""]
    return lines


def judged(mesh, known, log):
    """The figures that are shown of a mesh: title → figure."""
    components = str(log["pieces"])
    if known["name"] == "splash":
        return {"components": components, "triangles": f"{log['triangles']:,}", "volume [m³]": f"{log['volume']:.3f}"}
    found = judge(mesh, known)
    shown = {"components": components, "volume error": f"{100 * found['volume_error']:+.1f} %"}
    if "thickness" in found:
        shown["thickness [spacings]"] = f"{found['thickness']:.2f}"
        shown["thinnest, thickest"] = f"{found['thinnest']:.2f}, {found['thickest']:.2f}"
        shown["roughness [radii]"] = f"{found['sheet_roughness']:.3f}"
    if "roughness" in found:
        shown["volume error"] = f"{100 * found['volume_error']:+.2f} %"
        shown["roughness [radii]"] = f"{found['roughness']:.3f}"
        shown["normals, error"] = f"{found['file_normals']:.2f}°"
        shown["Hausdorff [spacings]"] = f"{max(found['from_mesh'], found['to_mesh']):.2f}"
    if "round" in found:
        shown["radius varies by"] = f"{100 * found['round']:.1f} %"
    return shown


def pictures(made, options):
    """Renders the pictures; returns their table."""
    variants = VARIANTS[:4]
    lines = ["| | " + " | ".join(variant for variant, _ in variants) + " |", "|---|" + "---|" * len(variants)]
    for name, title, camera in SCENES:
        if name not in PICTURED:
            continue
        files = [ROOT / f"docs/images/kernels-{name}-{column}.png" for column in range(len(variants))]
        outputs = [word for file in files for word in ("-o", file)]
        line = [options.bpy, ROOT / "tools/blender/clay.py", *[mesh for mesh, _, _ in made[name][:4]], *outputs, *camera]
        subprocess.run(list(map(str, line)), check=True, stdout=subprocess.DEVNULL)
        cells = [f"![{title}, {variant}](images/{file.name})" for file, (variant, _) in zip(files, variants)]
        lines.append(f"| {title} | " + " | ".join(cells) + " |")
    return [*lines, ""]


INTRODUCTION = f"""# Kernels and smoothing: their effect on a surface

```sh
meniscus mesh my-shot --set surface.anisotropy={{}} --set surface.smoothing={{}}     # the smoothest surface
```

- **Thin sheets**: use `[surface.anisotropy]`. A sheet of one layer is then flat, as thick as the layer, and keeps its rim.
  One of two layers loses a tenth of its volume, twice as much as without.
- **A bulk of liquid**: `[surface.anisotropy]` removes a fifth of the bumps, `[surface.smoothing]` nearly all; together they
  are the smoothest. Smoothing removes all detail shorter than its wavelength; small droplets are left as they are.
- **Filaments and droplets** have too few neighbours for anisotropy. They gain a sixth of volume with it, since the level is
  lower.

Steps of the seeding lattice, as on the ball, are longer than the kernels' support. Particles of a simulation have none.
The surface's level is between those for planes along and across the seeding lattice, so that bodies have their volume to
some tenths of a per cent. A plane along the seeding lattice is 0.05 spacings too deep (`src/field/threshold.rs`).

Written by `tools/bench/kernels.py`; do not edit. Voxels are a quarter of a spacing. Particles are displaced from their
seeding lattice by up to {surface_scenes.JITTER} spacings, as those of a liquid are. *Isotropic* is a preset's default surface;
*anisotropic* has `[surface.anisotropy]` and *smoothed* has `[surface.smoothing]`, both with their defaults. *Wavelength 12*
smooths twice as far.

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
        text = INTRODUCTION + "\n".join(shown) + "\n## Figures\n\n" + "\n".join(tables(made))
    options.output.write_text(text.rstrip() + "\n")


if __name__ == "__main__":
    main()
