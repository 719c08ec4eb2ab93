# SPDX-License-Identifier: MIT OR Apache-2.0
"""Writes presets as TOML: tables in a given order, numbers as short as single precision allows, texts escaped. No Blender in here."""

import math
import re

import numpy as np

BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")
MAX_INLINE_CHARACTERS = 110


def number(value: float) -> str:
    """The shortest decimal that single precision reads as the same number. Raises ValueError for NaN and infinity."""
    single = np.float32(value)
    if not math.isfinite(single):
        raise ValueError(f"{value} has no finite value in single precision")
    if single == 0.0:
        return "0"
    if 1e-5 <= abs(single) < 1e7:
        text = np.format_float_positional(single, unique=True, trim="-")
    else:
        text = np.format_float_scientific(single, unique=True, trim="-", exp_digits=1)
    return text


def string(text: str) -> str:
    """A basic string: quotes, backslashes and all characters that are not printable are escaped."""
    out = []
    for character in text:
        code = ord(character)
        if character in '"\\':
            out.append("\\" + character)
        elif 0xD800 <= code <= 0xDFFF:
            # Half of a surrogate pair is no character of TOML.
            out.append("\ufffd")
        elif character.isprintable():
            out.append(character)
        else:
            out.append(f"\\u{code:04X}" if code <= 0xFFFF else f"\\U{code:08X}")
    return '"' + "".join(out) + '"'


def key(name: str) -> str:
    return name if BARE_KEY.fullmatch(name) else string(name)


def inline(value: object) -> str:
    """A value on one line: a boolean, number, text, list, or table."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        return number(value)
    if isinstance(value, str):
        return string(value)
    if isinstance(value, dict):
        inner = ", ".join(f"{key(name)} = {inline(each)}" for name, each in value.items())
        return f"{{ {inner} }}" if inner else "{}"
    return "[" + ", ".join(inline(each) for each in value) + "]"


def comment(text: str) -> str:
    """A text as one comment line; line breaks and control characters become spaces."""
    shown = "".join(c if c.isprintable() else " " for c in text)
    return f"# {' '.join(shown.encode('utf-8', 'replace').decode('utf-8').split())}".rstrip()


class Document:
    """Lines of a TOML file."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def comment(self, text: str) -> None:
        self.lines.append(comment(text))

    def blank(self) -> None:
        if self.lines and self.lines[-1]:
            self.lines.append("")

    def pairs(self, values: dict[str, object]) -> None:
        """Key and value, one a line; long lists of tables have a line for each table."""
        for name, value in values.items():
            text = inline(value)
            is_list = isinstance(value, (list, tuple)) and len(value) > 1
            if is_list and len(text) > MAX_INLINE_CHARACTERS:
                text = "[\n" + "".join(f"    {inline(each)},\n" for each in value) + "]"
            self.lines.append(f"{key(name)} = {text}")

    def table(self, path: str, values: dict[str, object], note: str = "", repeated: bool = False) -> None:
        """A table, or an entry of a list of tables, below a comment. Values that are tables get their own heading."""
        self.blank()
        if note:
            self.comment(note)
        self.lines.append(f"[[{path}]]" if repeated else f"[{path}]")
        tables = {name: value for name, value in values.items() if isinstance(value, Table)}
        self.pairs({name: value for name, value in values.items() if name not in tables})
        for name, value in tables.items():
            self.table(f"{path}.{key(name)}", value)

    def text(self) -> str:
        return "\n".join(self.lines) + "\n"


class Table(dict):
    """A table that is written under a heading of its own, where a `dict` is written in one line."""
