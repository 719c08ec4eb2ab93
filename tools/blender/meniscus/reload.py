# SPDX-License-Identifier: MIT OR Apache-2.0
"""Reloads imported shots: reads shot.json again, and gives the objects of the import what it names now.

An import marks its objects with its number and the path of shot.json. When the .blend is saved elsewhere, paths that the import chose
by itself become relative to it.
"""

import os
import uuid
from pathlib import Path

import bpy

from . import nodes, outputs, sheets, volumes
from .check import check_cache, check_files
from .folder import ShotFolder
from .messages import ShotError, listed, printable
from .motion import read_motion
from .selection import chosen, select
from .shot import below, read_shot
from .update import IMPORT, OUTPUT, Target

# Custom properties of imported objects: the path of shot.json, and how it was to be written.
SHOT, MODE = "meniscus_shot", "meniscus_paths"


def mark(made: outputs.Made, folder: str, file: str, mode: str) -> None:
    """Marks the objects of a new import."""
    number = uuid.uuid4().hex
    for key, each in made.all():
        each[OUTPUT], each[IMPORT], each[SHOT], each[MODE] = key, number, f"{folder.removesuffix('/')}/{file}", mode


def imports(scene: bpy.types.Scene) -> dict[str, list[bpy.types.Object]]:
    """The objects of each import in a scene, by its number."""
    found: dict[str, list[bpy.types.Object]] = {}
    for each in scene.objects:
        if isinstance(each.get(IMPORT), str) and isinstance(each.get(SHOT), str):
            found.setdefault(each[IMPORT], []).append(each)
    return found


def reload(context: bpy.types.Context, scene: bpy.types.Scene, number: str, shown: list[bpy.types.Object]) -> list[tuple[str, str]]:
    """Shows what the shot of one import has now; kinds of reports and their texts. Raises ShotError."""
    notes: list[tuple[str, str]] = []
    path = shown[0][SHOT]
    if path.startswith("//") and not bpy.data.filepath:
        raise ShotError(f"{printable(path)}: relative to a .blend that is not saved. Save it first")
    shot = read_shot(Path(bpy.path.abspath(path)))
    files = ShotFolder(shot.folder)
    frames = check_files(shot, files, lambda text: notes.append(("WARNING", text)))
    folder = outputs.shot_folder(files.root, "AUTO" if path.startswith("//") else "ABSOLUTE")
    outputs.check_paths(shot, folder)
    motions = {collider: read_motion(files, collider.motion) for collider in shot.colliders}
    for collider, motion in motions.items():
        check_cache(collider, motion, files)
    home = shown[0].users_collection[0] if shown[0].users_collection else scene.collection
    target = Target(scene, lambda: home, number=number)
    now = [target.sequence(output, folder, shot.viscosity) for output in (*shot.meshes, *shot.points)]
    for output in shot.volumes:
        now += target.volume(context, output, folder, frames[output], shot.viscosity)
        text = volumes.rewritten(output, folder, frames[output])
        if text is not None:
            notes.append(("WARNING", text))
    for sheet in shot.sheets:
        now.append(target.adopt(sheets.add_sheet(sheet, files.full(sheet.rest), below(folder, sheet.cache)), outputs.key_of(sheet)))
    for collider, motion in motions.items():
        now.append(target.adopt(outputs.add_solid(collider, motion, files, folder), outputs.key_of(collider)))
    for each in now:
        each[SHOT], each[MODE] = path, now[0].get(MODE, "AUTO")
        each.update_tag()
    kept = {each.name for each in now}
    gone = sorted(each.name for each in imports(scene)[number] if each.name not in kept)
    if gone:
        notes.append(("WARNING", f"{shot.title}: {listed(gone)}: no longer in the shot; what was shown stays"))
    if (scene.frame_start, scene.frame_end) != (shot.frames.first, shot.frames.last):
        span = f"frames {shot.frames.first} to {shot.frames.last}, the scene {scene.frame_start} to {scene.frame_end}"
        notes.append(("INFO", f"{shot.title}: the shot has {span}"))
    notes.append(("INFO", f"{shot.title}: {len(now)} object(s) reloaded"))
    return notes


