# SPDX-License-Identifier: MIT OR Apache-2.0
"""Rigid motion from world matrices: poses relative to the first frame, and keyframes without those that others imply."""

from dataclasses import dataclass

import numpy as np
from mathutils import Matrix, Quaternion

# Rounding of matrices in single precision.
TOLERANCE = 2e-5
# A place that lies on the line between its neighbours within this part of a micrometre and of its size changes nothing.
EXACT = 2e-7
# Angle [rad] by which an interpolated rotation may differ: a point at 1 m from the origin is off by 10 micrometres. Below 3e-6 the
# rounding of Blender's angles keeps every frame of a long turn; above 1e-3 turns are visibly uneven.
MAX_ANGLE = 1e-5
# Turn [rad] between two keyframes at most: slerp takes the shorter arc, and half a turn has none.
MAX_ARC = 2.5
# Frames between two keyframes at most: every pose between is compared.
MAX_RUN = 1000


@dataclass(frozen=True)
class Pose:
    """Place [m], unit quaternion w, x, y, z, and size over that in the first frame."""

    place: tuple[float, float, float]
    quaternion: tuple[float, float, float, float]
    size: float


IDENTITY = (1.0, 0.0, 0.0, 0.0)


def rigid_poses(matrices: list[np.ndarray]) -> list[Pose] | None:
    """Poses of a shape that has its axes of the first frame; None if it shears or scales by axis. Matrices are in metres."""
    if len(matrices) > 1 and all(matrix is matrices[0] for matrix in matrices):
        # Nothing moves in the scene: one frame was sampled.
        first = rigid_poses(matrices[:1])
        return first and first * len(matrices)
    start = matrices[0][:3, :3]
    if abs(np.linalg.det(start)) < 1e-30:
        return None
    inverse = np.linalg.inv(start)
    found: list[Pose] = []
    for matrix in matrices:
        turn = matrix[:3, :3] @ inverse
        cube = np.linalg.det(turn)
        if cube <= 0.0:
            return None
        size = cube ** (1.0 / 3.0)
        if np.abs(turn @ turn.T / size**2 - np.eye(3)).max() > 10.0 * TOLERANCE:
            return None
        size = 1.0 if abs(size - 1.0) < TOLERANCE else float(size)
        found.append(Pose(tuple(map(float, matrix[:3, 3])), quaternion(turn / size, found[-1].quaternion if found else IDENTITY), size))
    return found


def quaternion(turn: np.ndarray, before: tuple[float, ...]) -> tuple[float, float, float, float]:
    """The unit quaternion of a rotation, of the two that nearer to the one before."""
    if np.abs(turn - np.eye(3)).max() < TOLERANCE:
        found = np.array(IDENTITY)
    else:
        found = np.array(Matrix(turn.tolist()).to_quaternion().normalized())
    if np.dot(found, before) < 0.0:
        found = -found
    return tuple(float(part) for part in found)


def displacements(found: list[Pose]) -> list[Pose]:
    """Poses for points whose places in the first frame are in the world, not about the shape's origin; without size."""
    start = np.array(found[0].place)
    moved = []
    for pose in found:
        turn = np.array(Quaternion(pose.quaternion).to_matrix())
        place = np.array(pose.place) - turn @ start
        moved.append(Pose(tuple(map(float, place)), pose.quaternion, 1.0))
    return moved


def is_still(poses: list[Pose]) -> bool:
    """Whether all poses are the first, but for rounding."""
    first = vector(poses[0])
    return all(is_near(vector(pose), first, first) for pose in poses)


def vector(pose: Pose) -> np.ndarray:
    return np.array([*pose.place, *pose.quaternion, pose.size])


def is_near(one: np.ndarray, other: np.ndarray, size: np.ndarray) -> bool:
    return bool(np.all(np.abs(one - other) <= EXACT * np.maximum(1.0, np.abs(size))))


def kept(frames: list[int], poses: list[Pose]) -> list[int]:
    """Indices of the poses that keyframes need, so that the engine's interpolation gives all of them.

    The engine interpolates place and size linearly and quaternions by slerp, so a shape that rests, moves in a straight line at
    constant speed or turns about one axis at constant speed needs few; one that speeds up needs nearly every frame.
    """
    return needed(frames, [vector(pose) for pose in poses])


def needed(frames: list[int], vectors: list[np.ndarray]) -> list[int]:
    rows, times = np.array(vectors), np.array(frames, np.float64)
    chosen = [0]
    for index in range(1, len(rows) - 1):
        last = chosen[-1]
        if index - last >= MAX_RUN or not are_implied(times[last : index + 2], rows[last : index + 2]):
            chosen.append(index)
    return chosen + ([len(rows) - 1] if len(rows) > 1 else [])


def are_implied(times: np.ndarray, rows: np.ndarray) -> bool:
    """Whether interpolation between the first and the last row gives those between them."""
    start, end, between = rows[0], rows[-1], rows[1:-1]
    parts = ((times[1:-1] - times[0]) / (times[-1] - times[0]))[:, None]
    lines = start + parts * (end - start)
    is_straight = np.abs(between - lines) <= EXACT * np.maximum(1.0, np.abs(start))
    if not np.all(is_straight[:, [0, 1, 2, 7]]):
        return False
    cosine = float(start[3:7] @ end[3:7])
    if cosine < np.cos(MAX_ARC / 2.0):
        return False
    # A small angle between two rotations is twice the distance of their unit quaternions.
    angles = 2.0 * np.linalg.norm(between[:, 3:7] - slerp(start[3:7], end[3:7], parts), axis=1)
    return bool(np.all(angles <= MAX_ANGLE))


def slerp(start: np.ndarray, end: np.ndarray, parts: np.ndarray) -> np.ndarray:
    """Quaternions at parts of the arc between two that are less than half a turn apart, as src/math/rotation.rs has them."""
    cosine = start @ end
    sine = np.sqrt(max(1.0 - cosine * cosine, 0.0))
    if sine < 1e-9:
        return np.repeat(start[None], len(parts), axis=0)
    angle = np.arctan2(sine, cosine)
    return (start * np.sin((1.0 - parts) * angle) + end * np.sin(parts * angle)) / sine


def kept_values(frames: list[int], values: list[float]) -> list[int]:
    """The same for a number over time, such as a rate."""
    largest = max(map(abs, values)) or 1.0
    return needed(frames, [np.array([value / largest, 0.0, 0.0, *IDENTITY, 1.0]) for value in values])


def keyframes(frames: list[int], poses: list[Pose]) -> list[dict[str, object]]:
    """Keyframes of a preset."""
    turns = any(pose.quaternion != IDENTITY for pose in poses)
    grows = any(pose.size != 1.0 for pose in poses)
    found = []
    for index in kept(frames, poses):
        pose = poses[index]
        entry: dict[str, object] = {"frame": frames[index], "position": list(pose.place)}
        if turns:
            entry["quaternion"] = list(pose.quaternion)
        if grows:
            entry["scale"] = pose.size
        found.append(entry)
    return found
