# SPDX-License-Identifier: MIT OR Apache-2.0
"""Reads shot.json, the file at the top of a Meniscus shot folder. No Blender in here.

An invalid file is refused with a ShotError that names what was found, where, and what to do next.
"""

import json
import math
import re
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

FORMAT = "meniscus-shot"
VERSION = 1
NUMBER = re.compile(r"\{:0(\d)\}")
VELOCITY = ["vx", "vy", "vz"]


class ShotError(Exception):
    """A shot that cannot be opened: what, where, and the next step, in one message."""


@dataclass(frozen=True)
class Frames:
    """Frame numbers first, first + step, … up to last; last need not be one of them."""

    first: int
    last: int
    step: int

    def numbers(self) -> range:
        return range(self.first, self.last + 1, self.step)


@dataclass(frozen=True)
class MeshOutput:
    """A sequence of PLY files, one a frame."""

    name: str
    pattern: str
    frames: Frames
    has_velocity: bool

    def file(self, folder: Path, frame: int) -> Path:
        """Path of one frame's file."""
        return folder / NUMBER.sub(lambda match: f"{frame:0{match.group(1)}}", self.pattern)

    def missing(self, folder: Path) -> list[int]:
        """Frames whose file is not there."""
        return [frame for frame in self.frames.numbers() if not self.file(folder, frame).is_file()]


@dataclass(frozen=True)
class VolumeOutput:
    """A sequence of OpenVDB files, one a frame."""

    name: str
    pattern: str
    frames: Frames
    has_velocity: bool

    def path(self, folder: str, frame: int) -> str:
        """Path of one frame's file below `folder`, with / between its parts."""
        file = NUMBER.sub(lambda match: f"{frame:0{match.group(1)}}", self.pattern)
        return f"//{file}" if folder == "//" else f"{folder.removesuffix('/')}/{file}"

    def missing(self, folder: Path) -> list[int]:
        """Frames whose file is not there."""
        return [f for f in self.frames.numbers() if not Path(self.path(folder.as_posix(), f)).is_file()]


@dataclass(frozen=True)
class SheetOutput:
    """The rest mesh of a sheet as PLY, and one PC2 point cache with the places of its points in every frame."""

    name: str
    rest: str
    cache: str
    frames: Frames

    def rest_file(self, folder: Path) -> Path:
        """Path of the rest mesh."""
        return folder / self.rest

    def cache_path(self, folder: str) -> str:
        """Path of the cache below `folder`, with / between its parts."""
        return f"//{self.cache}" if folder == "//" else f"{folder.removesuffix('/')}/{self.cache}"

    def missing(self, folder: Path) -> list[Path]:
        """Files that are not there."""
        return [file for file in (folder / self.rest, folder / self.cache) if not file.is_file()]


@dataclass(frozen=True)
class Shot:
    """What a shot folder holds, as far as Blender can use it."""

    folder: Path
    title: str
    fps: float
    frames: Frames
    meshes: list[MeshOutput]
    volumes: list[VolumeOutput]
    sheets: list[SheetOutput]
    skipped: list[str]


def read_shot(path: Path) -> Shot:
    """Reads shot.json, or the shot.json of a folder. Raises ShotError."""
    path = Path(path)
    if path.is_dir():
        path = path / "shot.json"
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise ShotError(
            f"{path}: no such file. Choose the shot.json of a shot folder; `meniscus shot` writes it"
        ) from None
    except OSError as error:
        raise ShotError(f"{path}: cannot be read ({error.strerror}). Check the file's permissions") from None
    except ValueError as error:
        raise ShotError(
            f"{path}: not valid JSON ({error}). Run `meniscus shot` again to rewrite it"
        ) from None
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        found = data.get("format") if isinstance(data, dict) else type(data).__name__
        raise ShotError(
            f'{path}: "format" is {found!r}, expected "{FORMAT}". '
            "Choose the shot.json that `meniscus shot` wrote"
        )
    if data.get("version") != VERSION:
        raise ShotError(
            f'{path}: "version" is {data.get("version")!r}, this add-on reads {VERSION}. '
            "Install the add-on that came with the Meniscus that wrote the shot"
        )
    return Reader(path).shot(data)


