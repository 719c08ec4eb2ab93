# SPDX-License-Identifier: MIT OR Apache-2.0
"""Tests of where a preset places things, inside Blender: pins, mirrored objects, unit scales, keyframes of settings, and names.

run.py starts the stage in a process of its own. The engine checks no preset in here.
"""

from pathlib import Path
from types import SimpleNamespace

import bpy
import numpy as np
from mathutils import Euler, Matrix, Quaternion, Vector

import harness
import ply
from harness import check
from presets import add, fresh, noted, points, posed, refused, write, world_points
from scenes import empty, scene_module
from volumes import load_openvdb

MIRRORS = [(-1.0, 1.0, 1.0), (1.0, -1.0, 1.0), (1.0, 1.0, -1.0), (-1.0, -1.0, -1.0)]
TURN = (0.3, 0.5, 0.2)


def check_pins(folder: Path) -> None:
    """Pinned points, whose rest places are in the world, are where Blender has them."""
    scene = fresh(folder)
    cloth = add("cloth", rotation_euler=(0.4, 0.0, 0.0))
    cloth.vertex_groups.new(name="Held").add(list(range(41)), 1.0, "REPLACE")
    cloth.meniscus.pins = "Held"
    for frame, place, angle in ((1, (1.0, 2.0, 3.0), 0.0), (4, (2.0, 2.5, 3.0), 1.0)):
        cloth.location, cloth.rotation_euler.z = place, angle
        cloth.keyframe_insert("location", frame=frame)
        cloth.keyframe_insert("rotation_euler", frame=frame)
    data, _ = write(scene, accepted=False)
    rest, keys = world_points(cloth, 1), data["sheet"][0]["pin"][0]["keyframes"]
    errors = [np.abs(posed(rest, keys, frame) - world_points(cloth, frame)).max() for frame in range(1, 5)]
    check(max(errors) < 1e-5, "pinned points are where Blender has them in every frame [m]", errors)


def directions(shown: bpy.types.Object) -> np.ndarray:
    """The object's axes in the world, as columns of unit length."""
    bpy.context.view_layer.update()
    matrix = np.array(shown.matrix_world)[:3, :3]
    return matrix / np.linalg.norm(matrix, axis=0)


def turned(entry: dict, vector: list[float]) -> np.ndarray:
    """A vector of a shape in its first frame, in the world."""
    keys = entry.get("keyframes")
    return np.array(Quaternion(keys[0].get("quaternion", (1, 0, 0, 0))).to_matrix()) @ vector if keys else np.array(vector)


def check_mirrored(folder: Path) -> None:
    """A mirrored object has the normals, velocities and axes that Blender shows."""
    for number, mirror in enumerate(MIRRORS):
        for moves in (False, True):
            scene = fresh(folder / f"{number} {moves}")
            plane = add("floor", scale=mirror, rotation_euler=TURN)
            disc, solid = add("inflow", scale=mirror, rotation_euler=TURN), add("inflow", scale=mirror, rotation_euler=TURN)
            solid.data = bpy.data.objects["Pool"].data
            solid.name, solid.meniscus.shape = "Solid", "MESH"
            for each in (disc, solid):
                each.meniscus.emitter.use_velocity, each.meniscus.emitter.velocity = True, (1.0, 2.0, 3.0)
                each.meniscus.emitter.use_rate = False
            force = add("force", scale=mirror, rotation_euler=TURN)
            force.meniscus.kind = "uniform"
            force.meniscus.kind_uniform.acceleration = (1.0, 2.0, 3.0)
            for each in (plane, disc, solid, force) if moves else ():
                each.keyframe_insert("location", frame=1)
                each.location.x += 1.0
                each.keyframe_insert("location", frame=4)
            data, _ = write(scene, accepted=False)
            scene.frame_set(1)
            name = f"{mirror}, {'moving' if moves else 'at rest'}"
            axes = directions(plane)
            entry = data["world"]["collider"][0]
            normal = turned(entry, entry["shape"]["plane"]["normal"])
            check(np.allclose(normal, axes[:, 2], atol=1e-5), f"the normal of a plane: {name}", (normal, axes[:, 2]))
            wanted = axes @ (1.0, 2.0, 3.0)
            for entry in data["liquid"]["emitter"]:
                found = turned(entry, entry["velocity"])
                check(np.allclose(found, wanted, atol=1e-5), f"the velocity of a {list(entry['shape'])[0]}: {name}", (found, wanted))
                if "disc" in entry["shape"]:
                    normal = turned(entry, entry["shape"]["disc"]["normal"])
                    check(np.allclose(normal, axes[:, 2], atol=1e-5), f"the normal of a disc: {name}", (normal, axes[:, 2]))
            entry = data["force"][0]
            found = turned(entry, entry["kind"]["uniform"]["acceleration"])
            check(np.allclose(found, wanted, atol=1e-5), f"the acceleration of a force: {name}", (found, wanted))


