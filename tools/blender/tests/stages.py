# SPDX-License-Identifier: MIT OR Apache-2.0
"""The parts of the tests that run inside Blender; run.py starts each one in a process of its own.

Meshes are compared with the files through the numpy reader in ply.py.
"""

import json
import struct
import sys
from pathlib import Path

import bpy
import numpy as np
from mathutils import Vector

import harness
import ply
import synthetic
from harness import ADDON, at_frame, change, check, evaluated, expect, imported, refused, use_addon

SIZE = (128, 64)


def vectors(mesh: bpy.types.Mesh, name: str) -> np.ndarray | None:
    """A point vector attribute as N x 3 floats, None where it does not exist."""
    attribute = mesh.attributes.get(name)
    if attribute is None or (attribute.domain, attribute.data_type) != ("POINT", "FLOAT_VECTOR"):
        return None
    values = np.empty(3 * len(attribute.data), np.float32)
    attribute.data.foreach_get("vector", values)
    return values.reshape(-1, 3)


def columns(table: dict[str, np.ndarray], names: str) -> np.ndarray:
    return np.stack([table[name] for name in names.split()], axis=1)


def same_as_file(shown: bpy.types.Object, frame: int, path: Path) -> str:
    """What differs between the mesh at a frame and a file; empty if nothing does."""
    mesh = at_frame(shown, frame)
    table, triangles = ply.read(path)
    wanted = columns(table, "x y z")
    if len(mesh.vertices) != len(wanted):
        return f"{len(mesh.vertices)} vertices, the file has {len(wanted)}"
    if len(wanted) == 0:
        return "" if len(mesh.polygons) == 0 else "faces without vertices"
    found = vectors(mesh, "position")
    if not np.array_equal(found, wanted):
        return "positions differ"
    box = np.array(shown.evaluated_get(bpy.context.evaluated_depsgraph_get()).bound_box, np.float32)
    if not (np.array_equal(box.min(0), wanted.min(0)) and np.array_equal(box.max(0), wanted.max(0))):
        return f"bounding box {box.min(0)} {box.max(0)}, the file has {wanted.min(0)} {wanted.max(0)}"
    velocity = vectors(mesh, "velocity")
    if ("vx" in table) != (velocity is not None):
        return "velocity is missing" if velocity is None else "velocity from nowhere"
    if velocity is not None and not np.array_equal(velocity, columns(table, "vx vy vz")):
        return "velocity differs"
    corners = np.empty(len(mesh.loops), np.int32)
    mesh.loops.foreach_get("vertex_index", corners)
    if not np.array_equal(corners.reshape(-1, 3), triangles):
        return "triangles differ"
    strange = strange_normals(mesh, table, corners) if "nx" in table else 0.0
    if strange > 1e-3:
        return f"{100.0 * strange:.2f} % of the normals differ"
    if mesh.materials[:1] != [mesh.materials.get("Water")] or mesh.materials.get("Water") is None:
        return "the material is not Water"
    return ""


def strange_normals(mesh: bpy.types.Mesh, table: dict[str, np.ndarray], corners: np.ndarray) -> float:
    """The part of the corners whose normal is not the file's.

    Blender keeps normals as 16 bit angles within the fan of faces around a corner, good to about 1e-4; flat
    shaded faces are far off. Faces without area have no such angles, so a few corners may differ.
    """
    normals = np.empty(3 * len(mesh.loops), np.float32)
    mesh.corner_normals.foreach_get("vector", normals)
    off = np.abs(normals.reshape(-1, 3) - columns(table, "nx ny nz")[corners]).max(axis=1)
    return float(np.mean(off > 2e-3))


