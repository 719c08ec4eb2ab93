# SPDX-License-Identifier: MIT OR Apache-2.0
"""Add > Meniscus: objects with a role, a mesh of a useful size in metres, and a spacing that fits it."""

from collections.abc import Callable
from dataclasses import dataclass
from math import cos, pi, sin

import bpy
from bpy.props import EnumProperty
from mathutils import Matrix, Vector

from .. import colliders
from . import roles, settings, spacing, startup

Faces = tuple[list[tuple[float, float, float]], list[tuple[int, ...]]]
# Spacings [m] for scenes of metres and of a table.
COARSE, FINE = 0.03, 0.0015
STEPS = 48
GLASS = {"radius": 0.036, "wall": 0.004, "floor": 0.006, "height": 0.1}
TAP_HEIGHT, TAP_RADIUS, PIPE_LENGTH = 0.14, 0.006, 0.05


def box(low: tuple[float, float, float], high: tuple[float, float, float]) -> Faces:
    corners = [(x, y, z) for z in (low[2], high[2]) for y in (low[1], high[1]) for x in (low[0], high[0])]
    return corners, [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]


def ring(radius: float, height: float) -> list[tuple[float, float, float]]:
    return [(radius * cos(2.0 * pi * i / STEPS), radius * sin(2.0 * pi * i / STEPS), height) for i in range(STEPS)]


def disc(radius: float) -> Faces:
    return ring(radius, 0.0), [tuple(range(STEPS))]


def turned(profile: list[tuple[float, float]]) -> Faces:
    """A closed surface of revolution: its profile of radius and height runs from the axis to the axis, outside on its right."""
    vertices: list[tuple[float, float, float]] = [(0.0, 0.0, profile[0][1])]
    for radius, height in profile[1:-1]:
        vertices += ring(radius, height)
    vertices.append((0.0, 0.0, profile[-1][1]))
    last, count = len(vertices) - 1, len(profile) - 2
    after = [(i + 1) % STEPS for i in range(STEPS)]
    faces = [(0, 1 + after[i], 1 + i) for i in range(STEPS)]
    for row in range(count - 1):
        start = 1 + row * STEPS
        faces += [(start + i, start + after[i], start + STEPS + after[i], start + STEPS + i) for i in range(STEPS)]
    start = 1 + (count - 1) * STEPS
    return vertices, faces + [(start + i, start + after[i], last) for i in range(STEPS)]


def glass() -> Faces:
    radius, wall, floor, height = (GLASS[name] for name in ("radius", "wall", "floor", "height"))
    middle = height + wall / 4.0
    inner = radius - wall
    return turned([(0, 0), (radius, 0), (radius, height), (radius - wall / 2.0, middle), (inner, height), (inner, floor), (0, floor)])


def sphere(radius: float) -> Faces:
    rows = STEPS // 2
    profile = [(radius * sin(pi * i / rows), -radius * cos(pi * i / rows)) for i in range(rows + 1)]
    return turned([(0, -radius), *profile[1:-1], (0, radius)])


def pipe() -> Faces:
    """What the water of a tap comes out of, along Z up to just before the mouth."""
    radius, gap = TAP_RADIUS * 1.25, TAP_RADIUS * 0.2
    return turned([(0, -PIPE_LENGTH), (radius, -PIPE_LENGTH), (radius, -gap), (0, -gap)])


def grid(size: float, cells: int) -> Faces:
    step, half = size / cells, size / 2.0
    vertices = [(x * step - half, y * step - half, 0.0) for y in range(cells + 1) for x in range(cells + 1)]
    row = cells + 1
    return vertices, [(y * row + x, y * row + x + 1, (y + 1) * row + x + 1, (y + 1) * row + x) for y in range(cells) for x in range(cells)]


@dataclass(frozen=True)
class Kind:
    """An entry of the menu."""

    label: str
    text: str
    icon: str
    role: str
    shape: str
    mesh: Callable[[], Faces] | None
    # Given to a scene that has none yet.
    spacing: float = COARSE
    place: tuple[float, float, float] = (0.0, 0.0, 0.0)
    # Axis and angle of a turn.
    turn: tuple[str, float] = ("Z", 0.0)
    sets_spacing: bool = True
    # Of smoke: rings and tubes have cores of twice as much or more at draft.
    smoke_spacing: float = 0.05


