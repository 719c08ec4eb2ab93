# SPDX-License-Identifier: MIT OR Apache-2.0
"""Colliders: a mesh with keyframes in every frame in which it moves, and the materials `Collider`, `Ground` and `Glass`.

Keyframes are linear between whole frames, so Cycles blurs a collider along its motion.
"""

from math import radians

import bpy
from mathutils import Matrix, Vector

from .material import own, principled
from .motion import Motion
from .sheets import read_mesh
from .shot import ColliderOutput

# Size of a plane over that of the square in its file.
PLANE_SIZE = 20.0
# Faces that meet at a larger angle have an edge.
EDGE_ANGLE = radians(30.0)
MATTE_NAME, MATTE_STAMP = "Collider", "meniscus_collider"
MATTE_COLOUR, MATTE_ROUGHNESS = (0.60, 0.52, 0.38, 1.0), 0.55
GROUND_NAME, GROUND_STAMP = "Ground", "meniscus_ground"
GROUND_COLOUR, GROUND_ROUGHNESS = (0.16, 0.18, 0.20, 1.0), 0.6
GLASS_NAME, GLASS_STAMP = "Glass", "meniscus_glass"
GLASS_IOR = 1.5
# Without caustics glass throws a black shadow; shadow rays pass with this colour instead.
GLASS_SHADOW = (0.92, 0.95, 0.95, 1.0)
# Custom property with the key of the shape.
SHAPE = "meniscus_shape"
# In BezTriple.
LINEAR = 1


def add_collider(collider: ColliderOutput, mesh: str, motion: Motion) -> bpy.types.Object:
    """A new object that shows one collider, in no collection yet. Raises ShotError."""
    made = read_mesh(collider.name, mesh)
    made.data.set_sharp_from_angle(angle=EDGE_ANGLE)
    if motion.shape == "plane":
        # The file has a square of a plane without an edge: what it shows should end behind the horizon.
        enlarge(made.data, PLANE_SIZE)
    matte_of_shape = ground if motion.shape == "plane" else matte
    made.data.materials.append(glass() if motion.look == "glass" else matte_of_shape())
    made.hide_render = made.hide_viewport = motion.look == "hidden"
    made.rotation_mode, made[SHAPE] = "QUATERNION", motion.shape
    made.location, made.rotation_quaternion = motion.poses[0][:3], motion.poses[0][3:]
    made.scale = [motion.scales[0]] * 3 if motion.scales else (1.0, 1.0, 1.0)
    if motion.scales or any(pose != motion.poses[0] for pose in motion.poses):
        animate(made, motion)
    return made


def enlarge(mesh: bpy.types.Mesh, factor: float) -> None:
    """Scales a mesh about the mean of its vertices: a plane stays in its plane."""
    middle = sum((vertex.co for vertex in mesh.vertices), Vector()) / len(mesh.vertices)
    mesh.transform(Matrix.Translation(middle) @ Matrix.Scale(factor, 4) @ Matrix.Translation(-middle))


def animate(made: bpy.types.Object, motion: Motion) -> None:
    """A keyframe in each frame of the motion."""
    action = bpy.data.actions.new(made.name)
    slot = action.slots.new("OBJECT", made.name)
    curves = action.layers.new("Motion").strips.new(type="KEYFRAME").channelbag(slot, ensure=True).fcurves
    channels = [("location", axis) for axis in range(3)] + [("rotation_quaternion", axis) for axis in range(4)]
    count = len(motion.poses)
    columns = [[pose[column] for pose in motion.poses] for column in range(len(channels))]
    if motion.scales:
        channels += [("scale", axis) for axis in range(3)]
        columns += [motion.scales] * 3
    for (path, axis), values in zip(channels, columns):
        points = curves.new(path, index=axis).keyframe_points
        points.add(count)
        places = [0.0] * (2 * count)
        places[::2] = range(motion.first, motion.first + count)
        places[1::2] = values
        points.foreach_set("co", places)
        points.foreach_set("interpolation", [LINEAR] * count)
        curves[-1].update()
    data = made.animation_data_create()
    data.action, data.action_slot = action, slot


def remove_animation(made: bpy.types.Object) -> None:
    """Removes the keyframes of an object, and their action unless another has it."""
    action = made.animation_data.action if made.animation_data else None
    if action is not None:
        made.animation_data.action = None
        if not action.users:
            bpy.data.actions.remove(action)


def matte() -> bpy.types.Material:
    """The file's own Collider that an earlier import made, else a new one."""
    return plain(MATTE_NAME, MATTE_STAMP, MATTE_COLOUR, MATTE_ROUGHNESS)


def ground() -> bpy.types.Material:
    """The file's own Ground that an earlier import made, else a new one: planes, and the ground that the import adds."""
    return plain(GROUND_NAME, GROUND_STAMP, GROUND_COLOUR, GROUND_ROUGHNESS)


def plain(name: str, stamp: str, colour: tuple[float, ...], roughness: float) -> bpy.types.Material:
    material, is_new = own(name, stamp)
    if is_new:
        material.diffuse_color = colour
        shader = principled(material)
        shader.inputs["Base Color"].default_value = colour
        shader.inputs["Roughness"].default_value = roughness
    return material


def glass() -> bpy.types.Material:
    """The file's own Glass that an earlier import made, else a new one."""
    material, is_new = own(GLASS_NAME, GLASS_STAMP)
    if not is_new:
        return material
    material.use_raytrace_refraction = True
    material.diffuse_color = (0.8, 0.9, 0.9, 0.3)
    nodes, links = material.node_tree.nodes, material.node_tree.links
    surface = principled(material)
    output = next(node for node in nodes if node.type == "OUTPUT_MATERIAL")
    surface.inputs["Base Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    surface.inputs["Roughness"].default_value = 0.0
    surface.inputs["IOR"].default_value = GLASS_IOR
    surface.inputs["Transmission Weight"].default_value = 1.0
    clear = nodes.new("ShaderNodeBsdfTransparent")
    clear.inputs["Color"].default_value = GLASS_SHADOW
    path, mix = nodes.new("ShaderNodeLightPath"), nodes.new("ShaderNodeMixShader")
    links.new(path.outputs["Is Shadow Ray"], mix.inputs[0])
    links.new(surface.outputs[0], mix.inputs[1])
    links.new(clear.outputs[0], mix.inputs[2])
    links.new(mix.outputs[0], output.inputs["Surface"])
    for node, place in ((surface, (-200, 0)), (clear, (-200, 380)), (path, (-200, 720)), (mix, (120, 200))):
        node.location = place
    return material
