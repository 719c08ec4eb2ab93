# SPDX-License-Identifier: MIT OR Apache-2.0
"""The folder of a scene, and the .blend and scene that it belongs to."""

import os
from pathlib import Path

import bpy

from ..messages import ShotError, printable
from . import assets


def folder_of(scene: bpy.types.Scene) -> Path:
    """The folder that the scene names, absolute. Raises ShotError."""
    text = scene.meniscus.folder
    if not text.strip():
        raise ShotError("No folder is chosen. Set Folder in Properties > Scene > Meniscus")
    if text.startswith("//") and not bpy.data.filepath:
        raise ShotError("The .blend is not saved, so no folder can be relative to it. Save it first, or choose an absolute folder")
    path = Path(bpy.path.abspath(text))
    if not path.is_absolute():
        raise ShotError(f"{printable(text)}: not an absolute folder. Start it with //, for one next to the .blend")
    return path


def blend_from(root: Path) -> str:
    """The path of the .blend relative to a folder, so that both can be moved; empty if it is not saved."""
    path = bpy.data.filepath
    if not path:
        return ""
    try:
        return os.path.relpath(os.path.realpath(path), os.path.realpath(root))
    except ValueError:
        # Another drive.
        return os.path.realpath(path)


def is_same(root: Path, blend: str) -> bool:
    """Whether a path that `blend_from` made is that of this file."""
    return os.path.normcase(blend) == os.path.normcase(blend_from(root))


def check_owner(scene: bpy.types.Scene, root: Path, takes_over: bool) -> None:
    """Raises ShotError if a folder is that of another scene, or of another .blend that still exists."""
    place = os.path.normcase(os.path.realpath(root))
    for each in bpy.data.scenes:
        if each == scene or all(one.meniscus.role == "NONE" for one in each.objects):
            continue
        try:
            is_shared = os.path.normcase(os.path.realpath(folder_of(each))) == place
        except ShotError:
            is_shared = False
        if is_shared:
            text = f"is also the folder of the scene {printable(each.name)}. Choose another in Properties > Scene > Meniscus"
            raise ShotError(f"{printable(root)}: {text}")
    blend = assets.read_objects(root).get("blend")
    is_other = isinstance(blend, str) and bool(blend) and bool(bpy.data.filepath) and not is_same(root, blend)
    if is_other and not takes_over and os.path.isfile(os.path.join(os.path.realpath(root), blend)):
        text = f"is the folder of {printable(os.path.basename(blend))}. Choose another, or take it over with Write Preset"
        raise ShotError(f"{printable(root)}: {text}")
