# SPDX-License-Identifier: MIT OR Apache-2.0
"""From the untrusted motion file of a collider to a `Motion`, whose numbers are within their limits. No Blender in here."""

import json
import math
from dataclasses import dataclass
from pathlib import Path

from .folder import ShotFolder, read_limited
from .messages import REMAKE, ShotError, printable, shortened
from .shot import MAX_POSITION

FORMAT = "meniscus-motion"
VERSION = 1
# 250 000 poses of at most 100 bytes.
MAX_BYTES = 32 << 20
MAX_POSES = 250_000
MAX_FRAME = 2**31 - 1
# Rounding leaves a unit quaternion within 1e-6 of length 1.
UNIT_TOLERANCE = 1e-3
LOOKS = ("matte", "glass", "hidden")
SHAPES = ("plane", "box", "sphere", "capsule", "tank", "torus", "ellipsoid", "disc", "mesh")


@dataclass(frozen=True)
class Motion:
    """Position [m] and unit quaternion w, x, y, z of a collider in each whole frame from `first` on."""

    shape: str
    look: str
    first: int
    poses: list[list[float]]
    # Size over that of the mesh in each of these frames; None if it does not change.
    scales: list[float] | None
    # First and last frame of the point cache of a mesh that deforms.
    cache_frames: tuple[int, int] | None


def read_motion(folder: ShotFolder, path: str) -> Motion:
    """Reads and validates the motion file of a collider. Raises ShotError."""
    full = folder.full(path)
    content = read_limited(Path(full), MAX_BYTES, REMAKE)

    def invalid(key: str, found: object, expected: str, next_step: str = REMAKE) -> ShotError:
        return ShotError(f"{printable(full)}: {key} is {shortened(found)}, expected {expected}. {next_step}")

    try:
        data = json.loads(content.decode("utf-8"), parse_constant=refuse_constant)
    except (ValueError, RecursionError) as error:
        raise ShotError(f"{printable(full)}: not valid JSON ({printable(error, 200)}). {REMAKE}") from None
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        found = data.get("format") if isinstance(data, dict) else type(data).__name__
        raise invalid('"format"', found, f'"{FORMAT}"')
    if type(data.get("version")) is not int or data["version"] != VERSION:
        newer = "Install the add-on that came with the Meniscus that wrote the shot"
        raise invalid('"version"', data.get("version"), str(VERSION), newer)
    for key, known in (("shape", SHAPES), ("look", LOOKS)):
        if not isinstance(data.get(key), str) or data[key] not in known:
            raise invalid(f'"{key}"', data.get(key), "one of " + ", ".join(known))
    first, poses = data.get("first"), data.get("poses")
    if type(first) is not int or not 0 <= first <= MAX_FRAME:
        raise invalid('"first"', first, f"a whole number from 0 to {MAX_FRAME}")
    if not isinstance(poses, list) or not 1 <= len(poses) <= MAX_POSES:
        found = len(poses) if isinstance(poses, list) else poses
        raise invalid('"poses"', found, f"a list of 1 to {MAX_POSES} poses")
    for index, pose in enumerate(poses):
        if not is_pose(pose):
            expected = f"a position within {MAX_POSITION:g} m and a unit quaternion, 7 numbers"
            raise invalid(f'"poses"[{index}]', pose, expected)
    scales = data.get("scales")
    if scales is not None:
        if not isinstance(scales, list) or len(scales) != len(poses):
            raise invalid('"scales"', scales, f"{len(poses)} numbers, one for each pose")
        if not all(type(scale) in (int, float) and 1e-6 <= scale <= 1e6 for scale in scales):
            raise invalid('"scales"', scales, "numbers from 1e-6 to 1e6")
    frames = data.get("point_cache_frames")
    if frames is not None:
        if not isinstance(frames, list) or len(frames) != 2 or any(type(frame) is not int for frame in frames):
            raise invalid('"point_cache_frames"', frames, "two whole numbers")
        if not 0 <= frames[0] <= frames[1] <= MAX_FRAME or frames[1] - frames[0] >= MAX_POSES:
            raise invalid('"point_cache_frames"', frames, f"0 <= first <= last <= {MAX_FRAME}, at most {MAX_POSES} frames")
        frames = tuple(frames)
    return Motion(data["shape"], data["look"], first, poses, scales, frames)


def refuse_constant(name: str) -> None:
    """NaN and Infinity, which Python reads, are no JSON."""
    raise ValueError(f"{name} is not a number")


def is_pose(pose: object) -> bool:
    """Whether a value is a pose: position and unit quaternion."""
    if not isinstance(pose, list) or len(pose) != 7 or any(type(number) not in (int, float) for number in pose):
        return False
    if not all(-MAX_POSITION <= number <= MAX_POSITION for number in pose):
        return False
    return abs(math.hypot(*pose[3:]) - 1.0) <= UNIT_TOLERANCE
