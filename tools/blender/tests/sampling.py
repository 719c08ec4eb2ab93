# SPDX-License-Identifier: MIT OR Apache-2.0
"""Tests of how presets are written over time, inside Blender: a few steps a tick, Esc, progress, no frame of a scene at rest.

run.py starts each stage in a process of its own. There is no window, so events are made up.
"""

import os
import time
from pathlib import Path
from types import SimpleNamespace

import bpy

import harness
from harness import check
from presets import add, fresh
from results import drawn
from logs import full
from scenes import scene_module, wait

LAST = 40
# An interruption of sampling.
NOT_FINITE = "a location that is NaN"


class Sampled:
    """Counts the frames in which objects are sampled."""

    def __init__(self) -> None:
        self.sample, self.frames = scene_module("sample"), []
        self.original = self.sample.sample_frame

    def __enter__(self) -> list[int]:
        def counted(each, *rest):
            self.frames.append(bpy.context.scene.frame_current)
            return self.original(each, *rest)

        self.sample.sample_frame = counted
        return self.frames

    def __exit__(self, *_) -> None:
        self.sample.sample_frame = self.original


def check_rest(folder: Path) -> None:
    """Frames are sampled only if something on which an object with a role depends may move."""
    scene = fresh(folder)
    scene.frame_end = LAST
    target = bpy.data.objects.new("Target", None)
    scene.collection.objects.link(target)
    pool = bpy.data.objects["Pool"]
    other = add("collider")
    other.meniscus.role = "NONE"
    other.keyframe_insert("location", frame=1)
    cases = [("a scene at rest, whatever moves in it without a role", lambda: None, False)]
    cases.append(("the parent of a parent", lambda: parent(pool, parent(target, other)), True))
    cases.append(("a constraint", lambda: setattr(pool.constraints.new("COPY_LOCATION"), "target", other), True))
    cases.append(("a constraint to nothing that moves", lambda: pool.constraints.new("LIMIT_LOCATION"), False))
    cases.append(("a track of a movie clip", lambda: pool.constraints.new("FOLLOW_TRACK"), True))
    cases.append(("a camera solver of a bone", lambda: parent(pool, rig()).parent.pose.bones[0].constraints.new("CAMERA_SOLVER"), True))
    cases.append(("a metaball of the family", lambda: family(pool, other), True))
    cases.append(("a driver", lambda: drive(pool, other), True))
    cases.append(("a modifier with a time of its own", lambda: pool.modifiers.new("Wave", "WAVE"), True))
    cases.append(("a modifier", lambda: pool.modifiers.new("Bevel", "BEVEL"), False))
    cases.append(("an animated setting of the scene", lambda: scene.keyframe_insert("gravity"), True))
    cases.append(("a handler of another extension", lambda: bpy.app.handlers.frame_change_post.append(handler), True))
    cases.append(("a parent that is a rigid body", lambda: parent(pool, rigid()), True))
    for name, change, moves in cases:
        change()
        with Sampled() as frames:
            scene_module("preset").write(bpy.context)
        expected = list(range(1, LAST + 1)) if moves else [1]
        check(sorted(set(frames)) == expected, f"{name}: {'every frame is' if moves else 'one frame is'} sampled", frames)
        restore(pool, target, scene)


def handler(*_) -> None:
    """Moves nothing."""


def parent(one: bpy.types.Object, other: bpy.types.Object) -> bpy.types.Object:
    one.parent = other
    return one


def rigid() -> bpy.types.Object:
    each = bpy.data.objects.new("Rigid", bpy.data.meshes.new("Rigid"))
    bpy.context.collection.objects.link(each)
    with bpy.context.temp_override(object=each, active_object=each, selected_objects=[each]):
        bpy.ops.rigidbody.object_add()
    return each


