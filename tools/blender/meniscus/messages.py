# SPDX-License-Identifier: MIT OR Apache-2.0
"""Texts of messages. What comes from a shot folder is shown on one line, escaped and shortened. No Blender in here.

Blender prints every report, so a line break in a title or a file name would start a line of its own in the log of a farm.
"""

import reprlib

MAX_SHOWN_CHARACTERS = 1000
MAX_LISTED_NAMES = 10
REMAKE = "Remove it and run `meniscus shot` again; it makes what is missing"

values = reprlib.Repr()
values.maxlevel, values.maxlist, values.maxdict = 3, 4, 4
values.maxstring = values.maxlong = values.maxother = 80


class ShotError(Exception):
    """A shot that cannot be opened: where, what was found and expected, and the next step, in one message."""


def printable(text: object, limit: int = MAX_SHOWN_CHARACTERS) -> str:
    """A text or a path on one line, without control characters, shortened to `limit` characters."""
    text = str(text)
    shown = "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text[:limit])
    return shown if len(text) <= limit else f"{shown}…"


def shortened(value: object) -> str:
    """A value of any type and size as Python writes it, shortened."""
    return printable(values.repr(value))


def listed(names: list[str]) -> str:
    """The first names of a list, and how many follow."""
    more = len(names) - MAX_LISTED_NAMES
    return ", ".join(names[:MAX_LISTED_NAMES]) + (f" and {more} more" if more > 0 else "")


def spans(numbers: list[int], step: int = 1) -> str:
    """Ascending numbers as text, runs in which each is `step` after the one before as first-last."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number - runs[-1][1] == step:
            runs[-1][1] = number
        else:
            runs.append([number, number])
    return listed([f"{first}-{last}" if last > first else str(first) for first, last in runs])
