# SPDX-License-Identifier: MIT OR Apache-2.0
"""Camera, ground and light for a shot in a scene that has none, and Blender's own cube, camera and lamp.

What a user made or changed is never touched: a camera or a lamp in the scene, or a changed world, keeps its place.
"""

from math import cos, radians, sin

import bpy
import numpy as np
from mathutils import Matrix, Vector

from .colliders import SHAPE, ground
from .shot import CameraPlace

# Frames that the camera has to show; more cost time and hardly move it.
LOOKED_AT_FRAMES = 5
# Part of the vertices cut off at either end of each axis: a few thrown drops must not push the camera away.
BOX_CUT = 0.002
# A collider that is larger by this factor than what moves in the shot need not be in the picture.
MAX_COLLIDER_SIZE = 2.5
AZIMUTH, ELEVATION, LENS = radians(-28.0), radians(18.0), 50.0
# By parts of the size of the shot: how far the ground reaches into a liquid that stands on it, as a gap of air would mirror; how
# far solids that carry the liquid may go below it before they stand on the ground; and how far the ground reaches.
GROUND_OVERLAP, MAX_FOUNDATION, GROUND_REACH = 0.001, 0.03, 40.0
# A plane whose normal is within this angle of +Z is the floor.
MAX_FLOOR_SLOPE = radians(10.0)
STAMP = "meniscus_studio"
# Of Blender's startup file.
STARTUP_OBJECTS = {
    "Cube": {"type": "MESH", "location": (0.0, 0.0, 0.0), "rotation_euler": (0.0, 0.0, 0.0)},
    "Light": {
        "type": "LIGHT",
        "location": (4.076245, 1.005454, 5.903862),
        "rotation_euler": (0.650328, 0.055217, 1.866391),
        "data.type": "POINT",
        "data.energy": 1000.0,
        "data.color": (1.0, 1.0, 1.0),
        "data.shadow_soft_size": 0.1,
    },
    "Camera": {
        "type": "CAMERA",
        "location": (7.358891, -6.925791, 4.958309),
        "rotation_euler": (1.109319, 0.0, 0.814928),
        "data.type": "PERSP",
        "data.lens": 50.0,
        "data.dof.use_dof": False,
        "data.sensor_fit": "AUTO",
        "data.sensor_width": 36.0,
        "data.shift_x": 0.0,
        "data.shift_y": 0.0,
        "data.clip_start": 0.1,
        "data.clip_end": 100.0,
    },
}
STARTUP_MATERIAL = "Material"
STARTUP_SHADER = {"Base Color": (0.8, 0.8, 0.8, 1.0), "Metallic": 0.0, "Roughness": 0.5}
DEFAULT_WORLD, DEFAULT_SKY = "World", (0.050876, 0.050876, 0.050876)


class Box:
    """The smallest box around points; it has none until some are added."""

    def __init__(self) -> None:
        self.low, self.high = np.full(3, np.inf), np.full(3, -np.inf)

    def add(self, low: np.ndarray, high: np.ndarray) -> None:
        self.low, self.high = np.minimum(self.low, low), np.maximum(self.high, high)

    def exists(self) -> bool:
        return bool(np.all(np.isfinite(self.low)) and np.all(np.isfinite(self.high)) and self.size() > 0.0)

    def carries(self, other: "Box") -> bool:
        """Whether it is as wide as another one, so that what is in that may stand on it."""
        return bool(self.exists() and np.all(self.low[:2] <= other.low[:2]) and np.all(self.high[:2] >= other.high[:2]))

    def size(self) -> float:
        """Length of the diagonal."""
        return float(np.linalg.norm(self.high - self.low))