DOWN = ("X", pi)
KINDS = {
    "tank": Kind("Tank", "A container for liquid: its inside", "CUBE", "COLLIDER", "TANK", lambda: box((-1, -0.5, 0), (1, 0.5, 1))),
    "pool": Kind("Pool", "Liquid at rest when the shot starts", "MOD_OCEAN", "FLUID", "BOX", lambda: box((-1, -0.5, 0), (1, 0.5, 0.3))),
    "drop": Kind("Drop", "A ball of liquid that falls", "MATFLUID", "FLUID", "SPHERE", lambda: sphere(0.2), place=(0, 0, 0.7)),
    "inflow": Kind(
        "Inflow", "A nozzle from which liquid flows", "FORWARD", "INFLOW", "DISC",
        lambda: disc(0.08), place=(0, 0, 0.5), turn=("Y", pi / 2),
    ),
    "tap": Kind(
        "Tap", "Water that runs down out of a pipe", "TRIA_DOWN_BAR", "INFLOW", "DISC",
        lambda: disc(TAP_RADIUS), FINE, (0, 0, TAP_HEIGHT), DOWN,
    ),
    "outflow": Kind(
        "Outflow", "A volume that removes liquid", "TRACKING_BACKWARDS_SINGLE", "OUTFLOW", "BOX",
        lambda: box((-0.2, -0.2, 0), (0.2, 0.2, 0.1)),
    ),
    "collider": Kind("Collider", "A solid that may be animated", "MOD_PHYSICS", "COLLIDER", "MESH", lambda: sphere(0.2), place=(0, 0, 0.2)),
    "floor": Kind("Floor", "A floor without an edge", "MESH_PLANE", "COLLIDER", "PLANE", lambda: grid(4.0, 1), sets_spacing=False),
    "glass": Kind("Glass", "A drinking glass, 10 cm high", "MESH_CYLINDER", "COLLIDER", "MESH", glass, FINE),
    "body": Kind(
        "Body", "A crate that falls and floats", "RIGID_BODY", "BODY", "MESH",
        lambda: box((-0.15,) * 3, (0.15,) * 3), place=(0, 0, 0.6),
    ),
    "force": Kind("Force", "Accelerates liquid and cloth", "FORCE_FORCE", "FORCE", "EVERYWHERE", None, sets_spacing=False),
    "smoke": Kind("Smoke", "A source of smoke", "VOLUME_DATA", "SMOKE", "SPHERE", lambda: sphere(0.15), place=(0, 0, 0.15)),
    "cloud": Kind("Smoke Cloud", "Smoke that is there when the shot starts", "OUTLINER_OB_VOLUME", "CLOUD", "SPHERE", lambda: sphere(0.25), place=(0, 0, 0.4)),
    "ring": Kind("Smoke Ring", "A ring of smoke that flies up", "MESH_TORUS", "RING", "DISC", lambda: disc(0.4), place=(0, 0, 0.3), smoke_spacing=0.03),
    "tube": Kind(
        "Vortex Tube", "Air that swirls around an axis", "MESH_CYLINDER", "TUBE", "BOX",
        lambda: turned([(0, 0), (0.1, 0), (0.1, 1), (0, 1)]), smoke_spacing=0.03,
    ),
    "turbulence": Kind(
        "Turbulence", "Random swirls in the air of smoke", "FORCE_TURBULENCE", "TURBULENCE", "BOX",
        lambda: box((-0.5, -0.5, 0), (0.5, 0.5, 1)),
    ),
    "cloth": Kind("Cloth", "A square of cloth", "MOD_CLOTH", "CLOTH", "MESH", lambda: grid(1.0, 40), place=(0, 0, 0.8)),
}


def new_mesh(name: str, faces: Faces, scale: float, is_smooth: bool) -> bpy.types.Mesh:
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata([tuple(part / scale for part in vertex) for vertex in faces[0]], [], faces[1])
    if is_smooth:
        mesh.polygons.foreach_set("use_smooth", [True] * len(mesh.polygons))
        mesh.set_sharp_from_angle(angle=colliders.EDGE_ANGLE)
    return mesh


def add(context: bpy.types.Context, name: str) -> bpy.types.Object:
    """A new object of a kind at the 3D cursor, active and selected."""
    kind, scale = KINDS[name], context.scene.unit_settings.scale_length
    data = new_mesh(kind.label, kind.mesh(), scale, kind.shape in ("MESH", "SPHERE")) if kind.mesh else None
    made = bpy.data.objects.new(kind.label, data)
    if data is None:
        made.empty_display_type, made.empty_display_size = "SINGLE_ARROW", 0.5 / scale
    context.collection.objects.link(made)
    place = context.scene.cursor.location + Vector(kind.place) / scale
    made.matrix_world = Matrix.Translation(place) @ Matrix.Rotation(kind.turn[1], 4, kind.turn[0])
    role = made.meniscus
    role.role, role.shape = kind.role, kind.shape
    shot = context.scene.meniscus
    if kind.sets_spacing and not shot.liquid.is_property_set("spacing"):
        shot.liquid.spacing = kind.spacing / scale
        if kind.spacing == FINE:
            shot.liquid.max_substeps, shot.liquid.use_surface_tension = 200, True
            shot.liquid.surface_tension.contact_angle = 40.0 * pi / 180.0
        else:
            splash(shot)
    if kind.role in roles.OF_SMOKE:
        refine_smoke(shot, kind.smoke_spacing / scale)
    finish(context, made, name, scale)
    for each in context.selected_objects:
        each.select_set(False)
    made.select_set(True)
    context.view_layer.objects.active = made
    return made


