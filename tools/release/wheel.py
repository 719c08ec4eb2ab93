# SPDX-License-Identifier: MIT OR Apache-2.0
"""Packs wheels: the same bytes from the same files on every machine whose Python has the same zlib.

At compression 9, programs and libraries are compressed by zopfli: 3.4 % smaller than by zlib, in 1.3 s a megabyte. The wheel for Windows
would have 8.27 MB otherwise.
"""

import ast
import base64
import hashlib
import re
import sys
import tomllib
import zipfile
from dataclasses import dataclass
from pathlib import Path

import licences
from platforms import Platform

ROOT = licences.ROOT
PACKAGE = ROOT / "tools" / "python" / "meniscus_fx"
EPOCH = (1980, 1, 1, 0, 0, 0)
MAX_BYTES = 8_000_000
SUMMARY = "Offline liquids, smoke and cloth for shots: the program meniscus, and surfaces of particles in numpy arrays"


@dataclass(frozen=True)
class Entry:
    """A file of an archive."""

    path: str
    data: bytes
    is_program: bool = False


def version() -> str:
    """The version of Cargo.toml, which the package and the extension have too."""
    found = tomllib.loads((ROOT / "Cargo.toml").read_text(encoding="utf-8"))["package"]["version"]
    python = re.search(r'^VERSION = "(.*)"$', (PACKAGE / "_version.py").read_text(encoding="utf-8"), re.MULTILINE)
    native = tomllib.loads((ROOT / "tools/python/native/Cargo.toml").read_text(encoding="utf-8"))["package"]["version"]
    others = {"meniscus_fx/_version.py": python and python.group(1), "native/Cargo.toml": native}
    for file, other in others.items():
        if other != found:
            sys.exit(f"tools/python/{file}: found the version {other}, expected {found}, that of Cargo.toml")
    return str(found)


def called_functions() -> set[str]:
    """The functions of the library that the package calls: the keys of FUNCTIONS in its `_native.py`."""
    tree = ast.parse((PACKAGE / "_native.py").read_text(encoding="utf-8"))
    for node in tree.body:
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Dict) and ast.unparse(node.targets[0]) == "FUNCTIONS":
            return {key.value for key in node.value.keys if isinstance(key, ast.Constant)}
    sys.exit(f"{PACKAGE / '_native.py'}: found no dictionary FUNCTIONS")


def metadata(shipped: list[licences.Package]) -> str:
    lines = [
        "Metadata-Version: 2.4",
        "Name: meniscus-fx",
        f"Version: {version()}",
        f"Summary: {SUMMARY}",
        f"License-Expression: {licences.expression(shipped)}",
        "License-File: LICENSE-APACHE",
        "License-File: LICENSE-MIT",
        "License-File: THIRD-PARTY.txt",
        "Keywords: simulation,fluid,sph,meshing,vfx",
        "Classifier: Topic :: Multimedia :: Graphics :: 3D Rendering",
        "Classifier: Topic :: Scientific/Engineering :: Physics",
        "Classifier: Typing :: Typed",
        "Requires-Python: >=3.9",
        "Requires-Dist: numpy>=1.20",
        "Requires-Dist: xxhash",
        "Requires-Dist: zstandard",
        "Description-Content-Type: text/markdown",
    ]
    guide = (ROOT / "tools" / "python" / "README.md").read_text(encoding="utf-8")
    return "\n".join(lines) + "\n\n" + guide


def pack(platform: Platform, built: Path, folder: Path, compression: int) -> Path:
    """Writes the wheel of the program and library in `built`, and returns its path."""
    name = f"meniscus_fx-{version()}"
    info = f"{name}.dist-info"
    shipped = licences.packages(platform.target)
    sources = sorted(path for path in PACKAGE.iterdir() if path.suffix == ".py" or path.name == "py.typed")
    wheel = f"Wheel-Version: 1.0\nGenerator: meniscus-release\nRoot-Is-Purelib: false\nTag: py3-none-{platform.tag}\n"
    texts = {
        f"{info}/METADATA": metadata(shipped),
        f"{info}/WHEEL": wheel,
        f"{info}/entry_points.txt": "[console_scripts]\nmeniscus = meniscus_fx._program:main\n",
        f"{info}/licenses/LICENSE-APACHE": (ROOT / "LICENSE-APACHE").read_text(encoding="utf-8"),
        f"{info}/licenses/LICENSE-MIT": (ROOT / "LICENSE-MIT").read_text(encoding="utf-8"),
        f"{info}/licenses/THIRD-PARTY.txt": licences.third_party(shipped),
        f"{info}/sboms/meniscus-fx.cdx.json": licences.sbom(shipped, version()),
    }
    entries = [Entry(f"meniscus_fx/{path.name}", path.read_bytes().replace(b"\r\n", b"\n")) for path in sources]
    entries += [
        Entry(f"meniscus_fx/bin/{platform.program}", (built / platform.program).read_bytes(), is_program=True),
        Entry(f"meniscus_fx/lib/{platform.library}", (built / platform.library).read_bytes(), is_program=True),
        *(Entry(path, text.encode()) for path, text in texts.items()),
    ]
    entries.sort(key=lambda entry: (entry.path.startswith(info), entry.path))
    entries.append(Entry(f"{info}/RECORD", record(entries, f"{info}/RECORD").encode()))
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}-py3-none-{platform.tag}.whl"
    write(path, entries, compression)
    return path


def record(entries: list[Entry], own: str) -> str:
    """The list of files with their checksums and sizes."""
    lines = []
    for entry in entries:
        digest = base64.urlsafe_b64encode(hashlib.sha256(entry.data).digest()).rstrip(b"=").decode()
        lines.append(f"{entry.path},sha256={digest},{len(entry.data)}")
    return "\n".join([*lines, f"{own},,"]) + "\n"


class Zopfli:
    """A compressor of zipfile: the format of zlib's, by a longer search."""

    def __init__(self) -> None:
        self.data = b""

    def compress(self, data: bytes) -> bytes:
        self.data += data
        return b""

    def flush(self) -> bytes:
        import zopfli.zlib

        # More iterations gain less than a thousandth. A zip has the stream without zlib's header and checksum.
        found: bytes = zopfli.zlib.compress(self.data, numiterations=5)[2:-4]
        return found


def write(path: Path, entries: list[Entry], compression: int) -> None:
    """Writes a zip whose times, permissions and system do not depend on the machine."""
    unfinished = path.with_suffix(".part")
    with zipfile.ZipFile(unfinished, "w", zipfile.ZIP_DEFLATED, compresslevel=compression) as archive:
        for entry in entries:
            info = zipfile.ZipInfo(entry.path, EPOCH)
            info.create_system, info.compress_type = 3, zipfile.ZIP_DEFLATED
            info.external_attr = (0o100755 if entry.is_program else 0o100644) << 16
            if compression < 9 or not entry.is_program:
                archive.writestr(info, entry.data, compresslevel=compression)
                continue
            with archive.open(info, "w") as file:
                file._compressor = Zopfli()
                file.write(entry.data)
    unfinished.replace(path)