def check_units(folder: Path) -> None:
    """Settings that were never changed are the reference's, whatever the unit scale; changed ones are in its units."""
    scene = fresh(folder)
    scene.unit_settings.scale_length = 0.01
    scene.meniscus.use_whitewater = True
    force = add("force")
    force.meniscus.kind = "point"
    data, _ = write(scene, accepted=False)
    check(not data["whitewater"], "untouched settings of whitewater are left out", data["whitewater"])
    check(np.isclose(data["force"][0]["kind"]["point"]["radius"], 0.1), "an untouched required length is in metres", data["force"][0])
    force.meniscus.kind_point.radius = 20.0
    data, _ = write(scene, accepted=False)
    check(np.isclose(data["force"][0]["kind"]["point"]["radius"], 0.2), "a changed length is in the scene's units", data["force"][0])


def check_playhead(folder: Path) -> None:
    """The preset has the values of the first frame, wherever the playhead is; keyframes that it leaves out are reported."""
    scene = fresh(folder)
    nozzle = add("inflow")
    nozzle.meniscus.emitter.use_velocity = True
    camera = bpy.data.objects.new("View", bpy.data.cameras.new("View"))
    scene.collection.objects.link(camera)
    scene.camera = camera
    for frame, value in ((1, 1.0), (4, 2.0)):
        nozzle.meniscus.emitter.velocity = (value, 0.0, 0.0)
        nozzle.keyframe_insert("meniscus.emitter.velocity", frame=frame)
        scene.gravity = (0.0, 0.0, -value)
        scene.keyframe_insert("gravity", frame=frame)
        camera.data.lens = 40.0 * value
        camera.data.keyframe_insert("lens", frame=frame)
        scene.meniscus.liquid.density = 1000.0 * value
        scene.keyframe_insert("meniscus.liquid.density", frame=frame)
    path, texts, notes = folder / "meniscus" / "scene.toml", [], []
    for frame in (1, 4):
        scene.frame_set(frame)
        data, notes = write(scene, accepted=False)
        texts.append(path.read_bytes())
        check(scene.frame_current == frame, "the playhead stays")
    check(texts[0] == texts[1], "the preset does not depend on the playhead")
    found = (data["world"]["gravity"][2], data["camera"]["focal_length"], data["liquid"].get("density", 1000.0))
    check(np.allclose(found, (-1.0, 40.0, 1000.0)), "values are those of the first frame", found)
    for parts in (("Inflow", "emitter velocity"), ("gravity",), ("View", "lens"), ("liquid density",)):
        noted(notes, *parts, "first frame")


