# SPDX-License-Identifier: MIT OR Apache-2.0
"""Surfaces of particles in numpy arrays."""

from __future__ import annotations

import _thread
import contextlib
import ctypes
import json
import os
import threading
import warnings
from typing import TYPE_CHECKING, Any, Callable, Mapping

import numpy

from . import _native, _toml
from ._errors import MeniscusError, ParameterError, ParticleError, SurfaceWarning

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

TYPES = {_native.F32: ("<f4", 1), _native.F32X3: ("<f4", 3), _native.U32: ("<u4", 1), _native.U32X3: ("<u4", 3)}
KINDS = {("float32", 1): _native.F32, ("float32", 2): _native.F32X3, ("uint32", 1): _native.U32}


class Mesh:
    """A closed triangle mesh around particles; faces are counter-clockwise seen from outside.

    The arrays are read-only views of memory that the mesh owns: they stay valid for as long as one of them or the mesh is in
    use. `.copy()` gives an array that can be changed. A mesh can be copied, not pickled.
    """

    vertices: NDArray[Any]
    """Positions [m], shape (v, 3): float32; float64 where the particles are so far from the origin that float32 does not
    distinguish the vertices of a surface."""
    triangles: NDArray[numpy.uint32]
    """Three vertices per triangle, shape (t, 3)."""
    normals: NDArray[numpy.float32]
    """Unit outward normals, shape (v, 3)."""
    attributes: dict[str, NDArray[Any]]
    """Interpolated attributes of the particles, one value per vertex, such as `velocity` [m/s]."""
    points: NDArray[Any] | None
    """Centres [m] of small components that became points; None unless `components` was set."""
    point_radii: NDArray[numpy.float32] | None
    """Radii of these points [m]."""
    point_attributes: dict[str, NDArray[Any]]
    """Attributes of these points."""
    report: dict[str, Any]
    """What the mesh is and how it was made: `check` (closed, manifold, oriented, volume [m³], area [m²], …), `stats` (counts
    and seconds of each pass), `adjustments` and `losses` as pairs of a number and what it counts."""

    def __init__(self, outcome: _native.Outcome):
        self._outcome = outcome
        self.report = json.loads(outcome.text())
        self.attributes, self.point_attributes = {}, {}
        self.points = self.point_radii = None
        for column in outcome.columns():
            self._add(str(column.name), _array(outcome, column))

    def _add(self, name: str, values: NDArray[Any]) -> None:
        if name in ("vertices", "points"):
            origin = numpy.array(self.report["origin"])
            if origin.any():
                values = values + origin
                values.flags.writeable = False
            setattr(self, name, values)
        elif name.startswith("vertex."):
            self.attributes[name[len("vertex.") :]] = values
        elif name.startswith("point."):
            self.point_attributes[name[len("point.") :]] = values
        else:
            setattr(self, name, values)

    @property
    def volume(self) -> float:
        """The enclosed volume [m³]."""
        return float(self.report["check"]["volume"])

    @property
    def area(self) -> float:
        """The area [m²]."""
        return float(self.report["check"]["area"])

    @property
    def is_sound(self) -> bool:
        """Whether the mesh is closed, manifold, oriented, finite and without degenerate triangles."""
        return bool(self.report["sound"])

    def write(self, path: str | os.PathLike[str]) -> None:
        """Writes the mesh to a `.ply` or `.obj` file, which appears whole or not at all.

        Raises OSError if the file cannot be written.
        """
        try:
            self._outcome.write(os.fspath(path))
        except ParticleError as error:
            raise OSError(str(error)) from None

    def __repr__(self) -> str:
        return f"<meniscus_fx.Mesh: {len(self.vertices)} vertices, {len(self.triangles)} triangles>"


