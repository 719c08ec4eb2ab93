"""Judges a surface, whoever wrote it: `python surface_judge.py JOB.json` prints JSON.

Every program's files go through this file alone. Of any mesh:

- *open*, *crowded*, *turned* edges: with one triangle, with more than two, with two that run the same way. *Pinched*
  vertices: their triangles form more than one fan. None of these: the mesh is closed, manifold and oriented.
- *degenerate* triangles: a corner named twice, two corners at one place, or a height below a millionth of the longest
  side. *Slivers*: a smallest angle below one degree.
- *grid*: distance of the planes that many vertices share [m], which marching cubes leaves behind and smoothing wipes
  out: it shows that two programs used the same voxel.
- *components* that share no vertex, *handles* through them (genus, of a closed manifold mesh), volume [m³] by the
  divergence theorem, its error against the particles' own N · spacing³, and area [m²].

Of shapes that are known, in double precision:

- ball: *roughness* is the RMS of the vertices' distance from the centre about its mean, in particle radii (half a
  spacing). *Normals*: mean angle between a vertex's normal and the direction from the centre, of the normals in the
  file and of the mean of the faces' around it, weighted by area. *Hausdorff*: the largest distance from a vertex to the
  sphere of the particles' volume, and the largest from 20 000 points spread over that sphere to the mesh, in spacings.
- sheet: *thickness* in the middle third, its mean over the area and the smallest and largest over patches of 3 × 3
  spacings, in spacings; a sheet of n layers should have n.
- droplet, drop: *round* is the deviation of the vertices' distance from their middle over its mean.
"""

import json
import math
import pathlib
import sys

import numpy
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

TYPES = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
         "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
         "float32": "f4", "float64": "f8"}  # fmt: skip
# A triangle is flat if its height is at most this part of its longest side.
FLAT = 1e-6


def read_ply(path):
    """Vertices [m], triangles and, where the file has them, normals of a binary PLY of triangles."""
    data = path.read_bytes()
    end = data.index(b"end_header\n") + len(b"end_header\n")
    elements = []
    for line in data[:end].decode("ascii", "replace").splitlines():
        words = line.split()
        if words[0] == "format":
            order = {"binary_little_endian": "<", "binary_big_endian": ">"}[words[1]]
        elif words[0] == "element":
            elements.append((words[1], int(words[2]), []))
        elif words[0] == "property":
            elements[-1][2].append(words[1:])
    tables = {}
    for name, count, properties in elements:
        fields = []
        for words in properties:
            if words[0] == "list":
                fields += [("count", order + TYPES[words[1]]), (words[3], order + TYPES[words[2]], 3)]
            else:
                fields.append((words[1], order + TYPES[words[0]]))
        rows = numpy.frombuffer(data, numpy.dtype(fields), count, end)
        end += rows.nbytes
        if "count" in rows.dtype.names and (rows["count"] != 3).any():
            sys.exit(f"{path}: a face with {rows['count'].max()} corners, expected triangles only")
        tables[name] = rows
    vertex, face = tables["vertex"], tables["face"]

    def columns(names):
        return numpy.stack([vertex[name] for name in names], 1).astype(float)

    corners = next(name for name in face.dtype.names if name != "count" and face[name].ndim == 2)
    normals = columns(["nx", "ny", "nz"]) if "nx" in vertex.dtype.names else None
    return columns("xyz"), face[corners].astype(numpy.int64), normals


def sound(x, triangles):
    """Figures of any mesh."""
    corners = x[triangles]
    sides = corners[:, [1, 2, 0]] - corners
    lengths = numpy.sqrt((sides**2).sum(2))
    doubled = numpy.sqrt((numpy.cross(sides[:, 0], sides[:, 1]) ** 2).sum(1))
    repeated = (triangles == triangles[:, [1, 2, 0]]).any(1)
    flat = repeated | (doubled <= FLAT * lengths.max(1) ** 2)
    # The smallest angle lies opposite to the shortest side: its sine is 2 A over the product of the other two.
    ordered = numpy.sort(lengths, 1)
    with numpy.errstate(divide="ignore", invalid="ignore"):
        sine = doubled / (ordered[:, 1] * ordered[:, 2])
    slivers = flat | (sine < math.sin(math.radians(1)))

    middle = x.mean(0) if len(x) else numpy.zeros(3)
    a, b, c = (corners[:, k] - middle for k in range(3))
    figures = {
        "vertices": len(x),
        "triangles": len(triangles),
        "degenerate": int(flat.sum()),
        "slivers": int(slivers.sum()),
        "volume": float(numpy.einsum("ij,ij->i", a, numpy.cross(b, c)).sum() / 6),
        "area": float(doubled.sum() / 2),
        "finite": bool(numpy.isfinite(x).all()),
        "grid": grid(x),
    }
    return figures | topology(len(x), triangles)


