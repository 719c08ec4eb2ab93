# SPDX-License-Identifier: MIT OR Apache-2.0
"""Joints between two sheets of cloth: points of two vertex groups in pairs, one to one, nearest pair first."""

from dataclasses import dataclass

import numpy as np

from ..messages import ShotError, printable
from .sample import Sampled, members

# Points that an exact joint holds together are at most this far apart [m]: rounding of places in single precision.
COINCIDENT = 1e-5
# Distances between two groups that are compared: 128 MB of them.
MAX_DISTANCES = 1 << 24
# Two vertex groups as sheet and points, whichever of the two sheets has the joint.
Groups = frozenset[tuple[str, frozenset[int]]]


@dataclass
class Pairs:
    """Points that are joined, by their numbers in each sheet, in order."""

    own: list[int]
    theirs: list[int]
    # Distance between the points of a pair [m].
    largest: float
    groups: Groups

    @property
    def free(self) -> int:
        """Number of points of the larger group that are in no pair."""
        return sum(len(points) for _, points in self.groups) - 2 * len(self.own)


def placed(each: Sampled) -> np.ndarray:
    """The points of a sheet in the world [m]."""
    matrix = each.matrices[0]
    return each.vertices[0].astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3]


def pairs(each: Sampled, other: Sampled) -> Pairs:
    """Pairs each point with the nearest one that is in no pair yet, nearest pair first. Raises ShotError."""
    role = each.role
    own = members(each, role.joint_points, "its joint")
    theirs = members(other, role.joint_other_points, f"the joint of {printable(each.source.name)}")
    if each is other and set(own) & set(theirs):
        raise ShotError(f"{printable(each.source.name)}: a point is in both vertex groups of its joint. Use groups without a common point")
    if len(own) * len(theirs) > MAX_DISTANCES:
        text = f"its joint pairs a group of {len(own)} points with one of {len(theirs)}, more than can be compared. Choose the points of a seam alone"
        raise ShotError(f"{printable(each.source.name)}: {text}")
    distances = np.linalg.norm(placed(each)[own][:, None] - placed(other)[theirs][None], axis=2)
    found: list[tuple[int, int]] = []
    rows, columns, largest = set(range(len(own))), set(range(len(theirs))), 0.0
    # The nearest pair first, so that a group with more points leaves its farthest out.
    for flat in np.argsort(distances, axis=None, kind="stable"):
        row, column = divmod(int(flat), len(theirs))
        if row in rows and column in columns:
            found.append((row, column))
            rows.remove(row)
            columns.remove(column)
            largest = max(largest, float(distances[row, column]))
            if not rows or not columns:
                break
    found.sort()
    groups = frozenset({(each.asset, frozenset(own)), (other.asset, frozenset(theirs))})
    return Pairs([own[row] for row, _ in found], [theirs[column] for _, column in found], largest, groups)


def held(sheets: list[Sampled]) -> list[Sampled]:
    """Sheets that pins hold until the end, and those that joints without a release connect to them."""
    found = {each.source for each in sheets if each.pins and not each.role.pin.use_release}
    links = [{each.source, each.role.joint_to} for each in sheets if each.role.joint_to is not None and not each.role.joint.use_release]
    for _ in sheets:
        for link in links:
            if link & found:
                found |= link
    return [each for each in sheets if each.source in found]


def check_exact(each: Sampled, values: dict[str, object], largest: float) -> None:
    """Raises ShotError if an exact joint would have to pull points together."""
    if "stiffness" not in values and "direction" not in values and largest > COINCIDENT:
        text = f"points of its joint are {largest:.3g} m apart, and without a stiffness they must coincide"
        raise ShotError(f"{printable(each.source.name)}: {text}. Switch Stiffness of the joint on, or move them together")
