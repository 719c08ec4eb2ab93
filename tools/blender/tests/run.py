# SPDX-License-Identifier: MIT OR Apache-2.0
"""Tests of the Blender extension, on a shot folder that the meniscus binary made and on synthetic ones.

    python tools/blender/tests/run.py SHOT_DIR [VOLUMES_DIR [SMOKE_DIR [PLUME_DIR]]] [--keep DIR]

The interpreter needs bpy (4.5 to 5.2) and numpy. The zip is built, and every stage of stages.py and hostile.py runs in a Blender
process of its own with user folders made for the test; the shot is copied first, the given folder is not
touched. The last line is `N passed, N failed`; the exit code is 1 if anything failed. Without SHOT_DIR a
synthetic shot stands in for it, and the longest tests are shorter or left out (SHORT); without VOLUMES_DIR, a folder of `meniscus volume`, no volume is opened; without SMOKE_DIR, a shot of `smoke-ring`,
no smoke is imported; without PLUME_DIR, a shot of `plume`, none whose first frame is empty. Scenes become shots with the engine that
MENISCUS in the environment names, else the `meniscus` on the PATH; without either, that is left out.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
import zipfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
TOOL = HERE.parent
# A stage takes a minute at most; one that waits for a pipe never ends.
HANG_SECONDS = 900
SCENES = {
    "scenes.py": ["tap"],
    "first.py": ["first"],
    "presets.py": ["presets"],
    "placing.py": ["placing"],
    "sampling.py": ["sampling"],
    "logs.py": ["logs"],
    "jobs.py": ["jobs", "closed", "engine"],
    "results.py": ["bodies", "cloth", "arrivals", "panels"],
}
# What runs in their place on a synthetic shot, as in a second version of Blender: to save time. tools/soak/run has all of it in every version.
SHORT = {
    "first.py": ["few"],
    "results.py": ["bodies", "cloth", "panels"],
    "jobs.py": ["engine"],
    "logs.py": [],
    "presets.py": [],
    "placing.py": [],
}
# Stages of solids.py and hostile.py that are left out there too.
LONG_ONLY = ("startup", "pictures", "hostile")
sys.path[:0] = [str(HERE), str(TOOL)]

import build  # noqa: E402
import synthetic  # noqa: E402


class Tally:
    """Prints one line a check and counts them."""

    def __init__(self) -> None:
        self.passed = 0
        self.failed = 0

    def check(self, good: bool, name: str, detail: str = "") -> None:
        self.passed += good
        self.failed += not good
        print(f"ok   {name}" if good else f"FAIL {name}: {detail}", flush=True)

    def stage(self, name: str, arguments: list[Path], resources: Path, script: str = "stages.py") -> None:
        """Runs one stage in a new process; its ok, FAIL, expect and forbid lines become checks."""
        print(f"-- {name}", flush=True)
        start = time.monotonic()
        command = [sys.executable, str(HERE / script), name, *map(str, arguments)]
        environment = os.environ | {"BLENDER_USER_RESOURCES": str(resources), "PYTHONDONTWRITEBYTECODE": "1"}
        run = subprocess.Popen(
            command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, encoding="utf-8", errors="replace"
        )
        try:
            output, _ = run.communicate(timeout=HANG_SECONDS)
        except subprocess.TimeoutExpired:
            run.kill()
            output, _ = run.communicate()
        lines = output.splitlines()
        failed, read = self.failed, 0
        talk = "\n".join(line for line in lines if not line.startswith(("expect\t", "forbid\t")))
        for line in lines:
            kind, _, rest = line.partition("\t")
            read += kind in ("ok", "FAIL", "expect", "forbid")
            if kind == "ok":
                self.check(True, rest)
            elif kind == "FAIL":
                self.check(False, *rest.split("\t", 1))
            elif kind == "expect":
                self.check(rest in talk, f"Blender reports: {rest}", "not among what was printed")
            elif kind == "forbid":
                found = [line for line in talk.splitlines() if line.startswith(rest)]
                self.check(not found, f"Blender prints no line with {rest}", str(found))
        print(f"-- {name} took {time.monotonic() - start:.1f} s", flush=True)
        done = run.returncode == 0 and lines[-1:] == [f"done {read}"]
        self.check(done, f"stage {name} ran to its end", f"exit code {run.returncode}, {read} lines read")
        if self.failed > failed:
            printed = [line for line in talk.splitlines() if not line.startswith(("Fra:", "ok\t"))]
            print("   | " + "\n   | ".join(printed[-60:]), flush=True)


def check_build(tally: Tally, work: Path) -> Path:
    """Builds the zip twice and looks at its version."""
    first, second = build.build(work / "zip"), build.build(work / "again")
    tally.check(first.read_bytes() == second.read_bytes(), "the zip has the same bytes when built twice")
    program = work / "program"
    program.write_bytes(b"engine")
    packed = [build.build(work / name, {"linux-x64": program}) for name in ("packed", "packed again")]
    with zipfile.ZipFile(packed[0]) as archive:
        names = archive.namelist()
        has_engine = "engine/linux-x64/meniscus" in names and archive.read("engine/linux-x64/meniscus") == b"engine"
    same = packed[0].read_bytes() == packed[1].read_bytes() and packed[0].name.endswith("-linux-x64.zip")
    tally.check(has_engine and "scene/preset.schema.json" in names, "the zip has the schema, and the engine where one is packed", str(names))
    tally.check(same, "a zip with an engine has the same bytes when built twice")
    cargo = tomllib.loads((TOOL.parent.parent / "Cargo.toml").read_text(encoding="utf-8"))
    wanted = f"meniscus-{cargo['package']['version']}.zip"
    tally.check(first.name == wanted, "extension and crate have one version", f"{first.name}, not {wanted}")
    return first


def has_engine() -> bool:
    """Whether there is an engine, whose path MENISCUS then has; its absence is reported."""
    program = os.environ.get("MENISCUS") or shutil.which("meniscus")
    if not program:
        print("LEFT OUT: scenes and kinds of outputs, since MENISCUS names no engine and none is on the PATH", flush=True)
        return False
    os.environ["MENISCUS"] = os.path.abspath(program)
    return True


def check_scenes(tally: Tally, work: Path, user: Path, is_short: bool) -> None:
    """Scenes that become shots, with the engine."""
    # Stages of scenes and shots have equal names.
    scenes = work / "scenes"
    scenes.mkdir()
    for script, names in (SCENES | SHORT if is_short else SCENES).items():
        for name in names:
            tally.stage(name, [scenes / name], user, script)


def check_kinds(tally: Tally, work: Path, user: Path, bare: Path) -> None:
    """Every kind of output, with the engine; each .blend and its shot move to another folder between two processes."""
    kinds = work / "kinds"
    kinds.mkdir()
    for name in ("liquids", "smoke_and_cloth"):
        tally.stage(name, [kinds], user, "kinds.py")
        os.rename(kinds, work / f"kinds of {name}")
        kinds = work / f"kinds of {name}"
        tally.stage(f"{name}_moved", [kinds], bare, "kinds.py")
    tally.stage("forms", [kinds], user, "kinds.py")
    tally.stage("clouds", [kinds], user, "kinds.py")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("shot", type=Path, nargs="?", help="shot folder with PLY meshes, a few frames")
    parser.add_argument("volumes", type=Path, nargs="?", help="shot folder with volumes, a few frames")
    parser.add_argument("smoke", type=Path, nargs="?", help="shot folder with volumes of a smoke ring")
    parser.add_argument("plume", type=Path, nargs="?", help="shot folder with volumes of a plume, its first frame without smoke")
    parser.add_argument("cloth", type=Path, nargs="?", help="shot folder with sheets as point caches, a few frames")
    parser.add_argument("--keep", type=Path, help="work in this new folder and keep it")
    given = parser.parse_args()
    work = given.keep or Path(tempfile.mkdtemp(prefix="meniscus-blender-"))
    work.mkdir(parents=True, exist_ok=True)
    tally = Tally()
    try:
        archive = check_build(tally, work)
        if given.shot:
            ignored = shutil.ignore_patterns("cache", "volume", "sheet")
            shutil.copytree(given.shot, work / "shot", ignore=ignored)
        else:
            synthetic.write_shot(work / "shot")
        user, bare = work / "user", work / "bare"
        user.mkdir()
        bare.mkdir()
        tally.stage("install", [archive], user)
        tally.stage("shot", [work / "shot"], user)
        # The folder moves between the two processes: relative paths have to survive that.
        os.rename(work / "shot", work / "moved shot")
        tally.stage("farm", [work / "moved shot"], bare)
        tally.stage("edges", [work / "edges"], user)
        tally.stage("messages", [work / "messages"], user)
        tally.stage("blur", [work / "blur"], user)
        synthetic.write_sheet(work / "sheet")
        tally.stage("sheet", [work / "sheet"], user)
        tally.stage("sheets", [work / "sheets"], user)
        is_short = not given.shot
        solids = ("colliders", "deforming", "startup", "floors", "studio", "pictures", "motions")
        for name, script in [*((name, "solids.py") for name in solids), ("hostile", "hostile.py")]:
            if not (is_short and name in LONG_ONLY):
                tally.stage(name, [work / name], user, script)
        (work / "reload").mkdir()
        tally.stage("reload", [work / "reload"], user, "kinds.py")
        if has_engine():
            check_kinds(tally, work, user, bare)
            check_scenes(tally, work, user, is_short)
        if given.volumes:
            shutil.copytree(given.volumes, work / "volumes")
            tally.stage("volume", [work / "volumes"], bare)
        if given.smoke:
            shutil.copytree(given.smoke, work / "smoke", ignore=shutil.ignore_patterns("cache"))
            tally.stage("smoke", [work / "smoke"], user)
        if given.plume:
            shutil.copytree(given.plume, work / "plume", ignore=shutil.ignore_patterns("cache"))
            tally.stage("plume", [work / "plume"], user)
        if given.cloth:
            shutil.copytree(given.cloth, work / "cloth", ignore=shutil.ignore_patterns("cache"))
            tally.stage("sheet", [work / "cloth"], user)
    finally:
        if not given.keep:
            shutil.rmtree(work, ignore_errors=True)
    print(f"{tally.passed} passed, {tally.failed} failed", flush=True)
    return 1 if tally.failed else 0


if __name__ == "__main__":
    sys.exit(main())