def frame_camera(low: np.ndarray, high: np.ndarray) -> None:
    """An orthographic camera that looks along +Y at a box with a margin, a sun and a clear film."""
    scene = bpy.context.scene
    middle, extent = (low + high) / 2.0, high - low
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.type = "ORTHO"
    camera.data.ortho_scale = float(1.4 * max(extent[0], extent[2] * SIZE[0] / SIZE[1], 1e-3))
    camera.location = Vector((middle[0], low[1] - 5.0, middle[2]))
    camera.rotation_euler = (np.pi / 2.0, 0.0, 0.0)
    sun = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    world = bpy.data.worlds.new("World")
    scene.collection.objects.link(camera)
    scene.collection.objects.link(sun)
    scene.camera, scene.world = camera, world
    render = scene.render
    render.engine, render.film_transparent = "CYCLES", True
    render.resolution_x, render.resolution_y, render.resolution_percentage = *SIZE, 100
    render.image_settings.file_format, render.image_settings.color_mode = "OPEN_EXR", "RGBA"
    scene.cycles.device, scene.cycles.samples, scene.cycles.seed = "CPU", 16, 1
    scene.cycles.use_adaptive_sampling = scene.cycles.use_denoising = False


def render_alpha(path: Path) -> np.ndarray:
    """Renders the current frame and returns its alpha."""
    bpy.context.scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(str(path))
    pixels = np.empty(4 * SIZE[0] * SIZE[1], np.float32)
    image.pixels.foreach_get(pixels)
    bpy.data.images.remove(image)
    return pixels.reshape(SIZE[1], SIZE[0], 4)[:, :, 3]


def sequence(shot: Path) -> tuple[dict, dict[int, Path]]:
    """shot.json and the first PLY output's files by frame, read without the add-on's code."""
    data = json.loads((shot / "shot.json").read_text(encoding="utf-8"))
    output = next(o for o in data["outputs"] if (o["kind"], o["format"]) == ("mesh", "ply"))
    span = output["frames"]
    numbers = range(span["first"], span["last"] + 1, span["step"])
    return data, {frame: shot / output["pattern"].format(frame) for frame in numbers}


def stage_install(archive: Path) -> None:
    """The zip installs from disk into fresh user folders."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.extensions.package_install_files(
        repo="user_default", filepath=str(archive), enable_on_install=True
    )
    check(ADDON in bpy.context.preferences.addons, "the zip installs and is switched on")
    check(hasattr(bpy.types, "IMPORT_SCENE_OT_meniscus_shot"), "the operator is registered")
    bpy.ops.preferences.addon_disable(module=ADDON)
    check(
        not hasattr(bpy.types, "IMPORT_SCENE_OT_meniscus_shot"), "the operator is unregistered when it is switched off"
    )


def stage_shot(shot: Path) -> None:
    """Imports the shot, compares every frame with its file, renders one, saves next to shot.json."""
    use_addon()
    data, files = sequence(shot)
    bpy.ops.wm.save_as_mainfile(filepath=str(shot / "scene.blend"))
    bpy.ops.import_scene.meniscus_shot(filepath=str(shot / "shot.json"), studio=False)
    scene, shown = bpy.context.scene, bpy.context.object
    rate = scene.render.fps / scene.render.fps_base
    check(abs(rate - data["fps"]) < 1e-5 * rate, "the scene has the shot's frame rate", rate)
    span = data["frames"]
    check(
        (scene.frame_start, scene.frame_end) == (span["first"], span["last"]),
        "the scene has the shot's frames",
    )
    check(scene.render.use_motion_blur, "motion blur is on")
    for frame, path in files.items():
        difference = same_as_file(shown, frame, path)
        check(not difference, f"frame {frame} is its file", difference)
    sizes = {frame: len(ply.read(path)[0]["x"]) for frame, path in files.items()}
    frame = max(frame for frame, size in sizes.items() if size > 0)
    points = columns(ply.read(files[frame])[0], "x y z")
    frame_camera(points.min(0), points.max(0))
    scene.frame_set(frame)
    alpha = render_alpha(shot / "first.exr")
    check(0.02 < (alpha > 0.5).mean() < 0.9, "the rendered frame shows water and background", alpha.mean())
    np.save(shot / "alpha.npy", alpha)
    bpy.ops.wm.save_as_mainfile(filepath=str(shot / "scene.blend"))


def stage_farm(shot: Path) -> None:
    """Opens the saved file in its moved folder, without add-on and with scripts disabled; renders again."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.wm.open_mainfile(filepath=str(shot / "scene.blend"), use_scripts=False)
    check(not hasattr(bpy.types, "IMPORT_SCENE_OT_meniscus_shot"), "the add-on is not there")
    check(not bpy.app.autoexec_fail and not bpy.data.texts, "the file has no scripts")
    alpha, before = render_alpha(shot / "second.exr"), np.load(shot / "alpha.npy")
    check(np.array_equal(alpha, before), "the frame renders the same", np.abs(alpha - before).max())


