#!/usr/bin/env python3
# SPDX-License-Identifier: MIT OR Apache-2.0
"""Makes the figures and the glass of the built-in presets: bear, duck, glass, rabbit and rubber-duck.ply of presets/assets.

    tools/figures.py                        all of them
    tools/figures.py rabbit -o /some/where  one of them, elsewhere
    tools/figures.py --cells 80             finer

A figure is a smooth union of ellipsoids and capsules, about 1 high, standing on z = 0 and looking along -Y. Its surface
is meshed by naive surface nets: a vertex in each cell that the surface crosses, at the mean of the crossings of the
cell's edges and then moved onto the surface; a quad about each crossed edge of the grid. The result is checked: closed,
every edge between two faces that agree on it, volume above zero. The glass is a profile turned about Z, 1 high.
Needs numpy; the same numpy gives the same bytes.
"""

import argparse
import pathlib

import numpy as np

ROOT = pathlib.Path(__file__).resolve().parents[1]
# Steps along the gradient that take a vertex onto the surface. Three reach 1e-4 everywhere but in creases.
PROJECTIONS = 3


def ellipsoid(points, center, radii):
    """About the distance to an ellipsoid: exact on its surface, and good near it."""
    q = (points - center) / radii
    k0 = np.linalg.norm(q, axis=-1)
    k1 = np.linalg.norm(q / radii, axis=-1)
    return np.where(k1 > 0, k0 * (k0 - 1) / np.maximum(k1, 1e-12), -min(radii))


def capsule(points, start, end, radius):
    """The distance to a cylinder with round ends."""
    start, axis = np.array(start), np.subtract(end, start)
    along = np.clip((points - start) @ axis / (axis @ axis), 0, 1)
    return np.linalg.norm(points - start - along[..., None] * axis, axis=-1) - radius


def blend(distances, width):
    """The union, with fillets about `width` wide: the polynomial smooth minimum, one after the other."""
    union = distances[0]
    for other in distances[1:]:
        h = np.clip(0.5 + 0.5 * (other - union) / width, 0, 1)
        union = other + (union - other) * h - width * h * (1 - h)
    return union


def both(shape, points, first, *rest):
    """The shape on either side of the figure: at x and at -x."""
    return shape(points * (-1, 1, 1), first, *rest), shape(points, first, *rest)


def rabbit(p):
    """Sits up, with its ears laid back a little."""
    return blend(
        [
            ellipsoid(p, (0, 0.06, 0.25), (0.22, 0.27, 0.25)),
            ellipsoid(p, (0, -0.07, 0.36), (0.17, 0.16, 0.22)),
            ellipsoid(p, (0, -0.15, 0.57), (0.14, 0.17, 0.14)),
            ellipsoid(p, (0, 0.34, 0.20), (0.08, 0.08, 0.08)),
            *both(ellipsoid, p, (0.17, 0.06, 0.15), (0.10, 0.19, 0.15)),
            *both(capsule, p, (0.16, -0.16, 0.055), (0.15, 0.08, 0.055), 0.055),
            *both(capsule, p, (0.06, -0.20, 0.34), (0.05, -0.23, 0.06), 0.06),
            *both(capsule, p, (0.06, -0.10, 0.68), (0.11, 0.06, 0.945), 0.055),
        ],
        0.05,
    )


def bear(p):
    """Sits with its legs out in front and its arms thrown up."""
    return blend(
        [
            ellipsoid(p, (0, 0.04, 0.28), (0.23, 0.20, 0.28)),
            ellipsoid(p, (0, 0.00, 0.68), (0.20, 0.18, 0.18)),
            ellipsoid(p, (0, -0.17, 0.64), (0.085, 0.075, 0.07)),
            *both(ellipsoid, p, (0.15, 0.02, 0.86), (0.075, 0.05, 0.075)),
            *both(capsule, p, (0.18, 0.0, 0.44), (0.40, -0.10, 0.62), 0.075),
            *both(capsule, p, (0.14, -0.06, 0.10), (0.22, -0.36, 0.10), 0.095),
            *both(capsule, p, (0.22, -0.40, 0.10), (0.22, -0.40, 0.15), 0.085),
        ],
        0.05,
    )


