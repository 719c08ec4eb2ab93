# SPDX-License-Identifier: MIT OR Apache-2.0
"""Finds settings that change: animated ones, which a preset holds only as they are in the first frame, and those that a window changes
while frames are sampled. By their values, whatever changes them.
"""

import bpy

from ..messages import printable
from . import roles

# Settings of an object that are sampled in every frame, and those that no file is made of.
SAMPLED = {"is_on", "factor", "emitter.rate", "is_marker", "role"}
OF_CLOTH = ("pin_stiffness", "use_liquid", "use_air", "liquid_friction")
OF_SCENE = ("liquid", "smoke", "sheets", "surface", "whitewater", "volume")
OF_CAMERA = ("lens", "sensor_width", "sensor_height", "shift_x", "shift_y")

# Values by the name of their owner and their path.
Settings = dict[tuple[str, str], object]
# Of the scene itself, in addition to `gravity` and its groups.
OF_TIME_AND_UNITS = ("frame_start", "frame_end", "frame_step")
OF_RENDER = ("fps", "fps_base")


class Changes:
    """Compares settings of objects, scene and camera in every frame with those of the first."""

    def __init__(self, scene: bpy.types.Scene, sources: list[bpy.types.Object]) -> None:
        self.scene, self.sources = scene, sources
        self.first: dict[tuple[str, str], object] = {}
        # Names of what changed, in the order in which it was found.
        self.found: dict[tuple[str, str], None] = {}

    def look(self, graph: bpy.types.Depsgraph, is_first: bool) -> None:
        for name, values in self.values(graph):
            for path, value in values.items():
                if is_first:
                    self.first[name, path] = value
                elif self.first.get((name, path), value) != value:
                    self.found[name, path] = None

    def values(self, graph: bpy.types.Depsgraph):
        """Names of owners with their settings."""
        scene = self.scene.evaluated_get(graph)
        values: dict[str, object] = {"gravity": tuple(scene.gravity), "use_gravity": scene.use_gravity}
        for name in OF_SCENE:
            add(values, getattr(scene.meniscus, name), f"{name}.")
        yield self.scene.name, values
        for source in self.sources:
            if source == self.scene.camera:
                data = source.evaluated_get(graph).data
                yield source.name, {name: getattr(data, name) for name in OF_CAMERA if hasattr(data, name)}
            else:
                yield source.name, of_object(source.evaluated_get(graph).meniscus)

    def notes(self) -> list[str]:
        paths: dict[str, list[str]] = {}
        for name, path in self.found:
            paths.setdefault(name, []).append(words(path))
        text = "changes over time; the preset has the value of the first frame"
        return [f"{printable(name)}: {', '.join(some)} {text}" for name, some in paths.items()]


def words(path: str) -> str:
    return path.replace("kind_", "").replace(".", " ").replace("_", " ")


def of_object(role, sampled: bool = False) -> dict[str, object]:
    """The settings of an object that its role uses; `sampled` also those that have a value for each frame."""
    values: dict[str, object] = {}
    if role.role in roles.DEFINITIONS:
        attribute = roles.DEFINITIONS[role.role][1]
        add(values, getattr(role, attribute), f"{attribute}.")
    if role.role == "FORCE":
        values["kind"] = role.kind
        add(values, getattr(role, f"kind_{role.kind}"), f"kind_{role.kind}.")
    if role.role == "CLOTH":
        values |= {name: getattr(role, name) for name in OF_CLOTH}
        add(values, role.drag, "drag.")
        add(values, role.joint, "joint.")
        add(values, role.pin, "pin.")
    return {path: value for path, value in values.items() if sampled or path not in SAMPLED}


def add(values: dict[str, object], data: bpy.types.PropertyGroup, prefix: str) -> None:
    """Adds the properties of a group and of the groups in it."""
    for each in data.bl_rna.properties:
        if each.identifier in ("rna_type", "name"):
            continue
        value = getattr(data, each.identifier)
        if each.type == "POINTER":
            add(values, value, f"{prefix}{each.identifier}.")
        else:
            is_vector = getattr(each, "is_array", False)
            values[f"{prefix}{each.identifier}"] = tuple(value) if is_vector else value


def settings_of(scene: bpy.types.Scene, layer: bpy.types.ViewLayer) -> Settings:
    """What a preset reads of a scene and of its objects with a role, as they are in the current frame."""
    values: dict[str, object] = {name: getattr(scene, name) for name in OF_TIME_AND_UNITS}
    values |= {name: getattr(scene.render, name) for name in OF_RENDER}
    values |= {"unit scale": scene.unit_settings.scale_length, "gravity": (scene.use_gravity, *scene.gravity)}
    values["camera"] = scene.camera.name if scene.camera is not None else ""
    add_own(values, scene.meniscus)
    for name in OF_SCENE:
        add(values, getattr(scene.meniscus, name), f"{name}.")
    found: Settings = {(scene.name, path): value for path, value in values.items()}
    for each in scene.objects:
        role = each.meniscus
        if role.role == "NONE":
            continue
        values = {"place": tuple(map(tuple, each.matrix_basis)), "visibility": each.visible_get(view_layer=layer)}
        add_own(values, role)
        values |= {name: getattr(role, name).name if getattr(role, name) else "" for name in ("joint_to", "region_of")}
        found |= {(each.name, path): value for path, value in (values | of_object(role, sampled=True)).items()}
    return found


def add_own(values: dict[str, object], data: bpy.types.PropertyGroup) -> None:
    """Adds the properties of a group without those that point to others."""
    for each in data.bl_rna.properties:
        if each.type != "POINTER" and each.identifier != "name":
            values[each.identifier] = getattr(data, each.identifier)


def difference(before: Settings, after: Settings) -> str | None:
    """The first setting that differs, with its owner; None if none does."""
    for owner, path in before | after:
        if (owner, path) not in before or (owner, path) not in after:
            return f"{owner}: its role or its name"
        one, other = before[owner, path], after[owner, path]
        # A NaN differs from itself.
        if one != other and repr(one) != repr(other):
            return f"{owner}: its {words(path)}"
    return None
