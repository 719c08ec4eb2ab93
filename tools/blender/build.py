# SPDX-License-Identifier: MIT OR Apache-2.0
"""Builds the Blender extension: meniscus-VERSION.zip, the same bytes from the same sources on every machine.

    python tools/blender/build.py [-o DIR]

Needs Python 3.11 or later and nothing else. Prints the path of the zip.
"""

import argparse
import tomllib
import zipfile
from pathlib import Path

SOURCE = Path(__file__).resolve().parent / "meniscus"
SUFFIXES = (".py", ".toml")
EPOCH = (1980, 1, 1, 0, 0, 0)


def build(folder: Path) -> Path:
    """Writes the zip into a folder and returns its path."""
    manifest = tomllib.loads((SOURCE / "blender_manifest.toml").read_text(encoding="utf-8"))
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{manifest['id']}-{manifest['version']}.zip"
    with zipfile.ZipFile(path, "w") as archive:
        for source in sorted(file for file in SOURCE.iterdir() if file.suffix in SUFFIXES):
            # Time, permissions and system are fixed, the data is stored: nothing depends on the machine.
            entry = zipfile.ZipInfo(source.name, EPOCH)
            entry.create_system, entry.external_attr = 3, 0o644 << 16
            archive.writestr(entry, source.read_bytes().replace(b"\r\n", b"\n"))
    return path


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("."), help="folder for the zip")
    print(build(parser.parse_args().output))