def rig() -> bpy.types.Object:
    each = bpy.data.objects.new("Rig", bpy.data.armatures.new("Rig"))
    bpy.context.collection.objects.link(each)
    bpy.context.view_layer.objects.active = each
    bpy.ops.object.mode_set(mode="EDIT")
    each.data.edit_bones.new("Bone").tail = (0.0, 0.0, 1.0)
    bpy.ops.object.mode_set(mode="OBJECT")
    return each


def family(pool: bpy.types.Object, other: bpy.types.Object) -> None:
    """Two metaballs with one surface: the first has a role, the second moves."""
    for name in ("Ball", "Ball.001"):
        each = bpy.data.objects.new(name, bpy.data.metaballs.new(name))
        each.data.elements.new()
        bpy.context.collection.objects.link(each)
    each.parent = other
    bpy.data.objects["Ball"].meniscus.role = "COLLIDER"


def drive(pool: bpy.types.Object, other: bpy.types.Object) -> None:
    variable = pool.driver_add("location", 0).driver.variables.new()
    variable.targets[0].id, variable.targets[0].data_path = other, "location.x"


def restore(pool: bpy.types.Object, target: bpy.types.Object, scene: bpy.types.Scene) -> None:
    pool.parent = target.parent = None
    for name in ("Ball", "Ball.001"):
        if name in bpy.data.objects:
            bpy.data.objects.remove(bpy.data.objects[name])
    pool.constraints.clear()
    pool.modifiers.clear()
    pool.animation_data_clear()
    scene.animation_data_clear()
    if handler in bpy.app.handlers.frame_change_post:
        bpy.app.handlers.frame_change_post.remove(handler)


def button(operator: type):
    """A stand-in for a button that was pressed in a window: without one, Blender makes no modal operator."""
    sampling = scene_module("sampling")
    found = {"reports": [], "timer": None}
    found["report"] = lambda self, kind, text: self.reports.append((*kind, text))
    found["wait_for_events"] = lambda self, _context: None
    for name in ("takes_over", "prepare", "finish", "start", "action", "wait", "wait_for"):
        if hasattr(operator, name):
            found[name] = getattr(operator, name)
    return type("Button", (sampling.PresetOperator,), found | {"wait": False, "replaces": False})()


def event(kind: str) -> SimpleNamespace:
    return SimpleNamespace(type=kind, value="PRESS")


def moving_pool(folder: Path) -> bpy.types.Scene:
    scene = fresh(folder)
    scene.frame_end = LAST
    made = add("collider")
    for frame in (1, LAST):
        made.location.z = frame
        made.keyframe_insert("location", frame=frame)
    made.hide_set(True)
    scene.frame_set(7, subframe=0.25)
    return scene


def waving_pool(folder: Path) -> bpy.types.Scene:
    """The same with a collider that deforms, whose point cache has a part for each frame."""
    scene = moving_pool(folder)
    wave = bpy.data.objects["Collider"].modifiers.new("Wave", "WAVE")
    wave.height, wave.width = 0.1, 0.5
    return scene


def state(scene: bpy.types.Scene) -> tuple:
    """What sampling changes for a while."""
    return scene.frame_current, scene.frame_subframe, bpy.data.objects["Collider"].hide_get()


