#!/usr/bin/env python3
"""The promise of equal bytes: presets made in many variants, each compared with the release build on two threads.

    tools/soak/same_bytes.py [--meniscus BINARY] [--variants NAME...] [--only PRESET...] [--frames N]

Variants:
    threads-1 threads-3 threads-7   other numbers of threads
    resumed                         three processes, each continuing the one before
    unoptimised                     built without optimisation, with all debug assertions
    native                          built for this machine's processor (target-cpu=native)
    nehalem                         the release build on an emulated processor without AVX (qemu-x86_64)
    musl                            built for another C library
    aarch64                         built for 64-bit Arm, on an emulated processor (qemu-aarch64)
    windows                         built for Windows, run by wine

Every preset runs the first N frames of its draft tier with its products, and the products that it does not name
(tools/soak/identical.py). Builds land in target/same_bytes/. What a variant needs and is not installed is reported as LEFT OUT, and one that does not build ends the study: qemu-user,
musl-tools, wine64 from Debian; cargo-zigbuild and ziglang from PyPI; targets by rustup. Exit code 1: some bytes differ; 2: a
variant that was named could not run. Needs numpy and zstandard.
"""

import argparse
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

import identical  # noqa: E402

BUILDS = identical.ROOT / "target" / "same_bytes"


class LeftOut(Exception):
    """What a variant needs is not installed."""


def needed(program):
    found = shutil.which(program)
    if found is None:
        raise LeftOut(f"{program} is not installed")
    return found


def built(name, *arguments, tool="build", **environment):
    """A binary built with other settings, in a folder of its own."""
    folder = BUILDS / name
    done = subprocess.run(
        ["cargo", tool, "--quiet", "--bin", "meniscus", "--target-dir", folder, *arguments],
        cwd=identical.ROOT,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
    )
    if done.returncode != 0:
        sys.exit(f"{name}: the build failed\n{done.stderr}")
    profile = "release" if "--release" in arguments else "debug"
    for found in folder.glob(f"**/{profile}/meniscus*"):
        if found.suffix in ("", ".exe") and found.is_file():
            return found
    sys.exit(f"{name}: {folder} holds no binary")


def unoptimised():
    settings = {"OPT_LEVEL": "0", "DEBUG_ASSERTIONS": "true", "OVERFLOW_CHECKS": "true"}
    packages = ["--config", 'profile.dev.package."*".opt-level=0']
    return built("unoptimised", *packages, **{f"CARGO_PROFILE_DEV_{key}": value for key, value in settings.items()})


def for_target(name, target, tool="build"):
    if tool == "zigbuild":
        needed("cargo-zigbuild")
    else:
        needed("musl-gcc")
    installed = subprocess.run(["rustup", "target", "list", "--installed"], capture_output=True, text=True).stdout.split()
    if target not in installed:
        raise LeftOut(f"rustup target add {target} has not been run")
    return built(name, "--release", "--target", target, tool=tool)


def windows():
    """The command of the Windows program, with the library that Debian's wine lacks."""
    wine = needed("wine")
    binary = for_target("windows", "x86_64-pc-windows-gnu", "zigbuild")
    missing = binary.with_name("bcryptprimitives.dll")
    source = identical.ROOT / "tools" / "soak" / "bcryptprimitives.c"
    compiler = [sys.executable, "-m", "ziglang", "cc", "-target", "x86_64-windows-gnu", "-shared"]
    subprocess.run([*compiler, "-o", missing, source, "-ladvapi32"], check=True)
    os.environ.setdefault("WINEDEBUG", "-all")
    return [wine, binary]


def variants(binary):
    """By name: a function that gives the command of the tool and its options."""
    return {
        "threads-1": lambda: ([binary], ["--threads", 1]),
        "threads-3": lambda: ([binary], ["--threads", 3]),
        "threads-7": lambda: ([binary], ["--threads", 7]),
        "resumed": lambda: ([binary], ["--threads", 2]),
        "unoptimised": lambda: ([unoptimised()], []),
        "native": lambda: ([built("native", "--release", RUSTFLAGS="-C target-cpu=native")], []),
        "nehalem": lambda: ([needed("qemu-x86_64"), "-cpu", "Nehalem", binary], []),
        "musl": lambda: ([for_target("musl", "x86_64-unknown-linux-musl")], []),
        "aarch64": lambda: ([needed("qemu-aarch64"), for_target("aarch64", "aarch64-unknown-linux-musl", "zigbuild")], []),
        "windows": lambda: (windows(), []),
    }


def made(command, options, name, frames):
    with tempfile.TemporaryDirectory() as folder:
        # Options of the whole tool stand before its commands.
        return identical.hashed(identical.make([*command, *options], name, pathlib.Path(folder), frames))


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--meniscus", type=pathlib.Path, default=identical.ROOT / "target" / "release" / "meniscus")
    parser.add_argument("--variants", nargs="+", metavar="NAME", help="only these")
    parser.add_argument("--only", nargs="+", metavar="PRESET", help="only these presets")
    parser.add_argument("--frames", type=int, default=6, metavar="N", help="frames of each preset (6)")
    args = parser.parse_args()
    if args.frames < 3:
        parser.error("--frames: three or more, so that a shot can be resumed twice")
    binary = args.meniscus.resolve()
    table = variants(binary)
    names = args.only or identical.presets([binary])
    whole = [f"1-{args.frames}"]
    parts = [f"1-{args.frames * part // 3}" for part in (1, 2, 3)]

    start = time.monotonic()
    reference = {name: made([binary], ["--threads", 2], name, whole) for name in names}
    files = sum(len(found) for patterns in reference.values() for found in patterns.values())
    print(f"release build, two threads: {len(names)} presets, {files} files, {time.monotonic() - start:.0f} s", flush=True)

    differing = missing = 0
    for variant in args.variants or table:
        start = time.monotonic()
        try:
            command, options = table[variant]()
        except LeftOut as reason:
            missing += 1
            print(f"{variant}: LEFT OUT, {reason}", flush=True)
            continue
        ready = time.monotonic()
        lines = []
        for name in names:
            found = made(command, options, name, parts if variant == "resumed" else whole)
            lines += [f"{name}: {line}" for line in identical.differences(reference[name], found)]
        differing += bool(lines)
        verdict = "differs" if lines else "identical"
        print(f"{variant}: {verdict}, {files} files, {time.monotonic() - ready:.0f} s (build {ready - start:.0f} s)", flush=True)
        for line in lines:
            print(f"  {line}", flush=True)
    if differing:
        sys.exit(f"{differing} variants differ")
    if missing and args.variants:
        sys.exit(2)


if __name__ == "__main__":
    main()
