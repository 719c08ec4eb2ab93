# SPDX-License-Identifier: MIT OR Apache-2.0
"""Finds the engine: the path in the preferences, the Python package meniscus_fx, a program in this extension, the PATH."""

import os
import platform
import stat
import sys
from pathlib import Path

import bpy
from bpy.props import StringProperty

from ..messages import ShotError, printable

EXTENSION = Path(__file__).resolve().parent.parent
ADDON = __package__.rpartition(".")[0]
PROGRAM = "meniscus.exe" if os.name == "nt" else "meniscus"


class MENISCUS_Preferences(bpy.types.AddonPreferences):
    bl_idname = ADDON

    program: StringProperty(
        name="Engine",
        description="The meniscus program. Empty: that of the Python package meniscus_fx, of this extension, or on the PATH",
        subtype="FILE_PATH",
        options={"PATH_SUPPORTS_BLEND_RELATIVE"},
    )

    def draw(self, _context: bpy.types.Context) -> None:
        self.layout.prop(self, "program")
        try:
            path, source = find()
            self.layout.label(text=f"{source}: {printable(path)}", icon="CHECKMARK")
        except ShotError as error:
            self.layout.label(text=str(error), icon="ERROR")


def machine() -> str:
    """This machine in the words of Blender's extensions, such as linux-x64."""
    system = {"linux": "linux", "darwin": "macos", "win32": "windows"}.get(sys.platform, sys.platform)
    processor = platform.machine().lower()
    return f"{system}-{ {'x86_64': 'x64', 'amd64': 'x64', 'aarch64': 'arm64'}.get(processor, processor)}"


def chosen() -> str:
    """The path in the preferences; empty if there is none, or if the extension is used as a Python module."""
    addon = bpy.context.preferences.addons.get(ADDON)
    return addon.preferences.program.strip() if addon and addon.preferences else ""


def find() -> tuple[Path, str]:
    """The engine's program and where it was found. Raises ShotError."""
    if chosen():
        path = Path(bpy.path.abspath(chosen()))
        if not is_program(path):
            raise ShotError(f"{printable(path)}: not a program that can be run. Choose another in Preferences > Add-ons > Meniscus, or clear it")
        return path, "Preferences"
    looked = []
    try:
        import meniscus_fx

        path = Path(meniscus_fx.program())
        if is_program(path):
            return path, "Python package meniscus_fx"
        looked.append(f"{printable(path)} of meniscus_fx, which is not a program")
    except ImportError:
        looked.append("the Python package meniscus_fx")
    except Exception as error:
        looked.append(f"the Python package meniscus_fx ({printable(error, 200)})")
    packed = EXTENSION / "engine" / machine() / PROGRAM
    if packed.is_file():
        if make_executable(packed):
            return packed, "Extension"
        looked.append(f"{printable(packed)}, which cannot be made executable")
    else:
        looked.append(f"{printable(packed)}")
    found = on_path()
    if found:
        return found, "PATH"
    looked.append("the PATH")
    text = f"The engine was not found. Looked for {'; '.join(looked)}"
    raise ShotError(f"{text}. Install it, or choose it in Preferences > Add-ons > Meniscus > Engine")


def on_path() -> Path | None:
    """The program in the first folder of the PATH that has it. Relative folders and the current one are not trusted."""
    folders = [folder for folder in os.get_exec_path() if os.path.isabs(folder)]
    return next((path for folder in folders if is_program(path := Path(folder) / PROGRAM)), None)


def is_program(path: Path) -> bool:
    return path.is_file() and os.access(path, os.X_OK)


def make_executable(path: Path) -> bool:
    """Gives a program its permission back, which the installation of a zip does not keep."""
    if not os.access(path, os.X_OK):
        try:
            path.chmod(path.stat().st_mode | stat.S_IXUSR | stat.S_IXGRP | stat.S_IXOTH)
        except OSError:
            return False
    return is_program(path)
