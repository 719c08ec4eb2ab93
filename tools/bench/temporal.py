#!/usr/bin/env python3
# SPDX-License-Identifier: MIT OR Apache-2.0
"""How far surfaces of Meniscus and splashsurf move when the same particles are moved rigidly or jittered.

    tools/bench/temporal.py [--scene splash-10k] [--json temporal.json] > temporal.md

Particles of a scene of surface_scenes.py are shifted by parts of a voxel, rotated, or displaced at random by up to a
thousandth of a spacing. Each mesh is moved back and compared with that of the particles as they were: RMS and largest
distance of its vertices from it, in spacings, and components. Meniscus runs as `meniscus mesh FILE` does, the peer as in
surfaces.py. Needs what surfaces.py needs."""

import argparse
import json
import pathlib
import subprocess
import sys
import tempfile

from surfaces import PEERS, ROOT, SPACING, environment, row, splashsurf

HERE = pathlib.Path(__file__).resolve().parent
VOXEL = 0.5 * SPACING
# Name, shift [m], axis and angle [rad] of the rotation, displacement at random [spacings].
CASES = [
    ("half a voxel", [0.5 * VOXEL, 0, 0], 0.0, 0.0),
    ("parts of a voxel", [0.37 * VOXEL, 0.61 * VOXEL, 0.23 * VOXEL], 0.0, 0.0),
    ("rotation by 3°", [0, 0, 0], 0.05, 0.0),
    ("rotation by 29°", [0, 0, 0], 0.5, 0.0),
    ("jitter", [0, 0, 0], 0.0, 1e-3),
]
JUDGE = """
import json, sys, numpy
from pathlib import Path
from scipy.spatial.transform import Rotation
import surface_judge as judge
job = json.load(sys.stdin)
meshes = [judge.read_ply(Path(path))[:2] for path in job["meshes"]]
x, triangles = meshes[0]
found = []
for (moved, faces), shift, turn in zip(meshes[1:], job["shifts"], job["turns"]):
    back = Rotation.from_rotvec(turn).inv().apply(moved - job["centre"] - numpy.array(shift)) + job["centre"]
    off = judge.distance(back, x, triangles) / job["spacing"]
    found.append([float(numpy.sqrt((off**2).mean())), float(off.max()), judge.topology(len(moved), faces)["components"]])
print(json.dumps([judge.topology(len(x), triangles)["components"], found]))
"""
MOVE = """
import json, sys, numpy
from scipy.spatial.transform import Rotation
import surface_scenes
job = json.load(sys.stdin)
x = surface_scenes.make(job["scene"])[0].astype(float)
centre = x.mean(0)
random = numpy.random.default_rng(job["seed"])
x.astype("<f4").tofile(job["paths"][0])
for path, shift, turn, jitter in zip(job["paths"][1:], job["shifts"], job["turns"], job["jitters"]):
    moved = Rotation.from_rotvec(turn).apply(x - centre) + centre + numpy.array(shift)
    moved += random.uniform(-jitter, jitter, x.shape) * job["spacing"]
    moved.astype("<f4").tofile(path)
print(json.dumps([len(x), centre.tolist()]))
"""


def python(options, program, job):
    done = subprocess.run([options.python, "-c", program], input=json.dumps(job).encode(), cwd=HERE, check=True,
                          stdout=subprocess.PIPE)  # fmt: skip
    return json.loads(done.stdout)


def mesh(options, flags, source, out):
    """The mesh of a particle file by Meniscus with some keys, or by the peer with further flags."""
    if isinstance(flags, dict):
        keys = [word for key, value in flags.items() for word in ("--set", f"{key}={value}")]
        command = [options.binary, "mesh", source, "--spacing", SPACING, *keys, "-o", out, "--progress", "none"]
    else:
        units = [f"-r={SPACING / 2}", f"-c={2 * VOXEL / SPACING}", "-l=2", "-t=0.6"]
        out.mkdir()
        command = [options.peer, "reconstruct", "-q", source, "-o", "mesh.ply", "--output-dir", out, *units, *flags]
    subprocess.run([str(word) for word in command], check=True, stdout=subprocess.DEVNULL)
    return str(next(out.rglob("*.ply")))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", default="splash-10k")
    parser.add_argument("--add", action="append", default=[], metavar="NAME:KEY=VALUE,…", help="a further Meniscus row")
    parser.add_argument("--venv", type=pathlib.Path, default=ROOT / "target/surface-venv")
    parser.add_argument("--peers", type=pathlib.Path, default=ROOT / "target/peers")
    parser.add_argument("--binary", type=pathlib.Path, default=ROOT / "target/release/meniscus")
    parser.add_argument("--seed", type=int, default=1, help="of the jitter")
    parser.add_argument("--json", type=pathlib.Path)
    options = parser.parse_args()
    options.binary = options.binary.resolve()
    options.python, options.peer = environment(options.venv.resolve()), splashsurf(options.peers.resolve())
    axis = [1 / 14**0.5, 2 / 14**0.5, 3 / 14**0.5]
    shifts = [shift for _, shift, _, _ in CASES]
    turns = [[angle * part for part in axis] for _, _, angle, _ in CASES]
    results = {}
    with tempfile.TemporaryDirectory(prefix="temporal-") as folder:
        folder = pathlib.Path(folder)
        paths = [str(folder / f"{number}.xyz") for number in range(len(CASES) + 1)]
        job = {"scene": options.scene, "paths": paths, "shifts": shifts, "turns": turns, "spacing": SPACING, "seed": options.seed}
        count, centre = python(options, MOVE, job | {"jitters": [jitter for *_, jitter in CASES]})
        for name, flags in [("Meniscus", {}), *map(row, options.add), *PEERS]:
            print(name, file=sys.stderr, flush=True)
            out = [folder / f"{len(results)}-{number}" for number in range(len(paths))]
            meshes = [mesh(options, flags, path, place) for path, place in zip(paths, out)]
            results[name] = python(options, JUDGE, job | {"meshes": meshes, "centre": centre})
    print(f"`{options.scene}`, {count} particles; RMS and largest displacement in spacings, change of the number of components.\n")
    print("| row | components |" + "".join(f" {name} |" for name, *_ in CASES))
    print("|---|--:|" + "--:|" * len(CASES))
    for name, (components, found) in results.items():
        cells = [f"{rms:.4f}, {largest:.2f}, {after - components:+d}" for rms, largest, after in found]
        print(f"| {name} | {components} | " + " | ".join(cells) + " |")
    if options.json:
        options.json.write_text(json.dumps(results, indent=1))


if __name__ == "__main__":
    main()
