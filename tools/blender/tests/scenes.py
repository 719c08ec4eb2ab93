# SPDX-License-Identifier: MIT OR Apache-2.0
"""Tests of scenes that become shots, inside Blender: operators from an empty scene to a picture, jobs, and what presets hold.

run.py starts each stage in a process of its own. MENISCUS in the environment is the engine's program.
"""

import os
import time
from importlib import import_module
from pathlib import Path

import bpy
import numpy as np
from mathutils import Vector

import harness
import ply
from harness import ADDON, check, use_addon

# A picture of the jet of a tap: across and along Z, and the pixels of a metre.
WIDE, HIGH, PIXELS_PER_METRE = 96, 340, 2000.0
JET_FRAME, LAST_FRAME = 3, 12
SHUTTER = 0.5
MAX_SECONDS = 300.0


def scene_module(name: str):
    return import_module(f"{ADDON}.scene.{name}")


def empty(folder: Path) -> bpy.types.Scene:
    """An empty scene, saved in a folder, with the engine on the PATH."""
    use_addon()
    folder.mkdir(parents=True, exist_ok=True)
    program = Path(os.environ["MENISCUS"])
    os.environ["PATH"] = f"{program.parent}{os.pathsep}{os.environ['PATH']}"
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "scene.blend"))
    return bpy.context.scene


def tap(folder: Path, last: int = LAST_FRAME) -> bpy.types.Scene:
    """A tap above a glass on a table, at draft."""
    scene = empty(folder)
    for kind in ("floor", "glass", "tap"):
        bpy.ops.meniscus.add(kind=kind)
    # Voxels of 1.2 mm, which take a tenth of the time of the default.
    bpy.data.objects["Glass"].meniscus.resolution = 64
    scene.frame_end, scene.render.fps = last, 24
    return scene


def wait(scene: bpy.types.Scene, until=lambda job: False) -> tuple:
    """Looks at the scene's job as the timer does; the job, and how long the longest look took."""
    session, longest, start = scene_module("session"), 0.0, time.monotonic()
    job = session.job_of(scene)
    while job.is_running and not until(job) and time.monotonic() - start < MAX_SECONDS:
        before = time.monotonic()
        # A timer of Blender has no window.
        with bpy.context.temp_override(window=None, area=None, region=None):
            session.tick()
        longest = max(longest, time.monotonic() - before)
        time.sleep(0.02)
    return job, longest


def water(scene: bpy.types.Scene) -> bpy.types.Object | None:
    return next((each for each in scene.objects if each.get("meniscus_output") == "mesh:liquid"), None)


def sequence_input(shown: bpy.types.Object, name: str) -> object:
    modifier = shown.modifiers["Meniscus Sequence"]
    socket = next(item for item in modifier.node_group.interface.items_tree if item.name == name and item.in_out == "INPUT")
    if hasattr(modifier, "properties"):
        return getattr(modifier.properties.inputs, socket.identifier).value
    return modifier[socket.identifier]


def stage_tap(folder: Path) -> None:
    """From an empty scene to a picture of a tap that fills a glass, by operators alone."""
    start = time.monotonic()
    scene = tap(folder)
    session = scene_module("session")
    session.ARRIVAL_SECONDS = 0.0
    bpy.ops.meniscus.simulate()
    check(session.job_of(scene).is_running, "Simulate returns while the engine runs")
    seen = []

    def look(job) -> bool:
        shown = water(scene)
        if shown is not None:
            seen.append(sequence_input(shown, "Last"))
        return False

    job, longest = wait(scene, look)
    check(job.code == 0, "the job ends with its result", (job.code, job.error, list(job.messages)))
    print(f"The longest look at the engine took {longest:.2f} s")
    check(bool(seen) and seen == sorted(seen) and seen[0] < LAST_FRAME, "surfaces are shown while frames arrive", seen[:20])
    shown = water(scene)
    check(sequence_input(shown, "Last") == LAST_FRAME, "the last frame is shown at the end")
    check(bpy.data.objects["Tap"].hide_render and not bpy.data.objects["Glass"].hide_render, "the nozzle is not rendered, the glass is")
    text = (folder / "meniscus" / "scene.toml").read_bytes()
    bpy.ops.meniscus.write()
    check((folder / "meniscus" / "scene.toml").read_bytes() == text, "the preset has the same bytes when it is written again")
    for line in (b"# Tap", b"spacing = 0.0015", b"rate = 0.00008", b'look = "glass"', b"liquid.spacing = 0.003"):
        check(line in text, f"the preset has the line {line.decode()}", text.decode())
    look_at_jet(scene)
    file = folder / "meniscus" / "draft" / f"mesh/liquid_{JET_FRAME:04}.ply"
    table, _ = ply.read(file)
    sharp, blurred = (picture(folder / f"{name}.exr", blur) for name, blur in (("sharp", False), ("blurred", True)))
    check_place(sharp, table)
    check_blur(sharp, blurred, table, scene)
    beauty(scene, folder / "tap.png")
    print(f"From an empty scene to the picture: {time.monotonic() - start:.0f} s")
    bpy.ops.wm.save_mainfile()


