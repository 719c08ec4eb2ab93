# SPDX-License-Identifier: MIT OR Apache-2.0
"""Tests of what a generated preset holds, inside Blender: shapes, motion, units, settings, names, and objects that are left out.

run.py starts the stage in a process of its own. Every preset is read back with Python's TOML reader, and the engine checks it.
"""

import os
import shutil
import struct
import subprocess
import tomllib
from pathlib import Path

import bpy
import numpy as np
from mathutils import Euler, Matrix, Quaternion, Vector

import harness
import ply
from harness import check
from scenes import empty, scene_module

HOSTILE = ['"]\n[evil]\nx = "', "../../outside", "con", "a/b", "A_B", "ünï çode\u202e", "", "x" * 63, "0001", "liquid", "line\r\nbreak # ]]"]


def write(scene: bpy.types.Scene, name: str = "", accepted: bool = True) -> tuple[dict, list[str]]:
    """Writes the preset; its content, and the notes. The engine has to accept it."""
    written = scene_module("preset").write(bpy.context)
    data = tomllib.loads(written.path.read_text(encoding="utf-8"))
    if accepted:
        command = [os.environ["MENISCUS"], "simulate", written.path.name, "--dry-run", "--quality", "draft", "-o", "draft"]
        run = subprocess.run(command, cwd=written.path.parent, capture_output=True, encoding="utf-8", errors="replace", timeout=120)
        check(run.returncode == 0, f"the engine accepts the preset{': ' + name if name else ''}", run.stderr[-1500:])
    return data, written.notes


def add(kind: str, **changes: object) -> bpy.types.Object:
    """A new object, whose mesh the engine samples coarsely, to save time."""
    bpy.ops.meniscus.add(kind=kind)
    made = bpy.context.object
    made.meniscus.resolution = 16
    for name, value in changes.items():
        setattr(made, name, value)
    return made


def noted(notes: list[str], *parts: str) -> None:
    found = any(all(part in note for part in parts) for note in notes)
    check(found, f"reported: {' … '.join(parts)}", notes)


def refused(name: str, *parts: str) -> None:
    """Writing fails with one message that has these parts."""
    try:
        scene_module("preset").write(bpy.context)
    except Exception as error:
        text = str(error)
        is_plain = type(error).__name__ == "ShotError" and "\n" not in text
        check(is_plain and all(part in text for part in parts), f"refused: {name}", f"{type(error).__name__}: {text}")
    else:
        check(False, f"refused: {name}", "it was written")


def fresh(folder: Path) -> bpy.types.Scene:
    """An empty scene with a pool of a few particles and four frames."""
    scene = empty(folder)
    add("pool")
    scene.meniscus.liquid.spacing = 0.1
    scene.frame_end = 4
    return scene


def points(file: Path) -> np.ndarray:
    table, _ = ply.read(file)
    return np.stack([table[axis] for axis in "xyz"], axis=1)


def world_points(shown: bpy.types.Object, frame: int, scale: float = 1.0) -> np.ndarray:
    """The vertices of an object with its modifiers in a frame [m], by Blender alone."""
    bpy.context.scene.frame_set(frame)
    evaluated = shown.evaluated_get(bpy.context.evaluated_depsgraph_get())
    return np.array([evaluated.matrix_world @ vertex.co for vertex in evaluated.data.vertices]) * scale


def posed(vertices: np.ndarray, keyframes: list[dict], frame: int) -> np.ndarray:
    """Vertices at a frame, by the rules of presets: linear places, slerp, linear sizes."""
    after = next((i for i, key in enumerate(keyframes) if key["frame"] >= frame), len(keyframes) - 1)
    before = max(after - 1, 0) if keyframes[after]["frame"] != frame else after
    one, other = keyframes[before], keyframes[after]
    part = 0.0 if before == after else (frame - one["frame"]) / (other["frame"] - one["frame"])
    place = (1.0 - part) * np.array(one["position"]) + part * np.array(other["position"])
    turns = [Quaternion(key.get("quaternion", (1.0, 0.0, 0.0, 0.0))) for key in (one, other)]
    size = (1.0 - part) * one.get("scale", 1.0) + part * other.get("scale", 1.0)
    # Blender's slerp between near rotations is linear, and not normalized.
    return size * vertices @ np.array(turns[0].slerp(turns[1], part).normalized().to_matrix()).T + place


