# SPDX-License-Identifier: MIT OR Apache-2.0
"""Rigid motion from world matrices: poses relative to the first frame, and keyframes without those that others imply."""

from dataclasses import dataclass

import numpy as np
from mathutils import Matrix, Quaternion

# Rounding of matrices in single precision.
TOLERANCE = 2e-5
# A place that lies on the line between its neighbours within this part of a micrometre and of its size changes nothing.
EXACT = 2e-7
# Frames between two keyframes at most: every pose between is compared with the line.
MAX_RUN = 100


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
    """Indices of the poses that keyframes need so that linear interpolation gives all of them.

    A pose is left out only if the shape rests, or moves in a straight line at constant speed without turning; a turn keeps
    every frame.
    """
    return needed(frames, [vector(pose) for pose in poses])


def needed(frames: list[int], vectors: list[np.ndarray]) -> list[int]:
    chosen = [0]
    for index in range(1, len(vectors) - 1):
        last = chosen[-1]
        is_implied = all(on_line(frames, vectors, last, between, index + 1) for between in range(last + 1, index + 1))
        if not is_implied or index - last >= MAX_RUN:
            chosen.append(index)
    return chosen + ([len(vectors) - 1] if len(vectors) > 1 else [])


def on_line(frames: list[int], vectors: list[np.ndarray], first: int, between: int, last: int) -> bool:
    """Whether a pose is on the line between two others, without a turn."""
    start, end = vectors[first], vectors[last]
    if np.abs(start[3:7] - end[3:7]).max() > 0.0 or np.abs(start[3:7] - vectors[between][3:7]).max() > 0.0:
        return False
    part = (frames[between] - frames[first]) / (frames[last] - frames[first])
    return is_near(vectors[between], start + part * (end - start), start)


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
