# SPDX-License-Identifier: MIT OR Apache-2.0
"""Rigid motion from world matrices: poses relative to the first frame, and keyframes without those that others imply."""

from collections.abc import Callable
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
# Singular values of the fit of a pivot, over the largest, that count as zero: along the axis of a turn a pivot has no place of its own.
MIN_SINGULAR = 1e-5
# Distance of a pivot over the size of the path, or over 1 m: vertices about a farther one are rounded to more than a tenth of an error
# that turns may have.
MAX_ARM = 16.0


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
    turns = np.array([matrix[:3, :3] for matrix in matrices]) @ np.linalg.inv(start)
    cubes = np.linalg.det(turns)
    if np.any(cubes <= 0.0):
        return None
    sizes = np.cbrt(cubes)
    if np.abs(turns @ turns.transpose(0, 2, 1) / sizes[:, None, None] ** 2 - np.eye(3)).max() > 10.0 * TOLERANCE:
        return None
    sizes[np.abs(sizes - 1.0) < TOLERANCE] = 1.0
    turns /= sizes[:, None, None]
    found: list[Pose] = []
    for matrix, turn, size in zip(matrices, turns, sizes):
        before = found[-1].quaternion if found else IDENTITY
        found.append(Pose(tuple(map(float, matrix[:3, 3])), quaternion(turn, before), float(size)))
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


def needed(times: np.ndarray, is_implied: Callable[[slice], bool]) -> list[int]:
    """Indices of the rows that keyframes need, so that interpolation gives all others; `is_implied` takes a run of rows.

    Each run is the longest that doubling and bisection find. All rows of a run that is chosen were compared.
    """
    count, chosen = len(times), [0]
    while chosen[-1] < count - 1:
        start = chosen[-1]
        longest = min(MAX_RUN, count - 1 - start)
        # The next row always follows; `good` rows on are implied, `bad` are not, or are too many.
        good, bad = 1, longest + 1
        while good < longest and 2 * good < bad:
            if is_implied(slice(start, start + 2 * good + 1)):
                good *= 2
            else:
                bad = 2 * good
        while bad - good > 1:
            middle = (good + bad) // 2
            if is_implied(slice(start, start + middle + 1)):
                good = middle
            else:
                bad = middle
        chosen.append(start + good)
    return chosen


def kept(frames: list[int], poses: list[Pose]) -> list[int]:
    """Indices of the poses that keyframes need, so that the engine's interpolation gives all of them.

    The engine interpolates place and size linearly and quaternions by slerp, so a shape that rests, moves in a straight line at
    constant speed or turns about one axis at constant speed needs few; one that speeds up needs nearly every frame.
    """
    times, rows = np.array(frames, np.float64), np.array([vector(pose) for pose in poses])
    return needed(times, lambda run: are_implied(times[run], rows[run]))


def are_implied(times: np.ndarray, rows: np.ndarray) -> bool:
    """Whether interpolation between the first and the last row gives those between them."""
    lines = interpolated(times, rows)
    if lines is None:
        return False
    is_near = np.abs(rows[1:-1] - lines) <= EXACT * np.maximum(1.0, np.abs(rows[0]))
    return bool(np.all(is_near[:, [0, 1, 2, 7]])) and are_turns_near(rows[1:-1], lines)


def interpolated(times: np.ndarray, rows: np.ndarray) -> np.ndarray | None:
    """The rows between the first and the last one as the engine interpolates them; None if these are too far apart to turn."""
    start, end = rows[0], rows[-1]
    parts = ((times[1:-1] - times[0]) / (times[-1] - times[0]))[:, None]
    if float(start[3:7] @ end[3:7]) < np.cos(MAX_ARC / 2.0):
        return None
    lines = start + parts * (end - start)
    lines[:, 3:7] = slerp(start[3:7], end[3:7], parts)
    return lines


def are_turns_near(rows: np.ndarray, others: np.ndarray) -> bool:
    # A small angle between two rotations is twice the distance of their unit quaternions.
    return bool(np.all(2.0 * np.linalg.norm(rows[:, 3:7] - others[:, 3:7], axis=1) <= MAX_ANGLE))