def check_modal(folder: Path) -> None:
    """A button samples a frame a tick, shows how far it is, and leaves the scene as it was."""
    scene, context = waving_pool(folder), bpy.context
    operators, panels = scene_module("operators"), scene_module("panels")
    path, before = folder / "meniscus" / "scene.toml", state(scene)
    pressed, ticks, texts, files = button(operators.MENISCUS_OT_write), 1, [], set()
    with Sampled() as frames:
        answer = pressed.invoke(context, event("LEFTMOUSE"))
        check(answer == {"RUNNING_MODAL"} and len(set(frames)) == 1, "a button that writes the preset is modal after its first frame", (answer, frames))
        works = [name for name in ("simulate", "write", "show") if getattr(bpy.ops.meniscus, name).poll()]
        check(not works, "no second button works meanwhile", works)
        check(pressed.modal(context, event("MOUSEMOVE")) == {"RUNNING_MODAL"} and len(set(frames)) == 1, "other events sample nothing, and change nothing")
        check(not path.exists(), "no preset is written yet")
        # As an animation does that another window plays.
        scene.frame_set(LAST)
        while answer == {"RUNNING_MODAL"} and ticks < 10 * LAST:
            texts += drawn(panels.MENISCUS_PT_sidebar)
            files |= {each.name for each in (folder / "meniscus").rglob("*") if each.is_file() and not each.name.startswith(".")}
            answer = pressed.modal(context, event("TIMER"))
            ticks += 1
    check(answer == {"FINISHED"} and path.is_file(), "the preset is written after the last frame", (answer, pressed.reports))
    check(not files, "its files appear in the last tick, all at once", files)
    counts = [len({text for text in texts if label in text}) for label in ("Composing", "Writing files")]
    check(counts[0] == 2 and counts[1] >= LAST, "a tick composes one object, or writes one part of a file", counts)
    check(ticks >= LAST and sorted(set(frames)) == list(range(1, LAST + 1)), "a tick samples one frame of a heavy scene", (ticks, len(set(frames))))
    shown = [text for text in texts if "%" in text]
    check(len(set(shown)) > LAST // 2 and all("Esc" in text for text in shown), "the panel shows the progress, and that Esc cancels", shown[:3])
    check(state(scene) == before, "frame and hidden objects are as before", (state(scene), before))
    written = path.read_bytes()
    bpy.ops.meniscus.write()
    check(path.read_bytes() == written and state(scene) == before, "a script writes the same at once")


def check_cancelled(folder: Path) -> None:
    """Esc, an undo, changes of the scene, and an error in a frame end the sampling without a trace."""
    for name in ("Esc", "undo", "a save", "a removed object", *EDITS, NOT_FINITE):
        scene, context = moving_pool(folder / name), bpy.context
        before, path = state(scene), folder / name / "meniscus" / "scene.toml"
        pressed = button(scene_module("operators").MENISCUS_OT_write)
        pressed.invoke(context, event("LEFTMOUSE"))
        pressed.modal(context, event("TIMER"))
        check(state(scene) != before, f"{name}: the scene is in another frame", state(scene))
        answer = interrupt(name, pressed)
        check(answer == {"CANCELLED"}, f"{name} cancels", answer)
        texts = [text for kind, text in pressed.reports if kind in ("WARNING", "ERROR")]
        expected = EDITS[name][1] if name in EDITS else ""
        check(len(texts) == 1 and "sampled" in texts[0] and texts[0].startswith(expected), f"{name} is reported", pressed.reports)
        if name != "a removed object":
            check(state(scene) == before, f"{name}: frame and hidden objects are as before", (state(scene), before))
        check(scene.frame_current == 7 and not path.exists(), f"{name}: nothing is written", scene.frame_current)
        check(bpy.ops.meniscus.simulate.poll() and bpy.ops.meniscus.write.poll(), f"{name}: the buttons work again")


def collider() -> bpy.types.Object:
    return bpy.data.objects["Collider"]


# What a second window can change, and how the message on it starts.
EDITS = {
    "a longer frame range": (lambda scene: setattr(scene, "frame_end", LAST + 10), "Scene: its frame end"),
    "another frame rate": (lambda scene: setattr(scene.render, "fps", 25), "Scene: its fps"),
    "another unit scale": (lambda scene: setattr(scene.unit_settings, "scale_length", 0.5), "Scene: its unit scale"),
    "another quality": (lambda scene: setattr(scene.meniscus, "quality", "final"), "Scene: its quality"),
    "another setting of the liquid": (lambda scene: setattr(scene.meniscus.liquid, "density", 900.0), "Scene: its liquid density"),
    "another role": (lambda scene: setattr(collider().meniscus, "role", "FLUID"), "Collider: its role"),
    "a role that is removed": (lambda scene: setattr(collider().meniscus, "role", "NONE"), "Collider: its role"),
    "a new role": (lambda scene: new_role(scene), "Late: its role"),
    "another setting of an object": (lambda scene: setattr(collider().meniscus.collider, "friction", 0.7), "Collider: its collider friction"),
    "another place": (lambda scene: setattr(bpy.data.objects["Pool"], "location", (0.0, 0.0, 1.0)), "Pool: its place"),
    "an object that is hidden": (lambda scene: bpy.data.objects["Pool"].hide_set(True), "Pool: its visibility"),
}


def new_role(scene: bpy.types.Scene) -> None:
    late = bpy.data.objects.new("Late", None)
    scene.collection.objects.link(late)
    late.meniscus.role = "FORCE"


def interrupt(name: str, pressed) -> set[str]:
    """What happens while frames are sampled; what the operator then returns."""
    if name == "Esc":
        return pressed.modal(bpy.context, event("ESC"))
    if name == "undo":
        for each in bpy.app.handlers.undo_pre:
            each(bpy.context.scene)
    elif name == "a save":
        bpy.ops.wm.save_mainfile()
    elif name == "a removed object":
        bpy.data.objects.remove(bpy.data.objects["Pool"])
    elif name in EDITS:
        EDITS[name][0](bpy.context.scene)
    else:
        bpy.data.objects["Collider"].location.z = float("nan")
        bpy.data.objects["Collider"].animation_data_clear()
    return pressed.modal(bpy.context, event("TIMER"))


def check_cancelled_late(folder: Path) -> None:
    """Esc while tables are composed or files are written leaves the files of the earlier preset, and no others; so does an error."""
    scene, context = waving_pool(folder), bpy.context
    bpy.ops.meniscus.write()
    bpy.data.objects["Collider"].modifiers["Wave"].height = 0.2
    before, frame = contents(folder), state(scene)
    for label in ("Composing", "Writing files"):
        pressed = button(scene_module("operators").MENISCUS_OT_write)
        pressed.invoke(context, event("LEFTMOUSE"))
        while label not in pressed.sampling.text() and pressed.modal(context, event("TIMER")) == {"RUNNING_MODAL"}:
            pass
        for _ in range(LAST if label == "Writing files" else 1):
            pressed.modal(context, event("TIMER"))
        is_within = label in pressed.sampling.text() and pressed.sampling.is_open
        check(is_within and pressed.modal(context, event("ESC")) == {"CANCELLED"}, f"{label}: Esc cancels", pressed.sampling.text())
        check(contents(folder) == before and state(scene) == frame, f"{label}: the earlier preset and its meshes stay", sorted(contents(folder)))
    assets = scene_module("assets")
    replace, assets.sync = assets.sync, full
    try:
        bpy.ops.meniscus.write()
    except RuntimeError as error:
        check("cannot be written" in str(error), "a full disk is reported", error)
    finally:
        assets.sync = replace
    check(contents(folder) == before, "and leaves the earlier preset and its meshes", sorted(contents(folder)))
    check_locked_meanwhile(folder, before)
    for name, age in ((".Collider.pc2.1.tmp", 2 * 86400), (".Collider.ply.1.tmp", 60), ("..Mine.1.tmp", 2 * 86400)):
        path = folder / "meniscus" / "assets" / name
        path.write_bytes(b"part")
        os.utime(path, (time.time() - age,) * 2)
    bpy.ops.meniscus.write()
    left = [each.name for each in (folder / "meniscus" / "assets").glob(".*.tmp")]
    check(sorted(left) == ["..Mine.1.tmp", ".Collider.ply.1.tmp"], "a temporary file of a Blender that ended long ago is removed, no other one", left)
    for name in left:
        (folder / "meniscus" / "assets" / name).unlink()
    after = contents(folder)
    changed = {path for path in after if after[path] != before.get(path)}
    is_right = changed == {"assets/Collider.pc2", "assets/Collider.ply"} and after.keys() == before.keys()
    check(is_right, "then only files that differ are written", changed)


def check_locked_meanwhile(folder: Path, before: dict[str, tuple[int, bytes]]) -> None:
    """Files of a preset are not replaced under a job that another Blender has started since."""
    run, steps = scene_module("run"), scene_module("preset").writing(bpy.context)
    next(steps)
    is_locked, run.is_locked = run.is_locked, lambda _path: True
    try:
        for _ in steps:
            pass
        check(False, "a job that has started meanwhile is found")
    except scene_module("preset").ShotError as error:
        check("a job is running in this folder" in str(error), "a job that has started meanwhile is found", error)
    finally:
        run.is_locked = is_locked
    check(contents(folder) == before, "and its files stay", sorted(contents(folder)))


def contents(folder: Path) -> dict[str, tuple[int, bytes]]:
    """When every file of a preset was written, and its content; temporary ones included."""
    root = folder / "meniscus"
    return {each.relative_to(root).as_posix(): (each.stat().st_mtime_ns, each.read_bytes()) for each in root.rglob("*") if each.is_file()}


def check_script(folder: Path) -> None:
    """What a script adds takes part, without an update of the view layer."""
    scene = fresh(folder)
    late = bpy.data.objects["Pool"].copy()
    scene.collection.objects.link(late)
    notes = scene_module("preset").write(bpy.context).notes
    text = (folder / "meniscus" / "scene.toml").read_text()
    check(text.count("[[liquid.source]]") == 2 and not any("left out" in note for note in notes), "an object that a script has just added takes part", notes)


def check_simulate(folder: Path) -> None:
    """*Plan*, *Simulate* and *Start Over* of a window start the engine after the last frame."""
    scene = moving_pool(folder)
    scene.frame_end = 2
    operators, session, sampling = (scene_module(name) for name in ("operators", "session", "sampling"))
    operators.has_window = sampling.has_window
    for action in ("plan", "simulate"):
        pressed, before = button(getattr(operators, f"MENISCUS_OT_{action}")), session.job_of(scene)
        answer, looks = pressed.invoke(bpy.context, event("LEFTMOUSE")), 0
        check(session.job_of(scene) is before, f"{action}: no job starts while frames are sampled")
        while answer == {"RUNNING_MODAL"} and looks < 100:
            answer, looks = pressed.modal(bpy.context, event("TIMER")), looks + 1
        job = session.job_of(scene)
        is_started = answer == {"FINISHED"} and job is not None and job.action == action
        check(is_started, f"{action}: the engine starts after the last frame", (answer, pressed.reports))
        check(sampling.Sampling.current is None, f"{action}: sampling has ended")
        wait(scene)
        check(job.description["frames"] == [1, 2, 1] and not job.error, f"{action}: the job has the frames of the preset", job.error)
    marked = folder / "meniscus" / scene.meniscus.quality / "shot.json"
    before = marked.stat().st_mtime_ns
    # Confirmed by a dialog, it invokes Simulate, which is done in one tick: Blender itself has no modal operators without a window.
    sampling.BUDGET_SECONDS = 60.0
    answer, job = bpy.ops.meniscus.start_over("EXEC_DEFAULT"), session.job_of(scene)
    check(answer == {"FINISHED"} and job.action == "start_over", "Start Over starts its own job when it was confirmed", (answer, job.action))
    wait(scene)
    check(not job.error and marked.stat().st_mtime_ns > before, "Start Over simulates again", job.error)


def stage_sampling(folder: Path) -> None:
    check_rest(folder / "rest")
    check_script(folder / "script")
    sampling = scene_module("sampling")
    sampling.has_window = lambda context: True
    sampling.BUDGET_SECONDS = 0.0
    check_modal(folder / "modal")
    check_cancelled(folder / "cancelled")
    check_cancelled_late(folder / "cancelled late")
    check_simulate(folder / "simulate")


if __name__ == "__main__":
    harness.run(globals())