def furnish(
    context: bpy.types.Context,
    moved: list[bpy.types.Object],
    solids: list[bpy.types.Object],
    frames: tuple[int, int],
    camera: CameraPlace | None,
) -> list[str]:
    """Adds what the scene lacks of camera, ground and light around `moved` and `solids` in these frames; what was done, as texts."""
    shot, whole, height = boxes(context, moved, [solid for solid in solids if is_bounded(solid)], frames)
    if not whole.exists():
        return ["added no camera and light, since no frame that was looked at has vertices"]
    removed = remove_defaults(context.scene)
    done = [f"removed Blender's own {', '.join(removed)}, which had not been changed"] if removed else []
    added = []
    has_floor = any(is_floor(solid) for solid in solids)
    if not has_floor and not any(block.get(STAMP) == "ground" for block in context.scene.objects):
        add_ground(context, shot if shot.exists() else whole, height)
        added.append("ground")
    if not any(block.type == "LIGHT" for block in context.scene.objects):
        add_lights(context, whole)
        added.append("light")
    if context.scene.camera is None:
        add_camera(context, whole, camera)
        added.append("camera")
    return done + ([f"added {', '.join(added)}"] if added else [])


def is_bounded(solid: bpy.types.Object) -> bool:
    """Whether a collider has bounds that ground and camera follow: it is rendered and no plane."""
    return not solid.hide_render and solid[SHAPE] != "plane"


def is_floor(solid: bpy.types.Object) -> bool:
    """Whether a collider is a floor: a plane that is rendered and at rest, with a normal close to +Z."""
    if solid[SHAPE] != "plane" or solid.hide_render or solid.animation_data or not len(solid.data.polygons):
        return False
    # A new object has its world matrix only after an evaluation; it has no parent.
    normal = solid.matrix_basis.to_3x3() @ solid.data.polygons[0].normal
    return normal.z > cos(MAX_FLOOR_SLOPE)


def boxes(
    context: bpy.types.Context, moved: list[bpy.types.Object], solids: list[bpy.types.Object], frames: tuple[int, int]
) -> tuple[Box, Box, float]:
    """From the first to the last frame: the box of what moves, that with the solids in the picture, the height of the ground."""
    scene, shot = context.scene, Box()
    solid = [Box() for _ in solids]
    before = scene.frame_current
    looked_at = np.linspace(*frames, LOOKED_AT_FRAMES).round().astype(int)
    for frame in sorted(set(looked_at.tolist())):
        scene.frame_set(frame)
        graph = context.evaluated_depsgraph_get()
        for shown in (each for each in moved if not each.hide_render):
            add_points(shot, shown.evaluated_get(graph))
        for shown, box in zip(solids, solid):
            add_corners(box, shown)
    scene.frame_set(before)
    whole = Box()
    if shot.exists():
        whole.add(shot.low, shot.high)
    for box in solid:
        if box.exists() and (not shot.exists() or box.size() <= MAX_COLLIDER_SIZE * shot.size()):
            whole.add(box.low, box.high)
    if not shot.exists():
        return shot, whole, float(min((box.low[2] for box in solid if box.exists()), default=np.inf))
    lowest = min((box.low[2] for box in solid if box.carries(shot)), default=np.inf)
    floor = shot.low[2] + GROUND_OVERLAP * shot.size()
    return shot, whole, float(lowest if lowest < shot.low[2] - MAX_FOUNDATION * shot.size() else floor)


def add_points(box: Box, shown: bpy.types.Object) -> None:
    """Adds the vertices of a mesh but for a few at either end, or the corners of anything else."""
    if shown.type != "MESH":
        add_corners(box, shown)
    elif len(shown.data.vertices):
        points = np.empty(3 * len(shown.data.vertices), np.float32)
        shown.data.vertices.foreach_get("co", points)
        points = points.reshape(-1, 3)
        points = points[np.isfinite(points).all(axis=1)]
        if len(points):
            box.add(*np.quantile(points, (BOX_CUT, 1.0 - BOX_CUT), axis=0))


def add_corners(box: Box, shown: bpy.types.Object) -> None:
    corners = np.array([shown.matrix_world @ Vector(corner) for corner in shown.bound_box])
    if np.ptp(corners, axis=0).max() > 0.0:
        box.add(corners.min(axis=0), corners.max(axis=0))


