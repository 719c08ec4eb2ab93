# SPDX-License-Identifier: MIT OR Apache-2.0
"""Meniscus for Blender: File > Import > Meniscus Shot opens the shot.json of a shot folder.

Each PLY mesh sequence of the shot becomes an object whose geometry nodes read the file of the current frame, each volume
sequence without a mesh of the same name a volume object, each sheet a mesh that a point cache moves.
What is made consists of plain Blender data: a saved file renders without this add-on and with scripts
disabled.
"""

from pathlib import Path

import bpy
from bpy.props import BoolProperty, EnumProperty, StringProperty
from bpy_extras.io_utils import ImportHelper

from . import material, nodes, sheets, volumes
from .shot import MeshOutput, SheetOutput, Shot, ShotError, VolumeOutput, format_pattern, read_shot, scene_rate


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

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            shot = read_shot(Path(bpy.path.abspath(self.filepath)))
            outputs = self.usable(shot)
            folder = shot_folder(shot.folder, self.path_mode)
        except ShotError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        if self.set_scene:
            self.apply_frames(context.scene, shot)
        if self.motion_blur:
            context.scene.render.use_motion_blur = True
        for selected in context.selected_objects:
            selected.select_set(False)
        all_made = []
        for output in outputs:
            if isinstance(output, VolumeOutput):
                made = volumes.add_volume(context, output, folder)
            elif isinstance(output, SheetOutput):
                made = sheets.add_sheet(context, output, shot.folder, folder)
            else:
                made = add_object(context, output, format_pattern(folder, output.pattern))
            all_made.append(made)
        # Last: importing a sheet's mesh selects that alone.
        for made in all_made:
            made.select_set(True)
            context.view_layer.objects.active = made
        if shot.skipped:
            self.report({"WARNING"}, f"{shot.title}: not opened, no PLY mesh, no smoke and no sheet: {', '.join(shot.skipped)}")
        where = "relative to the .blend" if folder.startswith("//") else "absolute"
        count = sum(len(output.frames.numbers()) for output in outputs)
        made = [(shot.meshes, "mesh sequence"), (shot.volumes, "volume sequence"), (shot.sheets, "sheet")]
        kinds = ", ".join(f"{len(some)} {kind}(s)" for some, kind in made if some)
        self.report({"INFO"}, f"{shot.title}: {kinds}, {count} frames, paths {where}")
        return {"FINISHED"}

    def usable(self, shot: Shot) -> list[MeshOutput | VolumeOutput | SheetOutput]:
        """The sequences that have files; gaps are reported, a sequence without any file is an error."""
        for sheet in shot.sheets:
            if gone := sheet.missing(shot.folder):
                raise ShotError(f"{sheet.name}: {gone[0]} is missing. Run `meniscus shot` again; it makes what is missing")
        outputs = [*shot.meshes, *shot.volumes]
        for output in outputs:
            if isinstance(output, VolumeOutput) and output.frames.step > 1:
                text = f"{output.name}: only every frame number {output.frames.step} has a volume; the others show nothing"
                self.report({"WARNING"}, text)
            missing = output.missing(shot.folder)
            if not missing:
                continue
            total = len(output.frames.numbers())
            place = f"that of frame {missing[0]}"
            if isinstance(output, MeshOutput):
                place = output.file(shot.folder, missing[0])
            text = (
                f"{output.name}: {len(missing)} of {total} files missing, first {place}. "
                "Run `meniscus shot` again; it makes what is missing"
            )
            if len(missing) == total:
                raise ShotError(text)
            self.report({"WARNING"}, f"{text}. Until then these frames are empty")
        return [*outputs, *shot.sheets]

    def apply_frames(self, scene: bpy.types.Scene, shot: Shot) -> None:
        """Frame range, rate and current frame of the shot."""
        scene.render.fps, scene.render.fps_base = scene_rate(shot.fps)
        scene.frame_start, scene.frame_end = shot.frames.first, shot.frames.last
        if not shot.frames.first <= scene.frame_current <= shot.frames.last:
            scene.frame_set(shot.frames.first)
        if scene.unit_settings.scale_length != 1.0:
            scale = scene.unit_settings.scale_length
            self.report(
                {"WARNING"}, f"The scene's unit scale is {scale:g}; one unit of the shot is one metre"
            )


def shot_folder(folder: Path, mode: str) -> str:
    """The shot folder as a path string with / between its parts: //… or absolute. Raises ShotError."""
    absolute = folder.resolve().as_posix()
    if mode == "ABSOLUTE":
        return absolute
    if not bpy.data.filepath:
        if mode == "RELATIVE":
            raise ShotError("The .blend is not saved, so no path can be relative to it. Save it first")
        return absolute
    try:
        relative = bpy.path.relpath(absolute).replace("\\", "/")
    except ValueError:
        relative = absolute
    if mode == "RELATIVE" and not relative.startswith("//"):
        raise ShotError(f"{absolute} is on another drive than the .blend. Choose absolute paths")
    return "//" if relative == "//." else relative


def add_object(context: bpy.types.Context, mesh: MeshOutput, files: str) -> bpy.types.Object:
    """A new object in the active collection that shows one sequence."""
    made = bpy.data.objects.new(mesh.name, bpy.data.meshes.new(mesh.name))
    context.collection.objects.link(made)
    modifier = made.modifiers.new(nodes.NAME, "NODES")
    modifier.node_group = nodes.sequence_group()
    water = material.water()
    made.data.materials.append(water)
    values = {"Files": files, "First": mesh.frames.first, "Last": mesh.frames.last, "Step": mesh.frames.step}
    nodes.set_inputs(modifier, values | {"Velocity": mesh.has_velocity, "Material": water})
    return made


def menu_item(self: bpy.types.Menu, _context: bpy.types.Context) -> None:
    self.layout.operator(IMPORT_SCENE_OT_meniscus_shot.bl_idname, text="Meniscus Shot (shot.json)")


def register() -> None:
    bpy.utils.register_class(IMPORT_SCENE_OT_meniscus_shot)
    bpy.types.TOPBAR_MT_file_import.append(menu_item)


def unregister() -> None:
    bpy.types.TOPBAR_MT_file_import.remove(menu_item)
    bpy.utils.unregister_class(IMPORT_SCENE_OT_meniscus_shot)