def check_names(folder: Path) -> None:
    """Names that users type stay names: no file leaves the folder, no text becomes a key."""
    scene = fresh(folder)
    for name in HOSTILE:
        made = add("collider")
        made.name = name or "Empty"
        made.location.x = 5.0
    scene.meniscus.title = 'quote " backslash \\ [table]\n\tend'
    before = {path for path in folder.parent.rglob("*") if not path.is_relative_to(folder)}
    data, _ = write(scene, "hostile names")
    check(data["title"] == scene.meniscus.title, "the title is the text that was typed", data["title"])
    check(set(data) == {"title", "frames", "fps", "world", "liquid", "surface", "output", "quality"}, "no name becomes a table", list(data))
    files = [entry["shape"]["mesh"]["file"] for entry in data["world"]["collider"]]
    is_plain = all(file.startswith("assets/") and "/" not in file[7:] and ".." not in file and file.isascii() for file in files)
    check(len(files) == len(HOSTILE) and is_plain, "files of hostile names are inside the folder", files)
    check(len({file.lower() for file in files}) == len(files), "no two objects have one file", files)
    check(not any(Path(file).stem.lower() in ("con", "liquid") for file in files), "no file is a device or a stream", files)
    after = {path for path in folder.parent.rglob("*") if not path.is_relative_to(folder)}
    check(before == after, "nothing is written outside the folder", after - before)


def check_left_out(folder: Path) -> None:
    """What is not simulated is reported."""
    scene = fresh(folder)
    excluded, disabled, hidden = (bpy.data.collections.new(name) for name in ("Excluded", "Disabled", "Hidden"))
    for each in (excluded, disabled, hidden):
        scene.collection.children.link(each)
        made = add("collider")
        made.name = f"In {each.name}"
        scene.collection.objects.unlink(made)
        each.objects.link(made)
    eye = add("collider")
    eye.name = "Eye"
    eye.modifiers.new("Subdivision", "SUBSURF")
    eye.hide_set(True)
    layer = bpy.context.view_layer.layer_collection.children
    layer["Excluded"].exclude, disabled.hide_viewport, layer["Hidden"].hide_viewport = True, True, True
    instance = bpy.data.objects.new("Instance", None)
    instance.instance_type, instance.instance_collection = "COLLECTION", excluded
    scene.collection.objects.link(instance)
    data, notes = write(scene)
    for name in ("Excluded", "Disabled", "Hidden"):
        noted(notes, f"In {name}", "left out")
    noted(notes, "Instance", "left out")
    files = [entry["shape"]["mesh"]["file"] for entry in data["world"]["collider"]]
    check(files == ["assets/Eye.ply"], "an object that only its eye hides takes part", files)
    check(eye.hide_get(), "it is hidden as before")
    vertices = len(points(folder / "meniscus" / "assets" / "Eye.ply"))
    check(vertices > len(eye.data.vertices), "its modifiers are applied", (vertices, len(eye.data.vertices)))


