# SPDX-License-Identifier: MIT OR Apache-2.0
"""The buttons: each writes what it needs, starts a job of the engine, and returns at once."""

import time
from pathlib import Path

import bpy
from bpy.props import BoolProperty

from ..messages import ShotError, printable
from . import engine, preset, run, session, settings
from .names import QUALITIES
from .toml import inline

WAIT_SECONDS = 0.05


def check_free(root: Path) -> None:
    """Raises ShotError while a job of any Blender reads the files of a folder."""
    if run.is_locked(root / run.RUN):
        raise ShotError(f"{printable(root)}: a job is running in this folder. Pause it, or wait for its end")


class JobOperator:
    """What all buttons that start a job share."""

    bl_options = {"REGISTER"}
    wait: BoolProperty(name="Wait", description="Return when the job has ended, for scripts", options={"HIDDEN", "SKIP_SAVE"})

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        job = session.job_of(context.scene)
        if job is not None and job.is_running:
            cls.poll_message_set("A job is running in this folder")
            return False
        if context.mode.startswith("EDIT"):
            cls.poll_message_set("Leave Edit Mode first: the mesh that is being edited is not final")
            return False
        return True

    def begin(self, context: bpy.types.Context, action: str, changes: tuple[str, ...] = (), writes: bool = True) -> set[str]:
        """Writes the preset if the action needs it, and starts the engine."""
        scene, shot = context.scene, context.scene.meniscus
        try:
            program, source = engine.find()
            root = preset.folder_of(scene)
            path = root / preset.assets.PRESET
            check_free(root)
            follows, tier = action in session.RUNS, shot.quality
            frames = [scene.frame_start, scene.frame_end, scene.frame_step]
            if writes:
                written = preset.write(context)
                for note in written.notes:
                    self.report({"WARNING"}, note)
                for name in written.removed:
                    self.report({"INFO"}, f"Removed {name} of an earlier preset")
                follows = follows and written.has_surface
            elif action == "resume":
                earlier = session.job_of(scene)
                follows = follows and earlier is not None and any("follow" in step for step in earlier.description.get("steps", []))
                # The preset as it was written last has the frames of that job, not those that the scene has now.
                frames = earlier.description.get("frames", frames) if earlier is not None else frames
            steps = run.steps_of(action, tier, path, list(changes), shot.threads, follows)
            job = run.start(root, program, action, tier, steps, frames, preset.blend_from(root), scene.name)
        except ShotError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
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


class MENISCUS_OT_simulate(JobOperator, bpy.types.Operator):
    """Write the preset, simulate it, and show surfaces as frames arrive. Frames of an equal simulation are kept"""

    bl_idname = "meniscus.simulate"
    bl_label = "Simulate"

    def execute(self, context: bpy.types.Context) -> set[str]:
        return self.begin(context, "simulate")


class MENISCUS_OT_start_over(JobOperator, bpy.types.Operator):
    """Delete the frames of this quality and simulate again"""

    bl_idname = "meniscus.start_over"
    bl_label = "Start Over"

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        return context.window_manager.invoke_confirm(self, event)

    def execute(self, context: bpy.types.Context) -> set[str]:
        return self.begin(context, "start_over")


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
        return self.begin(context, "resume", writes=False)


class MENISCUS_OT_plan(JobOperator, bpy.types.Operator):
    """Write the preset and estimate particles, memory, disk and time"""

    bl_idname = "meniscus.plan"
    bl_label = "Plan"

    def execute(self, context: bpy.types.Context) -> set[str]:
        return self.begin(context, "plan")


class MENISCUS_OT_mesh(JobOperator, bpy.types.Operator):
    """Make the surfaces of simulated frames with the settings of Surface, without simulating"""

    bl_idname = "meniscus.mesh"
    bl_label = "Mesh Again"

    def execute(self, context: bpy.types.Context) -> set[str]:
        scene = context.scene
        table = settings.values(scene.meniscus.surface, "SurfaceParams", scene.unit_settings.scale_length)
        return self.begin(context, "mesh", (f"surface={inline(table)}",), writes=False)


class MENISCUS_OT_whitewater(JobOperator, bpy.types.Operator):
    """Compute spray, foam and bubbles of simulated frames with the settings of Whitewater, without simulating"""

    bl_idname = "meniscus.whitewater"
    bl_label = "Whitewater Again"

    def execute(self, context: bpy.types.Context) -> set[str]:
        scene = context.scene
        table = settings.values(scene.meniscus.whitewater, "WhitewaterParams", scene.unit_settings.scale_length)
        return self.begin(context, "whitewater", (f"whitewater={inline(table)}",), writes=False)


class MENISCUS_OT_write(bpy.types.Operator):
    """Write the preset and its meshes, to run it elsewhere"""

    bl_idname = "meniscus.write"
    bl_label = "Write Preset"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return JobOperator.poll.__func__(cls, context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            check_free(preset.folder_of(context.scene))
            written = preset.write(context, takes_over=True)
        except ShotError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
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

    def execute(self, context: bpy.types.Context) -> set[str]:
        scene = context.scene
        try:
            folder = preset.folder_of(scene) / scene.meniscus.quality
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
