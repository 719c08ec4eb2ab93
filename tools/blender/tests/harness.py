# SPDX-License-Identifier: MIT OR Apache-2.0
"""What the tests inside Blender share: checks as lines for run.py, imports, and edits of a shot.json.

A check is a line `ok<TAB>name` or `FAIL<TAB>name<TAB>detail`; `expect<TAB>text` asks run.py to look for a
text among what Blender printed, `forbid<TAB>text` for lines that start with one.
"""

import json
import os
import sys
import traceback
from pathlib import Path

import bpy

ADDON = "bl_ext.user_default.meniscus"

reported = 0


def report(line: str) -> None:
    """Prints a line for run.py, on a line of its own even where Blender left one unfinished."""
    global reported
    reported += 1
    print("\n" + line.replace("\n", " "), flush=True)


def check(good: bool, name: str, detail: object = "") -> None:
    report(f"ok\t{name}" if good else f"FAIL\t{name}\t{detail}")


def expect(text: str) -> None:
    report(f"expect\t{text}")


def forbid(text: str) -> None:
    report(f"forbid\t{text}")


def use_addon() -> None:
    """An empty file with the installed add-on switched on."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.preferences.addon_enable(module=ADDON)


def evaluated(shown: bpy.types.Object) -> bpy.types.Mesh:
    return shown.evaluated_get(bpy.context.evaluated_depsgraph_get()).data


def at_frame(shown: bpy.types.Object, frame: int, subframe: float = 0.0) -> bpy.types.Mesh:
    bpy.context.scene.frame_set(frame, subframe=subframe)
    return evaluated(shown)


def imported(folder: Path, studio: bool = False, **options: str) -> bpy.types.Object:
    """Imports a shot, without camera, ground and light unless they are tested, and returns its active object."""
    bpy.ops.import_scene.meniscus_shot(filepath=str(folder / "shot.json"), studio=studio, **options)
    return bpy.context.object


def change(path: Path, edit) -> None:
    """Rewrites a shot.json after an edit of its data."""
    data = json.loads(path.read_text(encoding="utf-8"))
    edit(data)
    path.write_text(json.dumps(data), encoding="utf-8")


def refused(name: str, path: Path, *parts: str, **options: str) -> None:
    """The import fails, its message has every part, and the file is as it was."""
    objects = len(bpy.data.objects)
    try:
        bpy.ops.import_scene.meniscus_shot(filepath=str(path), **options)
    except RuntimeError as error:
        text = str(error)
        lacking = [part for part in parts if part not in text]
        check(not lacking, f"refused: {name}", f"message lacks {lacking}: {text!r}")
        plain = "Traceback" not in text and "\n" not in text.strip() and len(text) < 5000
        check(plain, f"refused with one line: {name}", text[:2000])
    else:
        check(False, f"refused: {name}", "it was imported")
    check(len(bpy.data.objects) == objects, f"refused without a trace: {name}")


def run(stages: dict) -> None:
    """Runs the stage that the command line names, and ends the process."""
    code = 1
    try:
        stages[f"stage_{sys.argv[1]}"](*map(Path, sys.argv[2:]))
        print(f"\ndone {reported}")
        code = 0
    except Exception:
        traceback.print_exc(file=sys.stdout)
    sys.stdout.flush()
    # bpy as a module can crash while the interpreter shuts down, which would hide the result.
    os._exit(code)
