# SPDX-License-Identifier: MIT OR Apache-2.0
"""Reads Meniscus cache frames (frame_0001.mcf) into numpy arrays. Read-only.

    python -m meniscus_fx.cache frame_0001.mcf      # prints what is there

Needs numpy and zstandard; checks every checksum where xxhash is installed.
The format is described in docs/formats/cache.md.

    from meniscus_fx import cache
    frame = cache.read("cache/frame_0001.mcf")
    frame["streams"]["liquid"]["channels"]["position"]    # float32, shape (n, 3) [m]
"""

from __future__ import annotations

import os
import struct
import sys
from typing import TYPE_CHECKING, Any

import numpy

try:
    import xxhash
except ImportError:
    xxhash = None  # type: ignore[assignment, unused-ignore]

if TYPE_CHECKING:
    from ._errors import MeniscusError
else:
    try:
        from ._errors import MeniscusError
    except ImportError:
        # This file works alone, too.
        MeniscusError = Exception

MAGIC = b"\x89MCF\r\n\x1a\n"
END = b"MCF-END\n"
VERSIONS = (1, 2)
KINDS = {1: "particles", 2: "tracers", 3: "vortons", 4: "mesh_points", 5: "mesh_faces", 6: "rigid_bodies"}
TYPES = {1: ("<f4", 1), 2: ("<f4", 3), 3: ("<u4", 1)}


class CacheError(MeniscusError):
    """The file is not a whole frame of this version."""


def read_header(path: str | os.PathLike[str]) -> dict[str, Any]:
    """The fields of the frame's header, without the columns."""
    with open(path, "rb") as file:
        return _header(path, file.read())[0]


def read(path: str | os.PathLike[str]) -> dict[str, Any]:
    """The frame: header fields, and every channel as an array.

    {"key", "frame", "time", "tool", "streams": {name: {"len", "kind", "scalars": {..}, "channels": {name: array}}}}
    """
    try:
        import zstandard
    except ImportError:
        raise CacheError("columns are packed with zstd: pip install zstandard") from None
    with open(path, "rb") as file:
        data = file.read()
    frame, columns, at, checksum = _header(path, data)
    entries_in_chunk = frame["entries_in_chunk"]
    seal = [struct.pack("<Q", checksum)]
    for stream_name, channel_name, kind in columns:
        stream = frame["streams"][stream_name]
        dtype, words = TYPES[kind]
        chunks = [numpy.empty((0, 4 * words), "u1")]
        for first in range(0, stream["len"], entries_in_chunk):
            entries = min(entries_in_chunk, stream["len"] - first)
            place = f"{path}: {stream_name}.{channel_name}, entry {first}"
            if at + 12 > len(data) - 24:
                raise CacheError(f"{place}: found the end, expected a chunk")
            stored, expected = struct.unpack_from("<IQ", data, at)
            seal.append(data[at : at + 12])
            packed = data[at + 12 : at + 12 + stored]
            _compare(place, packed, expected)
            try:
                raw = zstandard.ZstdDecompressor().decompress(packed, max_output_size=4 * words * entries)
            except zstandard.ZstdError as error:
                raise CacheError(f"{place}: {error}") from None
            if len(raw) != 4 * words * entries:
                raise CacheError(f"{place}: found {len(raw)} bytes, expected {4 * words * entries}")
            chunks.append(numpy.frombuffer(raw, "u1").reshape(4 * words, entries).T)
            at += 12 + stored
        column = numpy.ascontiguousarray(numpy.concatenate(chunks)).view(dtype)
        stream["channels"][channel_name] = column.reshape(-1, 3) if words == 3 else column.reshape(-1)
    if at != len(data) - 24:
        raise CacheError(f"{path}: found {len(data) - 24 - at} bytes after the last chunk, expected the trailer")
    _compare(f"{path}: seal", b"".join(seal), struct.unpack_from("<Q", data, len(data) - 16)[0])
    return frame


def _compare(place: str, data: bytes, expected: int) -> None:
    if xxhash is not None and xxhash.xxh3_64_intdigest(data) != expected:
        raise CacheError(f"{place}: the checksum differs, expected {expected:016x}: the file is damaged")


def _kind_in_version_1(name: str) -> str:
    """The kind of a stream of that name, which version 1 does not store."""
    if name.startswith("sheet."):
        return "mesh_faces" if name.endswith(".faces") else "mesh_points"
    return {"liquid": "particles", "smoke": "vortons", "smoke_tracers": "tracers"}.get(name, "unknown")


def _header(path: str | os.PathLike[str], data: bytes) -> tuple[dict[str, Any], list[tuple[str, str, int]], int, int]:
    """Header fields, (stream, channel, type) of every column, start of the columns, checksum of the header."""
    if data[:8] != MAGIC or len(data) < 48:
        raise CacheError(f"{path}: found {data[:8]!r}, expected a cache frame")
    version, length, checksum = struct.unpack_from("<IIQ", data, 8)
    if version not in VERSIONS:
        raise CacheError(f"{path}: found format version {version}, expected one of {VERSIONS}")
    if data[-8:] != END or struct.unpack_from("<Q", data, len(data) - 24)[0] != len(data):
        raise CacheError(f"{path}: found no trailer for {len(data)} bytes: the file was cut or extended")
    header = data[24 : 24 + length]
    _compare(f"{path}: header", data[:16] + header, checksum)
    at = 0

    def take(form: str) -> Any:
        nonlocal at
        values = struct.unpack_from(form, header, at)
        at += struct.calcsize(form)
        return values[0] if len(values) == 1 else values

    def text() -> str:
        return str(take(f"{take('<I')}s"), "utf-8")

    try:
        key, index, time = take("<QId")
        frame = {"key": key, "frame": index, "time": time, "tool": text(), "entries_in_chunk": take("<I")}
        columns: list[tuple[str, str, int]] = []
        frame["streams"] = {}
        for _ in range(take("<I")):
            name = text()
            kind = _kind_in_version_1(name) if version == 1 else KINDS.get(take("<B"), "unknown")
            stream = frame["streams"][name] = {"len": take("<Q"), "kind": kind, "scalars": {}, "channels": {}}
            columns += [(name, text(), take("<B")) for _ in range(take("<I"))]
            for _ in range(take("<I")):
                scalar = text()
                stream["scalars"][scalar] = take("<d")
    except (struct.error, UnicodeDecodeError) as error:
        raise CacheError(f"{path}: header: {error}") from None
    if at != length or any(kind not in TYPES for *_, kind in columns) or frame["entries_in_chunk"] < 1:
        raise CacheError(f"{path}: header: found fields that version {version} does not have")
    return frame, columns, 24 + length, checksum


def main() -> None:
    for path in sys.argv[1:]:
        frame = read(path)
        checked = "checksums match" if xxhash else "checksums not compared (pip install xxhash)"
        print(f"{path}: frame {frame['frame']}, time {frame['time']:.6g} s, key {frame['key']:016x}, {checked}")
        for name, stream in frame["streams"].items():
            print(f"  {name} ({stream['kind']}): {stream['len']} entries, scalars {stream['scalars']}")
            for channel, values in stream["channels"].items():
                bounds = f" from {values.min(axis=0)} to {values.max(axis=0)}" if len(values) else ""
                print(f"    {channel}: {values.dtype}{list(values.shape)}{bounds}")


if __name__ == "__main__":
    main()
