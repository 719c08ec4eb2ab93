# SPDX-License-Identifier: MIT OR Apache-2.0
"""Tests of jobs as files and processes, inside Blender and without the engine: logs, time left, a .blend that is saved elsewhere.

run.py starts the stage in a process of its own. Python itself is the program that the jobs run.
"""

import errno
import json
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import bpy

import arriving
import harness
import identities
from harness import ADDON, check
from scenes import empty, scene_module, wait

SLEEP = ["-c", "import time; time.sleep(60)"]


def job_files(folder: Path, log: str, state: dict | None = None) -> Path:
    """The files of a job that has ended, with a log; its root."""
    run = folder / "meniscus" / "run"
    run.mkdir(parents=True)
    job = {"id": "one", "action": "simulate", "tier": "draft", "steps": [{"name": "simulate", "arguments": []}], "frames": [1, 4, 1]}
    (run / "job.json").write_text(json.dumps(job))
    (run / "state.json").write_text(json.dumps({"id": "one", "step": "simulate", "code": 0} | (state or {})))
    (run / "simulate.log").write_text(log)
    return folder / "meniscus"


def event(name: str, **data: object) -> str:
    return json.dumps({"event": name, "data": data}) + "\n"


def check_long_log(folder: Path) -> None:
    """The whole log of a job that has ended is read, however long it is."""
    log = "".join(event("note", text=f"note {number % 10} " + 200 * "x") for number in range(3000)) + event("note", text="the last note")
    check(len(log) > 2 << 18, "the log is longer than one look")
    job = scene_module("run").attach(job_files(folder, log))
    check("the last note" in job.messages, "the end of a long log is read", list(job.messages)[-1:])


def check_eta(folder: Path) -> None:
    """The time left counts from the first look, since a job that is resumed starts with the frames of earlier ones."""
    run = scene_module("run")
    log = event("begin", text="simulate: frames 1-100") + event("progress", percent=50.0) + event("progress", percent=60.0)
    job = run.Job(job_files(folder, log))
    job.is_running, job.state = True, {"step": "simulate", "step_started": 990.0}
    clock, before = SimpleNamespace(now=1000.0), run.time
    run.time = SimpleNamespace(time=lambda: clock.now)
    try:
        job.read("simulate")
        check(job.eta() is None, "without a speed there is no time left", job.eta())
        with open(folder / "meniscus" / "run" / "simulate.log", "a") as file:
            file.write(event("progress", percent=70.0))
        clock.now = 1010.0
        job.read("simulate")
        check(job.eta() is not None and abs(job.eta() - 30.0) < 0.1, "10 % in 10 s leave 30 s for 30 %", job.eta())
    finally:
        run.time = before


def check_empty_frames(folder: Path) -> None:
    """A frame without particles counts once, however many products are made of it."""
    notes = [event("note", text=f"/shot/cache/frame_{frame:04}.mcf: no particles, so its {product} is empty") for frame in (1, 2) for product in ("surface", "droplets")]
    job = scene_module("run").attach(job_files(folder, "".join(notes)))
    check(list(job.messages) == ["2 frame(s) are empty: there were no particles"], "an empty frame counts once", list(job.messages))


def sleeping(root: Path):
    """A job that does nothing for a minute."""
    run = scene_module("run")
    steps = [{"name": "simulate", "arguments": SLEEP}]
    return run.start(root, Path(sys.executable), "simulate", "draft", steps, [1, 4, 1])


def check_saved_elsewhere(folder: Path) -> None:
    """A job is followed and paused after the .blend was saved elsewhere, and when the add-on is switched on again."""
    scene = empty(folder / "first")
    session = scene_module("session")
    session.begin(scene, sleeping(folder / "first" / "meniscus"))
    job, _ = wait(scene, lambda job: job.state.get("id") is not None)
    (folder / "second").mkdir()
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "second" / "scene.blend"))
    found = session.job_of(scene)
    check(found is job and found.is_running, "the job is that of the scene after Save As", found)
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "first" / "scene.blend"))
    bpy.ops.preferences.addon_disable(module=ADDON)
    bpy.ops.preferences.addon_enable(module=ADDON)
    session = scene_module("session")
    check(bpy.app.timers.is_registered(session.saved), "a timer looks for jobs as soon as the file can be read")
    session.saved()
    found = session.job_of(bpy.context.scene)
    check(found is not None and found.is_running, "the job is found when the add-on is switched on", found)
    if found is None:
        job.stop()
        job.process.wait()
        return
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "second" / "scene.blend"))
    bpy.ops.meniscus.pause()
    found, _ = wait(bpy.context.scene)
    check(found.code == 130, "it is paused from there", (found.code, found.error))
    job.process.wait()


