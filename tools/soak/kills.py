#!/usr/bin/env python3
"""Kills jobs at random moments and continues them: are files and logs then those of a job that was never stopped?

    tools/soak/kills.py [MENISCUS] [--kills 200] [--seed 1]

A small shot of water and a rigid body is simulated, meshed and turned into volumes and whitewater by `shot`, `simulate`, `mesh`, `volume` and
`whitewater`. Each is killed by SIGKILL after a random time, several times in a row, then continued to its end. The folder must then
equal that of an undisturbed run: every file byte for byte, and every line of the logs but for the seconds that passes took;
`verify` must succeed, and no temporary may be left.
Prints the number of kills that hit a running job; exits with 1 at the first difference.

Needs only Python's standard library.
"""

import argparse
import json
import pathlib
import random
import shutil
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]

PRESET = """
title = "Kills"
frames = "1-8"
[[world.collider]]
shape = { tank = { min = [0, 0, 0], max = [1.6, 0.8, 1.2] } }
[liquid]
spacing = 0.08
[liquid.xsph]
[[liquid.source]]
shape = { box = { min = [0, 0, 0], max = [0.8, 0.8, 0.8] } }
[[body]]
shape = { sphere = { center = [0, 0, 0], radius = 0.2 } }
density = 400
position = [1.2, 0.4, 0.3]
[whitewater]
[output]
mesh = ["ply", "obj"]
volume = ["density"]
"""

# What is killed, and what has to have run before.
JOBS = {
    "shot": (["shot", "kills.toml", "-o", "out"], []),
    "simulate": (["simulate", "kills.toml", "-o", "out"], []),
    "mesh": (["mesh", "out"], [["simulate", "kills.toml", "-o", "out"]]),
    "volume": (["volume", "out"], [["simulate", "kills.toml", "-o", "out"]]),
    "whitewater": (["whitewater", "out"], [["simulate", "kills.toml", "-o", "out"]]),
}


def run(binary, args, folder):
    """Runs a command to its end and returns how long it took [s]."""
    start = time.monotonic()
    done = subprocess.run([binary, *args, "--progress", "none"], cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        sys.exit(f"{' '.join(args)}: exit {done.returncode}\n{done.stderr}")
    return time.monotonic() - start


def content(folder):
    """Every file of a shot folder by its path; of logs, the lines without what differs from run to run."""
    found = {}
    for path in sorted(folder.rglob("*")):
        if path.is_dir() or path.name == ".lock":
            continue
        name = str(path.relative_to(folder))
        if path.suffix == ".jsonl":
            lines = [json.loads(line) for line in path.read_text().splitlines()]
            for line in lines:
                line.pop("seconds", None)
            found[name] = lines
        else:
            found[name] = path.read_bytes()
    return found


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("binary", nargs="?", type=pathlib.Path, default=ROOT / "target/release/meniscus")
    parser.add_argument("--kills", type=int, default=200, help="kills that have to hit a running job")
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    binary = args.binary.resolve()
    chance = random.Random(args.seed)
    hits = dict.fromkeys(JOBS, 0)
    with tempfile.TemporaryDirectory() as place:
        place = pathlib.Path(place)
        (place / "kills.toml").write_text(PRESET)
        out = place / "out"
        expected = {}
        for name, (job, before) in JOBS.items():
            shutil.rmtree(out, ignore_errors=True)
            for command in before:
                run(binary, command, place)
            seconds = run(binary, job, place)
            expected[name] = (seconds, content(out))
        while sum(hits.values()) < args.kills:
            for name, (job, before) in JOBS.items():
                seconds, files = expected[name]
                shutil.rmtree(out, ignore_errors=True)
                for command in before:
                    run(binary, command, place)
                for _ in range(4):
                    process = subprocess.Popen(
                        [binary, *job, "--progress", "none"], cwd=place, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
                    )
                    time.sleep(chance.uniform(0, seconds))
                    hits[name] += process.poll() is None
                    process.kill()
                    process.wait()
                run(binary, job, place)
                run(binary, ["verify", "out"], place)
                found = content(out)
                names = sorted(set(files) | set(found))
                if different := [file for file in names if files.get(file) != found.get(file)]:
                    sys.exit(f"{name}: after {sum(hits.values())} kills these differ: {', '.join(different)}")
    print(f"{sum(hits.values())} kills of running jobs, nothing lost: {hits}")


if __name__ == "__main__":
    main()
