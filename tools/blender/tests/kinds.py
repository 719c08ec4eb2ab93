# SPDX-License-Identifier: MIT OR Apache-2.0
"""Tests of every kind of output in the shots that the engine makes of shots/, inside Blender.

run.py starts each stage in a process of its own: the first imports and saves, the second opens what was moved, without the extension.
"""

import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import bpy
import numpy as np

import harness
import ply
import synthetic
from harness import ADDON, at_frame, change, check, evaluated, expect, imported, use_addon
from stages import columns, point_cache, vectors

HERE = Path(__file__).resolve().parent
FRAME, SIZE = 4, (96, 64)
FPS = 24.0


def shot(folder: Path, name: str) -> dict:
    """Makes a shot with the engine, and returns its shot.json."""
    command = [os.environ["MENISCUS"], "shot", str(HERE / "shots" / f"{name}.toml"), "-o", str(folder), "--progress", "none"]
    run = subprocess.run(command, capture_output=True, text=True)
    check(run.returncode == 0, f"the engine makes {name}", run.stderr[-2000:])
    return json.loads((folder / "shot.json").read_text(encoding="utf-8"))


def outputs(data: dict, *kinds: tuple[str, str]) -> None:
    """Leaves only some outputs in a shot.json."""
    data["outputs"] = [each for each in data["outputs"] if (each["kind"], each["format"]) in kinds]


def picture(path: Path) -> np.ndarray:
    """The current frame as red, green and blue."""
    scene = bpy.context.scene
    render = scene.render
    render.resolution_x, render.resolution_y, render.resolution_percentage = *SIZE, 100
    render.image_settings.file_format, render.image_settings.color_mode = "OPEN_EXR", "RGBA"
    scene.cycles.device, scene.cycles.samples, scene.cycles.seed = "CPU", 8, 1
    scene.cycles.use_adaptive_sampling = scene.cycles.use_denoising = False
    render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(str(path))
    pixels = np.empty(4 * SIZE[0] * SIZE[1], np.float32)
    image.pixels.foreach_get(pixels)
    bpy.data.images.remove(image)
    return pixels.reshape(SIZE[1], SIZE[0], 4)[:, :, :3]


def signature(frame: int) -> dict[str, object]:
    """What is shown in a frame, by object: counts and boxes of its geometry, and the world matrix."""
    bpy.context.scene.frame_set(frame)
    graph = bpy.context.evaluated_depsgraph_get()
    found: dict[str, object] = {}
    for each in sorted(bpy.context.scene.objects, key=lambda one: one.name):
        shown = each.evaluated_get(graph)
        box = np.array([corner[:] for corner in shown.bound_box]).round(5).tolist() if each.type in ("MESH", "VOLUME") else []
        count = len(shown.data.vertices) if each.type == "MESH" else 0
        found[each.name] = [each.type, count, box, [list(row) for row in shown.matrix_world]]
    return found


def cloud(shown: bpy.types.Object) -> dict[str, np.ndarray]:
    """Radius and velocity of the points that an object shows."""
    # The geometry owns the points.
    geometry = shown.evaluated_get(bpy.context.evaluated_depsgraph_get()).evaluated_geometry()
    points = geometry.pointcloud
    if points is None:
        return {"radius": np.empty(0), "velocity": np.empty((0, 3))}
    radii, speeds = np.empty(len(points.points), np.float32), np.empty(3 * len(points.points), np.float32)
    points.attributes["radius"].data.foreach_get("value", radii)
    points.attributes["velocity"].data.foreach_get("vector", speeds)
    return {"radius": radii, "velocity": speeds.reshape(-1, 3)}