class IMPORT_SCENE_OT_meniscus_reload(bpy.types.Operator):
    """Read the shots that were imported into this scene again: more frames, other outputs, changed files"""

    bl_idname = "import_scene.meniscus_reload"
    bl_label = "Reload Meniscus Shots"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not imports(context.scene):
            cls.poll_message_set("This scene has no imported shot. File > Import > Meniscus Shot")
            return False
        return context.mode == "OBJECT"

    def execute(self, context: bpy.types.Context) -> set[str]:
        selected, active = chosen(context.view_layer)
        failed = 0
        for number, shown in imports(context.scene).items():
            try:
                for kind, text in reload(context, context.scene, number, shown):
                    self.report({kind}, text)
            except ShotError as error:
                failed += 1
                self.report({"ERROR"}, str(error))
        select(context.view_layer, selected, active)
        return {"CANCELLED"} if failed else {"FINISHED"}


def held_paths(shown: bpy.types.Object) -> list[tuple[object, str]]:
    """What has paths of a shot in an object, and the attribute with it; the input of a node group as its name."""
    found: list[tuple[object, str]] = [(shown, SHOT)]
    for modifier in shown.modifiers:
        if modifier.type == "NODES" and modifier.node_group and any(reader.stamp in modifier.node_group for reader in nodes.READERS):
            found.append((modifier, "Files"))
        elif modifier.type == "MESH_CACHE":
            found.append((modifier, "filepath"))
    if shown.type == "VOLUME":
        found.append((shown.data, "filepath"))
    return found


def get_path(holder: object, name: str) -> str:
    if name == "Files":
        return nodes.get_input(holder, name) or ""
    return holder.get(name, "") if name == SHOT else getattr(holder, name)


def set_path(holder: object, name: str, path: str) -> None:
    if name == "Files":
        nodes.set_inputs(holder, {name: path})
        holder.id_data.update_tag()
    elif name == SHOT:
        holder[name] = path
    else:
        setattr(holder, name, path)


def rebase(path: str, old: str, new: str) -> str:
    """A path that was absolute or relative to the .blend `old`, relative to the .blend `new`; unchanged on another drive."""
    absolute = os.path.normpath(os.path.join(os.path.dirname(old), path[2:])) if path.startswith("//") else path
    try:
        return "//" + os.path.relpath(absolute, os.path.dirname(new)).replace("\\", "/")
    except ValueError:
        return absolute


def save_elsewhere(old: str, new: str) -> None:
    """Makes paths relative to the .blend `new` where they are relative to `old`, or where the import was to choose.

    Blender itself moves the relative paths of volumes and point caches.
    """
    for shown in bpy.data.objects:
        if not isinstance(shown.get(OUTPUT), str):
            continue
        for holder, name in held_paths(shown):
            path = get_path(holder, name)
            is_text = name in ("Files", SHOT)
            if path.startswith("//"):
                if old and is_text and os.path.dirname(old) != os.path.dirname(new):
                    set_path(holder, name, rebase(path, old, new))
            elif path and not old and shown.get(MODE, "AUTO") == "AUTO":
                set_path(holder, name, rebase(path, old, new))


@bpy.app.handlers.persistent
def before_saving(path: str = "", *_) -> None:
    if path:
        save_elsewhere(bpy.data.filepath, os.path.abspath(path))
        saving.append((bpy.data.filepath, os.path.abspath(path)))


@bpy.app.handlers.persistent
def after_saving(*_) -> None:
    """After a copy was saved, this file keeps its own place."""
    while saving:
        old, new = saving.pop()
        if old and bpy.data.filepath and os.path.abspath(bpy.data.filepath) != new:
            save_elsewhere(new, old)


saving: list[tuple[str, str]] = []


def register() -> None:
    bpy.utils.register_class(IMPORT_SCENE_OT_meniscus_reload)
    bpy.app.handlers.save_pre.append(before_saving)
    bpy.app.handlers.save_post.append(after_saving)


def unregister() -> None:
    bpy.app.handlers.save_pre.remove(before_saving)
    bpy.app.handlers.save_post.remove(after_saving)
    bpy.utils.unregister_class(IMPORT_SCENE_OT_meniscus_reload)