def stage_edges(work: Path) -> None:
    """Empty frames, frames outside the range and between steps, sub-frames, long numbers, awkward folders."""
    use_addon()
    plain = synthetic.write_shot(work / "plain").parent
    shown = imported(plain)
    files = sequence(plain)[1]
    for frame, path in files.items():
        difference = same_as_file(shown, frame, path)
        check(not difference, f"synthetic frame {frame} is its file", difference)
    check(len(at_frame(shown, 3).vertices) == 0, "an empty frame is empty")
    for scene_frame, frame in ((-7, 1), (0, 1), (6, 5), (400, 5)):
        difference = same_as_file(shown, scene_frame, files[frame])
        check(not difference, f"frame {scene_frame} holds frame {frame}", difference)
    wanted = columns(ply.read(files[2])[0], "x y z")
    for whole, part in ((1, 0.75), (2, 0.25)):
        found = vectors(at_frame(shown, whole, part), "position")
        check(np.array_equal(found, wanted), f"sub-frame {whole + part} shows frame 2")

    stepped = synthetic.write_shot(work / "step", 3, 8, 2, ()).parent
    shown, files = imported(stepped), sequence(stepped)[1]
    for scene_frame, frame in ((3, 3), (4, 3), (5, 5), (6, 5), (7, 7), (8, 7), (9, 7), (1, 3)):
        difference = same_as_file(shown, scene_frame, files[frame])
        check(not difference, f"step 2: frame {scene_frame} shows frame {frame}", difference)

    for name, first in (("long numbers", 9999), ("braces {a} {:04} }{", 1), ("spät 水", 1)):
        folder = synthetic.write_shot(work / name, first, first + 1, empty=()).parent
        for mode in ("ABSOLUTE", "RELATIVE"):
            bpy.ops.wm.save_as_mainfile(filepath=str(work / "edges.blend"))
            shown = imported(folder, path_mode=mode)
            text = files_input(shown.modifiers[0])
            check(text.startswith("//") == (mode == "RELATIVE"), f"{name}: path is {mode.lower()}", text)
            difference = same_as_file(shown, first + 1, sequence(folder)[1][first + 1])
            check(not difference, f"{name}: {mode.lower()} frame {first + 1} is its file", difference)

    still = synthetic.write_shot(work / "still", fps=30000 / 1001)
    change(still, lambda data: data["outputs"][0].pop("attributes"))
    mesh = at_frame(imported(still.parent), 1)
    check(
        len(mesh.vertices) == 642 and "velocity" not in mesh.attributes, "no velocity where the shot has none"
    )
    render = bpy.context.scene.render
    check((render.fps, round(render.fps_base, 6)) == (30, 1.001), "29.97 frames a second are 30 over 1.001")
    check(len(bpy.data.node_groups) == 1, "imports share one node group")
    check(len(bpy.data.materials) == 1, "imports share one material")
    water = bpy.data.materials["Water"].node_tree.nodes["Principled BSDF"]
    check(abs(water.inputs["IOR"].default_value - 1.33) < 1e-6, "Water refracts with 1.33")


def files_input(modifier: bpy.types.NodesModifier) -> str:
    """The sequence's path as the modifier holds it, its first input."""
    if bpy.app.version >= (5, 2):
        return modifier.properties.inputs.Socket_1.value
    return modifier["Socket_1"]


