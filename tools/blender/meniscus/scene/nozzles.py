# SPDX-License-Identifier: MIT OR Apache-2.0
"""Nozzles that are too narrow for the liquid's spacing: a tap in a scene whose spacing fits a pool. No Blender in here."""

from collections.abc import Sequence

from ..messages import printable

# Widths of an opening in spacings: below the first a jet breaks up into rows of particles, the second is that of the tap in the menu.
MIN_WIDTH, FITTING_WIDTH = 4.0, 8.0


def narrow(name: str, is_disc: bool, lengths: Sequence[float], spacing: float) -> str | None:
    """A note on a nozzle whose box has these lengths [m], with the spacing that fits; None if it is wide enough."""
    width = min(lengths[:2] if is_disc else lengths)
    if width <= 0.0 or width >= MIN_WIDTH * spacing:
        return None
    finding = f"its opening of {width:.3g} m is {width / spacing:.2g} times as wide as the spacing of the liquid, {spacing:.3g} m"
    enlarged = f"enlarge the opening to {FITTING_WIDTH * spacing:.3g} m, and its rate with its area"
    advice = f"A Spacing of {width / FITTING_WIDTH:.3g} m fits it; Plan shows what that takes. Or {enlarged}"
    return f"{printable(name)}: {finding}: little or no liquid comes out. {advice}"
