# SPDX-License-Identifier: MIT OR Apache-2.0
"""Builds the Blender extension: meniscus-VERSION.zip, the same bytes from the same sources on every machine.

    python tools/blender/build.py [-o DIR] [--engine PLATFORM=PROGRAM]

`--engine linux-x64=target/release/meniscus` packs the engine for one of Blender's platforms; repeated, for several. Needs Python
3.11 or later and nothing else. Prints the path of the zip.
"""

import argparse
import tomllib
import zipfile
from pathlib import Path

SOURCE = Path(__file__).resolve().parent / "meniscus"
SCHEMA = SOURCE.parents[2] / "docs" / "preset.schema.json"
SUFFIXES = (".py", ".toml")
EPOCH = (1980, 1, 1, 0, 0, 0)
PLATFORMS = ("linux-x64", "linux-arm64", "macos-x64", "macos-arm64", "windows-x64", "windows-arm64")


def build(folder: Path, engines: dict[str, Path] | None = None) -> Path:
    """Writes the zip, with a program for each platform in `engines`, into a folder and returns its path."""
    manifest = tomllib.loads((SOURCE / "blender_manifest.toml").read_text(encoding="utf-8"))
    folder.mkdir(parents=True, exist_ok=True)
    engines = dict(sorted((engines or {}).items()))
    path = folder / ("-".join([manifest["id"], manifest["version"], *engines]) + ".zip")
    sources = {str(file.relative_to(SOURCE).as_posix()): file for file in SOURCE.rglob("*") if file.suffix in SUFFIXES}
    # The panels' properties and tooltips are made of it.
    sources["scene/preset.schema.json"] = SCHEMA
    with zipfile.ZipFile(path, "w") as archive:
        for name, source in sorted(sources.items()):
            add(archive, name, source.read_bytes().replace(b"\r\n", b"\n"), 0o644)
        for platform, program in engines.items():
            file = "meniscus.exe" if platform.startswith("windows") else "meniscus"
            add(archive, f"engine/{platform}/{file}", program.read_bytes(), 0o755)
    return path


def add(archive: zipfile.ZipFile, name: str, content: bytes, mode: int) -> None:
    """Stores a file with fixed time, permissions and system, uncompressed: nothing depends on the machine."""
    entry = zipfile.ZipInfo(name, EPOCH)
    entry.create_system, entry.external_attr = 3, mode << 16
    archive.writestr(entry, content)


def engine(text: str) -> tuple[str, Path]:
    platform, _, program = text.partition("=")
    if platform not in PLATFORMS or not Path(program).is_file():
        raise argparse.ArgumentTypeError(f"found {text}, expected PLATFORM=PROGRAM with a file and one of {', '.join(PLATFORMS)}")
    return platform, Path(program)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("."), help="folder for the zip")
    parser.add_argument("--engine", type=engine, action="append", default=[], metavar="PLATFORM=PROGRAM", help="a program to pack")
    given = parser.parse_args()
    print(build(given.output, dict(given.engine)))
