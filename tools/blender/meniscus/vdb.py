# SPDX-License-Identifier: MIT OR Apache-2.0
"""Checks the headers of OpenVDB files: everything in front of the nodes of each grid's tree. No Blender in here.

OpenVDB allocates whatever a length in a header requests: with random numbers there, 24 GiB and the end of Blender. docs/formats/volume.md
has the layout that is accepted here. The nodes and values behind the headers are left to OpenVDB.
"""

import math
import os
import re
import struct
from typing import BinaryIO

from .folder import ShotFolder, open_regular, reason
from .headers import damaged
from .messages import shortened

# A file has less than 200 bytes in front of its descriptors, a descriptor and the head of a grid less than 1000.
MAX_HEADER_BYTES = 8192
MAGIC = 0x56444220
FILE_VERSION = 224
# OpenVDB 5 to 12 write this version of the format.
LIBRARY_VERSIONS = range(5, 13)
MAX_GRIDS = 16
MAX_METADATA = 32
TREE = re.compile(rb"Tree_(float|vec3s)_5_4_3(?:_HalfFloat)?")
# Bytes of a value of metadata; None is any number.
METADATA_BYTES = {b"string": None, b"bool": 1, b"int64": 8, b"vec3i": 12}
# Active values only, and zip, Blosc or none.
COMPRESSIONS = (2, 3, 6)
# Minimum size of a child of the root: its first node and its two masks.
MIN_CHILD_BYTES = 12 + 2 * 4096


class HeaderError(Exception):
    """What is wrong with a header, and what was expected."""


class Header:
    """Reads the values of a header one after the other. Raises HeaderError where it ends early."""

    def __init__(self, content: bytes) -> None:
        self.content = content
        self.position = 0

    def take(self, size: int, what: str) -> bytes:
        taken = self.content[self.position : self.position + size]
        if len(taken) < size:
            raise HeaderError(f"{what} of {size} bytes ends after the header, expected an OpenVDB file")
        self.position += size
        return taken

    def unpack(self, layout: str, what: str) -> tuple:
        return struct.unpack(layout, self.take(struct.calcsize(layout), what))

    def text(self, what: str) -> bytes:
        (size,) = self.unpack("<I", what)
        return self.take(size, what)

    def number(self, what: str, allowed: range | tuple[int, ...]) -> int:
        (number,) = self.unpack("<I", what)
        require(number in allowed, what, number, allowed)
        return number

    def metadata(self) -> None:
        for _ in range(self.number("the number of metadata", range(MAX_METADATA + 1))):
            name, kind = self.text("the name of a metadata"), self.text("the type of a metadata")
            require(kind in METADATA_BYTES, f"the type of the metadata {shortened(name)}", kind, "string, bool, int64 or vec3i")
            size = len(self.text(f"the metadata {shortened(name)}"))
            require(METADATA_BYTES[kind] in (None, size), f"the size of the metadata {shortened(name)}", size, METADATA_BYTES[kind])


def require(good: bool, what: str, found: object, expected: object) -> None:
    """Raises HeaderError unless a value is good."""
    if not good:
        if isinstance(expected, range):
            expected = f"{expected[0]} to {expected[-1]}"
        elif isinstance(expected, tuple):
            expected = " or ".join(map(str, expected))
        raise HeaderError(f"{what} is {shortened(found)}, expected {expected}")


def check_vdb(folder: ShotFolder, path: str) -> None:
    """Raises ShotError unless the headers of a volume and of its grids agree with the file's size."""
    with open_regular(folder.full(path)) as file:
        try:
            check_headers(file, os.fstat(file.fileno()).st_size)
        except OSError as error:
            raise damaged(folder, path, f"cannot be read ({reason(error)})") from None
        except HeaderError as error:
            raise damaged(folder, path, str(error)) from None


def check_headers(file: BinaryIO, size: int) -> None:
    """Checks the header of a file and those of its grids, which follow one another to the end of the file."""
    position, header = 0, Header(file.read(MAX_HEADER_BYTES))
    magic, version, library, _, has_offsets = header.unpack("<QIIIB", "the start")
    require(magic == MAGIC, "its first number", magic, f"{MAGIC}, which OpenVDB files have")
    require(version == FILE_VERSION, "the version of the format", version, FILE_VERSION)
    require(library in LIBRARY_VERSIONS, "the version of OpenVDB", library, LIBRARY_VERSIONS)
    require(has_offsets == 1, "the flag for offsets", has_offsets, 1)
    header.take(36, "the identity")
    header.metadata()
    for index in range(header.number("the number of grids", range(MAX_GRIDS + 1))):
        if index > 0:
            file.seek(position)
            header = Header(file.read(MAX_HEADER_BYTES))
        position = check_grid(header, position, size)
    end = position or header.position
    require(size == end, "the size of the file", size, f"{end} bytes as in its header")


def check_grid(header: Header, start: int, size: int) -> int:
    """Checks the descriptor and the head of a grid in a header read from `start`; where the grid ends."""
    name, kind, parent = header.text("the name of a grid"), header.text("the type of a grid"), header.text("the parent of a grid")
    tree = TREE.fullmatch(kind)
    require(bool(tree), "the type of a grid", kind, "Tree_float_5_4_3 or Tree_vec3s_5_4_3")
    require(parent == b"", "the parent of a grid", parent, "none")
    head, values, end = header.unpack("<qqq", "the offsets of a grid")
    grid = f"the grid {shortened(name)}"
    require(head == start + header.position, f"the offset of {grid}", head, start + header.position)
    require(head < values <= end <= size, f"the end of {grid}", (values, end), f"at most {size}, the size of the file")
    header.number(f"the compression of {grid}", COMPRESSIONS)
    header.metadata()
    transform = header.text(f"the transform of {grid}")
    require(transform == b"UniformScaleMap", f"the transform of {grid}", transform, "UniformScaleMap")
    scales = header.unpack("<15d", f"the transform of {grid}")
    sound = all(math.isfinite(scale) and scale > 0.0 for scale in scales)
    require(sound, f"the transform of {grid}", scales[:3], "finite numbers above 0")
    header.number(f"the number of buffers of {grid}", (1,))
    background = header.unpack("<f" if tree[1] == b"float" else "<3f", f"the background of {grid}")
    require(all(map(math.isfinite, background)), f"the background of {grid}", background, "finite numbers")
    header.number(f"the number of tiles of {grid}", (0,))
    topology = values - start - header.position - 4
    header.number(f"the number of children of {grid}", range(max(topology, 0) // MIN_CHILD_BYTES + 1))
    return end
