# SPDX-License-Identifier: MIT OR Apache-2.0
"""Writes a small shot folder without a simulation: a wobbling ball that flies, with its exact velocities.

    python tools/blender/tests/synthetic.py DIR [--first 1] [--last 5] [--step 1] [--empty 3]

The surface is p(d, t) = c + v t + r (1 + a sin(w t + k d_z)) d for unit directions d, so its velocity is
known in closed form. Frames listed by --empty have no vertices and no faces, as a shot has before its first
drop.
"""

import argparse
import json
import struct
from pathlib import Path

import numpy as np

import ply

CENTRE = np.array([0.3, 0.4, 0.6])
DRIFT = np.array([6.0, 0.5, -0.8])
RADIUS, AMPLITUDE, RATE, WAVES = 0.3, 0.15, 9.0, 5.0


def icosphere(subdivisions: int) -> tuple[np.ndarray, np.ndarray]:
    """Unit directions and outward triangles of a subdivided icosahedron."""
    g = (1.0 + 5.0**0.5) / 2.0
    points = [(-1, g, 0), (1, g, 0), (-1, -g, 0), (1, -g, 0), (0, -1, g), (0, 1, g)]
    points += [(0, -1, -g), (0, 1, -g), (g, 0, -1), (g, 0, 1), (-g, 0, -1), (-g, 0, 1)]
    faces = [(0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4)]
    faces += [(11, 10, 2), (10, 7, 6), (7, 1, 8), (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8)]
    faces += [(3, 8, 9), (4, 9, 5), (2, 4, 11), (6, 2, 10), (8, 6, 7), (9, 8, 1)]
    points = [np.array(p, float) / np.linalg.norm(p) for p in points]
    for _ in range(subdivisions):
        middle: dict[tuple[int, int], int] = {}

        def between(a: int, b: int) -> int:
            key = (min(a, b), max(a, b))
            if key not in middle:
                half = points[a] + points[b]
                middle[key] = len(points)
                points.append(half / np.linalg.norm(half))
            return middle[key]

        split = []
        for a, b, c in faces:
            ab, bc, ca = between(a, b), between(b, c), between(c, a)
            split += [(a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)]
        faces = split
    return np.array(points), np.array(faces)


def surface(directions: np.ndarray, triangles: np.ndarray, seconds: float) -> dict[str, np.ndarray]:
    """Vertex columns at a time: position, area-weighted normal and velocity."""
    phase = RATE * seconds + WAVES * directions[:, 2:3]
    position = CENTRE + DRIFT * seconds + RADIUS * (1.0 + AMPLITUDE * np.sin(phase)) * directions
    velocity = DRIFT + RADIUS * AMPLITUDE * RATE * np.cos(phase) * directions
    corners = position[triangles]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal = np.zeros_like(position)
    for corner in range(3):
        np.add.at(normal, triangles[:, corner], area)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return dict(zip(ply.PROPERTIES, np.concatenate([position, normal, velocity], axis=1).T))


def write_shot(
    folder: Path,
    first: int = 1,
    last: int = 5,
    step: int = 1,
    empty: tuple[int, ...] = (3,),
    fps: float = 24.0,
) -> Path:
    """Writes shot.json and the PLYs; returns the path of shot.json."""
    folder = Path(folder)
    directions, triangles = icosphere(3)
    for frame in range(first, last + 1, step):
        columns, faces = surface(directions, triangles, (frame - first) / fps), triangles
        if frame in empty:
            columns, faces = {name: values[:0] for name, values in columns.items()}, triangles[:0]
        ply.write(folder / "mesh" / f"liquid_{frame:04}.ply", columns, faces)
    frames = {"first": first, "last": last, "step": step}
    output = {"kind": "mesh", "name": "liquid", "format": "ply", "pattern": "mesh/liquid_{:04}.ply"}
    output |= {"frames": frames, "attributes": {"velocity": ["vx", "vy", "vz"]}}
    return write_manifest(folder, fps, output)


def write_manifest(folder: Path, fps: float, output: dict) -> Path:
    """Writes the shot.json of one output; returns its path."""
    shot = {"format": "meniscus-shot", "version": 1, "title": "Synthetic", "fps": fps, "frames": output["frames"]}
    shot |= {"up": "+Z", "length_unit": "m", "outputs": [output]}
    path = folder / "shot.json"
    path.write_text(json.dumps(shot, indent=2) + "\n", encoding="utf-8")
    return path


def sheet_places(seconds: float, side: int) -> np.ndarray:
    """A square of `side` x `side` points that flies and waves, with all sides to be seen."""
    u, v = np.meshgrid(np.linspace(0.0, 1.0, side), np.linspace(0.0, 1.0, side))
    height = 0.2 * np.sin(5.0 * u + 2.0 * v + RATE * seconds)
    x = np.stack([u, v, height], axis=-1).reshape(-1, 3) + DRIFT * seconds
    return x.astype("<f4")