def reconstruct(
    positions: ArrayLike,
    spacing: float,
    *,
    quality: str | None = "final",
    velocity: ArrayLike | None = None,
    radius: ArrayLike | None = None,
    attributes: Mapping[str, ArrayLike] | None = None,
    threads: int = 0,
    max_memory: int | None = None,
    **surface: Any,
) -> Mesh:
    """The surface of particles as a closed triangle mesh.

    Arrays that are float32 (uint32 for integers), C-contiguous and aligned are read in place; others are converted, which
    copies them: float64 loses precision, signed integers must not be negative. Nothing may write to the arrays during the
    call. The result is the same for any number of threads, on any computer. Ctrl-C in the main thread stops the call.

    Args:
        positions: Positions of the particles [m], shape (n, 3).
        spacing: Distance between particles at rest [m], twice the particle radius of other tools. Range: 1e-6 to 1e6.
        quality: Tier of settings to start from: "draft", "preview" or "final" (the smoothest, as `meniscus mesh`); None: the
            defaults of [surface], without anisotropy and smoothing.
        velocity: Velocities [m/s], shape (n, 3); the mesh gets a `velocity` per vertex, for motion blur.
        radius: Radii of the particles [m], shape (n,): each kernel scales with its particle's.
        attributes: Further values per particle, shape (n,) or (n, 3), interpolated to the vertices under the same names.
        threads: Threads to compute with, at most 1024; 0 uses every core.
        max_memory: Memory that the surface may need [bytes], by an estimate before it is made; None: what the system grants.
        **surface: Keys of [surface] (docs/parameters.md): `voxel=0.5`, `kernel_radius=2`, `smoothing={"wavelength": 6}`,
            `anisotropy={}`, `components={}`, `decimation={"fraction": 0.5}` …; None removes a term that the tier has.

    Raises:
        ParameterError: a parameter is unknown or out of range; the message has the range. It is a ValueError.
        ParticleError: an array has the wrong shape, or numbers that are not finite, with the index. It is a ValueError.
        OutOfMemoryError: there is too little memory. It is a MemoryError.

    Warns:
        SurfaceWarning: particles are left out or limited, with their number, or the mesh is not sound.
    """
    columns = {"position": _finite("positions", _column("positions", positions, vectors=True))}
    count = len(columns["position"])
    if velocity is not None:
        columns["velocity"] = _finite("velocity", _column("velocity", velocity, vectors=True))
    if radius is not None:
        columns["radius"] = _finite("radius", _column("radius", radius, vectors=False))
        surface.setdefault("radius", "attribute")
    for name, values in (attributes or {}).items():
        if not isinstance(name, str) or name in ("position", "velocity", "radius"):
            expected = "expected a name other than position, velocity and radius, which are parameters"
            raise ParameterError(f"attributes: found {name!r}, {expected}")
        place = f"attributes[{name!r}]"
        columns[name] = _finite(place, _column(place, values, vectors=None))
    for name, values in columns.items():
        if len(values) != count:
            raise ParticleError(f"{name}: found {len(values)} values, expected {count}, as many as positions")
    if attributes and "attributes" not in surface:
        surface["attributes"] = [name for name in columns if name not in ("position", "radius")]
    mesh = Mesh(_made(columns, spacing, quality, threads, max_memory, surface))
    for number, what in mesh.report["losses"]:
        warnings.warn(f"{number} {what}", SurfaceWarning, stacklevel=2)
    if not mesh.is_sound:
        warnings.warn(f"the mesh is not sound: {mesh.report['check']['first_fault']}", SurfaceWarning, stacklevel=2)
    return mesh


def _column(name: str, values: ArrayLike, vectors: bool | None) -> NDArray[Any]:
    """An array that the library can read: the one given, if it is suitable."""
    array = numpy.asarray(values)
    if array.dtype.kind not in "fiu":
        raise ParticleError(f"{name}: found values of type {array.dtype}, expected numbers")
    if array.size == 0 and array.ndim <= 1 and vectors is not False:
        array = array.reshape(0, 3) if vectors else array
    is_vector = array.ndim == 2 and array.shape[1] == 3
    if (vectors is not False and is_vector) or (vectors is not True and array.ndim == 1):
        whole = array.dtype.kind in "iu" and array.ndim == 1 and vectors is None
        if whole and array.size and (int(array.min()) < 0 or int(array.max()) > 0xFFFFFFFF):
            raise ParticleError(f"{name}: found {array.min()} to {array.max()}, expected integers from 0 to 4294967295")
        with numpy.errstate(over="ignore"):
            array = numpy.require(array, numpy.uint32 if whole else numpy.float32, ["C", "A"])
        return array
    shapes = {True: "(n, 3)", False: "(n,)", None: "(n,) or (n, 3)"}[vectors]
    raise ParticleError(f"{name}: found the shape {array.shape}, expected {shapes}")


def _finite(name: str, array: NDArray[Any]) -> NDArray[Any]:
    """The array, if all its numbers are finite."""
    # A sum is finite only if all numbers are, and takes no array of truth values.
    with numpy.errstate(over="ignore", invalid="ignore"):
        total = array.sum(dtype=numpy.float64)
    if not numpy.isfinite(total):
        wrong = numpy.flatnonzero(~numpy.isfinite(array).reshape(len(array), -1).all(axis=1))
        found = f"entry {wrong[0]} is {array[wrong[0]].tolist()}, expected finite numbers in single precision"
        raise ParticleError(f"{name}: {found}; {len(wrong)} such entries")
    return array


