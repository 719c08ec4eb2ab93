# SPDX-License-Identifier: MIT OR Apache-2.0
"""Names of tiers, and of files and sheets from names that a user typed. No Blender in here."""

import re
import unicodedata

# Tiers of a preset, from coarse to fine; the last is the preset without changes.
QUALITIES = ("draft", "preview", "final")
# Blender's names have 63 bytes, and so have those of files in a shot folder; a number that makes one unique has to fit in.
MAX_CHARACTERS = 48
# Windows opens devices under these names, whatever follows a dot.
DEVICES = {"con", "prn", "aux", "nul", *(f"{port}{number}" for port in ("com", "lpt") for number in range(10))}
# Streams of a shot, which a sheet of the same name would hide.
RESERVED = DEVICES | {"liquid", "smoke", "bodies", "whitewater"}


def plain(text: str) -> str:
    """A text as ASCII letters, digits, - and _, of 1 to MAX_CHARACTERS characters, that is no device and no frame's number."""
    ascii_text = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode("ascii")
    name = re.sub(r"[^A-Za-z0-9-]+", "_", ascii_text).strip("_-")[:MAX_CHARACTERS].rstrip("_-")
    # Names of files may end in a frame's number, _0001: `Cloth.0001` must not.
    name = re.sub(r"_(?=[0-9]{4,}$)", "-", name)
    return f"object_{name}" if not name or name.lower() in RESERVED or name[0].isdigit() else name


class Names:
    """Gives each text a plain name that no other has, whatever the case."""

    def __init__(self) -> None:
        self.used: set[str] = set()

    def unique(self, text: str) -> str:
        """The plain name of a text, with -2, -3, … from the second of a name on."""
        stem = plain(text)
        name, number = stem, 1
        while name.lower() in self.used:
            number += 1
            name = f"{stem}-{number}"
        self.used.add(name.lower())
        return name
