# SPDX-License-Identifier: MIT OR Apache-2.0
"""Tests of the engine's jobs, inside Blender: pause, resume, locks, other settings, a Blender that was closed, and the engine's place.

run.py starts each stage in a process of its own.
"""

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import bpy

import harness
from harness import ADDON, check, use_addon
from scenes import empty, scene_module, sequence_input, tap, wait, water

# So many that the fastest engine is still at work when the second frame has been seen: it makes 24 in less time.
PAUSED_LAST = 120


def failed(name: str, call, *parts: str, **options: object) -> None:
    """An operator fails with one message that has these parts."""
    try:
        call(**options)
    except RuntimeError as error:
        text = str(error)
        check(all(part in text for part in parts) and "Traceback" not in text, f"fails: {name}", text)
    else:
        check(False, f"fails: {name}", "it succeeded")


def cached(folder: Path) -> dict[str, int]:
    """The frames in the cache, with the time at which each was written."""
    return {file.name: file.stat().st_mtime_ns for file in (folder / "meniscus" / "draft" / "cache").glob("frame_*.mcf")}


def pool(folder: Path, last: int) -> bpy.types.Scene:
    """A drop above a pool, of few particles."""
    scene = empty(folder)
    for kind in ("tank", "pool", "drop"):
        bpy.ops.meniscus.add(kind=kind)
    scene.meniscus.liquid.spacing, scene.frame_end = 0.06, last
    return scene


def stage_jobs(folder: Path) -> None:
    """Pause keeps frames, Resume goes on after them, and the same button again has nothing to do."""
    scene = pool(folder, PAUSED_LAST)
    session = scene_module("session")
    bpy.ops.meniscus.simulate()
    failed("a second job of the scene", bpy.ops.meniscus.simulate, "A job is running in this folder")
    wait(scene, lambda job: bool(job.state))
    run, program = scene_module("run"), Path(os.environ["MENISCUS"])
    try:
        run.start(folder / "meniscus", program, "simulate", "draft", [], [1, 1, 1])
        check(False, "a second job in the folder is refused", "it was started")
    except Exception as error:
        check("a job is running in this folder" in str(error), "a second job in the folder is refused", error)
    job, _ = wait(scene, lambda job: len(cached(folder)) >= 2)
    bpy.ops.meniscus.pause()
    check("Pausing" in session.status(job), "the panel shows that the job is being paused", session.status(job))
    job, _ = wait(scene)
    before = cached(folder)
    check(job.code == 130 and not job.error, "a paused job ends with exit code 130", (job.code, job.error))
    check(2 <= len(before) < PAUSED_LAST, "finished frames are kept", len(before))
    bpy.ops.meniscus.resume(wait=True)
    after = cached(folder)
    check(session.job_of(scene).code == 0 and len(after) == PAUSED_LAST, "Resume makes the other frames", (session.job_of(scene).code, len(after)))
    check(all(after[name] == written for name, written in before.items()), "no frame is simulated twice")
    check(sequence_input(water(scene), "Last") == PAUSED_LAST, "all surfaces are shown")
    kept = water(scene)
    kept.name = "My Water"
    bpy.ops.meniscus.simulate(wait=True)
    check(cached(folder) == after, "Simulate again keeps every frame")
    check(water(scene).name == "My Water", "the artist's name of the surface stays")
    check_again(scene, folder)
    check_locked(scene, folder)


def check_again(scene: bpy.types.Scene, folder: Path) -> None:
    """Surfaces and whitewater are made again with other settings, from the same frames."""
    before = cached(folder)
    mesh = folder / "meniscus" / "draft" / "mesh" / f"liquid_{PAUSED_LAST:04}.ply"
    size = mesh.stat().st_size
    scene.meniscus.surface.voxel = 1.0
    bpy.ops.meniscus.mesh(wait=True)
    check(mesh.stat().st_size < size / 2, "Mesh Again uses the settings of Surface", (mesh.stat().st_size, size))
    bpy.ops.meniscus.whitewater(wait=True)
    foam = next((each for each in scene.objects if each.get("meniscus_output") == "points:whitewater"), None)
    check(foam is not None and sequence_input(foam, "Last") == PAUSED_LAST, "Whitewater Again shows its points", [each.name for each in scene.objects])
    check(cached(folder) == before, "neither simulates")
    scene.meniscus.surface.voxel = 0.5


def check_locked(scene: bpy.types.Scene, folder: Path) -> None:
    """A folder that another process simulates in, and frames of other settings, are reported; Start Over replaces these."""
    import fcntl

    session = scene_module("session")
    scene.frame_end = PAUSED_LAST + 1
    with open(folder / "meniscus" / "draft" / "cache" / ".lock", "a+b") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        failed("a folder that another process holds", bpy.ops.meniscus.simulate, "locked", wait=True)
        check(session.job_of(scene).code == 11, "its exit code is 11", session.job_of(scene).code)
    scene.frame_end = 4
    scene.meniscus.liquid.density = 900.0
    failed("frames of other settings", bpy.ops.meniscus.simulate, "Start Over", "liquid.density", wait=True)
    bpy.ops.meniscus.start_over(wait=True)
    check(session.job_of(scene).code == 0 and len(cached(folder)) == 4, "Start Over simulates again", (session.job_of(scene).error, len(cached(folder))))
    check(sequence_input(water(scene), "Last") == 4, "surfaces of earlier frames are not shown", sequence_input(water(scene), "Last"))
    scene.meniscus.liquid.use_density_dev = scene.meniscus.liquid.use_iterations = True
    scene.meniscus.liquid.density_dev = 0.01
    failed("a preset that the engine refuses", bpy.ops.meniscus.simulate, "preset is refused", wait=True)
    text = "\n".join(session.job_of(scene).messages)
    check("iterations" in text and "scene.toml" in text, "the lines that are wrong are reported", text)


