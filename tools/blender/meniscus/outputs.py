# SPDX-License-Identifier: MIT OR Apache-2.0
"""Objects that show the outputs of a shot: new ones for each sequence, sheet and collider, and paths as Blender holds them."""

from dataclasses import dataclass, field
from pathlib import Path

import bpy

from . import colliders, material, nodes, sheets, volumes
from .folder import ShotFolder
from .messages import ShotError, printable
from .motion import Motion
from .shot import ColliderOutput, MeshOutput, PointsOutput, SequenceOutput, SheetOutput, Shot, VolumeOutput, below, format_string
from .viscosity import THICK

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


@dataclass
class Made:
    """What an import has made: objects of outputs, and those of colliders; each with the key of its output."""

    shown: list[tuple[str, bpy.types.Object]] = field(default_factory=list)
    solids: list[tuple[str, bpy.types.Object]] = field(default_factory=list)

    def all(self) -> list[tuple[str, bpy.types.Object]]:
        return [*self.shown, *self.solids]


def key_of(output: MeshOutput | PointsOutput | VolumeOutput | SheetOutput | ColliderOutput, surface: bool = False) -> str:
    """What names an output among those of its shot; `surface` that of a volume's level set."""
    kinds = {MeshOutput: "mesh", PointsOutput: "points", VolumeOutput: "volume", SheetOutput: "sheet", ColliderOutput: "collider"}
    return f"{'level_set' if surface else kinds[type(output)]}:{output.name}"


def add_outputs(
    context: bpy.types.Context,
    shot: Shot,
    files: ShotFolder,
    folder: str,
    frames: dict[SequenceOutput, list[int]],
    motions: dict[ColliderOutput, Motion],
) -> Made:
    """New objects in the active collection, for every output; all or none. Raises ShotError."""
    made = Made()
    try:
        for output in (*shot.meshes, *shot.points):
            made.shown.append((key_of(output), add_object(output, format_string(below(folder, output.pattern)), shot.viscosity)))
        for output in shot.volumes:
            volume, *surface = volumes.add_volume(context, output, folder, frames[output], lambda: liquid(shot.viscosity))
            made.shown.append((key_of(output), volume))
            made.shown += [(key_of(output, surface=True), each) for each in surface]
        for sheet in shot.sheets:
            made.shown.append((key_of(sheet), sheets.add_sheet(sheet, files.full(sheet.rest), below(folder, sheet.cache))))
        for collider, motion in motions.items():
            made.solids.append((key_of(collider), add_solid(collider, motion, files, folder)))
    except ShotError:
        for _, each in made.all():
            bpy.data.objects.remove(each)
        raise
    # Last: with every object in the scene, each new one would evaluate all before it again.
    for _, each in made.all():
        context.collection.objects.link(each)
    return made


def add_solid(collider: ColliderOutput, motion: Motion, files: ShotFolder, folder: str) -> bpy.types.Object:
    """A new object that shows a collider or a body, in no collection yet. Raises ShotError."""
    made = colliders.add_collider(collider, files.full(collider.mesh), motion)
    if collider.cache and motion.cache_frames:
        sheets.deform(made, below(folder, collider.cache), motion.cache_frames[0])
    return made


def add_object(mesh: MeshOutput | PointsOutput, files: str, viscosity: float = 0.0) -> bpy.types.Object:
    """A new object that shows one sequence, in no collection yet."""
    made = bpy.data.objects.new(mesh.name, bpy.data.meshes.new(mesh.name))
    modifier = made.modifiers.new(nodes.NAME, "NODES")
    modifier.node_group = nodes.sequence_group(reader_of(mesh))
    shown = material_of(mesh, viscosity)
    made.data.materials.append(shown)
    nodes.set_inputs(modifier, inputs_of(mesh, files) | {"Material": shown})
    made.hide_render = made.hide_viewport = isinstance(mesh, PointsOutput) and mesh.is_hidden
    return made


def reader_of(mesh: MeshOutput | PointsOutput) -> nodes.Reader:
    if isinstance(mesh, PointsOutput):
        return nodes.POINTS
    return nodes.OBJ if mesh.is_obj else nodes.SURFACE


def inputs_of(mesh: MeshOutput | PointsOutput, files: str) -> dict[str, object]:
    """The inputs of a modifier that follow from the output alone."""
    values = {"Files": files, "First": mesh.frames.first, "Last": mesh.frames.last, "Step": mesh.frames.step}
    return values | {"Velocity": mesh.has_velocity}


def material_of(mesh: MeshOutput | PointsOutput, viscosity: float) -> bpy.types.Material:
    """What a sequence looks like: cloth, foam, liquids of several colours, honey, or water."""
    if isinstance(mesh, PointsOutput):
        if mesh.is_tracers:
            return material.tracers()
        if mesh.is_whitewater:
            return material.foam()
    elif mesh.is_sheet:
        return sheets.cloth()
    return material.liquids() if mesh.has_colours else liquid(viscosity)


def liquid(viscosity: float) -> bpy.types.Material:
    """Honey or water, by the dynamic viscosity [Pa·s]."""
    return material.honey() if viscosity >= THICK else material.water()