def stage_messages(work: Path) -> None:
    """Errors in a shot are reported with their place and the next step."""
    use_addon()
    refused("no file", work / "nowhere" / "shot.json", "nowhere", "no such file", "meniscus shot")
    refused(
        "no paths without a saved file",
        synthetic.write_shot(work / "a"),
        "Save it first",
        path_mode="RELATIVE",
    )

    def broken(name: str, edit, *parts: str) -> None:
        path = synthetic.write_shot(work / name)
        change(path, edit)
        refused(name, path, str(path), *parts, "`meniscus shot`")

    broken("format", lambda d: d.update(format="other"), "'other'", '"meniscus-shot"')
    broken("fps", lambda d: d.update(fps="24"), '"fps"', "'24'")
    broken("up", lambda d: d.update(up="+Y"), '"up"', "'+Y'", '"+Z"')
    broken("unit", lambda d: d.update(length_unit="cm"), '"length_unit"', "'cm'")
    broken(
        "no mesh",
        lambda d: d["outputs"][0].update(kind="volume"),
        "no mesh",
        "liquid (volume, ply)",
        "[output]",
    )
    broken("outside", lambda d: d["outputs"][0].update(pattern="../x_{:04}.ply"), "inside the shot folder")
    broken("no number", lambda d: d["outputs"][0].update(pattern="x.ply"), "'x.ply'", "{:04}")
    broken("range", lambda d: d["frames"].update(first=9), '"frames"', "first <= last")
    broken("velocity", lambda d: d["outputs"][0]["attributes"].update(velocity=["a"]), "['a']", "vx")

    newer = synthetic.write_shot(work / "newer")
    change(newer, lambda data: data.update(version=2))
    refused("version", newer, str(newer), '"version" is 2', "reads 1", "Install the add-on")
    text = synthetic.write_shot(work / "text")
    text.write_text("{", encoding="utf-8")
    refused("not JSON", text, str(text), "not valid JSON")

    gone = synthetic.write_shot(work / "gone")
    for path in (gone.parent / "mesh").iterdir():
        path.unlink()
    refused("all files missing", gone, "liquid: 5 of 5 files missing", "liquid_0001.ply", "`meniscus shot`")
    gap = synthetic.write_shot(work / "gap")
    (gap.parent / "mesh" / "liquid_0004.ply").unlink()
    change(gap, lambda data: data["outputs"].append({"kind": "light", "name": "sun", "format": "ies"}))
    shown = imported(gap.parent)
    expect("Warning: liquid: 1 of 5 files missing, first ")
    expect("Warning: Synthetic: not opened, of a kind that Blender cannot show: sun (light, ies)")
    check(len(at_frame(shown, 4).vertices) == 0, "a missing frame is empty, not the one before")
    expect("Info: Synthetic: 1 mesh sequence(s), 5 frames, paths absolute")


def stage_blur(work: Path) -> None:
    """Motion blur follows `velocity`: a shutter of s frames smears the shape by s v / fps metres."""
    use_addon()
    shown = imported(synthetic.write_shot(work, empty=()).parent)
    scene, points = bpy.context.scene, columns(ply.read(work / "mesh" / "liquid_0002.ply")[0], "x y z")
    scene.frame_set(2)
    frame_camera(points.min(0), points.max(0))
    scene.cycles.samples = 256
    pixel = scene.camera.data.ortho_scale / SIZE[0]
    scene.render.motion_blur_shutter = 1.0

    def width(blur: bool) -> float:
        scene.render.use_motion_blur = blur
        covered = np.nonzero((render_alpha(work / "blur.exr") > 0.002).any(axis=0))[0]
        return (covered[-1] - covered[0]) * pixel

    grown = width(True) - width(False)
    wanted = synthetic.DRIFT[0] / 24.0
    check(abs(grown - wanted) < 3.0 * pixel, "blur has the length given by the velocity", f"{grown}, not {wanted}")
    sys.modules[f"{ADDON}.nodes"].set_inputs(shown.modifiers[0], {"Velocity": False})
    shown.update_tag()
    # A shorter shutter: half a frame away the next file is read, and shape blurs into shape.
    scene.render.motion_blur_shutter = 0.5
    check(abs(width(True) - width(False)) < 1.5 * pixel, "without the velocity attribute nothing is blurred")
    check_instances(work / "instances", lambda blur: width(blur) / pixel)


