#!/usr/bin/env python3
"""Measures release profiles: seconds of a cold build against the speed of the program, as a table in Markdown.

    tools/bench/build.py                                   # the profiles of docs/build.md
    tools/bench/build.py lto=off,codegen-units=16 lto=thin # others; what is not named is Cargo.toml's

Every profile is built in a folder of its own, removed at the end, with packages that were downloaded before. The programs
then run in turn: the solver's nanoseconds a particle and iteration, and those of a surface a particle, are medians.
Needs Python's standard library, and a machine that does nothing else for about five minutes a profile.
"""

import argparse
import json
import os
import pathlib
import shutil
import statistics
import subprocess
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]

# Settings of Cargo's profile, as it takes them from the environment.
PROFILES = ["", "codegen-units=4", "lto=off,codegen-units=4", "lto=off"]

PRESET = ["dam-break", "--quality", "preview", "--frames", "1-24"]


def build(profile, folder):
    """Builds with a profile from nothing; returns the seconds and the program."""
    environment = dict(os.environ, CARGO_TARGET_DIR=str(folder))
    for setting in filter(None, profile.split(",")):
        key, value = setting.split("=")
        environment["CARGO_PROFILE_RELEASE_" + key.upper().replace("-", "_")] = value
    start = time.perf_counter()
    subprocess.run(["cargo", "build", "--release", "--quiet"], cwd=ROOT, env=environment, check=True)
    return time.perf_counter() - start, folder / "release" / "meniscus"


def speed(program, folder):
    """Nanoseconds of the solver a particle and iteration, and of a surface a particle."""
    shot = folder / "shot"
    shutil.rmtree(shot, ignore_errors=True)
    common = ["--progress", "none"]
    subprocess.run([program, "simulate", *PRESET, "-o", shot, *common], check=True, stdout=subprocess.DEVNULL)
    records = [json.loads(line) for line in (shot / "log.jsonl").read_text().splitlines()]
    liquids = [record["liquid"] for record in records]
    solving = sum(dict(record["seconds"])["solve"] for record in records)
    updates = sum(record["particles"] * liquid["iterations"] for record, liquid in zip(records, liquids))
    start = time.perf_counter()
    subprocess.run([program, "mesh", shot, "--force", *common], check=True, stdout=subprocess.DEVNULL)
    meshing = time.perf_counter() - start
    return 1e9 * solving / updates, 1e9 * meshing / sum(record["particles"] for record in records)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("profiles", nargs="*", default=PROFILES)
    parser.add_argument("--builds", type=int, default=1, help="cold builds of each profile")
    parser.add_argument("--runs", type=int, default=5, help="runs of each program")
    parser.add_argument("--reference", type=pathlib.Path, help="a program to compare the speed with")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        rows, programs = [], []
        if options.reference:
            rows.append((options.reference.name, None, options.reference.stat().st_size))
            programs.append(options.reference)
        for number, profile in enumerate(options.profiles):
            seconds = []
            for _ in range(options.builds):
                target = folder / f"target-{number}"
                shutil.rmtree(target, ignore_errors=True)
                took, program = build(profile, target)
                seconds.append(took)
            kept = folder / f"meniscus-{number}"
            shutil.copy(program, kept)
            shutil.rmtree(target)
            programs.append(kept)
            rows.append((profile or "Cargo.toml's", statistics.median(seconds), kept.stat().st_size))
            print(f"built {rows[-1]}", flush=True)
        runs = [[speed(program, folder) for program in programs] for _ in range(options.runs)]
    print("| profile | cold build [s] | program [MB] | solver [ns a particle and iteration] | surface [ns a particle] |")
    print("|---|---|---|---|---|")
    for place, (profile, seconds, size) in enumerate(rows):
        solver, surface = (statistics.median(run[place][k] for run in runs) for k in range(2))
        took = f"{seconds:.0f}" if seconds else ""
        print(f"| {profile} | {took} | {size / 1e6:.1f} | {solver:.1f} | {surface:.0f} |", flush=True)


if __name__ == "__main__":
    main()
