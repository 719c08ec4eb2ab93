# SPDX-License-Identifier: MIT OR Apache-2.0
"""Objects that show the outputs of a shot: new ones for each sequence, sheet and collider, and paths as Blender holds them."""

from pathlib import Path

import bpy

from . import colliders, material, nodes, sheets, volumes
from .folder import ShotFolder
from .messages import ShotError, printable
from .motion import Motion
from .shot import ColliderOutput, MeshOutput, PointsOutput, SequenceOutput, Shot, below, format_string

# Blender's FILE_MAX, with the zero at the end.
MAX_PATH_BYTES = 1024


def shot_folder(folder: str, mode: str) -> str:
    """The resolved shot folder as a path string with / between its parts: //… or absolute. Raises ShotError."""
    absolute = Path(folder).as_posix()
    if mode == "ABSOLUTE":
        return absolute
    if not bpy.data.filepath:
        if mode == "RELATIVE":
            raise ShotError("The .blend is not saved, so no path can be relative to it. Save it first")
        return absolute
    try:
        relative = bpy.path.relpath(absolute).replace("\\", "/")
    except ValueError:
        relative = absolute
    if mode == "RELATIVE" and not relative.startswith("//"):
        raise ShotError(f"{printable(absolute)} is on another drive than the .blend. Choose absolute paths")
    return "//" if relative == "//." else relative


def check_paths(shot: Shot, folder: str) -> None:
    """Raises ShotError if Blender cannot hold the path of a file."""
    longest = [output.path(output.frames.last) for output in (*shot.meshes, *shot.points, *shot.volumes)]
    longest += [path for collider in shot.colliders for path in (collider.mesh, collider.cache) if path]
    for path in longest + [path for sheet in shot.sheets for path in (sheet.rest, sheet.cache)]:
        full = below(folder, path)
        try:
            size = max(len(name.encode("utf-8")) for name in (full, bpy.path.abspath(full)))
        except UnicodeEncodeError:
            raise ShotError(f"{printable(full)}: not a name in UTF-8, expected one. Rename the folder") from None
        if size >= MAX_PATH_BYTES:
            text = f"a path of {size} bytes, expected less than {MAX_PATH_BYTES}. Move the shot to a folder with a shorter path"
            raise ShotError(f"{printable(full)}: {text}")


def add_outputs(
    context: bpy.types.Context,
    shot: Shot,
    files: ShotFolder,
    folder: str,
    frames: dict[SequenceOutput, list[int]],
    motions: dict[ColliderOutput, Motion],
) -> tuple[list[bpy.types.Object], list[bpy.types.Object]]:
    """New objects in the active collection, one for each output, and those of colliders; all or none. Raises ShotError."""
    all_made, solids = [], []
    try:
        for output in (*shot.meshes, *shot.points):
            all_made.append(add_object(output, format_string(below(folder, output.pattern))))
        for output in shot.volumes:
            all_made.append(volumes.add_volume(context, output, folder, frames[output]))
        for sheet in shot.sheets:
            all_made.append(sheets.add_sheet(sheet, files.full(sheet.rest), below(folder, sheet.cache)))
        for collider, motion in motions.items():
            made = colliders.add_collider(collider, files.full(collider.mesh), motion)
            solids.append(made)
            if collider.cache and motion.cache_frames:
                sheets.deform(made, below(folder, collider.cache), motion.cache_frames[0])
    except ShotError:
        for made in (*all_made, *solids):
            bpy.data.objects.remove(made)
        raise
    # Last: with every object in the scene, each new one would evaluate all before it again.
    for made in (*all_made, *solids):
        context.collection.objects.link(made)
    return all_made, solids


def add_object(mesh: MeshOutput | PointsOutput, files: str) -> bpy.types.Object:
    """A new object that shows one sequence, in no collection yet."""
    made = bpy.data.objects.new(mesh.name, bpy.data.meshes.new(mesh.name))
    modifier = made.modifiers.new(nodes.NAME, "NODES")
    modifier.node_group = nodes.sequence_group(isinstance(mesh, PointsOutput))
    is_foam = isinstance(mesh, PointsOutput) and mesh.is_whitewater
    shown = material.foam() if is_foam else material.water()
    made.data.materials.append(shown)
    values = {"Files": files, "First": mesh.frames.first, "Last": mesh.frames.last, "Step": mesh.frames.step}
    nodes.set_inputs(modifier, values | {"Velocity": mesh.has_velocity, "Material": shown})
    return made
