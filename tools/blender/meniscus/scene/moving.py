# SPDX-License-Identifier: MIT OR Apache-2.0
"""Whether anything that a preset is made of can change over time; if not, one frame is sampled in place of all.

Conservative: what is not known to be static counts as moving. Only data-blocks on which the objects with a role depend are
looked at, so results that are shown in the scene, which move, do not count.
"""

import bpy

# Modifiers whose result follows from the object and the data-blocks that they name. Others (cloth, caches, …) have a time of their own.
STATIC_MODIFIERS = {
    "ARMATURE", "ARRAY", "BEVEL", "BOOLEAN", "CAST", "CORRECTIVE_SMOOTH", "CURVE", "DATA_TRANSFER", "DECIMATE", "DISPLACE", "EDGE_SPLIT",
    "HOOK", "LAPLACIANDEFORM", "LAPLACIANSMOOTH", "MASK", "MESH_DEFORM", "MIRROR", "MULTIRES", "NODES", "NORMAL_EDIT", "REMESH",
    "SCREW", "SHRINKWRAP", "SIMPLE_DEFORM", "SKIN", "SMOOTH", "SOLIDIFY", "SUBSURF", "SURFACE_DEFORM", "TRIANGULATE", "UV_PROJECT", "UV_WARP",
    "VERTEX_WEIGHT_EDIT", "VERTEX_WEIGHT_MIX", "VERTEX_WEIGHT_PROXIMITY", "WARP", "WEIGHTED_NORMAL", "WELD", "WIREFRAME",
}  # fmt: skip
# Data-blocks that play over time by themselves.
PLAYING = (bpy.types.MovieClip, bpy.types.CacheFile, bpy.types.ParticleSettings, bpy.types.Sound)
# Data-blocks that give no object a place, a shape or a setting.
LOOKS = (bpy.types.Material, bpy.types.World, bpy.types.WorkSpace, bpy.types.Screen, bpy.types.WindowManager)
TIME_NODES = {f"GeometryNode{name}" for name in ("InputSceneTime", "SimulationInput", "SimulationOutput", "InputActiveCamera", "Bake")}


def moves(scene: bpy.types.Scene, sources: list[bpy.types.Object]) -> bool:
    """Whether an object, or what it depends on, may differ between two frames of a scene."""
    if bpy.app.handlers.frame_change_pre or bpy.app.handlers.frame_change_post:
        # Other extensions move things there.
        return True
    return is_animated(scene) or any(may_change(each) for each in dependencies(sources))


def dependencies(sources: list[bpy.types.Object]) -> set[bpy.types.ID]:
    """The objects, and every data-block that one of them uses, over any number of steps; not through scenes."""
    uses: dict[bpy.types.ID, list[bpy.types.ID]] = {}
    for used, users in bpy.data.user_map().items():
        for user in users:
            uses.setdefault(user, []).append(used)
    found: set[bpy.types.ID] = set()
    waiting: list[bpy.types.ID] = list(sources)
    while waiting:
        each = waiting.pop()
        if each in found or isinstance(each, LOOKS):
            continue
        found.add(each)
        if not isinstance(each, bpy.types.Scene):
            waiting += uses.get(each, ())
    return found


def may_change(each: bpy.types.ID) -> bool:
    if isinstance(each, PLAYING) or is_animated(each):
        return True
    if isinstance(each, bpy.types.Image):
        return each.source in ("SEQUENCE", "MOVIE")
    if isinstance(each, bpy.types.Volume):
        return each.is_sequence
    if isinstance(each, bpy.types.NodeTree):
        return any(node.bl_idname in TIME_NODES or node.bl_idname.startswith("GeometryNodeImport") for node in each.nodes)
    if isinstance(each, bpy.types.Object):
        return each.rigid_body is not None or any(modifier.type not in STATIC_MODIFIERS for modifier in each.modifiers)
    return False


def is_animated(each: bpy.types.ID) -> bool:
    """Whether a data-block has an action, drivers or strips. Bones are animated by the data of their object."""
    data = getattr(each, "animation_data", None)
    return data is not None and (data.action is not None or bool(data.drivers) or bool(data.nla_tracks))
