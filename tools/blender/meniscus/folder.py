# SPDX-License-Identifier: MIT OR Apache-2.0
"""The files of a shot folder: only regular files inside the folder are found or opened. No Blender in here.

Each folder is listed once, so the work is linear in the files that exist, whatever frames shot.json names.
"""

import os
import stat
from pathlib import Path
from typing import BinaryIO

from .messages import REMAKE, ShotError, printable

# A listing of this size takes a second.
MAX_LISTED_FILES = 1_000_000
# What has such a name must be a file.
EXTENSIONS = (".ply", ".obj", ".vdb", ".pc2", ".json")


def open_regular(path: str | Path) -> BinaryIO:
    """Opens a regular file for reading. Raises ShotError; a pipe or a device is never opened, nor waited for."""
    try:
        if stat.S_ISREG(os.stat(path).st_mode):
            flags = os.O_RDONLY | getattr(os, "O_BINARY", 0) | getattr(os, "O_NONBLOCK", 0)
            file = os.fdopen(os.open(path, flags), "rb", buffering=0)
            # Another file may have taken its place since.
            if stat.S_ISREG(os.fstat(file.fileno()).st_mode):
                return file
            file.close()
    except FileNotFoundError:
        raise ShotError(
            f"{printable(path)}: no such file. Choose the shot.json of a shot folder; `meniscus shot` writes it"
        ) from None
    except (OSError, ValueError) as error:
        raise ShotError(f"{printable(path)}: cannot be read ({reason(error)}). Check its path and permissions") from None
    raise ShotError(f"{printable(path)}: not a regular file. Remove it and run `meniscus shot` again to rewrite it")


def read_limited(path: Path, limit: int, next_step: str = "Choose the shot.json that `meniscus shot` wrote") -> bytes:
    """The content of a regular file in its own folder, of at most `limit` bytes. Raises ShotError."""
    if not os.path.realpath(path).startswith(inside(os.path.realpath(path.parent))):
        raise leads_outside(path)
    with open_regular(path) as file:
        try:
            content = file.read(limit + 1)
        except OSError as error:
            raise ShotError(f"{printable(path)}: cannot be read ({reason(error)}). Check the disk") from None
    if len(content) > limit:
        raise ShotError(f"{printable(path)}: more than {limit} bytes, expected at most that. {next_step}")
    return content


def reason(error: Exception) -> str:
    return printable(getattr(error, "strerror", None) or error, 200)


def inside(folder: str) -> str:
    """What the paths of all files inside a folder start with."""
    return folder if folder.endswith(os.sep) else folder + os.sep


def leads_outside(path: str | Path) -> ShotError:
    return ShotError(
        f"{printable(path)}: leads out of the shot folder through a symbolic link, expected a file inside. "
        "Copy what it links to into the shot folder"
    )


class ShotFolder:
    """Lists the folders of one shot, each once. Paths are validated ones, with / between their parts."""

    def __init__(self, root: Path) -> None:
        self.root = os.path.realpath(root)
        self.files: dict[str, set[str]] = {}
        self.numbers: dict[str, dict[tuple[str, str], list[int]]] = {}
        self.entries = 0

    def full(self, path: str) -> str:
        """The absolute path."""
        return os.path.join(self.root, *path.split("/"))

    def has(self, path: str) -> bool:
        """Whether a regular file is there. Raises ShotError."""
        folder, _, name = path.rpartition("/")
        return name in self.list(folder)

    def frames(self, pattern: str, number: str) -> list[int]:
        """The frames that have a file, ascending; `number` stands for theirs in the pattern. Raises ShotError."""
        folder, _, name = pattern.rpartition("/")
        if folder not in self.numbers:
            self.numbers[folder] = frame_numbers(self.list(folder))
        before, _, after = name.partition(number)
        return self.numbers[folder].get((before, after), [])

    def list(self, folder: str) -> set[str]:
        """Names of the regular files in a folder; none if it does not exist. Raises ShotError."""
        if folder in self.files:
            return self.files[folder]
        full = self.full(folder)
        if folder and not os.path.realpath(full).startswith(inside(self.root)):
            raise leads_outside(full)
        found = self.files[folder] = set()
        try:
            with os.scandir(full) as entries:
                for entry in entries:
                    self.entries += 1
                    if self.entries > MAX_LISTED_FILES:
                        text = f"more than {MAX_LISTED_FILES} files, expected at most that"
                        raise ShotError(f"{printable(full)}: {text}. Remove those that are not of the shot")
                    if self.is_file(entry):
                        found.add(entry.name)
        except FileNotFoundError:
            pass
        except OSError as error:
            text = f"cannot be listed ({reason(error)})"
            raise ShotError(f"{printable(full)}: {text}. Check its path and permissions") from None
        return found

    def is_file(self, entry: os.DirEntry) -> bool:
        """Whether an entry is a regular file; a folder is not. Raises ShotError at what Blender must not open.

        This holds for entries that shot.json does not name, too: a file system may find them under another spelling.
        """
        if entry.is_file(follow_symlinks=False):
            return True
        try:
            is_dir, is_file = entry.is_dir(), entry.is_file()
        except OSError as error:
            raise ShotError(f"{printable(entry.path)}: cannot be read ({reason(error)}). {REMAKE}") from None
        if is_dir and not entry.name.lower().endswith(EXTENSIONS):
            return False
        if is_dir:
            raise ShotError(f"{printable(entry.path)}: a folder, expected a file. {REMAKE}")
        if entry.is_symlink() and not os.path.realpath(entry.path).startswith(inside(self.root)):
            raise leads_outside(entry.path)
        if not is_file and os.path.exists(entry.path):
            raise ShotError(f"{printable(entry.path)}: neither a file nor a folder. {REMAKE}")
        return is_file


def frame_numbers(names: set[str]) -> dict[tuple[str, str], list[int]]:
    """The frame numbers before the extensions of file names, ascending, by what is before and after them."""
    found: dict[tuple[str, str], list[int]] = {}
    for name in names:
        stem, dot, extension = name.rpartition(".")
        before = stem.rstrip("0123456789")
        digits = stem[len(before) :]
        if digits and digits == f"{int(digits):04}":
            found.setdefault((before, dot + extension), []).append(int(digits))
    for frames in found.values():
        frames.sort()
    return found
