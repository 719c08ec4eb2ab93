#!/usr/bin/env python3
"""Lets system calls, memory and disks fail while jobs run, and continues the jobs: is anything lost or wrong then?

    tools/soak/faults.py [MENISCUS] [--calls N] [--only JOB...]

Calls: with `strace`, the n-th fsync, fdatasync, rename, openat and write of a job fails, for n from 1 until it has no such call, or --calls
times. Memory: the job runs under address-space limits from too little for the program to enough. Disk: on a tmpfs that is
too small (needs the right to mount). After each the job may fail, by a documented exit code and with a message, but the same
command without the fault must then end with 0, `verify` must find everything valid, and every file and line of the logs must
equal those of an undisturbed run.
Prints the exit codes of every part; exits with 1 at the first difference. Parts that cannot run here are named. Every job in turn,
or those named by --only: two processes with different ones can run next to each other.

Needs only Python's standard library, and Linux.
"""

import argparse
import collections
import itertools
import pathlib
import resource
import shutil
import subprocess
import sys
import tempfile

from kills import JOBS, PRESET, ROOT, content, run

# Exit codes that a fault may have: failed, some frames failed, lost frames, disk full, over memory.
FAILED, SOME_FAILED, MISSING, DISK_FULL, OVER_MEMORY = 1, 3, 10, 28, 33
MIB = 1 << 20
PAGE = 4096


class Study:
    """A job that fails again and again, in a new folder each time."""

    def __init__(self, binary, name, parent):
        self.binary, self.name, self.parent = binary, name, parent
        self.job, self.before = JOBS[name]
        self.folder = None
        folder = self.start()
        run(binary, self.job, folder)
        self.whole = content(folder / "out")

    def start(self, at=None):
        """A folder in which everything that the job needs is done."""
        if self.folder:
            shutil.rmtree(self.folder, ignore_errors=True)
        folder = at or self.parent / self.name
        folder.mkdir(exist_ok=True)
        (folder / "kills.toml").write_text(PRESET)
        for line in self.before:
            run(self.binary, line, folder)
        self.folder = None if at else folder
        return folder

    def fail(self, folder, wrapper=(), limit=None):
        """Runs the job with a fault; its exit code, and what it wrote to stderr."""

        def restrict():
            if limit:
                resource.setrlimit(resource.RLIMIT_AS, (limit, limit))

        command = [*wrapper, self.binary, *self.job, "--progress", "none", "--threads", "2"]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, preexec_fn=restrict)
        return done.returncode, done.stderr

    def check(self, folder, label, code, message, expected):
        """What must hold after a fault."""
        if code not in (0, *expected):
            sys.exit(f"{self.name}, {label}: exit {code}, expected 0 or one of {expected}\n{message}")
        # Where writing fails, the message may be what could not be written.
        if code and "error" not in message and not label.startswith("write"):
            sys.exit(f"{self.name}, {label}: exit {code} without a message")
        run(self.binary, self.job, folder)
        run(self.binary, ["verify", "out"], folder)
        found = content(folder / "out")
        for name in sorted(self.whole.keys() | found.keys()):
            if self.whole.get(name) != found.get(name):
                sys.exit(f"{self.name}, {label}: {name} differs from that of an undisturbed run")


def calls(study, most):
    """The n-th call of a kind fails."""
    codes = collections.Counter()
    for call, error in [("fsync", "EIO"), ("fdatasync", "EIO"), ("rename", "EIO"), ("write", "ENOSPC"), ("openat", "EMFILE")]:
        # Other names of the same call; the program's own start opens its libraries.
        names = {"rename": "rename,renameat,renameat2", "write": "write,pwrite64,writev"}.get(call, call)
        first = 12 if call == "openat" else 1
        for number in itertools.count(first) if most is None else range(first, first + most):
            folder = study.start()
            trace = study.parent / "trace"
            inject = ["strace", "-f", "-o", trace, "-e", f"trace={names}", "-e", f"inject={names}:error={error}:when={number}"]
            code, message = study.fail(folder, wrapper=inject)
            study.check(folder, f"{call} {number}", code, message, (FAILED, SOME_FAILED, MISSING, DISK_FULL))
            # The job has no further call of this kind.
            if "(INJECTED)" not in trace.read_text(errors="replace"):
                break
            codes[f"{call} {code}"] += 1
    return codes


def memory(study):
    """Limits of the address space, up to what the job needs."""
    codes = collections.Counter()
    for mib in range(32, 200, 4):
        folder = study.start()
        code, message = study.fail(folder, limit=mib * MIB)
        # Threads that cannot be started are a wrong request: code 2.
        study.check(folder, f"{mib} MiB", code, message, (2, OVER_MEMORY))
        codes[code] += 1
    return codes


def disk(study):
    """File systems of all sizes up to what the job needs."""
    codes = collections.Counter()
    # What is there before the job, in whole pages.
    needed = sum(PAGE + -(-file.lstat().st_size // PAGE) * PAGE for file in study.start().rglob("*"))
    mount = study.parent / "disk"
    mount.mkdir(exist_ok=True)
    for part in range(12):
        size = needed + (4 + 16 * part) * PAGE
        made = subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", mount], capture_output=True, text=True, check=False)
        if made.returncode != 0:
            print(f"LEFT OUT: full disks ({made.stderr.strip()})")
            break
        try:
            folder = study.start(mount)
            code, message = study.fail(folder)
            if code not in (0, DISK_FULL):
                sys.exit(f"{study.name}, {size} bytes of disk: exit {code}, expected 28\n{message}")
            codes[code] += 1
            subprocess.run(["mount", "-o", "remount,size=64m", mount], check=True)
            study.check(folder, f"{size} bytes of disk", code, message, (DISK_FULL,))
        finally:
            subprocess.run(["umount", mount], check=True)
    return codes


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("binary", nargs="?", type=pathlib.Path, default=ROOT / "target/release/meniscus")
    parser.add_argument("--calls", type=int, help="calls of each kind that fail at most, one a run")
    parser.add_argument("--only", nargs="+", choices=JOBS, default=list(JOBS), metavar="JOB", help=f"only these of {', '.join(JOBS)}")
    args = parser.parse_args()
    binary = args.binary.resolve()
    can_inject = shutil.which("strace") is not None
    if not can_inject:
        print("LEFT OUT: failing system calls (strace is not installed)")
    with tempfile.TemporaryDirectory() as parent:
        for name in args.only:
            study = Study(binary, name, pathlib.Path(parent))
            parts = {"memory": memory(study), "disk": disk(study)}
            if can_inject:
                parts["calls"] = calls(study, args.calls)
            for part, codes in parts.items():
                print(f"{name}, {part}: " + ", ".join(f"{code} ×{count}" for code, count in sorted(codes.items(), key=str)), flush=True)


if __name__ == "__main__":
    main()
