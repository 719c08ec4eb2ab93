# SPDX-License-Identifier: MIT OR Apache-2.0
"""Renders frames of a shot folder with Cycles on the CPU: water on a tiled base in a light studio, smoke before the dark.

    python tools/blender/render.py SHOT_DIR --frame N -o picture.png [--samples 64] [--size 1280x720]
    python tools/blender/render.py SHOT_DIR --frame 1-72x2 -o pictures/####.png       # for loop.py; of several frames, those that are there are kept

The interpreter needs bpy (4.5 to 5.2) and numpy. Water and colliders are what the extension imports; base and lights are
set up around the bounding box of the meshes over the sequence, and so is the camera unless the shot has one: every frame is seen
from the same place. Options turn the view (--azimuth, --elevation), switch motion blur off (--sharp) and keep the scene
(--blend)."""

import argparse
import os
import re
import sys
import traceback
from math import cos, radians, sin
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix, Vector

sys.path.insert(0, str(Path(__file__).resolve().parent))

import meniscus  # noqa: E402
from meniscus.colliders import SHAPE  # noqa: E402
from meniscus.shot import CameraPlace, read_shot  # noqa: E402
from meniscus.studio import is_bounded, is_floor  # noqa: E402

# Frames looked at for the bounding box; more cost time and hardly move it, as thrown drops are left out.
BOX_FRAMES = 13
# Part of the vertices cut off at either end of each axis: a few thrown drops must not push the camera away.
BOX_CUT = 0.002
# The water stands on a collider that is as wide and reaches deeper below it than this part of the water's size.
MAX_FOUNDATION = 0.03
# Degrees around Z from the front (-Y), and above the horizon.
AZIMUTH, ELEVATION = -28.0, 20.0


def water_box(all_shown: list[bpy.types.Object], frames: range) -> tuple[np.ndarray, np.ndarray]:
    """The box that all but a few vertices of each object keep to over the sequence."""
    picked = sorted({frames[round(i * (len(frames) - 1) / (BOX_FRAMES - 1))] for i in range(BOX_FRAMES)})
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for frame in picked:
        bpy.context.scene.frame_set(frame)
        for shown in all_shown:
            mesh = shown.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
            if len(mesh.vertices) == 0:
                continue
            points = np.empty(3 * len(mesh.vertices), np.float32)
            mesh.vertices.foreach_get("co", points)
            ends = np.quantile(points.reshape(-1, 3), (BOX_CUT, 1.0 - BOX_CUT), axis=0)
            low, high = np.minimum(low, ends[0]), np.maximum(high, ends[1])
    if not np.all(np.isfinite(low)):
        names = ", ".join(shown.name for shown in all_shown)
        raise SystemExit(f"{names}: no vertices in frames {picked}, so there is nothing to look at")
    return low, high


def smoke_box(shown: bpy.types.Object, frames: range) -> tuple[np.ndarray, np.ndarray]:
    """The box that the grids keep to over the sequence."""
    picked = sorted({frames[round(i * (len(frames) - 1) / (BOX_FRAMES - 1))] for i in range(BOX_FRAMES)})
    corners = []
    for frame in picked:
        bpy.context.scene.frame_set(frame)
        graph = bpy.context.evaluated_depsgraph_get()
        corners.append(np.array([corner[:] for corner in shown.evaluated_get(graph).bound_box]))
    points = np.concatenate(corners)
    return points.min(0), points.max(0)


