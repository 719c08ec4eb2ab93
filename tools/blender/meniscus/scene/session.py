# SPDX-License-Identifier: MIT OR Apache-2.0
"""The jobs of the scenes of this file: a timer reads their logs, shows what arrives, and redraws the panels.

Jobs belong to folders, not to Blender: when a file is opened, the last job of its folder is found again, running or not.
"""

import json
import subprocess
import time
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy

from ..folder import read_limited
from ..messages import ShotError, printable
from ..selection import chosen, select
from . import places, run, sampling, settings, show
from .arrivals import Arrivals
from .sampling import Sampling

POLL_SECONDS = 0.25
# Between two looks at new surfaces, and, without a job, at jobs that another Blender has started.
ARRIVAL_SECONDS, IDLE_SECONDS = 1.0, 5.0
RUNS = ("simulate", "resume", "start_over")

# The last job of each folder.
jobs: dict[str, run.Job] = {}
# Jobs whose results are still to be shown, by the session_uid of the scene that started them. A job keeps its folder when
# the .blend is saved elsewhere.
followed: dict[int, run.Job] = {}
# Runners of jobs that have ended.
ending: list[subprocess.Popen] = []
arrivals: dict[str, Arrivals] = {}
plans: dict[str, list[str]] = {}
last_look: dict[str, float] = {}


def root_of(scene: bpy.types.Scene) -> Path | None:
    try:
        return places.folder_of(scene)
    except ShotError:
        return None


def job_of(scene: bpy.types.Scene) -> run.Job | None:
    """The job that a scene started and that is not shown yet, else the running or last one of its folder."""
    job = followed.get(scene.session_uid)
    if job is not None:
        return job
    root = root_of(scene)
    return jobs.get(str(root)) if root else None


def plan_of(scene: bpy.types.Scene) -> list[str]:
    root = root_of(scene)
    return plans.get(str(root), []) if root else []


def shown_of(job: run.Job) -> str:
    """What a running job shows so far; empty if nothing is."""
    arrived = arrivals.get(str(job.root))
    return arrived.text() if arrived is not None and job.is_running else ""


def begin(scene: bpy.types.Scene, job: run.Job) -> None:
    """Takes a job that was started."""
    key = str(job.root)
    jobs[key] = job
    followed[scene.session_uid] = job
    arrivals.pop(key, None)
    watch(job)
    # An idle timer would look at the new job only after seconds.
    if bpy.app.timers.is_registered(tick):
        bpy.app.timers.unregister(tick)
    ensure_timer()


def watch(job: run.Job) -> None:
    """Follows what a job makes while it simulates."""
    frames = job.description.get("frames")
    is_list = isinstance(frames, list) and len(frames) == 3 and all(type(one) is int for one in frames)
    if is_list and frames[2] > 0 and frames[0] >= 0 and job.products():
        numbers = list(range(frames[0], min(frames[1], frames[0] + 1_000_000) + 1, frames[2]))
        arrivals[str(job.root)] = Arrivals(job, numbers)


def ensure_timer() -> None:
    if not bpy.app.timers.is_registered(tick):
        bpy.app.timers.register(tick, first_interval=POLL_SECONDS, persistent=True)


def tick() -> float | None:
    """Updates all jobs; without a folder that has one, the timer ends."""
    if bpy.app.is_job_running("RENDER") or Sampling.current is not None:
        # A render reads the objects that would be changed; sampling has changed the current frame.
        return POLL_SECONDS
    scenes = {scene.session_uid: scene for scene in bpy.data.scenes}
    for number, job in list(followed.items()):
        if number in scenes:
            try:
                advance(scenes[number], job)
            except Exception as error:
                # Blender removes a timer whose function raises: no job of this file would be updated again.
                report(job, error)
        else:
            # The scene was deleted: its job goes on, and there is nothing to show it in.
            del followed[number]
    ending[:] = [process for process in ending if process.poll() is None]
    if followed or ending:
        return POLL_SECONDS
    if any([find_job(scene, again=True) for scene in scenes.values()]):
        sampling.redraw(bpy.context)
    return POLL_SECONDS if followed else IDLE_SECONDS if jobs else None


