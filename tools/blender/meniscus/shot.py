# SPDX-License-Identifier: MIT OR Apache-2.0
"""From an untrusted shot.json to a `Shot`, whose names, paths and numbers are within their limits. No Blender in here.

Everything else in the extension uses the `Shot` alone. An invalid file is refused with a ShotError. Names and paths consist
of the characters that `meniscus` writes, so none of them can leave the folder or be anything but a name.
"""

import json
import math
import os
import re
from dataclasses import dataclass, replace
from pathlib import Path

from .folder import read_limited
from .messages import ShotError, listed, printable, shortened
from .viscosity import read_viscosity

FORMAT = "meniscus-shot"
VERSION = 1
FRAME_NUMBER = "{:04}"
VELOCITY = ["vx", "vy", "vz"]
# Kinds of outputs that show what other outputs show: the user need not know that Blender does not open them.
OTHER_FORMS = ("preview", "report", "usd")
MESH_FORMATS = ("ply", "obj")
# Grids of volumes that can be shown: fog, level sets, and what whitewater fills.
FOG, LEVEL_SET, WHITEWATER = "density", "surface", ("spray", "foam", "bubbles")

# A shot has some hundred bytes for each output; a list of 1000 outputs has half a megabyte.
MAX_MANIFEST_BYTES = 4 << 20
MAX_OUTPUTS = 1000
# Longer names of data-blocks are cut by Blender before 5.0.
MAX_NAME_BYTES = 63
MAX_PATH_BYTES = 255
# Frames of a Blender scene end here; inputs of nodes are signed integers of 32 bits.
MAX_SCENE_FRAME = 1048574
MAX_INTEGER = 2**31 - 1
# Places in metres; farther ones are no place of a shot.
MAX_POSITION = 1e9

NAME = re.compile(r"[A-Za-z0-9_-]+")
# Parts neither start nor end with a dot.
PATH = re.compile(r"(?:[A-Za-z0-9_-]+(?:\.+[A-Za-z0-9_-]+)*/)*[A-Za-z0-9_-]+(?:\.+[A-Za-z0-9_-]+)*")


@dataclass(frozen=True)
class Frames:
    """Frame numbers first, first + step, … up to last; last need not be one of them."""

    first: int
    last: int
    step: int

    def numbers(self) -> range:
        return range(self.first, self.last + 1, self.step)


@dataclass(frozen=True)
class SequenceOutput:
    """Files below the shot folder, one a frame; FRAME_NUMBER in `pattern`, before the extension, stands for the number."""

    name: str
    pattern: str
    frames: Frames
    has_velocity: bool

    def path(self, frame: int) -> str:
        """Path of one frame's file below the shot folder."""
        return self.pattern.replace(FRAME_NUMBER, f"{frame:04}")


@dataclass(frozen=True)
class MeshOutput(SequenceOutput):
    """A sequence of PLY or OBJ files: of a surface, whose vertices may have colours, or of a sheet."""

    has_colours: bool = False
    is_sheet: bool = False

    @property
    def is_obj(self) -> bool:
        return self.pattern.endswith(".obj")


@dataclass(frozen=True)
class PointsOutput(SequenceOutput):
    """A sequence of PLY files of points, each with a `radius`: droplets, tracers of smoke, or whitewater, which has a `kind`."""

    is_whitewater: bool
    has_colours: bool = False
    # Whether another output shows the same.
    is_hidden: bool = False

    @property
    def is_tracers(self) -> bool:
        return self.pattern.startswith("points/")


@dataclass(frozen=True)
class VolumeOutput(SequenceOutput):
    """A sequence of OpenVDB files."""

    grids: tuple[str, ...]
    # Whether another output shows the same.
    is_hidden: bool = False

    @property
    def has_surface(self) -> bool:
        """Whether the level set of a liquid is what it shows."""
        return LEVEL_SET in self.grids and not self.is_hidden


@dataclass(frozen=True)
class SheetOutput:
    """The rest mesh of a sheet as PLY, and one PC2 point cache with the places of its points in every frame."""

    name: str
    rest: str
    cache: str
    frames: Frames


@dataclass(frozen=True)
class ColliderOutput:
    """The mesh of a collider in its own axes as PLY, its poses as JSON, and the PC2 point cache of a mesh that deforms."""

    name: str
    mesh: str
    motion: str
    cache: str | None


@dataclass(frozen=True)
class CameraPlace:
    """The camera of a shot: where it is, the point in the middle of its picture [m], and its focal length [mm]."""

    position: tuple[float, float, float]
    target: tuple[float, float, float]
    focal_length: float


