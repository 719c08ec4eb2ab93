#!/usr/bin/env python3
"""Compares the files of two builds: every built-in preset's draft tier, byte for byte in its data.

    tools/soak/identical.py record  --meniscus BINARY [FILE]   writes hashes of the data
    tools/soak/identical.py compare --meniscus BINARY [FILE]   fails where they differ, and prints where first

FILE is tools/soak/identical.json unless given; BINARY is target/release/meniscus unless given. `--only NAME...` takes
some presets. A whole run takes about five minutes on two cores and 300 MB of disk.

Every preset runs all frames of its draft tier with the outputs it names. Other products are made of its last frames:
EXTRA_FRAMES volumes of liquid, points of smoke, meshes of sheets with a thickness, and one OBJ mesh.

Data is the content that a picture shows: time, scalars and channels of cached frames; elements, properties and bodies of PLY;
vertices, normals and faces of OBJ; transforms, trees and values of VDB grids; point caches whole. Keys, comments, versions
and metadata are left out, and so are logs, manifests and anything that holds a time of day.

Hashes hold for one instruction set and one version of zstd and Blosc: record and compare on one machine where they
differ. Needs numpy and zstandard (and tools/python/meniscus_fx/cache.py).
"""

import argparse
import collections
import hashlib
import json
import pathlib
import re
import struct
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tools" / "python"))

from meniscus_fx import cache as meniscus_cache  # noqa: E402

# Frames, the last ones, of which products are made that a preset does not name.
EXTRA_FRAMES = 3

# Hexadecimal digits kept of each file's hash.
DIGITS = 12


def run(command, *args):
    """Standard output of a command of the tool; `command` is a list, which an emulator may begin."""
    done = subprocess.run([*map(str, command), *map(str, args), "--progress", "none"], capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"meniscus {' '.join(map(str, args))}: exit {done.returncode}\n{done.stderr}")
    return done.stdout


def presets(command):
    return [line.split()[0] for line in run(command, "presets", "list").splitlines() if line.strip()]


def make(command, name, folder, frames=("",)):
    """The folders of a preset's shot and of the products that it does not name.

    `frames` are ranges, each made by a process of its own, which continues the one before.
    """
    shot = folder / "shot"
    for numbers in frames:
        run(command, "shot", name, "--quality", "draft", "-o", shot, *(["--frames", numbers] if numbers else []))
    frames = sorted((shot / "cache").glob("frame_*.mcf"))
    streams = meniscus_cache.read_header(frames[-1])["streams"]
    numbers = [int(re.search(r"\d+", frame.name).group()) for frame in frames[-EXTRA_FRAMES:]]
    last = ",".join(map(str, numbers))
    made = [shot]

    def extra(label, *args):
        made.append(folder / label)
        run(command, *args, "-o", folder / label)

    if "liquid" in streams:
        extra("volume", "volume", shot, "--frames", last)
        extra("obj", "mesh", shot, "--format", "obj", "--frames", numbers[-1])
    if "smoke" in streams:
        extra("points", "export", shot, "--frames", last)
    if any(stream.startswith("sheet.") for stream in streams):
        extra("thick", "export", shot, "--format", "ply", "--thickness", "0.01", "--frames", last)
    return made


def cache_data(path):
    frame = meniscus_cache.read(path)
    yield struct.pack("<Id", frame["frame"], frame["time"])
    for name, stream in sorted(frame["streams"].items()):
        yield f"{name} {stream['len']}".encode()
        for scalar, value in sorted(stream["scalars"].items()):
            yield scalar.encode() + struct.pack("<d", value)
        for channel, values in sorted(stream["channels"].items()):
            yield f"{channel} {values.dtype} {values.shape}".encode()
            yield values.tobytes()


def ply_data(path):
    data = path.read_bytes()
    end = data.index(b"end_header\n") + len(b"end_header\n")
    yield from (line for line in data[:end].splitlines(True) if not line.startswith(b"comment"))
    yield data[end:]


def obj_data(path):
    yield from (line for line in path.read_bytes().splitlines(True) if not line.startswith(b"#"))


