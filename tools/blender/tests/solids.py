# SPDX-License-Identifier: MIT OR Apache-2.0
"""Colliders, droplets, camera, ground and light inside Blender; run.py starts each stage in a process of its own.

Poses are compared with the motion files by quaternion arithmetic of their own.
"""

import json
import subprocess
import sys
from pathlib import Path

import bpy
import numpy as np

import harness
import ply
import synthetic
from harness import ADDON, change, check, expect, forbid, imported, refused, use_addon


def turned(points: np.ndarray, pose: list[float]) -> np.ndarray:
    """R x + p of a pose: v + 2 u x (u x v + w v) for a quaternion (w, u)."""
    place, w, u = np.array(pose[:3]), pose[3], np.array(pose[4:])
    return points + 2.0 * np.cross(u, np.cross(u, points) + w * points) + place


def in_world(shown: bpy.types.Object) -> np.ndarray:
    """Vertices of an object in the current frame."""
    graph = bpy.context.evaluated_depsgraph_get()
    made = shown.evaluated_get(graph)
    points = np.empty(3 * len(made.data.vertices), np.float32)
    made.data.vertices.foreach_get("co", points)
    place = np.array(made.matrix_world)
    return points.reshape(-1, 3) @ place[:3, :3].T + place[:3, 3]


def check_poses(shot: Path) -> None:
    """Every collider is where its motion file puts it, in each frame from before the first to after the last."""
    scene, data = bpy.context.scene, json.loads((shot / "shot.json").read_text(encoding="utf-8"))
    for output in (output for output in data["outputs"] if output["kind"] == "collider"):
        shown, motion = bpy.data.objects[output["name"]], json.loads((shot / output["pattern"]).read_text(encoding="utf-8"))
        table, _ = ply.read(shot / output["rest"])
        rest = np.stack([table[name] for name in "xyz"], axis=1).astype(float)
        poses, worst = motion["poses"], 0.0
        numbers = range(motion["first"] - 2, motion["first"] + len(poses) + 2)
        for frame in numbers:
            scene.frame_set(frame)
            wanted = turned(rest, poses[min(max(frame - motion["first"], 0), len(poses) - 1)])
            worst = max(worst, float(np.abs(in_world(shown) - wanted).max()))
        size = float(np.abs(rest).max())
        check(worst < 1e-5 * max(size, 1.0), f"{shown.name} is where its file puts it in {len(numbers)} frames", worst)


def stage_colliders(work: Path) -> None:
    """Colliders have their motion, materials and looks; droplets are points of their radius."""
    use_addon()
    path = synthetic.write_colliders(work)
    surface = imported(path.parent, studio=True)
    paddle, bowl, ghost = (bpy.data.objects[name] for name in ("paddle", "bowl", "ghost"))
    check(ghost.hide_viewport and ghost.hide_render and not paddle.hide_render, "a hidden collider is neither shown nor rendered")
    ghost.hide_viewport = False
    check_poses(work)
    check([m.name for m in bowl.data.materials] == ["Glass"], "a look of glass has the glass material")
    check([m.name for m in paddle.data.materials] == ["Collider"], "a matte look has the plain material")
    scene = bpy.context.scene
    scene.frame_set(3, subframe=0.5)
    first, second = synthetic.poses(2, 14)[1:3]
    between = in_world(paddle).mean(axis=0) - (np.array(first[:3]) + second[:3]) / 2.0
    check(np.abs(between).max() < 1e-5, "between two frames a collider is in the middle", between)
    expect("Info: Synthetic: 1 mesh sequence(s), 1 point sequence(s), 3 collider(s), 32 frames, paths absolute")

    drops = bpy.data.objects["liquid_points"]
    scene.frame_set(2)
    graph = bpy.context.evaluated_depsgraph_get()
    geometry = drops.evaluated_get(graph).evaluated_geometry()
    cloud = geometry.pointcloud
    check(cloud is not None and len(cloud.points) == 2, "droplets are a point cloud")
    radii = [round(point.radius, 6) for point in cloud.points]
    check(radii == [0.03, 0.05], "a droplet has its radius", radii)
    velocity = [tuple(value.vector) for value in cloud.attributes["velocity"].data]
    check(velocity == [(6.0, 0.0, 0.0), (0.0, 0.0, 0.0)], "droplets have their velocities", velocity)

    # A shutter of one frame smears the paddle, whose velocity no attribute holds.
    for other in (surface, bowl, ghost, drops):
        other.hide_render = True
    for other in scene.objects:
        other.hide_render |= other.type == "MESH" and other != paddle
    scene.frame_set(8)
    render = scene.render
    check(render.engine == "CYCLES" and render.use_motion_blur, "the engine blurs motion", render.engine)
    render.resolution_x, render.resolution_y, render.film_transparent = 160, 90, True
    render.image_settings.file_format, render.image_settings.color_mode = "OPEN_EXR", "RGBA"
    scene.cycles.samples, scene.cycles.use_denoising, render.motion_blur_shutter = 64, False, 1.0
    covered = []
    for blur in (False, True):
        render.use_motion_blur, render.filepath = blur, str(work / f"blur{blur}.exr")
        bpy.ops.render.render(write_still=True)
        image = bpy.data.images.load(render.filepath)
        pixels = np.empty(4 * 160 * 90, np.float32)
        image.pixels.foreach_get(pixels)
        covered.append(int((pixels[3::4] > 0.02).sum()))
    check(covered[1] > 1.1 * covered[0] > 0, "a moving collider is blurred", covered)


