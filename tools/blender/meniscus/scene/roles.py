# SPDX-License-Identifier: MIT OR Apache-2.0
"""The role of an object in a shot, its settings, and the settings of the scene, as properties of Blender."""

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

from .. import colliders
from . import schema, settings
from .names import QUALITIES

ROLES = [
    ("NONE", "None", "Takes no part in the simulation", "X", 0),
    ("FLUID", "Fluid", "Liquid fills the object when the shot starts", "MOD_FLUIDSIM", 1),
    ("INFLOW", "Inflow", "Liquid flows out of the object while the shot runs", "FORWARD", 2),
    ("OUTFLOW", "Outflow", "Liquid in the object is removed", "TRACKING_BACKWARDS_SINGLE", 3),
    ("COLLIDER", "Collider", "Keeps liquid, smoke and cloth out, or in; follows the object's animation", "MOD_PHYSICS", 4),
    ("BODY", "Body", "A rigid body that falls, floats and collides", "RIGID_BODY", 5),
    ("CLOTH", "Cloth", "A sheet of cloth or rubber", "MOD_CLOTH", 6),
    ("FORCE", "Force", "Accelerates liquid and cloth", "FORCE_FORCE", 7),
    ("SMOKE", "Smoke Source", "Gives off smoke while the shot runs", "VOLUME_DATA", 8),
    ("RING", "Smoke Ring", "A ring of smoke when the shot starts, which flies along the object's Z axis", "MESH_TORUS", 9),
    ("TUBE", "Vortex Tube", "Air that swirls around the object's Z axis when the shot starts", "MESH_CYLINDER", 10),
    ("TURBULENCE", "Turbulence", "Random swirls of the smoke's air when the shot starts", "FORCE_TURBULENCE", 11),
    ("REGION", "Cloth Region", "Cloth in the object when the shot starts has other material", "MOD_VERTEX_WEIGHT", 12),
    ("CLOUD", "Smoke Cloud", "Smoke fills the object when the shot starts", "OUTLINER_OB_VOLUME", 13),
]
# Each role's definition in the schema and the attribute with its settings.
DEFINITIONS = {
    "FLUID": ("LiquidSource", "source"),
    "INFLOW": ("LiquidEmitter", "emitter"),
    "COLLIDER": ("Collider", "collider"),
    "BODY": ("BodyParams", "body"),
    "CLOTH": ("SheetParams", "cloth"),
    "FORCE": ("ForceParams", "force"),
    "SMOKE": ("Emitter", "smoke"),
    "CLOUD": ("SmokeSource", "cloud"),
    "RING": ("Ring", "ring"),
    "TUBE": ("Tube", "tube"),
    "TURBULENCE": ("Turbulence", "turbulence"),
    "REGION": ("Region", "region"),
}
# Roles that make a scene one with smoke.
OF_SMOKE = {"SMOKE", "CLOUD", "RING", "TUBE", "TURBULENCE"}
# Roles whose objects only mark a volume: pictures show the liquid, not them.
VOLUMES = {"FLUID", "INFLOW", "OUTFLOW", "FORCE", "REGION", *OF_SMOKE}
SHAPE_ITEMS = {
    "MESH": ("MESH", "Mesh", "The object's surface with its modifiers; its faces enclose a volume", "MESH_DATA", 0),
    "BOX": ("BOX", "Box", "The object's bounding box in its own axes", "MESH_CUBE", 1),
    "SPHERE": ("SPHERE", "Sphere", "The ball or ellipsoid that fills the object's bounding box", "MESH_UVSPHERE", 2),
    "DISC": ("DISC", "Disc", "The round plate in the object's X and Y axes; liquid leaves it along its Z axis", "MESH_CIRCLE", 3),
    "PLANE": ("PLANE", "Plane", "Everything below the object's XY plane", "MESH_PLANE", 4),
    "TANK": ("TANK", "Tank", "Everything outside of the object's bounding box", "CUBE", 5),
    "EVERYWHERE": ("EVERYWHERE", "Everywhere", "The whole scene", "WORLD", 6),
}
# The first is the default.
SHAPES = {
    "NONE": ["MESH"],
    "FLUID": ["MESH", "BOX", "SPHERE", "DISC"],
    "INFLOW": ["DISC", "MESH", "BOX", "SPHERE"],
    "OUTFLOW": ["BOX", "MESH", "SPHERE", "PLANE", "TANK"],
    "COLLIDER": ["MESH", "BOX", "SPHERE", "DISC", "PLANE", "TANK"],
    "BODY": ["MESH"],
    "CLOTH": ["MESH"],
    "FORCE": ["EVERYWHERE", "MESH", "BOX", "SPHERE"],
    "SMOKE": ["MESH", "BOX", "SPHERE"],
    "CLOUD": ["MESH", "BOX", "SPHERE"],
    "RING": ["DISC"],
    "TUBE": ["BOX"],
    "TURBULENCE": ["BOX", "SPHERE"],
    "REGION": ["BOX", "MESH", "SPHERE"],
}
# Blender wants the lists of items to live as long as the property.
SHAPES_OF_ROLE = {role: [SHAPE_ITEMS[shape] for shape in shapes] for role, shapes in SHAPES.items()}
# Made of objects, as rings, tubes, joints and regions are.
SMOKE_SKIPPED = frozenset({"turbulence"})


