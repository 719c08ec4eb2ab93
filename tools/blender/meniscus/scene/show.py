# SPDX-License-Identifier: MIT OR Apache-2.0
"""Shows the results of a job in the scene; arrivals.py, those of a job that runs.

Objects are those that the importer makes. Each has a custom property with the output that it shows, so a second run gives it
other files and leaves its materials, name and place as the artist made them.
"""

from pathlib import Path

import bpy
from mathutils import Matrix

from .. import colliders, outputs, sheets, volumes
from ..check import check_cache, check_files
from ..folder import ShotFolder
from ..headers import check_ply
from ..messages import ShotError, printable
from ..motion import Motion, read_motion
from ..shot import MAX_SCENE_FRAME, Shot, below, read_shot
from ..update import OUTPUT, Target
from .identity import SOURCE, Sources
from .sample import is_shown, quiet

Copies = dict[str, bpy.types.Object]
COLLECTION = "Meniscus Shot"


def collection(scene: bpy.types.Scene) -> bpy.types.Collection:
    """The scene's collection of results."""
    for each in scene.collection.children_recursive:
        if each.get(OUTPUT):
            return each
    made = bpy.data.collections.new(COLLECTION)
    made[OUTPUT] = "results"
    scene.collection.children.link(made)
    return made


def target(scene: bpy.types.Scene) -> Target:
    """Where results of the scene's own jobs are shown."""
    return Target(scene, lambda: collection(scene), scene.unit_settings.scale_length)


def show_all(context: bpy.types.Context, scene: bpy.types.Scene, folder: Path) -> list[str]:
    """Shows every output of a shot that ended; what was reported about it. Raises ShotError."""
    notes: list[str] = []
    shot = read_shot(folder)
    files = ShotFolder(shot.folder)
    frames = check_files(shot, files, notes.append)
    path = outputs.shot_folder(files.root, "AUTO")
    outputs.check_paths(shot, path)
    for output in (*shot.meshes, *shot.points):
        target(scene).sequence(output, path, shot.viscosity)
    for output in shot.volumes:
        target(scene).volume(context, output, path, frames[output], shot.viscosity)
        text = volumes.rewritten(output, path, frames[output])
        if text is not None:
            notes.append(text)
    return notes + show_shapes(context, scene, shot, Sources(folder.parent), files)


def show_shapes(context: bpy.types.Context, scene: bpy.types.Scene, shot: Shot, sources: Sources, files: ShotFolder) -> list[str]:
    """Shows cloth, bodies and tanks with a look; what was reported about it. Raises ShotError."""
    keys = {each.name: f"sheet:{each.name}" for each in shot.sheets} | {each.name: f"body:{each.name}" for each in shot.colliders}
    sources.relabel(scene, OUTPUT, keys)
    path = outputs.shot_folder(files.root, "AUTO")
    copies, notes = copies_of(context, scene, shot, sources), lacking(context, scene, shot, sources)
    for sheet in shot.sheets:
        show_cloth(context, scene, sheet, sources, copies, files, path)
    show_solids(context, scene, shot, sources, copies, files)
    return notes


def sources_of(scene: bpy.types.Scene, shot: Shot, sources: Sources) -> list[tuple[str, str, bpy.types.Object]]:
    """Output, role and object of the shot's bodies and cloth that the scene has."""
    pairs = [(each.name, "CLOTH") for each in shot.sheets] + [(each.name, "BODY") for each in shot.colliders]
    return [(name, role, source) for name, role in pairs if (source := sources.object(scene, name, role)) is not None]


def copies_of(context: bpy.types.Context, scene: bpy.types.Scene, shot: Shot, sources: Sources) -> Copies:
    """Copies of the objects of bodies and cloth as they are in the first frame, by their outputs' names."""
    found, copies = sources_of(scene, shot, sources), {}
    layers = {name: layer_of(context, scene, source) or context.view_layer for name, _, source in found}
    # Blender evaluates an object only in view layers that have it.
    for layer in dict.fromkeys(layers.values()):
        some = [one for one in found if layers[one[0]] == layer]
        with context.temp_override(scene=scene, view_layer=layer), quiet(context, [source for *_, source in some if source.name in layer.objects]):
            scene.frame_set(min(shot.frames.first, MAX_SCENE_FRAME))
            copies |= {name: copy_of(context, source, sources.start(name), place=role == "CLOTH") for name, role, source in some}
    return copies


