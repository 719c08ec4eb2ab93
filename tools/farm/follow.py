#!/usr/bin/env python3
"""Measures meshing behind a running simulation.

    tools/farm/follow.py [--binary MENISCUS] [--repeats 3] [--most 1.1]

Both programs get one thread, so on a machine with two free cores neither takes time from the other, as on a farm. Two ratios are
printed: the time of both together over the longer of the two alone, and over the simulation's own time in the same run, which
other work on the machine does not change much. Exits with 1 if the median of the second is above --most, if that of the first is and
the machine was idle at the start, or if the meshes differ.
"""

import argparse
import os
import pathlib
import shutil
import statistics
import subprocess
import sys
import tempfile
import time

import common

FRAMES = 48


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--binary", type=pathlib.Path, default=common.ROOT / "target/release/meniscus")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--most", type=float, default=1.1)
    args = parser.parse_args()
    binary = args.binary.resolve()
    preset = common.PRESET.replace('"1-24"', f'"1-{FRAMES}"').replace("spacing = 0.05", "spacing = 0.03")
    preset = preset.replace("voxel = 0.25", "voxel = 0.4")
    tail = ["--threads", 1, "--progress", "none"]
    simulate = [binary, "simulate", "follow.toml", *tail, "-o"]
    mesh = [binary, "mesh", *tail]
    with tempfile.TemporaryDirectory() as place:
        desk = pathlib.Path(place).resolve()
        (desk / "follow.toml").write_text(preset)

        def timed(*commands):
            """The seconds from the start until each command has ended, in their order."""
            start = time.monotonic()
            running = [subprocess.Popen([str(word) for word in command], cwd=desk, stdout=subprocess.DEVNULL)
                       for command in commands]
            ends = {}
            while len(ends) < len(running):
                pid, status = os.wait()
                ends[pid] = time.monotonic() - start
                if status:
                    sys.exit("a command failed")
            return [ends[process.pid] for process in running]

        is_idle = os.getloadavg()[0] < 0.5
        alone, own = [], []
        for _ in range(args.repeats):
            for name in ["alone", "together"]:
                shutil.rmtree(desk / name, ignore_errors=True)
            simulating, meshing = timed([*simulate, "alone"])[0], timed([*mesh, "alone"])[0]
            ends = timed([*simulate, "together"], [*mesh, "together", "--follow", "--frames", f"1-{FRAMES}"])
            alone.append(max(ends) / max(simulating, meshing))
            own.append(max(ends) / ends[0])
            print(f"simulate {simulating:.1f} s, mesh {meshing:.1f} s, together {ends[0]:.1f} s and {ends[1]:.1f} s: "
                  f"{alone[-1]:.3f} of the longer alone, {own[-1]:.3f} of the simulation in this run")
            common.expect_same(common.content(desk / "together"), common.content(desk / "alone"), "together")
        alone, own = statistics.median(alone), statistics.median(own)
        note = "" if is_idle else " (not judged: the machine was not idle)"
        print(f"median {alone:.3f} of the longer alone{note}, {own:.3f} of the simulation in the same run; at most {args.most}")
        sys.exit(own > args.most or is_idle and alone > args.most)


if __name__ == "__main__":
    main()
