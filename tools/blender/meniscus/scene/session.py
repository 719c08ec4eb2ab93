# SPDX-License-Identifier: MIT OR Apache-2.0
"""The jobs of the scenes of this file: a timer reads their logs, shows surfaces as frames arrive, and redraws the panels.

Jobs belong to folders, not to Blender: when a file is opened, the last job of its folder is found again, running or not.
"""

import json
import time
from pathlib import Path

import bpy

from ..folder import read_limited
from ..messages import ShotError, printable
from . import preset, run, settings, show

POLL_SECONDS = 0.25
# With nothing to read, so that a job that another program starts in the folder is seen.
ARRIVAL_SECONDS = 1.0
RUNS = ("simulate", "resume", "start_over")

jobs: dict[str, run.Job] = {}
arrivals: dict[str, show.Arrivals] = {}
plans: dict[str, list[str]] = {}
last_look: dict[str, float] = {}


def root_of(scene: bpy.types.Scene) -> Path | None:
    try:
        return preset.folder_of(scene)
    except ShotError:
        return None


def job_of(scene: bpy.types.Scene) -> run.Job | None:
    """The running or last job of a scene's folder."""
    root = root_of(scene)
    return jobs.get(str(root)) if root else None


def plan_of(scene: bpy.types.Scene) -> list[str]:
    root = root_of(scene)
    return plans.get(str(root), []) if root else []


def begin(scene: bpy.types.Scene, job: run.Job) -> None:
    """Takes a job that was started."""
    key = str(job.root)
    jobs[key] = job
    arrivals.pop(key, None)
    watch(scene, job)
    ensure_timer()


def watch(scene: bpy.types.Scene, job: run.Job) -> None:
    """Follows the surfaces of a job that makes some."""
    steps = job.description.get("steps", [])
    frames = job.description.get("frames")
    is_list = isinstance(frames, list) and len(frames) == 3 and all(type(one) is int for one in frames)
    if is_list and frames[2] > 0 and frames[0] >= 0 and any(isinstance(step, dict) and step.get("follow") for step in steps):
        numbers = list(range(frames[0], min(frames[1], frames[0] + 1_000_000) + 1, frames[2]))
        arrivals[str(job.root)] = show.Arrivals(job.shot, numbers)


def ensure_timer() -> None:
    if not bpy.app.timers.is_registered(tick):
        bpy.app.timers.register(tick, first_interval=POLL_SECONDS, persistent=True)


def tick() -> float | None:
    """One look at all jobs; the timer ends with the last of them."""
    if bpy.app.is_job_running("RENDER"):
        # A render reads the objects that would be changed.
        return POLL_SECONDS
    is_busy = False
    for scene in bpy.data.scenes:
        job = job_of(scene)
        if job is not None and job.is_running:
            advance(scene, job)
            is_busy = is_busy or job.is_running
    return POLL_SECONDS if is_busy else None


def advance(scene: bpy.types.Scene, job: run.Job) -> None:
    """Reads what a job reported and shows it."""
    key = str(job.root)
    changed = job.update()
    arrived = arrivals.get(key)
    if arrived is not None and (not job.is_running or time.monotonic() - last_look.get(key, 0.0) >= ARRIVAL_SECONDS):
        last_look[key] = time.monotonic()
        try:
            changed = arrived.update(scene, job.surfaces()) or changed
        except ShotError as error:
            job.messages.append(str(error))
            del arrivals[key]
    if not job.is_running:
        finish(scene, job)
    if changed:
        redraw()


def finish(scene: bpy.types.Scene, job: run.Job) -> None:
    """Shows what a job has made when it has ended."""
    if job.code != 0:
        return
    if job.action == "plan":
        plans[str(job.root)] = read_plan(job)
        return
    show_result(scene, job)


def show_result(scene: bpy.types.Scene, job: run.Job) -> None:
    # A timer has no window, which operators of Blender's importers need.
    window = next(iter(bpy.context.window_manager.windows), None)
    places = {"window": window} if window else {}
    with bpy.context.temp_override(**places, scene=scene, view_layer=scene.view_layers[0]):
        try:
            job.messages.extend(show.show_all(bpy.context, scene, job.shot))
        except ShotError as error:
            job.error = str(error)


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


def redraw() -> None:
    manager = bpy.context.window_manager
    for window in manager.windows if manager else []:
        for area in window.screen.areas:
            if area.type in ("PROPERTIES", "VIEW_3D"):
                area.tag_redraw()


@bpy.app.handlers.persistent
def opened(*_) -> None:
    """Finds the jobs of the folders of a file that was opened."""
    jobs.clear()
    arrivals.clear()
    plans.clear()
    for scene in bpy.data.scenes:
        find_job(scene)


def find_job(scene: bpy.types.Scene) -> None:
    """Takes the last job of a scene's folder, unless it is known."""
    root = root_of(scene)
    if root is None or str(root) in jobs:
        return
    job = run.attach(root)
    if job is not None:
        jobs[str(root)] = job
        if job.is_running:
            watch(scene, job)
            ensure_timer()


def register() -> None:
    settings.updates["folder"] = lambda shot, _context: find_job(shot.id_data)
    bpy.app.handlers.load_post.append(opened)


def unregister() -> None:
    bpy.app.handlers.load_post.remove(opened)
    if bpy.app.timers.is_registered(tick):
        bpy.app.timers.unregister(tick)
    jobs.clear()