def add_night(low: np.ndarray, high: np.ndarray, given: argparse.Namespace) -> None:
    """Darkness, a bright light from behind on the left, a dim one from the right, which shows the rims of smoke. Solids of
    the shot that --ball names are matte bodies."""
    middle, size = Vector((low + high) / 2.0), float(np.linalg.norm(high - low))
    world = bpy.data.worlds.new("Night")
    bpy.context.scene.world = world
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.010, 0.013, 0.018, 1.0)
    key = middle + size * Vector((-1.3, 0.9, 1.1))
    add_light("AREA", "Key", key, middle, energy=150.0 * size**2, shape="SQUARE", size=0.6 * size)
    fill = middle + size * Vector((1.6, -0.9, 0.4))
    add_light("AREA", "Fill", fill, middle, energy=40.0 * size**2, shape="SQUARE", size=size)
    for x, y, z, radius in given.ball:
        bpy.ops.mesh.primitive_uv_sphere_add(segments=96, ring_count=48, radius=radius, location=(x, y, z))
        bpy.ops.object.shade_smooth()
        bpy.context.object.data.materials.append(material("Ball", (0.22, 0.10, 0.06), 0.5))


def material(name: str, colour: tuple[float, float, float], roughness: float) -> bpy.types.Material:
    """A plain Principled material."""
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    shader = made.node_tree.nodes["Principled BSDF"]
    shader.inputs["Base Color"].default_value = (*colour, 1.0)
    shader.inputs["Roughness"].default_value = roughness
    return made


def tiles(size: float) -> bpy.types.Material:
    """Grey square tiles with pale joints, `size` metres wide: they show the refraction."""
    made = material("Tiles", (0.8, 0.8, 0.8), 0.35)
    nodes, links = made.node_tree.nodes, made.node_tree.links
    place = nodes.new("ShaderNodeTexCoord")
    brick = nodes.new("ShaderNodeTexBrick")
    brick.offset, brick.squash = 0.0, 1.0
    settings = {"Scale": 1.0, "Mortar Size": 0.015 * size, "Mortar Smooth": 0.2, "Bias": 0.0}
    settings |= {"Brick Width": size, "Row Height": size}
    settings |= {"Color1": (0.30, 0.36, 0.40, 1.0), "Color2": (0.38, 0.44, 0.48, 1.0)}
    settings |= {"Mortar": (0.75, 0.78, 0.80, 1.0)}
    for name, value in settings.items():
        brick.inputs[name].default_value = value
    links.new(place.outputs["Object"], brick.inputs["Vector"])
    links.new(brick.outputs["Color"], nodes["Principled BSDF"].inputs["Base Color"])
    return made


def add_box(name: str, low: np.ndarray, high: np.ndarray, bevel: float, look: bpy.types.Material) -> None:
    """A box with rounded edges."""
    bpy.ops.mesh.primitive_cube_add(size=2.0)
    made = bpy.context.object
    made.name = name
    made.data.transform(Matrix.LocRotScale(Vector((high + low) / 2.0), None, Vector((high - low) / 2.0)))
    made.data.materials.append(look)
    rounded = made.modifiers.new("Bevel", "BEVEL")
    rounded.width, rounded.segments = bevel, 4


def add_stage(low: np.ndarray, high: np.ndarray, solids: list[bpy.types.Object]) -> None:
    """A tiled base under the water, and a floor that bends up into a backdrop. Where the water stands on a collider, there is no
    base; a plane at rest that faces upwards is the floor too."""
    size = float(np.linalg.norm(high - low))
    if any(is_floor(solid) for solid in solids):
        return
    lowest = np.inf
    for solid in filter(is_bounded, solids):
        corners = np.array([solid.matrix_world @ Vector(corner) for corner in solid.bound_box])
        if np.all(corners.min(0)[:2] <= low[:2]) and np.all(corners.max(0)[:2] >= high[:2]):
            lowest = min(lowest, corners[:, 2].min())
    if lowest < low[2] - MAX_FOUNDATION * size:
        add_backdrop(low, high, lowest)
        return
    margin, thick = 0.035 * size, 0.05 * size
    # The base reaches a little into the water: a gap of air below it would mirror and hide the tiles.
    top = low[2] + 0.001 * size
    tile = max(high[0] - low[0], high[1] - low[1]) / 16.0
    under = np.array([low[0] - margin, low[1] - margin, top - thick])
    over = np.array([high[0] + margin, high[1] + margin, top])
    add_box("Base", under, over, 0.12 * thick, tiles(tile))

    add_backdrop(low, high, under[2] - 0.001 * size)