def check_motion(folder: Path) -> None:
    """Animation arrives as keyframes that give Blender's own places, and none that others imply."""
    scene = fresh(folder)
    scene.frame_end, scene.unit_settings.scale_length = 25, 0.5
    slide, spin, still = add("collider"), add("collider"), add("collider")
    for made, name in ((slide, "Slide"), (spin, "Spin"), (still, "Still")):
        made.name = name
    slide.scale, slide.rotation_euler = (1.0, 2.0, 0.5), (0.3, 0.2, 0.1)
    parent = bpy.data.objects.new("Parent", None)
    scene.collection.objects.link(parent)
    spin.parent, spin.scale, spin.location = parent, (-1.0, 1.0, 1.5), (0.0, 3.0, 0.0)
    still.location = (9.0, 0.0, 0.0)
    for frame, place, angle in ((1, 0.0, 0.0), (9, 0.0, 0.0), (17, 2.0, 1.5), (25, 2.0, 1.5)):
        slide.location = (place, 5.0, 1.0)
        slide.keyframe_insert("location", frame=frame)
        parent.rotation_euler, parent.scale = (0.0, angle, 2.0 * angle), [1.0 + angle / 3.0] * 3
        parent.keyframe_insert("rotation_euler", frame=frame)
        parent.keyframe_insert("scale", frame=frame)
    for curve in slide.animation_data.action.layers[0].strips[0].channelbags[0].fcurves:
        for point in curve.keyframe_points:
            point.interpolation = "LINEAR"
    data, _ = write(scene, "animated colliders")
    entries = {Path(entry["shape"]["mesh"]["file"]).stem: entry for entry in data["world"]["collider"]}
    frames = [key["frame"] for key in entries["Slide"]["keyframes"]]
    check(frames == [1, 9, 17, 25], "keyframes that others imply are left out", frames)
    check("keyframes" not in entries["Still"], "an object at rest has no keyframes")
    for made in (slide, spin, still):
        vertices = points(folder / "meniscus" / entries[made.name]["shape"]["mesh"]["file"])
        keys = entries[made.name].get("keyframes") or [{"frame": 1, "position": [0.0, 0.0, 0.0]}]
        errors = [np.abs(posed(vertices, keys, frame) - world_points(made, frame, 0.5)).max() for frame in range(1, 26)]
        check(max(errors) < 1e-5, f"{made.name} is where Blender has it in every frame [m]", max(errors))
    check("scale" in entries["Spin"]["keyframes"][-1], "a collider that grows has keyframes of its size")
    _, faces = ply.read(folder / "meniscus" / "assets" / "Spin.ply")
    vertices = points(folder / "meniscus" / "assets" / "Spin.ply")
    corners = vertices[faces]
    volume = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6.0
    check(volume > 0.0, "faces of a mirrored object look outwards", volume)


def check_turns(folder: Path) -> None:
    """A turn at constant speed needs a keyframe for each 2.5 rad, and gives Blender's own poses; one that speeds up keeps its frames."""
    scene = fresh(folder)
    scene.frame_end = 241
    even, eased, tumbling = add("collider"), add("collider"), add("collider")
    for made, name, turn in ((even, "Even", (0.3, 0.2, 20.0)), (eased, "Eased", (0.0, 0.0, 2.0)), (tumbling, "Tumbling", (9.0, 7.0, 20.0))):
        made.name, made.location = name, (1.0, 2.0, 3.0)
        for frame, angles in ((1, (0.3, 0.2, 0.0)), (241, turn)):
            made.rotation_euler = angles if name != "Eased" else (0.0, 0.0, angles[2])
            made.keyframe_insert("rotation_euler", frame=frame)
        for curve in made.animation_data.action.layers[0].strips[0].channelbags[0].fcurves:
            for point in curve.keyframe_points:
                point.interpolation = "LINEAR" if name != "Eased" else "BEZIER"
    data, _ = write(scene, "turning colliders")
    keys = {Path(entry["shape"]["mesh"]["file"]).stem: entry["keyframes"] for entry in data["world"]["collider"]}
    counts = {name: len(found) for name, found in keys.items()}
    print(f"Keyframes of 241 frames: {counts}")
    check(9 <= counts["Even"] <= 11, "a turn of 20 rad at constant speed has ten keyframes", counts)
    check(counts["Eased"] > 100 and counts["Tumbling"] > 200, "turns that speed up or change their axis keep their frames", counts)
    worst = dict.fromkeys(counts, 0.0)
    rest = np.array([vertex.co for vertex in even.data.vertices])[::17]
    vertices = {name: points(folder / "meniscus" / "assets" / f"{name}.ply")[::17] for name in counts}
    for frame in range(1, 242):
        scene.frame_set(frame)
        for made in (even, eased, tumbling):
            matrix, found = np.array(made.matrix_world), posed(vertices[made.name], keys[made.name], frame)
            worst[made.name] = max(worst[made.name], np.abs(found - rest @ matrix[:3, :3].T - matrix[:3, 3]).max())
    check(max(worst.values()) < 4e-6, "turns are where Blender has them, to 1e-5 rad at 0.2 m [m]", worst)
    print(f"Largest distance from Blender's vertices: {worst}")


