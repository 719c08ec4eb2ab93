#!/usr/bin/env python3
"""Measures meshing behind a running simulation: the time of both together over the longer of the two alone.

    tools/farm/follow.py [--binary MENISCUS] [--repeats 3] [--most 1.1]

Both programs get one thread, so on a machine with two free cores neither takes time from the other, as on a farm. Each ratio is of
runs one after the other. Exits with 1 if the median ratio is above --most, or the meshes differ.
"""

import argparse
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
            start = time.monotonic()
            running = [subprocess.Popen([str(word) for word in command], cwd=desk, stdout=subprocess.DEVNULL)
                       for command in commands]
            if any(process.wait() for process in running):
                sys.exit("a command failed")
            return time.monotonic() - start

        ratios = []
        for _ in range(args.repeats):
            for name in ["alone", "together"]:
                shutil.rmtree(desk / name, ignore_errors=True)
            simulating = timed([*simulate, "alone"])
            meshing = timed([*mesh, "alone"])
            together = timed([*simulate, "together"], [*mesh, "together", "--follow", "--frames", f"1-{FRAMES}"])
            ratios.append(together / max(simulating, meshing))
            print(f"simulate {simulating:.1f} s, mesh {meshing:.1f} s, together {together:.1f} s: {ratios[-1]:.3f} of the longer")
            common.expect_same(common.content(desk / "together"), common.content(desk / "alone"), "together")
        median = statistics.median(ratios)
        print(f"median {median:.3f}, at most {args.most}")
        sys.exit(median > args.most)


if __name__ == "__main__":
    main()
