# SPDX-License-Identifier: MIT OR Apache-2.0
"""Blender's startup file as a newcomer has it: its cube would hide a first pool, and its camera shows a glass as a few pixels."""

import bpy
import numpy as np
from mathutils import Vector

from .. import studio
from ..studio import Box

# Custom property of the camera: the matrix and the near clip distance that this file gave it. Those of an artist are others.
PLACED = "meniscus_placed"
# What this file changes.
CHANGED_PATHS = ("location", "data.clip_start")
# The camera stays where the objects are at least this part of their distance from it.
SMALL = 0.035
MARGIN = 0.3


def tidy(context: bpy.types.Context, made: bpy.types.Object) -> list[str]:
    """Hides the startup cube around a new object, and moves the startup camera up to small ones; what was done."""
    notes, scene = [], context.scene
    cube = scene.objects.get("Cube")
    if cube is not None and cube != made and is_in_the_way(cube, made, context.view_layer):
        cube.hide_render = True
        cube.hide_set(True, view_layer=context.view_layer)
        notes.append("Hid the startup cube, which would cover the result")
    camera = scene.camera
    if camera is not None and is_free(camera) and frame(context, camera):
        notes.append("Moved the startup camera closer")
    return notes


def is_in_the_way(cube: bpy.types.Object, made: bpy.types.Object, layer: bpy.types.ViewLayer) -> bool:
    is_plain = cube.meniscus.role == "NONE" and not cube.hide_render and cube.name in layer.objects and studio.is_unchanged(cube)
    return is_plain and all(abs(part) <= 1.0 for part in made.matrix_world.translation)


def is_free(camera: bpy.types.Object) -> bool:
    """Whether no artist has placed a camera, or set it up."""
    if camera.name != "Camera" or camera.type != "CAMERA":
        return False
    placed = camera.get(PLACED)
    if placed is None:
        return studio.is_unchanged(camera)
    expected = {path: value for path, value in studio.STARTUP_OBJECTS[camera.name].items() if path not in CHANGED_PATHS}
    used = (camera.animation_data, camera.data.animation_data, camera.parent, *camera.children, *camera.constraints)
    if any(used) or camera.data.users != 1 or len(camera.users_scene) != 1:
        return False
    return is_placed(camera, placed) and all(studio.is_equal(camera.path_resolve(path), value) for path, value in expected.items())


def is_placed(camera: bpy.types.Object, placed: list[float]) -> bool:
    current = placement(camera)
    return len(placed) == len(current) and bool(np.allclose(current, placed, atol=1e-6))


def placement(camera: bpy.types.Object) -> list[float]:
    return [*np.array(camera.matrix_basis).ravel().tolist(), camera.data.clip_start]


def frame(context: bpy.types.Context, camera: bpy.types.Object) -> bool:
    """Moves a camera, without a turn, so that all objects with a role fill the picture, if they would be small in it."""
    graph, box = context.evaluated_depsgraph_get(), Box()
    for each in context.scene.objects:
        has_part = each.meniscus.role != "NONE" or (each.parent is not None and each.parent.meniscus.role != "NONE")
        # A floor without an edge has no size.
        if has_part and each.type != "EMPTY" and each.meniscus.shape != "PLANE":
            studio.add_corners(box, each)
    if not box.exists():
        return False
    if 0.0 < box.low[2] < 5.0 * box.size():
        # Down to the floor, on which liquid falls.
        box.low[2] = 0.0
    middle = Vector((box.low + box.high) / 2.0)
    if box.size() > SMALL * (camera.matrix_basis.translation - middle).length:
        return False
    low, high = box.low - MARGIN * box.size(), box.high + MARGIN * box.size()
    corners = [(x, y, z) for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]
    camera.location, _ = camera.camera_fit_coords(graph, np.array(corners).ravel().tolist())
    camera.data.clip_start = min(camera.data.clip_start, 0.05 * box.size())
    camera[PLACED] = placement(camera)
    return True