def check_deforming(folder: Path) -> None:
    """A mesh that an armature bends arrives as a point cache with Blender's own places."""
    scene = fresh(folder)
    scene.frame_start, scene.frame_end = 3, 9
    tube = add("collider")
    tube.name = "Arm"
    rig = bpy.data.objects.new("Rig", bpy.data.armatures.new("Rig"))
    scene.collection.objects.link(rig)
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.mode_set(mode="EDIT")
    bone = rig.data.edit_bones.new("Bone")
    bone.head, bone.tail = (0.0, 0.0, 0.0), (0.0, 0.0, 0.2)
    bpy.ops.object.mode_set(mode="OBJECT")
    tube.vertex_groups.new(name="Bone").add([v.index for v in tube.data.vertices if v.co.z > 0.0], 1.0, "REPLACE")
    tube.modifiers.new("Armature", "ARMATURE").object = rig
    pose = rig.pose.bones["Bone"]
    pose.rotation_mode = "XYZ"
    for frame, angle in ((3, 0.0), (9, 0.8)):
        pose.rotation_euler = Euler((angle, 0.0, 0.0))
        pose.keyframe_insert("rotation_euler", frame=frame)
    data, _ = write(scene, "a collider that deforms")
    mesh = data["world"]["collider"][0]["shape"]["mesh"]
    content = (folder / "meniscus" / mesh["point_cache"]).read_bytes()
    _, version, count, first, step, samples = struct.unpack("<12siiffi", content[:32])
    check((version, count, first, step, samples) == (1, len(tube.data.vertices), 3.0, 1.0, 7), "the point cache covers the frames")
    places = np.frombuffer(content[32:], "<f4").reshape(samples, count, 3)
    errors = [np.abs(places[frame - 3] - world_points(tube, frame)).max() for frame in range(3, 10)]
    check(max(errors) < 1e-6, "its places are Blender's own [m]", errors)
    check(np.abs(places[-1] - places[0]).max() > 0.05, "it deforms")


def check_settings(folder: Path) -> None:
    """Units, frame rate, steps, shapes, rates and switches over time, camera."""
    scene = fresh(folder)
    scene.unit_settings.scale_length = 0.01
    scene.meniscus.liquid.spacing = 2.0
    scene.render.fps, scene.render.fps_base = 24, 1.001
    scene.frame_start, scene.frame_end, scene.frame_step = 2, 20, 3
    nozzle = add("inflow")
    nozzle.rotation_euler, nozzle.location = (0.0, 0.0, 0.0), (0.0, 0.0, 50.0)
    for frame, rate, is_on in ((2, 0.1, True), (8, 0.4, True), (14, 0.4, False), (20, 0.4, False)):
        nozzle.meniscus.emitter.rate, nozzle.meniscus.is_on = rate, is_on
        nozzle.keyframe_insert("meniscus.emitter.rate", frame=frame)
        nozzle.keyframe_insert("meniscus.is_on", frame=frame)
    tank = add("tank")
    tank.meniscus.collider.use_contact_angle, scene.meniscus.liquid.use_surface_tension = True, False
    nozzle.meniscus.emitter.use_color, nozzle.meniscus.emitter.color = True, (1.0, 0.5, 0.25)
    nozzle.meniscus.emitter.use_viscosity, scene.meniscus.liquid.use_viscosity = True, False
    camera = bpy.data.objects.new("View", bpy.data.cameras.new("View"))
    scene.collection.objects.link(camera)
    scene.camera = camera
    camera.matrix_world = Matrix.Translation((0.0, -300.0, 20.0)) @ Matrix.Rotation(np.pi / 2.0, 4, "X")
    data, notes = write(scene, "units and settings")
    check(abs(data["fps"] - 24.0 / 1.001) < 1e-4, "the frame rate has Blender's base", data["fps"])
    check(data["frames"] == "2-20x3", "frames have the scene's step", data["frames"])
    check(data["liquid"]["spacing"] == 0.02, "lengths are in metres, whatever the unit of the scene", data["liquid"]["spacing"])
    check(np.allclose(data["world"]["gravity"], (0.0, 0.0, -0.0981)), "gravity is what the scene shows in m/s²", data["world"])
    noted(notes, "gravity", "unit scale")
    check(data["world"]["collider"][0]["shape"]["tank"]["max"] == [1, 0.5, 1], "a tank is its box in metres")
    noted(notes, "Tank", "contact angle", "left out")
    emitter = data["liquid"]["emitter"][0]
    noted(notes, "viscosity is left out", "the scene's liquid has none")
    check(emitter["color"] == [1, 0.5, 0.25], "a nozzle has its own colour", emitter)
    check("viscosity" not in emitter, "a viscosity of a nozzle needs that of the liquid", emitter)
    scene.meniscus.liquid.use_viscosity = True
    thick = write(scene, "viscosity of a nozzle")[0]["liquid"]
    check(thick["emitter"][0]["viscosity"] == 10 and "viscosity" in thick, "a nozzle has its own viscosity", thick["emitter"][0])
    scene.meniscus.liquid.use_viscosity = False
    check(emitter["shape"]["disc"]["normal"] == [0, 0, 1], "a nozzle points along its Z axis", emitter)
    rates = [(key["frame"], round(key["rate"], 9)) for key in emitter["rate_keyframes"]]
    check(rates[0] == (2, 0.0001) and rates[-1] == (20, 0.0004), "rates over time are in m³/s", rates)
    check(emitter["on"] == [{"end": 14}], "keyframes of On become ranges", emitter["on"])
    view = data["camera"]
    check(np.allclose(view["position"], (0.0, -3.0, 0.2)) and abs(view["target"][1]) < 1.0, "the camera is in metres", view)
    check(view["focal_length"] == 50, "the camera has its focal length", view)
    camera.data.type = "ORTHO"
    data, notes = write(scene, "without the camera")
    noted(notes, "View", "left out")
    check("camera" not in data, "an orthographic camera is left out")
    camera.data.type = "PERSP"
    camera.keyframe_insert("location", frame=2)
    camera.location.x = 10.0
    camera.keyframe_insert("location", frame=20)
    _, notes = write(scene, "a camera that moves")
    noted(notes, "View", "moves")
    path = folder / "meniscus" / "scene.toml"
    for before, after in ((camera, None), (None, camera)):
        scene.camera = before
        steps = scene_module("preset").writing(bpy.context)
        next(steps)
        scene.camera = after
        try:
            list(steps)
            has_camera = "camera" in tomllib.loads(path.read_text(encoding="utf-8"))
        except AttributeError as error:
            has_camera = error
        check(has_camera == (before is not None), "the camera is that of the start of sampling", has_camera)