def check_sources(folder: Path) -> None:
    """A result finds its object by what the folder has, also after the .blend was closed without saving, and next to copies."""
    scene = fresh(folder)
    made = add("body")
    bpy.ops.wm.save_mainfile()
    write(scene, accepted=False)
    copied = made.copy()
    copied.name = "A Copy"
    scene.collection.objects.link(copied)
    show = scene_module("show")
    found = show.Sources(folder / "meniscus").object(scene, "Body", "BODY")
    check(found == made, "a copy is not taken for the object", found)
    bpy.ops.wm.open_mainfile(filepath=bpy.data.filepath)
    sources = show.Sources(folder / "meniscus")
    found = sources.object(bpy.context.scene, "Body", "BODY")
    check(found is not None and found.name == "Body", "an object is found after the file was closed without saving", found)
    check(np.allclose(sources.start("Body"), Matrix.Translation((0.0, 0.0, 0.6))), "with its place in the first frame")
    listed = folder / "meniscus" / "assets" / "objects.json"
    entries = ("3", '{"object": "Body", "start": [1]}', '{"object": 1, "start": []}', '{"object": "Body", "start": [%s]}' % ", ".join(["NaN"] * 16))
    for text in ("[]", "{" * 5000, '{"objects": []}', *(f'{{"objects": {{"Body": {entry}}}}}' for entry in entries)):
        listed.write_text(text)
        check(show.Sources(folder / "meniscus").object(bpy.context.scene, "Body", "BODY") is None, f"a broken list names no object: {text[:60]}")


def check_copies(folder: Path) -> None:
    """A body's result has the mesh of the first frame, as the engine has it, wherever the playhead is; also of a hidden object."""
    scene = fresh(folder)
    made = add("body")
    wave = made.modifiers.new("Wave", "WAVE")
    wave.height, wave.time_offset, wave.width = 0.5, -20.0, 0.5
    made.modifiers.new("Subdivision", "SUBSURF")
    write(scene, accepted=False)
    wanted = world_points(made, 1) - made.matrix_world.translation
    made.hide_set(True)
    scene.frame_set(4)
    show = scene_module("show")
    shot = SimpleNamespace(sheets=[], colliders=[SimpleNamespace(name="Body")], frames=SimpleNamespace(first=1))
    copies = show.copies_of(bpy.context, scene, shot, show.Sources(folder / "meniscus"))
    found = np.array([vertex.co for vertex in copies["Body"].data.vertices])
    check(found.shape == wanted.shape and np.abs(found - wanted).max() < 1e-5, "a copy has the mesh of the first frame", found.shape)
    check(scene.frame_current == 4 and made.hide_get(), "playhead and eye are as before")


def check_body(folder: Path) -> None:
    """Place and rotation of a body, start and end of smoke are the object's: no setting competes with them."""
    empty(folder)
    made = scene_module("settings").made
    for definition, names in (("BodyParams", ("position", "rotation")), ("Emitter", ("start", "end"))):
        found = [name for name in names if name in made[definition].bl_rna.properties]
        check(not found, f"{definition} offers nothing that the object has itself", found)
    check("velocity" in made["BodyParams"].bl_rna.properties, "a body has its velocity")


def check_owner(folder: Path) -> None:
    """A result is shown in the scene that started its job; two scenes with one folder are refused however it is written."""
    first = fresh(folder)
    second = bpy.data.scenes.new("Second")
    second.meniscus.folder = str(folder / "meniscus")
    session, run = scene_module("session"), scene_module("run")
    shown: list[str] = []

    class Ended(run.Job):
        def update(self) -> bool:
            self.is_running, self.code = False, 0
            return True

    job = Ended(folder / "meniscus")
    job.description, job.is_running = {"action": "simulate", "scene": second.name}, True
    before, session.show_result = session.show_result, lambda scene, _job: shown.append(scene.name)
    try:
        session.begin(second, job)
        session.tick()
    finally:
        session.show_result = before
    check(shown == ["Second"], "a result is shown in the scene that started the job", shown)
    session.opened()
    second.collection.objects.link(first.objects["Pool"])
    refused("two scenes with one folder, written differently", "scene Second")


def volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    """The volume that triangles enclose, positive if they are counter-clockwise seen from outside."""
    corners = vertices[faces]
    return float(np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6.0)


def check_turned(folder: Path) -> None:
    """A turned box or ellipsoid of liquid is that, not the mesh of its object; also of an empty."""
    for shape, wanted in (("BOX", 8.0), ("SPHERE", 8.0 * np.pi / 6.0)):
        for kind in ("empty", "mirrored"):
            scene = fresh(folder / f"{shape} {kind}")
            made = bpy.data.objects.new("Turned", None if kind == "empty" else bpy.data.meshes.new("Turned"))
            scene.collection.objects.link(made)
            if made.data:
                # Only the bounding box matters: two corners.
                made.data.from_pydata([(-1, -1, -1), (1, 1, 1)], [], [])
            made.scale, made.rotation_euler, made.location = (0.5, 1.0, -2.0 if kind == "mirrored" else 2.0), TURN, (0.0, 0.0, 5.0)
            made.meniscus.role = "FLUID"
            made.meniscus.shape = shape
            bpy.context.view_layer.update()
            data, _ = write(scene, accepted=False)
            file = folder / f"{shape} {kind}" / "meniscus" / data["liquid"]["source"][1]["shape"]["mesh"]["file"]
            table, faces = ply.read(file)
            vertices = np.stack([table[axis] for axis in "xyz"], axis=1).astype(np.float64)
            found = volume(vertices - vertices.mean(0), faces)
            check(0.985 * wanted < found < 1.001 * wanted, f"the volume of a turned {shape}: {kind}", (found, wanted))
            check(np.allclose(vertices.mean(0), (0.0, 0.0, 5.0), atol=1e-4), f"the place of a turned {shape}: {kind}", vertices.mean(0))


def bent_by_parent(scene: bpy.types.Scene) -> bpy.types.Object:
    """A collider whose parent is an armature that bends it, without a modifier."""
    bent = add("collider")
    rig = bpy.data.objects.new("Rig", bpy.data.armatures.new("Rig"))
    scene.collection.objects.link(rig)
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.mode_set(mode="EDIT")
    bone = rig.data.edit_bones.new("Bone")
    bone.head, bone.tail = (0.0, 0.0, 0.0), (0.0, 0.0, 0.2)
    bpy.ops.object.mode_set(mode="OBJECT")
    bent.name, bent.parent, bent.parent_type = "Bent", rig, "ARMATURE"
    bent.vertex_groups.new(name="Bone").add([v.index for v in bent.data.vertices if v.co.z > 0.0], 1.0, "REPLACE")
    pose = rig.pose.bones["Bone"]
    pose.rotation_mode = "XYZ"
    for frame, angle in ((1, 0.0), (4, 0.8)):
        pose.rotation_euler.x = angle
        pose.keyframe_insert("rotation_euler", frame=frame)
    return bent


