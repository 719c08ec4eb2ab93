#!/usr/bin/env python3
"""Bodies of liquid that touch nothing, for two seconds: does their volume stay, and do they stay in one piece?

    tools/bench/free_liquid.py                       all: the small bodies, and those of 27 000 particles
    tools/bench/free_liquid.py --particles 1728      the small bodies alone, two minutes on two cores

Shapes: cube, ball, slab (three times as wide as thick), bar (six times as long), at rest without gravity and in free fall. Terms: those of
the built-in presets (`TERMS`); tension is that of the presets, half of density × gravity × spacing². Spacings, sizes and substeps a frame
are varied one at a time from 2 cm, the default number of substeps and 1 728 particles, and once for 27 000 particles.

Printed for each row, over its frames and shapes, as the difference farthest from zero: the mean density of the bulk against rest density, the volume
inside the mesh against the fourth frame's, and the largest number of connected components of the mesh. Exits with 1 if density leaves ±1 %, the
mesh ±2 %, or the liquid one component. Splash tensions draw sharp corners round at once, so meshes are compared with the first
frame after a tenth of a second.

Needs a release binary and only Python's standard library.
"""

import argparse
import json
import math
import pathlib
import sys
import tempfile

from shot import ROOT, run

FPS = 24
SECONDS = 2.0
# Half a frame more than a tenth of a second.
FIRST = 4
SPACING = 0.02

# The tables of the built-in presets; `{tension}` is half of density × gravity × spacing².
TERMS = {
    "splashes": ["density_dev=0.3 %", "implicitness=0.25", "xsph.strength=0.01", "vorticity.strength=0.5",
                 "surface_tension.coefficient={tension:.4g}"],
    "figure-bath": ["density_dev=0.3 %", "xsph.strength=0.01", "vorticity.strength=0.5",
                    "surface_tension.coefficient={tension:.4g}"],
    "draft": ["density_dev=1 %", "implicitness=0.25", "xsph.strength=0.01", "vorticity.strength=0.5",
              "surface_tension.coefficient={tension:.4g}"],
    "water-on-cloth": ["density_dev=0.5 %", "cfl=0.6", "xsph.strength=0.02"],
    "honey": ["density=1400", "max_substeps=200", "viscosity.dynamic=30"],
    "no tables": [],
}  # fmt: skip
DENSITY, MESH = 0.01, 0.02


def shapes(count, spacing):
    """Bodies of about `count` particles as TOML, by name."""
    cells = {
        "cube": [1, 1, 1],
        "slab": [3, 3, 1],
        "bar": [6, 1, 1],
    }
    found = {}
    for name, ratio in cells.items():
        unit = (count / math.prod(ratio)) ** (1 / 3)
        sides = [round(unit * r) * spacing for r in ratio]
        found[name] = f"box = {{ min = [0, 0, 0], max = {json.dumps(sides)} }}"
    radius = (count * 0.75 / math.pi) ** (1 / 3) * spacing
    found["ball"] = f"sphere = {{ center = [0, 0, 0], radius = {radius!r} }}"
    return found


def preset(shape, spacing, gravity):
    return "\n".join([
        f'title = "free liquid"\nframes = "1-{round(SECONDS * FPS) + 1}"\nfps = {FPS}',
        f"[world]\ngravity = [0, 0, {-gravity}]",
        f"[liquid]\nspacing = {spacing!r}",
        f"[[liquid.source]]\nshape = {{ {shape} }}",
        "[surface]\nvoxel = 0.5\n[surface.anisotropy]\n[surface.smoothing]",
        '[output]\nmesh = ["ply"]',
    ])  # fmt: skip


def farthest(values):
    return max(values, key=abs)


def body(binary, text, sets, folder):
    """Differences of density and of the mesh's volume that are farthest from zero, and the largest number of components."""
    path = folder / "free.toml"
    path.write_text(text)
    words = [word for given in sets for word in ("--set", f"liquid.{given}")]
    run([binary, "shot", path, "-o", folder / "shot", "--progress", "none", *words])
    log = [json.loads(line)["liquid"] for line in (folder / "shot/log.jsonl").read_text().splitlines()]
    meshes = [json.loads(line) for line in (folder / "shot/mesh.jsonl").read_text().splitlines()]
    density = farthest([difference for record in log for difference in (record["compression_avg"], -record["dilation_avg"])])
    volumes = [mesh["volume"] for mesh in meshes]
    start = volumes[FIRST - 1]
    return density, farthest([volume / start - 1 for volume in volumes[FIRST:]]), max(m["pieces"] for m in meshes)


def rows(options):
    """Terms, gravity, number of particles, spacing and substeps a frame (None: the default)."""
    for name in TERMS:
        for gravity in (0, 9.81):
            for count in options.particles:
                yield name, gravity, count, SPACING, None
    count = min(options.particles)
    for gravity in (0, 9.81):
        for spacing in (0.01, 0.05):
            yield "splashes", gravity, count, spacing, None
        for substeps in (4, 16):
            yield "splashes", gravity, count, SPACING, substeps


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--particles", type=int, nargs="+", default=[1728, 27000])
    parser.add_argument("--terms", action="append", help="only these; may be repeated", choices=list(TERMS))
    parser.add_argument("--binary", type=pathlib.Path, default=ROOT / "target/release/meniscus")
    options = parser.parse_args()
    print("| terms | gravity | particles | spacing | substeps | density | mesh | components | |")
    print("|---|---|---|---|---|---|---|---|---|")
    failed = False
    for name, gravity, count, spacing, substeps in rows(options):
        if options.terms and name not in options.terms:
            continue
        sets = [term.format(tension=0.5 * 1000 * 9.81 * spacing**2) for term in TERMS[name]]
        sets += [f"min_substeps={substeps}", f"max_substeps={max(substeps, 100)}"] if substeps else []
        found = {}
        for shape, text in shapes(count, spacing).items():
            with tempfile.TemporaryDirectory(prefix="free-liquid-") as folder:
                found[shape] = body(options.binary, preset(text, spacing, gravity), sets, pathlib.Path(folder))
        density, mesh = (farthest([figures[k] for figures in found.values()]) for k in (0, 1))
        components = max(figures[2] for figures in found.values())
        wrong = [
            shape for shape, (d, m, c) in found.items() if abs(d) > DENSITY or abs(m) > MESH or c > 1
        ]
        failed |= bool(wrong)
        print(
            f"| {name} | {gravity} | {count} | {spacing} m | {substeps or 'default'} | {density:+.2%} | {mesh:+.2%} | {components} | {', '.join(wrong)} |",
            flush=True,
        )
    sys.exit(int(failed))


if __name__ == "__main__":
    main()