def check_kinds(folder: Path) -> None:
    """Every entry of the menu makes a scene that the engine accepts."""
    kinds = list(scene_module("add").KINDS)
    check(len(kinds) == 17, "the menu has seventeen entries", kinds)
    smokes = {"smoke", "cloud", "ring", "tube", "turbulence"}
    for chosen in ({"body"}, {"cloth", *smokes}):
        scene = fresh(folder / "-".join(sorted(chosen)))
        for kind in (kind for kind in kinds if kind not in ({"body", "cloth", *smokes} - chosen)):
            made = add(kind)
            check(made.meniscus.role != "NONE", f"{made.name} has a role")
        scene.meniscus.liquid.spacing = 0.05
        scene.meniscus.use_whitewater = True
        data, _ = write(scene, f"all kinds with {' and '.join(sorted(chosen))}")
        check("whitewater" in data, "whitewater has its table")
        if "cloth" in chosen:
            check({"emitter", "source", "ring", "tube", "turbulence"} < data["smoke"].keys(), "smoke has all of its tables", list(data["smoke"]))
            for kind in ("cloth", "smoke"):
                second = add(kind)
                second.location.x = 3.0
            scene.meniscus.sheets.use_contact = True
            data, _ = write(scene, "two cloths and two sources of smoke")
            check([sheet["name"] for sheet in data["sheet"]] == ["Cloth", "Cloth_001"], "two cloths have names of their own", data["sheet"])
            check(len(data["smoke"]["emitter"]) == 2 and len(data["coupling"]) == 4, "both cloths are coupled with liquid and smoke")
            pinned = bpy.data.objects["Cloth"]
            pinned.vertex_groups.new(name="Held").add(list(range(41)), 1.0, "REPLACE")
            pinned.meniscus.pins = "Held"
            pinned.meniscus.pin.use_release, pinned.meniscus.pin.release = True, 3
            data, _ = write(scene, "cloth with pins")
            check(data["sheet"][0]["pin"][0]["at"]["points"] == list(range(41)), "the vertex group is pinned")
            check(data["sheet"][0]["pin"][0]["release"] == 3, "pins let go at a frame")
    scene = fresh(folder / "forces")
    for kind in ("uniform", "point", "vortex", "turbulence", "drag"):
        for shape in ("EVERYWHERE", "SPHERE"):
            made = add("force", rotation_euler=(0.0, 1.0, 0.0), location=(0.0, 0.0, 1.0))
            made.meniscus.kind, made.meniscus.shape = kind, shape
            made.meniscus.force.use_falloff, made.meniscus.force.falloff, made.meniscus.factor = True, 0.2, 0.5
    data, _ = write(scene, "every kind of force")
    check(len(data["force"]) == 10 and all(force["strength_keyframes"] == [{"frame": 1, "factor": 0.5}] for force in data["force"]), "forces have their strength")


