"""Particles to be surfaced, made from nothing but their names: `surface_scenes.py splash-100k out.xyz`.

Every scene starts on a cubic seeding lattice and is jittered: each particle moves by up to JITTER spacings along each axis,
drawn from a generator with a fixed seed. Files hold raw little-endian single-precision triples without a header, which both
programs read as `.xyz`.

- `splash-100k`, `splash-1M`, `splash-4M`, and `splash-10M`, `splash-20M` for the limits of size: a pool a metre deep
  with waves, and over each patch of it a crown, a thin curved sheet and spray. A larger one is a wider pool with more of
  them, not a magnified one, so the share of its particles near the surface is about the same: a cube of 95 000 particles
  has 13 % of them in its outermost layer, one of four million 4 %.
- `spray`: droplets of one to a few dozen particles, hardly any interior.
- `ball`: radius 40 spacings. `sheet1`, `sheet2`: 60 × 60 spacings, one and two particles thick. `filament`: 80
  particles in a row. `droplet`: one particle. `drop`: radius 2.5 spacings. These five have a spacing of 0.05 m too, and
  lie turned against the grid by a fixed rotation, so that the grid favours no program.
"""

import argparse
import math
import pathlib

import numpy
from scipy import ndimage

SPACING = 0.05  # m
JITTER = 0.15  # spacings
SEED = 20130201
# Keeps the seeding lattice off grid nodes, since voxels divide the spacing.
SHIFT = numpy.array([0.137, 0.291, 0.433])

# Name: cells along the pool's sides (x, y), depth in cells, patches with a crown along x and y.
SPLASHES = {
    "splash-10k": ((26, 26), 12, (1, 1)),
    "splash-100k": ((62, 62), 24, (1, 1)),
    "splash-1M": ((198, 198), 24, (3, 3)),
    "splash-4M": ((398, 398), 24, (6, 6)),
    "splash-10M": ((645, 645), 24, (10, 10)),
    "splash-20M": ((912, 912), 24, (14, 14)),
}


def splash(name, time=0.0):
    """The filled cells of the seeding lattice: the pool, and the splashes above it. `time` [frames] moves all of it."""
    (nx, ny), depth, (px, py) = SPLASHES[name]
    random = numpy.random.default_rng(SEED)
    height = 2 * depth + 24
    filled = numpy.zeros((nx, ny, height), bool)
    x, y = numpy.meshgrid(numpy.arange(nx) + 0.5, numpy.arange(ny) + 0.5, indexing="ij")

    # Waves of a few lengths and directions.
    level = numpy.full((nx, ny), float(depth))
    for length, size in [(61.0, 1.6), (37.0, 1.1), (23.0, 0.8), (13.0, 0.5)]:
        turn, phase = random.uniform(0, 2 * math.pi, 2)
        along = x * math.cos(turn) + y * math.sin(turn)
        level += size * numpy.sin(2 * math.pi * (along / length - time / 24) + phase)

    z = numpy.arange(height) + 0.5
    wide = nx / px
    for i in range(px):
        for j in range(py):
            centre = numpy.array([(i + random.uniform(0.4, 0.6)) * wide, (j + random.uniform(0.4, 0.6)) * ny / py])
            radius = wide * random.uniform(0.2, 0.26)
            dx, dy = x - centre[0], y - centre[1]
            away, angle = numpy.hypot(dx, dy), numpy.arctan2(dy, dx)

            # A crater, and around it a crown that opens upwards, two particles thick and lower between its fingers.
            level -= 0.35 * depth * numpy.exp(-((away / (0.8 * radius)) ** 2))
            fingers = random.integers(9, 15)
            rise = depth * random.uniform(0.7, 0.9)
            top = depth + rise * (0.75 + 0.25 * numpy.cos(fingers * angle + time / 6))
            for k in range(depth - 2, height):
                opened = radius * (1 + 0.35 * ((z[k] - depth) / rise) ** 2)
                thick = 2.6 - 1.2 * min(max((z[k] - depth) / rise, 0.0), 1.0)
                filled[:, :, k] |= (numpy.abs(away - opened) < thick / 2) & (z[k] < top)

            # A curved sheet about one and a half particles thick, thrown outwards over an eighth of the circle.
            start = random.uniform(-math.pi, math.pi)
            inside = numpy.abs((angle - start - time / 48 + math.pi) % (2 * math.pi) - math.pi) < math.pi / 8
            for k in range(depth, height):
                reach = 1.5 * radius + 4 * math.sin((z[k] - depth) / (0.4 * rise))
                filled[:, :, k] |= inside & (numpy.abs(away - reach) < 0.75) & (z[k] < depth + 1.2 * rise)
    filled |= z < level[:, :, None]

    # Spray flies free: droplets that would touch something are left out.
    blocked = ndimage.binary_dilation(filled, iterations=2)
    share = 0.004 * nx * ny * depth
    drops = max(int(share / 6), 4)
    low = depth + 4
    at = random.uniform([1, 1, low], [nx - 1, ny - 1, height - 2], (drops, 3))
    at[:, 2] += 0.5 * time * numpy.sin(at[:, 0])
    droplets(filled, blocked, at, random)
    return filled


