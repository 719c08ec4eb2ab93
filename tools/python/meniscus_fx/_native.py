# SPDX-License-Identifier: MIT OR Apache-2.0
"""The library behind `reconstruct`: its C interface, of which `native/src/lib.rs` is the other side."""

from __future__ import annotations

import ctypes
import sys
from pathlib import Path
from typing import Any

from ._errors import Interrupted, MeniscusError, OutOfMemoryError, ParameterError, ParticleError

ABI = 2
NAMES = {"win32": "meniscus_native.dll", "darwin": "libmeniscus_native.dylib"}
PATH = Path(__file__).resolve().parent / "lib" / NAMES.get(sys.platform, "libmeniscus_native.so")

F32, F32X3, U32, U32X3 = 1, 2, 3, 4


class Text(ctypes.Structure):
    """UTF-8 text of the other side of a call."""

    _fields_ = [("data", ctypes.c_void_p), ("len", ctypes.c_size_t)]

    def __str__(self) -> str:
        return ctypes.string_at(self.data, self.len).decode("utf-8", "replace") if self.len else ""


class InputColumn(ctypes.Structure):
    """A column of particles."""

    _fields_ = [("name", Text), ("kind", ctypes.c_uint32), ("data", ctypes.c_void_p)]


class RawRequest(ctypes.Structure):
    """What a surface is made of."""

    _fields_ = [
        ("particles", ctypes.c_size_t),
        ("columns", ctypes.POINTER(InputColumn)),
        ("column_count", ctypes.c_size_t),
        ("spacing", ctypes.c_double),
        ("quality", Text),
        ("settings", ctypes.POINTER(Text)),
        ("setting_count", ctypes.c_size_t),
        ("threads", ctypes.c_size_t),
        ("max_memory", ctypes.c_uint64),
        ("cancel", ctypes.c_void_p),
    ]


class OutcomeColumn(ctypes.Structure):
    """A column of a mesh."""

    _fields_ = [("name", Text), ("kind", ctypes.c_uint32), ("len", ctypes.c_size_t), ("data", ctypes.c_void_p)]


# Result and arguments of every function.
FUNCTIONS = {
    "meniscus_abi": (ctypes.c_uint32, []),
    "meniscus_version": (Text, []),
    "meniscus_cancel_new": (ctypes.c_void_p, []),
    "meniscus_cancel_set": (None, [ctypes.c_void_p]),
    "meniscus_cancel_free": (None, [ctypes.c_void_p]),
    "meniscus_reconstruct": (ctypes.c_void_p, [ctypes.POINTER(RawRequest)]),
    "meniscus_outcome_status": (ctypes.c_uint32, [ctypes.c_void_p]),
    "meniscus_outcome_text": (Text, [ctypes.c_void_p]),
    "meniscus_outcome_column_count": (ctypes.c_size_t, [ctypes.c_void_p]),
    "meniscus_outcome_column": (OutcomeColumn, [ctypes.c_void_p, ctypes.c_size_t]),
    "meniscus_outcome_write": (ctypes.c_void_p, [ctypes.c_void_p, Text]),
    "meniscus_outcome_free": (None, [ctypes.c_void_p]),
}

_loaded: ctypes.CDLL | None = None
# Status of a call whose threads wait for memory for ever: what it reads stays in `_read`.
ABANDONED = 6
_read: dict[Reading, object] = {}


def library() -> ctypes.CDLL:
    """The library, loaded once."""
    global _loaded
    if _loaded is None:
        try:
            found = ctypes.CDLL(str(PATH))
        except OSError as error:
            hint = "install the wheel for this platform; a checkout has no library (docs/python.md)"
            raise MeniscusError(f"{PATH}: cannot load the library: {error}; {hint}") from None
        # Another version may lack functions.
        abi = found.meniscus_abi() if hasattr(found, "meniscus_abi") else None
        if abi != ABI:
            raise MeniscusError(f"{PATH}: found interface {abi}, expected {ABI}: install meniscus-fx again")
        for name, (result, arguments) in FUNCTIONS.items():
            function = getattr(found, name)
            function.restype, function.argtypes = result, arguments
        _loaded = found
    return _loaded


def text(value: bytes) -> Text:
    """A text for a call; `value` is to be kept until it returns."""
    return Text(ctypes.cast(ctypes.c_char_p(value), ctypes.c_void_p), len(value))


class Flag:
    """Owns a flag that cancels a call, and is freed with its last owner: the caller or the thread of the call."""

    def __init__(self) -> None:
        self.address: int = library().meniscus_cancel_new()

    def __del__(self) -> None:
        if _loaded is not None:
            _loaded.meniscus_cancel_free(self.address)

    def set(self) -> None:
        library().meniscus_cancel_set(self.address)


class Reading:
    """Keeps what a call reads, until its threads do not read it any more."""

    def __init__(self, *read: object) -> None:
        # Noted before the call: afterwards there may be no memory for it.
        _read[self] = read

    def end(self, outcome: Outcome | None) -> None:
        """The call ended with this outcome; None: without one."""
        if outcome is None or outcome.status() != ABANDONED:
            del _read[self]


class Outcome:
    """Owns the result of a call, which is freed with it. It never changes, so that copies share it."""

    def __init__(self, address: int):
        self.address = address

    def __del__(self) -> None:
        # At the end of the interpreter the library may be gone, and memory is with the process.
        if _loaded is not None:
            _loaded.meniscus_outcome_free(self.address)

    def __copy__(self) -> Outcome:
        return self

    def __deepcopy__(self, memo: object) -> Outcome:
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        # Another owner of the address would free it twice.
        raise TypeError("a mesh cannot be pickled: pass on its arrays (`mesh.vertices`, …) or a file (`mesh.write`)")

    def check(self) -> None:
        """Raises the error that the call ended with, if it did."""
        status = self.status()
        message = self.text()
        if status == 1:
            raise ParameterError(message)
        if status == 2:
            raise ParticleError(message)
        if status == 3:
            raise Interrupted(message)
        if status in (5, ABANDONED):
            raise OutOfMemoryError(message)
        if status != 0:
            raise MeniscusError(f"a bug in meniscus {library().meniscus_version()}: {message}")

    def status(self) -> int:
        return int(library().meniscus_outcome_status(self.address))

    def text(self) -> str:
        return str(library().meniscus_outcome_text(self.address))

    def columns(self) -> list[OutcomeColumn]:
        count = library().meniscus_outcome_column_count(self.address)
        return [library().meniscus_outcome_column(self.address, column) for column in range(count)]

    def write(self, path: str) -> None:
        encoded = path.encode("utf-8")
        reading, failed = Reading(self), None
        try:
            address = library().meniscus_outcome_write(self.address, text(encoded))
            failed = Outcome(address) if address is not None else None
        finally:
            reading.end(failed)
        if failed is not None:
            failed.check()
