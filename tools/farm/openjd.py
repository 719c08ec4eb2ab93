#!/usr/bin/env python3
"""Runs the job of a shot with the `openjd` program, kills one worker, and compares the result with a local run.

    tools/farm/openjd.py [--binary MENISCUS] [--openjd OPENJD]

Without --openjd, `openjd-cli` is installed from PyPI into target/openjd. Exits with 1 at the first difference.
"""

import argparse
import pathlib
import subprocess
import sys
import tempfile

import common


def installed():
    """The path of `openjd`, which is installed where it is not yet."""
    home = common.ROOT / "target/openjd"
    if not (home / "bin/openjd").exists():
        subprocess.run([sys.executable, "-m", "venv", home], check=True)
        subprocess.run([home / "bin/pip", "install", "--quiet", "openjd-cli==0.8.0"], check=True)
    return home / "bin/openjd"


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--binary", type=pathlib.Path, default=common.ROOT / "target/release/meniscus")
    parser.add_argument("--openjd", type=pathlib.Path)
    args = parser.parse_args()
    binary, openjd = args.binary.resolve(), (args.openjd or installed()).absolute()
    with tempfile.TemporaryDirectory() as place:
        desk = pathlib.Path(place).resolve()
        local = common.local_run(binary, desk)
        shot = desk / common.AWKWARD
        farm = ["farm", "openjd", shot, "--preset", "farm.toml", "--chunk", common.CHUNK, "--command", binary]
        common.run([binary, *farm], desk)
        job = [openjd, "run", shot / "farm.openjd.json", "--step", "verify", "--run-dependencies"]
        common.run([openjd, "check", shot / "farm.openjd.json"], desk)

        # The third chunk's worker is killed when it has made a mesh: the engine reports it, the chunks before stay.
        with subprocess.Popen(job, cwd=desk, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as running:
            common.kill_worker(shot, ["--frames", "13-18"], shot / "mesh/liquid_0013.ply")
            output = running.communicate()[0]
        if running.returncode == 0 or "openjd_progress" not in output:
            sys.exit(f"the killed worker is not reported, or no progress is\n{output[-3000:]}")
        before = common.made(shot)
        if not 13 <= len(before) < 18:
            sys.exit(f"the kill came too early or too late: {len(before)} meshes")

        # The same job again: what was made stays.
        output = common.run(job, desk)
        after = common.made(shot)
        again = [name for name in before if before[name] != after[name]]
        if len(again) > 1:
            sys.exit(f"made again although they were complete: {again}")
        common.expect_same(common.content(shot), local, "Open Job Description")
        print(f"openjd: {len(before)} of 24 meshes at the kill, {len(again)} made again; equal to the local run")

        # The same with chunks of another length, from another folder: no path is in the template.
        moved = desk / "moved"
        shot.rename(moved)
        common.run([binary, "farm", "openjd", moved, "--chunk", 5, "--command", binary], desk)
        output = common.run([openjd, "run", moved / "farm.openjd.json", "--step", "verify", "--run-dependencies"], desk)
        if "Frames(STRING) = 21-24" not in output or common.made(moved) != after:
            sys.exit(f"the moved shot was made again, or its chunks are others\n{output[-3000:]}")

        # Wedges: each is a task.
        wedge = ["wedge", "farm.toml", "--set", "liquid.spacing=0.08,0.1", "--set", "liquid.cfl=0.4,0.8", "-o", "wedges"]
        common.run([binary, *wedge, "--prepare"], desk)
        common.run([binary, "farm", "openjd", "wedges", "--chunk", 12, "--command", binary], desk)
        output = common.run([openjd, "run", desk / "wedges/farm.openjd.json", "--step", "compare", "--run-dependencies"], desk)
        if output.count("Shot(STRING) = ") < 4 * (1 + 2 + 2 + 1):
            sys.exit(f"too few tasks of wedges\n{output[-3000:]}")
        on_farm = common.content(desk / "wedges")
        (desk / "wedges").rename(desk / "wedges-farm")
        common.run([binary, *wedge], desk)
        common.expect_same(on_farm, {**common.content(desk / "wedges"), "wedges.csv": on_farm["wedges.csv"],
                                     "wedges.html": on_farm["wedges.html"]}, "wedges by Open Job Description")
        print("openjd: four wedges equal to those of a local run")


if __name__ == "__main__":
    main()
