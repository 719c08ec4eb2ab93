# SPDX-License-Identifier: MIT OR Apache-2.0
"""Air in motion when a shot starts: turbulence, smoke rings and vortex tubes, from objects that show their place, axis and size."""

import numpy as np

from ..messages import ShotError, printable
from .sample import Sampled
from .shapes import Placed


def ring(placed: Placed) -> dict[str, object]:
    """Centre, direction and radius of a ring, from the disc of its object."""
    disc = placed.shape["disc"]
    return {"center": disc["center"], "direction": disc["normal"], "radius": disc["radius"]}


def tube(each: Sampled, bounds: tuple[np.ndarray, np.ndarray]) -> dict[str, object]:
    """The ends of a tube: the middles of the lower and the upper side of its object's bounding box. Raises ShotError."""
    low, high = bounds
    middle, matrix = (low + high) / 2.0, each.matrices[0]
    ends = [matrix[:3, :3] @ (*middle[:2], height) + matrix[:3, 3] for height in (low[2], high[2])]
    if not np.linalg.norm(ends[1] - ends[0]) > 0.0:
        raise ShotError(f"{printable(each.source.name)}: has no length along its Z axis, which is that of the tube. Scale it")
    return {"from": ends[0].tolist(), "to": ends[1].tolist()}
