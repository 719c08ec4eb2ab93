# SPDX-License-Identifier: MIT OR Apache-2.0
"""Tests of results that arrive while a job runs, for the stage of logs.py: without the engine, from files that are made up."""

import os
from pathlib import Path
from types import SimpleNamespace

import bpy

from harness import check
from scenes import empty, scene_module


def running(folder: Path, count: int):
    """A job that has reported so many frames of smoke, with their empty files; its arrivals."""
    shot = folder / "meniscus" / "draft"
    (shot / "volume").mkdir(parents=True, exist_ok=True)
    job = SimpleNamespace(shot=shot, root=shot.parent, messages=[], passes=lambda: {})
    job.frames_of = lambda product: set(range(1, job.count + 1)) if product == "volumes" else set()
    job.count = 0
    for frame in range(1, count + 1):
        (shot / "volume" / f"smoke_{frame:04}.vdb").touch()
    return job, scene_module("arrivals").Arrivals(job, list(range(1, count + 1)))


def check_late_smoke(folder: Path) -> None:
    """Of smoke that starts late each file is checked and opened once, and the panel has the object's present name."""
    scene = empty(folder)
    module, count, first = scene_module("arrivals"), 12, 9
    job, arrived = running(folder, count)
    checked, opened, made = [], [], []

    def extent(_context, _name: str, paths: list[str]) -> float | None:
        opened.extend(paths)
        return 2.0 if any(int(path[-8:-4]) >= first for path in paths) else None

    def add_volume(_context, output, _folder: str, present: list[int], _liquid) -> list[bpy.types.Object]:
        made.append(present)
        return [bpy.data.objects.new("smoke", bpy.data.volumes.new("smoke"))]

    before = module.check_vdb, module.volumes.extent, module.volumes.add_volume
    module.check_vdb, module.volumes.extent, module.volumes.add_volume = (lambda _files, path: checked.append(path)), extent, add_volume
    try:
        for job.count in range(1, count + 1):
            arrived.update(bpy.context, scene, job)
            if job.count < first and arrived.text():
                made.append(arrived.text())
    finally:
        module.check_vdb, module.volumes.extent, module.volumes.add_volume = before
    check(len(checked) == count and len(opened) == first, "each file of smoke that starts late is checked and opened once", (len(checked), len(opened)))
    shown = next((each for each in scene.objects if each.get("meniscus_output") == "volume:smoke"), None)
    check(made == [[first]] and shown is not None and shown.data.frame_duration == count, "it is shown from its first smoke on", made)
    check(arrived.text() == "Shown to frame: Smoke 12", "the panel lists it", arrived.text())
    check(not job.messages, "new files of smoke need no remark", job.messages)
    for file in (job.shot / "volume").iterdir():
        os.utime(file, ns=(0, 0))
    module.check_vdb, module.volumes.extent, module.volumes.add_volume = (lambda _files, _path: None), extent, add_volume
    try:
        again = module.Arrivals(job, list(range(1, count + 1)))
        for job.count in (first, count):
            again.update(bpy.context, scene, job)
    finally:
        module.check_vdb, module.volumes.extent, module.volumes.add_volume = before
    found = [text for text in job.messages if "rewritten" in text and "new Blender" in text]
    check(len(found) == len(job.messages) == 1, "files that a second simulation rewrites are reported once", job.messages)


def check_renamed_result(folder: Path) -> None:
    """A result that is renamed while its job runs is listed once, by its present name."""
    scene = empty(folder)
    job, arrived = running(folder, 2)
    shown = bpy.data.objects.new("Cloth Simulated", None)
    shown["meniscus_output"] = "sheet:Cloth"
    scene.collection.objects.link(shown)
    module = scene_module("arrivals")
    before = module.show.show_shapes
    module.show.show_shapes = lambda *_: []
    try:
        arrived.scene = scene.session_uid
        for frame in (1, 2):
            arrived.shapes(bpy.context, scene, None, None, {"sheet:Cloth": frame})
            shown.name = "Sail"
    finally:
        module.show.show_shapes = before
    check(arrived.text() == "Shown to frame: Sail 2", "a renamed result is listed once", arrived.text())
