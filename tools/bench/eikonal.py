#!/usr/bin/env python3
"""Meniscus, scikit-fmm and a plain sweep in C on the same ball, in one table: CPU nanoseconds a node and error.

    tools/bench/eikonal.py                 everything, at 256³
    tools/bench/eikonal.py --no-peer       Meniscus alone: error against time for orders, bands and blocks

Needs cargo; for the others a C compiler, and a network for the first run (pip fills a virtual environment, see --venv).

*Case*: a ball of a fifth of the side in a box of 256³ nodes, its middle on no node. Meniscus: `benches/eikonal.rs`, from an
exact band of three voxels or from a field. scikit-fmm gets the same distance, clipped to three voxels, and computes its
seeds from the crossings between nodes. The C sweep (sweep.c: one array, no blocks) starts from the exact band that Meniscus
starts from. Errors are those of |distance| over all nodes.

*Cost*: CPU seconds of the process, so other work on the machine shows little. scikit-fmm and the C sweep run on one thread,
best of three. The time of the C sweep excludes its build and the allocation of its arrays.
"""

import argparse
import pathlib
import subprocess

from shot import ROOT
from surfaces import environment

PEERS = """
import ctypes
import sys
import time
import numpy as np
import skfmm
n, radius, band = 256, 0.2 * 256, 3
x = np.arange(n) - n / 2
exact = np.sqrt(
    (x[None, None, :] - 0.31) ** 2 + (x[None, :, None] + 0.17) ** 2 + (x[:, None, None] - 0.05) ** 2
) - radius

def fast_marching(order):
    start = time.process_time()
    found = skfmm.distance(np.clip(exact, -band, band), dx=1.0, order=order)
    return time.process_time() - start, found

def plain_sweep():
    pinned = np.abs(exact) < band
    found = np.where(pinned, np.abs(exact), 1e9).astype(np.float32)
    flags = pinned.astype(np.uint8)
    sweep = ctypes.CDLL(sys.argv[1]).sweep
    start = time.process_time()
    sweep(found.ctypes.data_as(ctypes.c_void_p), flags.ctypes.data_as(ctypes.c_void_p), n)
    return time.process_time() - start, found

rows = [(f"scikit-fmm {skfmm.__version__}, order {order}, 1", lambda order=order: fast_marching(order)) for order in (1, 2)]
for name, solve in [*rows, ("plain sweep in C, exact band, 1", plain_sweep)]:
    seconds, found = min((solve() for _ in range(3)), key=lambda pair: pair[0])
    error = np.abs(np.abs(found) - np.abs(exact))
    each = seconds / n**3 * 1e9
    print(f"| {name} | inf | {n**3} | {each:.1f} | | {error.mean():.4f} | {error.max():.3f} |", flush=True)
"""


def plain_sweep(folder: pathlib.Path) -> pathlib.Path:
    """sweep.c as a library for this processor."""
    folder.mkdir(parents=True, exist_ok=True)
    library = folder / "sweep.so"
    source = pathlib.Path(__file__).resolve().parent / "sweep.c"
    subprocess.run(["cc", "-O3", "-march=native", "-shared", "-fPIC", "-o", library, source, "-lm"], check=True)
    return library


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--no-peer", action="store_true", help="leave scikit-fmm and the C sweep out")
    parser.add_argument(
        "--venv", type=pathlib.Path, default=ROOT / "target/surface-venv", help="made and filled if missing"
    )
    parser.add_argument("--peers", type=pathlib.Path, default=ROOT / "target/peers", help="where sweep.c is built")
    options = parser.parse_args()
    # A filter that no criterion measurement matches: the table alone.
    bench = ["cargo", "bench", "--quiet", "--bench", "eikonal", "--", "no-measurement"]
    subprocess.run(bench, cwd=ROOT, check=True)
    if not options.no_peer:
        python = environment(options.venv.resolve(), ["numpy", "scipy", "scikit-fmm"], "numpy, scipy, skfmm")
        subprocess.run([python, "-c", PEERS, plain_sweep(options.peers.resolve())], check=True)


if __name__ == "__main__":
    main()