def look_at_jet(scene: bpy.types.Scene) -> None:
    """An orthographic camera along +Y at the jet; only the water is in its picture."""
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.type, camera.data.ortho_scale = "ORTHO", HIGH / PIXELS_PER_METRE
    camera.location, camera.rotation_euler = (0.0, -1.0, 0.075), (np.pi / 2.0, 0.0, 0.0)
    scene.collection.objects.link(camera)
    scene.camera = camera
    for each in scene.objects:
        each.visible_camera = each == water(scene)
    override = bpy.data.materials.new("Test")
    scene.view_layers[0].material_override = override
    render = scene.render
    render.engine, render.film_transparent, render.motion_blur_shutter = "CYCLES", True, SHUTTER
    render.resolution_x, render.resolution_y, render.resolution_percentage = WIDE, HIGH, 100
    render.image_settings.file_format, render.image_settings.color_mode = "OPEN_EXR", "RGBA"
    scene.cycles.device, scene.cycles.samples, scene.cycles.seed = "CPU", 64, 1
    scene.cycles.use_adaptive_sampling = scene.cycles.use_denoising = False
    # A filter narrower than a pixel.
    scene.cycles.pixel_filter_type = "BOX"
    scene.frame_set(JET_FRAME)


def picture(path: Path, blur: bool) -> np.ndarray:
    """The alpha of the current frame, first row at the top."""
    scene = bpy.context.scene
    scene.render.use_motion_blur, scene.render.filepath = blur, str(path)
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(str(path))
    pixels = np.empty(4 * WIDE * HIGH, np.float32)
    image.pixels.foreach_get(pixels)
    bpy.data.images.remove(image)
    return pixels.reshape(HIGH, WIDE, 4)[::-1, :, 3]