def lacking(context: bpy.types.Context, scene: bpy.types.Scene, shot: Shot, sources: Sources) -> list[str]:
    """Messages on objects that are gone, or that no view layer evaluates."""
    text = "every view layer excludes or hides it, so its result lacks modifiers. Enable it in viewports and show the result again"
    notes = [f"{printable(source.name)}: {text}" for *_, source in sources_of(scene, shot, sources) if layer_of(context, scene, source) is None]
    notes += sources.lacking(scene, [each.name for each in shot.sheets], "CLOTH")
    return notes + sources.lacking(scene, [each.name for each in shot.colliders], "BODY")


def layer_of(context: bpy.types.Context, scene: bpy.types.Scene, source: bpy.types.Object) -> bpy.types.ViewLayer | None:
    """The view layer that evaluates an object: the current one if it does, else the first; None if none does."""
    for layer in (context.view_layer, *scene.view_layers):
        if source.name in layer.objects:
            with context.temp_override(scene=scene, view_layer=layer):
                if is_shown(source, context):
                    return layer
    return None


def copy_of(context: bpy.types.Context, source: bpy.types.Object, start: Matrix, place: bool) -> bpy.types.Object:
    """A new object with the source's mesh, its modifiers applied, materials and all, in metres as its asset was written."""
    graph = context.evaluated_depsgraph_get()
    mesh = bpy.data.meshes.new_from_object(source.evaluated_get(graph), preserve_all_data_layers=True, depsgraph=graph)
    mesh.transform(start if place else start.to_3x3().to_4x4())
    if start.to_3x3().determinant() < 0.0:
        mesh.flip_normals()
    return bpy.data.objects.new(f"{source.name} Simulated", mesh)


def stand_in(shown: bpy.types.Object, source: bpy.types.Object | None, scene: bpy.types.Scene) -> None:
    """Hides the object that a result stands for: its eye in each view layer, and in renders. Its role keeps it in the simulation."""
    if source is None:
        return
    shown[SOURCE] = source.meniscus.identifier
    source.hide_render = True
    for layer in scene.view_layers:
        if source.name in layer.objects:
            source.hide_set(True, view_layer=layer)


def show_cloth(context: bpy.types.Context, scene: bpy.types.Scene, sheet, sources: Sources, copies: Copies, files: ShotFolder, path: str) -> None:
    source, key = sources.object(scene, sheet.name, "CLOTH"), f"sheet:{sheet.name}"
    cache = below(path, sheet.cache)
    made = None
    if source is not None:
        made = copies[sheet.name]
        if len(made.data.vertices) == check_ply(files, sheet.rest):
            sheets.deform(made, cache, sheet.frames.first, sheet.frames.step)
        else:
            bpy.data.objects.remove(made)
            made = None
    if made is None:
        made = sheets.add_sheet(sheet, files.full(sheet.rest), cache)
    elif not len(made.data.materials):
        made.data.materials.append(sheets.cloth())
    stand_in(target(scene).adopt(made, key), source, scene)


def show_solids(context: bpy.types.Context, scene: bpy.types.Scene, shot: Shot, sources: Sources, copies: Copies, files: ShotFolder) -> None:
    """Bodies where the simulation moved them, and tanks with a look; the scene has the other colliders."""
    for output in shot.colliders:
        source = sources.object(scene, output.name, "BODY")
        motion = read_motion(files, output.motion)
        check_cache(output, motion, files)
        if source is not None:
            made = copies[output.name]
            if not len(made.data.materials):
                made.data.materials.append(colliders.matte())
            moved(made, motion, scene.unit_settings.scale_length)
            stand_in(target(scene).adopt(made, f"body:{output.name}"), source, scene)
        elif motion.shape == "tank":
            made = colliders.add_collider(output, files.full(output.mesh), motion)
            moved(made, motion, scene.unit_settings.scale_length)
            target(scene).adopt(made, f"tank:{output.name}")


def moved(made: bpy.types.Object, motion: Motion, scale: float) -> None:
    """Gives an object the poses of a motion, in the scene's units."""
    poses = [[*(part / scale for part in pose[:3]), *pose[3:]] for pose in motion.poses]
    scales = [size / scale for size in motion.scales] if motion.scales else None
    scaled = Motion(motion.shape, motion.look, motion.first, poses, scales, None)
    made.rotation_mode = "QUATERNION"
    made.location, made.rotation_quaternion = poses[0][:3], poses[0][3:]
    if scales or any(pose != poses[0] for pose in poses):
        colliders.animate(made, scaled)
