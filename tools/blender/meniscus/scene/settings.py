# SPDX-License-Identifier: MIT OR Apache-2.0
"""Property groups made of the schema: a table of a preset becomes a group, a key a property with Blender's units.

A key without a default has a switch `use_KEY`: off, it is left out of the preset. Lengths are in the scene's units and are
multiplied by its unit scale; angles are radians in Blender and degrees in presets.
"""

from collections.abc import Callable
from math import degrees, radians

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, FloatVectorProperty, IntProperty, PointerProperty, StringProperty

from .schema import Key, keys
from .schema import key as schema_key
from .toml import Table

PREFIX = "MENISCUS_PG_"
MAX_INT = 2**31 - 1
# Blender's units, and whether values scale with the scene's unit of length.
UNITS = {"m": ("LENGTH", True), "m/s": ("VELOCITY", True), "m/s²": ("ACCELERATION", True)}
ANGLES = ("°", "deg")
# Units that Blender lacks are part of the label; a volume flow rate is shown in litres.
LITRES = "m³/s"
# Keys whose place, shape and motion are those of objects, and those that this extension decides itself.
WRITTEN = {"shape", "keyframes", "interpolation", "rate_keyframes", "strength_keyframes", "name", "kind", "systems", "on", "grain"}
# Keys that are the object's own place, rotation and switch.
OWN = {"BodyParams": {"position", "rotation"}, "Emitter": {"start", "end"}}
OWN |= {"Ring": {"center", "direction", "radius"}, "Tube": {"from", "to"}}
# The schema gives a required key no default.
STARTS = {
    "LiquidParams.spacing": 0.03,
    "SmokeParams.spacing": 0.05,
    "SheetParams.density": 0.2,
    "SheetParams.stiffness": (300.0, 300.0),
    "BodyParams.density": 500.0,
    "LiquidEmitter.rate": 0.0001,
    "ImplicitViscosity.dynamic": 1.0,
    "LiquidSource.viscosity": 10.0,
    "LiquidEmitter.viscosity": 10.0,
    "LiquidSource.color": (0.03, 0.22, 0.62),
    "LiquidEmitter.color": (0.80, 0.10, 0.05),
    "Viscosity.nu": 0.0005,
    "Repulsion.energy": 0.5,
    "Repulsion.range": 0.004,
    "Contact.thickness": 0.002,
    "Turbulence.scale": 0.4,
    "Turbulence.strength": 0.3,
    "Ring.thickness": 0.1,
    "Ring.circulation": 1.6,
    "Tube.thickness": 0.1,
    "Tube.circulation": 1.0,
    "Region.rest": 0.8,
    "Joint.stiffness": 100.0,
    "uniform.acceleration": (0.0, 0.0, 1.0),
    "point.strength": 5.0,
    "point.radius": 0.1,
    "vortex.strength": 5.0,
    "vortex.radius": 0.1,
    "turbulence.strength": 2.0,
    "turbulence.scale": 0.2,
    "turbulence.period": 1.0,
    "drag.rate": 1.0,
}
# What a new scene uses of the keys that have a switch, as the built-in presets do.
SWITCHED_ON = {"LiquidParams.xsph", "LiquidEmitter.rate", "SheetParams.bending"}
SWITCHED_ON |= {f"SurfaceParams.{name}" for name in ("anisotropy", "smoothing", "contact")}
SWITCHED_ON_VALUES = {"SheetParams.bending": 1e-5}

made: dict[str, type] = {}
# What is called after a change of a key, by its name.
updates: dict[str, Callable] = {}


def label(key: Key) -> str:
    """The name of a key in Blender's style, with the unit where Blender has none for it."""
    words = key.name.replace("_", " ").title()
    if key.unit == LITRES:
        return f"{words} (L/s)"
    has_blender_unit = key.unit in UNITS or key.unit in ANGLES or key.unit in ("", "1")
    return words if has_blender_unit else f"{words} ({key.unit})"


def group(definition: str, inner: tuple[Key, ...] | None = None, skip: frozenset[str] = frozenset()) -> type:
    """The registered property group of a definition, made once; `inner` are its keys if the schema has no definition for it."""
    if definition in made:
        return made[definition]
    annotations = {}
    for key in inner if inner is not None else keys(definition):
        if key.name in WRITTEN or key.name in skip or key.name in OWN.get(definition, ()) or key.kind == "other":
            continue
        path = f"{definition}.{key.name}"
        if key.is_optional:
            name = f"Use {key.name.replace('_', ' ').title()}"
            annotations[f"use_{key.name}"] = BoolProperty(
                name=name, description=key.text, default=path in SWITCHED_ON, update=updates.get(key.name)
            )
        annotations[key.name] = PointerProperty(type=group(key.definition)) if key.kind == "table" else property_of(key, path)
    new = type(f"{PREFIX}{definition}", (bpy.types.PropertyGroup,), {"__annotations__": annotations})
    bpy.utils.register_class(new)
    made[definition] = new
    return new


def unregister() -> None:
    for each in reversed(list(made.values())):
        bpy.utils.unregister_class(each)
    made.clear()