def stage_closed(folder: Path) -> None:
    """A Blender that is closed loses no frame, and the next one finds its job."""
    scene = tap(folder, last=10)
    bpy.ops.wm.save_mainfile()
    command = [sys.executable, str(Path(__file__)), "leave", str(folder)]
    subprocess.run(command, timeout=120, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    session = scene_module("session")
    bpy.ops.wm.open_mainfile(filepath=str(folder / "scene.blend"))
    scene = bpy.context.scene
    job = session.job_of(scene)
    check(job is not None and job.action == "simulate" and job.process is None, "the job of a Blender that was closed is found")
    job, _ = wait(scene)
    check(job.code == 0 and len(cached(folder)) == 10, "no frame is lost", (job.code, len(cached(folder))))
    if water(scene) is None:
        bpy.ops.meniscus.show()
    check(sequence_input(water(scene), "Last") == 10, "its surfaces are shown")
    check_killed(scene, folder)


def check_killed(scene: bpy.types.Scene, folder: Path) -> None:
    """A job whose processes were ended from outside is not taken for a running one."""
    session, run = scene_module("session"), scene_module("run")
    scene.frame_end = 60
    bpy.ops.meniscus.start_over()
    job, _ = wait(scene, lambda job: len(cached(folder)) >= 2 and job.step == "simulate")
    os.killpg(job.process.pid, signal.SIGKILL)
    job, _ = wait(scene)
    check(job.code is None and "Resume" in job.reason(), "an ended job is reported", (job.code, job.error))
    found = run.attach(folder / "meniscus")
    check(not found.is_running and "Resume" in session.status(found), "the number of a process in a file is no proof that it runs", session.status(found))
    before = cached(folder)
    scene.meniscus.threads = 1
    bpy.ops.meniscus.resume()
    job, _ = wait(scene, lambda job: len(cached(folder)) > len(before))
    check(all(cached(folder)[name] == written for name, written in before.items()), "Resume keeps its frames")
    bpy.ops.meniscus.pause()
    wait(scene)


def check_links(folder: Path) -> None:
    """Links in the job's folder lead no write outside."""
    scene = pool(folder, 2)
    outside = folder / "outside"
    outside.write_text("mine")
    run = folder / "meniscus" / "run"
    run.mkdir(parents=True)
    for name in ("simulate.log", "simulate.out", "outputs.log", "surfaces.log", "runner.log", "job.json", "state.json"):
        (run / name).symlink_to(outside)
    bpy.ops.meniscus.simulate(wait=True)
    check(scene_module("session").job_of(scene).code == 0 and outside.read_text() == "mine", "no write follows a link in the job's folder")
    check(not any(path.is_symlink() for path in run.iterdir()), "links are replaced by files")


def stage_leave(folder: Path) -> None:
    """Starts a job and leaves at once, without a word to it."""
    use_addon()
    program = Path(os.environ["MENISCUS"])
    os.environ["PATH"] = f"{program.parent}{os.pathsep}{os.environ['PATH']}"
    bpy.ops.wm.open_mainfile(filepath=str(folder / "scene.blend"))
    bpy.ops.meniscus.simulate()
    os._exit(0)


def stage_engine(folder: Path) -> None:
    """The engine is looked for in the preferences, a Python package, the extension, and on the PATH, in this order."""
    use_addon()
    engine = scene_module("engine")
    program = Path(os.environ["MENISCUS"])
    path = os.environ["PATH"]
    os.environ["PATH"] = str(folder)
    folder.mkdir(parents=True)
    try:
        engine.find()
        check(False, "a missing engine is an error", "it was found")
    except Exception as error:
        text = str(error)
        check(all(part in text for part in ("meniscus_fx", "extension", "PATH", "Preferences")), "a missing engine is an error with every place", text)
    places = [("PATH", folder / "meniscus"), ("Extension", engine.EXTENSION / "engine" / engine.machine() / engine.PROGRAM)]
    for source, place in places:
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text("#!/bin/sh\n")
        # An installed zip has lost this permission.
        place.chmod(0o644 if source == "Extension" else 0o755)
        check(engine.find() == (place, source), f"the engine is found: {source}", engine.find())
    package = folder / "meniscus_fx"
    package.mkdir()
    (package / "__init__.py").write_text(f"def program():\n    return {str(program)!r}\n")
    sys.path.insert(0, str(folder))
    check(engine.find()[1] == "Python package meniscus_fx", "the engine is found: Python package", engine.find())
    preferences = bpy.context.preferences.addons[ADDON].preferences
    preferences.program = str(program)
    check(engine.find() == (program, "Preferences"), "the engine is found: preferences", engine.find())
    preferences.program = str(folder / "nothing")
    try:
        engine.find()
        check(False, "a wrong path in the preferences is an error", "another was used")
    except Exception as error:
        check("nothing" in str(error) and "Preferences" in str(error), "a wrong path in the preferences is an error", error)
    preferences.program = ""
    shutil.rmtree(engine.EXTENSION / "engine")
    sys.path.remove(str(folder))
    del sys.modules["meniscus_fx"]
    os.environ["PATH"] = path
    check_plan(folder / "plan")
    check_links(folder / "links")


def check_plan(folder: Path) -> None:
    """Plan reports memory, disk and time, and simulates nothing."""
    scene = pool(folder, 6)
    bpy.ops.meniscus.plan(wait=True)
    lines = scene_module("session").plan_of(scene)
    check(any("Memory" in line for line in lines) and any("Time" in line for line in lines), "Plan shows memory, disk and time", lines)
    check(not (folder / "meniscus" / "draft").exists(), "Plan makes no shot folder")


if __name__ == "__main__":
    harness.run(globals())