def add_object(context: bpy.types.Context, name: str, data: bpy.types.ID, stamp: str) -> bpy.types.Object:
    made = bpy.data.objects.new(name, data)
    made[STAMP] = stamp
    context.scene.collection.objects.link(made)
    return made


def add_ground(context: bpy.types.Context, box: Box, height: float) -> None:
    """A wide square."""
    middle, reach = (box.low + box.high) / 2.0, GROUND_REACH * box.size()
    mesh = bpy.data.meshes.new("Ground")
    mesh.from_pydata([(x * reach, y * reach, 0.0) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))], [], [(0, 1, 2, 3)])
    mesh.materials.append(ground())
    made = add_object(context, "Ground", mesh, "ground")
    made.location = (middle[0], middle[1], height)


def add_lights(context: bpy.types.Context, box: Box) -> None:
    """A sun from behind on the left, a large soft light above, and a clear sky unless the scene has a world of its own."""
    middle, size = Vector((box.low + box.high) / 2.0), box.size()
    sun = bpy.data.lights.new("Sun", "SUN")
    sun.energy, sun.angle, sun.color = 3.0, radians(1.5), (1.0, 0.95, 0.87)
    aim(add_object(context, "Sun", sun, "light"), middle + size * Vector((-1.4, 1.3, 1.9)), middle)
    soft = bpy.data.lights.new("Soft Light", "AREA")
    # Power grows with the square of the size, so a cup and a harbour are lit alike.
    soft.shape, soft.size, soft.size_y, soft.energy = "RECTANGLE", 2.2 * size, 0.8 * size, 90.0 * size**2
    aim(add_object(context, "Soft Light", soft, "light"), middle + size * Vector((-0.7, 1.7, 1.5)), middle)
    if is_default_world(context.scene.world):
        context.scene.world = sky()


def sky() -> bpy.types.World:
    """A clear sky without the sun's disc."""
    world = bpy.data.worlds.new("Sky")
    world.use_nodes = True
    nodes, links = world.node_tree.nodes, world.node_tree.links
    background = next(node for node in nodes if node.type == "BACKGROUND")
    texture = nodes.new("ShaderNodeTexSky")
    # Blender 5.0 renamed the Nishita sky.
    texture.sky_type = "SINGLE_SCATTERING" if bpy.app.version >= (5, 0) else "NISHITA"
    texture.sun_disc = False
    texture.sun_elevation, texture.sun_rotation = radians(38.0), radians(140.0)
    background.inputs["Strength"].default_value = 0.08
    links.new(texture.outputs["Color"], background.inputs["Color"])
    return world


def is_default_world(world: bpy.types.World | None) -> bool:
    """Whether there is no world, or that of Blender's startup file."""
    if world is None:
        return True
    nodes = world.node_tree.nodes if world.node_tree else []
    colours = [node.inputs["Color"].default_value[:3] for node in nodes if node.type == "BACKGROUND"]
    plain = len(nodes) == 2 and len(colours) == 1 and np.allclose(colours[0], DEFAULT_SKY, atol=1e-4)
    return world.name == DEFAULT_WORLD and world.animation_data is None and plain


def add_camera(context: bpy.types.Context, box: Box, place: CameraPlace | None) -> None:
    """The camera of the shot, or one that sees the whole box with a margin."""
    camera = bpy.data.cameras.new("Camera")
    camera.lens, camera.clip_start, camera.clip_end = LENS, 0.001 * box.size(), 200.0 * box.size()
    # Focal lengths of shots are for a sensor as wide as the picture, in portrait format too.
    camera.sensor_fit = "HORIZONTAL"
    made = add_object(context, "Camera", camera, "camera")
    context.scene.camera = made
    if place:
        camera.lens = place.focal_length
        camera.clip_end = max(camera.clip_end, 2.0 * float(np.linalg.norm(np.subtract(place.position, place.target))))
        aim(made, Vector(place.position), Vector(place.target))
        return
    middle = Vector((box.low + box.high) / 2.0)
    toward = Vector((sin(AZIMUTH) * cos(ELEVATION), -cos(AZIMUTH) * cos(ELEVATION), sin(ELEVATION)))
    aim(made, middle + 5.0 * box.size() * toward, middle)
    context.view_layer.update()
    margin = 0.06 * box.size()
    low, high = box.low - margin, box.high + margin
    corners = [(x, y, z) for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]
    made.location, _ = made.camera_fit_coords(context.evaluated_depsgraph_get(), np.array(corners).ravel().tolist())