def add_backdrop(low: np.ndarray, high: np.ndarray, ground: float) -> None:
    """Floor and backdrop as one sheet: straight, a quarter circle, straight up."""
    size = float(np.linalg.norm(high - low))
    middle, wide, radius = (low + high) / 2.0, 14.0 * size, 3.0 * size
    back = middle[1] + 3.2 * size
    bend = [
        (back + radius * sin(a), ground + radius * (1.0 - cos(a))) for a in np.linspace(0.0, np.pi / 2.0, 33)
    ]
    profile = [(middle[1] - 12.0 * size, ground), *bend, (back + radius, ground + 12.0 * size)]
    points = [(middle[0] + side * wide, y, z) for y, z in profile for side in (-1.0, 1.0)]
    sheet = bpy.data.meshes.new("Backdrop")
    sheet.from_pydata(points, [], [(2 * i, 2 * i + 1, 2 * i + 3, 2 * i + 2) for i in range(len(profile) - 1)])
    sheet.shade_smooth()
    sheet.materials.append(material("Backdrop", (0.10, 0.15, 0.19), 0.6))
    bpy.context.collection.objects.link(bpy.data.objects.new("Backdrop", sheet))


def aim(made: bpy.types.Object, target: Vector) -> None:
    """Turns a lamp or camera so that its -Z axis points at the target."""
    made.rotation_euler = (target - made.location).to_track_quat("-Z", "Y").to_euler()


def add_light(kind: str, name: str, place: Vector, target: Vector, **settings: object) -> None:
    lamp = bpy.data.lights.new(name, kind)
    for key, value in settings.items():
        setattr(lamp, key, value)
    made = bpy.data.objects.new(name, lamp)
    made.location = place
    aim(made, target)
    bpy.context.collection.objects.link(made)


def add_lights(low: np.ndarray, high: np.ndarray) -> None:
    """A clear sky, a sun from behind on the left, and two soft boxes for long highlights."""
    middle, size = Vector((low + high) / 2.0), float(np.linalg.norm(high - low))
    world = bpy.data.worlds.new("Sky")
    bpy.context.scene.world = world
    world.use_nodes = True
    nodes, links = world.node_tree.nodes, world.node_tree.links
    sky = nodes.new("ShaderNodeTexSky")
    # Blender 5.0 renamed the Nishita sky.
    sky.sky_type = "SINGLE_SCATTERING" if bpy.app.version >= (5, 0) else "NISHITA"
    sky.sun_disc = False
    sky.sun_elevation, sky.sun_rotation = radians(38.0), radians(140.0)
    nodes["Background"].inputs["Strength"].default_value = 0.07
    links.new(sky.outputs["Color"], nodes["Background"].inputs["Color"])
    sun = middle + size * Vector((-1.4, 1.3, 1.9))
    add_light("SUN", "Sun", sun, middle, energy=3.6, angle=radians(1.5), color=(1.0, 0.95, 0.87))
    # Lamp power grows with the square of the scene, so a cup and a harbour are lit alike.
    key = middle + size * Vector((-0.7, 1.7, 1.3))
    add_light(
        "AREA",
        "Back",
        key,
        middle,
        energy=110.0 * size**2,
        shape="RECTANGLE",
        size=2.2 * size,
        size_y=0.7 * size,
    )
    fill = middle + size * Vector((1.9, -1.4, 1.5))
    add_light("AREA", "Fill", fill, middle, energy=14.0 * size**2, shape="RECTANGLE", size=size, size_y=size)