class Reader:
    """Takes the values of one shot.json apart; every complaint names the file and the key."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def fail(self, key: str, found: object, expected: str) -> ShotError:
        return ShotError(
            f"{self.path}: {key} is {found!r}, expected {expected}. "
            "Run `meniscus shot` again to rewrite the file"
        )

    def shot(self, data: dict) -> Shot:
        fps = data.get("fps")
        if isinstance(fps, bool) or not isinstance(fps, (int, float)) or not 0.01 <= fps <= 10000.0:
            raise self.fail('"fps"', fps, "a number from 0.01 to 10000")
        if data.get("up") != "+Z":
            raise self.fail('"up"', data.get("up"), '"+Z"')
        if data.get("length_unit") != "m":
            raise self.fail('"length_unit"', data.get("length_unit"), '"m"')
        outputs = data.get("outputs")
        if not isinstance(outputs, list) or not all(isinstance(output, dict) for output in outputs):
            raise self.fail('"outputs"', outputs, "a list of objects")
        meshes, volumes, sheets, skipped = [], [], [], []
        meshed = [o.get("name") for o in outputs if (o.get("kind"), o.get("format")) == ("mesh", "ply")]
        moved = [o.get("name") for o in outputs if (o.get("kind"), o.get("format")) == ("sheet", "pc2")]
        for index, output in enumerate(outputs):
            kind, form = output.get("kind"), output.get("format")
            key, fog = f'"outputs"[{index}]', "density" in (output.get("grids") or [])
            if (kind, form) == ("mesh", "ply") and output.get("name") not in moved:
                meshes.append(self.mesh(key, output))
            elif (kind, form) == ("sheet", "pc2"):
                sheets.append(self.sheet(key, output))
            elif (kind, form) == ("volume", "vdb") and fog and output.get("name") not in meshed:
                volumes.append(self.volume(key, output))
            else:
                skipped.append(f"{output.get('name', index)} ({kind}, {form})")
        if not meshes and not volumes and not sheets:
            listed = ", ".join(skipped) or "nothing"
            raise ShotError(
                f"{self.path}: no mesh in PLY format, no volume with a density and no sheet among the outputs (found: {listed}). "
                'Add mesh = ["ply"], volume = ["density"] or sheet = ["pc2"] to the preset\'s [output] and run '
                "`meniscus shot` again"
            )
        title = str(data.get("title") or self.path.parent.name)
        return Shot(
            self.path.parent, title, float(fps), self.frames('"frames"', data.get("frames")), meshes, volumes,
            sheets, skipped,
        )

    def name(self, key: str, output: dict) -> str:
        """The name of an output."""
        name = output.get("name")
        if not isinstance(name, str) or not name:
            raise self.fail(f'{key} "name"', name, "a name")
        return name

    def inside(self, key: str, path: str) -> str:
        """A path that does not leave the shot folder."""
        parts = PurePosixPath(path)
        if parts.is_absolute() or ".." in parts.parts or "\\" in path or ":" in NUMBER.sub("", path):
            raise self.fail(key, path, "a path inside the shot folder, with / between its parts")
        return path

    def files(self, key: str, output: dict) -> tuple[str, str]:
        """The name of an output and the pattern of its files."""
        name, pattern = self.name(key, output), output.get("pattern")
        if not isinstance(pattern, str) or len(NUMBER.findall(pattern)) != 1:
            raise self.fail(f'{key} "pattern"', pattern, "a path with one {:04} for the frame number")
        return name, self.inside(f'{key} "pattern"', pattern)

    def sheet(self, key: str, output: dict) -> SheetOutput:
        paths = []
        for part in ("rest", "pattern"):
            path = output.get(part)
            if not isinstance(path, str) or not path or NUMBER.search(path):
                raise self.fail(f'{key} "{part}"', path, "a path without a frame number")
            paths.append(self.inside(f'{key} "{part}"', path))
        return SheetOutput(self.name(key, output), *paths, self.frames(f'{key} "frames"', output.get("frames")))

    def volume(self, key: str, output: dict) -> VolumeOutput:
        name, pattern = self.files(key, output)
        frames = self.frames(f'{key} "frames"', output.get("frames"))
        return VolumeOutput(name, pattern, frames, "velocity" in output["grids"])

    def mesh(self, key: str, output: dict) -> MeshOutput:
        name, pattern = self.files(key, output)
        attributes = output.get("attributes") or {}
        if not isinstance(attributes, dict):
            raise self.fail(f'{key} "attributes"', attributes, "an object")
        velocity = attributes.get("velocity")
        if velocity not in (None, VELOCITY):
            raise self.fail(f'{key} "velocity"', velocity, str(VELOCITY))
        frames = self.frames(f'{key} "frames"', output.get("frames"))
        return MeshOutput(name, pattern, frames, velocity is not None)

    def frames(self, key: str, value: object) -> Frames:
        numbers = [value.get(name) for name in ("first", "last", "step")] if isinstance(value, dict) else []
        if len(numbers) != 3 or any(type(number) is not int for number in numbers):
            raise self.fail(key, value, '"first", "last" and "step" as whole numbers')
        frames = Frames(*numbers)
        if frames.first < 0 or frames.last < frames.first or frames.step < 1:
            raise self.fail(key, value, "0 <= first <= last and step >= 1")
        return frames


def scene_rate(fps: float) -> tuple[int, float]:
    """Frames per second as Blender holds them: a whole number over a base (23.976 → 24 over 1.001)."""
    whole = max(1, math.floor(fps + 0.5))
    return whole, whole / fps


def format_pattern(path: str, pattern: str) -> str:
    """A folder and a pattern as one Format String input: only the braces of the frame number stay single."""
    head, width, tail = NUMBER.split(pattern)
    escape = {ord("{"): "{{", ord("}"): "}}"}
    head = f"{path.removesuffix('/')}/{head}" if path != "//" else f"//{head}"
    return head.translate(escape) + f"{{:0{width}}}" + tail.translate(escape)
