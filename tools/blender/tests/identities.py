# SPDX-License-Identifier: MIT OR Apache-2.0
"""Tests of which object an output belongs to, for the stage of logs.py: no engine, presets that are only written."""

from pathlib import Path

import bpy

from harness import check
from presets import add
from scenes import empty, scene_module


def copy_of(source: bpy.types.Object, name: str = "") -> bpy.types.Object:
    made = source.copy()
    made.data = source.data.copy()
    made.name = name or made.name
    bpy.context.scene.collection.objects.link(made)
    return made


def sources(folder: Path):
    return scene_module("identity").Sources(folder / "meniscus")


def check_deleted(folder: Path) -> None:
    """The output of a deleted object is not that of its duplicate; undo brings it back."""
    scene = empty(folder)
    cloth = add("cloth")
    scene_module("preset").write(bpy.context)
    copy_of(cloth)
    bpy.ops.ed.undo_push(message="Before")
    with bpy.context.temp_override(selected_objects=[cloth]):
        bpy.ops.object.delete()
    bpy.ops.ed.undo_push(message="Delete")
    found = sources(folder).object(scene, "Cloth", "CLOTH")
    check(len(scene.objects) == 1 and found is None, "the output of a deleted object does not become that of its duplicate", found)
    bpy.ops.ed.undo()
    scene = bpy.context.scene
    found = sources(folder).object(scene, "Cloth", "CLOTH")
    check(len(scene.objects) == 2 and found == scene.objects["Cloth"], "an object that undo brings back has its output", found)
    full = bpy.data.scenes.new("Full Copy")
    full.collection.objects.link(scene.objects["Cloth.001"])
    found = sources(folder).object(full, "Cloth", "CLOTH")
    check(found == scene.objects["Cloth.001"], "in a copy of the scene the copied object has the output", found)
