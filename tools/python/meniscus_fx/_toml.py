# SPDX-License-Identifier: MIT OR Apache-2.0
"""Settings as TOML, for the library and the program alike."""

from __future__ import annotations

import json
from typing import Any, Mapping

from ._errors import ParameterError


def setting(key: str, value: Any) -> str:
    """`key=value` as `--set` reads it; None removes an optional term."""
    try:
        text = f"{key}={_value(value)}"
        text.encode("utf-8")
        return text
    except ParameterError as error:
        raise ParameterError(f"{key}: {error}") from None
    except (UnicodeEncodeError, RecursionError) as error:
        raise ParameterError(f"{key}: the value cannot be written as TOML: {error}") from None


def _value(value: Any) -> str:
    """A value as TOML; entries of tables that are None are left out."""
    # Numbers and arrays of numpy, which is not imported for it.
    if hasattr(value, "tolist"):
        value = value.tolist()
    if value is None:
        return "none"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (int, float)):
        return repr(value)
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, Mapping):
        entries = (f"{json.dumps(str(key))} = {_value(entry)}" for key, entry in value.items() if entry is not None)
        return "{ " + ", ".join(entries) + " }"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_value(entry) for entry in value) + "]"
    raise ParameterError(f"found a {type(value).__name__}, expected a number, text, bool, list, mapping or None")
