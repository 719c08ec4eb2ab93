"""Judges particles, whoever wrote them: `python liquid_judge.py JOB.json` prints JSON.

Both programs go through this file alone. ρ/ρ₀ of a particle is V · Σ W(r, h) over itself and its neighbours, V being
the rest volume that the program gives a particle, with s = V^(1/3) and the sum scaled to 1 on the cubic seeding lattice
of spacing s. Two kernels: the cubic spline with h = 2 s, and Wendland's C2 with h = 3 s ("wide"). Neither is neutral. On a
disordered liquid of one and the same number density kernels differ by a per cent or more: the first is the very
constraint that the peer solves, so it favours the peer; the second is a wider one of the family that Meniscus solves by
default (Wendland's C2 with h = 2 s), so it may favour Meniscus, though it depends less on the arrangement of particles.
Height, volume, mechanical energy, front and top need no kernel at all. The front is that of a thousandth of the
particles, the top that of a fiftieth of those in the last fifth of the tank, since single ones fly ahead.

Walls add nothing: near them ρ is too low, so
- the *bulk* are the particles farther than h from every wall and from every empty cell; cells are 1.5 s wide. They alone
  give the mean compression max(ρ/ρ₀ − 1, 0), the two-sided deviation |ρ/ρ₀ − 1|, the signed mean and the largest compression;
- the largest compression over *all* particles is a lower bound: walls could only add to it.
"""

import json
import pathlib
import sys

import numpy
from scipy import ndimage
from scipy.spatial import cKDTree

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "python"))
from meniscus_fx import cache as meniscus_cache  # noqa: E402  (found through the line above)


def spline(q):
    """The cubic spline, not normalized, of q = r/h in [0, 1]."""
    return numpy.where(q > 0.5, 2 * (1 - q) ** 3, 1 + 6 * q * q * (q - 1))


def wendland(q):
    """Wendland's C2 kernel, not normalized, of q = r/h in [0, 1]."""
    return (1 - q) ** 4 * (1 + 4 * q)


# Prefix of the figures, kernel, support in spacings.
KERNELS = [("", spline, 2), ("wide_", wendland, 3)]
# [m/s²], along −z in both programs.
GRAVITY = 9.81
# Pairs whose kernels are taken at once: a million particles have 60 million.
PAIRS = 1 << 22


def rest_sum(kernel, support):
    """Σ W of a particle inside a filled seeding lattice."""
    steps = numpy.arange(-support, support + 1)
    q = numpy.sqrt(sum(a * a for a in numpy.meshgrid(steps, steps, steps))) / support
    return kernel(q[q <= 1]).sum()


def densities(x, spacing):
    """ρ/ρ₀ of every particle, one array a kernel."""
    pairs = cKDTree(x).query_pairs(max(support for *_, support in KERNELS) * spacing, output_type="ndarray")
    totals = [numpy.full(len(x), kernel(numpy.zeros(1))[0]) for _, kernel, _ in KERNELS]
    for first in range(0, len(pairs), PAIRS):
        i, j = pairs[first : first + PAIRS].T
        difference = x[i] - x[j]
        r = numpy.sqrt(numpy.einsum("ij,ij->i", difference, difference)) / spacing
        for total, (_, kernel, support) in zip(totals, KERNELS):
            near = r < support
            w = kernel(r[near] / support)
            total += numpy.bincount(i[near], w, len(x)) + numpy.bincount(j[near], w, len(x))
    return [total / rest_sum(kernel, support) for total, (_, kernel, support) in zip(totals, KERNELS)]


def bulk(x, spacing, tank, support):
    """Which particles are farther than `support` spacings, at most 3, from walls and empty places."""
    h = support * spacing
    tank = numpy.asarray(tank)
    inside = ((x > h) & (x < tank - h)).all(axis=1)
    edge = 1.5 * spacing
    cells = numpy.maximum(numpy.floor(tank / edge).astype(int), 1)
    at = numpy.clip(numpy.floor(x / tank * cells).astype(int), 0, cells - 1)
    filled = numpy.zeros(cells, bool)
    filled[tuple(at.T)] = True
    # Two cells on every side are three spacings; beyond the walls nothing counts as empty.
    deep = ndimage.binary_erosion(filled, numpy.ones((5, 5, 5), bool), border_value=1)
    return inside & deep[tuple(at.T)]


def column(x, spacing, tank):
    """Heights of a column at rest over its floor, and the share of the rest volume that it fills."""
    bins = [max(int(side / (2 * spacing)), 1) for side in tank[:2]]
    place = [numpy.clip((x[:, a] / tank[a] * bins[a]).astype(int), 0, bins[a] - 1) for a in range(2)]
    top = numpy.full(bins, -numpy.inf)
    numpy.maximum.at(top, tuple(place), x[:, 2])
    # The outermost particles mark the walls of this program; a thousandth may stray.
    low, high = numpy.quantile(x, [0.001, 0.999], axis=0)
    footprint = numpy.prod(high[:2] - low[:2] + spacing)
    surface = numpy.median(top) + spacing / 2
    floor = low[2] - spacing / 2
    return {
        "surface": surface,
        "middle": x[:, 2].mean(),
        "volume": (surface - floor) * footprint / (len(x) * spacing**3),
        "footprint": footprint,
        "floor": floor,
    }


def load(path):
    """Positions, velocities and, where the program wrote it, its own ρ/ρ₀."""
    if path.suffix == ".npz":
        with numpy.load(path) as frame:
            return frame["position"].astype(float), frame["velocity"].astype(float), frame["density"]
    channels = meniscus_cache.read(path)["streams"]["liquid"]["channels"]
    return channels["position"].astype(float), channels["velocity"].astype(float), None


def judge(path, spacing, tank):
    """The figures of one frame."""
    x, v, own = load(path)
    far = x[:, 0] > 0.8 * tank[0]
    figures = {
        "rms_speed": numpy.sqrt((v * v).sum(axis=1).mean()),
        "column": column(x, spacing, tank),
        # Per mass [m²/s²].
        "energy": (0.5 * (v * v).sum(axis=1) + GRAVITY * x[:, 2]).mean(),
        "front": numpy.quantile(x[:, 0], 0.999) + spacing / 2,
        "top": numpy.quantile(x[far, 2], 0.98) + spacing / 2 if far.sum() > 50 else 0.0,
        "outside": int(((x < -spacing) | (x > numpy.asarray(tank) + spacing)).any(axis=1).sum()),
    }
    for rho, (prefix, _, support) in zip(densities(x, spacing), KERNELS):
        chosen = bulk(x, spacing, tank, support)
        deviation = rho[chosen] - 1
        named = {"bulk_share": chosen.mean(), "max_all": max(rho.max() - 1, 0.0)}
        if chosen.any():
            named |= {
                "compression": numpy.maximum(deviation, 0).mean(),
                "two_sided": numpy.abs(deviation).mean(),
                "signed": deviation.mean(),
                "max_bulk": max(deviation.max(), 0.0),
            }
        figures |= {prefix + key: value for key, value in named.items()}
    if own is not None and own.any():
        figures |= {"own_average": numpy.maximum(own - 1, 0).mean(dtype=float), "own_max": max(own.max() - 1, 0.0)}
    return {key: value if isinstance(value, (dict, int)) else float(value) for key, value in figures.items()}


def main():
    job = json.loads(pathlib.Path(sys.argv[1]).read_text())
    print(json.dumps([judge(pathlib.Path(path), job["spacing"], job["tank"]) for path in job["frames"]]))


if __name__ == "__main__":
    main()
