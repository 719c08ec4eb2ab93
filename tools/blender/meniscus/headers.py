# SPDX-License-Identifier: MIT OR Apache-2.0
"""Compares the headers of mesh and point cache files with the files' sizes. No Blender in here.

Blender's PLY reader believes a header: a count above 2³¹ ends the process, a smaller one is allocated. docs/formats/mesh.md
has the layout that is accepted here. The contents are left to Blender, which checks the vertex numbers of faces.
"""

import os
import re
import struct
from dataclasses import dataclass

from .folder import ShotFolder, open_regular, reason
from .messages import REMAKE, ShotError, printable, shortened

MAX_PLY_HEADER_BYTES = 8192
MAX_COUNT = 2**31 - 1
PLY = re.compile(
    rb"ply\nformat binary_little_endian 1\.0\n(?:comment[^\r\n]*\n)*element vertex (\d{1,10})\n"
    rb"((?:property double [xyz]\n){3})?"
    rb"((?:property (?:float|uint) [!-~]+\n|property uchar red\nproperty uchar green\nproperty uchar blue\n)*)"
    rb"(?:element face (\d{1,10})\nproperty list uchar uint vertex_indices\n)?end_header\n"
)
OBJ_MARK = b"# Meniscus: metres, Z up"
FACE_BYTES = 13
BYTES = {b"double": 8, b"float": 4, b"uint": 4, b"uchar": 1}
PC2 = struct.Struct("<12siiffi")


@dataclass(frozen=True)
class PointCache:
    """What the header of a point cache must contain."""

    points: int
    first: int
    step: int
    samples: int


def head(folder: ShotFolder, path: str, size: int) -> tuple[bytes, int]:
    """The first `size` bytes of a file and its whole size. Raises ShotError."""
    with open_regular(folder.full(path)) as file:
        try:
            return file.read(size), os.fstat(file.fileno()).st_size
        except OSError as error:
            raise damaged(folder, path, f"cannot be read ({reason(error)})") from None


def damaged(folder: ShotFolder, path: str, finding: str) -> ShotError:
    return ShotError(f"{printable(folder.full(path))}: {finding}. {REMAKE}")


def check_ply(folder: ShotFolder, path: str, has_faces: bool = True) -> int:
    """Raises ShotError unless header and size of a mesh, or of points without faces, agree; the number of its vertices."""
    start, size = head(folder, path, MAX_PLY_HEADER_BYTES)
    match = PLY.match(start)
    if not match or (match[4] is not None) != has_faces:
        raise damaged(folder, path, f"starts with {shortened(start)}, expected a PLY header as `meniscus` writes it")
    vertices, faces = int(match[1]), int(match[4] or 0)
    if max(vertices, 3 * faces) > MAX_COUNT:
        raise damaged(folder, path, f"{vertices} vertices and {faces} faces, expected less than 2³¹ vertices and corners")
    # Coordinates far from the origin are in double precision.
    coordinates, others = (match[group] or b"" for group in (2, 3))
    properties = [line.split(b" ") for line in (coordinates + others).splitlines()]
    names = [name for _, _, name in properties]
    if names[:3] != [b"x", b"y", b"z"] or len(set(names)) < len(names):
        raise damaged(folder, path, f"vertex properties {shortened(names)}, expected x, y, z and others, each once")
    vertex_bytes = sum(BYTES[kind] for _, kind, _ in properties)
    expected = match.end() + vertex_bytes * vertices + FACE_BYTES * faces
    if size != expected:
        raise damaged(folder, path, f"{size} bytes, expected {expected} for {vertices} vertices and {faces} faces")
    return vertices


def check_obj(folder: ShotFolder, path: str) -> None:
    """Raises ShotError unless a mesh as text has the first line that `meniscus` writes; as text it allocates what its size allows."""
    start, _ = head(folder, path, len(OBJ_MARK))
    if start != OBJ_MARK:
        raise damaged(folder, path, f"starts with {shortened(start)}, expected the first line of an OBJ as `meniscus` writes it")


def check_pc2(folder: ShotFolder, path: str, wanted: PointCache) -> None:
    """Raises ShotError unless a point cache has the header and the size that it must have."""
    start, size = head(folder, path, PC2.size)
    expected = PC2.pack(b"POINTCACHE2\0", 1, wanted.points, wanted.first, wanted.step, wanted.samples)
    if start != expected:
        found = shortened(start)
        if len(start) == PC2.size and start[:12] == expected[:12]:
            _, version, points, first, step, samples = PC2.unpack(start)
            found = f"version {version}, {points} points, {samples} samples from frame {first:g} on, {step:g} frames apart"
        text = f"version 1, {wanted.points} points, {wanted.samples} samples from frame {wanted.first} on, {wanted.step} frames apart"
        raise damaged(folder, path, f"its header has {found}, expected {text}")
    expected_size = PC2.size + 12 * wanted.points * wanted.samples
    if size != expected_size:
        raise damaged(folder, path, f"{size} bytes, expected {expected_size} for {wanted.points} points and {wanted.samples} samples")
