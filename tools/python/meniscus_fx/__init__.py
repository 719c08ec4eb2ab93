# SPDX-License-Identifier: MIT OR Apache-2.0
"""Meniscus from Python: surfaces of particles in numpy arrays, cached frames, simulations.

    import meniscus_fx as mf

    mesh = mf.reconstruct(positions, spacing=0.02)          # float32 (n, 3) is read in place, without a copy
    mesh.vertices, mesh.triangles, mesh.normals             # numpy arrays, without a copy
    mesh.write("surface.ply")

    shot = mf.simulate("dam-break", "wave", quality="draft", progress=print)
    frame = mf.cache.read(shot.frames[-1])

Lengths are metres, axes are right-handed with Z up, faces are counter-clockwise seen from outside. Everything runs on this
computer; nothing is downloaded. `docs/python.md` is the guide.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

from ._errors import Interrupted, MeniscusError, OutOfMemoryError, ParameterError, ParticleError, ProgramError, SurfaceWarning
from ._program import Progress, Shot, program, run, shot, simulate
from ._version import VERSION as __version__

if TYPE_CHECKING:
    from . import cache as cache
    from ._mesh import Mesh as Mesh
    from ._mesh import reconstruct as reconstruct

__all__ = [
    "Interrupted",
    "MeniscusError",
    "Mesh",
    "OutOfMemoryError",
    "ParameterError",
    "ParticleError",
    "ProgramError",
    "Progress",
    "Shot",
    "SurfaceWarning",
    "__version__",
    "cache",
    "program",
    "reconstruct",
    "run",
    "shot",
    "simulate",
]

# These need numpy, which the command `meniscus` does not wait for.
_OF_NUMPY = {"Mesh": "._mesh", "reconstruct": "._mesh"}


def __getattr__(name: str) -> object:
    if name == "cache":
        return importlib.import_module(".cache", __name__)
    if name in _OF_NUMPY:
        return getattr(importlib.import_module(_OF_NUMPY[name], __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