def stage_liquids(folder: Path) -> None:
    """Two liquids with their colours, a collider and a body that move, whitewater and volumes; saved with relative paths."""
    use_addon()
    data = shot(folder / "one", "liquids")
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "scene.blend"))
    imported(folder / "one", studio=True)
    scene = bpy.context.scene
    water, foam = scene.objects["liquid"], scene.objects["whitewater"]
    mesh, (table, _) = at_frame(water, FRAME), ply.read(folder / f"one/mesh/liquid_{FRAME:04}.ply")
    check(np.array_equal(vectors(mesh, "velocity"), columns(table, "vx vy vz")), "the surface has the velocities of its file")
    check([each.name for each in mesh.materials] == ["Liquids"], "several liquids have a material of their colours")
    colours = np.empty(4 * len(mesh.vertices), np.float32)
    mesh.attributes["Col"].data.foreach_get("color", colours)
    stored = columns(table, "red green blue") / np.float32(255.0)
    linear = np.where(stored <= 0.04045, stored / 12.92, ((stored + 0.055) / 1.055) ** 2.4)
    check(np.abs(colours.reshape(-1, 4)[:, :3] - linear).max() < 1e-6, "the surface has the colours of its file")
    preset = tomllib.loads((folder / "one/preset.toml").read_text(encoding="utf-8"))
    ends = np.array([source["color"] for source in preset["liquid"]["source"]])
    part = (linear[:, 0] - ends[0, 0]) / (ends[1, 0] - ends[0, 0])
    check(part.min() < 0.01 and part.max() > 0.99, "both colours are on the surface", (part.min(), part.max()))
    check(np.abs(linear - (ends[0] + part[:, None] * (ends[1] - ends[0]))).max() < 0.01, "all others are between the two")

    check_whitewater(folder / f"one/whitewater/whitewater_{FRAME:04}.ply", foam)
    check_solids(scene, data, folder / "one")
    hidden = scene.objects["liquid_volume"]
    check(hidden.type == "VOLUME" and hidden.hide_render and hidden.hide_viewport, "the volume of what the mesh shows is hidden")
    expect("liquid: hidden, since another object shows the same")
    check(scene.camera is not None and abs(scene.camera.data.lens - 45.0) < 1e-4, "the camera is the shot's")
    check(any(each.get("meniscus_studio") == "ground" for each in scene.objects), "there is a ground")
    check(scene.render.engine == "CYCLES" and scene.render.use_motion_blur, "motion blur follows velocities in Cycles")
    check_relative()
    save(folder, "one", scene)


def harness_module(name: str):
    """A module of the add-on."""
    return sys.modules[f"{ADDON}.{name}"]


def check_whitewater(path: Path, foam: bpy.types.Object) -> None:
    """Points as balls of their radius, or as instances of an object."""
    scattered = read_points(path)
    points = cloud(foam)
    radii, count = points["radius"], len(points["radius"])
    check(count == len(scattered["x"]) > 0, "whitewater has the points of its file", count)
    check(np.array_equal(radii, scattered["radius"]), "each is a ball of its own radius")
    check(np.array_equal(points["velocity"], columns(scattered, "vx vy vz")), "and has its velocity")
    check([each.name for each in foam.data.materials] == ["Foam"], "its material is Foam")
    nodes = harness_module("nodes")
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=1, radius=1.0, location=(0.0, 0.0, -50.0))
    drop = bpy.context.object
    nodes.set_inputs(foam.modifiers[0], {"Instances": True, "Instance": drop})
    foam.update_tag()
    graph = bpy.context.evaluated_depsgraph_get()
    sizes = [each.matrix_world.to_scale()[0] for each in graph.object_instances if each.is_instance and each.parent and each.parent.name == foam.name]
    check(len(sizes) == count, "as instances there is an object at every point", (len(sizes), count))
    check(len(sizes) == count and np.allclose(sorted(sizes), np.sort(radii), rtol=1e-4), "scaled by the radius")
    nodes.set_inputs(foam.modifiers[0], {"Blur Instances": True})
    foam.update_tag()
    mesh, corners = evaluated(foam), len(drop.data.vertices)
    check(len(mesh.vertices) == count * corners, "for motion blur they are one mesh", (len(mesh.vertices), count, corners))
    wanted = np.repeat(columns(scattered, "vx vy vz"), corners, axis=0)
    check(len(mesh.vertices) == len(wanted) and np.array_equal(vectors(mesh, "velocity"), wanted), "whose vertices have the velocities of their points")
    nodes.set_inputs(foam.modifiers[0], {"Instances": False, "Instance": None, "Blur Instances": False})
    bpy.data.objects.remove(drop)
    foam.update_tag()