def check_air(folder: Path) -> None:
    """Rings, tubes and turbulence are where their objects are, with their axes and sizes."""
    scene = empty(folder)
    scene.unit_settings.scale_length = 0.5
    turn = Euler((0.3, 0.5, 0.2))
    ring, tube, gusts = (add(kind, rotation_euler=turn, location=(1.0, 2.0, 3.0)) for kind in ("ring", "tube", "turbulence"))
    gusts.rotation_euler = (0.0, 0.0, 0.0)
    ring.scale, ring.meniscus.ring.circulation = (2.0, 2.0, 2.0), 3.0
    tube.meniscus.tube.density = 0.0
    gusts.meniscus.turbulence.scale = 1.5
    data, _ = write(scene, "rings, tubes and turbulence")
    axis = np.array(turn.to_matrix())[:, 2]
    found = data["smoke"]["ring"][0]
    check(np.allclose(found["direction"], axis, atol=1e-5) and np.allclose(found["center"], (0.5, 1.0, 1.5)), "a ring has its object's place and axis", found)
    check(abs(found["radius"] - 0.8) < 1e-6 and found["circulation"] == 3, "a ring has its object's size", found)
    found = data["smoke"]["tube"][0]
    ends = np.array([found["from"], found["to"]])
    check(np.allclose(ends[0], (0.5, 1.0, 1.5)) and np.allclose(ends[1] - ends[0], axis, atol=1e-5), "a tube has its object's ends", found)
    check(found["density"] == 0, "a tube has its settings", found)
    found = data["smoke"]["turbulence"]
    check(np.allclose(found["shape"]["box"]["max"], (1.0, 1.5, 2.5)) and found["scale"] == 0.75, "turbulence has its object's box, in metres", found)
    check_smoke_spacing(folder / "spacing")
    scene = empty(folder / "two")
    add("turbulence")
    add("turbulence")
    refused("two objects with turbulence", "Turbulence.001", "second turbulence")


def check_smoke_spacing(folder: Path) -> None:
    """The menu lowers its own spacing of smoke for a kind that needs less, and no other one."""
    for order in (("smoke", "ring"), ("ring", "smoke")):
        scene = empty(folder)
        scene.unit_settings.scale_length = 0.5
        for kind in order:
            add(kind)
        spacing = scene.meniscus.smoke.spacing
        check(abs(spacing - 0.06) < 1e-6, f"{' and '.join(order)}: the spacing fits the ring", spacing)
    scene = empty(folder)
    add("smoke")
    scene.meniscus.smoke.spacing = 0.2
    add("ring")
    check(abs(scene.meniscus.smoke.spacing - 0.2) < 1e-6, "a spacing that was typed stays", scene.meniscus.smoke.spacing)


