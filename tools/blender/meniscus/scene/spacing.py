# SPDX-License-Identifier: MIT OR Apache-2.0
"""Objects that do not fit the liquid's spacing: a tap in a scene whose spacing is that of a pool, and a pool in one of a tap. No Blender in here."""

from collections.abc import Sequence
from math import pi, prod

from ..messages import printable

# Widths of an opening in spacings: below the first a jet breaks up into rows of particles, the second is that of the tap in the menu.
MIN_WIDTH, FITTING_WIDTH = 4.0, 8.0
# Particles of one object: above the first they need gigabytes, the second are a detailed pool.
MAX_PARTICLES, FITTING_PARTICLES = 2e7, 1e6


def note(name: str, role: str, shape: str, lengths: Sequence[float], spacing: float) -> str | None:
    """A note on an object whose box has these lengths [m], with the spacing that fits; None if it fits."""
    if role == "INFLOW":
        # The flow is taken to be along the shortest side of a plate, and along a rod.
        return narrow(name, min(lengths[:2]) if shape == "DISC" else sorted(lengths)[1], spacing)
    if role == "FLUID" and shape != "DISC":
        return many(name, prod(lengths) * (pi / 6.0 if shape == "SPHERE" else 1.0), spacing)
    return None


def narrow(name: str, width: float, spacing: float) -> str | None:
    if width <= 0.0 or width >= MIN_WIDTH * spacing:
        return None
    finding = f"its opening of {width:.3g} m is {width / spacing:.2g} times as wide as the spacing of the liquid, {spacing:.3g} m"
    enlarged = f"enlarge the opening to {FITTING_WIDTH * spacing:.3g} m, and its rate with its area"
    advice = f"A Spacing of {width / FITTING_WIDTH:.3g} m fits it; Plan shows what that takes. Or {enlarged}"
    return f"{printable(name)}: {finding}: little or no liquid comes out. {advice}"


def many(name: str, volume: float, spacing: float) -> str | None:
    count = volume / spacing**3
    if count <= MAX_PARTICLES:
        return None
    finding = f"it has up to {count / 1e6:.0f} million particles at the spacing of the liquid, {spacing:.3g} m; Plan shows what that takes"
    scale = (FITTING_PARTICLES / count) ** (1.0 / 3.0)
    return f"{printable(name)}: {finding}. A Spacing of {spacing / scale:.2g} m gives a million, or scale the object by {scale:.2g}"