def read_points(path: Path) -> dict[str, np.ndarray]:
    """The columns of a PLY file of points, by a reader of its own."""
    data = path.read_bytes()
    end = data.index(b"end_header\n") + len(b"end_header\n")
    head = data[:end].decode("ascii")
    fields = re.findall(r"property (float|uint) (\S+)", head)
    row = np.dtype([(name, "<f4" if kind == "float" else "<u4") for kind, name in fields])
    table = np.frombuffer(data, row, offset=end)
    return {name: table[name] for _, name in fields}


def check_solids(scene: bpy.types.Scene, data: dict, folder: Path) -> None:
    """Colliders and bodies are where their motion files have them, in every frame."""
    for name in ("box", "sphere", "tank"):
        shown, motion = scene.objects[name], json.loads((folder / f"collider/{name}.json").read_text(encoding="utf-8"))
        worst = 0.0
        for index, pose in enumerate(motion["poses"]):
            scene.frame_set(motion["first"] + index)
            place, turn = shown.matrix_world.to_translation(), shown.matrix_world.to_quaternion()
            worst = max(worst, np.abs(np.array(place) - pose[:3]).max(), 1.0 - abs(np.dot(turn, pose[3:])))
        check(worst < 1e-5, f"{name} is where the engine had it", worst)
        moves = any(pose != motion["poses"][0] for pose in motion["poses"])
        check(moves == (name != "tank"), f"{name} moves or rests", moves)
    check([each.name for each in scene.objects["tank"].data.materials] == ["Glass"], "the tank is of glass")


def check_relative() -> None:
    """No path of the file is absolute."""
    blend = Path(bpy.data.filepath).parent
    found = [bpy.path.abspath(path) for path in bpy.utils.blend_paths(absolute=False) if not path.startswith("//")]
    for shown in bpy.context.scene.objects:
        found += [value for value in shown.values() if isinstance(value, str) and str(blend) in value]
        for modifier in shown.modifiers:
            if modifier.type == "NODES":
                found += [harness_module("nodes").get_input(modifier, "Files")]
    found = [path for path in found if not path.startswith("//")]
    check(not found, "all paths are relative", found)


def save(folder: Path, name: str, scene: bpy.types.Scene) -> None:
    """Saves what is shown and a picture of it, for the second process."""
    (folder / f"{name}.json").write_text(json.dumps([signature(1), signature(FRAME)]), encoding="utf-8")
    scene.frame_set(FRAME)
    np.save(folder / f"{name}.npy", picture(folder / f"{name}.exr"))
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "scene.blend"))