def add_camera(low: np.ndarray, high: np.ndarray, given: argparse.Namespace, place: CameraPlace | None) -> None:
    """The camera of the shot, unless an option chooses the view; else a 60 mm lens that sees the whole box with a margin."""
    scene = bpy.context.scene
    made = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(made)
    scene.camera = made
    made.data.lens = 60.0
    middle, size = (low + high) / 2.0, float(np.linalg.norm(high - low))
    made.data.clip_start, made.data.clip_end = 0.001 * size, 200.0 * size
    if place and given.azimuth is None and given.elevation is None and not given.close:
        made.data.lens, made.location = place.focal_length, place.position
        aim(made, Vector(place.target))
        return
    turn = radians(AZIMUTH if given.azimuth is None else given.azimuth)
    tilt = radians(ELEVATION if given.elevation is None else given.elevation)
    toward = Vector((sin(turn) * cos(tilt), -cos(turn) * cos(tilt), sin(tilt)))
    made.location = Vector(middle) + 5.0 * size * toward
    aim(made, Vector(middle))
    bpy.context.view_layer.update()
    # The base belongs to the picture: a margin for it on every side and below.
    low, high = low - np.array([0.05, 0.05, 0.06]) * size, high + np.array([0.05, 0.05, 0.02]) * size
    middle, half = (low + high) / 2.0, (high - low) / 2.0 * 1.04
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    corners = (middle + signs * half).ravel().tolist()
    made.location, _ = made.camera_fit_coords(bpy.context.evaluated_depsgraph_get(), corners)


def set_render(given: argparse.Namespace) -> None:
    """Cycles on the CPU, enough bounces for water behind water, and the denoiser where it was built in."""
    scene = bpy.context.scene
    render, cycles = scene.render, scene.cycles
    render.engine, cycles.device = "CYCLES", "CPU"
    width, height = given.size
    render.resolution_x, render.resolution_y, render.resolution_percentage = width, height, 100
    render.image_settings.file_format = "PNG"
    render.use_motion_blur = not given.sharp
    cycles.samples, cycles.use_adaptive_sampling, cycles.adaptive_threshold = given.samples, True, 0.02
    cycles.max_bounces, cycles.transmission_bounces, cycles.glossy_bounces = 16, 16, 8
    cycles.volume_bounces = 2
    cycles.transparent_max_bounces, cycles.diffuse_bounces = 32, 3
    cycles.caustics_reflective = cycles.caustics_refractive = False
    cycles.sample_clamp_indirect = 6.0
    try:
        cycles.denoiser, cycles.use_denoising = "OPENIMAGEDENOISE", True
    except TypeError:
        cycles.use_denoising = False
        print("no denoiser in this Blender; more --samples help", file=sys.stderr)
    scene.view_settings.view_transform, scene.view_settings.look = "AgX", "AgX - Medium High Contrast"


def picture(given: argparse.Namespace) -> None:
    """Builds the scene and renders the frames."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    meniscus.register()
    bpy.ops.import_scene.meniscus_shot(filepath=str(given.shot), path_mode="ABSOLUTE", studio=False)
    all_shown, scene = list(bpy.context.selected_objects), bpy.context.scene
    solids = [solid for solid in scene.objects if SHAPE in solid]
    shown = bpy.context.object
    frames = range(scene.frame_start, scene.frame_end + 1)
    absent = [frame for frame in given.frame if frame not in frames]
    if absent:
        raise SystemExit(f"frame {absent[0]} is not in the shot, which has {frames[0]} to {frames[-1]}")
    if shown.type == "VOLUME":
        low, high = smoke_box(shown, frames)
        add_night(low, high, given)
    else:
        looked_at = range(given.frame[0], given.frame[-1] + 1) if given.close else frames
        low, high = water_box([shown for shown in all_shown if shown.type == "MESH"], looked_at)
        add_stage(low, high, solids)
        add_lights(low, high)
    set_render(given)
    add_camera(low, high, given, read_shot(given.shot).camera)
    scene.frame_set(given.frame[0])
    if given.blend:
        bpy.ops.wm.save_as_mainfile(filepath=str(given.blend.resolve()))
    for frame in given.frame:
        output = picture_of(given.output, frame).resolve()
        if len(given.frame) > 1 and output.exists():
            print(f"{output}: exists, not rendered again")
            continue
        # Under its own name only when it is complete, as the next run takes it for finished.
        scene.frame_set(frame)
        scene.render.filepath = str(output.with_name(f".{output.name}"))
        bpy.ops.render.render(write_still=True)
        os.replace(scene.render.filepath, output)


def picture_of(pattern: Path, frame: int) -> Path:
    """The file of a frame: its number stands in place of #, as wide as there are of them."""
    return pattern.with_name(re.sub("#+", lambda found: f"{frame:0{len(found[0])}}", pattern.name))


