# SPDX-License-Identifier: MIT OR Apache-2.0
"""Keys of presets from preset.schema.json, which the build packs next to this file. No Blender in here.

The schema is generated from the engine's own structs: names, types, units, ranges, defaults and the text of each key.
"""

import json
import re
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

HERE = Path(__file__).resolve().parent
FILE = "preset.schema.json"


@dataclass(frozen=True)
class Key:
    """One key of a table of a preset."""

    name: str
    # number, integer, vector, word, words, text, table, or other: what this extension writes itself.
    kind: str
    text: str
    default: object
    is_required: bool
    # Without it the key is left out, and the engine does what `text` names.
    is_optional: bool
    unit: str
    low: float | None
    high: float | None
    size: int = 0
    # Of words: the word and what it means.
    words: tuple[tuple[str, str], ...] = ()
    # Of tables: the definition.
    definition: str = ""


@dataclass(frozen=True)
class Choice:
    """One of several tables, such as a kind of force: `{ uniform = { … } }`."""

    name: str
    text: str
    keys: tuple[Key, ...] = field(default=())


@lru_cache(maxsize=1)
def schema() -> dict:
    """The whole schema: packed by the build, or of the checkout that this file is in."""
    for path in (HERE / FILE, HERE.parents[3] / "docs" / FILE):
        if path.is_file():
            return json.loads(path.read_text(encoding="utf-8"))
    raise FileNotFoundError(f"{HERE / FILE}: no such file. Build the extension with tools/blender/build.py")


@lru_cache(maxsize=None)
def keys(definition: str) -> tuple[Key, ...]:
    """The keys of a definition, in the schema's order."""
    found = schema()["$defs"][definition]
    required = found.get("required", [])
    return tuple(read_key(name, value, name in required) for name, value in found["properties"].items())


def key(definition: str, name: str) -> Key:
    """One key of a definition."""
    return next(each for each in keys(definition) if each.name == name)


@lru_cache(maxsize=None)
def choices(definition: str) -> tuple[Choice, ...]:
    """The tables of which a definition is one."""
    found = []
    for option in schema()["$defs"][definition]["oneOf"]:
        (name, table), *_ = option["properties"].items()
        required = table.get("required", [])
        inner = tuple(read_key(key, value, key in required) for key, value in table["properties"].items())
        found.append(Choice(name, plain(option.get("description", "")), inner))
    return tuple(found)


def read_key(name: str, value: dict, is_required: bool) -> Key:
    types = value.get("type", [])
    types = [types] if isinstance(types, str) else types
    reference, is_nullable = "", False
    for option in (value, *value.get("anyOf", [])):
        reference = reference or option.get("$ref", "").rpartition("/")[2]
        is_nullable = is_nullable or option.get("const") == "none"
    referred = schema()["$defs"].get(reference, {})
    words, kind, size = (), "other", 0
    if reference and "oneOf" in referred and all("const" in option for option in referred["oneOf"]):
        kind, words = "word", read_words(referred)
    elif reference and referred.get("type") == "object":
        kind = "table"
    elif "array" in types:
        kind, size, words = read_array(value)
    elif "number" in types or "integer" in types:
        kind = "number" if "number" in types else "integer"
    elif "string" in types:
        kind = "text"
    default = value.get("default")
    limits = value.get("items", value)
    return Key(
        name,
        kind,
        plain(value.get("description", "")),
        default,
        is_required,
        not is_required and default is None and (kind != "table" or is_nullable),
        value.get("unit", ""),
        limits.get("minimum", limits.get("exclusiveMinimum")),
        limits.get("maximum"),
        size,
        words,
        reference,
    )


def read_words(definition: dict) -> tuple[tuple[str, str], ...]:
    return tuple((option["const"], plain(option.get("description", ""))) for option in definition["oneOf"])


def read_array(value: dict) -> tuple[str, int, tuple]:
    """Kind, size and words of a list."""
    items = value.get("items", {})
    size = value.get("minItems", 0)
    types = items.get("type", [])
    if size == value.get("maxItems") and 2 <= size <= 4 and ("number" in types or types == "number"):
        return "vector", size, ()
    referred = schema()["$defs"].get(items.get("$ref", "").rpartition("/")[2], {})
    if "oneOf" in referred and all("const" in option for option in referred["oneOf"]):
        return "words", 0, read_words(referred)
    return "other", 0, ()


def plain(text: str) -> str:
    """The first paragraph of a description as a tooltip: without marks of code, units and the full stop at the end."""
    first = text.split("\n\n")[0].replace("`", "").replace("\n", " ")
    first = re.sub(r" \[[^\]]{1,12}\](?=[.:;,])", "", first)
    return first.strip().removesuffix(".")
