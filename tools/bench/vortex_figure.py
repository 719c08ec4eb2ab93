#!/usr/bin/env python3
"""Draws vorticity, vector potential and velocity of a vortex ring, as figure 1 of [gourlay19].

    tools/bench/vortex_figure.py docs/images/vortex-ring.png

Needs cargo, and a network for the first run (pip fills a virtual environment, see --venv). The numbers are those of
`cargo bench --bench vortex -- fields`: a ring of 20 000 vortons in its plane (above) and in a plane through its axis (below).
Arrows are the components in the plane, with lengths as their square roots. Colour is the component normal to the plane, or
where that is small, the magnitude.
"""

import argparse
import pathlib
import subprocess

from shot import ROOT
from surfaces import environment

DRAW = '''
import io
import sys
import matplotlib
import numpy as np
from PIL import Image

matplotlib.use("Agg")
import matplotlib.pyplot as plt

NAMES = ["− vorticity", "vector potential", "velocity"]

def panel(axes, u, v, along, across, out):
    length = np.hypot(along, across)
    colour = length if np.abs(out).max() < 0.7 * length.max() else out
    limit = np.abs(colour).max()
    axes.pcolormesh(u, v, colour, cmap="RdBu_r", vmin=-limit, vmax=limit, shading="gouraud")
    if length.max() > 0.05 * limit:
        step = (slice(None, None, 2), slice(None, None, 2))
        shrink = 1 / np.sqrt(np.maximum(length * length.max(), 1e-30))
        axes.quiver(u[step], v[step], (along * shrink)[step], (across * shrink)[step], scale=22, width=0.004)

rows = np.loadtxt(io.StringIO(sys.stdin.read())).reshape(2, 49, 49, 13)
figure, axes = plt.subplots(2, 3, figsize=(9, 6.2), layout="constrained")
for plane, (first, second, third, label) in enumerate([(0, 1, 2, "y [m]"), (0, 2, 1, "z [m]")]):
    grid = rows[plane]
    for column, name in enumerate(NAMES):
        field = grid[..., 4 + 3 * column : 7 + 3 * column] * (-1 if column == 0 else 1)
        here = axes[plane, column]
        panel(here, grid[..., 1 + first], grid[..., 1 + second], field[..., first], field[..., second], field[..., third])
        here.set(title=name, xlabel="x [m]", ylabel=label, aspect="equal", xticks=[-1, 0, 1], yticks=[-1, 0, 1])
figure.savefig(sys.argv[1], dpi=80)
Image.open(sys.argv[1]).convert("RGB").quantize(256, Image.Quantize.MAXCOVERAGE).save(sys.argv[1], optimize=True)
'''


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("picture", type=pathlib.Path)
    parser.add_argument(
        "--venv", type=pathlib.Path, default=ROOT / "target/figure-venv", help="made and filled if missing"
    )
    options = parser.parse_args()
    bench = ["cargo", "bench", "--quiet", "--bench", "vortex", "--", "fields"]
    fields = subprocess.run(bench, cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True).stdout
    python = environment(options.venv.resolve(), ["numpy", "matplotlib"], "numpy, matplotlib")
    subprocess.run([python, "-c", DRAW, options.picture], input=fields, text=True, check=True)


if __name__ == "__main__":
    main()