def frames_of(text: str) -> list[int]:
    """The frames of `40`, `1-72` or `1-72x2`; after a ValueError argparse prints the text."""
    found = re.fullmatch(r"(\d+)(?:-(\d+)(?:x(\d+))?)?", text)
    if not found:
        raise ValueError(text)
    first, last, step = (int(part) if part else None for part in found.groups())
    chosen = list(range(first, (first if last is None else last) + 1, 1 if step is None else step))
    if not chosen:
        raise ValueError(text)
    return chosen


def frame_size(text: str) -> tuple[int, int]:
    """WIDTHxHEIGHT as two numbers; after a ValueError argparse prints the text."""
    width, height = map(int, text.lower().split("x"))
    if width < 4 or height < 4:
        raise ValueError(text)
    return width, height


def ball_of(text: str) -> tuple[float, ...]:
    """X,Y,Z,R as four numbers; after a ValueError argparse prints the text."""
    x, y, z, radius = map(float, text.split(","))
    return x, y, z, radius


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("shot", type=Path, help="shot folder")
    parser.add_argument("--frame", type=frames_of, required=True, metavar="FRAMES", help="`40`, `1-72`, or every second, `1-72x2`")
    parser.add_argument("-o", "--output", type=Path, required=True, help="PNG to write; # stands for the digits of the frame")
    parser.add_argument("--samples", type=int, default=64)
    parser.add_argument("--size", type=frame_size, default=(1280, 720), help="WIDTHxHEIGHT")
    parser.add_argument("--azimuth", type=float, help=f"degrees around Z from the front (-Y); else the shot's camera, or {AZIMUTH:g}")
    parser.add_argument("--elevation", type=float, help=f"degrees above the horizon; else the shot's camera, or {ELEVATION:g}")
    near = "as near as the frames allow, not the whole shot; for surfaces and sheets"
    parser.add_argument("--close", action="store_true", help=near)
    parser.add_argument("--sharp", action="store_true", help="no motion blur")
    ball = {"type": ball_of, "action": "append", "default": [], "metavar": "X,Y,Z,R"}
    parser.add_argument("--ball", **ball, help="a ball in the smoke; may be repeated")
    parser.add_argument("--blend", type=Path, help="also save the scene")
    chosen = parser.parse_args()
    if len(chosen.frame) > 1 and "#" not in chosen.output.name:
        parser.error(f"--output: found {chosen.output.name} for {len(chosen.frame)} frames, expected a # for their number, as in ####.png")
    if chosen.output.suffix.lower() != ".png":
        parser.error(f"--output: found {chosen.output.name}, expected a name that ends in .png")
    return chosen


if __name__ == "__main__":
    chosen = arguments()
    code = 1
    try:
        picture(chosen)
        code = 0
    except (SystemExit, RuntimeError) as error:
        print(error, file=sys.stderr)
    except Exception:
        traceback.print_exc()
    sys.stdout.flush()
    sys.stderr.flush()
    # bpy as a module can crash while the interpreter shuts down, which would hide the result.
    os._exit(code)
