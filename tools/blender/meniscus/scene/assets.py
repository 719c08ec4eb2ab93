# SPDX-License-Identifier: MIT OR Apache-2.0
"""Files of a generated preset: meshes as PLY, point caches as PC2, the preset itself. No Blender in here.

Everything is written under a temporary name and renamed, inside the chosen folder. Meshes and point caches are written in parts, and
renamed only when all are there: a preset and its meshes belong together, so writing that is cancelled leaves the earlier ones.
Files of an earlier preset that no object needs any more are removed: those that this extension listed when it wrote them.
"""

import json
import os
import re
import struct
import time
from collections.abc import Callable, Generator
from functools import partial
from pathlib import Path
from typing import BinaryIO

import numpy as np

from ..folder import read_limited
from ..messages import ShotError, printable

ASSETS = "assets"
LIST = "files.json"
OBJECTS = "objects.json"
PRESET = "scene.toml"
MARK = "# Written by Meniscus for Blender."
OWN_FILE = re.compile(r"[A-Za-z0-9_-]{1,63}\.(?:ply|pc2)")
TEMPORARY = re.compile(rf"\.{OWN_FILE.pattern}\.\d+\.tmp")
# Age [s] at which a temporary file is that of a Blender that ended while it wrote.
ABANDONED_SECONDS = 86400.0
MAX_LIST_BYTES, MAX_OBJECTS_BYTES = 1 << 20, 16 << 20
PC2_VERSION = 1
# Bytes that are synced to the disk at once: more would hold Blender up at the end of a long point cache.
SYNC_BYTES = 16 << 20

# The content of a file: functions that make its parts, again each time.
Parts = list[Callable[[], bytes]]


def ply(vertices: np.ndarray, faces: np.ndarray | list[tuple[int, ...]]) -> bytes:
    """A mesh as binary PLY: places as single precision, faces as rows or lists of vertex numbers."""
    head = (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {len(vertices)}\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face {len(faces)}\nproperty list uchar uint vertex_indices\nend_header\n"
    )
    if isinstance(faces, np.ndarray):
        rows = np.empty(len(faces), np.dtype([("count", "u1"), ("corners", "<u4", 3)]))
        rows["count"], rows["corners"] = 3, faces
        body = rows.tobytes()
    else:
        body = b"".join(struct.pack(f"<B{len(face)}I", len(face), *face) for face in faces)
    return head.encode("ascii") + np.ascontiguousarray(vertices, "<f4").tobytes() + body


def pc2(samples: list[Callable[[], np.ndarray]], count: int, first: float, step: float) -> Parts:
    """Places of `count` vertices over time as a PC2 point cache, a sample every `step` frames from `first` on."""
    head = struct.pack("<12siiffi", b"POINTCACHE2\0", PC2_VERSION, count, first, step, len(samples))
    return [lambda: head, *(partial(packed, places) for places in samples)]


def packed(places: Callable[[], np.ndarray]) -> bytes:
    return np.ascontiguousarray(places(), "<f4").tobytes()


