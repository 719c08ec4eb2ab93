# SPDX-License-Identifier: MIT OR Apache-2.0
"""The buttons: each writes what it needs and starts a job of the engine. In a window, none blocks Blender."""

import time

import bpy
from bpy.props import BoolProperty

from ..messages import ShotError
from . import engine, places, preset, run, session, settings
from .names import QUALITIES
from .sampling import PresetOperator, Sampling, has_window
from .toml import inline

WAIT_SECONDS = 0.05
SAMPLING = "A preset is being written. Esc cancels"


class JobOperator:
    """What all buttons that start a job share."""

    bl_options = {"REGISTER"}
    wait: BoolProperty(name="Wait", description="Return when the job has ended, for scripts", options={"HIDDEN", "SKIP_SAVE"})

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        job = session.job_of(context.scene)
        if Sampling.current is not None:
            cls.poll_message_set(SAMPLING)
            return False
        if job is not None and job.is_running:
            cls.poll_message_set("A job is running in this folder")
            return False
        if context.mode.startswith("EDIT"):
            cls.poll_message_set("Leave Edit Mode first: the mesh that is being edited is not final")
            return False
        return True

    def begin(self, context: bpy.types.Context, action: str, changes: tuple[str, ...] = ()) -> set[str]:
        """Starts an action that uses the preset as it was written last."""
        try:
            root = places.folder_of(context.scene)
            run.check_free(root)
            earlier, frames, products = session.job_of(context.scene), scene_frames(context.scene), set()
            if action == "resume" and earlier is not None:
                # The preset has the frames of that job, not those that the scene has now.
                frames, products = earlier.description.get("frames", frames), earlier.products()
            return self.start(context, action, frames, changes, products)
        except ShotError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}

    def start(self, context: bpy.types.Context, action: str, frames: list[int], changes: tuple[str, ...], products: set[str]) -> set[str]:
        """Starts the engine in the scene's folder. Raises ShotError."""
        scene, shot = context.scene, context.scene.meniscus
        program, source = engine.find()
        root, tier = places.folder_of(scene), shot.quality
        path = root / preset.assets.PRESET
        steps = run.steps_of(action, tier, path, list(changes), shot.threads, products)
        job = run.start(root, program, action, tier, steps, frames, places.blend_from(root), scene.name)
        self.report({"INFO"}, f"Started {action.replace('_', ' ')} of {path.name} at {tier} with the engine of {source}")
        session.begin(scene, job)
        if self.wait:
            self.wait_for(scene, job)
        return {"FINISHED"}

    def wait_for(self, scene: bpy.types.Scene, job: run.Job) -> None:
        while job.is_running:
            session.advance(scene, job)
            time.sleep(WAIT_SECONDS)
        for text in job.messages:
            self.report({"INFO"}, text)
        if job.error:
            self.report({"ERROR"}, f"{session.status(job)}. {job.error}")


def scene_frames(scene: bpy.types.Scene) -> list[int]:
    return [scene.frame_start, scene.frame_end, scene.frame_step]


class WritingJobOperator(PresetOperator, JobOperator):
    """A job of a preset that is written before."""

    action = ""

    def prepare(self, context: bpy.types.Context) -> None:
        engine.find()

    def finish(self, context: bpy.types.Context, written: preset.Written) -> set[str]:
        for note in written.notes:
            self.report({"WARNING"}, note)
        for name in written.removed:
            self.report({"INFO"}, f"Removed {name} of an earlier preset")
        products = written.products if self.action in session.RUNS else set()
        return self.start(context, self.action, written.frames, (), products)


class MENISCUS_OT_simulate(WritingJobOperator, bpy.types.Operator):
    """Write the preset, simulate it, and show results as frames arrive. Frames of an equal simulation are kept"""

    bl_idname = "meniscus.simulate"
    bl_label = "Simulate"

    replaces: BoolProperty(name="Start Over", description="Delete the frames of this quality", options={"HIDDEN", "SKIP_SAVE"})

    @property
    def action(self) -> str:
        return "start_over" if self.replaces else "simulate"


