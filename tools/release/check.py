#!/usr/bin/env python3
# SPDX-License-Identifier: MIT OR Apache-2.0
"""Runs what is in wheels: each system's program makes the same bytes as that of Linux x86-64.

    tools/release/check.py [DIR]                 the wheels in DIR (target/wheels)
    tools/release/check.py --python python3.9 python3.13     in environments of these, too

On Linux x86-64. The wheel of Linux x86-64 is installed by pip into a fresh environment, with the tests of the package; mypy and
pyright, from PyPI, check its types, and auditwheel that the wheels of Linux need no more than their tags promise. Linux arm64 runs by
qemu-aarch64-static, Windows by wine (with a library that Debian's lacks, compiled by x86_64-w64-mingw32-gcc). Libraries are loaded by
load.c, compiled by zig. What cannot run here is reported as LEFT OUT: wheels of macOS are only checked by their headers, in
tools/release/build. The tests of the command line on Windows' program: tools/release/wine.
"""

import argparse
import hashlib
import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))

from platforms import PLATFORMS, Platform  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
JOBS = [
    ["shot", "dam-break", "--quality", "draft", "--frames", "1-4", "-o", "dam"],
    ["volume", "dam", "--frames", "4"],
    ["shot", "cloth-over-ellipsoid", "--quality", "draft", "--frames", "1-3", "-o", "cloth"],
    ["shot", "smoke-ring", "--quality", "draft", "--frames", "1-3", "-o", "smoke"],
]
# These hold times of day, or the system's separator of paths.
NOT_COMPARED = {"log.jsonl", "report.html", "shot.json", "mesh.jsonl", "volume.jsonl", "products.json", "outputs.json"}


class LeftOut(Exception):
    """What a system needs to run here is not installed."""


def needed(program: str) -> str:
    found = shutil.which(program)
    if found is None:
        raise LeftOut(f"{program} is not installed")
    return found


def wheel_of(platform: Platform, wheels: Path) -> Path:
    found = list(wheels.glob(f"meniscus_fx-*-py3-none-{platform.tag}.whl"))
    if len(found) != 1:
        raise LeftOut(f"{wheels} has {len(found)} wheels for it, expected one")
    return found[0]


def unpacked(path: Path, platform: Platform, folder: Path) -> Path:
    """The program of a wheel."""
    with zipfile.ZipFile(path) as archive:
        archive.extractall(folder)
    program = folder / "meniscus_fx" / "bin" / platform.program
    program.chmod(0o755)
    return program


def command(platform: Platform, program: Path) -> list[str]:
    """How a program runs here."""
    if platform.name == "linux-x64":
        return [str(program)]
    if platform.name == "linux-arm64":
        return [needed("qemu-aarch64-static"), "-L", "/usr/aarch64-linux-gnu", str(program)]
    if platform.name == "windows-x64":
        os.environ.setdefault("WINEDEBUG", "-all")
        os.environ.setdefault("WINEPREFIX", str(Path(tempfile.gettempdir()) / "meniscus-wine"))
        wine, gcc = needed("wine"), needed("x86_64-w64-mingw32-gcc")
        missing = program.with_name("bcryptprimitives.dll")
        subprocess.run([gcc, "-shared", "-o", missing, ROOT / "tools/soak/bcryptprimitives.c", "-ladvapi32"], check=True)
        return [wine, str(program)]
    raise LeftOut("no emulator runs it here")


