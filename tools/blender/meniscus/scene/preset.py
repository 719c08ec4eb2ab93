# SPDX-License-Identifier: MIT OR Apache-2.0
"""Writes the preset of a scene: roles, settings, camera, frames and gravity as TOML, meshes as files next to it."""

from collections.abc import Generator
from dataclasses import dataclass
from math import hypot
from pathlib import Path
from typing import TypeVar

import bpy
import numpy as np

from ..messages import ShotError, printable
from . import assets, identity, joints, poses, sample, schema, settings, spacing, toml, vortices
from .names import QUALITIES, Names
from .places import blend_from, check_owner, folder_of
from .roles import OF_SMOKE
from .run import SHEETS, SOLIDS, SURFACES, VOLUMES, WHITEWATER, check_free
from .sample import Sampled
from .shapes import Placed, Shaper
from .toml import Document, Table

EARTH = 9.81
# The largest surface tension that the engine takes [N/m].
MAX_TENSION = 1000.0
# Keys of forces that are vectors in the object's axes.
FORCE_VECTORS = {"acceleration", "velocity"}
# Smoke's own volumes need no finer grid, and no terms of a liquid's surface.
SMOKE_SURFACE = {"voxel": 1.0, "kernel_radius": 3.0}


# Labels of the steps of writing a preset.
SAMPLING, COMPOSING, WRITING = "Sampling", "Composing", "Writing files"
Result = TypeVar("Result")
# Steps that yield the finished part.
Parts = Generator[float, None, None]


@dataclass
class Written:
    """A preset that was written, what it leaves out, and files of earlier objects that were removed."""

    path: Path
    notes: list[str]
    removed: list[str]
    # Names of run.py for what can be shown while it is simulated.
    products: set[str]
    # Start, end and step.
    frames: list[int]


@dataclass(frozen=True)
class TimeAndUnits:
    """Frame range, frame rate and unit scale of a scene: read once, since all samples of a preset need the same."""

    start: int
    end: int
    step: int
    fps: float
    scale: float

    @classmethod
    def of(cls, scene: bpy.types.Scene) -> "TimeAndUnits":
        fps = float(scene.render.fps / scene.render.fps_base)
        return cls(scene.frame_start, scene.frame_end, scene.frame_step, fps, scene.unit_settings.scale_length)


@dataclass(frozen=True)
class Step:
    """A step of writing a preset: what is being done, the finished part of it, and whether the scene is still being read."""

    label: str
    part: float
    is_reading: bool = True


Steps = Generator[Step, None, Written]


def write(context: bpy.types.Context, takes_over: bool = False) -> Written:
    """Writes preset and assets of the scene into its folder; `takes_over` one of another .blend. Raises ShotError."""
    steps = writing(context, takes_over)
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return end.value


def writing(context: bpy.types.Context, takes_over: bool = False) -> Steps:
    """The same in steps of one frame, one object, or one part of a file. Closing it restores the scene, and changes no file.

    Files are written under temporary names; the last step renames them.
    """
    notes: list[str] = []
    frames, units = sample.frame_numbers(context.scene), TimeAndUnits.of(context.scene)
    sources = sample.takes_part(context, notes)
    root = folder_of(context.scene)
    check_owner(context.scene, root, takes_over)
    check_free(root)
    folder = assets.Folder(root)
    folder.check_preset()
    scene, camera = context.scene, context.scene.camera
    try:
        with sample.quiet(context, sources):
            steps = sample.sample(context, sources + ([camera] if camera else []), frames, units.scale, notes)
            sampled = yield from labelled(steps, SAMPLING)
            camera_samples = sampled.pop() if camera else None
            writer = Writer(scene, units, sampled, camera_samples, folder, notes)
            text = yield from labelled(writer.text(), COMPOSING)
        yield from labelled(folder.stage(), WRITING, is_reading=False)
        identity.mark(sampled, identity.Sources(root))
        owner = {"blend": blend_from(root), "scene": scene.name, "session": identity.session}
        # Another Blender may have started a job meanwhile, which reads the files.
        check_free(root)
        path, removed = folder.finish(text, owner | {"objects": identity.entries(sampled)})
    finally:
        folder.discard()
    return Written(path, notes, removed, writer.products(), [units.start, units.end, units.step])


