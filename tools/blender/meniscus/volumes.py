# SPDX-License-Identifier: MIT OR Apache-2.0
"""Volume sequences as Blender's own volume objects, and the `Smoke` material.

Cycles multiplies `velocity` by the shutter and divides by the scene's frame rate where the unit is *Second*, so
the grid holds the file's metres a second unchanged.
"""

import math

import bpy

from .material import own
from .shot import MAX_SCENE_FRAME, VolumeOutput, below

NAME = "Smoke"
STAMP = "meniscus_smoke"
# Light fades to a third over this part of the smoke's size, where its density is 1: thinner looks like haze,
# thicker like wool.
THICKNESS = 0.03
COLOUR = (0.82, 0.83, 0.85, 1.0)
# Frames that are opened to find some smoke; an emitter's first few are empty.
MAX_PROBED_FRAMES = 100
# Smoke throws light on rather than back.
ANISOTROPY = 0.2


def add_volume(context: bpy.types.Context, output: VolumeOutput, folder: str, present: list[int]) -> bpy.types.Object:
    """A new object that shows one sequence, in no collection yet; `folder` is the shot's, absolute or //…"""
    volume = bpy.data.volumes.new(output.name)
    first, last = output.frames.first, min(output.frames.last, MAX_SCENE_FRAME)
    paths = [below(folder, output.path(frame)) for frame in present[:MAX_PROBED_FRAMES]]
    volume.filepath = below(folder, output.path(first))
    # The name of a grid is taken only where a file with it is open, which a sequence is not yet.
    if output.has_velocity and volume.grids.load():
        volume.velocity_grid, volume.velocity_unit = "velocity", "SECOND"
        volume.grids.unload()
    volume.is_sequence, volume.sequence_mode = True, "CLIP"
    # Blender counts files from one: the offset makes the number of a file that of its frame.
    volume.frame_start, volume.frame_duration, volume.frame_offset = first, last - first + 1, first - 1
    made = bpy.data.objects.new(output.name, volume)
    volume.materials.append(smoke(size(context, output.name, paths)))
    return made


def size(context: bpy.types.Context, name: str, paths: list[str]) -> float:
    """The diagonal of the first frame with smoke: an emitter's first is empty. 1 if there is none."""
    probe = bpy.data.volumes.new(name)
    shown = bpy.data.objects.new(name, probe)
    context.collection.objects.link(shown)
    try:
        for path in paths:
            probe.filepath = path
            corners = [corner[:] for corner in shown.evaluated_get(context.evaluated_depsgraph_get()).bound_box]
            spans = [max(axis) - min(axis) for axis in zip(*corners)]
            diagonal = sum(span * span for span in spans) ** 0.5
            if diagonal > 0.0 and math.isfinite(diagonal):
                return diagonal
        return 1.0
    finally:
        # Takes the object along.
        bpy.data.volumes.remove(probe)


def smoke(size: float) -> bpy.types.Material:
    """The file's own Smoke that an earlier import made, else a new one for smoke of this size in metres."""
    material, is_new = own(NAME, STAMP)
    if not is_new:
        return material
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    there = nodes.new("ShaderNodeAttribute")
    there.attribute_name = "density"
    scale = nodes.new("ShaderNodeMath")
    scale.operation, scale.label = "MULTIPLY", "Fades a metre"
    scale.inputs[1].default_value = 1.0 / (THICKNESS * size)
    shader = nodes.new("ShaderNodeVolumePrincipled")
    shader.inputs["Color"].default_value = COLOUR
    shader.inputs["Anisotropy"].default_value = ANISOTROPY
    # The density comes through the node above, where it can be scaled.
    shader.inputs["Density Attribute"].default_value = ""
    output = nodes.new("ShaderNodeOutputMaterial")
    links.new(there.outputs["Fac"], scale.inputs[0])
    links.new(scale.outputs[0], shader.inputs["Density"])
    links.new(shader.outputs[0], output.inputs["Volume"])
    for place, node in enumerate((there, scale, shader, output)):
        node.location = (240 * place, 0)
    return material