def made(run: list[str], folder: Path) -> dict[str, str]:
    """Hashes of the files that the jobs write."""
    folder.mkdir()
    for job in JOBS:
        subprocess.run([*run, *job, "--progress", "none"], cwd=folder, check=True, stdout=subprocess.DEVNULL)
    files = (path for path in folder.rglob("*") if path.is_file() and path.name not in NOT_COMPARED)
    return {path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


# The target of zig's compiler for C, with the oldest glibc.
C_TARGETS = {"linux-x64": "x86_64-linux-gnu.2.28", "linux-arm64": "aarch64-linux-gnu.2.28", "windows-x64": "x86_64-windows-gnu"}


def loaded(platform: Platform, run: list[str], folder: Path) -> str:
    """What load.c prints of the library of an unpacked wheel, and a hash of the mesh that it writes; `run` runs the program."""
    if importlib.util.find_spec("ziglang") is None:
        raise LeftOut("its library was not loaded: the package ziglang, which compiles load.c, is not installed")
    program = folder / "meniscus_fx/bin" / ("load.exe" if platform.name.startswith("windows") else "load")
    compiler = [sys.executable, "-m", "ziglang", "cc", "-target", C_TARGETS[platform.name], "-O1"]
    subprocess.run([*compiler, "-o", program, ROOT / "tools/release/load.c", *([] if program.suffix else ["-ldl"])], check=True)
    library = folder / "meniscus_fx/lib" / platform.library
    # Windows looks for what a library needs next to the program.
    found = subprocess.run([*run[:-1], program, library], cwd=folder, check=True, capture_output=True, text=True).stdout
    return "\n".join([*found.splitlines(), hashlib.sha256((folder / "load.ply").read_bytes()).hexdigest()])


def installed(interpreter: str, path: Path, venv: Path) -> None:
    """Installs the wheel of this system into an environment of an interpreter, and runs the tests of the package on it."""
    subprocess.run([interpreter, "-m", "venv", venv], check=True)
    python = venv / "bin/python"
    subprocess.run([python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", path], check=True)
    versions = "import sys, numpy; print('Python', sys.version.split()[0], 'with numpy', numpy.__version__, flush=True)"
    subprocess.run([python, "-c", versions], check=True)
    shot = ["shot", "dam-break", "--quality", "draft", "--frames", "1-5", "-o", "dam-break", "--progress", "none"]
    subprocess.run([venv / "bin/meniscus", *shot], check=True, cwd=venv, stdout=subprocess.DEVNULL)
    environment = os.environ | {"MENISCUS": str(venv / "bin/meniscus"), "MENISCUS_SHOT": str(venv / "dam-break")}
    tests = [python, "-m", "unittest", "discover", "-s", ROOT / "tools/python/tests"]
    subprocess.run(tests, check=True, cwd=venv, env=environment)


def audited(platform: Platform, path: Path, python: Path) -> bool:
    """Whether a wheel of Linux needs no library and no symbol that its tag does not promise, by PyPA's own program."""
    command = [python, "-m", "auditwheel", "show", "--json", path]
    found = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)["overall_tag"]
    numbers = re.fullmatch(r"manylinux_(\d+)_(\d+)_\w+", found)
    fits = numbers is not None and tuple(map(int, numbers.groups())) <= platform.floor
    print(f"{platform.name}: auditwheel finds {found}, {'which' if fits else 'expected what'} {platform.tag} has", flush=True)
    return fits


def typed(work: Path) -> None:
    """Checks the types of the installed package: complete, and what a user's code expects of them."""
    python, example = work / "venv/bin/python", work / "typed_example.py"
    shutil.copy(ROOT / "tools/python/typed_example.py", example)
    install = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    subprocess.run([*install, "mypy==2.4.1", "pyright[nodejs]==1.1.414", "auditwheel==6.8.2"], check=True)
    # A mistake that is not found is one, too.
    settings = {"typeCheckingMode": "strict", "enableTypeIgnoreComments": True, "reportUnnecessaryTypeIgnoreComment": "error"}
    (work / "pyrightconfig.json").write_text(json.dumps(settings))
    environment = os.environ | {"PATH": f"{python.parent}{os.pathsep}{os.environ['PATH']}", "VIRTUAL_ENV": str(work / "venv")}
    for command in (["mypy", "--strict", example], ["pyright", example], ["pyright", "--verifytypes", "meniscus_fx", "--ignoreexternal"]):
        subprocess.run([python, "-m", *command], check=True, cwd=work, env=environment)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("wheels", type=Path, nargs="?", default=ROOT / "target" / "wheels")
    parser.add_argument("--python", nargs="+", default=[], metavar="PROGRAM", help="interpreters to test the package in, too")
    options = parser.parse_args()
    failed = 0
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        own = wheel_of(PLATFORMS["linux-x64"], options.wheels)
        for number, interpreter in enumerate(options.python):
            installed(interpreter, own, work / f"venv-{number}")
        installed(sys.executable, own, work / "venv")
        typed(work)
        reference = library = None
        for platform in sorted(PLATFORMS.values(), key=lambda platform: platform.name != "linux-x64"):
            try:
                path = wheel_of(platform, options.wheels)
                if platform.name.startswith("linux"):
                    failed |= not audited(platform, path, work / "venv/bin/python")
                run = command(platform, unpacked(path, platform, work / platform.name))
                files = made(run, work / f"{platform.name}-files")
            except LeftOut as reason:
                print(f"{platform.name}: LEFT OUT, {reason}", flush=True)
                continue
            reference = reference or files
            differing = sorted(name for name in reference.keys() | files.keys() if reference.get(name) != files.get(name))
            print(f"{platform.name}: {len(files)} files, {len(differing)} differ {' '.join(differing[:5])}", flush=True)
            failed |= bool(differing)
            try:
                printed = loaded(platform, run, work / platform.name)
            except LeftOut as reason:
                print(f"{platform.name}: LEFT OUT, {reason}", flush=True)
            else:
                library = library or printed
                print(f"{platform.name}: its library {'makes the same mesh' if printed == library else 'differs: ' + printed}", flush=True)
                failed |= printed != library
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