def splash(shot: bpy.types.PropertyGroup) -> None:
    """Gives liquid the terms of the engine's own presets of splashes."""
    shot.use_splash_tension = shot.liquid.use_surface_tension = shot.liquid.use_vorticity = True
    shot.liquid.use_implicitness, shot.liquid.implicitness = True, 0.25


def refine_smoke(shot: bpy.types.PropertyGroup, spacing: float) -> None:
    """Sets the spacing of smoke where the scene has none, or lowers one that this menu set: no one chose that."""
    is_set = shot.smoke.is_property_set("spacing")
    if not is_set or (shot.smoke.spacing == shot.added_smoke_spacing and spacing < shot.smoke.spacing):
        shot.smoke.spacing = spacing
        shot.added_smoke_spacing = shot.smoke.spacing


def finish(context: bpy.types.Context, made: bpy.types.Object, name: str, scale: float) -> None:
    """What a kind has in addition to its mesh and role."""
    role = made.meniscus
    if name == "tank":
        made.display_type, made.hide_render = "WIRE", True
    elif name == "inflow":
        # Litres a second: 1 m/s through its disc.
        role.emitter.rate = 20.0
    elif name in ("smoke", "cloud"):
        # Without heat and velocity it would stay where it is.
        if name == "smoke":
            role.smoke.temperature, role.smoke.use_velocity, role.smoke.velocity = 180.0, True, (0.0, 0.0, 0.4 / scale)
        else:
            role.cloud.temperature = 180.0
        if not context.scene.meniscus.smoke.is_property_set("use_buoyancy"):
            context.scene.meniscus.smoke.use_buoyancy = True
    elif name == "tap":
        role.emitter.rate = 0.08
        shown = bpy.data.objects.new("Pipe", new_mesh("Pipe", pipe(), scale, True))
        context.collection.objects.link(shown)
        shown.parent = made
    elif name == "glass":
        role.collider.use_look, role.collider.look = True, "glass"
        role.collider.use_friction, role.collider.friction = True, 0.1
        made.data.materials.append(colliders.glass())
    elif name == "floor":
        role.collider.use_friction, role.collider.friction = True, 0.3
    elif name == "cloth":
        made.data.polygons.foreach_set("use_smooth", [True] * len(made.data.polygons))


def note_on(context: bpy.types.Context, made: bpy.types.Object) -> str | None:
    """A note on an object that does not fit the spacing that the scene had before: one spacing fits no tap and a pool."""
    scale = context.scene.unit_settings.scale_length
    distance = settings.number(context.scene.meniscus.liquid, "LiquidParams", "spacing", scale)
    return spacing.note(made.name, made.meniscus.role, made.meniscus.shape, [scale * length for length in made.dimensions], distance)


class MENISCUS_OT_add(bpy.types.Operator):
    """Add an object with a role in a Meniscus shot"""

    bl_idname = "meniscus.add"
    bl_label = "Add Meniscus Object"
    bl_options = {"REGISTER", "UNDO"}

    kind: EnumProperty(name="Kind", items=[(name, kind.label, kind.text, kind.icon, index) for index, (name, kind) in enumerate(KINDS.items())])

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return context.mode == "OBJECT"

    @classmethod
    def description(cls, _context: bpy.types.Context, properties) -> str:
        return KINDS[properties.kind].text

    def execute(self, context: bpy.types.Context) -> set[str]:
        made = add(context, self.kind)
        for note in startup.tidy(context, made):
            self.report({"INFO"}, note)
        note = note_on(context, made)
        if note is not None:
            self.report({"WARNING"}, note)
        return {"FINISHED"}


class MENISCUS_MT_add(bpy.types.Menu):
    bl_idname = "MENISCUS_MT_add"
    bl_label = "Meniscus"

    def draw(self, _context: bpy.types.Context) -> None:
        for name, kind in KINDS.items():
            self.layout.operator(MENISCUS_OT_add.bl_idname, text=kind.label, icon=kind.icon).kind = name


def menu_item(self: bpy.types.Menu, _context: bpy.types.Context) -> None:
    self.layout.menu(MENISCUS_MT_add.bl_idname, icon="MOD_FLUIDSIM")