def write_sheet(folder: Path, first: int = 1, last: int = 5, step: int = 1, side: int = 9, fps: float = 24.0) -> Path:
    """Writes shot.json, a rest mesh and its point cache; returns the path of shot.json."""
    folder = Path(folder)
    rest = sheet_places(0.0, side)
    corner = np.array([row * side + column for row in range(side - 1) for column in range(side - 1)])
    triangles = np.concatenate([corner[:, None] + [0, 1, side + 1], corner[:, None] + [0, side + 1, side]])
    still = np.zeros_like(rest)
    up = still + [0.0, 0.0, 1.0]
    columns = dict(zip(ply.PROPERTIES, np.concatenate([rest, up, still], axis=1).T))
    ply.write(folder / "sheet" / "sail.ply", columns, triangles)
    numbers = range(first, last + 1, step)
    head = struct.pack("<12siiffi", b"POINTCACHE2\0", 1, len(rest), first, step, len(numbers))
    places = [sheet_places((frame - first) / fps, side).tobytes() for frame in numbers]
    (folder / "sheet" / "sail.pc2").write_bytes(head + b"".join(places))
    output = {"kind": "sheet", "name": "sail", "format": "pc2", "rest": "sheet/sail.ply", "pattern": "sheet/sail.pc2"}
    return write_manifest(folder, fps, output | {"frames": {"first": first, "last": last, "step": step}, "attributes": {}})


def poses(first: int, last: int) -> list[list[float]]:
    """Position and quaternion w, x, y, z in each frame: a turn of 20 degrees a frame about a tilted axis, past half a turn."""
    axis, found = np.array([2.0, -1.0, 2.0]) / 3.0, []
    for frame in range(first, last + 1):
        half = np.radians(10.0 * (frame - first))
        found.append([0.1 * frame, -0.2 * frame, 0.5, np.cos(half), *(np.sin(half) * axis)])
    return found


def write_colliders(folder: Path, first: int = 2, last: int = 14) -> Path:
    """Adds to the flying ball a paddle that moves, a bowl of glass, a hidden ball, and droplets; returns the path of shot.json."""
    path = write_shot(folder, last=16, empty=())
    shot = json.loads(path.read_text(encoding="utf-8"))
    directions, triangles = icosphere(2)
    for name, look, moved in (("paddle", "matte", True), ("bowl", "glass", False), ("ghost", "hidden", False)):
        ply.write(folder / "collider" / f"{name}.ply", dict(zip("xyz", (0.2 * directions).T)), triangles)
        motion = {"format": "meniscus-motion", "version": 1, "shape": "mesh", "look": look, "first": first if moved else 1}
        motion["poses"] = poses(first, last) if moved else [[0.0, 0.5, 0.0, 1.0, 0.0, 0.0, 0.0]]
        (folder / "collider" / f"{name}.json").write_text(json.dumps(motion), encoding="utf-8")
        output = {"kind": "collider", "name": name, "format": "json", "rest": f"collider/{name}.ply"}
        frames = {"first": motion["first"], "last": motion["first"] + len(motion["poses"]) - 1, "step": 1}
        shot["outputs"].append(output | {"pattern": f"collider/{name}.json", "frames": frames, "attributes": {}})
    drops = {"x": [0.5, 0.6], "y": [0.0, 0.1], "z": [1.2, 1.5], "radius": [0.03, 0.05], "vx": [6.0, 0.0], "vy": [0, 0], "vz": [0, 0]}
    for frame in range(1, 17):
        file = folder / "mesh" / f"liquid_points_{frame:04}.ply"
        ply.write(file, {name: np.array(values, float) for name, values in drops.items()}, None)
    output = {"kind": "points", "name": "liquid_points", "format": "ply", "pattern": "mesh/liquid_points_{:04}.ply"}
    attributes = {"radius": ["radius"], "velocity": ["vx", "vy", "vz"]}
    shot["outputs"].append(output | {"frames": shot["frames"], "attributes": attributes})
    path.write_text(json.dumps(shot, indent=2) + "\n", encoding="utf-8")
    return path


def write_deforming(folder: Path, first: int = 3, last: int = 9) -> Path:
    """Adds to the colliders a ball that moves, grows and stretches along x from frame to frame; returns the path of shot.json."""
    path = write_colliders(folder)
    shot = json.loads(path.read_text(encoding="utf-8"))
    directions, triangles = icosphere(2)
    numbers = range(first, last + 1)
    ply.write(folder / "collider" / "blob.ply", dict(zip("xyz", stretched(directions, first, first).T)), triangles)
    head = struct.pack("<12siiffi", b"POINTCACHE2\0", 1, len(directions), first, 1, len(numbers))
    places = [stretched(directions, first, frame).astype("<f4").tobytes() for frame in numbers]
    (folder / "collider" / "blob.pc2").write_bytes(head + b"".join(places))
    motion = {"format": "meniscus-motion", "version": 1, "shape": "mesh", "look": "matte", "first": first}
    motion |= {"poses": poses(first, last), "scales": sizes(first, last), "point_cache_frames": [first, last]}
    (folder / "collider" / "blob.json").write_text(json.dumps(motion), encoding="utf-8")
    output = {"kind": "collider", "name": "blob", "format": "json", "rest": "collider/blob.ply", "point_cache": "collider/blob.pc2"}
    frames = {"first": first, "last": last, "step": 1}
    shot["outputs"].append(output | {"pattern": "collider/blob.json", "frames": frames, "attributes": {}})
    path.write_text(json.dumps(shot, indent=2) + "\n", encoding="utf-8")
    return path


def stretched(directions: np.ndarray, first: int, frame: int) -> np.ndarray:
    """Vertices of the ball in a frame, in its own axes."""
    return 0.2 * directions * [1.0 + 0.1 * (frame - first), 1.0, 1.0]


def sizes(first: int, last: int) -> list[float]:
    """Size of the ball in each frame."""
    return [1.0 + 0.25 * (frame - first) for frame in range(first, last + 1)]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--last", type=int, default=5)
    parser.add_argument("--step", type=int, default=1)
    parser.add_argument("--empty", type=int, nargs="*", default=[3])
    given = parser.parse_args()
    print(write_shot(given.folder, given.first, given.last, given.step, tuple(given.empty)))
