# SPDX-License-Identifier: MIT OR Apache-2.0
"""The artist's selection, which importers change, and which is restored after results were replaced."""

import bpy


def chosen(layer: bpy.types.ViewLayer) -> tuple[set[str], str]:
    """Names of the selected objects and of the active one: a result may be replaced by another object of its name."""
    selected = {each.name_full for each in objects_of(layer) if each.select_get(view_layer=layer)}
    return selected, layer.objects.active.name_full if layer.objects.active is not None else ""


def select(layer: bpy.types.ViewLayer, selected: set[str], active: str) -> None:
    """Restores the artist's selection: importers select what they make."""
    for each in objects_of(layer):
        each.select_set(each.name_full in selected, view_layer=layer)
        if each.name_full == active:
            layer.objects.active = each


def objects_of(layer: bpy.types.ViewLayer) -> list[bpy.types.Object]:
    """The objects of a view layer, which has None in the place of a removed one, and lacks new ones, until its active object is read."""
    layer.objects.active  # noqa: B018
    return [each for each in layer.objects if each is not None]
