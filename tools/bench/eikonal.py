#!/usr/bin/env python3
"""Meniscus and scikit-fmm on the same ball, in one table: CPU nanoseconds a node and error.

    tools/bench/eikonal.py                 both, at 256³
    tools/bench/eikonal.py --no-peer       Meniscus alone: error against time for orders, bands and blocks

Needs cargo, and for the peer numpy and a network for the first run (pip fills a virtual environment, see --venv).

*Case*: a ball of a fifth of the side in a box of 256³ nodes, its middle on no node. Meniscus: `benches/eikonal.rs`, from an
exact band of three voxels or from a field. scikit-fmm starts from the same distance, clipped to three voxels; it takes its
own start from the crossings between nodes. Errors of both are those of |distance| over all nodes.

*Cost*: CPU seconds of the process, so other work on the machine shows little. scikit-fmm runs on one thread.
"""

import argparse
import pathlib
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]

PEER = """
import time
import numpy as np
import skfmm
n, radius = 256, 0.2 * 256
x = np.arange(n) - n / 2
exact = np.sqrt(
    (x[None, None, :] - 0.31) ** 2 + (x[None, :, None] + 0.17) ** 2 + (x[:, None, None] - 0.05) ** 2
) - radius
for order in (1, 2):
    start = time.process_time()
    found = skfmm.distance(np.clip(exact, -3, 3), dx=1.0, order=order)
    seconds = time.process_time() - start
    error = np.abs(np.abs(found) - np.abs(exact))
    each = seconds / n**3 * 1e9
    print(f"| scikit-fmm {skfmm.__version__}, order {order}, 1 | inf | {n**3} | {each:.1f} | | "
          f"{error.mean():.4f} | {error.max():.3f} |", flush=True)
"""


def environment(folder: pathlib.Path) -> pathlib.Path:
    """The Python of a virtual environment that has scikit-fmm."""
    python = folder / "bin/python"
    if not python.exists():
        subprocess.run([sys.executable, "-m", "venv", folder], check=True)
    if subprocess.run([python, "-c", "import skfmm"], stderr=subprocess.DEVNULL).returncode != 0:
        subprocess.run([python, "-m", "pip", "install", "--quiet", "scikit-fmm", "numpy"], check=True)
    return python


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--no-peer", action="store_true", help="leave scikit-fmm out")
    parser.add_argument(
        "--venv", type=pathlib.Path, default=ROOT / "target/bench-venv", help="made and filled if missing"
    )
    options = parser.parse_args()
    # A filter that no criterion measurement matches: the table alone.
    bench = ["cargo", "bench", "--quiet", "--bench", "eikonal", "--", "no-measurement"]
    subprocess.run(bench, cwd=ROOT, check=True)
    if not options.no_peer:
        subprocess.run([environment(options.venv.resolve()), "-c", PEER], check=True)


if __name__ == "__main__":
    main()