def check_instances(folder: Path, columns_of) -> None:
    """Instances at points are blurred if they are made real; `columns_of` has the columns of the picture that they cover."""
    imported(synthetic.write_colliders(folder).parent)
    scene = bpy.context.scene
    shown = scene.objects["liquid_points"]
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=2, radius=1.0)
    ball = bpy.context.object
    for each in scene.objects:
        each.hide_render = each not in (shown, scene.camera)
    scene.frame_set(2)
    # Around the two points.
    frame_camera(np.array([0.2, -0.1, 1.1]), np.array([0.9, 0.2, 1.6]))
    pixel = scene.camera.data.ortho_scale / SIZE[0]
    modifier, nodes = shown.modifiers[0], sys.modules[f"{ADDON}.nodes"]
    # Half of the blur of the point that moves: to the right, the other one is farther.
    for is_real, wanted in ((False, 0.0), (True, 0.5 * 6.0 * scene.render.motion_blur_shutter / 24.0)):
        nodes.set_inputs(modifier, {"Instances": True, "Instance": ball, "Blur Instances": is_real})
        shown.update_tag()
        grown = pixel * (columns_of(True) - columns_of(False))
        check(abs(grown - wanted) < 3.0 * pixel, f"instances {'that are real have the blur of their velocities' if is_real else 'have none'}", (grown, wanted))