def check_left_out(folder: Path) -> None:
    """What a preset cannot hold is reported."""
    scene = fresh(folder)
    nozzle = add("inflow", scale=(1.0, 2.0, 1.0))
    nozzle.name = "Oval"
    force = add("force")
    force.meniscus.force.use_falloff = True
    parent = bpy.data.objects.new("Parent", None)
    scene.collection.objects.link(parent)
    parent.scale = (1.0, 3.0, 1.0)
    sheared = add("force", rotation_euler=TURN, parent=parent)
    sheared.name = "Sheared"
    cloth = add("cloth")
    wave = cloth.modifiers.new("Wave", "WAVE")
    wave.height, wave.time_offset, wave.width = 0.5, -20.0, 0.5
    scattered = add("collider")
    scattered.name = "Scattered"
    group = bpy.data.node_groups.new("Scatter", "GeometryNodeTree")
    for direction in ("INPUT", "OUTPUT"):
        group.interface.new_socket("Geometry", in_out=direction, socket_type="NodeSocketGeometry")
    nodes = {name: group.nodes.new(name) for name in ("NodeGroupInput", "NodeGroupOutput", "GeometryNodeInstanceOnPoints", "GeometryNodeMeshCube", "GeometryNodeJoinGeometry")}
    join, instances = nodes["GeometryNodeJoinGeometry"], nodes["GeometryNodeInstanceOnPoints"]
    group.links.new(nodes["NodeGroupInput"].outputs[0], instances.inputs["Points"])
    group.links.new(nodes["GeometryNodeMeshCube"].outputs[0], instances.inputs["Instance"])
    for each in (nodes["NodeGroupInput"], instances):
        group.links.new(each.outputs[0], join.inputs[0])
    group.links.new(join.outputs[0], nodes["NodeGroupOutput"].inputs[0])
    scattered.modifiers.new("Scatter", "NODES").node_group = group
    bent = bent_by_parent(scene)
    data, notes = write(scene, accepted=False)
    noted(notes, "Oval", "mean of its two radii")
    noted(notes, "Force", "falloff")
    noted(notes, "Sheared", "shear")
    noted(notes, "Cloth", "deformation")
    noted(notes, "Scattered", "instance(s)")
    meshes = [entry["shape"]["mesh"] for entry in data["world"]["collider"]]
    cached = [mesh["file"] for mesh in meshes if "point_cache" in mesh]
    check(cached == [f"assets/{bent.name}.ply"], "a mesh whose parent bends it is sampled in every frame", meshes)


def check_cloud(folder: Path) -> None:
    """Smoke fills an object when the shot starts, with its settings; its animation is reported."""
    scene = empty(folder)
    scene.frame_end, scene.unit_settings.scale_length = 2, 0.5
    made = add("cloud", scale=(1.0, 1.0, 2.0), rotation_euler=TURN, location=(1.0, 2.0, 3.0))
    made.meniscus.cloud.density = 0.5
    made.keyframe_insert("location", frame=1)
    made.location.x = 4.0
    made.keyframe_insert("location", frame=2)
    data, notes = write(scene)
    noted(notes, "Smoke Cloud", "animation is left out")
    found = data["smoke"]["source"][0]
    check((found["density"], found["temperature"]) == (0.5, 180), "smoke at the start has its settings", found)
    bpy.ops.meniscus.simulate(wait=True)
    grid = load_openvdb().read(str(folder / "meniscus" / "draft" / "volume" / "smoke_0001.vdb"), "density")
    low, high = grid.evalActiveVoxelBoundingBox()
    values = np.zeros([most - least + 1 for least, most in zip(low, high)])
    grid.copyToArray(values, ijk=low)
    places = np.indices(values.shape).reshape(3, -1).T * grid.transform.voxelSize()[0] + np.array(grid.transform.indexToWorld(low))
    weights = values.ravel()
    mean = np.average(places, axis=0, weights=weights)
    check(np.abs(mean - (0.5, 1.0, 1.5)).max() < 0.02, "the smoke is at the place of its object in the first frame [m]", mean)
    # Along its Z axis the ellipsoid is twice as long.
    along = ((places - mean) @ np.array(Euler(TURN).to_matrix()))
    spread = np.average(along**2, axis=0, weights=weights) ** 0.5
    check(1.7 < spread[2] / spread[0] < 2.2, "it has the shape of its object", spread)
    full = float(np.median(values[values > 0.5 * values.max()]))
    check(0.4 < full < 0.6, "it has its density", full)


