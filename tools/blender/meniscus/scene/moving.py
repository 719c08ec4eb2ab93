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
# Constraints whose result follows from the objects that they name. Others (tracks and cameras of movie clips, caches) have a time of their own.
STATIC_CONSTRAINTS = {
    "ACTION", "ARMATURE", "CHILD_OF", "CLAMP_TO", "COPY_LOCATION", "COPY_ROTATION", "COPY_SCALE", "COPY_TRANSFORMS", "DAMPED_TRACK", "FLOOR",
    "FOLLOW_PATH", "IK", "LIMIT_DISTANCE", "LIMIT_LOCATION", "LIMIT_ROTATION", "LIMIT_SCALE", "LOCKED_TRACK", "MAINTAIN_VOLUME", "PIVOT",
    "SHRINKWRAP", "SPLINE_IK", "STRETCH_TO", "TRACK_TO", "TRANSFORM",
}  # fmt: skip
# Data-blocks whose content depends on the current frame without an animation.
TIME_DEPENDENT_TYPES = (bpy.types.MovieClip, bpy.types.CacheFile, bpy.types.ParticleSettings, bpy.types.Sound)
# Data-blocks that give no object a place, a shape or a setting.
SHADING_AND_INTERFACE_TYPES = (bpy.types.Material, bpy.types.World, bpy.types.WorkSpace, bpy.types.Screen, bpy.types.WindowManager)
TIME_DEPENDENT_NODES = {f"GeometryNode{name}" for name in ("InputSceneTime", "SimulationInput", "SimulationOutput", "InputActiveCamera", "Bake")}


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
        if each in found or isinstance(each, SHADING_AND_INTERFACE_TYPES):
            continue
        found.add(each)
        if not isinstance(each, bpy.types.Scene):
            waiting += uses.get(each, ())
    return found


def may_change(each: bpy.types.ID) -> bool:
    if isinstance(each, TIME_DEPENDENT_TYPES) or is_animated(each):
        return True
    if isinstance(each, bpy.types.Image):
        return each.source in ("SEQUENCE", "MOVIE")
    if isinstance(each, bpy.types.Volume):
        return each.is_sequence
    if isinstance(each, bpy.types.NodeTree):
        return any(node.bl_idname in TIME_DEPENDENT_NODES or node.bl_idname.startswith("GeometryNodeImport") for node in each.nodes)
    if isinstance(each, bpy.types.Object):
        return may_object_change(each)
    return False


def may_object_change(each: bpy.types.Object) -> bool:
    # Every metaball of a family shapes the surface, and no data-block names the others.
    if each.type == "META" or each.rigid_body is not None or any(modifier.type not in STATIC_MODIFIERS for modifier in each.modifiers):
        return True
    bones = each.pose.bones if each.pose is not None else ()
    constraints = [*each.constraints, *(constraint for bone in bones for constraint in bone.constraints)]
    # The solver of iTaSC simulates over time.
    has_solver = each.pose is not None and each.pose.ik_solver != "LEGACY"
    return has_solver or any(constraint.type not in STATIC_CONSTRAINTS for constraint in constraints)


def is_animated(each: bpy.types.ID) -> bool:
    """Whether a data-block has an action, drivers or strips. Bones are animated by the data of their object."""
    data = getattr(each, "animation_data", None)
    return data is not None and (data.action is not None or bool(data.drivers) or bool(data.nla_tracks))
