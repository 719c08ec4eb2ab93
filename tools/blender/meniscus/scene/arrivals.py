# SPDX-License-Identifier: MIT OR Apache-2.0
"""Shows the products of a running job as they are made.

Surfaces, their droplets and volumes of smoke have a file a frame, and are shown up to the last frame before which none is missing.
Cloth, bodies, tanks with a look and whitewater are made of all frames so far, again and again: each time, their objects are updated.
Level sets are none of these: a preset of a scene has no grid `surface`, as its liquids have meshes.
"""

from dataclasses import replace
from pathlib import Path

import bpy

from .. import colliders, outputs, volumes
from ..check import check_cache, check_sequence, check_sheet
from ..folder import ShotFolder
from ..headers import MAX_PLY_HEADER_BYTES, check_ply, head
from ..messages import ShotError
from ..motion import Motion, read_motion
from ..shot import FOG, FRAME_NUMBER, WHITEWATER, Frames, MeshOutput, PointsOutput, SequenceOutput, Shot, VolumeOutput, below, read_shot
from ..update import IMPORT, OUTPUT
from ..vdb import check_vdb
from ..viscosity import read_preset, read_viscosity
from . import run, show
from .identity import Sources

SURFACE = MeshOutput("liquid", f"mesh/liquid_{FRAME_NUMBER}.ply", Frames(0, 0, 1), True)
# Of a preset whose surface has `components`.
DROPLETS = PointsOutput("liquid_points", f"mesh/liquid_points_{FRAME_NUMBER}.ply", Frames(0, 0, 1), True, is_whitewater=False)
SMOKE = VolumeOutput("smoke", f"volume/smoke_{FRAME_NUMBER}.vdb", Frames(0, 0, 1), True, (FOG, "velocity"))
# Names in the panel; cloth and bodies have those of their objects.
LABELS = {"mesh:liquid": "Surface", "points:liquid_points": "Droplets", "volume:smoke": "Smoke", "points:whitewater": "Whitewater", "volume:whitewater": "Mist"}
# Property of surfaces with colours.
COLOURS = b"property uchar red\n"
# A file may be replaced while it is read: so many looks may fail in a row.
MAX_FAILURES = 5


def has_components(folder: Path) -> bool:
    """Whether small components of the surface in a shot folder become droplets."""
    surface = read_preset(folder).get("surface")
    return isinstance(surface, dict) and "components" in surface