def stage_deforming(work: Path) -> None:
    """A collider that deforms has its vertices, size and pose in every frame; files that do not belong together are refused."""
    use_addon()
    path = synthetic.write_deforming(work / "shot")
    imported(path.parent, studio=False)
    blob, scene, (first, last) = bpy.data.objects["blob"], bpy.context.scene, (3, 9)
    directions, _ = synthetic.icosphere(2)
    poses, sizes = synthetic.poses(first, last), synthetic.sizes(first, last)
    worst = 0.0
    for frame in range(first - 2, last + 3):
        scene.frame_set(frame)
        held = min(max(frame, first), last)
        own = sizes[held - first] * synthetic.stretched(directions, first, held)
        worst = max(worst, float(np.abs(in_world(blob) - turned(own, poses[held - first])).max()))
    check(worst < 1e-5, "a collider that deforms is where its files put it", worst)

    cache, motion = path.parent / "collider" / "blob.pc2", path.parent / "collider" / "blob.json"
    sound, text = cache.read_bytes(), motion.read_text(encoding="utf-8")
    cache.write_bytes(sound[:-4])
    refused("a short point cache", path, str(cache), "expected")
    cache.write_bytes(sound[:16] + (7).to_bytes(4, "little") + sound[20:])
    refused("a point cache of other points", path, str(cache), "7 points")
    cache.unlink()
    refused("no point cache", path, "blob.pc2 is missing", "`meniscus shot`")
    cache.write_bytes(sound)
    edits = {"point_cache_frames": [3], "scales": [1.0], "too far": {"point_cache_frames": [0, 2**31 - 1]}}
    for name, value in edits.items():
        change_to = value if isinstance(value, dict) else {name: value}
        motion.write_text(json.dumps(json.loads(text) | change_to), encoding="utf-8")
        refused(f"motion: {name}", path, str(motion), "`meniscus shot`")
    lone = {key: value for key, value in json.loads(text).items() if key != "point_cache_frames"}
    motion.write_text(json.dumps(lone), encoding="utf-8")
    refused("a point cache that the motion does not know", path, str(motion), "one of two files")
    motion.write_text(text, encoding="utf-8")
    change(path, lambda d: d["outputs"][-1].update(point_cache="../blob.pc2"))
    refused("a point cache elsewhere", path, "../blob.pc2", "inside the shot folder")