def pixels_of(table: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Row and column of each vertex in the picture."""
    return HIGH / 2.0 - (table["z"] - 0.075) * PIXELS_PER_METRE, WIDE / 2.0 + table["x"] * PIXELS_PER_METRE


def check_place(alpha: np.ndarray, table: dict[str, np.ndarray]) -> None:
    """Water is where the mesh is, and nowhere else."""
    rows, columns = pixels_of(table)
    inside = (rows > 1) & (rows < HIGH - 2) & (columns > 1) & (columns < WIDE - 2)
    check(inside.mean() > 0.98, "the jet is in the picture", inside.mean())
    near = np.zeros_like(alpha, bool)
    covered = 0
    for row, column in zip(rows[inside].astype(int), columns[inside].astype(int)):
        near[max(row - 3, 0) : row + 4, max(column - 3, 0) : column + 4] = True
        covered += alpha[row - 1 : row + 2, column - 1 : column + 2].max() > 0.2
    check(covered > 0.98 * inside.sum(), "there is water at the vertices of its mesh", covered / inside.sum())
    # Between vertices the disc of the jet is filled: rows of the mesh are covered from their first to their last vertex.
    strange = 0
    for row in range(HIGH):
        here = columns[np.abs(rows - row) < 3.0]
        filled = np.flatnonzero(alpha[row] > 0.5)
        low, high = (here.min() - 2.0, here.max() + 2.0) if len(here) else (np.inf, -np.inf)
        strange += int(((filled < low) | (filled > high)).sum())
    total = int((alpha > 0.5).sum())
    check(total > 1000 and strange < 0.01 * total, "there is no water elsewhere", (strange, total))
    height = np.ptp(np.flatnonzero((alpha > 0.5).any(axis=1))) / PIXELS_PER_METRE
    fallen = 0.08e-3 / (np.pi * 0.006**2) * 2.0 / 24.0 + 0.5 * 9.81 * (2.0 / 24.0) ** 2
    # Near the nozzle liquid moves with it: the tip falls freely after two spacings, 6 mm.
    check(fallen - 0.016 < height < fallen + 0.004, "the jet is as long as water falls in this time", (height, fallen))


def ramp(alpha: np.ndarray, column: int) -> float:
    """The rows over which the alpha at the tip of the jet falls from one to zero."""
    profile = alpha[:, column - 2 : column + 3].mean(axis=1)
    tip = np.flatnonzero(profile > 0.02).max()
    top = np.flatnonzero(profile[:tip] > 0.98)
    body = top[top < tip].max()
    rows = np.arange(body - 3, tip + 4)
    part = np.clip(profile[rows[0] : rows[-1] + 1], 0.0, 1.0)
    middle = (part > 0.2) & (part < 0.8)
    if middle.sum() < 3:
        return float(middle.sum())
    slope = np.polyfit(rows[: len(part)][middle], part[middle], 1)[0]
    return float(-1.0 / slope)


def check_blur(sharp: np.ndarray, blurred: np.ndarray, table: dict[str, np.ndarray], scene: bpy.types.Scene) -> None:
    """Motion blur spreads the tip of the jet over velocity × shutter / frame rate."""
    rows, columns = pixels_of(table)
    tip = rows > rows.max() - 8.0
    speed = -float(table["vz"][tip].mean())
    rate = scene.render.fps / scene.render.fps_base
    expected = speed * SHUTTER / rate * PIXELS_PER_METRE
    column = int(columns[rows.argmax()])
    still, moving = ramp(sharp, column), ramp(blurred, column)
    check(1.2 < speed < 1.9, "the tip falls as fast as water in free fall", speed)
    check(still < 3.0, "without motion blur the tip has an edge", still)
    check(abs(moving - expected) <= 2.0, "motion blur is velocity · shutter / fps wide", f"{moving:.2f} px, expected {expected:.2f}")


def beauty(scene: bpy.types.Scene, path: Path) -> None:
    """A small picture of glass and water, to be looked at."""
    for each in scene.objects:
        each.visible_camera = True
    scene.view_layers[0].material_override = None
    camera = scene.camera
    camera.data.type, camera.data.lens = "PERSP", 55.0
    camera.location = (-0.12, -0.42, 0.17)
    camera.rotation_euler = (Vector((0.0, 0.0, 0.075)) - camera.location).to_track_quat("-Z", "Y").to_euler()
    world = bpy.data.worlds.new("World")
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs[0].default_value = (0.8, 0.85, 0.9, 1.0)
    scene.world = world
    lamp = bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "AREA"))
    lamp.data.energy, lamp.data.size, lamp.location = 6.0, 0.4, (0.4, -0.2, 0.6)
    lamp.rotation_euler = (Vector((0.0, 0.0, 0.05)) - lamp.location).to_track_quat("-Z", "Y").to_euler()
    scene.collection.objects.link(lamp)
    render = scene.render
    render.film_transparent, render.resolution_x, render.resolution_y = False, 160, 240
    render.image_settings.file_format, render.image_settings.color_mode = "PNG", "RGB"
    scene.cycles.samples = int(os.environ.get("MENISCUS_SAMPLES", "8"))
    scene.frame_set(LAST_FRAME)
    render.use_motion_blur, render.filepath = True, str(path)
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(str(path))
    pixels = np.empty(4 * 160 * 240, np.float32)
    image.pixels.foreach_get(pixels)
    bpy.data.images.remove(image)
    check(np.ptp(pixels.reshape(-1, 4)[:, :3]) > 0.3, "the picture of the glass shows something")


if __name__ == "__main__":
    harness.run(globals())
