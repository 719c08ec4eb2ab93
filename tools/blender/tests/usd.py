# SPDX-License-Identifier: MIT OR Apache-2.0
"""Tests that Blender's own USD importer plays the stages that `meniscus usd` writes.

    MENISCUS=target/debug/meniscus python tools/blender/tests/usd.py SHOT_DIR [SHEET_DIR [COLLIDER_DIR]]

The interpreter needs bpy and numpy. SHOT_DIR is a shot with PLY meshes; of SHEET_DIR a sheet and of COLLIDER_DIR a collider is
compared too. The folders are not written: stages go to a temporary one. The last line is `N passed, N failed`.
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import bpy
import numpy as np

sys.path[:0] = [str(Path(__file__).resolve().parent)]
import ply  # noqa: E402

MENISCUS = os.environ["MENISCUS"]
passed = failed = 0


def check(good: bool, name: str, detail: object = "") -> None:
    global passed, failed
    passed += bool(good)
    failed += not good
    print(f"ok   {name}" if good else f"FAIL {name}: {detail}", flush=True)


def run(*words: object) -> None:
    subprocess.run([MENISCUS, *map(str, words), "--progress", "none"], check=True, stdout=subprocess.DEVNULL)


def imported(stage: Path) -> None:
    bpy.ops.wm.read_factory_settings(use_empty=True)
    result = bpy.ops.wm.usd_import(filepath=str(stage))
    check(result == {"FINISHED"}, f"{stage.parent.parent.name} is imported", result)


def evaluated(name: str, frame: int) -> bpy.types.Mesh:
    bpy.context.scene.frame_set(frame)
    return bpy.data.objects[name].evaluated_get(bpy.context.evaluated_depsgraph_get()).data


def vectors(attribute: bpy.types.Attribute) -> np.ndarray:
    values = np.empty(3 * len(attribute.data), "f4")
    attribute.data.foreach_get("vector", values)
    return values.reshape(-1, 3)


def columns(found: dict[str, np.ndarray], *names: str) -> np.ndarray:
    return np.stack([found[name] for name in names], 1)


def test_shot(shot: Path, work: Path) -> None:
    """Meshes of changing topology, their velocities and the camera."""
    manifest = json.loads((shot / "shot.json").read_text())
    output = next(o for o in manifest["outputs"] if o["kind"] == "mesh" and o["format"] == "ply")
    frames = [output["frames"]["first"], output["frames"]["last"]]
    for options in (), ("--up", "y", "--scale", "100", "--names", "houdini"):
        run("usd", shot, "-o", work, "--force", *options)
        imported(work / "usd/shot.usda")
        scene = bpy.context.scene
        check([scene.frame_start, scene.frame_end] == frames, "the range of frames is the shot's", scene.frame_end)
        check(abs(scene.render.fps / scene.render.fps_base - manifest["fps"]) < 1e-6, "frames a second are the shot's")
        name = output["name"]
        # Counts differ, so that an importer which keeps the first mesh fails.
        counts, fastest = set(), 0.0
        for frame in reversed(frames):
            expected, triangles = ply.read(shot / output["pattern"].format(frame))
            mesh = evaluated(name, frame)
            counts.add(len(mesh.vertices))
            same = len(mesh.vertices) == len(expected["x"]) and len(mesh.polygons) == len(triangles)
            check(same, f"frame {frame} has the mesh of its file", (len(mesh.vertices), len(expected["x"])))
            corners = np.empty(3 * len(mesh.polygons), "i4")
            mesh.loops.foreach_get("vertex_index", corners)
            check((corners == triangles.ravel().astype("i4")).all(), "corners are those of the file")
            places = vectors(mesh.attributes["position"])
            turn = bpy.data.objects[name].matrix_world
            world = places @ np.array(turn.to_3x3(), "f8").T + np.array(turn.translation)
            off = np.abs(world - columns(expected, "x", "y", "z")).max()
            check(off < 1e-5, f"{options}: places in the world are those of the file", off)
            found = vectors(mesh.attributes["velocity"]) @ np.array(turn.to_3x3(), "f8").T
            velocity = columns(expected, "vx", "vy", "vz")
            off = np.abs(found - velocity).max()
            check(off < 1e-4, f"{options}: velocities are those of the file", off)
            fastest = max(fastest, np.abs(velocity).max())
        check(len(counts) == 2, "the number of vertices changes", counts)
        check(fastest > 0.1, "something moves", fastest)
        compare_camera(manifest["camera"])


def compare_camera(expected: dict) -> None:
    camera = next(shown for shown in bpy.data.objects if shown.type == "CAMERA")
    lens = camera.data.lens / camera.data.sensor_width * 36.0
    check(abs(lens - expected["focal_length"]) < 1e-3, "the focal length is the preset's", lens)
    check(abs(camera.data.sensor_width - 36.0) < 1e-3, "the film is 36 mm wide", camera.data.sensor_width)
    matrix = np.array(camera.matrix_world, "f8")
    place, target = np.array(expected["position"]), np.array(expected["target"])
    check(np.abs(matrix[:3, 3] - place).max() < 1e-4, "the camera is at its place", matrix[:3, 3])
    view = -matrix[:3, 2] / np.linalg.norm(matrix[:3, 2])
    wanted = (target - place) / np.linalg.norm(target - place)
    check(np.abs(view - wanted).max() < 1e-5, "the camera looks at its target", view)
    check(abs(matrix[2, 0]) < 1e-6 and matrix[2, 1] > 0.0, "the camera is upright", matrix)


def test_sheet(shot: Path, work: Path) -> None:
    """A sheet has the points of its point cache in each frame."""
    output = next(o for o in json.loads((shot / "shot.json").read_text())["outputs"] if o["format"] == "pc2")
    run("usd", shot, "-o", work)
    imported(work / "usd/shot.usda")
    cache = (shot / output["pattern"]).read_bytes()
    points, samples = np.frombuffer(cache, "<i4", 1, 16)[0], np.frombuffer(cache, "<i4", 1, 28)[0]
    expected = np.frombuffer(cache, "<f4", 3 * points * samples, 32).reshape(samples, points, 3)
    first, last = output["frames"]["first"], output["frames"]["last"]
    for frame in (last, first):
        found = vectors(evaluated(output["name"], frame).attributes["position"])
        off = np.abs(found - expected[frame - first]).max()
        check(off < 1e-6, f"frame {frame} of {output['name']} has the points of its cache", off)
    check(np.abs(expected[-1] - expected[0]).max() > 1e-3, "the sheet moves")


def test_collider(shot: Path, work: Path) -> None:
    """A collider that moves is where its poses are, in each frame."""
    outputs = json.loads((shot / "shot.json").read_text())["outputs"]
    colliders = [(o, json.loads((shot / o["pattern"]).read_text())) for o in outputs if o["kind"] == "collider"]
    run("usd", shot, "-o", work)
    imported(work / "usd/shot.usda")
    moved = 0.0
    for output, motion in colliders:
        shown = bpy.data.objects[output["name"].replace("-", "_")]
        at_rest, _ = ply.read(shot / output["rest"])
        mesh = columns(at_rest, "x", "y", "z").astype("f8")
        for number in {0, len(motion["poses"]) - 1}:
            bpy.context.scene.frame_set(motion["first"] + number)
            x, y, z, w, i, j, k = motion["poses"][number]
            turn = np.array(
                [
                    [1 - 2 * (j * j + k * k), 2 * (i * j - k * w), 2 * (i * k + j * w)],
                    [2 * (i * j + k * w), 1 - 2 * (i * i + k * k), 2 * (j * k - i * w)],
                    [2 * (i * k - j * w), 2 * (j * k + i * w), 1 - 2 * (i * i + j * j)],
                ]
            )
            expected = mesh @ turn.T + [x, y, z]
            graph = bpy.context.evaluated_depsgraph_get()
            solid = shown.evaluated_get(graph)
            found = vectors(solid.data.attributes["position"]) @ np.array(solid.matrix_world.to_3x3(), "f8").T
            found = found + np.array(solid.matrix_world.translation)
            off = np.abs(found - expected).max()
            check(off < 1e-5, f"{output['name']} is where its pose {number} is", off)
            moved = max(moved, np.abs(expected - mesh).max())
    check(moved > 1e-4, "a collider moves", moved)


def write_blob(path: Path, radius: float, center: float, velocity: float, spacing: float) -> None:
    """Particles of a ball on a grid, which all move along x."""
    count = int(radius / spacing) + 1
    axis = spacing * np.arange(-count, count + 1)
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1).reshape(-1, 3)
    ball = grid[np.linalg.norm(grid, axis=1) < radius] + [center, 0.0, 0.0]
    names = ("x", "y", "z", "vx", "vy", "vz")
    rows = np.zeros(len(ball), [(name, "<f4") for name in names])
    for column, name in enumerate(names[:3]):
        rows[name] = ball[:, column]
    rows["vx"] = velocity
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(ball)}\n"
    header += "".join(f"property float {name}\n" for name in names) + "end_header\n"
    path.write_bytes(header.encode() + rows.tobytes())


def test_blur(work: Path) -> None:
    """Motion blur has the length that the velocities give it, although the topology changes."""
    velocity, fps, pixels, extent = 6.0, 24.0, 400, 2.0
    for frame in range(1, 5):
        write_blob(work / f"blob_{frame:04}.ply", 0.2 + 0.02 * frame, velocity * (frame - 2) / fps, velocity, 0.04)
    run("mesh", str(work / "blob_####.ply"), "--spacing", "0.04", "--fps", fps, "-o", work / "blob")
    run("usd", work / "blob")
    imported(work / "blob/usd/shot.usda")
    scene = bpy.context.scene
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.type, camera.data.ortho_scale = "ORTHO", extent
    camera.location, camera.rotation_euler = (0.0, -5.0, 0.0), (np.pi / 2, 0.0, 0.0)
    scene.collection.objects.link(camera)
    scene.camera = camera
    scene.render.engine, scene.cycles.samples, scene.cycles.use_denoising = "CYCLES", 128, False
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = pixels, 100, 100
    scene.render.film_transparent = True
    scene.render.image_settings.file_format, scene.render.image_settings.color_mode = "OPEN_EXR", "RGBA"
    scene.frame_set(2)

    def width(shutter: float) -> int:
        scene.render.use_motion_blur = shutter > 0.0
        scene.render.motion_blur_shutter = max(shutter, 0.01)
        scene.render.filepath = str(work / f"blur{shutter}.exr")
        bpy.ops.render.render(write_still=True)
        image = bpy.data.images.load(scene.render.filepath)
        alpha = np.empty(4 * image.size[0] * image.size[1], "f4")
        image.pixels.foreach_get(alpha)
        alpha = alpha.reshape(image.size[1], image.size[0], 4)[:, :, 3]
        covered = np.nonzero((alpha > 0.002).any(axis=0))[0]
        return int(covered[-1] - covered[0] + 1)

    at_rest = width(0.0)
    for shutter in (0.5, 1.0):
        grown, wanted = width(shutter) - at_rest, velocity * shutter / fps * pixels / extent
        check(abs(grown - wanted) <= 2.0, f"a shutter of {shutter} frames blurs by v · shutter / fps", f"{grown}, not {wanted} pixels")


def main() -> None:
    shots = [Path(word).resolve() for word in sys.argv[1:]]
    with tempfile.TemporaryDirectory() as folder:
        works = [Path(folder) / name for name in ("shot", "sheet", "collider")]
        for test, shot, work in zip((test_shot, test_sheet, test_collider), shots, works):
            test(shot, work)
        test_blur(Path(folder))
    print(f"{passed} passed, {failed} failed", flush=True)
    # Blender's module may not end by itself.
    os._exit(failed > 0)


main()
