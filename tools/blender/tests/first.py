# SPDX-License-Identifier: MIT OR Apache-2.0
"""The first ten minutes of a newcomer, inside Blender: every entry of the menu in Blender's own startup file, simulated and looked at.

run.py starts the stage in a process of its own.
"""

import os
import time
from pathlib import Path

import bpy
import numpy as np
from bpy_extras.object_utils import world_to_camera_view
from mathutils import Vector

import harness
from harness import ADDON, check
from scenes import scene_module
from volumes import load_openvdb

LAST = 5
# Of smoke in two frames [m].
MIN_RISE = 0.007
# Of anything else in two frames [m]: a pool at draft rounds its edges by 2 mm.
MIN_MOTION = 0.003
# Of a vortex tube [m²/s].
MIN_SWIRL = 0.01
# A pool in a tank is at rest, and air swirls in its place.
AT_REST = ("tank", "tube")
# What an entry that simulates nothing alone is added to.
WITH = {"tank": "pool", "outflow": "pool", "collider": "pool", "floor": "drop", "glass": "tap", "force": "pool", "turbulence": "smoke"}
# What the engine notes about it is right: a drop of the first frames is coarse at draft, and a pool is cut by what stands in it.
NOTED = ("volume is off", "particles of the sources were skipped", "1 frame(s) are empty")


def startup(folder: Path) -> bpy.types.Scene:
    """Blender's startup file with the add-on, saved."""
    bpy.ops.wm.read_factory_settings()
    bpy.ops.preferences.addon_enable(module=ADDON)
    folder.mkdir(parents=True)
    program = Path(os.environ["MENISCUS"])
    os.environ["PATH"] = f"{program.parent}{os.pathsep}{os.environ['PATH']}"
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "scene.blend"))
    bpy.context.scene.frame_end = LAST
    return bpy.context.scene


def corners(shown: bpy.types.Object) -> np.ndarray:
    """The corners of the box around an object in the current frame."""
    evaluated = shown.evaluated_get(bpy.context.evaluated_depsgraph_get())
    return np.array([shown.matrix_world @ Vector(corner) for corner in evaluated.bound_box])


def is_solid(shown: bpy.types.Object) -> bool:
    """Whether an object covers others, in renders or in the 3D view."""
    return not shown.hide_render or (not shown.hide_get() and shown.display_type != "WIRE")


def check_visible(scene: bpy.types.Scene, kind: str) -> None:
    """A result has a size, is in the picture and large enough in it, and no other object that is rendered encloses it."""
    results = [each for each in scene.objects if each.get("meniscus_output") and not each.hide_render]
    boxes = [corners(each) for each in results if np.ptp(corners(each), axis=0).max() > 0.0]
    check(bool(boxes), f"{kind}: a result has a size", [each.name for each in results])
    if not boxes:
        return
    places = np.concatenate(boxes)
    view = np.array([world_to_camera_view(scene, scene.camera, Vector(place)) for place in places])
    low, high = view.min(0), view.max(0)
    middle = (low + high) / 2.0
    check(bool(np.all(middle[:2] > 0.1) and np.all(middle[:2] < 0.9) and low[2] > scene.camera.data.clip_start), f"{kind}: it is in the picture", (low, high))
    check(float((high - low)[:2].max()) > 0.04, f"{kind}: it is not tiny", (high - low)[:2])
    solids = [each for each in scene.objects if each.type == "MESH" and each not in results and is_solid(each)]
    ends = [(corners(each).min(0), corners(each).max(0), each.name) for each in solids if each.data.name != "Glass"]
    around = [name for least, most, name in ends if np.all(least <= places.min(0) + 1e-3) and np.all(most >= places.max(0) - 1e-3)]
    check(not around, f"{kind}: no other object hides it", around)


def moved(scene: bpy.types.Scene) -> bool:
    """Whether results are elsewhere in the last frame than before, smoke by its mean place."""
    found = []
    for frame in (LAST - 2, LAST):
        scene.frame_set(frame)
        shown = [each for each in scene.objects if each.get("meniscus_output")]
        found.append(np.concatenate([smoke(each, frame) if each.type == "VOLUME" else corners(each) for each in shown]))
    if any(each.type == "VOLUME" for each in shown):
        # The mean of smoke that stays where it is changes, too, as its places are random.
        return bool(found[1][0, 2] - found[0][0, 2] > MIN_RISE)
    return found[0].shape != found[1].shape or bool(np.abs(found[1] - found[0]).max() > MIN_MOTION)


