# SPDX-License-Identifier: MIT OR Apache-2.0
"""Tests of which object an output belongs to, for the stage of logs.py: no engine, presets that are only written."""

from pathlib import Path
from types import SimpleNamespace

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


def check_copied_later(folder: Path) -> None:
    """A copy made after the file was opened again takes nothing from its original, which may be renamed; a lost object is reported."""
    scene = empty(folder)
    add("cloth")
    scene_module("preset").write(bpy.context)
    path = str(folder / "scene.blend")
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.open_mainfile(filepath=path)
    scene = bpy.context.scene
    scene.objects["Cloth"].name = "Sail"
    copy_of(scene.objects["Sail"], "Cloth")
    found = sources(folder).object(scene, "Cloth", "CLOTH")
    check(found == scene.objects["Sail"], "a later copy with its original's name is not the original", found)
    bpy.ops.wm.save_mainfile()
    marked = [each.name for each in scene.objects if each.meniscus.identifier]
    check(marked == ["Sail"], "a saved file has an identifier once", marked)
    bpy.ops.wm.open_mainfile(filepath=path)
    scene = bpy.context.scene
    scene.objects["Sail"].name, scene.objects["Cloth"].name = "Flag", "Kite"
    found = sources(folder).object(scene, "Cloth", "CLOTH")
    check(found == scene.objects["Flag"], "it is found after another rename", found)
    # As files of earlier versions have it.
    scene.objects["Kite"].meniscus.identifier = found.meniscus.identifier
    notes = sources(folder).lacking(scene, ["Cloth"], "CLOTH")
    check(len(notes) == 1 and "Cloth" in notes[0], "an object that cannot be distinguished from its copy is reported", notes)
    scene.objects["Kite"].name = "Cloth"
    check(not sources(folder).lacking(scene, ["Cloth"], "CLOTH"), "unless its name is that of the preset")
    bpy.ops.wm.save_mainfile()
    marked = [each.name for each in scene.objects if each.meniscus.identifier]
    check(marked == ["Cloth"], "the saved file has an identifier once then", marked)


def check_view_layers(folder: Path) -> None:
    """An object that the first view layer excludes has a result with its modifiers, and is hidden in every layer."""
    scene = empty(folder)
    body = add("body")
    body.modifiers.new("Array", "ARRAY").count = 2
    scene_module("preset").write(bpy.context)
    collection = bpy.data.collections.new("Bodies")
    scene.collection.children.link(collection)
    for each in body.users_collection:
        each.objects.unlink(body)
    collection.objects.link(body)
    first, second = scene.view_layers[0], scene.view_layers.new("Second")
    show, shot = scene_module("show"), SimpleNamespace(sheets=[], colliders=[SimpleNamespace(name="Body")], frames=SimpleNamespace(first=1))

    def result() -> tuple[int, list[str]]:
        with scene_module("session").in_scene(scene):
            copies, notes = (call(bpy.context, scene, shot, sources(folder)) for call in (show.copies_of, show.lacking))
        return len(copies["Body"].data.vertices), notes

    expected = result()
    first.layer_collection.children["Bodies"].exclude = True
    check(result() == expected and not expected[1], "a result has its object's modifiers where the first view layer excludes it", (result(), expected))
    shown = bpy.data.objects.new("Body Simulated", None)
    show.stand_in(shown, body, scene)
    check(body.hide_get(view_layer=second), "the object is hidden in the other view layer")
    check(result() == expected and body.hide_get(view_layer=second), "its own eye changes nothing, and stays closed", result())
    second.layer_collection.children["Bodies"].exclude = True
    count, notes = result()
    check(count < expected[0] and len(notes) == 1 and "Body" in notes[0], "an object that every view layer excludes is reported", (count, notes))