class MENISCUS_OT_start_over(WritingJobOperator, bpy.types.Operator):
    """Delete the frames of this quality and simulate again"""

    bl_idname = "meniscus.start_over"
    bl_label = "Start Over"
    action = "start_over"

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        return context.window_manager.invoke_confirm(self, event)

    def execute(self, context: bpy.types.Context) -> set[str]:
        if self.wait or not has_window(context):
            return super().execute(context)
        # A confirmed operator is executed, and only an invoked one can be modal.
        try:
            bpy.ops.meniscus.simulate("INVOKE_DEFAULT", replaces=True)
        except RuntimeError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}


class MENISCUS_OT_resume(JobOperator, bpy.types.Operator):
    """Go on with the preset as it was written last, after its last finished frame"""

    bl_idname = "meniscus.resume"
    bl_label = "Resume"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if session.job_of(context.scene) is None:
            cls.poll_message_set("This folder has no job yet. Simulate first")
            return False
        return super().poll(context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        job = session.job_of(context.scene)
        if job is not None and job.tier in QUALITIES:
            context.scene.meniscus.quality = job.tier
        return self.begin(context, "resume")


class MENISCUS_OT_plan(WritingJobOperator, bpy.types.Operator):
    """Write the preset and estimate particles, memory, disk and time"""

    bl_idname = "meniscus.plan"
    bl_label = "Plan"
    action = "plan"


class MENISCUS_OT_mesh(JobOperator, bpy.types.Operator):
    """Make the surfaces of simulated frames with the settings of Surface, without simulating"""

    bl_idname = "meniscus.mesh"
    bl_label = "Mesh Again"

    def execute(self, context: bpy.types.Context) -> set[str]:
        scene = context.scene
        table = settings.values(scene.meniscus.surface, "SurfaceParams", scene.unit_settings.scale_length)
        return self.begin(context, "mesh", (f"surface={inline(table)}",))


class MENISCUS_OT_whitewater(JobOperator, bpy.types.Operator):
    """Compute spray, foam and bubbles of simulated frames with the settings of Whitewater, without simulating"""

    bl_idname = "meniscus.whitewater"
    bl_label = "Whitewater Again"

    def execute(self, context: bpy.types.Context) -> set[str]:
        scene = context.scene
        table = settings.values(scene.meniscus.whitewater, "WhitewaterParams", scene.unit_settings.scale_length)
        return self.begin(context, "whitewater", (f"whitewater={inline(table)}",))


class MENISCUS_OT_write(PresetOperator, bpy.types.Operator):
    """Write the preset and its meshes, to run it elsewhere"""

    bl_idname = "meniscus.write"
    bl_label = "Write Preset"
    takes_over = True

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return JobOperator.poll.__func__(cls, context)

    def finish(self, context: bpy.types.Context, written: preset.Written) -> set[str]:
        for note in written.notes:
            self.report({"WARNING"}, note)
        self.report({"INFO"}, f"Wrote {written.path}")
        return {"FINISHED"}


class MENISCUS_OT_pause(bpy.types.Operator):
    """Stop the engine after its current step; finished frames are kept"""

    bl_idname = "meniscus.pause"
    bl_label = "Pause"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        job = session.job_of(context.scene)
        return job is not None and job.is_running and not job.is_stopping()

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            session.job_of(context.scene).stop()
        except ShotError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}


class MENISCUS_OT_show(bpy.types.Operator):
    """Show the results that the shot folder of this quality has"""

    bl_idname = "meniscus.show"
    bl_label = "Show Result"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if Sampling.current is not None:
            # It changes the current frame, too.
            cls.poll_message_set(SAMPLING)
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        scene = context.scene
        try:
            folder = places.folder_of(scene) / scene.meniscus.quality
            for note in session.show.show_all(context, scene, folder):
                self.report({"WARNING"}, note)
        except ShotError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}


CLASSES = [
    MENISCUS_OT_simulate,
    MENISCUS_OT_start_over,
    MENISCUS_OT_resume,
    MENISCUS_OT_plan,
    MENISCUS_OT_mesh,
    MENISCUS_OT_whitewater,
    MENISCUS_OT_write,
    MENISCUS_OT_pause,
    MENISCUS_OT_show,
]