def duck(p):
    """Sits as on a pond: a boat of a body, tail up, and a beak."""
    return blend(
        [
            ellipsoid(p, (0, 0.06, 0.26), (0.30, 0.42, 0.26)),
            capsule(p, (0, 0.38, 0.36), (0, 0.52, 0.50), 0.065),
            capsule(p, (0, -0.20, 0.40), (0, -0.22, 0.62), 0.13),
            ellipsoid(p, (0, -0.24, 0.77), (0.19, 0.20, 0.19)),
            ellipsoid(p, (0, -0.47, 0.72), (0.095, 0.12, 0.045)),
            *both(ellipsoid, p, (0.28, 0.10, 0.32), (0.07, 0.25, 0.14)),
        ],
        0.05,
    )


def rubber_duck(p):
    """Floats upright although its density is the same everywhere: a beamy, flat hull, and a small head above its middle."""
    return blend(
        [
            ellipsoid(p, (0, 0.02, 0.21), (0.42, 0.52, 0.21)),
            capsule(p, (0, 0.42, 0.27), (0, 0.56, 0.37), 0.06),
            capsule(p, (0, -0.14, 0.32), (0, -0.17, 0.46), 0.11),
            ellipsoid(p, (0, -0.18, 0.56), (0.165, 0.175, 0.16)),
            ellipsoid(p, (0, -0.37, 0.52), (0.085, 0.11, 0.042)),
            *both(ellipsoid, p, (0.34, 0.08, 0.30), (0.08, 0.26, 0.11)),
        ],
        0.05,
    )


# Half of the glass's section, (radius, height), from the middle of its base around the rim to the middle of its bottom.
GLASS = ((0, 0), (0.29, 0), (0.32, 0.02), (0.33, 0.05), (0.40, 0.98), (0.395, 0.995), (0.38, 1.0), (0.365, 0.995),
         (0.36, 0.98), (0.295, 0.12), (0.28, 0.09), (0.25, 0.075), (0, 0.07))


def glass(sides=64):
    """Vertices (n, 3) and triangles (m, 3) of the glass, a polygon of so many sides."""
    angles = np.arange(sides) * 2 * np.pi / sides
    ring = np.stack([np.cos(angles), np.sin(angles), np.zeros(sides)], axis=1)
    first, *inner, last = GLASS
    rings = [ring * radius + (0, 0, height) for radius, height in inner]
    vertices = np.concatenate([[(0, 0, first[1])], *rings, [(0, 0, last[1])]])
    here, there = np.arange(sides), (np.arange(sides) + 1) % sides
    triangles = [np.stack([0 * here, 1 + there, 1 + here], axis=1)]
    for k in range(len(rings) - 1):
        a, b = 1 + k * sides, 1 + (k + 1) * sides
        triangles += [np.stack([a + here, a + there, b + there], axis=1), np.stack([a + here, b + there, b + here], axis=1)]
    end = 1 + (len(rings) - 1) * sides
    triangles.append(np.stack([end + here, end + there, 0 * here + len(vertices) - 1], axis=1))
    return vertices, np.concatenate(triangles)


FIGURES = {"bear": bear, "duck": duck, "glass": glass, "rabbit": rabbit, "rubber-duck": rubber_duck}
# Cells for a height of 1, where a figure has others than --cells by default.
CELLS = {"rubber-duck": 24}