def stage_volume(shot: Path) -> None:
    """Opens a sequence of volumes with Blender's own means, looks at every grid, renders fog and motion blur."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    data = json.loads((shot / "shot.json").read_text(encoding="utf-8"))
    output = next(o for o in data["outputs"] if (o["kind"], o["format"]) == ("volume", "vdb"))
    first, last = output["frames"]["first"], output["frames"]["last"]
    volume = bpy.data.volumes.new(output["name"])
    volume.filepath = str(shot / output["pattern"].format(first))
    volume.is_sequence, volume.sequence_mode = True, "CLIP"
    # Blender counts files from one: the offset makes the number of a file that of its frame.
    volume.frame_start, volume.frame_duration, volume.frame_offset = first, last - first + 1, first - 1
    volume.velocity_grid, volume.velocity_unit = "velocity", "SECOND"
    shown = bpy.data.objects.new(output["name"], volume)
    scene = bpy.context.scene
    scene.collection.objects.link(shown)
    types = {"density": "FLOAT", "surface": "FLOAT", "velocity": "VECTOR_FLOAT"}
    for frame in range(first, last + 1):
        scene.frame_set(frame)
        grids = evaluated(shown).grids
        loaded = grids.load() and not grids.error_message
        check(loaded, f"frame {frame} of the volume loads", grids.error_message)
        right = grids.frame_filepath == str(shot / output["pattern"].format(frame))
        check(right, f"frame {frame} of the volume is its file", grids.frame_filepath)
        found = {grid.name: grid.data_type for grid in grids}
        check(found == types, f"frame {frame} has its grids", found)
        check(all(grid.load() for grid in grids), f"every grid of frame {frame} loads")
    box = np.array(shown.evaluated_get(bpy.context.evaluated_depsgraph_get()).bound_box)
    check(float(np.ptp(box, axis=0).min()) > 0.01, "the volume has a size", box)

    # Thick fog hides the background where the liquid is, and nowhere else.
    material = bpy.data.materials.new("Fog")
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    fog, end = tree.nodes.new("ShaderNodeVolumePrincipled"), tree.nodes.new("ShaderNodeOutputMaterial")
    fog.inputs["Density"].default_value = 200.0
    tree.links.new(fog.outputs[0], end.inputs["Volume"])
    volume.materials.append(material)
    frame_camera(box.min(0), box.max(0))
    scene.render.use_motion_blur = False
    alpha = render_alpha(shot / "fog.exr")
    check(0.05 < (alpha > 0.5).mean() < 0.9, "the fog shows liquid and background", (alpha > 0.5).mean())
    edge = np.concatenate([alpha[0], alpha[-1], alpha[:, 0], alpha[:, -1]])
    check(float(edge.max()) < 0.01, "there is no fog around the liquid", edge.max())
    scene.render.use_motion_blur, scene.render.motion_blur_shutter = True, 1.0
    blurred = render_alpha(shot / "blurred.exr")
    check(np.abs(blurred - alpha).max() > 0.05, "the velocities blur the fog", np.abs(blurred - alpha).max())


def stage_smoke(shot: Path) -> None:
    """Imports a shot of a ring that flies upwards: it is there, it moves, and its velocities are a second's."""
    use_addon()
    bpy.ops.import_scene.meniscus_shot(filepath=str(shot / "shot.json"), path_mode="ABSOLUTE", studio=False)
    shown, scene = bpy.context.object, bpy.context.scene
    volume = shown.data
    check(shown.type == "VOLUME" and shown.name == "smoke", "smoke is a volume", f"{shown.type} {shown.name}")
    unit = (volume.velocity_grid, volume.velocity_unit)
    check(unit == ("velocity", "SECOND"), "its velocities are metres a second", unit)
    check([m.name for m in volume.materials] == ["Smoke"], "it has a smoke material", list(volume.materials))
    data = json.loads((shot / "shot.json").read_text(encoding="utf-8"))
    span = data["outputs"][0]["frames"]
    boxes = []
    for frame in (span["first"], span["last"]):
        scene.frame_set(frame)
        name = Path(evaluated(shown).grids.frame_filepath).name
        check(name == f"smoke_{frame:04}.vdb", f"frame {frame} shows its file", name)
        graph = bpy.context.evaluated_depsgraph_get()
        boxes.append(np.array([corner[:] for corner in shown.evaluated_get(graph).bound_box]))
    both = np.concatenate(boxes)
    frame_camera(both.min(0), both.max(0))
    scene.render.use_motion_blur = False
    heights = []
    for frame in (span["first"], span["last"]):
        scene.frame_set(frame)
        alpha = render_alpha(shot / f"smoke{frame}.exr")
        check(0.005 < (alpha > 0.1).mean() < 0.9, f"frame {frame} shows smoke and background", (alpha > 0.1).mean())
        rows = np.arange(SIZE[1]) @ alpha / alpha.sum()
        heights.append(float(rows.sum()))
    check(heights[1] > heights[0] + 3.0, "the ring flies upwards", heights)
    sharp = alpha
    scene.render.use_motion_blur, scene.render.motion_blur_shutter = True, 1.0
    blurred = render_alpha(shot / "blurred.exr")
    check(np.abs(blurred - sharp).max() > 0.02, "its velocities blur it", np.abs(blurred - sharp).max())


def stage_plume(shot: Path) -> None:
    """Imports a shot whose first frame has no smoke yet: the material is scaled by the first frame with smoke."""
    use_addon()
    bpy.ops.import_scene.meniscus_shot(filepath=str(shot / "shot.json"), path_mode="ABSOLUTE", studio=False)
    shown, scene = bpy.context.object, bpy.context.scene
    check(not [o for o in bpy.data.objects if o.type == "VOLUME" and o != shown], "no other object remains")
    sizes = []
    for frame in (1, 2):
        scene.frame_set(frame)
        graph = bpy.context.evaluated_depsgraph_get()
        box = np.array([corner[:] for corner in shown.evaluated_get(graph).bound_box])
        sizes.append(float(np.linalg.norm(np.ptp(box, axis=0))))
    check(sizes[0] == 0.0 < sizes[1], "smoke comes with the second frame", sizes)
    nodes = shown.data.materials[0].node_tree.nodes
    fades = next(node.inputs[1].default_value for node in nodes if node.type == "MATH")
    check(abs(fades * 0.03 * sizes[1] - 1.0) < 1e-3, "its thickness is that of the smoke", (fades, sizes))


