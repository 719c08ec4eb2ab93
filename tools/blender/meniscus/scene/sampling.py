# SPDX-License-Identifier: MIT OR Apache-2.0
"""Operators that write the preset: at once from scripts and in background, in a window as a modal operator that Esc cancels.

A frame of a heavy scene takes seconds to evaluate, and a point cache has gigabytes, so in a window a timer takes a few steps per tick:
frames that are sampled, objects whose tables are composed, parts of files. Other input of that window waits: an edit between two frames
would be in half of the samples. Undo, loading and saving from another window cancel, and so do roles and settings that are changed there.
"""

import time

import bpy

from ..messages import ShotError, printable
from . import changes, preset

TICK_SECONDS = 0.02
# Steps are taken for this long per tick, one at least, before the window is drawn again.
BUDGET_SECONDS = 0.1
CANCELLED = "Cancelled while the scene was sampled and written: the files and the current frame are as before"


class Sampling:
    """A preset that is being written in steps. Only one is at a time, since it changes the current frame."""

    # Of this Blender.
    current: "Sampling | None" = None

    def __init__(self, context: bpy.types.Context, takes_over: bool) -> None:
        self.scene, self.layer, self.scene_name = context.scene, context.view_layer, context.scene.name
        self.step = preset.Step(preset.SAMPLING, 0.0)
        # What the preset reads, and the frame, at the end of the last tick.
        self.settings: changes.Settings | None = None
        self.frame = (0, 0.0)
        self.steps = preset.writing(context, takes_over)
        Sampling.current = self

    def advance(self, seconds: float) -> preset.Written | None:
        """Takes steps for some time, one at least; what was written after the last. Raises ShotError, and is then closed."""
        end = time.monotonic() + seconds
        try:
            self.check()
            while True:
                self.step = next(self.steps)
                if time.monotonic() >= end:
                    self.remember()
                    return None
        except StopIteration as done:
            self.close()
            return done.value
        except ReferenceError:
            self.close()
            raise ShotError("An object was removed while the scene was sampled; no file was written. Start again") from None
        except BaseException:
            self.close()
            raise

    def remember(self) -> None:
        """Keeps what the preset reads, unless all of it was read."""
        self.frame = (self.scene.frame_current, self.scene.frame_subframe)
        self.settings = changes.settings_of(self.scene, self.layer) if self.step.is_reading else None

    def check(self) -> None:
        """Raises ShotError if a role or a setting was changed since the last tick: a preset would have half of both."""
        if self.settings is None:
            return
        if (self.scene.frame_current, self.scene.frame_subframe) != self.frame:
            # Another window plays the animation: what is animated has the values of another frame.
            self.scene.frame_set(self.frame[0], subframe=self.frame[1])
        changed = changes.difference(self.settings, changes.settings_of(self.scene, self.layer))
        if changed is not None:
            raise ShotError(f"{printable(changed)} changed while the scene was sampled; no file was written. Start again")

    @property
    def is_open(self) -> bool:
        return Sampling.current is self

    def text(self) -> str:
        return f"{self.step.label} {100.0 * self.step.part:.0f} %. Esc cancels"

    def close(self) -> None:
        """Restores the scene as it was; no file is changed."""
        if self.is_open:
            Sampling.current = None
            self.steps.close()


def text_of(scene: bpy.types.Scene) -> str | None:
    """The line of the panel while the preset of a scene is written."""
    running = Sampling.current
    return running.text() if running is not None and running.scene_name == scene.name else None


@bpy.app.handlers.persistent
def stop(*_) -> None:
    """Ends sampling before the data that it holds are replaced, or are saved in the frame that it is in."""
    if Sampling.current is not None:
        Sampling.current.close()


HANDLERS = ("undo_pre", "redo_pre", "load_pre", "save_pre")


def register() -> None:
    for name in HANDLERS:
        getattr(bpy.app.handlers, name).append(stop)


def unregister() -> None:
    stop()
    for name in HANDLERS:
        getattr(bpy.app.handlers, name).remove(stop)


def has_window(context: bpy.types.Context) -> bool:
    """Whether timers and keys arrive."""
    return context.window is not None and not bpy.app.background


class PresetOperator:
    """What operators that write the preset share; they define `prepare` and `finish`. Raised ShotErrors are reported."""

    takes_over = False

    def prepare(self, context: bpy.types.Context) -> None:
        """Checks what can be checked before anything is sampled."""

    def finish(self, context: bpy.types.Context, written: preset.Written) -> set[str]:
        """Goes on with the written preset."""
        raise NotImplementedError

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            self.prepare(context)
            return self.finish(context, preset.write(context, self.takes_over))
        except ShotError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        if not has_window(context) or getattr(self, "wait", False):
            return self.execute(context)
        try:
            self.prepare(context)
            self.sampling, self.timer = Sampling(context, self.takes_over), None
            written = self.sampling.advance(BUDGET_SECONDS)
            if written is not None:
                return self.finish(context, written)
        except ShotError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.wait_for_events(context)
        self.show(context)
        return {"RUNNING_MODAL"}

    def wait_for_events(self, context: bpy.types.Context) -> None:
        self.timer = context.window_manager.event_timer_add(TICK_SECONDS, window=context.window)
        context.window_manager.modal_handler_add(self)

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if not self.sampling.is_open or (event.type == "ESC" and event.value == "PRESS"):
            self.cancel(context)
            self.report({"WARNING"}, CANCELLED)
            return {"CANCELLED"}
        if event.type != "TIMER" or bpy.app.is_job_running("RENDER"):
            return {"RUNNING_MODAL"}
        try:
            written = self.sampling.advance(BUDGET_SECONDS)
            if written is None:
                self.show(context)
                return {"RUNNING_MODAL"}
            self.cancel(context)
            return self.finish(context, written)
        except ShotError as error:
            self.cancel(context)
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        except BaseException:
            self.cancel(context)
            raise

    def cancel(self, context: bpy.types.Context) -> None:
        """Ends sampling, however far it is; Blender calls it when it closes the window."""
        self.sampling.close()
        if self.timer is not None:
            context.window_manager.event_timer_remove(self.timer)
            self.timer = None
        if context.workspace is not None:
            context.workspace.status_text_set(None)
        redraw(context)

    def show(self, context: bpy.types.Context) -> None:
        if context.workspace is not None:
            context.workspace.status_text_set(f"Meniscus: {printable(self.sampling.text())}")
        redraw(context)


def redraw(context: bpy.types.Context) -> None:
    manager = context.window_manager
    for window in manager.windows if manager else []:
        for area in window.screen.areas:
            if area.type in ("PROPERTIES", "VIEW_3D"):
                area.tag_redraw()