def shape_items(data: "ObjectRole", _context: bpy.types.Context) -> list:
    return SHAPES_OF_ROLE[data.role]


def role_changed(data: "ObjectRole", _context: bpy.types.Context) -> None:
    """Gives the role its first shape; volumes become wires that are not rendered, others are shown again."""
    shown = data.id_data
    has_mesh = shown.type != "EMPTY"
    # Blender warns of a shape that is read and that the new role lacks.
    shape = data.last_shape or "MESH"
    if shape not in SHAPES[data.role] or (shape == "MESH" and not has_mesh):
        shape = next((each for each in SHAPES[data.role] if has_mesh or each != "MESH"), "MESH")
    data.shape = shape
    is_volume = data.role in VOLUMES
    if is_volume != data.is_marker:
        data.is_marker, shown.hide_render = is_volume, is_volume
        if shown.type != "EMPTY":
            shown.display_type = "WIRE" if is_volume else "TEXTURED"
    look_changed(data)


def shape_changed(data: "ObjectRole", _context: bpy.types.Context) -> None:
    data.last_shape = data.shape


def look_changed(data: "ObjectRole") -> None:
    """Gives an object of glass that has no material the material Glass."""
    shown = data.id_data
    has_none = shown.type == "MESH" and not any(slot.material for slot in shown.material_slots)
    if has_none and look(data) == "glass":
        if shown.material_slots:
            shown.material_slots[0].material = colliders.glass()
        else:
            shown.data.materials.append(colliders.glass())


def look(data: "ObjectRole") -> str:
    """How pictures show a collider or a body."""
    group = {"COLLIDER": data.collider, "BODY": data.body}.get(data.role)
    return group.look if group is not None and group.use_look else "matte"


def is_cloth(_data: "ObjectRole", other: bpy.types.Object) -> bool:
    return other.meniscus.role == "CLOTH"


def scene_key(definition: str, name: str) -> str:
    return schema.key(definition, name).text


def make_classes() -> list[type]:
    """The classes of properties, whose tables come from the schema."""
    settings.updates["look"] = lambda group, _context: look_changed(group.id_data.meniscus)
    return [object_class(), scene_class()]


def object_class() -> type:
    """Properties of an object."""
    groups = {attribute: settings.group(definition) for definition, attribute in DEFINITIONS.values()}
    kinds = schema.choices("ForceKind")
    placed = frozenset({"center", "axis"})
    kind_groups = {kind.name: settings.group(kind.name, kind.keys, placed) for kind in kinds}
    kind_items = [(kind.name, kind.name.title(), kind.text, index) for index, kind in enumerate(kinds)]
    # Points, motion and stiffness of pins are those of vertex group, object and `pin_stiffness`.
    pin_group = settings.group("Pin", skip=frozenset({"stiffness", "collider", "place"}))
    joint_group, drag_group = settings.group("Joint"), settings.group("Drag")
    voxels = schema.key("MeshShape", "resolution")

    class ObjectRole(bpy.types.PropertyGroup):
        role: EnumProperty(name="Role", description="What the object does in the simulation", items=ROLES, update=role_changed)
        shape: EnumProperty(name="Shape", description="The shape that the engine uses in place of the object", items=shape_items, update=shape_changed)
        last_shape: StringProperty(options={"HIDDEN"})
        is_marker: BoolProperty()
        # Of identity.py.
        identifier: StringProperty(options={"HIDDEN"})
        is_on: BoolProperty(name="On", description="Whether it acts; keyframes switch it on and off", default=True)
        resolution: IntProperty(
            name="Resolution",
            description=voxels.text,
            min=int(voxels.low),
            max=int(voxels.high),
            default=voxels.default,
        )
        factor: FloatProperty(
            name="Strength", description=scene_key("ForceParams", "strength_keyframes"), min=0.0, max=1.0, default=1.0
        )
        kind: EnumProperty(name="Kind", description=scene_key("ForceParams", "kind"), items=kind_items)
        pins: StringProperty(name="Pins", description="Vertex group whose points are held: those with a weight of at least 0.5")
        pin_stiffness: FloatProperty(name="Pin Stiffness (N/m)", description=scene_key("Pin", "stiffness"), min=0.0, default=0.0)
        pin: PointerProperty(type=pin_group)
        use_liquid: BoolProperty(name="Liquid", description="Liquid and this cloth push each other", default=True)
        use_air: BoolProperty(name="Air", description="The air of the smoke pushes this cloth", default=True)
        liquid_friction: FloatProperty(name="Friction of Liquid", description=scene_key("Coupling", "friction"), min=0.0, default=0.1)
        drag: PointerProperty(type=drag_group)
        joint_to: PointerProperty(
            name="Join To", description="The cloth whose points are joined to this one's; the same object joins points of its own",
            type=bpy.types.Object, poll=is_cloth,
        )
        joint_points: StringProperty(name="Points", description="Vertex group of this cloth: its points and the other's are joined in pairs, one to one, nearest pair first")
        joint_other_points: StringProperty(name="Other Points", description="Vertex group of the other cloth. Of groups of unequal size, the points that are farthest stay free")
        joint: PointerProperty(type=joint_group)
        region_of: PointerProperty(
            name="Cloth", description="The cloth that has the region; empty: all of it", type=bpy.types.Object, poll=is_cloth
        )

    for name, group in groups.items():
        ObjectRole.__annotations__[name] = PointerProperty(type=group)
    for name, group in kind_groups.items():
        ObjectRole.__annotations__[f"kind_{name}"] = PointerProperty(type=group)
    ObjectRole.__name__ = "MENISCUS_PG_object"
    return ObjectRole