def grid(x):
    """The step of the planes across x that twenty vertices or more lie on; None if less than half of them do.

    Of the vertices on edges of a grid, those along y and z, two in three, lie on such a plane.
    """
    values, counts = numpy.unique(numpy.round(x[:, 0], 6), return_counts=True)
    shared = counts >= 20
    if 2 * counts[shared].sum() < len(x):
        return None
    planes = values[shared]
    steps = numpy.diff(planes)
    # A plane may be rounded up and down, each by half a millionth: the whole width gives the step more exactly.
    steps = steps[steps > 5e-6]
    if len(steps) <= 10:
        return None
    width = planes[-1] - planes[0]
    return float(width / round(width / numpy.median(steps)))


def topology(n, triangles):
    """Edges, fans and connected components."""
    start, stop = triangles.reshape(-1), triangles[:, [1, 2, 0]].reshape(-1)
    # Each corner owns the side that starts there; sides of one edge come together.
    low, high = numpy.minimum(start, stop), numpy.maximum(start, stop)
    key = low * n + high
    order = numpy.argsort(key, kind="stable")
    first = numpy.flatnonzero(numpy.diff(key[order], prepend=-1))
    count = numpy.diff(first, append=len(key))
    pair = first[count == 2]
    p, q = order[pair], order[pair + 1]
    turned = start[p] == start[q]

    # Corners at one vertex that share an edge belong to one fan; a corner's side ends at the triangle's next corner.
    following = numpy.arange(len(start)).reshape(-1, 3)[:, [1, 2, 0]].reshape(-1)
    p, q = p[~turned], q[~turned]
    fans, fan = components(len(start), numpy.concatenate([p, following[p]]), numpy.concatenate([following[q], q]))
    of_fan = numpy.empty(fans, numpy.int64)
    of_fan[fan] = start
    around = numpy.bincount(of_fan, minlength=n)
    pinched = int((around > 1).sum())
    used = int((around > 0).sum())

    parts = components(n, start, stop)[0] - (n - used)
    euler = used - len(first) + len(triangles)
    closed = not ((count == 1).any() or (count > 2).any() or turned.any() or pinched)
    return {
        "open": int((count == 1).sum()),
        "crowded": int((count > 2).sum()),
        "turned": int(turned.sum()),
        "pinched": pinched,
        "components": int(parts),
        "handles": int(parts - euler // 2) if closed else None,
        "unused": n - used,
    }


def components(n, rows, columns):
    """The number of connected components of n nodes, and the component of each."""
    graph = coo_matrix((numpy.ones(len(rows), bool), (rows, columns)), (n, n))
    return connected_components(graph, directed=False)


def face_normals(x, triangles):
    """The mean normal of the triangles around each vertex, weighted by area; unit length."""
    corners = x[triangles]
    cross = numpy.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    total = numpy.stack([numpy.bincount(triangles.reshape(-1), cross[:, k].repeat(3), len(x)) for k in range(3)], 1)
    return total / numpy.maximum(numpy.linalg.norm(total, axis=1, keepdims=True), 1e-300)


def mean_angle(a, b):
    """Mean angle [degrees] between rows, exact for small ones too."""
    across = numpy.linalg.norm(numpy.cross(a, b), axis=1)
    return float(numpy.degrees(numpy.arctan2(across, (a * b).sum(1))).mean())


def ball(x, triangles, normals, known):
    spacing = known["spacing"]
    away = x - numpy.array(known["centre"])
    r = numpy.linalg.norm(away, axis=1)
    radius = (3 * known["particles"] * spacing**3 / (4 * math.pi)) ** (1 / 3)
    outward = away / r[:, None]
    points = numpy.array(known["centre"]) + radius * spread(20000)
    figures = {
        "roughness": float(r.std() / (spacing / 2)),
        "face_normals": mean_angle(face_normals(x, triangles), outward),
        "from_mesh": float(numpy.abs(r - radius).max() / spacing),
        "to_mesh": float(distance(points, x, triangles).max() / spacing),
    }
    if normals is not None:
        figures["file_normals"] = mean_angle(normals, outward)
        figures["normals_off_unit"] = int((numpy.abs(numpy.linalg.norm(normals, axis=1) - 1) > 1e-3).sum())
    return figures


def spread(n):
    """Directions spread evenly over the sphere."""
    k = numpy.arange(n) + 0.5
    z, turn = 1 - 2 * k / n, math.pi * (1 + math.sqrt(5)) * k
    flat = numpy.sqrt(1 - z * z)
    return numpy.stack([flat * numpy.cos(turn), flat * numpy.sin(turn), z], 1)


def distance(points, x, triangles):
    """Distance from points to a mesh: exact to the sixteen triangles whose middles are nearest."""
    corners = x[triangles]
    near = cKDTree(corners.mean(1)).query(points, min(16, len(triangles)))[1].reshape(len(points), -1)
    return numpy.min([to_triangles(points, corners[column]) for column in near.T], axis=0)


def to_triangles(p, corners):
    """Distance from each point to its triangle: to the plane where it lies over it, else to the nearest side."""
    sides = corners[:, [1, 2, 0]] - corners
    normal = numpy.cross(sides[:, 0], sides[:, 1])
    from_corner = p[:, None] - corners
    inside = (numpy.einsum("ijk,ijk->ij", numpy.cross(normal[:, None], sides), from_corner) >= 0).all(1)
    length = numpy.maximum(numpy.linalg.norm(normal, axis=1), 1e-300)
    plane = numpy.abs((normal * from_corner[:, 0]).sum(1)) / length
    along = (sides * from_corner).sum(2) / numpy.maximum((sides**2).sum(2), 1e-300)
    foot = corners + numpy.clip(along, 0, 1)[:, :, None] * sides
    side = numpy.linalg.norm(p[:, None] - foot, axis=2).min(1)
    return numpy.where(inside, plane, side)


def sheet(x, triangles, known):
    """Thickness [spacings] in the middle third of a sheet of 60 by 60, with the sheet laid flat."""
    flat = (x - numpy.array(known["centre"])) @ numpy.array(known["rotation"]) / known["spacing"]
    corners = flat[triangles]
    cross = numpy.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    middle = corners.mean(1)
    # Twenty by twenty spacings as patches of three by three: 18 of them fit.
    patch = numpy.floor((middle[:, :2] + 9) / 3).astype(int)
    inside = ((patch >= 0) & (patch < 6)).all(1)
    index = patch[inside] @ [6, 1]
    shadow = cross[inside, 2] / 2
    volume = numpy.bincount(index, shadow * middle[inside, 2], 36)
    thick = volume / 9
    upper = inside & (cross[:, 2] > 0)
    return {
        "thickness": float(thick.mean()),
        "thinnest": float(thick.min()),
        "thickest": float(thick.max()),
        "sheet_roughness": float(middle[upper, 2].std() / 0.5),
    }


def judge(path, known):
    x, triangles, normals = read_ply(path)
    figures = sound(x, triangles)
    name = known["name"]
    figures["volume_error"] = figures["volume"] / (known["particles"] * known["spacing"] ** 3) - 1
    if name.endswith("ball"):
        figures |= ball(x, triangles, normals, known)
    if name.startswith("sheet"):
        figures |= sheet(x, triangles, known)
    if name.startswith("drop"):
        r = numpy.linalg.norm(x - x.mean(0), axis=1)
        figures["round"] = float(r.std() / r.mean())
    return figures


def main():
    job = json.loads(pathlib.Path(sys.argv[1]).read_text())
    print(json.dumps([judge(pathlib.Path(path), known) for path, known in job["meshes"]]))


if __name__ == "__main__":
    main()