def _made(
    columns: Mapping[str, NDArray[Any]],
    spacing: float,
    quality: str | None,
    threads: int,
    max_memory: int | None,
    surface: Mapping[str, Any],
) -> _native.Outcome:
    """The outcome of the library's call, which read the columns in place."""
    if isinstance(threads, bool) or not isinstance(threads, int) or not 0 <= threads <= 1024:
        raise ParameterError(f"threads: found {threads!r}, expected an integer from 0 to 1024")
    if max_memory is not None and (isinstance(max_memory, bool) or not isinstance(max_memory, int) or not 0 < max_memory < 1 << 64):
        raise ParameterError(f"max_memory: found {max_memory!r}, expected a number of bytes or None")
    try:
        spacing = float(spacing)
    except (TypeError, ValueError):
        raise ParameterError(f"spacing: found {spacing!r}, expected a number [m]") from None
    if not (quality is None or isinstance(quality, str)):
        raise ParameterError(f"quality: found {quality!r}, expected a text or None")
    names = [name.encode("utf-8", "replace") for name in columns]
    settings = [_toml.setting(f"surface.{key}", value).encode() for key, value in surface.items()]
    tier = (quality or "").encode("utf-8", "replace")
    raw_columns = (_native.InputColumn * len(columns))()
    for raw, name, values in zip(raw_columns, names, columns.values()):
        raw.name, raw.data = _native.text(name), values.ctypes.data
        raw.kind = KINDS[values.dtype.name, values.ndim]
    raw_settings = (_native.Text * len(settings))(*map(_native.text, settings))
    flag = _native.Flag()
    request = _native.RawRequest(
        len(columns["position"]), raw_columns, len(columns), spacing, _native.text(tier), raw_settings, len(settings),
        threads, max_memory or 0, flag.address,
    )  # fmt: skip
    outcome = _called(request, flag, (columns, names, settings, tier, raw_columns, raw_settings))
    outcome.check()
    return outcome


def _called(request: _native.RawRequest, flag: _native.Flag, read: object) -> _native.Outcome:
    """The outcome of a call, which keeps the flag and what it reads. In the main thread Ctrl-C cancels the call."""
    library = _native.library()
    found: list[_native.Outcome | None] = []
    ended = _thread.allocate_lock()
    ended.acquire()

    # Its thread owns everything that it uses, for a caller that an exception ends at any place, even before this is noted.
    def call(flag: _native.Flag = flag, read: object = read) -> None:
        outcome = None
        try:
            reading = _native.Reading(request, flag, read)
            outcome = _native.Outcome(library.meniscus_reconstruct(ctypes.byref(request)))
            reading.end(outcome)
        finally:
            found.append(outcome)
            ended.release()

    if threading.current_thread() is not threading.main_thread():
        call()
    else:
        # The interpreter looks at signals between calls, so the main thread waits in Python: for a bare lock, since an
        # interrupted `Event.wait` or `Thread.join` leaves their own locks taken.
        try:
            _start(call)
            _wait(found, ended)
        except MeniscusError:
            raise
        except BaseException:
            flag.set()
            # The call reads arrays that its caller may change afterwards: it ends first, however often Ctrl-C is pressed.
            while not found:
                with contextlib.suppress(KeyboardInterrupt):
                    _wait(found, ended)
            raise
    outcome = found[0]
    if outcome is None:
        raise MeniscusError("the thread of the call ended without a result")
    return outcome


def _start(call: Callable[[], None]) -> None:
    """Runs a call in a thread of its own."""
    try:
        _thread.start_new_thread(call, ())
    except RuntimeError as error:
        raise MeniscusError(f"cannot start a thread for the call: {error}; close other programs") from None


def _wait(found: list[_native.Outcome | None], ended: _thread.LockType) -> None:
    """Waits for the result. That it was found counts: an exception may come right after the lock was acquired."""
    # On Windows a wait without end does not see Ctrl-C.
    while not found:
        ended.acquire(timeout=0.2)


def _array(outcome: _native.Outcome, column: _native.OutcomeColumn) -> NDArray[Any]:
    """A column of an outcome as an array, which keeps the outcome."""
    dtype, words = TYPES[column.kind]
    shape = (column.len, words) if words > 1 else (column.len,)
    if column.len == 0:
        empty = numpy.empty(shape, dtype)
        empty.flags.writeable = False
        return empty
    return numpy.asarray(_Memory(outcome, column.data, shape, dtype))


class _Memory:
    """Memory of an outcome for numpy, whose arrays keep this object."""

    def __init__(self, outcome: _native.Outcome, address: int, shape: tuple[int, ...], dtype: str):
        self.outcome = outcome
        self.__array_interface__ = {"version": 3, "data": (address, True), "shape": shape, "typestr": dtype}