class Arrivals:
    """What a job has made so far, as its scene shows it."""

    def __init__(self, job: run.Job, frames: list[int]) -> None:
        self.shot, self.root, self.frames = job.shot, job.root, frames
        # Numbers of frames in a row whose files were checked, by sequence, and of passes that were shown.
        self.checked: dict[str, int] = {}
        self.passes: dict[str, int] = {}
        # Keys of results whose objects are those of this job.
        self.made: set[str] = set()
        # Names of colliders that are no results.
        self.not_shown: set[str] = set()
        # The last frame that is shown, by the key of the output.
        self.last: dict[str, int] = {}
        # The session_uid of the scene that shows it.
        self.scene = 0
        self.failures = 0
        self.seen: tuple = ()

    def is_due(self, job: run.Job) -> bool:
        """Whether the job has made anything since the last successful look."""
        return self.seen != made_by(job)

    def text(self) -> str:
        """What is shown so far, for the panel; empty if nothing is."""
        scene = next((each for each in bpy.data.scenes if each.session_uid == self.scene), None)
        own = [each for each in scene.objects if each.get(OUTPUT) and not each.get(IMPORT)] if scene and self.last else []
        names = {each[OUTPUT]: each.name.removesuffix(" Simulated") for each in own}
        parts = [f"{LABELS.get(key) or names[key]} {frame}" for key, frame in self.last.items() if key in names]
        return f"Shown to frame: {', '.join(parts)}" if parts else ""

    def update(self, context: bpy.types.Context, scene: bpy.types.Scene, job: run.Job) -> bool:
        """Shows what was made since the last look; whether there was any. Raises ShotError, and has then to be given up."""
        before, self.scene = dict(self.last), scene.session_uid
        try:
            files = ShotFolder(self.shot)
            self.surfaces(scene, files, job.frames_of(run.SURFACES))
            notes = self.volumes(context, scene, files, job.frames_of(run.VOLUMES))
            notes += self.repeated(context, scene, files, job.passes())
            job.messages.extend(note for note in notes if note not in job.messages)
            self.seen, self.failures = made_by(job), 0
        except ShotError:
            self.failures += 1
            if self.failures >= MAX_FAILURES:
                raise
        return self.last != before

    def arrived(self, output: SequenceOutput, files: ShotFolder, reported: set[int]) -> int:
        """How many frames in a row have a file of a sequence."""
        count = self.checked.get(output.name, 0)
        while count < len(self.frames) and self.frames[count] in reported and files.has(output.path(self.frames[count])):
            count += 1
        return count

    def span(self, count: int) -> Frames:
        step = self.frames[1] - self.frames[0] if len(self.frames) > 1 else 1
        return Frames(self.frames[0], self.frames[count - 1], step)

    def surfaces(self, scene: bpy.types.Scene, files: ShotFolder, reported: set[int]) -> None:
        before, count = self.checked.get(SURFACE.name, 0), self.arrived(SURFACE, files, reported)
        if count == before:
            return
        for frame in self.frames[before:count]:
            check_ply(files, SURFACE.path(frame))
        content, _ = head(files, SURFACE.path(self.frames[before]), MAX_PLY_HEADER_BYTES)
        output = MeshOutput(SURFACE.name, SURFACE.pattern, self.span(count), True, COLOURS in content.partition(b"element face")[0])
        shown: list[SequenceOutput] = [output]
        # Without small components, files of droplets are those of an earlier surface.
        if has_components(self.shot) and files.has(DROPLETS.path(output.frames.last)):
            for frame in self.frames[before:count]:
                check_ply(files, DROPLETS.path(frame), has_faces=False)
            shown.append(replace(DROPLETS, frames=output.frames, has_colours=output.has_colours))
        for each in shown:
            show.target(scene).sequence(each, outputs.shot_folder(files.root, "AUTO"), read_viscosity(self.shot))
            self.last[outputs.key_of(each)] = each.frames.last
        self.checked[SURFACE.name] = count

    def volumes(self, context: bpy.types.Context, scene: bpy.types.Scene, files: ShotFolder, reported: set[int]) -> list[str]:
        """Shows new frames of smoke; what was reported about it."""
        before, count = self.checked.get(SMOKE.name, 0), self.arrived(SMOKE, files, reported)
        if count == before:
            return []
        for frame in self.frames[before:count]:
            check_vdb(files, SMOKE.path(frame))
        self.checked[SMOKE.name] = count
        output = VolumeOutput(SMOKE.name, SMOKE.pattern, self.span(count), True, SMOKE.grids)
        return self.cloud(context, scene, output, outputs.shot_folder(files.root, "AUTO"), self.frames[before:count])

    def cloud(self, context: bpy.types.Context, scene: bpy.types.Scene, output: VolumeOutput, folder: str, newest: list[int]) -> list[str]:
        """Shows a sequence of volumes with its newest frames, once there is anything in one; what was reported about it."""
        key, note = outputs.key_of(output), volumes.rewritten(output, folder, newest)
        notes = [note] if note is not None else []
        shown = show.target(scene).existing(key)
        if shown is not None and key in self.made:
            shown.data.frame_duration = output.frames.last - output.frames.first + 1
        else:
            # The material's density follows from the size of the cloud: without any it is too early.
            extents = (volumes.extent(context, output.name, [below(folder, output.path(frame))]) for frame in newest)
            first = next((index for index, extent in enumerate(extents) if extent is not None), None)
            if first is None:
                return notes
            show.target(scene).volume(context, output, folder, newest[first:], 0.0)
            self.made.add(key)
        self.last[key] = output.frames.last
        return notes

    def repeated(self, context: bpy.types.Context, scene: bpy.types.Scene, files: ShotFolder, passes: dict[str, int]) -> list[str]:
        """Updates what is made of all frames so far; what was reported about it."""
        new = {name for name, count in passes.items() if count != self.passes.get(name, 0)}
        notes: list[str] = []
        if not new:
            return notes
        shot = read_shot(self.shot)
        if run.WHITEWATER in new:
            for output in (each for each in shot.points if each.is_whitewater):
                check_sequence(output, files, lambda _text: None)
                show.target(scene).sequence(output, outputs.shot_folder(files.root, "AUTO"), shot.viscosity)
                self.last[outputs.key_of(output)] = output.frames.last
            # Points that show the same are shown in their place.
            for output in (each for each in shot.volumes if set(WHITEWATER) & set(each.grids) and not each.is_hidden):
                present, before = check_sequence(output, files, lambda _text: None), self.checked.get(output.name, 0)
                self.checked[output.name] = len(present)
                notes += self.cloud(context, scene, output, outputs.shot_folder(files.root, "AUTO"), present[before:])
        if run.SHEETS in new:
            for sheet in shot.sheets:
                check_sheet(sheet, files)
            notes += self.shapes(context, scene, shot, files, {f"sheet:{each.name}": each.frames.last for each in shot.sheets})
        if run.SOLIDS in new:
            notes += self.solids(context, scene, shot, files)
        self.passes = dict(passes)
        return notes

    def shapes(self, context: bpy.types.Context, scene: bpy.types.Scene, shot: Shot, files: ShotFolder, lasts: dict[str, int]) -> list[str]:
        """Makes the results of cloth, bodies and tanks, which follow their files from then on; what was reported about it.

        `lasts` has the last frame of each, by its key.
        """
        target, sources = show.target(scene), Sources(self.root)
        lacking = [key for key in lasts if key not in self.made or target.existing(key) is None]
        notes: list[str] = []
        if lacking:
            notes = show.show_shapes(context, scene, shot, sources, files)
            self.made.update(lasts)
        for key, last in lasts.items():
            shown = target.existing(key)
            if shown is not None:
                # A modifier reads a point cache that has grown when its object is evaluated again.
                shown.update_tag(refresh={"DATA"})
                self.last[key] = last
        return notes

    def solids(self, context: bpy.types.Context, scene: bpy.types.Scene, shot: Shot, files: ShotFolder) -> list[str]:
        """Updates bodies, and tanks with a look; what was reported about it."""
        sources, target = Sources(self.root), show.target(scene)
        motions: dict[str, Motion] = {}
        for output in shot.colliders:
            is_body = sources.object(scene, output.name, "BODY") is not None
            if not is_body and output.name in self.not_shown:
                continue
            motion = read_motion(files, output.motion)
            check_cache(output, motion, files)
            if is_body or motion.shape == "tank":
                motions[f"{'body' if is_body else 'tank'}:{output.name}"] = motion
            else:
                # The scene has it: its file need not be read again.
                self.not_shown.add(output.name)
        known = self.made & motions.keys()
        notes = self.shapes(context, scene, shot, files, {key: motion.first + len(motion.poses) - 1 for key, motion in motions.items()})
        for key in known:
            shown = target.existing(key)
            if shown is not None:
                colliders.remove_animation(shown)
                show.moved(shown, motions[key], scene.unit_settings.scale_length)
        # One at rest has one pose, and the last frame of one that moves may be that of its keyframes.
        self.last = {key: last for key, last in self.last.items() if not key.startswith("tank:")}
        return notes


def made_by(job: run.Job) -> tuple:
    """Changes whenever a job has made something."""
    return len(job.frames_of(run.SURFACES)), len(job.frames_of(run.VOLUMES)), *sorted(job.passes().items())
