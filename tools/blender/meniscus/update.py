# SPDX-License-Identifier: MIT OR Apache-2.0
"""Shows an output of a shot in the object that shows it already, so that names, materials, parents and modifiers stay.

Each object has a custom property with the output that it shows; objects of one import have the import's number as well.
"""

from collections.abc import Callable
from dataclasses import dataclass

import bpy

from . import nodes, outputs, volumes
from .shot import MeshOutput, PointsOutput, VolumeOutput, below, format_string

OUTPUT, IMPORT = "meniscus_output", "meniscus_import"


@dataclass
class Target:
    """Where outputs are shown: a scene, and in it the objects of one import, or of the scene's own jobs."""

    scene: bpy.types.Scene
    # Gives the collection of new objects.
    collection: Callable[[], bpy.types.Collection]
    # Metres of one unit of the scene.
    scale: float = 1.0
    # The number of an import; empty for the scene's own jobs.
    number: str = ""

    def existing(self, key: str) -> bpy.types.Object | None:
        """The object that shows an output."""
        return next((each for each in self.scene.objects if each.get(OUTPUT) == key and each.get(IMPORT, "") == self.number), None)

    def stamp(self, made: bpy.types.Object, key: str) -> None:
        made[OUTPUT] = key
        if self.number:
            made[IMPORT] = self.number

    def adopt(self, made: bpy.types.Object, key: str) -> bpy.types.Object:
        """Links a new result into the scene, or gives its data to the earlier one, which keeps what the artist did to it."""
        before = self.existing(key)
        self.stamp(made, key)
        has_plain_modifiers = all(each.type in ("MESH_CACHE", "VOLUME_TO_MESH") or nodes.is_of_level_set(each) for each in made.modifiers)
        made.scale = [part / self.scale for part in made.scale]
        if before is not None and before.type == made.type and made.data is not None and has_plain_modifiers:
            take_over(before, made)
            return before
        if before is not None:
            if made.data and before.data and len(before.data.materials):
                made.data.materials.clear()
                for each in before.data.materials:
                    made.data.materials.append(each)
            made.hide_render = before.hide_render
            name = before.name
            bpy.data.objects.remove(before)
            made.name = name
        self.collection().objects.link(made)
        return made

    def sequence(self, output: MeshOutput | PointsOutput, folder: str, viscosity: float = 0.0) -> bpy.types.Object:
        """The object of a mesh or point sequence with these frames, a new one if there is none."""
        key = outputs.key_of(output)
        shown = self.existing(key)
        files = format_string(below(folder, output.pattern))
        modifier = shown.modifiers.get(nodes.NAME) if shown is not None else None
        if modifier is None or modifier.node_group is None:
            return self.adopt(outputs.add_object(output, files, viscosity), key)
        # Another format has another group; an artist's own group stays.
        group, wanted = modifier.node_group, outputs.reader_of(output)
        if any(reader.stamp in group for reader in nodes.READERS) and wanted.stamp not in group:
            material = nodes.get_input(modifier, "Material")
            modifier.node_group = nodes.sequence_group(wanted)
            nodes.set_inputs(modifier, {"Material": material})
        nodes.set_inputs(modifier, outputs.inputs_of(output, files))
        shown.update_tag()
        return shown

    def volume(self, context: bpy.types.Context, output: VolumeOutput, folder: str, present: list[int], viscosity: float) -> list[bpy.types.Object]:
        """The objects of a volume sequence: fog, or the surface of a level set."""
        volume, *surface = volumes.add_volume(context, output, folder, present, lambda: outputs.liquid(viscosity))
        volume = self.adopt(volume, outputs.key_of(output))
        for made in surface:
            volumes.show_level_set(made, volume)
        return [volume, *(self.adopt(made, outputs.key_of(output, surface=True)) for made in surface)]


def take_over(before: bpy.types.Object, made: bpy.types.Object) -> None:
    """Gives an object the data, place, animation and modifiers of a new result, which is removed."""
    replaced, slots = before.data, [slot.material for slot in before.material_slots]
    if any(slots):
        made.data.materials.clear()
        for each in slots:
            made.data.materials.append(each)
    before.data = made.data
    if not replaced.users:
        bpy.data.batch_remove([replaced])
    before.rotation_mode = made.rotation_mode
    before.location, before.scale = made.location, made.scale
    before.rotation_quaternion, before.rotation_euler = made.rotation_quaternion, made.rotation_euler
    animate(before, made)
    for index, each in enumerate(made.modifiers):
        own = before.modifiers.get(each.name)
        if own is None or own.type != each.type:
            own = before.modifiers.new(each.name, each.type)
            before.modifiers.move(len(before.modifiers) - 1, min(index, len(before.modifiers) - 1))
        for one in each.bl_rna.properties:
            is_value = one.type in ("BOOLEAN", "INT", "FLOAT", "STRING", "ENUM") or (one.type, one.identifier) == ("POINTER", "object")
            if not one.is_readonly and is_value and one.identifier != "name":
                value = getattr(each, one.identifier)
                setattr(own, one.identifier, tuple(value) if getattr(one, "is_array", False) else value)
        if nodes.is_of_level_set(each):
            own.node_group = each.node_group
            nodes.set_inputs(own, {"Volume": nodes.get_input(each, "Volume")})
    for name, value in made.items():
        if isinstance(value, (str, int, float)):
            before[name] = value
    bpy.data.objects.remove(made)


def animate(before: bpy.types.Object, made: bpy.types.Object) -> None:
    """Gives an object the action of a new result, or none; drivers stay."""
    new = made.animation_data.action if made.animation_data else None
    old = before.animation_data.action if before.animation_data else None
    if new is not None:
        animation = before.animation_data_create()
        animation.action = new
        animation.action_slot = made.animation_data.action_slot
    elif old is not None:
        before.animation_data.action = None
    if old is not None and not old.users:
        bpy.data.actions.remove(old)
