# SPDX-License-Identifier: MIT OR Apache-2.0
"""Volume sequences as Blender's own volume objects, surfaces of their level sets, and the materials `Smoke` and `Mist`.

Cycles multiplies `velocity` by the shutter and divides by the scene's frame rate where the unit is *Second*, so
the grid holds the file's metres a second unchanged.
"""

import math
import os
import re
from collections.abc import Callable, Iterable

import bpy

from . import nodes
from .material import own
from .messages import printable
from .shot import FOG, LEVEL_SET, MAX_SCENE_FRAME, WHITEWATER, VolumeOutput, below

# A file of a sequence.
NUMBERED = re.compile(r"(.*?)[0-9]+\.vdb")
NAME = "Smoke"
STAMP = "meniscus_smoke"
MIST_NAME, MIST_STAMP = "Mist", "meniscus_mist"
# Of volumes that another object shows, or that only hold a level set.
HIDDEN_SUFFIX = "_volume"
# Light fades to a third over this part of the smoke's size, where its density is 1: thinner looks like haze,
# thicker like wool.
THICKNESS = 0.03
COLOUR = (0.82, 0.83, 0.85, 1.0)
# Frames that are opened to find some smoke; an emitter's first few are empty.
MAX_PROBED_FRAMES = 100
# Smoke throws light on rather than back.
ANISOTROPY = 0.2


def add_volume(
    context: bpy.types.Context, output: VolumeOutput, folder: str, present: list[int], liquid: Callable[[], bpy.types.Material]
) -> list[bpy.types.Object]:
    """New objects that show one sequence, in no collection yet: fog, or the surface of a level set with what `liquid` makes.

    `folder` is the shot's, absolute or //…
    """
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
    if output.is_hidden or output.has_surface:
        made.name = f"{output.name}{HIDDEN_SUFFIX}"
        made.hide_render = made.hide_viewport = True
    if output.has_surface:
        return [made, level_set(made, output, liquid())]
    if FOG in output.grids:
        volume.materials.append(smoke(size(context, output.name, paths)))
    elif not output.has_surface and set(WHITEWATER) & set(output.grids):
        volume.materials.append(mist(size(context, output.name, paths)))
    return [made]


def level_set(volume: bpy.types.Object, output: VolumeOutput, material: bpy.types.Material) -> bpy.types.Object:
    """A new object with the surface at which a volume's level set is zero, and with the volume's velocities."""
    made = bpy.data.objects.new(output.name, bpy.data.meshes.new(output.name))
    made.data.materials.append(material)
    modifier = made.modifiers.new("Meniscus Level Set", "VOLUME_TO_MESH")
    modifier.object, modifier.grid_name = volume, LEVEL_SET
    modifier.threshold, modifier.use_smooth_shade = 0.0, True
    if output.has_velocity:
        made.modifiers.new(nodes.LEVEL_SET_NAME, "NODES").node_group = nodes.level_set_group()
    show_level_set(made, volume)
    return made


def show_level_set(made: bpy.types.Object, volume: bpy.types.Object) -> None:
    """Makes the surface of a level set that of a volume."""
    for modifier in made.modifiers:
        if modifier.type == "VOLUME_TO_MESH":
            modifier.object = volume
        elif nodes.is_of_level_set(modifier):
            nodes.set_inputs(modifier, {"Volume": volume})


# Modification times [ns] of the files that volumes of this Blender were given, by their real paths.
times: dict[str, int] = {}


@bpy.app.handlers.persistent
def remember(*_: object) -> None:
    """Notes the files of the sequences in the file that was opened: Blender reads them when it draws."""
    for volume in bpy.data.volumes:
        folder, name = os.path.split(os.path.realpath(bpy.path.abspath(volume.filepath)))
        match = NUMBERED.fullmatch(name)
        if match is None:
            continue
        try:
            with os.scandir(folder) as entries:
                for entry in entries:
                    other = NUMBERED.fullmatch(entry.name)
                    if other is not None and other[1] == match[1]:
                        times.setdefault(entry.path, entry.stat().st_mtime_ns)
        except OSError:
            # Moved or gone: Blender has nothing of it, either.
            continue


def rewritten(output: VolumeOutput, folder: str, frames: Iterable[int]) -> str | None:
    """A message if files of some frames were rewritten since a volume of this Blender was given them; None if none was.

    Blender keeps what it has read of a volume, by its path, until it is closed: whatever object shows it, it is the earlier one.
    """
    is_rewritten = False
    for frame in frames:
        path = os.path.realpath(bpy.path.abspath(below(folder, output.path(frame))))
        try:
            time = os.stat(path).st_mtime_ns
        except OSError:
            # It was checked before, and is gone again.
            continue
        is_rewritten |= times.setdefault(path, time) != time
    if not is_rewritten:
        return None
    text = "its files were rewritten, and Blender keeps what it has read of volumes until it is closed"
    return f"{printable(output.name)}: {text}. Frames that were shown before look as before. Save, and open the file in a new Blender"


def size(context: bpy.types.Context, name: str, paths: list[str]) -> float:
    """The diagonal of the first frame with smoke: an emitter's first is empty. 1 if there is none."""
    found = extent(context, name, paths)
    return 1.0 if found is None else found


def extent(context: bpy.types.Context, name: str, paths: list[str]) -> float | None:
    """The diagonal of the first of some files with smoke in it; None if there is none."""
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
        return None
    finally:
        # Takes the object along.
        bpy.data.volumes.remove(probe)


def smoke(size: float) -> bpy.types.Material:
    """The file's own Smoke that an earlier import made, else a new one for smoke of this size in metres."""
    material, is_new = own(NAME, STAMP)
    if is_new:
        scatter(material, [FOG], size)
    return material


def mist(size: float) -> bpy.types.Material:
    """The file's own Mist that an earlier import made, else a new one for volumes of whitewater of this size in metres."""
    material, is_new = own(MIST_NAME, MIST_STAMP)
    if is_new:
        scatter(material, list(WHITEWATER), size)
    return material


def scatter(material: bpy.types.Material, grids: list[str], size: float) -> None:
    """Makes a material a cloud, as dense as the sum of some grids."""
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    total = None
    for row, grid in enumerate(grids):
        there = nodes.new("ShaderNodeAttribute")
        there.attribute_name, there.location = grid, (0, -200 * row)
        found = there.outputs["Fac"]
        if total is not None:
            both = nodes.new("ShaderNodeMath")
            both.operation, both.location = "ADD", (120 + 120 * row, -200 * row)
            links.new(total, both.inputs[0])
            links.new(found, both.inputs[1])
            found = both.outputs[0]
        total = found
    scale = nodes.new("ShaderNodeMath")
    scale.operation, scale.label = "MULTIPLY", "Fades a metre"
    scale.inputs[1].default_value = 1.0 / (THICKNESS * size)
    shader = nodes.new("ShaderNodeVolumePrincipled")
    shader.inputs["Color"].default_value = COLOUR
    shader.inputs["Anisotropy"].default_value = ANISOTROPY
    # The density comes through the nodes above, where it can be scaled.
    shader.inputs["Density Attribute"].default_value = ""
    output = nodes.new("ShaderNodeOutputMaterial")
    links.new(total, scale.inputs[0])
    links.new(scale.outputs[0], shader.inputs["Density"])
    links.new(shader.outputs[0], output.inputs["Volume"])
    for place, node in enumerate((scale, shader, output)):
        node.location = (240 * (place + len(grids)), 0)