def property_of(key: Key, path: str):
    """The property of a key that is no table."""
    start = key.default if key.default is not None else STARTS.get(path, SWITCHED_ON_VALUES.get(path))
    common = {"name": label(key), "description": key.text}
    if key.kind == "text":
        return StringProperty(**common, default=start or "")
    if key.kind in ("word", "words"):
        items = [(word, word.replace("_", " ").title(), text, 1 << index) for index, (word, text) in enumerate(key.words)]
        if key.kind == "words":
            return EnumProperty(**common, items=items, options={"ENUM_FLAG"}, default=set(start or ()))
        return EnumProperty(**common, items=items, default=start or key.words[0][0], update=updates.get(key.name))
    if key.kind == "integer":
        low = int(key.low) if key.low is not None else -MAX_INT
        high = min(int(key.high) if key.high is not None else MAX_INT, MAX_INT)
        return IntProperty(**common, min=low, max=high, default=int(start or max(low, 0)))
    limits = {}
    if key.unit in ANGLES:
        common |= {"subtype": "ANGLE", "unit": "ROTATION"} if key.kind == "number" else {"unit": "ROTATION"}
        limits = {name: radians(limit) for name, limit in (("min", key.low), ("max", key.high)) if limit is not None}
    elif key.unit in UNITS:
        common["unit"] = UNITS[key.unit][0]
        # Other limits are metres, whatever the unit of the scene: the engine checks them.
        if key.low == 0.0:
            limits["min"] = 0.0
    elif key.unit == LITRES:
        limits["min"] = 0.0
    else:
        limits = {name: limit for name, limit in (("min", key.low), ("max", key.high)) if limit is not None}
    if key.kind == "vector":
        if key.name == "color":
            common["subtype"] = "COLOR"
        values = shown(key, list(start) if start is not None else [0.0] * key.size)
        return FloatVectorProperty(**common, **limits, size=key.size, precision=4, default=values)
    return FloatProperty(**common, **limits, precision=5, default=shown(key, float(start or 0.0)))


def shown(key: Key, value):
    """A value of the preset as the property has it at a unit scale of 1."""
    if isinstance(value, list):
        return tuple(shown(key, each) for each in value)
    if key.unit in ANGLES:
        return radians(value)
    return 1000.0 * value if key.unit == LITRES else float(value)


def written(key: Key, value, scale: float) -> object:
    """A property's value as the preset has it, in SI units; `scale` is the scene's unit of length in metres."""
    if key.kind == "vector":
        one = Key(key.name, "number", "", None, False, False, key.unit, None, None)
        return [written(one, each, scale) for each in value]
    if key.kind == "words":
        return [word for word, _ in key.words if word in value]
    if key.kind != "number":
        return value
    if key.unit in ANGLES:
        return degrees(value)
    if key.unit == LITRES:
        return value / 1000.0
    return value * scale if key.unit in UNITS else float(value)


def values(data: bpy.types.PropertyGroup, definition: str, scale: float, inner: tuple[Key, ...] | None = None) -> Table:
    """The keys of a group that differ from their defaults, are required, or are switched on."""
    found = Table()
    for key in inner if inner is not None else keys(definition):
        if key.name not in data.bl_rna.properties or key.name in WRITTEN:
            continue
        if key.is_optional and not getattr(data, f"use_{key.name}"):
            continue
        value = getattr(data, key.name)
        if key.kind == "table":
            inner_table = values(value, key.definition, scale)
            if inner_table or key.is_optional:
                found[key.name] = inner_table
            continue
        # What was never changed is the reference's own value: it is in metres, whatever the scene's unit.
        result = written(key, value, scale if data.is_property_set(key.name) else 1.0)
        if key.is_required or key.is_optional or not is_default(key, result):
            found[key.name] = result
    return found


def number(data: bpy.types.PropertyGroup, definition: str, name: str, scale: float) -> float:
    """One number of a group as the preset has it."""
    key = schema_key(definition, name)
    return written(key, getattr(data, name), scale if data.is_property_set(name) else 1.0)


def is_default(key: Key, result: object) -> bool:
    """Whether a value is the key's default, numbers but for the rounding of single precision."""
    if key.kind == "words":
        return set(result) == set(key.default or ())
    if key.kind == "vector":
        return all(is_near(one, other) for one, other in zip(result, key.default))
    return is_near(result, key.default) if key.kind == "number" else result == key.default


def is_near(one: float, other: float) -> bool:
    return abs(one - other) <= 1e-6 * max(1e-9, abs(one), abs(other))


def draw(layout: bpy.types.UILayout, data: bpy.types.PropertyGroup, definition: str, inner: tuple[Key, ...] | None = None) -> None:
    """All keys of a group, tables below a heading of their own."""
    for key in inner if inner is not None else keys(definition):
        if key.name not in data.bl_rna.properties or key.name in WRITTEN:
            continue
        if key.kind == "table":
            draw_table(layout, data, key)
            continue
        if not key.is_optional:
            layout.prop(data, key.name)
            continue
        row = layout.row(heading=label(key), align=True)
        row.prop(data, f"use_{key.name}", text="")
        value = row.row(align=True)
        value.active = getattr(data, f"use_{key.name}")
        value.prop(data, key.name, text="")


def draw_table(layout: bpy.types.UILayout, data: bpy.types.PropertyGroup, key: Key) -> None:
    """A table as a panel that folds, with its switch in the heading."""
    header, body = layout.panel(f"meniscus_{data.bl_rna.identifier}_{key.name}", default_closed=True)
    if key.is_optional:
        header.prop(data, f"use_{key.name}", text=label(key))
    else:
        header.label(text=label(key))
    if body is not None:
        body.active = not key.is_optional or getattr(data, f"use_{key.name}")
        draw(body, getattr(data, key.name), key.definition)