def scene_class() -> type:
    """Properties of a scene."""
    liquid_group = settings.group("LiquidParams")
    smoke_group, sheets_group = settings.group("SmokeParams", skip=SMOKE_SKIPPED), settings.group("SheetsCommon")
    surface_group, whitewater_group, volume_group = (settings.group(f"{name}Params") for name in ("Surface", "Whitewater", "Volume"))

    class SceneShot(bpy.types.PropertyGroup):
        folder: StringProperty(
            name="Folder",
            description="Folder of the preset, its meshes and the shot. Relative to the .blend with //",
            default="//meniscus",
            subtype="DIR_PATH",
            options={"PATH_SUPPORTS_BLEND_RELATIVE"},
            update=lambda shot, context: settings.updates["folder"](shot, context),
        )
        title: StringProperty(name="Title", description="The shot's name; empty: that of the scene")
        quality: EnumProperty(
            name="Quality",
            description="Tier of the preset that the buttons run, each in a folder of its own",
            items=[
                (QUALITIES[0], "Draft", "Coarse: seconds to minutes, to block a shot"),
                (QUALITIES[1], "Preview", "Between draft and final, to judge the motion"),
                (QUALITIES[2], "Final", "The spacing as it is set"),
            ],
        )
        draft: FloatProperty(name="Draft", description="Spacing of the draft over that of the final", min=1.0, max=10.0, default=2.0)
        preview: FloatProperty(name="Preview", description="Spacing of the preview over that of the final", min=1.0, max=10.0, default=1.4)
        threads: IntProperty(name="Threads", description="Threads of the engine; 0 uses every core", min=0, max=1024)
        use_whitewater: BoolProperty(name="Whitewater", description="Spray, foam and bubbles of the liquid")
        use_splash_tension: BoolProperty(
            name="Tension of Splashes",
            description="Surface tension of half of density × 9.81 m/s² × spacing², at the spacing of each quality: far above that of water, it holds "
            "films and jets together that are a few particles thick. Off for drops and taps, whose Coefficient is that of the liquid",
        )
        liquid: PointerProperty(type=liquid_group)
        smoke: PointerProperty(type=smoke_group)
        sheets: PointerProperty(type=sheets_group)
        surface: PointerProperty(type=surface_group)
        whitewater: PointerProperty(type=whitewater_group)
        # Of add.py.
        added_smoke_spacing: FloatProperty(options={"HIDDEN"})
        volume: PointerProperty(type=volume_group)

    SceneShot.__name__ = "MENISCUS_PG_scene"
    return SceneShot


classes: list[type] = []


def register() -> None:
    classes[:] = make_classes()
    for each in classes:
        bpy.utils.register_class(each)
    bpy.types.Object.meniscus = PointerProperty(type=classes[0])
    bpy.types.Scene.meniscus = PointerProperty(type=classes[1])


def unregister() -> None:
    del bpy.types.Scene.meniscus, bpy.types.Object.meniscus
    for each in reversed(classes):
        bpy.utils.unregister_class(each)
    settings.unregister()
