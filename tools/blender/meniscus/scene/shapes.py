# SPDX-License-Identifier: MIT OR Apache-2.0
"""The shape of a preset for an object: analytic ones from its bounding box, else a mesh file; and its motion as keyframes."""

from dataclasses import dataclass, field
from functools import partial

import numpy as np
from mathutils import Matrix

from ..messages import ShotError, printable
from . import assets, poses, schema
from .poses import IDENTITY, Pose
from .roles import SHAPE_ITEMS
from .sample import Sampled

TOLERANCE = 2e-5
# Roles that a preset can move, and those whose size can change or whose mesh can deform.
MOVING = {"INFLOW", "OUTFLOW", "COLLIDER", "FORCE", "SMOKE"}
CHANGING = {"COLLIDER"}
# Vertices around and along an ellipsoid that is written as a mesh: its volume is 0.4 % less than that of the ellipsoid.
ELLIPSOID = (64, 32)


@dataclass
class Placed:
    """A shape, its keyframes, and the object's axes, as columns, in those in which the shape is written."""

    shape: dict[str, object]
    keyframes: list[dict[str, object]] = field(default_factory=list)
    axes: np.ndarray = field(default_factory=lambda: np.eye(3))
    # The object's origin in the axes in which the shape is written [m]: not zero if it turns about a pivot elsewhere.
    origin: np.ndarray = field(default_factory=lambda: np.zeros(3))