def droplets(filled, blocked, centres, random):
    """Fills balls of 0.5 to 2 cells at `centres`, those that touch nothing in `blocked`."""
    for centre, radius in zip(centres, random.choice([0.5, 0.9, 1.3, 1.9], len(centres), p=[0.5, 0.25, 0.15, 0.1])):
        first = numpy.maximum(numpy.floor(centre - radius - 1).astype(int), 0)
        last = numpy.minimum(numpy.ceil(centre + radius + 1).astype(int), filled.shape)
        if (last <= first).any():
            continue
        box = tuple(slice(a, b) for a, b in zip(first, last))
        cells = numpy.stack(numpy.meshgrid(*(numpy.arange(a, b) for a, b in zip(first, last)), indexing="ij"), -1)
        middle = numpy.floor(centre)
        ball = ((cells - middle) ** 2).sum(-1) <= radius**2
        if not (ball & blocked[box]).any():
            filled[box] |= ball


def spray():
    """Droplets in a box, hardly any interior: about 60 000 particles."""
    random = numpy.random.default_rng(SEED + 1)
    side = 160
    filled = numpy.zeros((side, side, side), bool)
    centres = random.uniform(3, side - 3, (12000, 3))
    droplets(filled, filled, centres, random)
    return filled


def outermost(filled):
    """How many filled cells have an empty neighbour across a face, and how many are within two cells of one."""
    ball = numpy.zeros((5, 5, 5), bool)
    steps = numpy.stack(numpy.meshgrid(*[numpy.arange(-2, 3)] * 3, indexing="ij"), -1)
    ball[(steps**2).sum(-1) <= 4] = True
    layer = filled & ~ndimage.binary_erosion(filled)
    return int(layer.sum()), int((filled & ~ndimage.binary_erosion(filled, ball)).sum())


def jittered(cells, seed, turned=False):
    """Positions [m] of particles at the sites `cells` of the seeding lattice, moved by up to JITTER."""
    random = numpy.random.default_rng(seed)
    cells = cells + SHIFT + random.uniform(-JITTER, JITTER, cells.shape)
    if turned:
        cells = cells @ ROTATION.T
    return SPACING * cells


def rotation(axis, degrees):
    x, y, z = numpy.asarray(axis) / numpy.linalg.norm(axis)
    a = math.radians(degrees)
    cross = numpy.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return numpy.eye(3) + math.sin(a) * cross + (1 - math.cos(a)) * cross @ cross


ROTATION = rotation([1, 2, 3], 29)


def seeding_lattice(counts):
    """Sites of a block of the seeding lattice, centred on the origin."""
    axes = [numpy.arange(n) - (n - 1) / 2 for n in counts]
    return numpy.stack(numpy.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)


def ball(radius):
    cells = seeding_lattice([2 * math.ceil(radius) + 1] * 3)
    return cells[(cells**2).sum(1) <= radius**2]


# Shapes whose surface is known.
SHAPES = {
    "ball": lambda: ball(40),
    "small-ball": lambda: ball(12),
    "sheet1": lambda: seeding_lattice([60, 60, 1]),
    "sheet2": lambda: seeding_lattice([60, 60, 2]),
    "filament": lambda: seeding_lattice([80, 1, 1]),
    "droplet": lambda: seeding_lattice([1, 1, 1]),
    "drop": lambda: ball(2.5),
}
NAMES = [*SPLASHES, "spray", *SHAPES]


def make(name, time=0.0):
    """Positions [m] as float32, and the known figures of the scene."""
    if name in SHAPES:
        cells = SHAPES[name]()
        positions = jittered(cells, SEED + 2, turned=True)
        centre = SPACING * (SHIFT @ ROTATION.T)
        known = {"centre": centre.tolist(), "rotation": ROTATION.tolist()}
    else:
        filled = spray() if name == "spray" else splash(name, time)
        positions = jittered(numpy.argwhere(filled).astype(float), SEED + 3)
        layer, reach = outermost(filled)
        known = {"outermost": layer / len(positions), "within_kernel": reach / len(positions)}
    return positions.astype("<f4"), known | {"name": name, "particles": len(positions), "spacing": SPACING}


def write(name, path, time=0.0):
    """Writes a scene as raw triples; returns its known figures."""
    positions, known = make(name, time)
    positions.tofile(path)
    return known


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("name", choices=NAMES)
    parser.add_argument("path", type=pathlib.Path)
    parser.add_argument("--time", type=float, default=0.0, help="of a splash, in frames")
    options = parser.parse_args()
    print(write(options.name, options.path, options.time))


if __name__ == "__main__":
    main()