def report(job: run.Job, error: Exception) -> None:
    """Adds an error to a job's messages; of one that is no ShotError, Blender's console gets the traceback."""
    if isinstance(error, ShotError):
        text = str(error)
    else:
        text = f"The result cannot be updated: {type(error).__name__}: {printable(error, 200)}. Blender's console has more"
    if text not in job.messages:
        job.messages.append(text)
        if not isinstance(error, ShotError):
            traceback.print_exception(error)


def is_editing() -> bool:
    """Whether an artist edits, sculpts or paints: a result that is shown would end that."""
    windows = bpy.context.window_manager.windows
    layers = [window.view_layer for window in windows] or [scene.view_layers[0] for scene in bpy.data.scenes]
    active = [layer.objects.active for layer in layers]
    return any(each is not None and each.mode != "OBJECT" for each in active)


def advance(scene: bpy.types.Scene, job: run.Job) -> None:
    """Reads what a job reported and shows it."""
    key = str(job.root)
    changed = job.update()
    if is_editing():
        # The timer goes on, and shows what has arrived when the artist is done.
        if changed:
            sampling.redraw(bpy.context)
        return
    arrived = arrivals.get(key)
    if arrived is not None and arrived.is_due(job) and (not job.is_running or time.monotonic() - last_look.get(key, 0.0) >= ARRIVAL_SECONDS):
        last_look[key] = time.monotonic()
        try:
            with in_scene(scene):
                changed = arrived.update(bpy.context, scene, job) or changed
        except Exception as error:
            # The rest is shown when the job has ended.
            report(job, error)
            del arrivals[key]
    if not job.is_running:
        followed.pop(scene.session_uid, None)
        # The runner ends just after it has released its lock; without a look at its exit code it would stay a zombie.
        if job.process is not None:
            ending.append(job.process)
        finish(scene, job)
    if changed:
        sampling.redraw(bpy.context)


def finish(scene: bpy.types.Scene, job: run.Job) -> None:
    """Shows what a job has made when it has ended."""
    if job.code != 0:
        return
    if not is_own(scene, job):
        job.messages.append(f"The job was started by {printable(job.owner)}. Show Result shows it in this scene")
        return
    if job.action == "plan":
        plans[str(job.root)] = read_plan(job)
        return
    show_result(scene, job)


def show_result(scene: bpy.types.Scene, job: run.Job) -> None:
    with in_scene(scene) as window:
        try:
            notes = show.show_all(bpy.context, scene, job.shot)
            job.messages.extend(note for note in notes if note not in job.messages)
        except ShotError as error:
            job.error = str(error)
    if window:
        # The next Undo takes back what the artist does after this, not the result.
        with bpy.context.temp_override(window=window):
            if bpy.ops.ed.undo_push.poll():
                bpy.ops.ed.undo_push(message="Meniscus Result")


@contextmanager
def in_scene(scene: bpy.types.Scene) -> Iterator[bpy.types.Window | None]:
    """Gives Blender's importers the scene and a window, which a timer lacks, and keeps the artist's selection."""
    window = next(iter(bpy.context.window_manager.windows), None)
    places = {"window": window} if window else {}
    layer = window.view_layer if window else scene.view_layers[0]
    selected, active = chosen(layer)
    try:
        with bpy.context.temp_override(**places, scene=scene, view_layer=scene.view_layers[0]):
            yield window
    finally:
        select(layer, selected, active)