def point_cache(path: Path) -> tuple[dict, np.ndarray]:
    """The head of a PC2 file, and its places by sample and point, read without the add-on's code."""
    data = path.read_bytes()
    mark, version, points, start, step, samples = struct.unpack("<12siiffi", data[:32])
    check((mark, version) == (b"POINTCACHE2\0", 1), "the cache is a PC2 of version 1", (mark, version))
    places = np.frombuffer(data[32:], "<f4").reshape(samples, points, 3)
    return {"start": start, "step": step}, places


def stage_sheet(shot: Path) -> None:
    """Imports every sheet of a shot: each point is where the cache has it, to the last bit, and the first sheet renders."""
    use_addon()
    bpy.ops.import_scene.meniscus_shot(filepath=str(shot / "shot.json"), path_mode="ABSOLUTE", studio=False)
    data = json.loads((shot / "shot.json").read_text(encoding="utf-8"))
    outputs = [output for output in data["outputs"] if output["kind"] == "sheet"]
    check(bool(outputs), "the shot has sheets")
    for output in outputs:
        shown, span = bpy.data.objects[output["name"]], output["frames"]
        check([m.name for m in shown.data.materials] == ["Cloth"], f"{shown.name} has a cloth material")
        head, places = point_cache(shot / output["pattern"])
        numbers = range(span["first"], span["last"] + 1, span["step"])
        check(len(numbers) == len(places) and head == {"start": span["first"], "step": span["step"]}, "its head is the shot's", head)
        worst = 0.0
        for frame, wanted in zip(numbers, places):
            found = np.empty(wanted.size, np.float32)
            at_frame(shown, frame).vertices.foreach_get("co", found)
            worst = max(worst, float(np.abs(found.reshape(-1, 3) - wanted).max()))
        check(worst == 0.0, f"{shown.name}: error 0 in all of {len(places)} frames", worst)
        check(np.abs(places[-1] - places[0]).max() > 1e-3, "it moves")
        between = np.empty(places[0].size, np.float32)
        at_frame(shown, span["first"] + span["step"] // 2, 0.5 if span["step"] == 1 else 0.0).vertices.foreach_get("co", between)
        middle = (places[0] + places[1]) / 2.0
        check(np.abs(between.reshape(-1, 3) - middle).max() < 1e-5, "between two samples it is in the middle")
    places = point_cache(shot / outputs[0]["pattern"])[1]
    scene = bpy.context.scene
    low, high = places.min((0, 1)), places.max((0, 1))
    frame_camera(low, high)
    # From above: a sheet that lies flat cannot be seen from its side.
    scene.camera.rotation_euler[0] = np.pi / 4.0
    scene.camera.location = Vector((low + high) / 2.0) + 5.0 * float((high - low).max()) * Vector((0.0, -1.0, 1.0))
    scene.camera.data.ortho_scale *= 1.5
    scene.render.use_motion_blur = False
    images = []
    for frame in (outputs[0]["frames"]["first"], outputs[0]["frames"]["last"]):
        scene.frame_set(frame)
        images.append(render_alpha(shot / f"sheet{frame}.exr"))
        check(0.001 < (images[-1] > 0.1).mean() < 0.95, f"frame {frame} shows sheet and background", (images[-1] > 0.1).mean())
    check(np.abs(images[1] - images[0]).max() > 0.1, "the picture moves")


def stage_sheets(work: Path) -> None:
    """Sheets whose frames have steps, and the errors of a damaged one."""
    path = synthetic.write_sheet(work / "steps", first=7, last=15, step=2)
    stage_sheet(path.parent)
    gone = synthetic.write_sheet(work / "gone")
    (gone.parent / "sheet" / "sail.pc2").unlink()
    refused("no cache", gone, "sail.pc2 is missing", "`meniscus shot`")
    path = synthetic.write_sheet(work / "outside")
    change(path, lambda data: data["outputs"][0].update(pattern="/sail.pc2"))
    refused("a cache elsewhere", path, "'/sail.pc2'", "inside the shot folder")


if __name__ == "__main__":
    harness.run(globals())