def check_other_blender(folder: Path) -> None:
    """A job that another Blender starts in a folder whose last job is known is seen."""
    scene = empty(folder)
    session, run = scene_module("session"), scene_module("run")
    job_files(folder, "")
    session.opened()
    check(session.job_of(scene).code == 0, "the last job is known")
    other = sleeping(folder / "meniscus")
    while not run.is_locked(folder / "meniscus" / "run"):
        time.sleep(0.02)
    try:
        bpy.ops.meniscus.write()
    except RuntimeError as error:
        check("a job is running" in str(error), "its folder is in use", error)
    session.tick()
    found = session.job_of(scene)
    check(found.is_running and found.description["id"] == other.description["id"], "the other Blender's job is seen", found.description)
    bpy.ops.meniscus.pause()
    other.process.wait()


def check_runner(folder: Path) -> None:
    """The runner leaves no engine behind, keeps the exit code, and distinguishes a held lock from a file system without any."""
    runner = scene_module("runner")
    job_files(folder, "")
    run = folder / "meniscus" / "run"
    job = json.loads((run / "job.json").read_text()) | {"program": sys.executable, "cwd": str(folder)}
    (run / "job.json").write_text(json.dumps(job))
    started = []

    class Broken(runner.Runner):
        def start(self, arguments: list[str], log: str):
            started.append(super().start(arguments, log))
            return started[-1]

        def has_begun(self, log: str) -> bool:
            raise OSError(errno.EIO, "planted")

    try:
        Broken(run).run_step({"name": "simulate", "arguments": SLEEP, "follow": [{"name": "surfaces", "arguments": SLEEP}]})
    except OSError:
        pass
    check(started[0].poll() is not None, "after an error of the runner no engine is left")
    started[0].kill()
    whole = runner.Runner(run)
    whole.job["steps"] = []
    before, runner.os.replace = runner.os.replace, refuse
    try:
        code = whole.run()
    except OSError as error:
        code = error
    finally:
        runner.os.replace = before
    check(code == 0, "a state that cannot be written does not change the exit code", code)
    check_lock_errors(run, runner)


def check_full_disk(folder: Path) -> None:
    """On a full disk a pass is left out, and the simulation goes on; a runner that cannot write any state gives its reason."""
    runner, run = scene_module("runner"), scene_module("run")
    root = job_files(folder, "")
    job = json.loads((root / "run" / "job.json").read_text()) | {"program": sys.executable, "cwd": str(folder)}
    (root / "run" / "job.json").write_text(json.dumps(job))
    frames = "import sys, time\nfor _ in range(3): time.sleep(0.25); print('\"event\":\"frame\"', file=sys.stderr, flush=True)"
    step = {"name": "simulate", "arguments": ["-c", frames], "repeat": [{"name": "sheets", "arguments": ["-c", ""]}]}
    found, before, pause = runner.Runner(root / "run"), runner.os.replace, runner.PASS_SECONDS
    start, started = found.start, []

    def start_once(arguments: list[str], log: str):
        runner.os.replace = full if log == "sheets" else before
        started.append(log)
        if started.count("sheets") == 1 and log == "sheets":
            full()
        return start(arguments, log)

    found.start, runner.PASS_SECONDS = start_once, 0.0
    try:
        code = found.run_step(step)
    except OSError as error:
        code = error
    finally:
        runner.os.replace, runner.PASS_SECONDS = before, pause
    check(code == 0 and started.count("sheets") >= 2, "an error of a pass does not end the simulation", (code, started))
    ended = run.Job(root)
    ended.process = SimpleNamespace(poll=lambda: 1)
    (root / "run" / "runner.log").write_text("the state cannot be written (planted)\n")
    check(ended.reason() == "the state cannot be written (planted)", "a job that could write no state gives its reason", ended.reason())


def full(*_) -> None:
    raise OSError(errno.ENOSPC, "planted")


def refuse(*_) -> None:
    raise PermissionError(errno.EACCES, "planted")


