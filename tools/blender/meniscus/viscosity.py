# SPDX-License-Identifier: MIT OR Apache-2.0
"""The preset in a shot folder, and the viscosity of its liquid, by which it is shown as water or as honey. No Blender in here."""

import math
import re
import tomllib
from pathlib import Path

from .folder import read_limited
from .messages import ShotError

FILE = "preset.toml"
# A preset with 500 colliders and a keyframe in every frame has some megabytes.
MAX_BYTES = 16 << 20
# From this dynamic viscosity on a liquid is shown as honey [Pa·s]. Oil has 0.1, syrup 2 and honey 10.
THICK = 1.0
NUMBER = re.compile(r"\s*([0-9.]+(?:[eE][-+]?[0-9]+)?)\s*([mkM]?)Pa·?s\s*")
PREFIXES = {"": 1.0, "m": 1e-3, "k": 1e3, "M": 1e6}


def read_preset(folder: Path) -> dict[str, object]:
    """The preset in a shot folder; empty where there is none that can be read."""
    try:
        return tomllib.loads(read_limited(folder / FILE, MAX_BYTES).decode("utf-8"))
    except (ShotError, ValueError, RecursionError):
        return {}


def read_viscosity(folder: Path) -> float:
    """The largest dynamic viscosity [Pa·s] that the preset in a shot folder names; 0 where there is no preset or viscosity."""
    liquid = read_preset(folder).get("liquid")
    if not isinstance(liquid, dict) or not isinstance(liquid.get("viscosity"), dict):
        return 0.0
    lists = [entries for entries in (liquid.get("source"), liquid.get("emitter")) if isinstance(entries, list)]
    entries = [entry for entries in lists for entry in entries if isinstance(entry, dict)]
    values = [liquid["viscosity"].get("dynamic"), *(entry.get("viscosity") for entry in entries)]
    return max(map(in_pascal_seconds, values))


def in_pascal_seconds(value: object) -> float:
    """A viscosity of a preset [Pa·s]; 0 of what is none."""
    if isinstance(value, str):
        match = NUMBER.fullmatch(value)
        value = float(match[1]) * PREFIXES[match[2]] if match else 0.0
    return float(value) if type(value) in (int, float) and math.isfinite(value) else 0.0
