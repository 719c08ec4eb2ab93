#!/usr/bin/env python3
# SPDX-License-Identifier: MIT OR Apache-2.0
"""The Python package compared with pysplashsurf: seconds from one numpy array to arrays of a mesh, at equal settings.

    tools/bench/python_module.py WHEEL [--scenes splash-100k splash-1M] [--repeats 5] [--threads 1 2]

Both get the same float32 array in one process and take turns; figures are medians, of wall and of processor seconds of the
process. Settings are those of surfaces.py: voxel a quarter of a spacing, kernels that end at two spacings, threshold 0.6 of
the peer. *Plain* makes a mesh without post-processing; Meniscus also makes normals and checks its mesh. *Smoothed* is the
peer's recommended pipeline (clean-up, feature weights, 25 smoothing iterations, smoothed normals) and Meniscus' anisotropic
kernels with smoothing.

WHEEL is of this system (tools/release/build). The first run makes a virtual environment in `target/bench-venv` and fills it
from PyPI. On a busy machine processor seconds are the better guide.
"""

import argparse
import json
import os
import pathlib
import statistics
import subprocess
import sys
import time

from shot import ROOT
from surfaces import PACKAGES, environment

HERE = pathlib.Path(__file__).resolve().parent
PEER = "0.14.1.0"
VOXEL, KERNEL, THRESHOLD = 0.25, 2.0, 0.6


def subjects(threads, smoothed):
    """The two calls, by name."""
    import meniscus_fx
    import pysplashsurf
    from surface_scenes import SPACING

    settings = {} if smoothed else {"anisotropy": None, "smoothing": None}

    def ours(positions):
        mesh = meniscus_fx.reconstruct(positions, SPACING, threads=threads, voxel=VOXEL, kernel_radius=KERNEL, **settings)
        return len(mesh.triangles)

    # The pipeline takes multiples of the particle radius, half the spacing.
    more = {"mesh_cleanup": True, "mesh_smoothing_iters": 25, "compute_normals": True, "normals_smoothing_iters": 10}

    def peer(positions):
        found = pysplashsurf.reconstruction_pipeline(
            positions,
            particle_radius=SPACING / 2,
            smoothing_length=KERNEL,
            cube_size=2 * VOXEL,
            iso_surface_threshold=THRESHOLD,
            multi_threading=threads > 1,
            **(more if smoothed else {}),
        )
        mesh = found[0].mesh if hasattr(found[0], "mesh") else found[0]
        return len(mesh.triangles)

    return {"Meniscus": ours, "pysplashsurf": peer}


def measure(options):
    """Runs inside the environment: one table as JSON."""
    import numpy
    import surface_scenes

    scene, threads, smoothed, repeats = options
    path = pathlib.Path(os.environ["BENCH_SCRATCH"]) / f"{scene}.xyz"
    if not path.exists():
        surface_scenes.write(scene, str(path), 0.0)
    positions = numpy.fromfile(path, "<f4").reshape(-1, 3)
    runs = {name: [] for name in subjects(threads, smoothed)}
    for _ in range(repeats):
        for name, call in subjects(threads, smoothed).items():
            wall, cpu = time.perf_counter(), time.process_time()
            triangles = call(positions)
            runs[name].append((time.perf_counter() - wall, time.process_time() - cpu, triangles))
    found = {name: [statistics.median(run[place] for run in given) for place in (0, 1, 2)] for name, given in runs.items()}
    print(json.dumps({"particles": len(positions), "found": found}))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("wheel", type=pathlib.Path)
    parser.add_argument("--scenes", nargs="+", default=["splash-100k", "splash-1M"])
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--threads", nargs="+", type=int, default=[1, 2])
    parser.add_argument("--venv", type=pathlib.Path, default=ROOT / "target" / "bench-venv")
    options = parser.parse_args()
    python = environment(options.venv, [*PACKAGES, f"pysplashsurf=={PEER}"], "numpy, scipy, pysplashsurf")
    pip = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--force-reinstall", "--no-deps"]
    subprocess.run([*pip, options.wheel], check=True)
    scratch = options.venv / "scenes"
    scratch.mkdir(exist_ok=True)
    print("| surface | particles | threads | Meniscus wall, CPU [s] | pysplashsurf wall, CPU [s] | × wall | × CPU |")
    print("|---|--:|--:|--:|--:|--:|--:|")
    for scene in options.scenes:
        for smoothed in (False, True):
            for threads in options.threads:
                # Both pools of threads take their number from the start of a process.
                job = json.dumps([scene, threads, smoothed, options.repeats])
                variables = {"RAYON_NUM_THREADS": str(threads), "BENCH_SCRATCH": str(scratch), "BENCH_JOB": job}
                done = subprocess.run([python, __file__, "measure"], env=os.environ | variables, cwd=HERE, stdout=subprocess.PIPE, check=True)
                result = json.loads(done.stdout)
                ours, peer = result["found"]["Meniscus"], result["found"]["pysplashsurf"]
                figures = [f"{a[0]:.2f}, {a[1]:.2f}" for a in (ours, peer)]
                ratios = [f"{peer[place] / ours[place]:.2f}" for place in (0, 1)]
                name = "smoothed" if smoothed else "plain"
                print(f"| {name} | {result['particles']} | {threads} | {' | '.join(figures)} | {' | '.join(ratios)} |", flush=True)


if __name__ == "__main__":
    if "BENCH_JOB" in os.environ and sys.argv[1:] == ["measure"]:
        measure(json.loads(os.environ["BENCH_JOB"]))
    else:
        main()
