"""What the tests of farm jobs share: a shot, a local run of it, and the comparison of folders."""

import json
import pathlib
import shlex
import signal
import subprocess
import sys
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]

# Frames of a chunk, of the 24 that the shot has.
CHUNK = 6
CHUNKS = 4

PRESET = """
title = "Farm"
frames = "1-24"
[[world.collider]]
shape = { tank = { min = [0, 0, 0], max = [1.6, 0.8, 1.2] } }
[liquid]
spacing = 0.05
[liquid.xsph]
[[liquid.source]]
shape = { box = { min = [0, 0, 0], max = [0.8, 0.8, 0.8] } }
[surface]
voxel = 0.25
[output]
mesh = ["ply", "obj"]
volume = ["density"]
"""

# A folder that shells, format strings and file patterns would take for something else.
AWKWARD = "it's a \"shot\" {{Param.Folder}} $HOME %A `x`"


def run(args, cwd, code=0, **more):
    """Runs a command, expects its exit code, and returns its output."""
    done = subprocess.run([str(arg) for arg in args], cwd=cwd, capture_output=True, text=True, check=False, **more)
    if code is not None and done.returncode != code:
        words = " ".join(shlex.quote(str(arg)) for arg in args)
        sys.exit(f"{words}: exit {done.returncode}, expected {code}\n{done.stdout[-4000:]}\n{done.stderr[-4000:]}")
    return done.stdout + done.stderr


def local_run(binary, desk):
    """A run of the shot without a farm."""
    (desk / "farm.toml").write_text(PRESET)
    run([binary, "shot", "farm.toml", "-o", "local", "--progress", "none"], desk)
    return content(desk / "local")


def content(folder):
    """Every file that a shot folder holds by its path; of logs, the lines without what differs from run to run."""
    found = {}
    for path in sorted(folder.rglob("*")):
        name = str(path.relative_to(folder))
        if path.is_dir() or path.name == ".lock" or name.startswith("farm") or name == "meniscus.js":
            continue
        if path.suffix == ".jsonl":
            lines = [json.loads(line) for line in path.read_text().splitlines()]
            for line in lines:
                line.pop("seconds", None)
            found[name] = lines
        else:
            found[name] = path.read_bytes()
    return found


def expect_same(found, expected, what):
    """Ends with a message unless both folders have the same files with the same content."""
    different = sorted(name for name in found.keys() | expected.keys() if found.get(name) != expected.get(name))
    if different:
        sys.exit(f"{what}: other than the local run: {', '.join(different[:20])}")


def wait_for(condition, what, seconds=120):
    """Waits until a condition is true, and returns its value."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        found = condition()
        if found:
            return found
        time.sleep(0.002)
    sys.exit(f"{what}: not within {seconds} s")


def workers(folder, words):
    """The processes that run in or on a folder with these words of a command line in a row."""
    found = []
    for entry in pathlib.Path("/proc").iterdir():
        try:
            line = (entry / "cmdline").read_bytes().split(b"\0")[:-1] if entry.name.isdigit() else []
            place = (entry / "cwd").resolve() if line else None
        except OSError:
            continue
        line = [word.decode(errors="replace") for word in line]
        is_here = place == folder or any(str(folder) in word for word in line)
        pairs = [line[i : i + len(words)] for i in range(len(line))]
        if is_here and line[0].endswith("meniscus") and words in pairs:
            found.append(int(entry.name))
    return found


def kill_worker(folder, words, file):
    """Kills the worker of a chunk once it has made a file."""

    def under_way():
        return file.exists() and workers(folder, words)

    for pid in wait_for(under_way, f"a worker with {' '.join(words)}"):
        subprocess.run(["kill", f"-{signal.SIGKILL.value}", str(pid)], check=False)


def made(folder, extension="ply"):
    """When each mesh was made."""
    return {path.name: path.stat().st_mtime_ns for path in (folder / "mesh").glob(f"*.{extension}")}