def check_sheets(folder: Path) -> None:
    """Joints hold points of two sheets together, one to one; regions are other material in a volume."""
    scene = empty(folder)
    one, other = add("cloth"), add("cloth", location=(1.0, 0.0, 0.8))
    side = np.arange(41) * 41
    # The points of the other are numbered in another order.
    one.vertex_groups.new(name="Right").add([int(index) for index in side + 40], 1.0, "REPLACE")
    other.vertex_groups.new(name="Left").add([int(index) for index in side], 1.0, "REPLACE")
    other.scale.y = -1.0
    role = one.meniscus
    role.joint_to, role.joint_points, role.joint_other_points = other, "Right", "Left"
    back = other.meniscus
    back.joint_to, back.joint_points, back.joint_other_points = one, "Left", "Right"
    region = add("collider", location=(0.0, 0.0, 0.8))
    region.name, region.meniscus.role = "Hem", "REGION"
    region.meniscus.region.stiffness, region.meniscus.region_of = 10.0, other
    data, notes = write(scene, "joints and regions")
    check(len(data["sheets"]["joint"]) == 1, "a joint that both sheets have is written once", data["sheets"]["joint"])
    noted(notes, "Cloth.001", "joint is left out", "Cloth has the same one")
    back.joint_to = None
    joint = data["sheets"]["joint"][0]
    check(joint["sheets"] == ["Cloth", "Cloth_001"] and "stiffness" not in joint, "a joint names its sheets, and is exact", joint)
    ends = [world_points(made, 1)[part["points"]] for made, part in zip((one, other), joint["at"])]
    check(len(ends[0]) == 41 and np.abs(ends[0] - ends[1]).max() < 1e-6, "each point is joined to the one at its place")
    found = {sheet["name"]: sheet.get("region", []) for sheet in data["sheet"]}
    check(not found["Cloth"] and found["Cloth_001"][0]["stiffness"] == 10 and region.display_type == "WIRE", "a region is of the cloth that it names", found)
    region.meniscus.region_of, region.rotation_euler.z = None, 0.4
    other.location.x = 1.1
    refused("an exact joint of points that are apart", "Cloth", "0.1 m apart", "Stiffness")
    joints = scene_module("joints")
    joints.MAX_DISTANCES, limit = 1000, joints.MAX_DISTANCES
    refused("a joint of groups that are too large", "Cloth", "41 points", "seam")
    joints.MAX_DISTANCES = limit
    role.joint.use_stiffness, role.joint.stiffness, role.joint.use_release, role.joint.release = True, 50.0, True, 3
    other.vertex_groups["Left"].remove([0, 41, 82])
    data, notes = write(scene, "a joint of springs, and a region of all sheets")
    noted(notes, "Cloth", "3 point(s) of its joint stay free")
    check(len(data["sheets"]["joint"][0]["at"][0]["points"]) == 38, "each point is in one pair")
    joint = data["sheets"]["joint"][0]
    check(joint["stiffness"] == 50 and joint["release"] == 3, "a joint has its settings", joint)
    check(all(len(sheet["region"]) == 1 for sheet in data["sheet"]), "a region without a cloth is of all", data["sheet"])
    other.meniscus.role = "NONE"
    region.meniscus.region_of = other
    data, notes = write(scene, "without the other cloth")
    noted(notes, "Cloth", "joint is left out")
    noted(notes, "Hem", "left out", "no part as cloth")
    check("region" not in data["sheet"][0], "a region of an object that is no cloth is left out")


def check_falling(folder: Path) -> None:
    """Without a collider, what no pin holds is noted."""
    scene = empty(folder)

    def falls(name: str, expected: str) -> None:
        notes = scene_module("preset").write(bpy.context).notes
        found = [note.partition("collider: ")[2].partition(" will fall")[0] for note in notes if "will fall" in note]
        check(found == ([expected] if expected else []), f"{name}: {expected or 'nothing'} falls without end", notes)

    cloth = add("cloth")
    cloth.vertex_groups.new(name="Pins").add([0, 40], 1.0, "REPLACE")
    falls("a free cloth", "cloth")
    cloth.meniscus.pins = "Pins"
    falls("a cloth with pins", "")
    add("drop")
    falls("a cloth with pins that catches a drop", "")
    cloth.meniscus.use_liquid = False
    falls("a cloth with pins that liquid passes", "liquid")
    cloth.meniscus.pin.use_release = True
    falls("released pins", "liquid and cloth")
    cloth.meniscus.pin.use_release = False
    second = add("cloth", location=(1.0, 0.0, 0.8))
    falls("a second cloth", "liquid and cloth")
    second.vertex_groups.new(name="Side").add([0], 1.0, "REPLACE")
    role = second.meniscus
    role.joint_to, role.joint_points, role.joint_other_points, role.use_liquid = cloth, "Side", "Pins", False
    role.joint.use_stiffness = True
    falls("a cloth that is joined to one with pins", "liquid")
    scene.gravity = (0.0, 0.0, 0.0)
    falls("gravity that is zero", "")


def check_schema() -> None:
    """Properties are the schema's keys, with its texts as tooltips."""
    schema, settings = scene_module("schema"), scene_module("settings")
    group = bpy.types.Scene.bl_rna.properties["meniscus"].fixed_type.properties["liquid"].fixed_type
    lacking = [key.name for key in schema.keys("LiquidParams") if key.kind != "other" and key.name not in group.properties]
    check(not lacking, "every key of the liquid is a property", lacking)
    spacing = group.properties["spacing"]
    check(spacing.unit == "LENGTH" and "Distance between particles" in spacing.description, "a length has Blender's unit and the reference's text")
    every = [each for made in settings.made.values() for each in made.bl_rna.properties if each.identifier not in ("rna_type", "name")]
    ended = [each.identifier for each in every if each.description.endswith(".")]
    check(len(every) > 150 and not ended, "no tooltip ends with a full stop", ended)
    empty_texts = [each.identifier for each in every if not each.description and each.type != "POINTER"]
    check(not empty_texts, "every property has a tooltip", empty_texts)


