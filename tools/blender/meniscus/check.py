# SPDX-License-Identifier: MIT OR Apache-2.0
"""Checks every file of a shot that Blender will open: it exists, is inside the folder, and has a header that is true."""

from collections.abc import Callable
from itertools import islice

from .folder import ShotFolder
from .headers import MAX_COUNT, PointCache, check_obj, check_pc2, check_ply
from .messages import REMAKE, ShotError, printable, spans
from .motion import Motion
from .shot import FRAME_NUMBER, MAX_SCENE_FRAME, ColliderOutput, MeshOutput, PointsOutput, SequenceOutput, SheetOutput, Shot, VolumeOutput
from .vdb import check_vdb

# Missing frames that a message lists.
MAX_MISSING = 1000
MISSING = "Run `meniscus shot` again; it makes what is missing"


def check_files(shot: Shot, folder: ShotFolder, warn: Callable[[str], None]) -> dict[SequenceOutput, list[int]]:
    """The frames that have a file, of every sequence; missing ones are reported by `warn`. Raises ShotError."""
    for sheet in shot.sheets:
        check_sheet(sheet, folder)
    for collider in shot.colliders:
        check_collider(collider, folder)
    if shot.last_frame() > MAX_SCENE_FRAME:
        hidden = f"frames {MAX_SCENE_FRAME + 1} to {shot.last_frame()}"
        warn(f"{shot.title}: {hidden} cannot be shown, Blender's last is {MAX_SCENE_FRAME}")
    return {output: check_sequence(output, folder, warn) for output in (*shot.meshes, *shot.points, *shot.volumes)}


def check_sheet(sheet: SheetOutput, folder: ShotFolder) -> None:
    """Raises ShotError unless rest mesh and point cache belong together."""
    for path in (sheet.rest, sheet.cache):
        if not folder.has(path):
            raise ShotError(f"{sheet.name}: {printable(folder.full(path))} is missing. {MISSING}")
    points, samples = check_ply(folder, sheet.rest), len(sheet.frames.numbers())
    if points == 0 or samples > MAX_COUNT:
        finding = f"{points} points in {samples} frames, expected 1 to {MAX_COUNT} of each"
        raise ShotError(f"{printable(folder.full(sheet.rest))}: {finding}. {REMAKE}")
    check_pc2(folder, sheet.cache, PointCache(points, sheet.frames.first, sheet.frames.step, samples))


def check_collider(collider: ColliderOutput, folder: ShotFolder) -> None:
    """Raises ShotError unless there is a mesh, and a motion file, which its reader checks."""
    for path in (collider.mesh, collider.motion):
        if not folder.has(path):
            raise ShotError(f"{collider.name}: {printable(folder.full(path))} is missing. {MISSING}")
    if check_ply(folder, collider.mesh) == 0:
        raise ShotError(f"{printable(folder.full(collider.mesh))}: a mesh without vertices, expected some. {REMAKE}")


def check_cache(collider: ColliderOutput, motion: Motion, folder: ShotFolder) -> None:
    """Raises ShotError unless a collider that deforms has a point cache of its mesh, and no other has one."""
    if (collider.cache is None) != (motion.cache_frames is None):
        raise ShotError(f"{printable(folder.full(collider.motion))}: its point cache is named in one of two files. {REMAKE}")
    if collider.cache is None or motion.cache_frames is None:
        return
    if not folder.has(collider.cache):
        raise ShotError(f"{collider.name}: {printable(folder.full(collider.cache))} is missing. {MISSING}")
    first, last = motion.cache_frames
    check_pc2(folder, collider.cache, PointCache(check_ply(folder, collider.mesh), first, 1, last - first + 1))


def check_sequence(output: SequenceOutput, folder: ShotFolder, warn: Callable[[str], None]) -> list[int]:
    """The frames of a sequence that have a file. Raises ShotError if there are none, or one is damaged."""
    is_volume, wanted = isinstance(output, VolumeOutput), output.frames.numbers()
    # A sequence of volumes has no step: Blender opens the files between the steps as well.
    opened = range(output.frames.first, output.frames.last + 1) if is_volume else wanted
    found = [frame for frame in folder.frames(output.pattern, FRAME_NUMBER) if frame in opened]
    for frame in found:
        if is_volume:
            check_vdb(folder, output.path(frame))
        elif isinstance(output, MeshOutput) and output.is_obj:
            check_obj(folder, output.path(frame))
        else:
            check_ply(folder, output.path(frame), has_faces=not isinstance(output, PointsOutput))
    if is_volume and output.frames.step > 1:
        warn(f"{output.name}: only every frame number {output.frames.step} has a volume; the others show nothing")
    present = [frame for frame in found if frame in wanted]
    if len(present) < len(wanted):
        there = set(present)
        # Only as many as are shown: shot.json may count frames by the milliard.
        missing = list(islice((frame for frame in wanted if frame not in there), MAX_MISSING))
        file = printable(folder.full(output.path(missing[0])))
        count = len(wanted) - len(present)
        which = spans(missing, output.frames.step) + (", …" if count > len(missing) else "")
        text = f"{output.name}: {count} of {len(wanted)} files missing, first {file}. {MISSING}"
        if not present:
            raise ShotError(text)
        warn(f"{text}. Until then these frames are empty: {which}")
    return present