def surface(figure, cells):
    """Vertices (n, 3) and triangles (m, 3) of the figure's surface, with `cells` cells for a height of 1."""
    step = 1 / cells
    axes = [np.arange(np.floor(low * cells), np.ceil(high * cells) + 1) * step for low, high in
            ((-0.6, 0.6), (-0.7, 0.7), (-0.1, 1.1))]
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1) + step / 2
    values = figure(nodes)
    inside = values < 0

    # Every edge of the grid that the surface crosses adds its crossing to the four cells about it, and is a quad of them.
    count = np.zeros(inside.shape)
    total = np.zeros(nodes.shape)
    quads = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        here = np.take(inside, range(inside.shape[axis] - 1), axis)
        there = np.take(inside, range(1, inside.shape[axis]), axis)
        edges = np.argwhere(here != there)
        ends = edges + np.eye(3, dtype=int)[axis]
        a, b = values[tuple(edges.T)], values[tuple(ends.T)]
        crossing = nodes[tuple(edges.T)] + (a / (a - b))[:, None] * np.eye(3)[axis] * step
        around = []
        for back_u, back_v in ((1, 1), (0, 1), (0, 0), (1, 0)):
            cell = edges - back_u * np.eye(3, dtype=int)[u] - back_v * np.eye(3, dtype=int)[v]
            np.add.at(count, tuple(cell.T), 1)
            np.add.at(total, tuple(cell.T), crossing)
            around.append(np.ravel_multi_index(tuple(cell.T), inside.shape))
        quad = np.stack(around, axis=1)
        leaves = inside[tuple(edges.T)]
        quads.append(np.where(leaves[:, None], quad, quad[:, ::-1]))

    # Cells become vertices, in the order of the grid.
    crossed = np.flatnonzero(count.ravel())
    vertices = total.reshape(-1, 3)[crossed] / count.ravel()[crossed, None]
    quads = np.searchsorted(crossed, np.concatenate(quads))
    for _ in range(PROJECTIONS):
        vertices = onto(figure, vertices, step)

    # The shorter diagonal cuts a quad in two.
    across = [np.linalg.norm(vertices[quads[:, i]] - vertices[quads[:, i + 2]], axis=1) for i in (0, 1)]
    first = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]], axis=1)
    second = np.concatenate([quads[:, [1, 2, 3]], quads[:, [1, 3, 0]]], axis=1)
    return vertices, np.where((across[0] <= across[1])[:, None], first, second).reshape(-1, 3)


def onto(figure, vertices, step):
    """The vertices, moved along the gradient towards the surface by at most a quarter of a cell."""
    h = 1e-4
    gradient = np.stack([(figure(vertices + e) - figure(vertices - e)) / (2 * h) for e in h * np.eye(3)], axis=1)
    length2 = np.maximum((gradient**2).sum(axis=1), 0.1)
    by = np.clip(figure(vertices) / length2, -step / 4, step / 4)
    return vertices - by[:, None] * gradient


def check(vertices, triangles):
    """The enclosed volume. Refuses a surface that is open, has an edge of more than two faces, or is inside out."""
    directed = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    codes = directed[:, 0] * len(vertices) + directed[:, 1]
    back = directed[:, 1] * len(vertices) + directed[:, 0]
    if len(np.unique(codes)) != len(codes) or not np.array_equal(np.sort(codes), np.sort(back)):
        raise SystemExit("an edge is not between two faces that agree on it; try other --cells")
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    volume = np.einsum("ij,ij->", a, np.cross(b, c)) / 6
    if volume <= 0:
        raise SystemExit("the surface is inside out")
    return volume


def write(path, name, vertices, triangles):
    """Binary PLY: float positions, and triangles of int indices."""
    header = (
        f"ply\nformat binary_little_endian 1.0\ncomment {name}, made by tools/figures.py\n"
        f"element vertex {len(vertices)}\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face {len(triangles)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    faces = np.empty(len(triangles), [("n", "u1"), ("indices", "<i4", 3)])
    faces["n"], faces["indices"] = 3, triangles
    path.write_bytes(header.encode() + vertices.astype("<f4").tobytes() + faces.tobytes())


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("figures", nargs="*", metavar="FIGURE", help=", ".join(FIGURES))
    parser.add_argument("-o", "--output", type=pathlib.Path, default=ROOT / "presets/assets")
    parser.add_argument("--cells", type=int, help="cells for a height of 1 (default 36; rubber-duck 24)")
    options = parser.parse_args()
    for name in options.figures or FIGURES:
        if name not in FIGURES:
            parser.error(f"found {name}, expected one of {', '.join(FIGURES)}")
        figure = FIGURES[name]
        vertices, triangles = figure() if figure is glass else surface(figure, options.cells or CELLS.get(name, 36))
        volume = check(vertices, triangles)
        path = options.output / f"{name}.ply"
        write(path, name, vertices, triangles)
        low, high = vertices.min(axis=0).round(3), vertices.max(axis=0).round(3)
        print(f"{path.name}: {len(triangles)} triangles, {path.stat().st_size} bytes, volume {volume:.4f}, "
              f"from {low.tolist()} to {high.tolist()}")


if __name__ == "__main__":
    main()