def labelled(parts: Generator[float, None, Result], label: str, is_reading: bool = True) -> Generator[Step, None, Result]:
    """Finished parts as steps."""
    while True:
        try:
            part = next(parts)
        except StopIteration as end:
            return end.value
        yield Step(label, part, is_reading)


class Writer:
    """Composes the text of one preset."""

    def __init__(
        self,
        scene: bpy.types.Scene,
        units: TimeAndUnits,
        sampled: list[Sampled],
        camera_samples: Sampled | None,
        folder: assets.Folder,
        notes: list[str],
    ) -> None:
        self.scene, self.shot, self.camera_samples = scene, scene.meniscus, camera_samples
        self.units, self.scale, self.notes = units, units.scale, notes
        self.frames = list(range(units.start, units.end + 1, units.step))
        self.shaper = Shaper(folder, notes)
        self.folder = folder
        self.document = Document()
        # Shapes that several tables have.
        self.placed: dict[str, Placed] = {}
        self.roles: dict[str, list[Sampled]] = {}
        self.composed, self.count = 0, len(sampled)
        names = Names()
        for each in sampled:
            self.roles.setdefault(each.role.role, []).append(each)
            each.asset = names.unique(each.source.name)
        self.has_liquid = bool(self.roles.get("FLUID") or self.roles.get("INFLOW"))
        self.has_smoke, self.has_cloth, self.has_bodies = bool(OF_SMOKE & self.roles.keys()), "CLOTH" in self.roles, "BODY" in self.roles

    def text(self) -> Generator[float, None, str]:
        """The text of the preset, in steps of one object that yield the finished part. Raises ShotError."""
        if not (self.has_liquid or self.has_smoke or self.has_cloth or self.has_bodies):
            raise ShotError("The scene has nothing to simulate. Add a pool, an inflow, smoke, cloth or a body: Add > Meniscus")
        self.head()
        yield from self.world()
        self.falling()
        for part in (self.liquid(), self.smoke(), self.cloth(), self.bodies(), self.forces()):
            yield from part
        self.surface()
        self.camera()
        self.output()
        self.tiers()
        return self.document.text()

    def next_part(self) -> float:
        """The finished part before the tables of another object."""
        self.composed += 1
        return (self.composed - 1) / self.count

    def products(self) -> set[str]:
        """What the preset has that can be shown while it is simulated."""
        has_whitewater = self.has_liquid and self.shot.use_whitewater
        has_tank = any(each.role.shape == "TANK" and each.role.collider.use_look for each in self.of("COLLIDER"))
        has = [(SURFACES, self.has_liquid), (VOLUMES, self.has_smoke), (SHEETS, self.has_cloth)]
        has += [(SOLIDS, self.has_bodies or has_tank), (WHITEWATER, has_whitewater)]
        return {name for name, is_there in has if is_there}

    def of(self, role: str) -> list[Sampled]:
        return self.roles.get(role, [])

    def values(self, each: Sampled, attribute: str, definition: str) -> Table:
        return settings.values(getattr(each.role, attribute), definition, self.scale)

    def head(self) -> None:
        document, scene = self.document, self.scene
        document.lines.append(f"{assets.MARK} It replaces the file; copy it to change it.")
        document.comment("")
        document.comment(f"meniscus shot {assets.PRESET} --quality draft")
        document.blank()
        first, last, step = self.frames[0], self.frames[-1], self.units.step
        span = f"{first}-{last}" if last > first else f"{first}"
        title = self.shot.title.strip() or scene.name
        document.pairs({"title": title, "frames": span + (f"x{step}" if step > 1 and last > first else ""), "fps": self.units.fps})
        if scene.render.frame_map_old != scene.render.frame_map_new:
            self.notes.append("The scene's time stretching is left out: the shot runs at the frame rate")

    def world(self) -> Parts:
        scene = self.scene
        gravity = [float(part) * self.scale if scene.use_gravity else 0.0 for part in scene.gravity]
        size = hypot(*gravity)
        if scene.use_gravity and abs(size - EARTH) > 0.01 * EARTH and self.scale != 1.0:
            text = f"gravity is {size:.4g} m/s², as the unit scale {self.scale:g} applies to it. On Earth it is {EARTH}"
            self.notes.append(f"{printable(scene.name)}: {text}")
        self.document.table("world", {"gravity": gravity})
        for each in self.of("COLLIDER"):
            yield self.next_part()
            placed = self.shaper.place(each, each.asset)
            found = self.values(each, "collider", "Collider")
            has_tension = self.has_liquid and self.shot.liquid.use_surface_tension
            for key in ("friction", "restitution", "contact_angle"):
                if key in found and not (has_tension if key == "contact_angle" else self.has_liquid):
                    del found[key]
                    lacking = "no liquid" if not self.has_liquid else "no surface tension"
                    self.shaper.note(each, f"its {key.replace('_', ' ')} is left out, since the scene has {lacking}")
            if not all(each.is_on):
                self.shaper.note(each, "a collider is always on; its keyframes of On are left out")
            self.entry("world.collider", each, placed, found)

    def falling(self) -> None:
        """Notes that nothing is below what falls: a newcomer's water is gone after a second."""
        if "COLLIDER" in self.roles or not (self.scene.use_gravity and any(self.scene.gravity)):
            return
        held = joints.held(self.of("CLOTH"))
        is_liquid_held = any(each.role.use_liquid for each in held)
        is_cloth_free = len(held) < len(self.of("CLOTH"))
        has = (("liquid", self.has_liquid and not is_liquid_held), ("bodies", self.has_bodies), ("cloth", is_cloth_free))
        falls = [name for name, is_free in has if is_free]
        if falls:
            text = "will fall without end. Add a floor, tank or glass: Add > Meniscus"
            self.notes.append(f"The scene has no collider: {' and '.join(falls)} {text}")

    def entry(self, path: str, each: Sampled, placed: Placed, found: dict[str, object]) -> None:
        """One entry of a list of tables, with the object's name as its comment."""
        values = {"shape": placed.shape} | found
        if placed.keyframes:
            values["keyframes"] = placed.keyframes
        self.document.table(path, values, note=each.source.name, repeated=True)

    def liquid(self) -> Parts:
        if not self.has_liquid:
            for each in self.of("OUTFLOW"):
                self.shaper.note(each, "is left out, since the scene has no liquid")
            return
        values = settings.values(self.shot.liquid, "LiquidParams", self.scale)
        if "channels" in values and not self.shot.liquid.use_viscosity:
            values["channels"] = [channel for channel in values["channels"] if channel != "viscosity"]
        if self.has_splash_tension():
            values["surface_tension"]["coefficient"] = self.splash_tension(1.0)
            if self.splash_tension(max(self.shot.draft, 1.0)) == MAX_TENSION:
                self.notes.append(f"Tension of Splashes is {MAX_TENSION:g} N/m, the largest there is, although the spacing needs more. Lower it")
        self.document.table("liquid", values)
        for each in self.of("FLUID"):
            yield self.next_part()
            self.fits(each)
            placed = self.shaper.place(each, each.asset)
            self.entry("liquid.source", each, placed, self.liquid_values(each, "source", "LiquidSource"))
        for each in self.of("INFLOW"):
            yield self.next_part()
            self.inflow(each)
        for each in self.of("OUTFLOW"):
            yield self.next_part()
            ranges = self.ranges(each)
            if ranges is not None:
                placed = self.shaper.place(each, each.asset)
                self.entry("liquid.outflow", each, placed, {"on": ranges} if ranges else {})

    def liquid_values(self, each: Sampled, role: str, kind: str) -> dict[str, object]:
        """The settings of a source or an inflow, whose own viscosity needs that of the scene."""
        found = dict(self.values(each, role, kind))
        if "viscosity" in found and not self.shot.liquid.use_viscosity:
            del found["viscosity"]
            self.shaper.note(each, "its viscosity is left out, since the scene's liquid has none. Switch on Viscosity in Scene > Meniscus")
        return found

    def has_splash_tension(self) -> bool:
        return self.shot.use_splash_tension and self.shot.liquid.use_surface_tension

    def splash_tension(self, factor: float) -> float:
        """Half of density × gravity × spacing² where the spacing is so many times that of the final [N/m]."""
        density, spacing = (settings.number(self.shot.liquid, "LiquidParams", name, self.scale) for name in ("density", "spacing"))
        return min(0.5 * density * EARTH * (factor * spacing) ** 2, MAX_TENSION)

    def inflow(self, each: Sampled) -> None:
        ranges = self.ranges(each)
        if ranges is None:
            return
        placed = self.shaper.place(each, each.asset)
        self.fits(each)
        found = self.liquid_values(each, "emitter", "LiquidEmitter")
        for key in ("velocity", "direction"):
            if key in found:
                found[key] = clean_vector(placed.axes @ np.array(found[key]))
        if "rate" in found and "disc" not in placed.shape and "direction" not in found:
            found["direction"] = clean_vector(placed.axes[:, 2])
        if "rate" in found and len(set(each.rates)) > 1:
            rates = [rate / 1000.0 for rate in each.rates]
            del found["rate"]
            found["rate_keyframes"] = [{"frame": self.frames[i], "rate": rates[i]} for i in poses.kept_values(self.frames, rates)]
        if ranges:
            found["on"] = ranges
        self.entry("liquid.emitter", each, placed, found)

    def fits(self, each: Sampled) -> None:
        """Notes a nozzle that is too narrow for the spacing, and liquid that is too much for it."""
        low, high = self.shaper.bounds(each)
        lengths = (high - low) * np.linalg.norm(each.matrices[0][:3, :3], axis=0)
        distance = settings.number(self.shot.liquid, "LiquidParams", "spacing", self.scale)
        note = spacing.note(each.source.name, each.role.role, each.role.shape, lengths.tolist(), distance)
        if note is not None:
            self.notes.append(note)

    def ranges(self, each: Sampled) -> list[dict[str, int]] | None:
        """Frames in which an object acts; empty if always, None if never, which is reported."""
        if all(each.is_on):
            return []
        if not any(each.is_on):
            self.shaper.note(each, "is left out, since it is never on")
            return None
        found, count = [], len(self.frames)
        starts = [i for i in range(count) if each.is_on[i] and (i == 0 or not each.is_on[i - 1])]
        for start in starts:
            end = next((i for i in range(start, count) if not each.is_on[i]), None)
            span = {"start": self.frames[start]} if start > 0 else {}
            found.append(span | ({"end": self.frames[end]} if end is not None else {}))
        return found

    def smoke(self) -> Parts:
        if not self.has_smoke:
            return
        self.document.table("smoke", settings.values(self.shot.smoke, "SmokeParams", self.scale))
        for each in self.of("SMOKE"):
            yield self.next_part()
            ranges = self.ranges(each)
            if ranges is None:
                continue
            found = dict(self.values(each, "smoke", "Emitter"))
            if len(ranges) > 1:
                finding = f"is switched on {len(ranges)} times, and smoke can start once"
                raise ShotError(f"{printable(each.source.name)}: {finding}. Use several objects")
            if ranges:
                found |= ranges[0]
            self.entry("smoke.emitter", each, self.shaper.place(each, each.asset), found)
        for each in self.of("CLOUD"):
            yield self.next_part()
            self.entry("smoke.source", each, self.shaper.place(each, each.asset), self.values(each, "cloud", "SmokeSource"))
        self.vortices()

    def vortices(self) -> None:
        """What the air does at the start."""
        for each in self.of("RING"):
            own = vortices.ring(self.shaper.place(each, each.asset))
            self.document.table("smoke.ring", own | self.values(each, "ring", "Ring"), note=each.source.name, repeated=True)
        for each in self.of("TUBE"):
            self.shaper.motion(each)
            own = vortices.tube(each, self.shaper.bounds(each))
            self.document.table("smoke.tube", own | self.values(each, "tube", "Tube"), note=each.source.name, repeated=True)
        for number, each in enumerate(self.of("TURBULENCE")):
            if number > 0:
                raise ShotError(f"{printable(each.source.name)}: a second turbulence, and smoke has one. Enlarge the other, or use several shots")
            values = {"shape": self.shaper.place(each, each.asset).shape} | self.values(each, "turbulence", "Turbulence")
            self.document.table("smoke.turbulence", values, note=each.source.name)

    def cloth(self) -> Parts:
        for each in self.of("CLOTH"):
            yield self.next_part()
            name = each.asset
            matrix = each.matrices[0]
            if each.geometry is None or not len(each.geometry.faces):
                raise ShotError(f"{printable(each.source.name)}: has no faces, expected the mesh of a sheet. Give it a mesh")
            vertices = each.vertices[0].astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3]
            file = self.shaper.add_mesh(name, vertices, each.geometry.faces)
            found = self.values(each, "cloth", "SheetParams")
            values = {"name": name, "shape": {"mesh": {"file": file}}} | found
            self.document.table("sheet", values, note=each.source.name, repeated=True)
            self.pins(each)
            self.regions(each)
        if self.has_cloth:
            common = settings.values(self.shot.sheets, "SheetsCommon", self.scale)
            if common:
                self.document.table("sheets", common)
            self.joints()
        sheets = {each.source for each in self.of("CLOTH")}
        for each in self.of("REGION"):
            if not sheets:
                self.shaper.note(each, "is left out, since the scene has no cloth")
            elif each.role.region_of is not None and each.role.region_of not in sheets:
                self.shaper.note(each, "is left out, since the object that it is of takes no part as cloth")
        for each in self.of("CLOTH"):
            role = each.role
            if self.has_liquid and role.use_liquid:
                self.couple("liquid", each.asset, {"friction": float(role.liquid_friction)} if role.liquid_friction > 0.0 else {})
            if self.has_smoke and role.use_air:
                drag = settings.values(role.drag, "Drag", self.scale)
                self.couple("smoke", each.asset, {"drag": dict(drag)} if drag else {})

    def pins(self, each: Sampled) -> None:
        """Held points, which follow the animation of the object."""
        found = poses.rigid_poses(each.matrices)
        moves = found is not None and not poses.is_still(found)
        if found is None or (moves and not each.pins):
            self.shaper.note(each, "its animation is left out: cloth starts where the object is in the first frame, and only pins move")
        if each.changes_later:
            self.shaper.note(each, "its deformation is left out: cloth starts with the mesh of the first frame")
        if not each.pins:
            return
        values: dict[str, object] = {"at": {"points": each.pins}}
        if each.role.pin_stiffness > 0.0:
            values["stiffness"] = float(each.role.pin_stiffness)
        values |= settings.values(each.role.pin, "Pin", self.scale)
        if moves:
            values["keyframes"] = poses.keyframes(self.frames, poses.displacements(found))
        self.document.table("sheet.pin", values, repeated=True)

    def regions(self, sheet: Sampled) -> None:
        """Parts of a sheet with other material: all regions that are not of another cloth."""
        for each in self.of("REGION"):
            if each.role.region_of in (None, sheet.source):
                if each.asset not in self.placed:
                    self.placed[each.asset] = self.shaper.place(each, each.asset)
                values = {"shape": self.placed[each.asset].shape} | self.values(each, "region", "Region")
                self.document.table("sheet.region", values, note=each.source.name, repeated=True)

    def joints(self) -> None:
        """Points of two sheets that are held together."""
        sheets = {each.source: each for each in self.of("CLOTH")}
        written: set[joints.Groups] = set()
        for each in self.of("CLOTH"):
            if each.role.joint_to is None:
                continue
            other = sheets.get(each.role.joint_to)
            if other is None:
                self.shaper.note(each, "its joint is left out, since the other object takes no part as cloth")
                continue
            pairs = joints.pairs(each, other)
            if pairs.groups in written:
                self.shaper.note(each, f"its joint is left out, since {printable(other.source.name)} has the same one, with its own settings")
                continue
            written.add(pairs.groups)
            if pairs.free:
                self.shaper.note(each, f"{pairs.free} point(s) of its joint stay free, since the two vertex groups have unequal numbers of points")
            values = settings.values(each.role.joint, "Joint", self.scale)
            joints.check_exact(each, values, pairs.largest)
            both = {"sheets": [each.asset, other.asset], "at": [{"points": pairs.own}, {"points": pairs.theirs}]}
            self.document.table("sheets.joint", both | values, note=f"{each.source.name} to {other.source.name}", repeated=True)

    def couple(self, system: str, sheet: str, found: dict[str, object]) -> None:
        self.document.table("coupling", {"between": [system, sheet]} | found, repeated=True)

    def bodies(self) -> Parts:
        for each in self.of("BODY"):
            yield self.next_part()
            placed = self.shaper.place(each, each.asset)
            found = self.values(each, "body", "BodyParams")
            for key in ("liquid_friction", "contact_angle"):
                if key in found and not (self.has_liquid and (key != "contact_angle" or self.shot.liquid.use_surface_tension)):
                    del found[key]
                    self.shaper.note(each, f"its {key.replace('_', ' ')} is left out, since the scene has nothing that it acts on")
            motion = poses.rigid_poses(each.matrices)
            if motion is None or not poses.is_still(motion):
                self.shaper.note(each, "its animation is left out: a body moves by itself from its place in the first frame")
            found["position"] = each.matrices[0][:3, 3].tolist()
            self.entry("body", each, placed, found)

    def forces(self) -> Parts:
        feeling = (("liquid", self.has_liquid), ("sheets", self.has_cloth), ("bodies", self.has_bodies))
        systems = [name for name, has in feeling if has]
        for each in self.of("FORCE"):
            yield self.next_part()
            if not systems:
                self.shaper.note(each, "is left out: forces act on liquid, cloth and bodies, and the scene has none of them")
                continue
            kind = next(choice for choice in schema.choices("ForceKind") if choice.name == each.role.kind)
            table = settings.values(getattr(each.role, f"kind_{kind.name}"), kind.name, self.scale, kind.keys)
            placed = self.shaper.force(each, each.asset)
            table = {name: clean_vector(placed.axes @ np.array(value)) if name in FORCE_VECTORS else value for name, value in table.items()}
            for key, value in (("center", placed.origin.tolist()), ("axis", placed.axes[:, 2].tolist())):
                if any(one.name == key for one in kind.keys):
                    table = {key: value} | table
            values: dict[str, object] = {"kind": {kind.name: dict(table)}}
            if placed.shape:
                values["shape"] = placed.shape
            found = self.values(each, "force", "ForceParams")
            if "falloff" in found and not placed.shape:
                self.shaper.note(each, "its falloff is left out, since it acts everywhere")
                del found["falloff"]
            values |= found
            if self.has_smoke:
                values["systems"] = systems
            factors = [factor * on for factor, on in zip(each.factors, each.is_on)]
            if any(factor != 1.0 for factor in factors):
                kept = poses.kept_values(self.frames, factors) if len(set(factors)) > 1 else [0]
                values["strength_keyframes"] = [{"frame": self.frames[i], "factor": float(factors[i])} for i in kept]
            if placed.keyframes:
                values["keyframes"] = placed.keyframes
            self.document.table("force", values, note=each.source.name, repeated=True)

    def surface(self) -> None:
        if self.has_liquid:
            self.document.table("surface", settings.values(self.shot.surface, "SurfaceParams", self.scale))
        elif self.has_smoke:
            self.document.table("surface", SMOKE_SURFACE)
        if self.shot.use_whitewater and self.has_liquid:
            self.document.table("whitewater", settings.values(self.shot.whitewater, "WhitewaterParams", self.scale))
        elif self.shot.use_whitewater:
            self.notes.append("Whitewater is left out, since the scene has no liquid")
        volume = settings.values(self.shot.volume, "VolumeParams", self.scale)
        if self.has_smoke and volume:
            self.document.table("volume", volume)

    def camera(self) -> None:
        """The scene's camera in the first frame, for previews; a preset's camera is at rest, upright and in perspective."""
        if self.camera_samples is None:
            return
        camera = self.camera_samples.source
        name = printable(camera.name)
        if camera.type != "CAMERA" or camera.data.type != "PERSP":
            self.notes.append(f"{name}: left out of the preset, whose camera is one in perspective. The scene keeps it")
            return
        matrices = self.camera_samples.matrices
        if any(np.abs(matrix - matrices[0]).max() > 1e-6 for matrix in matrices):
            self.notes.append(f"{name}: moves; the preset has it where it is in the first frame. The scene keeps its animation")
        matrix = matrices[0]
        position, right = matrix[:3, 3], matrix[:3, 0]
        forward = -matrix[:3, 2] / np.linalg.norm(matrix[:3, 2])
        if abs(right[2]) > 1e-3 * np.linalg.norm(right) or abs(camera.data.shift_x) + abs(camera.data.shift_y) > 0.0:
            self.notes.append(f"{name}: rolls or is shifted, which the preset's camera cannot. The scene keeps it")
        data, render = camera.data, self.scene.render
        wide, high = render.resolution_x * render.pixel_aspect_x, render.resolution_y * render.pixel_aspect_y
        fits_width = data.sensor_fit == "HORIZONTAL" or (data.sensor_fit == "AUTO" and wide >= high)
        sensor = data.sensor_height if data.sensor_fit == "VERTICAL" else data.sensor_width
        width = sensor if fits_width else sensor * wide / high
        distance = self.distance(position, forward)
        values = {
            "position": position.tolist(),
            "target": (position + forward * distance).tolist(),
            "focal_length": float(np.clip(data.lens * 36.0 / width, 1.0, 5000.0)),
        }
        self.document.table("camera", values, note="millimetres for a sensor 36 mm wide")

    def distance(self, position: np.ndarray, forward: np.ndarray) -> float:
        """How far before the camera the middle of the shot's objects is [m]; at least 10 cm."""
        places = [each.matrices[0][:3, 3] for some in self.roles.values() for each in some]
        ahead = float((np.mean(places, axis=0) - position) @ forward)
        return max(ahead, 0.1)

    def output(self) -> None:
        values: dict[str, object] = {}
        if self.has_liquid:
            values["mesh"] = ["ply"]
        if self.has_smoke:
            values["volume"] = ["density", "velocity"]
        if self.has_cloth:
            values["sheet"] = ["pc2"]
        self.document.table("output", values)

    def tiers(self) -> None:
        for tier in QUALITIES[:-1]:
            factor = getattr(self.shot, tier)
            values = {}
            if self.has_liquid:
                values["liquid.spacing"] = settings.number(self.shot.liquid, "LiquidParams", "spacing", self.scale) * factor
                if self.has_splash_tension():
                    values["liquid.surface_tension.coefficient"] = self.splash_tension(factor)
            if self.has_smoke:
                values["smoke.spacing"] = settings.number(self.shot.smoke, "SmokeParams", "spacing", self.scale) * factor
            self.document.blank()
            self.document.lines.append(f"[quality.{tier}]")
            self.document.lines += [f"{key} = {toml.number(value)}" for key, value in values.items()]


def clean_vector(vector: np.ndarray) -> list[float]:
    size = float(np.abs(vector).max())
    return [0.0 if abs(part) <= 1e-6 * size else float(part) for part in vector]