def pivoted(frames: list[int], poses: list[Pose]) -> tuple[np.ndarray, list[Pose], list[int]]:
    """The pivot of a shape [m], in its own axes about its own origin; its poses there, and the indices of those that keyframes need.

    A place that turns about a distant pivot is on an arc, of which linear interpolation gives no part. The pivot itself rests, or
    moves in a line at constant speed, so a shape that is written about it needs as few keyframes as one that turns about its own origin.
    Zero if that saves less than half of them.
    """
    own = kept(frames, poses)
    zero = np.zeros(3), poses, own
    rows = np.array([vector(pose) for pose in poses])
    if len(own) <= 3 or np.all(rows[:, 3:7] == rows[0, 3:7]):
        return zero
    times = np.array(frames, np.float64)
    # As far as a turn of the largest angle moves a point of the path.
    size = max(1.0, float(np.ptp(rows[:, :3], axis=0).max()))
    offset = MAX_ANGLE * size
    columns = np.stack([rotated(rows[:, 3:7], axis) for axis in np.eye(3)], axis=2) * rows[:, 7, None, None]
    for order in (0, 1):
        # Places + columns · arm = line, by least squares.
        powers = ((times - times[0]) / (times[-1] - times[0]))[:, None] ** np.arange(order + 1)
        line = -np.einsum("ij,kl->ikjl", powers, np.eye(3)).reshape(len(times), 3, -1)
        unknown = np.linalg.lstsq(np.concatenate([columns, line], axis=2).reshape(3 * len(times), -1), -rows[:, :3].ravel(), rcond=MIN_SINGULAR)[0]
        arm, about = unknown[:3], rows.copy()
        about[:, :3] = powers @ unknown[3:].reshape(-1, 3)
        if np.linalg.norm(arm) > MAX_ARM * size or not are_near(rows, about, arm, offset):
            continue
        chosen = needed(times, lambda run: (lines := interpolated(times[run], about[run])) is not None and are_near(rows[run][1:-1], lines, arm, offset))
        if 2 * len(chosen) <= len(own):
            places = about[:, :3].tolist()
            return arm, [Pose(tuple(place), pose.quaternion, pose.size) for place, pose in zip(places, poses)], chosen
    return zero


def are_near(rows: np.ndarray, others: np.ndarray, arm: np.ndarray, offset: float) -> bool:
    """Whether poses about a pivot are those of a shape, whose origin may be off by `offset` [m]."""
    distances = np.linalg.norm(others[:, :3] - others[:, 7:] * rotated(others[:, 3:7], arm) - rows[:, :3], axis=1)
    are_sizes_near = np.all(np.abs(rows[:, 7] - others[:, 7]) <= EXACT * np.maximum(1.0, rows[:, 7]))
    return bool(are_sizes_near and np.all(distances <= offset)) and are_turns_near(rows, others)


def rotated(quaternions: np.ndarray, point: np.ndarray) -> np.ndarray:
    """A point turned by each of some unit quaternions."""
    across = 2.0 * np.cross(quaternions[:, 1:], point)
    return point + quaternions[:, :1] * across + np.cross(quaternions[:, 1:], across)


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
    return kept(frames, [Pose((value / largest, 0.0, 0.0), IDENTITY, 1.0) for value in values])


def keyframes(frames: list[int], poses: list[Pose], chosen: list[int] | None = None) -> list[dict[str, object]]:
    """Keyframes of a preset: those that interpolation needs, or `chosen` ones."""
    turns = any(pose.quaternion != IDENTITY for pose in poses)
    grows = any(pose.size != 1.0 for pose in poses)
    found = []
    for index in kept(frames, poses) if chosen is None else chosen:
        pose = poses[index]
        entry: dict[str, object] = {"frame": frames[index], "position": list(pose.place)}
        if turns:
            entry["quaternion"] = list(pose.quaternion)
        if grows:
            entry["scale"] = pose.size
        found.append(entry)
    return found
