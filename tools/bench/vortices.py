#!/usr/bin/env python3
"""Meniscus and fmm3dpy on the same vortons, in one table: CPU seconds on one thread and error of the velocity.

    tools/bench/vortices.py                 all
    tools/bench/vortices.py --no-million    without the cloud of a million, which takes half of the time
    tools/bench/vortices.py --no-peer       Meniscus alone

Needs cargo; for the peer a network for the first run (pip fills a virtual environment, see --venv).

The tables are those of `benches/vortex.rs`: errors and times of every method, the time against the number of vortons, the
Poisson equation by itself, and wall seconds by number of threads.

*Clouds* are those of `benches/vortex.rs`, made again here from the same numbers.

*The same work*: both find the velocity at every vorton. The peer has no cores: it sums points, as three charges a vorton whose
gradients give the curl, in double precision, and its error is taken against its own direct sum of points at 400 of them.
Meniscus sums Winckelmans-Leonard cores of one and a half spacings, in single precision, against its own sum over all pairs.

*Cost*: CPU seconds of the process, so other work on the machine shows little. The peer: best of three (of one for a million).
"""

import argparse
import os
import pathlib
import subprocess

from shot import ROOT
from surfaces import environment

PEER = '''
import sys
import time
import fmm3dpy
import numpy as np

def noise(i):
    x = (i.astype(np.uint64) + np.uint64(1)) * np.uint64(0x9E3779B97F4A7C15)
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return ((x ^ (x >> np.uint64(31))) >> np.uint64(11)).astype(float) / 2.0**53

def cloud(name, count):
    r = [noise(16 * np.arange(count) + k) for k in range(6)]
    if name == "cube":
        return np.array(r[:3]), np.array(r[3:]) - 0.5
    t, p, a = 2 * np.pi * r[0], 2 * np.pi * r[1], 0.1 * np.sqrt(r[2])
    rho = 1 + a * np.cos(p)
    x = np.array([rho * np.cos(t), rho * np.sin(t), a * np.sin(p)])
    return x, np.array([-np.sin(t), np.cos(t), np.zeros(count)])

def curl(gradient):
    g = np.asarray(gradient)
    return np.array([g[2, 1] - g[1, 2], g[0, 2] - g[2, 0], g[1, 0] - g[0, 1]])

print("| cloud | vortons | program | requested | CPU s | error |\\n|---|--:|---|--:|--:|--:|")
for name, count, runs in [("ring", 100_000, 3), ("cube", 100_000, 3), ("cube", 1_000_000, 1)]:
    if count > 100_000 and sys.argv[1] == "no-million":
        continue
    x, strength = cloud(name, count)
    chosen = np.arange(400) * count // 400
    direct = fmm3dpy.l3ddir(sources=x, charges=strength, targets=x[:, chosen], pgt=2, nd=3, thresh=1e-12)
    exact = curl(direct.gradtarg)
    for requested in [1e-2, 1e-3, 1e-4]:
        best = np.inf
        for _ in range(runs):
            start = time.process_time()
            found = fmm3dpy.lfmm3d(eps=requested, sources=x, charges=strength, pg=2, nd=3)
            best = min(best, time.process_time() - start)
        error = np.linalg.norm(curl(found.grad)[:, chosen] - exact) / np.linalg.norm(exact)
        print(f"| {name} | {count} | fmm3dpy | {requested:.0e} | {best:.3f} | {error:.1e} |", flush=True)
'''


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--no-peer", action="store_true", help="leave fmm3dpy out")
    parser.add_argument("--no-million", action="store_true", help="leave the peer's cloud of a million out")
    parser.add_argument(
        "--venv", type=pathlib.Path, default=ROOT / "target/vortex-venv", help="made and filled if missing"
    )
    options = parser.parse_args()
    # A filter that no criterion measurement matches: the tables alone.
    bench = ["cargo", "bench", "--quiet", "--bench", "vortex", "--", "no-measurement"]
    subprocess.run(bench, cwd=ROOT, check=True)
    if not options.no_peer:
        python = environment(options.venv.resolve(), ["numpy", "fmm3dpy==2.1.0"], "numpy, fmm3dpy")
        size = "no-million" if options.no_million else "million"
        subprocess.run([python, "-c", PEER, size], env=os.environ | {"OMP_NUM_THREADS": "1"}, check=True)


if __name__ == "__main__":
    main()