@dataclass(frozen=True)
class Shot:
    """What a shot folder holds, as far as Blender can use it."""

    folder: Path
    title: str
    fps: float
    frames: Frames
    camera: CameraPlace | None
    meshes: list[MeshOutput]
    points: list[PointsOutput]
    volumes: list[VolumeOutput]
    sheets: list[SheetOutput]
    colliders: list[ColliderOutput]
    skipped: list[str]
    # Of the liquid by the preset in the folder [Pa·s]; 0 if it has none.
    viscosity: float

    def last_frame(self) -> int:
        """The last frame of the shot and of all outputs."""
        return max(part.frames.last for part in (self, *self.meshes, *self.points, *self.volumes, *self.sheets))


def read_shot(path: Path) -> Shot:
    """Reads and validates shot.json, or the shot.json of a folder. Raises ShotError."""
    path = Path(path)
    if os.path.isdir(path):
        path = path / "shot.json"
    content = read_limited(path, MAX_MANIFEST_BYTES)
    try:
        data = json.loads(content.decode("utf-8"), parse_constant=refuse_constant)
    except (ValueError, RecursionError) as error:
        raise ShotError(
            f"{printable(path)}: not valid JSON ({printable(error, 200)}). Run `meniscus shot` again to rewrite it"
        ) from None
    return Validator(path).shot(data)


def refuse_constant(name: str) -> None:
    """NaN and Infinity, which Python reads, are no JSON."""
    raise ValueError(f"{name} is not a number")


