#!/usr/bin/env python3
"""Load: many frames, many particles, many runs.

    tools/soak/load.py frames    [--count 10000] [--blender PYTHON]   seconds of info, verify, resume and import, and of a tenth of them
    tools/soak/load.py particles [--height 5] [--frames 1-240]        memory of every frame, simulated, meshed, verified and imported
    tools/soak/load.py repeat    [--times 10] [--only PRESET...]      every preset's draft tier, with jittered timing, compared

`--meniscus BINARY` names the program (target/release/meniscus), `-o DIR` keeps the files. Exit code 1: a limit was exceeded.

`frames`: each command takes less than 10 s and at most 1.5 times its tenth's time per frame (plus half a second). PYTHON is one that
has `bpy`, here and for `particles`; without it the import is left out.
`particles`: `dam-break` at its draft accuracy and spacing (5 cm), with a column as high as --height [m] in place of one metre: 5 m are a
million particles. Peak resident memory while the last tenth of the frames is simulated within 5 % of that of the first tenth. The
memory of a mesh follows the size of its surface: while the last tenth is meshed it is within 5 % of that of a process which meshes no other
frames. The memory of `verify` is printed.
`repeat`: each run has another number of threads and is stopped and continued (SIGSTOP, SIGCONT) at random moments; its files must
equal those of the first (tools/soak/identical.py, needs numpy and zstandard).
"""

import argparse
import contextlib
import json
import pathlib
import random
import signal
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]

SMALL = """
title = "Many frames"
frames = "1-{count}"
[[world.collider]]
shape = {{ tank = {{ min = [0, 0, 0], max = [0.8, 0.4, 0.6] }} }}
[liquid]
spacing = 0.1
density_dev = "10 %"
[[liquid.source]]
shape = {{ box = {{ min = [0, 0, 0], max = [0.4, 0.4, 0.3] }} }}
[output]
mesh = ["ply"]
"""

# Seconds after which a run of a draft tier counts as hung.
LONGEST_RUN = 900

IMPORT = """
import sys, time
sys.path.insert(0, {extension!r})
import bpy, meniscus
meniscus.register()
start = time.monotonic()
bpy.ops.import_scene.meniscus_shot(filepath={shot!r}, path_mode="ABSOLUTE", studio=False)
print("import", time.monotonic() - start, flush=True)
import os
os._exit(0)
"""