class Folder:
    """The folder that a user chose for the preset. Raises ShotError where it cannot be written."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.assets = root / ASSETS
        # The files of this preset, and those of them that are there under a temporary name.
        self.contents: dict[str, Parts] = {}
        self.staged: dict[Path, Path] = {}
        try:
            self.assets.mkdir(parents=True, exist_ok=True)
            inside = os.path.realpath(self.assets) == os.path.join(os.path.realpath(root), ASSETS)
        except (OSError, ValueError) as error:
            raise cannot_write(root, error) from None
        if not inside:
            raise ShotError(f"{printable(self.assets)}: leads out of the folder through a symbolic link. Remove it")

    def add(self, file: str, parts: Parts) -> str:
        """Adds a file to the assets, which `stage` and `finish` write; returns its path in the preset."""
        if not OWN_FILE.fullmatch(file):
            raise ShotError(f"{printable(file)}: not a name of a file that this extension writes")
        self.contents[file] = parts
        return f"{ASSETS}/{file}"

    def stage(self) -> Generator[float, None, None]:
        """Writes files whose content is new under temporary names, in steps that yield the finished part. Raises ShotError."""
        total, done = sum(map(len, self.contents.values())), 0
        for file, parts in self.contents.items():
            path = self.assets / file
            try:
                for count in self.stage_file(path, parts):
                    yield (done + count) / total
            except OSError as error:
                raise cannot_write(path, error) from None
            done += len(parts)

    def stage_file(self, path: Path, parts: Parts) -> Generator[float, None, None]:
        """Writes one file unless it has this content; yields how many of its parts are done, to compare being half of the work."""
        if path.is_file() and not path.is_symlink():
            with open(path, "rb") as file:
                for count, part in enumerate(parts, 1):
                    content = part()
                    if file.read(len(content)) != content:
                        break
                    yield 0.5 * count
                else:
                    if not file.read(1):
                        return
        self.staged[path] = temporary_of(path)
        with open_new(self.staged[path]) as file:
            unsynced = 0
            for count, part in enumerate(parts, 1):
                unsynced += file.write(part())
                if unsynced > SYNC_BYTES or count == len(parts):
                    sync(file)
                    unsynced = 0
                yield 0.5 * (len(parts) + count)

    def discard(self) -> None:
        """Removes temporary files, of which there are none after `finish`."""
        for temporary in self.staged.values():
            try:
                temporary.unlink(missing_ok=True)
            except OSError:
                pass

    def check_preset(self) -> None:
        """Raises ShotError if another program wrote the preset that would be replaced."""
        path = self.root / PRESET
        if not os.path.lexists(path):
            return
        with_text = read_limited(path, 64 << 20, "Choose another folder").decode("utf-8", "replace")
        if not with_text.startswith(MARK):
            text = f"not written by this extension: its first line lacks `{MARK}`. Rename the file, or choose another folder"
            raise ShotError(f"{printable(path)}: {text}")

    def finish(self, preset: str, objects: dict[str, object]) -> tuple[Path, list[str]]:
        """Renames the staged files, writes the preset and what it was made of, and removes files of objects that are gone.

        Returns the preset's path, and the names of removed files.
        """
        self.check_preset()
        earlier, written = self.listed(), set(self.contents)
        # Both lists, until the preset no longer names the earlier files.
        self.write_list(earlier | written)
        for path, temporary in self.staged.items():
            try:
                os.replace(temporary, path)
            except OSError as error:
                raise cannot_write(path, error) from None
        write(self.root / PRESET, preset.encode("utf-8"))
        write(self.assets / OBJECTS, (json.dumps(objects, indent=1) + "\n").encode("ascii"))
        # Where letters' case makes no difference, the file of an earlier `Cube` is that of `cube`.
        kept = {name.lower() for name in written}
        removed = [name for name in sorted(earlier - written) if name.lower() not in kept and self.remove(name)]
        self.write_list(written)
        self.remove_abandoned()
        return self.root / PRESET, removed

    def remove_abandoned(self) -> None:
        """Removes old temporary files, which may have gigabytes."""
        try:
            paths = list(self.assets.iterdir())
        except OSError:
            return
        for path in paths:
            try:
                if TEMPORARY.fullmatch(path.name) and time.time() - path.lstat().st_mtime > ABANDONED_SECONDS:
                    path.unlink()
            except OSError:
                # Of another user, or gone meanwhile: the preset needs none of them.
                pass

    def listed(self) -> set[str]:
        """Names of the files that this extension wrote earlier and listed."""
        path = self.assets / LIST
        if not path.is_file():
            return set()
        try:
            names = json.loads(read_limited(path, MAX_LIST_BYTES, "Remove it"))
        except (ValueError, RecursionError):
            names = None
        if not isinstance(names, list):
            raise ShotError(f"{printable(path)}: not a list of names. Remove it; files of earlier objects then stay")
        return {name for name in names if isinstance(name, str) and OWN_FILE.fullmatch(name)}

    def write_list(self, names: set[str]) -> None:
        write(self.assets / LIST, (json.dumps(sorted(names), indent=0) + "\n").encode("ascii"))

    def remove(self, name: str) -> bool:
        path = self.assets / name
        try:
            path.unlink()
        except FileNotFoundError:
            return False
        except OSError as error:
            raise cannot_write(path, error) from None
        return True


def read_objects(root: Path) -> dict:
    """The .blend, scene and objects that the preset of a folder was made of; empty if that is not known."""
    path = root / ASSETS / OBJECTS
    if not path.is_file():
        return {}
    try:
        found = json.loads(read_limited(path, MAX_OBJECTS_BYTES, "Remove it"))
    except (ShotError, ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}


def temporary_of(path: Path) -> Path:
    return path.with_name(f".{path.name}.{os.getpid()}.tmp")


def open_new(path: Path) -> BinaryIO:
    """Opens a new file for writing in the place of what is there, which is not followed if it is a symbolic link."""
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0) | getattr(os, "O_NOFOLLOW", 0)
    path.unlink(missing_ok=True)
    return os.fdopen(os.open(path, flags, 0o666), "wb")


def sync(file: BinaryIO) -> None:
    file.flush()
    os.fsync(file.fileno())


def write(path: Path, content: bytes) -> None:
    """Replaces a file by one that is complete if it exists. Raises ShotError."""
    temporary = temporary_of(path)
    try:
        if path.is_file() and not path.is_symlink() and path.stat().st_size == len(content) and path.read_bytes() == content:
            return
        with open_new(temporary) as file:
            file.write(content)
            sync(file)
        os.replace(temporary, path)
    except OSError as error:
        try:
            temporary.unlink(missing_ok=True)
        except OSError:
            pass
        raise cannot_write(path, error) from None


def cannot_write(path: Path, error: Exception) -> ShotError:
    reason = printable(getattr(error, "strerror", None) or error, 200)
    return ShotError(f"{printable(path)}: cannot be written ({reason}). Check the folder, its permissions and the disk")
