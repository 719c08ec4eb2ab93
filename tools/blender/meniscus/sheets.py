# SPDX-License-Identifier: MIT OR Apache-2.0
"""Sheets: a rest mesh whose points a Mesh Cache modifier moves, and the `Cloth` material."""

import bpy

from .material import own, principled
from .messages import REMAKE, ShotError, printable
from .shot import SheetOutput

NAME = "Cloth"
STAMP = "meniscus_cloth"
COLOUR = (0.55, 0.08, 0.07, 1.0)
ROUGHNESS = 0.75
# Sheen of the fibres that rise from the weave.
SHEEN = 0.3


def add_sheet(sheet: SheetOutput, rest: str, cache: str) -> bpy.types.Object:
    """A new object that shows one sheet, in no collection yet; `cache` is absolute or //… Raises ShotError."""
    made = read_mesh(sheet.name, rest)
    made.data.materials.append(cloth())
    deform(made, cache, sheet.frames.first, sheet.frames.step)
    return made


def deform(made: bpy.types.Object, cache: str, first: int, step: int = 1) -> None:
    """Moves the vertices of an object by a point cache, whose path is absolute or //…, with a sample in every `step`th frame from `first` on."""
    modifier = made.modifiers.new("Meniscus Point Cache", "MESH_CACHE")
    modifier.cache_format, modifier.filepath = "PC2", cache
    modifier.interpolation, modifier.play_mode, modifier.time_mode = "LINEAR", "SCENE", "FRAME"
    modifier.deform_mode, modifier.forward_axis, modifier.up_axis = "OVERWRITE", "POS_Y", "POS_Z"
    # Sample = scale × frame − start.
    modifier.frame_scale = 1.0 / step
    modifier.frame_start = first / step


def read_mesh(name: str, path: str) -> bpy.types.Object:
    """A new object with the mesh of a PLY file, smooth and without materials, in no collection yet. Raises ShotError."""
    before, finding = set(bpy.data.objects), "no mesh in it"
    try:
        bpy.ops.wm.ply_import(filepath=path, forward_axis="Y", up_axis="Z", merge_verts=False)
    except RuntimeError as error:
        finding = f"cannot be read ({printable(error, 200)})"
    new = [made for made in bpy.data.objects if made not in before]
    if len(new) != 1 or not new[0].data.vertices:
        for made in new:
            bpy.data.objects.remove(made)
        raise ShotError(f"{printable(path)}: {finding}. {REMAKE}")
    made = new[0]
    for collection in made.users_collection:
        collection.objects.unlink(made)
    made.name = made.data.name = name
    made.data.polygons.foreach_set("use_smooth", [True] * len(made.data.polygons))
    made.data.materials.clear()
    return made


def cloth() -> bpy.types.Material:
    """The file's own Cloth that an earlier import made, else a new one."""
    material, is_new = own(NAME, STAMP)
    if not is_new:
        return material
    material.diffuse_color = COLOUR
    shader = principled(material)
    shader.inputs["Base Color"].default_value = COLOUR
    shader.inputs["Roughness"].default_value = ROUGHNESS
    shader.inputs["Sheen Weight"].default_value = SHEEN
    return material