def timed(command):
    start = time.monotonic()
    done = subprocess.run([*map(str, command)], capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"{' '.join(map(str, command))}: exit {done.returncode}\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
    return time.monotonic() - start, done.stdout


def seconds_of_frames(args, folder, count):
    """Seconds of each command on a folder of `count` frames."""
    preset, shot = folder / f"{count}.toml", folder / f"shot_{count}"
    preset.write_text(SMALL.format(count=count))
    made, _ = timed([args.meniscus, "shot", preset, "-o", shot, "--progress", "none"])
    found = {"shot": made}
    for name, command in {
        "resume": ["shot", preset, "-o", shot],
        "info": ["info", shot],
        "verify": ["verify", shot],
    }.items():
        found[name], _ = timed([args.meniscus, *command, "--progress", "none"])
    if args.blender:
        found["import"] = seconds_of_import(args, folder, shot)
    return found


def seconds_of_import(args, folder, shot):
    """Seconds that Blender takes to import a shot, without its own start."""
    script = folder / "import.py"
    script.write_text(IMPORT.format(extension=str(ROOT / "tools" / "blender"), shot=str(shot / "shot.json")))
    _, printed = timed([args.blender, script])
    return float(printed.split("import ")[1].split()[0])


def frames(args, folder):
    tenth, whole = (seconds_of_frames(args, folder, count) for count in (args.count // 10, args.count))
    failed = False
    for name, seconds in whole.items():
        slow = name != "shot" and (seconds > 10.0 or seconds > 10.0 * 1.5 * tenth[name] + 0.5)
        failed |= slow
        print(f"{name}: {args.count // 10} frames {tenth[name]:.2f} s, {args.count} frames {seconds:.2f} s{' TOO SLOW' if slow else ''}")
    return failed


def resident(pid):
    """Resident memory of a process in bytes, 0 when it has ended."""
    try:
        with open(f"/proc/{pid}/status") as status:
            for line in status:
                if line.startswith("VmRSS"):
                    return int(line.split()[1]) * 1024
    except OSError:
        pass
    return 0


def memory_of(command, done):
    """Peak resident memory while each number of finished frames held: `done` counts them."""
    peaks = {}
    with subprocess.Popen([*map(str, command)], stdout=subprocess.DEVNULL) as process:
        while process.poll() is None:
            number = done()
            peaks[number] = max(peaks.get(number, 0), resident(process.pid))
            time.sleep(0.05)
        if process.returncode != 0:
            sys.exit(f"{' '.join(map(str, command))}: exit {process.returncode}")
    return peaks


def table(values):
    """A table in the notation of presets."""
    return "{ " + ", ".join(f"{key} = {json.dumps(value)}" for key, value in values.items()) + " }"


def memory_of_last(args, shot, output, count):
    """Peak resident memory of a process that meshes the last `count` frames of a shot alone."""
    frames = [file.stem.removeprefix("frame_") for file in sorted(shot.glob("cache/frame_*.mcf"))]
    command = [args.meniscus, "mesh", shot, "-o", output, "--frames", f"{int(frames[-count])}-{int(frames[-1])}", "--progress", "none"]
    return max(memory_of(command, lambda: 0).values())


def particles(args, folder):
    shot = folder / "shot"
    if shot.exists():
        sys.exit(f"{shot} exists: frames that are there would not be made, so name another folder")
    failed = False
    # The proportions of the preset.
    height = args.height
    column, tank = ({"min": [0, 0, 0], "max": [part * height for part in parts]} for parts in [(1.0, 1.0, 1.0), (3.2, 1.0, 2.0)])
    options = ["--quality", "draft", "--frames", args.frames]
    options += ["--set", f"liquid.source.0.shape.box={table(column)}", "--set", f"world.collider.0.shape.tank={table(tank)}"]
    for name, command, below in [
        ("simulate", ["simulate", "dam-break", *options, "-o", shot], "cache/frame_*.mcf"),
        ("mesh", ["mesh", shot], "mesh/liquid_*.ply"),
        ("verify", ["verify", shot], None),
    ]:
        start = time.monotonic()
        count = (lambda: 0) if below is None else (lambda: sum(1 for _ in shot.glob(below)))
        peaks = memory_of([args.meniscus, *command, "--progress", "none"], count)
        seconds = time.monotonic() - start
        peak = max(peaks.values()) / 2**20
        line = f"{name}: {seconds:.0f} s, at most {peak:.0f} MiB"
        numbers = sorted(number for number in peaks if number >= 1)
        if len(numbers) >= 20:
            tenth = len(numbers) // 10
            first, last = (max(peaks[number] for number in part) / 2**20 for part in (numbers[:tenth], numbers[-tenth:]))
            line += f"; first tenth {first:.0f}, last tenth {last:.0f} MiB"
            expected = first
            if name == "mesh":
                expected = memory_of_last(args, shot, folder / "last", tenth) / 2**20
                line += f", alone {expected:.0f} MiB"
            grown = last / expected - 1.0
            failed |= grown > 0.05
            line += f" ({grown:+.1%})"
        elif below is not None:
            failed = True
            line += f"; TOO FEW FRAMES were seen to compare ({len(numbers)})"
        print(line, flush=True)
    if args.blender:
        print(f"import: {seconds_of_import(args, folder, shot):.1f} s", flush=True)
    used = sum(path.stat().st_size for path in shot.rglob("*") if path.is_file())
    print(f"files: {used / 1e9:.1f} GB")
    return failed


def jittered(command, chance):
    """Runs a command of the tool, stops and continues it at random moments, and returns its exit code; a hung one is killed."""
    deadline = time.monotonic() + LONGEST_RUN
    with subprocess.Popen([*map(str, command)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        while process.poll() is None:
            if time.monotonic() > deadline:
                process.kill()
            time.sleep(chance.uniform(0.01, 0.4))
            process.send_signal(signal.SIGSTOP)
            time.sleep(chance.uniform(0.0, 0.05))
            process.send_signal(signal.SIGCONT)
        return process.returncode


def repeat(args, folder):
    sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
    import identical

    chance = random.Random(args.seed)
    failed = 0
    for name in args.only or identical.presets([args.meniscus]):
        first, seconds = None, time.monotonic()
        for number in range(args.times):
            with tempfile.TemporaryDirectory(dir=folder) as run:
                shot, threads = pathlib.Path(run) / "shot", chance.randint(1, 4)
                command = [args.meniscus, "--threads", threads, "shot", name, "--quality", "draft", "-o", shot, "--progress", "none"]
                code = jittered(command, chance)
                found = identical.hashed([shot])
            first = first or found
            lines = identical.differences(first, found)
            if code != 0 or lines:
                failed += 1
                print(f"{name}: run {number + 1} with {threads} threads: exit code {code}", *lines, sep="\n  ", flush=True)
        print(f"{name}: {args.times} runs, {time.monotonic() - seconds:.0f} s", flush=True)
    return failed > 0


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("study", choices=["frames", "particles", "repeat"])
    parser.add_argument("--meniscus", type=pathlib.Path, default=ROOT / "target" / "release" / "meniscus")
    parser.add_argument("-o", dest="output", type=pathlib.Path, help="keeps the files here")
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--blender", metavar="PYTHON")
    parser.add_argument("--height", type=float, default=5.0)
    parser.add_argument("--frames", default="1-240")
    parser.add_argument("--times", type=int, default=10)
    parser.add_argument("--only", nargs="+", metavar="PRESET")
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    args.meniscus = args.meniscus.resolve()
    with contextlib.ExitStack() as stack:
        folder = args.output or pathlib.Path(stack.enter_context(tempfile.TemporaryDirectory()))
        folder.mkdir(parents=True, exist_ok=True)
        failed = {"frames": frames, "particles": particles, "repeat": repeat}[args.study](args, folder)
    sys.exit(int(failed))


if __name__ == "__main__":
    main()