class Validator:
    """Validates the values of one shot.json; every error names the file and the key."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.paths: set[str] = set()

    def error(self, key: str, found: object, expected: str, next_step: str = "") -> ShotError:
        next_step = next_step or "Run `meniscus shot` again to rewrite the file"
        return ShotError(f"{printable(self.path)}: {key} is {shortened(found)}, expected {expected}. {next_step}")

    def shot(self, data: object) -> Shot:
        self.check_format(data)
        fps = data.get("fps")
        if type(fps) not in (int, float) or not 0.01 <= fps <= 10000.0:
            raise self.error('"fps"', fps, "a number from 0.01 to 10000")
        if data.get("up") != "+Z":
            raise self.error('"up"', data.get("up"), '"+Z"')
        if data.get("length_unit") != "m":
            raise self.error('"length_unit"', data.get("length_unit"), '"m"')
        title = data.get("title")
        if not isinstance(title, (str, type(None))):
            raise self.error('"title"', title, "a text")
        title = printable(title or os.path.basename(self.path.parent), 100)
        frames = self.frames('"frames"', data.get("frames"))
        camera = self.camera(data.get("camera"))
        outputs = self.outputs(data.get("outputs"))
        return Shot(self.path.parent, title, float(fps), frames, camera, *outputs, read_viscosity(self.path.parent))

    def camera(self, camera: object) -> CameraPlace | None:
        """The camera, if the shot names one."""
        if camera is None:
            return None
        if not isinstance(camera, dict):
            raise self.error('"camera"', camera, "an object")
        places = []
        for part in ("position", "target"):
            place = camera.get(part)
            is_place = isinstance(place, list) and len(place) == 3 and all(type(x) in (int, float) for x in place)
            if not is_place or not all(-MAX_POSITION <= x <= MAX_POSITION for x in place):
                raise self.error(f'"camera" "{part}"', place, f"three numbers within {MAX_POSITION:g}")
            places.append(tuple(map(float, place)))
        lens = camera.get("focal_length")
        if type(lens) not in (int, float) or not 1.0 <= lens <= 5000.0:
            raise self.error('"camera" "focal_length"', lens, "a number from 1 to 5000")
        if places[0] == places[1]:
            raise self.error('"camera" "target"', list(places[1]), "another place than its position")
        return CameraPlace(*places, float(lens))

    def check_format(self, data: object) -> None:
        """Refuses other files and other versions."""
        found = data.get("format") if isinstance(data, dict) else type(data).__name__
        if not isinstance(data, dict) or found != FORMAT:
            raise self.error('"format"', found, f'"{FORMAT}"', "Choose the shot.json that `meniscus shot` wrote")
        version = data.get("version")
        if type(version) is not int or version != VERSION:
            raise ShotError(
                f'{printable(self.path)}: "version" is {shortened(version)}, this add-on reads {VERSION}. '
                "Install the add-on that came with the Meniscus that wrote the shot"
            )

    def outputs(self, outputs: object) -> tuple[list, ...]:
        """The outputs that Blender can open, by the fields of a Shot, and descriptions of the others."""
        if not isinstance(outputs, list) or not all(isinstance(output, dict) for output in outputs):
            raise self.error('"outputs"', outputs, "a list of objects")
        if len(outputs) > MAX_OUTPUTS:
            raise self.error('the number of "outputs"', len(outputs), f"at most {MAX_OUTPUTS}")
        for index, output in enumerate(outputs):
            for part in ("kind", "name", "format"):
                if not isinstance(output.get(part), str):
                    raise self.error(f'"outputs"[{index}] "{part}"', output.get(part), "a text")
        meshes, points, volumes, sheets, colliders, skipped = [], [], [], [], [], []
        known = {(o["kind"], o["format"], o["name"]) for o in outputs}
        for index, output in enumerate(outputs):
            key, kind, name = f'"outputs"[{index}]', (output["kind"], output["format"]), output["name"]
            grids = self.grids(key, output) if kind == ("volume", "vdb") else []
            if kind[0] == "mesh" and kind[1] in MESH_FORMATS:
                if not self.is_repeated(kind, name, known):
                    meshes.append(self.mesh(key, output))
            elif kind == ("points", "ply") and self.has_radius(key, output):
                points.append(self.points(key, output, ("volume", "vdb", name) in known))
            elif kind == ("sheet", "pc2"):
                sheets.append(SheetOutput(*self.moved_mesh(key, output, ".pc2"), self.frames(f'{key} "frames"', output.get("frames"))))
            elif kind == ("collider", "json"):
                colliders.append(ColliderOutput(*self.moved_mesh(key, output, ".json"), self.point_cache(key, output)))
            elif kind[0] in OTHER_FORMS or (kind[0] == "points" and ("points", "ply", name) in known):
                pass
            elif {FOG, LEVEL_SET, *WHITEWATER} & set(grids):
                is_shown_otherwise = self.is_shown_otherwise(name, grids, known)
                volumes.append(VolumeOutput(*self.sequence(key, output), "velocity" in grids, tuple(grids), is_shown_otherwise))
            else:
                skipped.append(f"{printable(name, 40)} ({', '.join(printable(text, 40) for text in kind)})")
        if not meshes and not points and not volumes and not sheets and not colliders:
            raise ShotError(
                f"{printable(self.path)}: no mesh in PLY or OBJ format, no points, volume, sheet or collider among the outputs "
                f"(found: {listed(skipped) or 'nothing'}). "
                'Add mesh = ["ply"], volume = ["density"] or sheet = ["pc2"] to the preset\'s [output] and run '
                "`meniscus shot` again"
            )
        return meshes, points, volumes, sheets, colliders, skipped

    def is_repeated(self, kind: tuple[str, str], name: str, known: set[tuple[str, str, str]]) -> bool:
        """Whether a mesh a frame shows what a point cache, or a mesh in a format with velocities, shows as well."""
        return ("sheet", "pc2", name) in known or (kind[1] == "obj" and ("mesh", "ply", name) in known)

    def is_shown_otherwise(self, name: str, grids: list[str], known: set[tuple[str, str, str]]) -> bool:
        """Whether the surface that a volume has, or its whitewater, is shown by a mesh or by points."""
        has_mesh = any(("mesh", form, name) in known for form in MESH_FORMATS)
        return has_mesh or (FOG not in grids and LEVEL_SET not in grids and ("points", "ply", name) in known)

    def mesh(self, key: str, output: dict) -> MeshOutput:
        has_colours = output["format"] == "ply" and self.has_colours(key, output)
        has_velocity = output["format"] == "ply" and self.has_velocity(key, output)
        sequence = self.sequence(key, output)
        return MeshOutput(*sequence, has_velocity, has_colours, sequence[1].startswith("sheet/"))

    def points(self, key: str, output: dict, has_volume: bool) -> PointsOutput:
        """Points; tracers are hidden where there is the smoke that they mark."""
        is_whitewater = self.attribute(key, output, "kind") == ["kind"]
        has_velocity, has_colours = self.has_velocity(key, output), self.has_colours(key, output)
        found = PointsOutput(*self.sequence(key, output), has_velocity, is_whitewater, has_colours)
        return replace(found, is_hidden=found.is_tracers and has_volume)

    def has_colours(self, key: str, output: dict) -> bool:
        return self.attribute(key, output, "color") == ["red", "green", "blue"]

    def sequence(self, key: str, output: dict) -> tuple[str, str, Frames]:
        """Name, pattern and frames of an output with a file a frame."""
        ending = f"{FRAME_NUMBER}.{output['format']}"
        pattern = output.get("pattern")
        if not isinstance(pattern, str) or pattern.count(FRAME_NUMBER) != 1 or not pattern.endswith(ending):
            expected = f"a path with one {FRAME_NUMBER} for the frame number, before .{output['format']}"
            raise self.error(f'{key} "pattern"', pattern, expected)
        stem = pattern.removesuffix(ending)
        # Blender takes all digits before the extension for the number.
        if stem[-1:].isdigit():
            raise self.error(f'{key} "pattern"', pattern, f"a path without a digit before {FRAME_NUMBER}")
        self.check_path(f'{key} "pattern"', pattern, f"{stem}0001.{output['format']}")
        return self.name(key, output), pattern, self.frames(f'{key} "frames"', output.get("frames"))

    def moved_mesh(self, key: str, output: dict, extension: str) -> tuple[str, str, str]:
        """Name, mesh, and the file that moves it, of an output with all frames in one file."""
        paths = []
        for part, ending in (("rest", ".ply"), ("pattern", extension)):
            path = output.get(part)
            if not isinstance(path, str) or not path.endswith(ending):
                raise self.error(f'{key} "{part}"', path, f"a path that ends in {ending}, without a frame number")
            self.check_path(f'{key} "{part}"', path, path)
            paths.append(path)
        return self.name(key, output), *paths

    def point_cache(self, key: str, output: dict) -> str | None:
        """The point cache of a collider that deforms."""
        path = output.get("point_cache")
        if path is None:
            return None
        if not isinstance(path, str) or not path.endswith(".pc2"):
            raise self.error(f'{key} "point_cache"', path, "a path that ends in .pc2")
        self.check_path(f'{key} "point_cache"', path, path)
        return path

    def name(self, key: str, output: dict) -> str:
        name = output.get("name")
        if not isinstance(name, str) or len(name) > MAX_NAME_BYTES or not NAME.fullmatch(name):
            expected = f"1 to {MAX_NAME_BYTES} characters, which are letters a to z, digits, - and _"
            raise self.error(f'{key} "name"', name, expected, "Rename it in the preset and run `meniscus shot` again")
        return name

    def check_path(self, key: str, found: str, path: str) -> None:
        """Refuses a path that might lead out of the shot folder, or that another output has; `found` is the text in the file."""
        if len(path) > MAX_PATH_BYTES or not PATH.fullmatch(path):
            expected = "a path inside the shot folder: letters a to z, digits, - _ . and / between its parts, "
            raise self.error(key, found, f"{expected}at most {MAX_PATH_BYTES} characters")
        if path in self.paths:
            raise self.error(key, found, "a path that no other output has")
        self.paths.add(path)

    def grids(self, key: str, output: dict) -> list[str]:
        grids = output.get("grids", [])
        if not isinstance(grids, list) or not all(isinstance(grid, str) for grid in grids):
            raise self.error(f'{key} "grids"', grids, "a list of names")
        return grids

    def attribute(self, key: str, output: dict, name: str) -> object:
        """The properties of an attribute; None if there is none."""
        attributes = output.get("attributes", {})
        if not isinstance(attributes, dict):
            raise self.error(f'{key} "attributes"', attributes, "an object")
        return attributes.get(name)

    def has_radius(self, key: str, output: dict) -> bool:
        return self.attribute(key, output, "radius") == ["radius"]

    def has_velocity(self, key: str, output: dict) -> bool:
        velocity = self.attribute(key, output, "velocity")
        if velocity not in (None, VELOCITY):
            raise self.error(f'{key} "velocity"', velocity, str(VELOCITY))
        return velocity is not None

    def frames(self, key: str, value: object) -> Frames:
        numbers = [value.get(name) for name in ("first", "last", "step")] if isinstance(value, dict) else []
        if len(numbers) != 3 or any(type(number) is not int for number in numbers):
            raise self.error(key, value, '"first", "last" and "step" as whole numbers')
        first, last, step = numbers
        if not (0 <= first <= last <= MAX_INTEGER and 1 <= step <= MAX_INTEGER):
            raise self.error(key, value, f"0 <= first <= last <= {MAX_INTEGER} and 1 <= step <= {MAX_INTEGER}")
        if first > MAX_SCENE_FRAME:
            expected = f"first <= {MAX_SCENE_FRAME}, Blender's last frame"
            raise self.error(key, value, expected, "Simulate the shot with lower frame numbers")
        return Frames(first, last, step)


def scene_rate(fps: float) -> tuple[int, float]:
    """Frames per second as Blender holds them: a whole number over a base (23.976 → 24 over 1.001)."""
    whole = max(1, math.floor(fps + 0.5))
    return whole, whole / fps


def below(folder: str, path: str) -> str:
    """A path below a folder, which is absolute or //…"""
    return f"//{path}" if folder == "//" else f"{folder.removesuffix('/')}/{path}"


def format_string(path: str) -> str:
    """A path with a FRAME_NUMBER at its end as Format String input: all other braces are doubled."""
    stem, _, extension = path.rpartition(FRAME_NUMBER)
    return stem.translate({ord("{"): "{{", ord("}"): "}}"}) + FRAME_NUMBER + extension