def check_pivot(folder: Path) -> None:
    """What turns at constant speed about a distant point is written about that point, with a keyframe for each 2.5 rad."""
    for name, drift in (("that rests", 0.0), ("that moves", 2.0)):
        scene = fresh(folder / name)
        scene.frame_end = 121
        pivot = bpy.data.objects.new("Pivot", None)
        scene.collection.objects.link(pivot)
        for frame, angle in ((1, 0.0), (121, 12.0)):
            pivot.rotation_euler, pivot.location = (0.3, 0.2, angle), (1.0 + drift * angle / 12.0, 2.0, 0.5)
            pivot.keyframe_insert("rotation_euler", frame=frame)
            pivot.keyframe_insert("location", frame=frame)
        for curve in pivot.animation_data.action.layers[0].strips[0].channelbags[0].fcurves:
            for point in curve.keyframe_points:
                point.interpolation = "LINEAR"
        mesh, box, force = add("collider"), add("outflow"), add("force")
        force.meniscus.kind, force.meniscus.shape = "point", "SPHERE"
        for index, each in enumerate((mesh, box, force)):
            each.parent, each.location, each.rotation_euler = pivot, (3.0 - index, 0.5, 0.2), TURN
        data, _ = write(scene, name)
        entries = {"mesh": data["world"]["collider"][0], "box": data["liquid"]["outflow"][0], "force": data["force"][0]}
        corners = np.array(list(entries["box"]["shape"]["box"].values()))
        shown = {
            "mesh": (points(folder / name / "meniscus" / entries["mesh"]["shape"]["mesh"]["file"])[::17], lambda frame: world_points(mesh, frame)[::17]),
            "box": (corners, lambda frame: ends(box, frame)),
            "force": (np.array([entries["force"]["kind"]["point"]["center"], entries["force"]["shape"]["sphere"]["center"]]), lambda frame: origins(force, frame)),
        }
        for kind, (own, wanted) in shown.items():
            keys = entries[kind]["keyframes"]
            worst = max(np.abs(posed(own, keys, frame) - wanted(frame)).max() for frame in range(1, 122))
            print(f"A {kind} about a pivot {name}: {len(keys)} keyframes of 121 frames, at most {worst:.1e} m off")
            check(len(keys) <= 7, f"a {kind} that turns by 12 rad about a pivot {name} has few keyframes", len(keys))
            check(worst < 2e-5, f"a {kind} that turns about a pivot {name} is where Blender has it in every frame [m]", worst)


def check_far_pivot() -> None:
    """About a pivot that is too far for single precision nothing is written."""
    poses = scene_module("poses")
    frames = list(range(1, 122))
    for radius, angle, is_pivot in ((1000.0, 0.01, False), (1000.0, 3.0, True), (18.0, 0.05, False), (3.0, 1.0, True)):
        rotations = [Quaternion((0.0, 0.0, 1.0), angle * index / 120.0) for index in range(121)]
        found = [poses.Pose(tuple(radius * part for part in rotation @ Vector((1.0, 0.0, 0.0))), tuple(rotation), 1.0) for rotation in rotations]
        pivot, _, chosen = poses.pivoted(frames, found)
        is_right = np.allclose(pivot, (-radius, 0.0, 0.0), atol=1e-3 * radius) if is_pivot else not np.any(pivot)
        check(is_right, f"a turn of {angle} rad at {radius:g} m {'has its pivot' if is_pivot else 'keeps its origin'}", (pivot, len(chosen)))


def ends(box: bpy.types.Object, frame: int) -> np.ndarray:
    """The lowest and the highest corner of a box, in its axes, in the world."""
    bpy.context.scene.frame_set(frame)
    corners = np.array([corner[:] for corner in box.bound_box])
    return np.array([box.matrix_world @ Vector(corner) for corner in (corners.min(0), corners.max(0))])


def origins(each: bpy.types.Object, frame: int) -> np.ndarray:
    bpy.context.scene.frame_set(frame)
    return np.array([each.matrix_world.to_translation()] * 2)