def aim(made: bpy.types.Object, place: Vector, target: Vector) -> None:
    """Places a lamp or camera, with its -Z axis towards the target."""
    made.location = place
    made.rotation_euler = (target - place).to_track_quat("-Z", "Y").to_euler()


def remove_defaults(scene: bpy.types.Scene) -> list[str]:
    """Removes cube, lamp and camera of Blender's startup file, each unless it was changed; their names."""
    found = [scene.objects.get(name) for name in STARTUP_OBJECTS]
    unchanged = [shown for shown in found if shown and is_unchanged(shown)]
    names = [shown.name for shown in unchanged]
    for shown in unchanged:
        bpy.data.objects.remove(shown, do_unlink=True)
    return names


def is_unchanged(shown: bpy.types.Object) -> bool:
    """Whether an object is as in Blender's startup file, and used in one scene alone."""
    values, data = STARTUP_OBJECTS[shown.name], shown.data
    if shown.type != values["type"] or data.name != shown.name or data.users != 1 or data.animation_data:
        return False
    scenes = [scene for scene in bpy.data.scenes if scene.camera == shown or scene in shown.users_scene]
    own = (shown.animation_data, shown.parent, *shown.children, *shown.modifiers, *shown.constraints)
    if len(scenes) != 1 or len(shown.users_collection) != 1 or any(own) or has_properties(shown) or has_properties(data):
        return False
    if shown.rotation_mode != "XYZ" or not np.allclose(shown.scale, 1.0, atol=1e-6):
        return False
    if not all(is_equal(shown.path_resolve(path), value) for path, value in values.items()):
        return False
    return shown.type != "MESH" or (is_startup_mesh(data) and shown.matrix_basis == Matrix.Identity(4))


def is_equal(found: object, expected: object) -> bool:
    """Whether a property has a value, numbers but for rounding."""
    return found == expected if isinstance(expected, (str, bool)) else bool(np.allclose(found, expected, rtol=1e-6, atol=1e-6))


def is_startup_mesh(mesh: bpy.types.Mesh) -> bool:
    """Whether it is the cube of Blender's startup file, with the material of that."""
    corners = sorted(tuple(round(c, 4) for c in vertex.co) for vertex in mesh.vertices)
    cube = sorted((x, y, z) for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0))
    is_cube = corners == cube and len(mesh.polygons) == 6
    return is_cube and len(mesh.materials) == 1 and is_startup_material(mesh.materials[0])


def is_startup_material(material: bpy.types.Material | None) -> bool:
    """Whether it is the only material of Blender's startup cube."""
    if material is None or material.name != STARTUP_MATERIAL or material.animation_data or has_properties(material):
        return False
    tree = material.node_tree
    if tree is None or tree.animation_data or len(tree.nodes) != 2 or len(tree.links) != 1:
        return False
    shaders = [node for node in tree.nodes if node.type == "BSDF_PRINCIPLED"]
    return len(shaders) == 1 and all(
        is_equal(shaders[0].inputs[name].default_value, value) for name, value in STARTUP_SHADER.items()
    )


def has_properties(data: bpy.types.ID) -> bool:
    """Whether it has custom properties. Blender adds empty groups for add-ons such as Cycles when it shows their panels."""
    groups = {key for key in data.keys() if key in data.bl_rna.properties and hasattr(data[key], "keys") and not data[key].keys()}
    return bool(set(data.keys()) - groups)