class Shaper:
    """Makes shapes of sampled objects, writes their files, and reports what a preset cannot hold."""

    def __init__(self, folder: assets.Folder, notes: list[str]) -> None:
        self.folder = folder
        self.notes = notes

    def place(self, each: Sampled, name: str) -> Placed:
        """The shape and motion of an object. Raises ShotError."""
        shape = each.role.shape
        if shape == "MESH" or shape == "EVERYWHERE":
            return self.mesh(each, name)
        return self.analytic(each, shape, name)

    def note(self, each: Sampled, text: str) -> None:
        self.notes.append(f"{printable(each.source.name)}: {text}")

    def motion(self, each: Sampled) -> list[Pose]:
        """Poses of a rigid object in all frames, of one that rests or cannot move in its preset only the first. Raises ShotError."""
        found = poses.rigid_poses(each.matrices)
        role = each.role.role
        if found is None:
            finding = "shears, or changes its size by axis or to zero"
            raise ShotError(f"{printable(each.source.name)}: {finding}. Apply its scale, or that of its parent")
        if poses.is_still(found):
            return found[:1]
        if role not in MOVING:
            if role not in ("BODY", "CLOTH"):
                # Of these the preset's writer reports it.
                self.note(each, "its animation is left out: the preset has it where the object is in the first frame")
            return found[:1]
        if role not in CHANGING and any(pose.size != 1.0 for pose in found):
            self.note(each, "its change of size is left out: only colliders can change theirs")
            found = [Pose(pose.place, pose.quaternion, 1.0) for pose in found]
        return found

    def analytic(self, each: Sampled, shape: str, asset: str) -> Placed:
        """A shape from the object's bounding box; a mesh of it where the preset cannot turn the shape itself."""
        name = printable(each.source.name)
        if each.deforms():
            self.note(each, f"its deformation is left out: the shape {SHAPE_ITEMS[shape][1]} is that of the first frame")
        found = self.motion(each)
        matrix = Matrix(each.matrices[0].tolist())
        _, turn, scale = matrix.decompose()
        axes = np.array(turn.to_matrix())
        if is_sheared(axes, scale, each.matrices[0]):
            raise ShotError(f"{name}: is sheared by its parent, so it is no {shape.lower()}. Choose the shape Mesh")
        low, high = self.bounds(each)
        ends = np.stack([low * scale, high * scale])
        box = Box(ends.min(0), ends.max(0))
        if shape in ("DISC", "PLANE"):
            # Their thickness is along Z alone; a plane has no extent.
            box.check(name, axes=2 if shape == "DISC" else 0)
        else:
            box.check(name, axes=3)
        half = box.half()
        if shape == "DISC" and abs(half[0] - half[1]) > 1e-4 * max(half[0], half[1]):
            text = f"{half[0]:.4g} and {half[1]:.4g} m. Choose the shape Mesh for its own outline"
            self.note(each, f"a disc is round: its radius is the mean of its two radii, {text}")
        is_still = len(found) == 1
        shown = directions(each.matrices[0])
        if is_still and (written := round_shape(shape, box, axes, shown, each)) is not None:
            return Placed(written, [], shown)
        turned = np.abs(axes - np.eye(3)).max() > TOLERANCE
        if is_still and not turned:
            return Placed(box_shape(shape, box.moved(each.matrices[0][:3, 3]), shown), [], shown)
        if each.role.role not in MOVING:
            vertices, faces = solid(shape, box)
            file = self.add_mesh(asset, vertices @ axes.T + each.matrices[0][:3, 3], faces)
            return Placed({"mesh": self.mesh_table(each, file)}, [], shown)
        if shape == "PLANE":
            if any(pose.quaternion != IDENTITY for pose in found):
                raise ShotError(f"{name}: turns, and a plane can only move. Choose the shape Box or Mesh")
            plane = {"plane": {"point": [0.0, 0.0, 0.0], "normal": clean(shown[:, 2])}}
            return Placed(plane, poses.keyframes(each.frames, found), shown)
        start = poses.quaternion(axes, IDENTITY)
        turned_poses = [Pose(pose.place, multiplied(pose.quaternion, start), pose.size) for pose in found]
        # The keyframes turn the axes of the box: of a mirrored object they differ from its own by their signs.
        own = axes.T @ shown
        pivot, moves = self.pivoted(each, turned_poses)
        return Placed(box_shape(shape, box.moved(-pivot), own), moves, own)

    def pivoted(self, each: Sampled, found: list[Pose]) -> tuple[np.ndarray, list[dict[str, object]]]:
        """The point of the shape about which it is written, and the keyframes of that point."""
        pivot, moved_poses, chosen = poses.pivoted(each.frames, found)
        return pivot, poses.keyframes(each.frames, moved_poses, chosen)

    def bounds(self, each: Sampled) -> tuple[np.ndarray, np.ndarray]:
        """The bounding box in the object's axes [scene units], of an empty the extent of its display."""
        if each.geometry is None:
            size = np.full(3, each.source.empty_display_size if each.source.type == "EMPTY" else 1.0)
            return -size, size
        if not len(each.geometry.vertices):
            raise ShotError(f"{printable(each.source.name)}: has no vertices. Give it a mesh")
        vertices = each.vertices[0].astype(np.float64)
        return vertices.min(0), vertices.max(0)

    def mesh(self, each: Sampled, name: str) -> Placed:
        """A mesh file: at its place in the world if it rests, about its origin or pivot if it moves, with a point cache if it deforms."""
        if each.geometry is None or not len(each.geometry.faces):
            raise ShotError(f"{printable(each.source.name)}: has no faces, expected a mesh that encloses a volume. Choose another shape")
        role = each.role.role
        found = poses.rigid_poses(each.matrices)
        if role in CHANGING and (each.deforms() or found is None):
            return self.deforming(each, name)
        if each.deforms():
            self.note(each, "its deformation is left out: only colliders can deform")
        found = self.motion(each)
        matrix, start, moves = each.matrices[0], np.zeros(3), []
        if len(found) > 1:
            pivot, moves = self.pivoted(each, found)
            start = -pivot
        elif role != "BODY":
            start = matrix[:3, 3]
        vertices = each.vertices[0].astype(np.float64) @ matrix[:3, :3].T + start
        file = self.add_mesh(name, vertices, oriented(each, matrix))
        return Placed({"mesh": self.mesh_table(each, file)}, moves, directions(matrix))

    def deforming(self, each: Sampled, name: str) -> Placed:
        """A mesh and the places of its vertices in every frame, both in the world."""
        if len(each.vertices) == 1:
            each.vertices = each.vertices * len(each.frames)
        samples = [partial(moved, *both) for both in zip(each.vertices, each.matrices)]
        step = each.frames[1] - each.frames[0] if len(each.frames) > 1 else 1
        file = self.add_mesh(name, samples[0](), oriented(each, each.matrices[0]))
        cache = self.folder.add(f"{name}.pc2", assets.pc2(samples, len(each.vertices[0]), float(each.frames[0]), float(step)))
        table = self.mesh_table(each, file)
        return Placed({"mesh": {"file": file, "point_cache": cache} | {key: value for key, value in table.items() if key != "file"}})

    def force(self, each: Sampled, name: str) -> Placed:
        """The place and axes of a force as keyframes, and its volume in these axes; an empty shape acts everywhere."""
        found = self.motion(each)
        _, turn, scale = Matrix(each.matrices[0].tolist()).decompose()
        axes = np.array(turn.to_matrix())
        own = axes.T @ directions(each.matrices[0])
        if is_sheared(axes, scale, each.matrices[0]):
            self.note(each, "its shear is left out: the axes of a force are at right angles")
        start = poses.quaternion(axes, IDENTITY)
        frames = each.frames[: len(found)]
        pivot, moved_poses, chosen = poses.pivoted(frames, [Pose(pose.place, multiplied(pose.quaternion, start), 1.0) for pose in found])
        moves = poses.keyframes(frames, moved_poses, chosen)
        shape = each.role.shape
        if shape == "EVERYWHERE":
            return Placed({}, moves, own, -pivot)
        if shape == "MESH":
            if each.geometry is None or not len(each.geometry.faces):
                raise ShotError(f"{printable(each.source.name)}: has no faces, expected a mesh that encloses a volume. Choose another shape")
            vertices = each.vertices[0].astype(np.float64) * scale - pivot
            file = self.add_mesh(name, vertices, oriented(each, each.matrices[0]))
            return Placed({"mesh": self.mesh_table(each, file)}, moves, own, -pivot)
        low, high = self.bounds(each)
        ends = np.stack([low * scale, high * scale])
        box = Box(ends.min(0), ends.max(0))
        box.check(printable(each.source.name), axes=3)
        return Placed(box_shape(shape, box.moved(-pivot), own), moves, own, -pivot)

    def add_mesh(self, name: str, vertices: np.ndarray, faces: np.ndarray | list[tuple[int, ...]]) -> str:
        """Adds a mesh to the files of the preset; returns its path."""
        return self.folder.add(f"{name}.ply", [partial(assets.ply, vertices, faces)])

    def mesh_table(self, each: Sampled, file: str) -> dict[str, object]:
        resolution = each.role.resolution
        return {"file": file} | ({"resolution": resolution} if resolution != schema.key("MeshShape", "resolution").default else {})