# Name and edit of an object of the startup file, each in a field of its own.
STARTUP_EDITS = {
    "Cube": {
        "rotation": lambda cube: setattr(cube, "rotation_euler", (0.0, 0.0, 0.3)),
        "quaternion": lambda cube: (setattr(cube, "rotation_mode", "QUATERNION"), setattr(cube, "rotation_quaternion", (0, 0, 0, 1))),
        "faces": lambda cube: remove_face(cube.data),
        "colour": lambda cube: set_shader(cube, "Base Color", (0.8, 0.1, 0.1, 1.0)),
        "roughness": lambda cube: set_shader(cube, "Roughness", 0.1),
        "material": lambda cube: cube.data.materials.clear(),
        "second material": lambda cube: cube.data.materials.append(bpy.data.materials.new("Other")),
        "material name": lambda cube: setattr(cube.data.materials[0], "name", "Marble"),
        "material property": lambda cube: cube.data.materials[0].__setitem__("note", 1),
        "node": lambda cube: cube.data.materials[0].node_tree.nodes.new("ShaderNodeTexBrick"),
        "property": lambda cube: cube.__setitem__("note", 1),
        "mesh property": lambda cube: cube.data.__setitem__("note", 1),
        "scene": lambda cube: bpy.data.scenes.new("Other").collection.objects.link(cube),
        "collection": lambda cube: bpy.data.collections.new("Other").objects.link(cube),
    },
    "Light": {
        "rotation": lambda light: setattr(light.rotation_euler, "x", 1.0),
        "colour": lambda light: setattr(light.data, "color", (1.0, 0.5, 0.2)),
        "radius": lambda light: setattr(light.data, "shadow_soft_size", 0.5),
        "property": lambda light: light.__setitem__("note", 1),
        "scene": lambda light: bpy.data.scenes.new("Other").collection.objects.link(light),
    },
    "Camera": {
        "rotation": lambda camera: setattr(camera.rotation_euler, "z", 1.0),
        "depth of field": lambda camera: setattr(camera.data.dof, "use_dof", True),
        "sensor": lambda camera: setattr(camera.data, "sensor_width", 24.0),
        "sensor fit": lambda camera: setattr(camera.data, "sensor_fit", "VERTICAL"),
        "shift x": lambda camera: setattr(camera.data, "shift_x", 0.1),
        "shift y": lambda camera: setattr(camera.data, "shift_y", 0.1),
        "clip start": lambda camera: setattr(camera.data, "clip_start", 0.01),
        "clip end": lambda camera: setattr(camera.data, "clip_end", 1000.0),
        "property": lambda camera: camera.data.__setitem__("note", 1),
        "scene": lambda camera: setattr(bpy.data.scenes.new("Other"), "camera", camera),
    },
}


def set_shader(cube: bpy.types.Object, name: str, value: object) -> None:
    nodes = cube.data.materials[0].node_tree.nodes
    next(node for node in nodes if node.type == "BSDF_PRINCIPLED").inputs[name].default_value = value


def remove_face(mesh: bpy.types.Mesh) -> None:
    points = [tuple(vertex.co) for vertex in mesh.vertices]
    faces = [tuple(face.vertices) for face in mesh.polygons][:-1]
    mesh.clear_geometry()
    mesh.from_pydata(points, [], faces)


def startup() -> None:
    """Blender's startup file with the add-on switched on."""
    bpy.ops.wm.read_factory_settings()
    bpy.ops.preferences.addon_enable(module=ADDON)


def stage_startup(work: Path) -> None:
    """An object of the startup file stays when any field of it was changed, and all stay if the shot has nothing to frame."""
    path = synthetic.write_shot(work / "shot", last=2, empty=())
    for name, edits in STARTUP_EDITS.items():
        for field, edit in edits.items():
            startup()
            edit(bpy.data.objects[name])
            imported(path.parent, studio=True)
            left = {"Cube", "Light"} & set(bpy.data.objects.keys())
            # The camera that the import adds has the same name.
            left |= {"Camera"} if "meniscus_studio" not in bpy.context.scene.camera else set()
            check(left == {name}, f"{name} stays after a change of its {field}, the others do not", left)
    startup()
    check(bpy.data.objects["Light"].data.cycles.max_bounces > 0, "the lamp has settings of Cycles")
    imported(path.parent, studio=True)
    check("Light" not in bpy.data.objects, "a lamp whose Cycles panel was shown is unchanged")
    empty = synthetic.write_shot(work / "empty", last=2, empty=(1, 2))
    startup()
    imported(empty.parent, studio=True)
    names = set(bpy.data.objects.keys())
    check({"Cube", "Light", "Camera"} <= names, "a shot without vertices removes nothing", names)
    expect("added no camera and light, since no frame that was looked at has vertices")