def swirl(scene: bpy.types.Scene) -> float:
    """Mean angular momentum of smoke about the Z axis of the world, per mass [m²/s]."""
    shown = next(each for each in scene.objects if each.get("meniscus_output"))
    path = bpy.path.abspath(shown.data.filepath).replace(f"{1:04}.vdb", f"{LAST:04}.vdb")
    grid = load_openvdb().read(path, "velocity")
    low, high = grid.evalActiveVoxelBoundingBox()
    velocities = np.zeros([*(most - least + 1 for least, most in zip(low, high)), 3])
    grid.copyToArray(velocities, ijk=low)
    places = np.moveaxis(np.indices(velocities.shape[:3]), 0, -1) * grid.transform.voxelSize()[0] + np.array(grid.transform.indexToWorld(low))
    momenta = places[..., 0] * velocities[..., 1] - places[..., 1] * velocities[..., 0]
    return float(momenta[np.any(velocities != 0.0, axis=-1)].mean())


def smoke(shown: bpy.types.Object, frame: int) -> np.ndarray:
    """The mean and the spread of the places of smoke, by its density."""
    path = bpy.path.abspath(shown.data.filepath).replace(f"{1:04}.vdb", f"{frame:04}.vdb")
    grid = load_openvdb().read(path, "density")
    low, high = grid.evalActiveVoxelBoundingBox()
    values = np.zeros([most - least + 1 for least, most in zip(low, high)])
    grid.copyToArray(values, ijk=low)
    places = np.indices(values.shape).reshape(3, -1).T * grid.transform.voxelSize()[0]
    places += np.array(grid.transform.indexToWorld(low))
    mean = np.average(places, axis=0, weights=values.ravel())
    return np.array([mean, np.average((places - mean) ** 2, axis=0, weights=values.ravel()) ** 0.5])


def check_camera(folder: Path) -> None:
    """The startup camera moves up to small objects until an artist has placed it or set it up."""
    setups = {
        "nothing": lambda camera: None,
        "a lens": lambda camera: setattr(camera.data, "lens", 85.0),
        "a near clip distance": lambda camera: setattr(camera.data, "clip_start", 0.02),
        "a constraint": lambda camera: setattr(camera.constraints.new("TRACK_TO"), "target", bpy.data.objects["Light"]),
        "a parent": lambda camera: setattr(camera, "parent", bpy.data.objects["Light"]),
        "animation": lambda camera: camera.keyframe_insert("location", frame=1),
        "a place": lambda camera: setattr(camera, "location", camera.location * 1.1),
    }
    for name, change in setups.items():
        camera = startup(folder / name).camera
        before = camera.location.copy()
        bpy.ops.meniscus.add(kind="tap")
        check((camera.location - before).length > 1.0, f"{name}: the camera moves up to a first object")
        change(camera)
        before = camera.location.copy()
        # Another one is far away, and small again.
        for each in ("Tap", "Pipe"):
            bpy.data.objects.remove(bpy.data.objects[each])
        bpy.context.scene.cursor.location.x = 50.0
        bpy.ops.meniscus.add(kind="tap")
        moved = (camera.location - before).length > 1e-3
        check(moved == (name == "nothing"), f"the camera, of which the artist changed {name}, {'moves' if name == 'nothing' else 'stays'}", camera.location)


def stage_first(folder: Path) -> None:
    """Every entry of the menu."""
    bpy.ops.preferences.addon_enable(module=ADDON)
    check_camera(folder / "camera")
    look_at(folder, list(scene_module("add").KINDS))


def stage_few(folder: Path) -> None:
    """One entry for each kind of result, for a second version of Blender."""
    look_at(folder, ["tap", "body", "ring", "cloth"])


def look_at(folder: Path, kinds: list[str]) -> None:
    """Add, Simulate, and something is there to be seen, without an error."""
    for kind in kinds:
        start, scene = time.monotonic(), startup(folder / kind)
        for each in (kind, WITH.get(kind)):
            if each:
                bpy.ops.meniscus.add(kind=each)
                # A fifth of the time for a glass, and not what is looked at.
                bpy.context.object.meniscus.resolution = 32
        bpy.ops.meniscus.simulate(wait=True)
        job = scene_module("session").job_of(scene)
        strange = [text for text in job.messages if not any(part in text for part in NOTED)]
        check(job.code == 0 and not job.error and not strange, f"{kind}: simulates without a remark", (job.code, job.error, strange))
        is_at_rest = kind in AT_REST
        check(moved(scene) != is_at_rest, f"{kind}: it {'stays where it is' if is_at_rest else 'moves'}")
        if kind == "tube":
            check(swirl(scene) > MIN_SWIRL, f"{kind}: its air swirls around the Z axis", swirl(scene))
        check_visible(scene, kind)
        print(f"{kind}: {time.monotonic() - start:.1f} s", flush=True)


if __name__ == "__main__":
    harness.run(globals())
