# SPDX-License-Identifier: MIT OR Apache-2.0
"""Finds animated settings that a preset holds only as they are in the first frame: by their values, whatever animates them."""

import bpy

from ..messages import printable
from . import roles

# Settings of an object that are sampled in every frame, and those that no file is made of.
SAMPLED = {"is_on", "factor", "emitter.rate", "is_marker", "role"}
OF_CLOTH = ("pin_stiffness", "use_liquid", "use_air", "liquid_friction")
OF_SCENE = ("liquid", "smoke", "sheets", "surface", "whitewater", "volume")
OF_CAMERA = ("lens", "sensor_width", "sensor_height", "shift_x", "shift_y")


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
            paths.setdefault(name, []).append(path.replace("kind_", "").replace(".", " ").replace("_", " "))
        text = "changes over time; the preset has the value of the first frame"
        return [f"{printable(name)}: {', '.join(some)} {text}" for name, some in paths.items()]


def of_object(role) -> dict[str, object]:
    """The settings of an object that its role uses."""
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
    return {path: value for path, value in values.items() if path not in SAMPLED}


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
