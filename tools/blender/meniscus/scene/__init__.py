# SPDX-License-Identifier: MIT OR Apache-2.0
"""From a Blender scene to a shot: roles of objects, the preset, the engine's process, and its results as they arrive."""

import bpy

from . import add, engine, identity, panels, roles, session

CLASSES = [engine.MENISCUS_Preferences, add.MENISCUS_OT_add, add.MENISCUS_MT_add, *panels.CLASSES]


def register() -> None:
    roles.register()
    for each in CLASSES:
        bpy.utils.register_class(each)
    bpy.types.VIEW3D_MT_add.append(add.menu_item)
    identity.register()
    session.register()


def unregister() -> None:
    session.unregister()
    identity.unregister()
    bpy.types.VIEW3D_MT_add.remove(add.menu_item)
    for each in reversed(CLASSES):
        bpy.utils.unregister_class(each)
    roles.unregister()
