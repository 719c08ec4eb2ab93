#!/usr/bin/env python3
"""What a signed distance on a dense cube costs elsewhere: scikit-fmm, and the plainest sweep in C.

    tools/bench/distances.py                     256³ nodes, a minute
    tools/bench/distances.py --meniscus          and Meniscus' own sweeps, from `cargo bench --bench surface_field`

A ball of 0.7 of the half edge, whose exact distance is known; each program gets the exact distance as its field, finds
the surface in it and computes the distance everywhere, on one thread. Nanoseconds of the peers are of CPU a node; those of
Meniscus are of wall clock, criterion's median, so a machine that does something else tells against it alone. Errors are in
voxels, mean and largest over all nodes. The C sweep (sweep.c: one thread, one array, no blocks) starts from the distances
of the nodes beside the surface, which are in its error and not in its time.
"""

import argparse
import ctypes
import json
import pathlib
import subprocess
import sys
import time

from shot import ROOT
from surfaces import environment

HERE = pathlib.Path(__file__).resolve().parent


def exact(n):
    """Signed distance to the ball, in voxels, at n³ nodes."""
    import numpy

    half = n / 2
    axis = (numpy.arange(n) - half) ** 2
    return numpy.sqrt(axis[:, None, None] + axis[None, :, None] + axis[None, None, :]) - 0.7 * half


def errors(found, phi):
    import numpy

    error = numpy.abs(found - phi)
    return float(error.mean()), float(error.max())


def scikit_fmm(phi, order):
    import skfmm

    start = time.process_time()
    found = skfmm.distance(phi, order=order)
    return time.process_time() - start, errors(found, phi), skfmm.__version__


def plain_sweep(phi, folder):
    """Seeds by the plane through the crossings beside a node, then sweep.c."""
    import numpy

    library = folder / "sweep.so"
    folder.mkdir(parents=True, exist_ok=True)
    subprocess.run(["cc", "-O3", "-march=native", "-shared", "-fPIC", "-o", library, HERE / "sweep.c", "-lm"], check=True)
    inverse = numpy.zeros_like(phi)
    for axis in range(3):
        nearest = numpy.full_like(phi, numpy.inf)
        for step in (1, -1):
            other = numpy.roll(phi, -step, axis)
            # Nothing lies beyond the last node; the ball does not reach it.
            crossing = numpy.where((phi < 0) != (other < 0), phi / (phi - other), numpy.inf)
            numpy.minimum(nearest, crossing, out=nearest)
        inverse += 1 / numpy.maximum(nearest, 1e-12) ** 2
    pinned = inverse > 0
    d = numpy.full(phi.shape, 1e9, numpy.float32)
    d[pinned] = 1 / numpy.sqrt(inverse[pinned])
    flags = pinned.astype(numpy.uint8)
    sweep = ctypes.CDLL(str(library)).sweep
    start = time.process_time()
    sweeps = sweep(d.ctypes.data_as(ctypes.c_void_p), flags.ctypes.data_as(ctypes.c_void_p), phi.shape[0])
    seconds = time.process_time() - start
    return seconds, errors(numpy.where(phi < 0, -d, d), phi), f"{sweeps} sweeps"


def meniscus(cells):
    """Medians of the crate's own bench on one thread: (name, ns a node)."""
    subprocess.run(["cargo", "bench", "--bench", "surface_field", "--", "sdf_256_full"], cwd=ROOT, check=True,
                   stdout=sys.stderr)  # fmt: skip
    for path in sorted((ROOT / "target/criterion").glob("sdf_256_full*/*_1_threads/new/estimates.json")):
        yield path.parent.parent.name, json.loads(path.read_text())["median"]["point_estimate"] / cells


def measure(options):
    """Runs inside the virtual environment: prints the table."""
    phi = exact(options.nodes)
    rows = []
    for repeat in range(options.repeats):
        rows += [("scikit-fmm, order 1", *scikit_fmm(phi, 1)), ("scikit-fmm, order 2", *scikit_fmm(phi, 2))]
        rows.append(("plain sweep in C", *plain_sweep(phi, options.peers)))
    print(f"{options.nodes}³ nodes, one thread; of the peers, CPU and the best of {options.repeats}\n")
    print("| program | ns a node | mean error, voxels | largest | |\n|---|---|---|---|---|")
    for name in dict.fromkeys(row[0] for row in rows):
        _, seconds, (mean, largest), remark = min(row for row in rows if row[0] == name)
        print(f"| {name} | {1e9 * seconds / phi.size:.0f} | {mean:.3f} | {largest:.3f} | {remark} |")
    if options.meniscus:
        for name, nanoseconds in meniscus(256**3):
            print(f"| Meniscus, {name.replace('_', ' ')} | {nanoseconds:.0f} | | | wall clock, criterion's median |")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--nodes", type=int, default=256, help="along an edge (256)")
    parser.add_argument("--repeats", type=int, default=3, help="of every row (3)")
    parser.add_argument("--meniscus", action="store_true", help="also run the crate's own bench of its sweeps")
    parser.add_argument("--venv", type=pathlib.Path, default=ROOT / "target/surface-venv", help="made and filled if missing")
    parser.add_argument("--peers", type=pathlib.Path, default=ROOT / "target/peers", help="where sweep.c is built")
    options = parser.parse_args()
    options.peers = options.peers.resolve()
    python = environment(options.venv.resolve(), ["numpy", "scipy", "scikit-fmm"], "numpy, scipy, skfmm")
    if pathlib.Path(sys.prefix).resolve() != options.venv.resolve():
        sys.exit(subprocess.run([python, *sys.argv]).returncode)
    measure(options)


if __name__ == "__main__":
    main()
