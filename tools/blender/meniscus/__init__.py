# SPDX-License-Identifier: MIT OR Apache-2.0
"""Meniscus for Blender: File > Import > Meniscus Shot opens the shot.json of a shot folder.

Each PLY mesh sequence of the shot becomes an object whose geometry nodes read the file of the current frame, each volume
sequence without a mesh of the same name a volume object, each sheet a mesh that a point cache moves, each collider a mesh with
keyframes. A scene without camera, ground and light gets them.
What is made consists of plain Blender data: a saved file renders without this add-on and with scripts
disabled.
"""

from pathlib import Path

import bpy
from bpy.props import BoolProperty, EnumProperty, StringProperty
from bpy_extras.io_utils import ImportHelper

from . import reload, scene, studio, volumes
from .check import check_cache, check_files
from .folder import ShotFolder
from .messages import ShotError, listed
from .motion import read_motion
from .outputs import add_outputs, check_paths, shot_folder
from .shot import MAX_SCENE_FRAME, Shot, read_shot, scene_rate

# More cost time and hardly change the picture.
VOLUME_BOUNCES = 4


class IMPORT_SCENE_OT_meniscus_shot(bpy.types.Operator, ImportHelper):
    """Open the mesh and volume sequences of a Meniscus shot folder"""

    bl_idname = "import_scene.meniscus_shot"
    bl_label = "Import Meniscus Shot"
    bl_options = {"REGISTER", "UNDO", "PRESET"}

    filename_ext = ".json"
    filter_glob: StringProperty(default="*.json", options={"HIDDEN"})
    path_mode: EnumProperty(
        name="Paths",
        description="How the object remembers where its files are",
        items=[
            ("AUTO", "Auto", "Relative to the .blend where it is saved and on the same drive, else absolute"),
            ("RELATIVE", "Relative", "Relative to the .blend; an error where that cannot be"),
            ("ABSOLUTE", "Absolute", "Full path"),
        ],
        default="AUTO",
    )
    set_scene: BoolProperty(
        name="Scene Frames and Rate",
        description="Give the scene the shot's frame range and rate; motion blur is only right at that rate",
        default=True,
    )
    motion_blur: BoolProperty(
        name="Motion Blur", description="Switch the scene's motion blur on", default=True
    )
    engine: EnumProperty(
        name="Engine",
        description="The scene's render engine",
        items=[
            ("CYCLES", "Cycles", "Blurs liquids along their velocities"),
            ("EEVEE", "EEVEE", "Fast; liquids have no motion blur"),
            ("KEEP", "As It Is", "Leave the scene's engine"),
        ],
        default="CYCLES",
    )
    studio: BoolProperty(
        name="Camera, Ground and Light",
        description="Add what the scene has none of, in place of Blender's own cube, camera and lamp if they are unchanged",
        default=True,
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            shot = read_shot(Path(bpy.path.abspath(self.filepath)))
            files = ShotFolder(shot.folder)
            frames = check_files(shot, files, lambda text: self.report({"WARNING"}, text))
            folder = shot_folder(files.root, self.path_mode)
            check_paths(shot, folder)
            motions = {collider: read_motion(files, collider.motion) for collider in shot.colliders}
            for collider, motion in motions.items():
                check_cache(collider, motion, files)
            made = add_outputs(context, shot, files, folder, frames, motions)
        except ShotError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        reload.mark(made, folder, "shot.json", self.path_mode)
        all_made, solids = ([each for _, each in some] for some in (made.shown, made.solids))
        if self.set_scene:
            self.apply_frames(context.scene, shot)
        if self.motion_blur:
            context.scene.render.use_motion_blur = True
        self.choose_engine(context.scene)
        self.scatter_light(context.scene, shot)
        if self.studio:
            span = (shot.frames.first, min(shot.frames.last, MAX_SCENE_FRAME))
            for text in studio.furnish(context, all_made, solids, span, shot.camera):
                self.report({"INFO"}, f"{shot.title}: {text}")
        # Last: importing a sheet's mesh selects that alone.
        for selected in context.selected_objects:
            selected.select_set(False)
        for made in all_made:
            made.select_set(True)
            context.view_layer.objects.active = made
        for text in filter(None, (volumes.rewritten(output, folder, frames[output]) for output in shot.volumes)):
            self.report({"WARNING"}, text)
        if shot.skipped:
            text = f"{shot.title}: not opened, of a kind that Blender cannot show: {listed(shot.skipped)}"
            self.report({"WARNING"}, text)
        where = "relative to the .blend" if folder.startswith("//") else "absolute"
        count = sum(len(output.frames.numbers()) for output in (*shot.meshes, *shot.points, *shot.volumes, *shot.sheets))
        made = [(shot.meshes, "mesh sequence"), (shot.points, "point sequence"), (shot.volumes, "volume sequence"), (shot.sheets, "sheet")]
        made += [(shot.colliders, "collider")]
        kinds = ", ".join(f"{len(some)} {kind}(s)" for some, kind in made if some)
        for text in hints(shot):
            self.report({"INFO"}, text)
        self.report({"INFO"}, f"{shot.title}: {kinds}, {count} frames, paths {where}")
        return {"FINISHED"}

    def choose_engine(self, scene: bpy.types.Scene) -> None:
        """Sets the render engine; a change of it is reported, and an engine that this Blender lacks."""
        if self.engine == "KEEP":
            return
        # Blender 4.2 to 4.5 call the only EEVEE by another name.
        names = {"CYCLES": ["CYCLES"], "EEVEE": ["BLENDER_EEVEE", "BLENDER_EEVEE_NEXT"]}[self.engine]
        before = scene.render.engine
        for name in names:
            try:
                scene.render.engine = name
            except TypeError:
                continue
            if name != before:
                self.report({"INFO"}, f"Render engine of {scene.name} changed from {before} to {name}")
            return
        self.report({"WARNING"}, f"This Blender has no {self.engine.title()}; the scene keeps its engine")

    def scatter_light(self, scene: bpy.types.Scene, shot: Shot) -> None:
        """Lets light scatter in smoke: without bounces, Blender's default, white smoke is nearly black inside."""
        is_cycles = self.engine != "KEEP" and scene.render.engine == "CYCLES"
        if is_cycles and any(not volume.is_hidden for volume in shot.volumes) and scene.cycles.volume_bounces == 0:
            scene.cycles.volume_bounces = VOLUME_BOUNCES
            self.report({"INFO"}, f"Volume bounces of {scene.name} changed from 0 to {VOLUME_BOUNCES}, so that smoke is not black")

    def apply_frames(self, scene: bpy.types.Scene, shot: Shot) -> None:
        """Frame range, rate and current frame of the shot."""
        scene.render.fps, scene.render.fps_base = scene_rate(shot.fps)
        scene.frame_start, scene.frame_end = shot.frames.first, min(shot.frames.last, MAX_SCENE_FRAME)
        if not shot.frames.first <= scene.frame_current <= shot.frames.last:
            scene.frame_set(shot.frames.first)
        if scene.unit_settings.scale_length != 1.0:
            scale = scene.unit_settings.scale_length
            self.report(
                {"WARNING"}, f"The scene's unit scale is {scale:g}; one unit of the shot is one metre"
            )


def hints(shot: Shot) -> list[str]:
    """What a user may not expect of the outputs of a shot."""
    found = [f"{mesh.name}: OBJ has no velocities, so it has no motion blur; mesh it as PLY" for mesh in shot.meshes if mesh.is_obj]
    hidden = [output.name for output in (*shot.points, *shot.volumes) if output.is_hidden]
    if hidden:
        found.append(f"{listed(hidden)}: hidden, since another object shows the same; unhide it in the outliner")
    for volume in (volume for volume in shot.volumes if volume.has_surface):
        blur = "" if volume.has_velocity else "; without a grid velocity it has no motion blur"
        found.append(f"{volume.name}: the surface of its level set is shown{blur}")
    return found


def menu_item(self: bpy.types.Menu, _context: bpy.types.Context) -> None:
    self.layout.operator(IMPORT_SCENE_OT_meniscus_shot.bl_idname, text="Meniscus Shot (shot.json)")


def register() -> None:
    bpy.utils.register_class(IMPORT_SCENE_OT_meniscus_shot)
    bpy.types.TOPBAR_MT_file_import.append(menu_item)
    reload.register()
    bpy.app.handlers.load_post.append(volumes.remember)
    scene.register()


def unregister() -> None:
    scene.unregister()
    bpy.app.handlers.load_post.remove(volumes.remember)
    reload.unregister()
    bpy.types.TOPBAR_MT_file_import.remove(menu_item)
    bpy.utils.unregister_class(IMPORT_SCENE_OT_meniscus_shot)