def read_plan(job: run.Job) -> list[str]:
    """Memory, disk and time of a plan, and its remarks."""
    try:
        data = json.loads(read_limited(job.folder / "plan.out", run.MAX_PLAN_BYTES, "Plan again"))
        counts = [
            f"{count['end']:,.0f} {count['name']}" for system in data["systems"] for count in system["counts"]
        ]
        lines = [f"{job.tier.title()}: {data['frames_stored']} frames, {', '.join(counts)}"]
        lines.append(f"Memory {size(data['memory'])}, disk {size(data['disk'])}")
        spread = 100.0 * data["uncertainty"]
        lines.append(f"Time {duration(data['seconds'])} ± {spread:.0f} % on {data['threads']} threads")
        return [printable(line, 300) for line in lines + [str(remark) for remark in data.get("remarks", [])]]
    except (ShotError, ValueError, KeyError, TypeError, RecursionError) as error:
        return [f"The plan cannot be read: {printable(error, 200)}"]


def size(count: float) -> str:
    return f"{count / 2**30:.1f} GiB" if count >= 2**30 else f"{count / 2**20:.0f} MiB"


def duration(seconds: float) -> str:
    if seconds < 100.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 6000.0 else f"{seconds / 3600.0:.1f} h"


def status(job: run.Job) -> str:
    """One line about a job."""
    if job.is_running:
        label = run.LABELS.get(job.step, "Starting")
        eta = job.eta()
        left = f", {duration(eta)} left" if eta is not None else ""
        return "Pausing" if job.is_stopping() else f"{label} {job.percent():.0f} %{left}"
    if job.code == 0:
        return f"{job.tier.title()}: {job.action.replace('_', ' ')} is done"
    if job.code == run.PAUSED:
        return f"{job.tier.title()}: paused, finished frames are kept"
    return f"{job.tier.title()}: {job.reason()}"


@bpy.app.handlers.persistent
def opened(*_) -> None:
    """Finds the jobs of the folders of a file that was opened."""
    for table in (jobs, followed, arrivals, plans):
        table.clear()
    saved()


@bpy.app.handlers.persistent
def saved(*_) -> None:
    """Finds the jobs of the folders of this file, which are others when it was saved elsewhere."""
    for scene in bpy.data.scenes:
        find_job(scene)


def find_job(scene: bpy.types.Scene, again: bool = False) -> bool:
    """Takes the last job of a scene's folder, unless it is known; whether it did. `again` if another Blender may have started a newer one."""
    root = root_of(scene)
    known = jobs.get(str(root)) if root is not None else None
    if root is None or (known is not None and not (again and run.last_id(root) != known.description.get("id"))):
        return False
    job = run.attach(root)
    if job is None:
        return False
    jobs[str(root)] = job
    ensure_timer()
    if job.is_running and scene.session_uid not in followed:
        followed[scene.session_uid] = job
        if is_own(scene, job):
            watch(job)
    return True


def is_own(scene: bpy.types.Scene, job: run.Job) -> bool:
    """Whether a scene of this file started a job; jobs of this Blender stay its own when the file is saved elsewhere."""
    if job.process is not None:
        return True
    started_in, blend = job.description.get("scene", scene.name), job.description.get("blend")
    is_of_file = not isinstance(blend, str) or not blend or places.is_same(job.root, blend)
    return is_of_file and started_in == scene.name


def folder_changed(shot: bpy.types.PropertyGroup, _context: bpy.types.Context) -> None:
    find_job(shot.id_data)


def register() -> None:
    settings.updates["folder"] = folder_changed
    sampling.register()
    bpy.app.handlers.load_post.append(opened)
    bpy.app.handlers.save_post.append(saved)
    # While an extension is being switched on, the open file cannot be read.
    bpy.app.timers.register(saved, first_interval=0.0)


def unregister() -> None:
    sampling.unregister()
    bpy.app.handlers.load_post.remove(opened)
    bpy.app.handlers.save_post.remove(saved)
    if bpy.app.timers.is_registered(tick):
        bpy.app.timers.unregister(tick)
    if bpy.app.timers.is_registered(saved):
        bpy.app.timers.unregister(saved)
    for table in (jobs, followed, arrivals, plans):
        table.clear()