def check_folder(folder: Path) -> None:
    """Files of objects that are gone are removed, others stay; presets of others are not replaced."""
    scene = fresh(folder)
    made = add("collider")
    write(scene)
    assets = folder / "meniscus" / "assets"
    (assets / "Mine.ply").write_bytes(b"mine")
    check((assets / "Collider.ply").is_file(), "an object has its file")
    bpy.data.objects.remove(made)
    scene_module("preset").write(bpy.context)
    check(not (assets / "Collider.ply").exists(), "the file of an object that is gone is removed")
    check((assets / "Mine.ply").read_bytes() == b"mine", "a file that the extension did not write stays")
    listed = assets / "files.json"
    listed.write_text('["../../scene.blend", "Mine.ply/../x", 3]')
    scene_module("preset").write(bpy.context)
    check((folder / "scene.blend").is_file(), "a list of files removes nothing outside the folder")
    path = folder / "meniscus" / "scene.toml"
    path.write_text('title = "mine"\n')
    refused("a preset that the extension did not write", "scene.toml", "not written by this extension")
    check(path.read_text() == 'title = "mine"\n', "that preset stays")
    path.unlink()
    shutil.rmtree(assets)
    outside = folder / "outside"
    outside.mkdir()
    assets.symlink_to(outside, target_is_directory=True)
    refused("assets that are a symbolic link", "symbolic link")
    check(not list(outside.iterdir()), "nothing is written through the link")


def check_refused(folder: Path) -> None:
    """Scenes that no preset can hold."""
    scene = empty(folder)
    refused("a scene without anything to simulate", "nothing to simulate")
    pool = add("pool")
    scene.frame_start, scene.frame_end = 1, 1_000_000
    refused("too many frames", "1000000 frames")
    scene.frame_end = 1
    scene.meniscus.folder = "relative/folder"
    refused("a relative folder", "not an absolute folder")
    scene.meniscus.folder = "//meniscus"
    pool.scale.x = 0.0
    refused("a flat box", "Pool")
    pool.scale.x = 1.0
    other = bpy.data.scenes.new("Other")
    other.collection.objects.link(pool)
    refused("two scenes with one folder", "scene Other")
    bpy.data.scenes.remove(other)
    check_other_blend(scene, folder)
    leaf = add("collider")
    leaf.data.clear_geometry()
    refused("a mesh without faces", "Collider", "no faces")
    bpy.ops.wm.read_homefile(use_empty=True)
    refused("a .blend that is not saved", "not saved")


def check_other_blend(scene: bpy.types.Scene, folder: Path) -> None:
    """The folder of another .blend is refused, unless it is taken over, or that file is gone."""
    first = bpy.data.filepath
    write(scene, accepted=False)
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "second.blend"))
    refused("the folder of another .blend", "folder of scene.blend", "Write Preset")
    before = (folder / "meniscus" / "scene.toml").read_bytes()
    check(bpy.ops.meniscus.write() == {"FINISHED"} and (folder / "meniscus" / "scene.toml").read_bytes() == before, "Write Preset takes it over")
    write(scene, accepted=False)
    (folder / "second.blend").unlink()
    bpy.ops.wm.save_as_mainfile(filepath=first)
    write(scene, accepted=False)
    check(scene_module("assets").read_objects(folder / "meniscus")["blend"] == "../scene.blend", "the folder of a file that is gone is free")


def stage_presets(folder: Path) -> None:
    check_names(folder / "names")
    check_left_out(folder / "left out")
    check_motion(folder / "motion")
    check_turns(folder / "turns")
    check_deforming(folder / "deforming")
    check_settings(folder / "settings")
    check_kinds(folder / "kinds")
    check_air(folder / "air")
    check_sheets(folder / "sheets")
    check_falling(folder / "falling")
    check_schema()
    check_folder(folder / "folder")
    check_refused(folder / "refused")


if __name__ == "__main__":
    harness.run(globals())
