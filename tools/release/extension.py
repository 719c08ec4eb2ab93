# SPDX-License-Identifier: MIT OR Apache-2.0
"""The Blender extension with the wheels inside, and the index of a repository that a web server or a folder can offer."""

import hashlib
import importlib.util
import json
import re
import tomllib
import zipfile
from pathlib import Path

import licences
import wheel
from platforms import PLATFORMS, Platform

BUILD = licences.ROOT / "tools" / "blender" / "build.py"
# Fields of a manifest that the index repeats, as Blender's `server-generate` does.
LISTED = (
    "schema_version", "id", "name", "tagline", "version", "type", "maintainer", "license", "blender_version_min",
    "blender_version_max", "website", "copyright", "permissions", "tags", "platforms",
)  # fmt: skip


def build(wheels: list[Path], folder: Path) -> Path:
    """Writes the zip with the wheels and the index next to it, and returns the zip's path."""
    spec = importlib.util.spec_from_file_location("blender_build", BUILD)
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    plain = module.build(folder / "plain")
    with zipfile.ZipFile(plain) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    manifest = with_wheels(files["blender_manifest.toml"].decode("utf-8"), wheels)
    files["blender_manifest.toml"] = manifest.encode()
    files |= {f"wheels/{path.name}": path.read_bytes() for path in wheels}
    path = folder / plain.name
    wheel.write(path, [wheel.Entry(name, data) for name, data in sorted(files.items())], compression=9)
    plain.unlink()
    plain.parent.rmdir()
    (folder / "index.json").write_text(index(manifest, path), encoding="utf-8")
    print(f"{path}  {path.stat().st_size / 1e6:.2f} MB, {', '.join(tomllib.loads(manifest)['platforms'])}")
    return path


def platform_of(path: Path) -> Platform:
    return next(platform for platform in PLATFORMS.values() if path.name.endswith(f"-{platform.tag}.whl"))


def with_wheels(manifest: str, wheels: list[Path]) -> str:
    """The manifest with the wheels, the platforms that they are for, and the licences of what is in them."""
    platforms = sorted(platform_of(path).name for path in wheels)
    shipped = [package for path in wheels for package in licences.packages(platform_of(path).target)]
    inside = sorted({licence for package in shipped for licence in licences.chosen(package)} - {"MIT"})
    terms = json.dumps(["SPDX:MIT", *(f"SPDX:{licence}" for licence in inside)])
    manifest, count = re.subn(r"(?m)^license = .*$", f"license = {terms}", manifest)
    assert count == 1, "the manifest has one line `license = …`"
    lines = [f"platforms = {json.dumps(platforms)}", "wheels = [", *(f'    "./wheels/{path.name}",' for path in sorted(wheels)), "]"]
    # Keys of the manifest itself are before its first table.
    start = manifest.index("\n[")
    return manifest[:start] + "\n" + "\n".join(lines) + "\n" + manifest[start:]


def index(manifest: str, path: Path) -> str:
    """The index of a repository with the zip alone."""
    fields = tomllib.loads(manifest)
    entry = {name: fields[name] for name in LISTED if name in fields}
    # By the wheels' tag `py3`.
    entry |= {"python_versions": ["3"]}
    entry |= {"archive_url": f"./{path.name}", "archive_size": path.stat().st_size}
    entry["archive_hash"] = "sha256:" + hashlib.sha256(path.read_bytes()).hexdigest()
    return json.dumps({"version": "v1", "blocklist": [], "data": [entry]}, indent=2) + "\n"