@dataclass
class Box:
    """A box between two corners [m]."""

    low: np.ndarray
    high: np.ndarray

    def check(self, name: str, axes: int) -> None:
        if not np.all((self.high - self.low)[:axes] > 0.0):
            raise ShotError(f"{name}: its bounding box is flat, expected a length along each axis. Scale it, or choose another shape")

    def moved(self, place: np.ndarray) -> "Box":
        return Box(self.low + place, self.high + place)

    def center(self) -> np.ndarray:
        return (self.low + self.high) / 2.0

    def half(self) -> np.ndarray:
        return (self.high - self.low) / 2.0


def moved(vertices: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Vertices in the world [m], in single precision."""
    return (vertices @ matrix[:3, :3].T + matrix[:3, 3]).astype(np.float32)


def is_round(half: np.ndarray) -> bool:
    return bool(half.max() - half.min() <= 1e-4 * half.max())


def solid(shape: str, box: Box) -> tuple[np.ndarray, np.ndarray]:
    """A box or ellipsoid as vertices and triangles that are counter-clockwise seen from outside."""
    if shape == "BOX":
        corners = np.array([(x, y, z) for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], np.float64)
        quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
        return box.center() + corners * box.half(), np.array([(a, *rest) for a, b, c, d in quads for rest in ((b, c), (c, d))])
    columns, rows = ELLIPSOID
    around = 2.0 * np.pi * np.arange(columns) / columns
    down = np.pi * np.arange(1, rows) / rows
    ring = np.stack([np.cos(around), np.sin(around)], axis=1)
    sides = [np.column_stack([ring * np.sin(angle), np.full(columns, np.cos(angle))]) for angle in down]
    points = np.vstack([[(0.0, 0.0, 1.0)], *sides, [(0.0, 0.0, -1.0)]])
    last, faces = len(points) - 1, []
    for column in range(columns):
        after = (column + 1) % columns
        faces.append((0, 1 + column, 1 + after))
        faces.append((last, last - columns + after, last - columns + column))
        for row in range(rows - 2):
            a, b = 1 + row * columns + column, 1 + row * columns + after
            faces += [(a, a + columns, b + columns), (a, b + columns, b)]
    return box.center() + points * box.half(), np.array(faces)


def directions(matrix: np.ndarray) -> np.ndarray:
    """The axes of an object in the world as columns of unit length, of a mirrored object as it shows them."""
    columns = matrix[:3, :3]
    return columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-30)


def is_sheared(axes: np.ndarray, scale: np.ndarray, matrix: np.ndarray) -> bool:
    """Whether a matrix is more than a rotation and a scale by axis."""
    return bool(np.abs(axes @ np.diag(scale) - matrix[:3, :3]).max() > TOLERANCE * max(map(abs, scale)))


def round_shape(shape: str, box: Box, axes: np.ndarray, shown: np.ndarray, each: Sampled) -> dict[str, object] | None:
    """A shape that rests and needs no keyframe for a turn: plane, disc and ball."""
    place = each.matrices[0][:3, 3]
    center = (axes @ box.center() + place).tolist()
    if shape == "PLANE":
        return {"plane": {"point": place.tolist(), "normal": clean(shown[:, 2])}}
    if shape == "DISC":
        return {"disc": {"center": center, "normal": clean(shown[:, 2])} | disc_size(box)}
    if shape == "SPHERE" and is_round(box.half()):
        return {"sphere": {"center": center, "radius": float(box.half().mean())}}
    return None


def clean(direction: np.ndarray) -> list[float]:
    """A direction without the rounding of zeros and ones."""
    # The sum turns a negative zero into zero.
    return [float(round(part, 6)) + 0.0 for part in direction]


def disc_size(box: Box) -> dict[str, float]:
    half = box.half()
    size = {"radius": float((half[0] + half[1]) / 2.0)}
    return size | ({"thickness": float(2.0 * half[2])} if half[2] > 1e-6 * half[0] else {})


def box_shape(shape: str, box: Box, own: np.ndarray) -> dict[str, object]:
    """A shape in the axes of its box, in which the columns of `own` are those of the object."""
    corners = {"min": box.low.tolist(), "max": box.high.tolist()}
    if shape in ("BOX", "TANK"):
        return {shape.lower(): corners}
    center = box.center().tolist()
    if shape == "DISC":
        return {"disc": {"center": center, "normal": clean(own[:, 2])} | disc_size(box)}
    if is_round(box.half()):
        return {"sphere": {"center": center, "radius": float(box.half().mean())}}
    return {"ellipsoid": {"center": center, "radii": box.half().tolist()}}


def oriented(each: Sampled, matrix: np.ndarray) -> np.ndarray:
    """Triangles counter-clockwise seen from outside, also of a mirrored object."""
    faces = each.geometry.faces
    return faces[:, ::-1] if np.linalg.det(matrix[:3, :3]) < 0.0 else faces


def multiplied(one: tuple[float, ...], other: tuple[float, ...]) -> tuple[float, ...]:
    """The quaternion of the rotation `other` and then `one`."""
    w, x, y, z = one
    a, b, c, d = other
    return (w * a - x * b - y * c - z * d, w * b + x * a + y * d - z * c, w * c - x * d + y * a + z * b, w * d + x * c - y * b + z * a)