def check_narrow(folder: Path) -> None:
    """A tap in a scene whose spacing fits a pool is noted with the spacing that fits it, when it is added and when it is written; so is the reverse."""
    scene = empty(folder)
    scene.unit_settings.scale_length = 0.5
    add("pool")
    add("inflow")
    _, notes = write(scene, accepted=False)
    check(not any("opening" in note for note in notes), "an inflow next to a pool is wide enough", notes)
    add("tap")
    check(abs(scene.meniscus.liquid.spacing - 0.06) < 1e-6, "the spacing stays that of the pool", scene.meniscus.liquid.spacing)
    harness.expect("Tap: its opening of 0.012 m is 0.4 times as wide as the spacing of the liquid, 0.03 m")
    _, notes = write(scene, accepted=False)
    noted(notes, "Tap: its opening", "A Spacing of 0.0015 m fits it", "enlarge the opening to 0.24 m")
    scene.meniscus.liquid.spacing = 0.003
    _, notes = write(scene, accepted=False)
    check(not any("opening" in note for note in notes), "with that spacing there is no note", notes)
    scene = empty(folder / "tap first")
    add("tap")
    harness.expect("Pool: it has up to 178 million particles at the spacing of the liquid, 0.0015 m")
    add("pool")
    check(abs(scene.meniscus.liquid.spacing - 0.0015) < 1e-7, "of a tap that is first the spacing fits the tap", scene.meniscus.liquid.spacing)
    _, notes = write(scene, accepted=False)
    noted(notes, "Pool: it has up to 178 million particles", "A Spacing of 0.0084 m gives a million", "scale the object by 0.18")
    check(not any("opening" in note for note in notes), "the tap fits", notes)


def check_tension(folder: Path) -> None:
    """Splashes have the tension that fits the spacing of each quality, taps that of water."""
    scene = empty(folder)
    add("pool")
    data, _ = write(scene, "a pool with the tension of splashes")
    found = [data["liquid"]["surface_tension"]["coefficient"], *(data["quality"][tier]["liquid"]["surface_tension"]["coefficient"] for tier in ("draft", "preview"))]
    wanted = [0.5 * 1000 * 9.81 * (part * 0.03) ** 2 for part in (1.0, 2.0, 1.4)]
    check(np.allclose(found, wanted, rtol=1e-5), "the tension of splashes fits each spacing", found)
    check(data["liquid"]["implicitness"] == 0.25 and "vorticity" in data["liquid"], "a pool has the terms of splashes", data["liquid"])
    scene.meniscus.liquid.spacing = 0.3
    data, notes = write(scene, "a coarse pool")
    check(data["quality"]["draft"]["liquid"]["surface_tension"]["coefficient"] == 1000, "the tension has a largest value", data["quality"])
    noted(notes, "Tension of Splashes", "1000 N/m")
    scene.meniscus.use_splash_tension = False
    data, _ = write(scene, "a pool with the tension of water")
    check("surface_tension" not in data["quality"]["draft"]["liquid"], "otherwise the tension is the liquid's", data["quality"])
    scene = empty(folder / "tap")
    add("tap")
    data, _ = write(scene, "a tap")
    is_water = data["liquid"]["surface_tension"].get("coefficient", 0.072) == 0.072 and "implicitness" not in data["liquid"]
    check(is_water and "surface_tension" not in data["quality"]["draft"]["liquid"], "a tap has the tension of water", data["liquid"])


def stage_placing(folder: Path) -> None:
    check_pins(folder / "pins")
    check_mirrored(folder / "mirrored")
    check_units(folder / "units")
    check_playhead(folder / "playhead")
    check_body(folder / "body")
    check_copies(folder / "copies")
    check_owner(folder / "owner")
    check_turned(folder / "turned")
    check_left_out(folder / "left out")
    check_sources(folder / "sources")
    check_cloud(folder / "cloud")
    check_pivot(folder / "pivot")
    check_far_pivot()
    check_narrow(folder / "narrow")
    check_tension(folder / "tension")


if __name__ == "__main__":
    harness.run(globals())