def moved(folder: Path, name: str) -> None:
    """Opens the saved file from its new place, without add-on and with scripts disabled: all is as it was."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.wm.open_mainfile(filepath=str(folder / "scene.blend"), use_scripts=False)
    check(not hasattr(bpy.types, "IMPORT_SCENE_OT_meniscus_shot"), "the add-on is not there")
    check(not bpy.app.autoexec_fail and not bpy.data.texts, "the file has no scripts")
    before = json.loads((folder / f"{name}.json").read_text(encoding="utf-8"))
    for frame, wanted in zip((1, FRAME), before):
        found = json.loads(json.dumps(signature(frame)))
        different = [key for key in wanted if found.get(key) != wanted[key]]
        check(not different and len(found) == len(wanted), f"frame {frame}: every object shows the same", different)
    again = picture(folder / "again.exr")
    check(np.array_equal(again, np.load(folder / f"{name}.npy")), "the picture is the same")
    check(float(np.ptp(again)) > 0.1, "it shows something", np.ptp(again))


def stage_liquids_moved(folder: Path) -> None:
    moved(folder, "one")


def stage_smoke_and_cloth(folder: Path) -> None:
    """Fog with its velocities, and a sheet as a point cache, whose meshes a frame are not shown twice."""
    use_addon()
    shot(folder / "two", "smoke-and-cloth")
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "scene.blend"))
    imported(folder / "two", studio=True)
    scene = bpy.context.scene
    kinds = {each.name: each.type for each in scene.objects}
    check({"smoke", "flag", "sphere"} <= set(kinds) and "flag.001" not in kinds, "smoke, sheet and collider are there, each once", kinds)
    fog = scene.objects["smoke"].data
    check((fog.velocity_grid, fog.velocity_unit) == ("velocity", "SECOND"), "fog has its velocities")
    floor = np.array([vertex.co for vertex in scene.objects["plane"].data.vertices])
    check(np.abs(floor[:, 2] + 0.5).max() < 1e-5, "a floor stays at its height", floor[:, 2])
    check(np.ptp(floor[:, 0]) >= 200.0, "and reaches behind the horizon", np.ptp(floor[:, 0]))
    check(scene.cycles.volume_bounces == 4, "light scatters in smoke", scene.cycles.volume_bounces)
    places = point_cache(folder / "two/sheet/flag.pc2")[1]
    found = np.empty(places[0].size, np.float32)
    at_frame(scene.objects["flag"], FRAME).vertices.foreach_get("co", found)
    check(np.array_equal(found.reshape(-1, 3), places[-1]), "the sheet is where its cache has it")
    materials = {name: [each.name for each in scene.objects[name].data.materials] for name in ("smoke", "flag", "sphere")}
    check(materials == {"smoke": ["Smoke"], "flag": ["Cloth"], "sphere": ["Collider"]}, "each has its material", materials)
    check_relative()
    save(folder, "two", scene)


def stage_smoke_and_cloth_moved(folder: Path) -> None:
    moved(folder, "two")


def stage_forms(folder: Path) -> None:
    """The same surface as OBJ and as a level set, sheets as meshes, a thick liquid: of the shots of the stages before."""
    use_addon()
    for name in ("one", "two"):
        shutil.copytree(folder / name, folder / "forms" / name, ignore=shutil.ignore_patterns("cache"))
    one, two = folder / "forms/one", folder / "forms/two"
    manifest = (one / "shot.json").read_text(encoding="utf-8")
    table, triangles = ply.read(one / f"mesh/liquid_{FRAME:04}.ply")
    wanted = columns(table, "x y z")

    change(one / "shot.json", lambda data: outputs(data, ("mesh", "obj")))
    mesh = at_frame(imported(one), FRAME)
    check(np.array_equal(vectors(mesh, "position"), wanted), "OBJ: the vertices are those of the PLY")
    corners = np.empty(len(mesh.loops), np.int32)
    mesh.loops.foreach_get("vertex_index", corners)
    check(np.array_equal(corners.reshape(-1, 3), triangles), "OBJ: so are the triangles")
    normals = np.empty(3 * len(mesh.loops), np.float32)
    mesh.corner_normals.foreach_get("vector", normals)
    off = np.abs(normals.reshape(-1, 3) - columns(table, "nx ny nz")[corners]).max(axis=1)
    check(float(np.mean(off > 2e-3)) < 1e-3, "OBJ: and the normals", float(off.max()))
    expect("OBJ has no velocities")
    damaged = one / f"mesh/liquid_{FRAME:04}.obj"
    text = damaged.read_bytes()
    damaged.write_bytes(b"mtllib /dev/zero\n" + text)
    harness.refused("an OBJ of another program", one / "shot.json", "liquid_0004.obj", "first line of an OBJ")
    damaged.write_bytes(text)

    (one / "shot.json").write_text(manifest, encoding="utf-8")
    change(one / "shot.json", lambda data: outputs(data, ("volume", "vdb")))
    imported(one)
    surface = bpy.context.scene.objects["liquid.001"]
    mesh = at_frame(surface, FRAME)
    places = vectors(mesh, "position")
    voxel = 0.015
    gap = [np.abs(places.min(0) - wanted.min(0)).max(), np.abs(places.max(0) - wanted.max(0)).max()] if len(places) else [9.0]
    check(max(gap) < 1.5 * voxel, "level set: the surface is where the mesh is", gap)
    mesh.calc_loop_triangles()
    corners = np.empty(3 * len(mesh.loop_triangles), np.int32)
    mesh.loop_triangles.foreach_get("vertices", corners)
    filled, of_mesh = (volume(*each) for each in ((places, corners.reshape(-1, 3)), (wanted, triangles)))
    check(abs(filled - of_mesh) < 0.05 * of_mesh, "level set: it encloses as much, and faces outwards", (filled, of_mesh))
    check([each.name for each in mesh.materials] == ["Water"], "level set: its material is Water")
    check_level_set_velocities(mesh, table)
    before = vectors(mesh, "velocity")
    surface.name = "Sea"
    check(bpy.ops.import_scene.meniscus_reload() == {"FINISHED"}, "level set: it is reloaded")
    again = at_frame(surface, FRAME)
    is_same = surface.name == "Sea" and len(surface.modifiers) == 2
    check(is_same and np.array_equal(vectors(again, "velocity"), before), "level set: its object stays, with its velocities", list(surface.modifiers))

    change(two / "shot.json", lambda data: outputs(data, ("mesh", "ply")))
    sheet = imported(two)
    places = point_cache(two / "sheet/flag.pc2")[1]
    check(np.array_equal(vectors(at_frame(sheet, FRAME), "position"), places[-1]), "a sheet as meshes is where its cache has it")
    check([each.name for each in evaluated(sheet).materials] == ["Cloth"], "a sheet as meshes is cloth")
    check("velocity" in evaluated(sheet).attributes, "and has velocities")

    thick = synthetic.write_shot(folder / "thick")
    for text, wanted_name in (("0.5", "Water"), ("30.0", "Honey"), ('"2500 mPa·s"', "Honey"), ("[1]", "Water"), ("{}", "Water")):
        (thick.parent / "preset.toml").write_text(f"[liquid.viscosity]\ndynamic = {text}\n", encoding="utf-8")
        found = [each.name for each in imported(thick.parent).data.materials]
        check(found == [wanted_name], f"a liquid of {text} Pa·s is {wanted_name}", found)
    own = '[liquid.viscosity]\ndynamic = 0.001\n[[liquid.source]]\n[[liquid.emitter]]\nviscosity = "0.5 Pa·s"\n[[liquid.emitter]]\nviscosity = "0.02 kPa·s"\n'
    for text, wanted_name in ((own, "Honey"), ("liquid = 3\n", "Water"), ("[liquid]\nsource = 1\nviscosity = [2]\n", "Water")):
        (thick.parent / "preset.toml").write_text(text, encoding="utf-8")
        found = [each.name for each in imported(thick.parent).data.materials]
        check(found == [wanted_name], f"the thickest source decides: {wanted_name}", found)


def check_level_set_velocities(mesh: bpy.types.Mesh, table: dict[str, np.ndarray]) -> None:
    """The surface of a level set has the velocities of the volume, which are near those of the mesh."""
    found, wanted = vectors(mesh, "velocity"), columns(table, "vx vy vz")
    places, own = vectors(mesh, "position")[::50], columns(table, "x y z")
    nearest = [int(np.argmin(((own - place) ** 2).sum(1))) for place in places]
    errors = np.linalg.norm(found[::50] - wanted[nearest], axis=1)
    speed = float(np.linalg.norm(wanted, axis=1).mean())
    check(float(np.median(errors)) < 0.15 * speed, "level set: it has the velocities of the liquid", (float(np.median(errors)), speed))


def volume(points: np.ndarray, triangles: np.ndarray) -> float:
    """Signed volume within a closed surface."""
    a, b, c = (points[triangles[:, corner]].astype(np.float64) for corner in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


def stage_reload(folder: Path) -> None:
    """A shot that grew is read again, what the artist did stays; paths follow the .blend when it is saved elsewhere."""
    use_addon()
    solid = synthetic.write_colliders(folder / "shots/one")
    full = solid.read_text(encoding="utf-8")

    def until(last: int) -> None:
        data = json.loads(full)
        data["frames"]["last"] = last
        for output in data["outputs"][:1]:
            output["frames"]["last"] = last
        solid.write_text(json.dumps(data), encoding="utf-8")

    until(9)
    shown = imported(solid.parent)
    nodes = harness_module("nodes")
    liquid = bpy.context.scene.objects["liquid"]
    files = lambda: nodes.get_input(liquid.modifiers[0], "Files")  # noqa: E731
    check(os.path.isabs(files()), "without a .blend paths are absolute", files())
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "scene.blend"))
    check(files() == "//shots/one/mesh/liquid_{:04}.ply", "they become relative when it is saved", files())
    os.makedirs(folder / "deeper/still")
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "deeper/still/copy.blend"), copy=True)
    check(files() == "//shots/one/mesh/liquid_{:04}.ply", "a copy leaves them as they are", files())
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "deeper/still/scene.blend"))
    check(files() == "//../../shots/one/mesh/liquid_{:04}.ply", "they follow the .blend to another folder", files())
    bpy.ops.wm.open_mainfile(filepath=str(folder / "deeper/still/copy.blend"))
    liquid = bpy.context.scene.objects["liquid"]
    check(files() == "//../../shots/one/mesh/liquid_{:04}.ply", "those of the copy are its own", files())
    bpy.ops.wm.open_mainfile(filepath=str(folder / "deeper/still/scene.blend"))

    scene = bpy.context.scene
    liquid, paddle = scene.objects["liquid"], scene.objects["paddle"]
    liquid.name, paddle.name = "Sea", "Oar"
    own = bpy.data.materials.new("Own")
    nodes.set_inputs(liquid.modifiers[0], {"Material": own})
    paddle.data.materials[0] = own
    motion = solid.parent / "collider/paddle.json"
    data = json.loads(motion.read_text(encoding="utf-8"))
    data["poses"] = [[9.0, *pose[1:]] for pose in data["poses"]]
    motion.write_text(json.dumps(data), encoding="utf-8")
    (solid.parent / "mesh/liquid_0012.ply").unlink()
    (solid.parent / "mesh/liquid_0014.ply").unlink()
    until(16)
    count = len(scene.objects)
    check(bpy.ops.import_scene.meniscus_reload() == {"FINISHED"}, "a shot is reloaded")
    check(nodes.get_input(liquid.modifiers[0], "Last") == 16, "it shows the frames that it has now")
    check(len(scene.objects) == count and liquid.name == "Sea" and paddle.name == "Oar", "objects stay, with their names")
    check(nodes.get_input(liquid.modifiers[0], "Material") == own and paddle.data.materials[0] == own, "and their materials")
    scene.frame_set(5)
    check(abs(paddle.matrix_world.to_translation()[0] - 9.0) < 1e-5, "a collider moves as it does now", paddle.matrix_world.to_translation())
    expect("liquid: 2 of 16 files missing, first ")
    expect("Until then these frames are empty: 12, 14")
    change(solid, lambda data: outputs(data, ("mesh", "ply"), ("collider", "json")))
    bpy.ops.import_scene.meniscus_reload()
    expect("liquid_points: no longer in the shot")
    solid.unlink()
    try:
        bpy.ops.import_scene.meniscus_reload()
        check(False, "a shot that is gone is refused")
    except RuntimeError as error:
        check("shot.json" in str(error), "a shot that is gone is refused", error)


def stage_clouds(folder: Path) -> None:
    """Mist, tracers, and volumes that are written again under the same names: of the shots of the stages before."""
    use_addon()
    scene, clouds = bpy.context.scene, folder / "clouds"
    run_engine("whitewater", folder / "one", "-o", clouds / "mist", "--set", 'whitewater.files=["vdb"]', "--progress", "none")
    mist = imported(clouds / "mist")
    check(mist.type == "VOLUME" and not mist.hide_render, "mist is a volume", mist.type)
    material = mist.data.materials[0]
    grids = {node.attribute_name for node in material.node_tree.nodes if node.bl_idname == "ShaderNodeAttribute"}
    check(material.name == "Mist" and grids == {"spray", "foam", "bubbles"}, "its material is as dense as the sum of its grids", (material.name, grids))
    scene.frame_set(FRAME)
    loaded = evaluated(mist).grids
    check(loaded.load() and {each.name for each in loaded} == grids, "its file has them", [each.name for each in loaded])
    run_engine("whitewater", folder / "one", "-o", clouds / "both", "--set", 'whitewater.files=["vdb", "ply"]', "--progress", "none")
    imported(clouds / "both")
    hidden = scene.objects["whitewater_volume"]
    check(hidden.type == "VOLUME" and hidden.hide_render and hidden.hide_viewport, "mist is hidden where points show the same")
    check_tracers(folder, clouds)
    check_rewritten(folder, clouds)


def run_engine(*arguments: object) -> None:
    run = subprocess.run([os.environ["MENISCUS"], *map(str, arguments)], capture_output=True, text=True)
    check(run.returncode == 0, f"the engine makes {arguments[0]}", run.stderr[-1000:])


def check_tracers(folder: Path, clouds: Path) -> None:
    """Tracers of smoke are points with their radius and velocity; hidden where a volume shows the same."""
    run_engine("export", folder / "two", "-o", clouds / "tracers", "--progress", "none")
    change(clouds / "tracers/shot.json", lambda data: outputs(data, ("points", "ply")))
    shown = imported(clouds / "tracers")
    table = read_points(clouds / f"tracers/points/smoke_{FRAME:04}.ply")
    bpy.context.scene.frame_set(FRAME)
    points = cloud(shown)
    check(len(table["x"]) > 0 and np.array_equal(points["radius"], table["radius"]), "tracers have the radius of their file", len(points["radius"]))
    check(np.array_equal(points["velocity"], columns(table, "vx vy vz")), "and its velocities")
    check([each.name for each in shown.data.materials] == ["Tracers"] and not shown.hide_render, "their material is Tracers", list(shown.data.materials))
    for part in ("points", "volume"):
        source = clouds / "tracers" if part == "points" else folder / "two"
        shutil.copytree(source / part, clouds / "smoke" / part)
    data = json.loads((folder / "two/shot.json").read_text(encoding="utf-8"))
    data["outputs"] = [each for each in data["outputs"] if each["kind"] == "volume"]
    data["outputs"] += json.loads((clouds / "tracers/shot.json").read_text(encoding="utf-8"))["outputs"]
    (clouds / "smoke/shot.json").write_text(json.dumps(data), encoding="utf-8")
    before = set(bpy.context.scene.objects)
    imported(clouds / "smoke")
    made = {each.type: each for each in set(bpy.context.scene.objects) - before}
    check(made["MESH"].hide_render and not made["VOLUME"].hide_render, "tracers are hidden where a volume shows the same")


def check_rewritten(folder: Path, clouds: Path) -> None:
    """A sequence of volumes that grew keeps its object at a reload; files that were rewritten are reported, since Blender keeps what it read."""
    shot = clouds / "grown"
    shutil.copytree(folder / "two/volume", shot / "volume")
    full = json.loads((folder / "two/shot.json").read_text(encoding="utf-8"))
    outputs(full, ("volume", "vdb"))

    def until(last: int) -> None:
        data = json.loads(json.dumps(full))
        for each in (data, *data["outputs"]):
            each["frames"]["last"] = last
        (shot / "shot.json").write_text(json.dumps(data), encoding="utf-8")

    until(2)
    scene = bpy.context.scene
    smoke = imported(shot)
    smoke.name, smoke.location.x = "Fog", 0.5
    own = bpy.data.materials.new("Own")
    smoke.data.materials[0] = own
    until(FRAME)
    check(bpy.ops.import_scene.meniscus_reload() == {"FINISHED"}, "volumes are reloaded")
    scene.frame_set(FRAME)
    name = Path(evaluated(smoke).grids.frame_filepath).name
    check(smoke.name == "Fog" and smoke.data.frame_duration == FRAME and name == f"smoke_{FRAME:04}.vdb", "the same object shows the new frames", name)
    check(smoke.data.materials[0] == own and smoke.data.velocity_grid == "velocity", "with its own material, and velocities", smoke.data.velocity_grid)
    volumes = harness_module("volumes")
    output = next(iter(harness_module("shot").read_shot(shot).volumes))
    check(volumes.rewritten(output, str(shot), range(1, FRAME + 1)) is None, "files that stayed are not reported")
    shutil.copyfile(shot / "volume/smoke_0003.vdb", shot / "volume/smoke_0002.vdb")
    check(volumes.rewritten(output, str(shot), range(1, FRAME + 1)) is not None, "a file that was rewritten is found")
    bpy.ops.import_scene.meniscus_reload()
    expect("smoke: its files were rewritten, and Blender keeps what it has read of volumes until it is closed")
    # Also those of a file that was opened, which no import has seen.
    bpy.ops.wm.save_as_mainfile(filepath=str(clouds / "grown.blend"))
    volumes.times.clear()
    bpy.ops.wm.open_mainfile(filepath=str(clouds / "grown.blend"))
    shutil.copyfile(shot / "volume/smoke_0004.vdb", shot / "volume/smoke_0002.vdb")
    check(volumes.rewritten(output, str(shot), range(1, FRAME + 1)) is not None, "a file of an opened scene that was rewritten is found")


if __name__ == "__main__":
    harness.run(globals())