def write_solid(path: Path, shape: str, look: str, poses: list[list[float]], points: list, faces: list) -> None:
    """Replaces the hidden ball of the synthetic shot by another collider."""
    ply.write(path.parent / "collider" / "ghost.ply", dict(zip("xyz", np.array(points, float).T)), np.array(faces))
    motion = {"format": "meniscus-motion", "version": 1, "shape": shape, "look": look, "first": 1, "poses": poses}
    (path.parent / "collider" / "ghost.json").write_text(json.dumps(motion), encoding="utf-8")
    frames = {"first": 1, "last": len(poses), "step": 1}
    change(path, lambda d: next(o for o in d["outputs"] if o["name"] == "ghost").update(frames=frames))


def stage_floors(work: Path) -> None:
    """Only a visible plane at rest that faces upwards is the floor, and hidden colliders move neither ground nor camera."""
    path = synthetic.write_colliders(work)

    def views() -> tuple[float | None, np.ndarray]:
        """Height of the ground, and place of the camera."""
        startup()
        imported(path.parent, studio=True)
        bpy.context.view_layer.update()
        made = [o for o in bpy.data.objects if o.get("meniscus_studio") == "ground"]
        return made[0].location.z if made else None, np.array(bpy.context.scene.camera.location)

    still, half = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], 0.5**0.5
    square = [(-20, -20, 0), (20, -20, 0), (20, 20, 0), (-20, 20, 0)]
    faces = [(0, 1, 2), (0, 2, 3)]
    height, place = views()
    wall = [(z, x, y) for x, y, z in square]
    lower = [*still[:2], -0.1, *still[3:]]
    for name, look, poses, points, is_floor in (
        ("a floor", "matte", [still], square, True),
        ("a floor with equal poses", "matte", [still, still], square, True),
        ("a wall turned to a floor", "matte", [[0.0, 0.0, 0.0, half, 0.0, -half, 0.0]], wall, True),
        ("a wall", "matte", [still], wall, False),
        ("a floor turned to a wall", "matte", [[0.0, 0.0, 0.0, half, 0.0, half, 0.0]], square, False),
        ("a ceiling", "matte", [still], square[::-1], False),
        ("a hidden plane", "hidden", [still], square, False),
        ("a plane that moves", "matte", [still, lower], square, False),
    ):
        write_solid(path, "plane", look, poses, points, faces)
        found, seen = views()
        text = "is the floor" if is_floor else "leaves the ground that the import adds"
        check(found == (None if is_floor else height), f"{name} {text}", found)
        check(np.allclose(seen, place, atol=1e-5), f"{name} does not move the camera", (seen, place))
    box = [(x, y, z) for z in (-1, 0) for x, y, _ in square]
    deep = [0.0, 0.0, -3.0, *still[3:]]
    for look, expected in (("hidden", height), ("matte", -4.0)):
        write_solid(path, "box", look, [deep], box, [*faces, (4, 5, 6), (4, 6, 7)])
        found, seen = views()
        check(abs(found - expected) < 1e-5, f"the ground below a {look} box is at {expected:.2f} m", found)
        check(np.allclose(seen, place, atol=1e-5), f"a wide {look} box does not move the camera", (seen, place))
    small = [(x, y, z) for z in (-1, 0) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    for look in ("hidden", "matte"):
        write_solid(path, "box", look, [deep], small, [*faces, (4, 5, 6), (4, 6, 7)])
        found, seen = views()
        check(abs(found - height) < 1e-5, f"a small {look} box does not lower the ground", found)
        moves = not np.allclose(seen, place, atol=1e-3)
        check(moves == (look == "matte"), f"only a visible box belongs to the picture: {look}", (seen, place))


def stage_studio(work: Path) -> None:
    """Blender's own scene loses its cube, and gets camera, ground and light; what a user made stays."""
    path = synthetic.write_colliders(work / "own")
    startup()
    cube = [o.name for o in bpy.data.objects]
    check(sorted(cube) == ["Camera", "Cube", "Light"], "the startup file has its cube, lamp and camera", cube)
    imported(path.parent, studio=True)
    names = set(bpy.data.objects.keys())
    check("Cube" not in names and "Light" not in names, "the cube and the lamp are gone", names)
    check({"Ground", "Sun", "Soft Light", "Camera"} <= names, "ground, light and camera are there", names)
    expect("removed Blender's own Cube, Light, Camera, which had not been changed")
    expect("added ground, light, camera")
    camera = bpy.context.scene.camera
    wide = in_picture(*(bpy.data.objects[name] for name in ("liquid", "paddle", "bowl")))
    check(0.5 < wide <= 1.0, "the shot is at least half as wide as the picture, and inside", wide)

    startup()
    bpy.data.objects["Cube"].location.x = 3.0
    bpy.data.objects["Camera"].location.x += 0.5
    camera = bpy.context.scene.camera
    imported(path.parent, studio=True)
    names = set(bpy.data.objects.keys())
    check("Cube" in names and bpy.context.scene.camera == camera, "a cube and a camera that were moved stay", names)
    check("Light" not in names, "the lamp, which was not changed, is replaced", names)

    startup()
    imported(path.parent, studio=False, engine="KEEP")
    names = set(bpy.data.objects.keys())
    check({"Cube", "Camera", "Light"} <= names and "Ground" not in names, "without the option nothing is added", names)
    check("EEVEE" in bpy.context.scene.render.engine, "the engine is kept", bpy.context.scene.render.engine)
    startup()
    imported(path.parent, studio=True, engine="EEVEE")
    check("EEVEE" in bpy.context.scene.render.engine, "EEVEE can be chosen", bpy.context.scene.render.engine)
    eevee = bpy.context.scene.render.engine
    bpy.context.scene.name = "Kept Engine"
    imported(path.parent, engine="EEVEE")
    forbid("Info: Render engine of Kept Engine")
    bpy.context.scene.name = "Own"
    imported(path.parent, engine="CYCLES")
    expect(f"Info: Render engine of Own changed from {eevee} to CYCLES")

    startup()
    place = {"position": [0.0, -6.0, 1.0], "target": [0.0, 1.0, 1.0], "focal_length": 35.0}
    change(path, lambda d: d.update(camera=place))
    imported(path.parent, studio=True)
    camera = bpy.context.scene.camera
    bpy.context.view_layer.update()
    toward = -np.array(camera.matrix_world)[:3, 2]
    near = np.allclose(camera.location, place["position"], atol=1e-6) and np.allclose(toward, (0.0, 1.0, 0.0), atol=1e-6)
    check(near and camera.data.lens == 35.0, "the camera is the shot's", (camera.location, toward, camera.data.lens))
    render = bpy.context.scene.render
    for size in ((1920, 1080), (1080, 1920)):
        render.resolution_x, render.resolution_y = size
        corners = camera.data.view_frame(scene=bpy.context.scene)
        slope = max(abs(corner.x / corner.z) for corner in corners)
        check(abs(slope - 18.0 / 35.0) < 1e-5, f"the focal length is for the width of a picture of {size}", slope)
    bad = {"not an object": 5, "no place": {"target": [0, 0, 0], "focal_length": 50}, "far": place | {"position": [0, 0, 1e10]}}
    bad |= {"text": place | {"target": "abc"}, "lens": place | {"focal_length": 0}, "same": place | {"target": place["position"]}}
    for name, value in bad.items():
        change(path, lambda d: d.update(camera=value))
        refused(f"camera: {name}", path, '"camera"', "`meniscus shot`")


def in_picture(*shown: bpy.types.Object) -> float:
    """The part of the picture's width that objects cover in the first and last frame; 2 if they leave the picture."""
    from bpy_extras.object_utils import world_to_camera_view
    from mathutils import Vector

    scene, places = bpy.context.scene, []
    for frame in (scene.frame_start, scene.frame_end):
        scene.frame_set(frame)
        for made in shown:
            places += [world_to_camera_view(scene, scene.camera, Vector(x)) for x in in_world(made)[::7]]
    x, y = np.array([p.x for p in places]), np.array([p.y for p in places])
    inside = min(x.min(), y.min()) >= 0.0 and max(x.max(), y.max()) <= 1.0
    return max(float(np.ptp(x)), float(np.ptp(y))) if inside else 2.0


def stage_pictures(work: Path) -> None:
    """render.py renders the frames that are requested; complete pictures are kept."""
    shot = synthetic.write_shot(work / "shot").parent
    (work / "pictures").mkdir()
    pattern = work / "pictures" / "##.png"

    def render(frames: str, pattern: Path) -> subprocess.CompletedProcess:
        given = [shot, "--frame", frames, "-o", pattern, "--samples", 1, "--size", "32x18", "--sharp"]
        command = [sys.executable, Path(__file__).resolve().parent.parent / "render.py", *given]
        return subprocess.run(list(map(str, command)), capture_output=True, text=True)

    first, kept = pattern.with_name("01.png"), b"not a picture"
    first.write_bytes(kept)
    done = render("1-5x4", pattern)
    names = sorted(file.name for file in first.parent.iterdir())
    check(done.returncode == 0 and names == ["01.png", "05.png"], "two of five frames are rendered", f"{names}: {done.stderr}")
    check(first.read_bytes() == kept, "a picture that is there is kept")
    check(pattern.with_name("05.png").read_bytes()[:4] == b"\x89PNG", "a picture is a PNG")
    for frames, output, wanted in (("1-9", pattern, "frame 6 is not in the shot"), ("1-2", first, "expected a #"), ("5-1", pattern, "5-1")):
        done = render(frames, output)
        check(done.returncode != 0 and wanted in done.stderr, f"frames {frames} in {output.name} are refused", done.stderr)


def stage_motions(work: Path) -> None:
    """Damaged and malicious motion files are refused with one line."""
    use_addon()
    path = synthetic.write_colliders(work / "shot")
    file = path.parent / "collider" / "paddle.json"
    sound = file.read_text(encoding="utf-8")
    still = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
    cases = {"empty": "", "no JSON": "[" * 100_000, "a list": "[]", "nothing": "{}"}
    edits = {"version": 2, "shape": "cone", "look": ["glass"], "first": -1, "poses": [], "format": None}
    cases |= {key: json.dumps(json.loads(sound) | {key: value}) for key, value in edits.items()}
    poses = {"six": still[:6], "text": [*still[:6], "0"], "truth": [True, *still[1:]], "far": [1e10, *still[1:]], "zero": [0.0] * 7}
    cases |= {f"pose: {key}": json.dumps(json.loads(sound) | {"poses": [still, pose]}) for key, pose in poses.items()}
    cases["pose: NaN"] = sound.replace("0.5", "NaN", 1)
    cases["pose: 1e999"] = sound.replace("0.5", "1e999", 1)
    cases["huge"] = sound + " " * (33 << 20)
    cases["first"] = json.dumps(json.loads(sound) | {"first": 2**40})
    for name, text in cases.items():
        file.write_text(text, encoding="utf-8")
        refused(f"motion: {name}", path, str(file), "`meniscus shot`" if name != "version" else "Install the add-on")
    file.unlink()
    refused("no motion", path, "paddle.json is missing", "`meniscus shot`")
    (work / "other.json").write_text(sound, encoding="utf-8")
    file.symlink_to(work / "other.json")
    refused("a link for a motion", path, str(file), "leads out of the shot folder")
    file.unlink()
    file.write_text(sound, encoding="utf-8")
    for key, value in {"pattern": "../paddle.json", "rest": "/paddle.ply"}.items():
        other = synthetic.write_colliders(work / key)
        change(other, lambda d: d["outputs"][1].update({key: value}))
        refused(f"a {key} elsewhere", other, value, "inside the shot folder")
    mesh = path.parent / "collider" / "bowl.ply"
    mesh.write_bytes(mesh.read_bytes()[:-1])
    refused("a damaged mesh", path, str(mesh), "expected")


if __name__ == "__main__":
    harness.run(globals())
