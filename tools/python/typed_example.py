# SPDX-License-Identifier: MIT OR Apache-2.0
"""A user's code for type checkers, never run: tools/release/check.py checks it by mypy and pyright.

Lines with `type: ignore` are mistakes that both have to find; one that they miss is an error, too.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, assert_type

import numpy as np
from numpy.typing import NDArray

import meniscus_fx as mf

positions = np.zeros((1, 3), np.float32)
mesh = mf.reconstruct(positions, spacing=0.04, quality="draft", velocity=positions, attributes={"heat": [1.0]}, voxel=0.5)
assert_type(mesh, mf.Mesh)
assert_type(mesh.triangles, NDArray[np.uint32])
assert_type(mesh.normals, NDArray[np.float32])
assert_type(mesh.volume, float)
assert_type(mesh.is_sound, bool)
mesh.write(Path("surface.ply"))
mf.reconstruct(positions, spacing="wide")  # type: ignore[arg-type]
mf.reconstruct(positions, 0.04, max_memory=1.5)  # type: ignore[arg-type]
mf.reconstruct(positions, 0.04, "draft")  # type: ignore[call-arg]
mesh.write(3)  # type: ignore[arg-type]


def report(now: mf.Progress) -> None:
    """Reports progress."""
    print(now.percent, now.text)


shot = mf.simulate("dam-break", "wave", quality="draft", frames="1-6", progress=report)
assert_type(shot, mf.Shot)
assert_type(shot.frames, list[Path])
assert_type(mf.cache.read(shot.frames[-1]), dict[str, Any])
assert_type(mf.run("--version"), str)
mf.simulate(3, "wave")  # type: ignore[arg-type]
try:
    mf.reconstruct(positions, 0.04)
except mf.OutOfMemoryError as error:
    memory: MemoryError = error