def vdb_data(path):
    """Name, type, transform and tree of every grid (the layout: docs/formats/volume.md)."""
    data = path.read_bytes()
    at = 8 + 4 + 8 + 1 + 36

    def number():
        nonlocal at
        at += 4
        return struct.unpack_from("<I", data, at - 4)[0]

    def text():
        nonlocal at
        length = number()
        at += length
        return data[at - length : at]

    def skip_metadata():
        for _ in range(number()):
            for _ in range(3):
                text()

    skip_metadata()
    for _ in range(number()):
        yield text() + b" " + text()
        text()
        first, _, end = struct.unpack_from("<3q", data, at)
        at = first + 4
        skip_metadata()
        yield data[at:end]
        at = end


READERS = {".mcf": cache_data, ".ply": ply_data, ".obj": obj_data, ".vdb": vdb_data, ".pc2": lambda path: [path.read_bytes()]}

# Folders whose files are products or frames.
FOLDERS = ["cache", "mesh", "volume", "points", "sheet"]


def hashed(folders):
    """Hashes by file name with `#` for digits, each with its number: {"shot/cache/frame_#.mcf": {"0001": hash}}."""
    found = collections.defaultdict(dict)
    for folder in folders:
        for below in FOLDERS:
            for path in sorted((folder / below).glob("*")):
                reader = READERS.get(path.suffix)
                if reader is None:
                    continue
                digest = hashlib.sha256()
                for part in reader(path):
                    digest.update(struct.pack("<Q", len(part)))
                    digest.update(part)
                number = re.search(r"\d*$", path.stem).group()
                pattern = f"{folder.name}/{below}/{path.stem[: len(path.stem) - len(number)]}{'#' if number else ''}{path.suffix}"
                found[pattern][number] = digest.hexdigest()[:DIGITS]
    return dict(found)


def dump(all_hashes):
    """JSON with one line a pattern: "frame=hash frame=hash …"."""
    lines = {
        name: {pattern: " ".join(f"{number}={value}" for number, value in files.items()) for pattern, files in patterns.items()}
        for name, patterns in all_hashes.items()
    }
    return json.dumps(lines, indent=1) + "\n"


def load(path):
    return {
        name: {pattern: dict(entry.split("=") for entry in files.split()) for pattern, files in patterns.items()}
        for name, patterns in json.loads(path.read_text()).items()
    }


def differences(expected, found):
    """One line for each pattern of a preset that differs."""
    lines = []
    for pattern in sorted(expected.keys() | found.keys()):
        old, new = expected.get(pattern, {}), found.get(pattern, {})
        missing, extra = sorted(old.keys() - new.keys()), sorted(new.keys() - old.keys())
        differing = sorted(number for number in old.keys() & new.keys() if old[number] != new[number])
        if not new or not old:
            lines.append(f"{pattern}: {'not written' if not new else 'not recorded'}")
        elif missing or extra or differing:
            parts = [("differ", differing), ("missing", missing), ("not recorded", extra)]
            lines.append(f"{pattern}: " + ", ".join(f"{len(list_)} {what}, first {list_[0] or 'whole'}" for what, list_ in parts if list_))
    return lines


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("action", choices=["record", "compare"])
    parser.add_argument("file", nargs="?", type=pathlib.Path, default=pathlib.Path(__file__).with_suffix(".json"))
    parser.add_argument("--meniscus", type=pathlib.Path, default=ROOT / "target" / "release" / "meniscus", help="the binary")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="only these presets")
    args = parser.parse_args()
    binary = args.meniscus.resolve()

    recorded = load(args.file) if args.action == "compare" or (args.only and args.file.exists()) else {}
    names = args.only or presets([binary])
    if args.action == "compare" and not args.only:
        names = sorted({*names, *recorded})
    failed = 0
    for name in names:
        start = time.monotonic()
        with tempfile.TemporaryDirectory() as folder:
            found = hashed(make([binary], name, pathlib.Path(folder)))
        lines = []
        if args.action == "record":
            recorded[name] = found
        else:
            lines = differences(recorded.get(name, {}), found)
            failed += bool(lines)
        verdict = "differs" if lines else "identical" if args.action == "compare" else "recorded"
        print(f"{name}: {verdict}, {sum(map(len, found.values()))} files, {time.monotonic() - start:.0f} s", flush=True)
        for line in lines:
            print(f"  {line}", flush=True)
    if args.action == "record":
        args.file.write_text(dump(dict(sorted(recorded.items()))))
    if failed:
        sys.exit(f"{failed} of {len(names)} presets differ")


if __name__ == "__main__":
    main()
