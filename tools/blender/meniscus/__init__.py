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

from . import colliders, material, nodes, sheets, studio, volumes
from .check import check_cache, check_files
from .folder import ShotFolder
from .messages import ShotError, listed, printable
from .motion import Motion, read_motion
from .shot import MAX_SCENE_FRAME, ColliderOutput, MeshOutput, PointsOutput, SequenceOutput, Shot, below, format_string, read_shot, scene_rate

# Blender's FILE_MAX, with the zero at the end.
MAX_PATH_BYTES = 1024


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
            all_made, solids = add_outputs(context, shot, files, folder, frames, motions)
        except ShotError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        if self.set_scene:
            self.apply_frames(context.scene, shot)
        if self.motion_blur:
            context.scene.render.use_motion_blur = True
        self.choose_engine(context.scene)
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
        if shot.skipped:
            text = f"{shot.title}: not opened, no PLY mesh, no smoke and no sheet: {listed(shot.skipped)}"
            self.report({"WARNING"}, text)
        where = "relative to the .blend" if folder.startswith("//") else "absolute"
        count = sum(len(output.frames.numbers()) for output in (*shot.meshes, *shot.points, *shot.volumes, *shot.sheets))
        made = [(shot.meshes, "mesh sequence"), (shot.points, "point sequence"), (shot.volumes, "volume sequence"), (shot.sheets, "sheet")]
        made += [(shot.colliders, "collider")]
        kinds = ", ".join(f"{len(some)} {kind}(s)" for some, kind in made if some)
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


def shot_folder(folder: str, mode: str) -> str:
    """The resolved shot folder as a path string with / between its parts: //… or absolute. Raises ShotError."""
    absolute = Path(folder).as_posix()
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
        raise ShotError(f"{printable(absolute)} is on another drive than the .blend. Choose absolute paths")
    return "//" if relative == "//." else relative


def check_paths(shot: Shot, folder: str) -> None:
    """Raises ShotError if Blender cannot hold the path of a file."""
    longest = [output.path(output.frames.last) for output in (*shot.meshes, *shot.points, *shot.volumes)]
    longest += [path for collider in shot.colliders for path in (collider.mesh, collider.cache) if path]
    for path in longest + [path for sheet in shot.sheets for path in (sheet.rest, sheet.cache)]:
        full = below(folder, path)
        try:
            size = max(len(name.encode("utf-8")) for name in (full, bpy.path.abspath(full)))
        except UnicodeEncodeError:
            raise ShotError(f"{printable(full)}: not a name in UTF-8, expected one. Rename the folder") from None
        if size >= MAX_PATH_BYTES:
            text = f"a path of {size} bytes, expected less than {MAX_PATH_BYTES}. Move the shot to a folder with a shorter path"
            raise ShotError(f"{printable(full)}: {text}")


def add_outputs(
    context: bpy.types.Context,
    shot: Shot,
    files: ShotFolder,
    folder: str,
    frames: dict[SequenceOutput, list[int]],
    motions: dict[ColliderOutput, Motion],
) -> tuple[list[bpy.types.Object], list[bpy.types.Object]]:
    """New objects in the active collection, one for each output, and those of colliders; all or none. Raises ShotError."""
    all_made, solids = [], []
    try:
        for output in (*shot.meshes, *shot.points):
            all_made.append(add_object(output, format_string(below(folder, output.pattern))))
        for output in shot.volumes:
            all_made.append(volumes.add_volume(context, output, folder, frames[output]))
        for sheet in shot.sheets:
            all_made.append(sheets.add_sheet(sheet, files.full(sheet.rest), below(folder, sheet.cache)))
        for collider, motion in motions.items():
            made = colliders.add_collider(collider, files.full(collider.mesh), motion)
            solids.append(made)
            if collider.cache and motion.cache_frames:
                sheets.deform(made, below(folder, collider.cache), motion.cache_frames[0])
    except ShotError:
        for made in (*all_made, *solids):
            bpy.data.objects.remove(made)
        raise
    # Last: with every object in the scene, each new one would evaluate all before it again.
    for made in (*all_made, *solids):
        context.collection.objects.link(made)
    return all_made, solids


def add_object(mesh: MeshOutput | PointsOutput, files: str) -> bpy.types.Object:
    """A new object that shows one sequence, in no collection yet."""
    made = bpy.data.objects.new(mesh.name, bpy.data.meshes.new(mesh.name))
    modifier = made.modifiers.new(nodes.NAME, "NODES")
    modifier.node_group = nodes.sequence_group(isinstance(mesh, PointsOutput))
    is_foam = isinstance(mesh, PointsOutput) and mesh.is_whitewater
    shown = material.foam() if is_foam else material.water()
    made.data.materials.append(shown)
    values = {"Files": files, "First": mesh.frames.first, "Last": mesh.frames.last, "Step": mesh.frames.step}
    nodes.set_inputs(modifier, values | {"Velocity": mesh.has_velocity, "Material": shown})
    return made


def menu_item(self: bpy.types.Menu, _context: bpy.types.Context) -> None:
    self.layout.operator(IMPORT_SCENE_OT_meniscus_shot.bl_idname, text="Meniscus Shot (shot.json)")


def register() -> None:
    bpy.utils.register_class(IMPORT_SCENE_OT_meniscus_shot)
    bpy.types.TOPBAR_MT_file_import.append(menu_item)


def unregister() -> None:
    bpy.types.TOPBAR_MT_file_import.remove(menu_item)
    bpy.utils.unregister_class(IMPORT_SCENE_OT_meniscus_shot)