def check_lock_errors(run: Path, runner) -> None:
    import fcntl

    before, fcntl.flock = fcntl.flock, no_locks
    try:
        with open(run / "lock", "w+b"):
            check(not scene_module("run").is_locked(run), "a file system without locks does not count as a job that runs")
    finally:
        fcntl.flock = before


def no_locks(*_) -> None:
    raise OSError(errno.ENOLCK, "planted")


def check_editing(folder: Path) -> None:
    """A result waits until the artist leaves Edit Mode, and keeps the selection."""
    scene = empty(folder)
    session, run = scene_module("session"), scene_module("run")
    bpy.ops.meniscus.add(kind="pool")
    shown = []

    class Ended(run.Job):
        def update(self) -> bool:
            self.is_running, self.code = False, 0
            return True

    def show(*_) -> list[str]:
        made = bpy.data.objects.new("Made", None)
        scene.collection.objects.link(made)
        for each in bpy.context.view_layer.objects:
            each.select_set(each == made)
        bpy.context.view_layer.objects.active = made
        shown.append(made)
        return []

    job = Ended(folder / "meniscus")
    job.description, job.is_running = {"action": "simulate", "scene": scene.name}, True
    before, session.show.show_all = session.show.show_all, show
    bpy.ops.object.mode_set(mode="EDIT")
    try:
        session.begin(scene, job)
        session.tick()
        check(not shown and bpy.context.mode == "EDIT_MESH", "nothing is shown in Edit Mode", bpy.context.mode)
        bpy.ops.object.mode_set(mode="OBJECT")
        session.tick()
    finally:
        session.show.show_all = before
    check(len(shown) == 1, "the result is shown afterwards", shown)
    found = [each.name for each in bpy.context.selected_objects], bpy.context.view_layer.objects.active.name
    check(found == (["Pool"], "Pool"), "the selection stays", found)


def check_broken_result(folder: Path) -> None:
    """A result that takes the place of another leaves the timer alive, and so does an error in one job."""
    scene = empty(folder)
    session, run = scene_module("session"), scene_module("run")
    for name in ("Other", "Result"):
        made = bpy.data.objects.new(name, None)
        scene.collection.objects.link(made)
        made.select_set(name == "Result")
    bpy.context.view_layer.objects.active = made

    class Ended(run.Job):
        error_of_update = None

        def update(self) -> bool:
            if self.error_of_update is not None:
                raise self.error_of_update
            self.is_running, self.code = False, 0
            return True

    def replace(*_) -> list[str]:
        bpy.data.objects.remove(bpy.data.objects["Result"])
        scene.collection.objects.link(bpy.data.objects.new("Result", None))
        return []

    def ended(scene: bpy.types.Scene, name: str, error: Exception | None = None):
        job = Ended(folder / name)
        job.description, job.is_running = {"action": "simulate", "scene": scene.name}, True
        job.error_of_update = error
        session.begin(scene, job)
        return job

    before, session.show.show_all = session.show.show_all, replace
    try:
        broken = ended(bpy.data.scenes.new("Broken"), "broken", ValueError("planted"))
        job = ended(scene, "sound")
        seconds = [session.tick(), session.tick()]
    except Exception as error:
        seconds = [type(error).__name__]
    finally:
        session.show.show_all = before
        session.opened()
    check(all(isinstance(each, float) for each in seconds), "an error in one job does not end the timer", seconds)
    check(sum("planted" in text for text in broken.messages) == 1, "it is a message of that job", list(broken.messages))
    found = [each.name for each in bpy.context.selected_objects], getattr(bpy.context.view_layer.objects.active, "name", None)
    check(not job.is_running and found == (["Result"], "Result"), "an object that replaces a selected one is selected", (found, list(job.messages)))


def stage_logs(folder: Path) -> None:
    empty(folder)
    check_long_log(folder / "long")
    check_eta(folder / "eta")
    check_empty_frames(folder / "without particles")
    check_runner(folder / "runner")
    check_full_disk(folder / "full")
    check_editing(folder / "editing")
    check_broken_result(folder / "broken")
    arriving.check_late_smoke(folder / "late smoke")
    arriving.check_renamed_result(folder / "renamed result")
    identities.check_deleted(folder / "deleted")
    identities.check_copied_later(folder / "copied later")
    identities.check_view_layers(folder / "view layers")
    check_saved_elsewhere(folder / "elsewhere")
    check_other_blender(folder / "other")


if __name__ == "__main__":
    harness.run(globals())
