# SPDX-License-Identifier: MIT OR Apache-2.0
"""Runs the engine's commands of one job in a session of its own, so that they go on when Blender is closed.

    python runner.py FOLDER

FOLDER/job.json names the commands. This script holds the lock FOLDER/lock as long as it runs, writes the output of each command
to a log, and its own state to FOLDER/state.json. A file FOLDER/stop ends the job: the engine gets the signal to stop and
keeps its frames. Nothing but Python's standard library in here.
"""

import errno
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

REFUSED, LOCKED, INTERRUPTED = 2, 11, 130
PROBLEMS = "problems"
POLL_SECONDS = 0.1
# Longer than the engine takes to come to an end after its signal: it leaves by itself after 4 s.
STOP_SECONDS = 15.0
REPLACE_ATTEMPTS = 20
# Between two commands that are repeated, at least.
PASS_SECONDS = 1.0
# Errors of a lock that another process holds.
HELD = {errno.EWOULDBLOCK, errno.EAGAIN, errno.EACCES, errno.EDEADLK}


def try_lock(file) -> bool:
    """Takes the operating system's lock of an open file, unless another process holds it. It ends with the process."""
    try:
        if os.name == "nt":
            import msvcrt

            file.seek(1 << 20)
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        # Another error, as of a file system without locks, does not mean that a process holds it.
        if error.errno in HELD:
            return False
        raise
    return True


def write_state(folder: Path, state: dict) -> None:
    temporary = folder / f".state.{os.getpid()}.tmp"
    with open_own(temporary) as file:
        file.write(json.dumps(state).encode("utf-8"))
    for attempt in range(REPLACE_ATTEMPTS):
        try:
            os.replace(temporary, folder / "state.json")
            return
        except PermissionError:
            # Windows replaces no file that Blender reads at this moment.
            if attempt + 1 == REPLACE_ATTEMPTS:
                raise
            time.sleep(POLL_SECONDS)


def open_own(path: Path):
    """Opens a new file for writing in the place of what is there, which is not followed if it is a symbolic link."""
    path.unlink(missing_ok=True)
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
    return os.fdopen(os.open(path, flags, 0o666), "wb")


def open_lock(path: Path):
    """Opens the lock, a regular file that is made if it is not there."""
    flags = os.O_RDWR | os.O_CREAT | getattr(os, "O_BINARY", 0) | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    return os.fdopen(os.open(path, flags, 0o666), "r+b")


def print_error(text: str) -> None:
    """Prints a line to runner.log, unless its disk is full as well."""
    try:
        print(text, file=sys.stderr, flush=True)
    except OSError:
        pass


class Runner:
    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.job = json.loads((folder / "job.json").read_text(encoding="utf-8"))
        self.is_stopped = False
        self.state = {"id": self.job["id"], "step": "", "code": None}

    def start(self, arguments: list[str], log: str) -> subprocess.Popen:
        """Starts the engine with its messages in LOG.log and its results in LOG.out."""
        options = {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP} if os.name == "nt" else {}
        with open_own(self.folder / f"{log}.out") as out, open_own(self.folder / f"{log}.log") as messages:
            command = [self.job["program"], *arguments]
            return subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=out, stderr=messages, cwd=self.job["cwd"], **options)

    def stop(self, process: subprocess.Popen) -> None:
        """The signal to stop, which keeps finished frames; then an end by force."""
        if process.poll() is None:
            try:
                process.send_signal(signal.CTRL_BREAK_EVENT if os.name == "nt" else signal.SIGTERM)
                process.wait(STOP_SECONDS)
            except (OSError, subprocess.TimeoutExpired):
                process.kill()
                process.wait()

    def wants_stop(self) -> bool:
        self.is_stopped = self.is_stopped or (self.folder / "stop").exists()
        return self.is_stopped

    def has_begun(self, log: str) -> bool:
        return b'"begin"' in (self.folder / f"{log}.log").read_bytes()[:65536]

    def run_step(self, step: dict) -> int:
        """One command, with it those that follow its frames or are repeated while it runs; the exit code."""
        self.state |= {"step": step["name"], "passes": {}}
        write_state(self.folder, self.state)
        main, followers = self.start(step["arguments"], step["name"]), []
        passes = Passes(self, step)
        try:
            while any(process.poll() is None for process in (main, *followers)) or passes.is_running():
                is_running = main.poll() is None
                if self.wants_stop() or (not is_running and main.returncode != 0):
                    break
                # What an earlier simulation left is gone only once this one has begun.
                if is_running and not followers and step.get("follow") and self.has_begun(step["name"]):
                    followers = [self.start(each["arguments"], each["name"]) for each in step["follow"]]
                passes.look(may_start=is_running)
                time.sleep(POLL_SECONDS)
        finally:
            # Also after an error, such as a log that is gone: no engine goes on without its runner.
            for process in (main, *followers, passes.process):
                if process:
                    self.stop(process)
        if self.is_stopped:
            return INTERRUPTED
        if main.returncode == REFUSED:
            self.explain(step["arguments"])
        # A product that could not be made meanwhile is made by the next step, which reports what is wrong with it.
        return main.returncode

    def explain(self, arguments: list[str]) -> None:
        """Runs a command that refuses its preset again, as its JSON events lack the lines that are wrong."""
        again = ["none" if argument == "json" else argument for argument in arguments]
        process = self.start(again, PROBLEMS)
        try:
            process.wait(STOP_SECONDS)
        except subprocess.TimeoutExpired:
            self.stop(process)

    def run(self) -> int:
        code = 0
        for step in self.job["steps"]:
            code = INTERRUPTED if self.wants_stop() else self.run_step(step)
            if code != 0:
                break
        self.state["code"] = code
        self.write_end()
        return code

    def write_end(self) -> None:
        """The last state; if it cannot be written, the exit code of this process and its log are what is left."""
        try:
            write_state(self.folder, self.state)
        except OSError as error:
            print_error(f"{self.folder}: the state cannot be written ({error})")


class Passes:
    """Commands of a step that make their files of all frames so far: one at a time, again when there are new frames.

    Each rests four times as long as it ran, so that it takes at most a fifth of the time; `passes` of the state counts those that
    succeeded.
    """

    def __init__(self, runner: Runner, step: dict) -> None:
        self.runner, self.commands = runner, step.get("repeat", [])
        self.log = runner.folder / f"{step['name']}.log"
        self.offset, self.frames = 0, 0
        # The frames that each command has seen, and when it may start again.
        self.seen: dict[str, int] = {}
        self.next_start: dict[str, float] = {}
        self.process, self.name, self.started, self.ended = None, "", 0.0, 0.0

    def is_running(self) -> bool:
        return self.process is not None and self.process.poll() is None

    def look(self, may_start: bool) -> None:
        """Ends a command that is done, and starts the next if there are new frames for it. Its errors do not end the simulation."""
        if self.is_running():
            return
        now = time.monotonic()
        try:
            self.advance(now, may_start)
        except OSError as error:
            # Such as a full disk. The next pass comes with new frames, the count of passes with the next state.
            self.ended = now
            print_error(f"{self.runner.folder}: {self.name or 'passes'}: a pass is left out ({error})")

    def advance(self, now: float, may_start: bool) -> None:
        if self.process is not None:
            is_made = self.process.returncode == 0
            self.process, self.ended = None, now
            self.next_start[self.name] = now + 4.0 * (now - self.started)
            if is_made:
                counts = self.runner.state["passes"]
                counts[self.name] = counts.get(self.name, 0) + 1
                write_state(self.runner.folder, self.runner.state)
        if not may_start or not self.commands or now < self.ended + PASS_SECONDS:
            return
        self.count_frames()
        waiting = [each for each in self.commands if self.next_start.get(each["name"], 0.0) <= now and self.seen.get(each["name"], 0) < self.frames]
        if waiting:
            command = min(waiting, key=lambda each: self.seen.get(each["name"], 0))
            self.name, self.started, self.seen[command["name"]] = command["name"], now, self.frames
            self.process = self.runner.start(command["arguments"], command["name"])

    def count_frames(self) -> None:
        """Counts the frames that the main command has reported."""
        with open(self.log, "rb") as file:
            file.seek(self.offset)
            added = file.read()
        whole = added.rfind(b"\n") + 1
        self.offset += whole
        self.frames += added[:whole].count(b'"event":"frame"')


def main() -> int:
    folder = Path(sys.argv[1])
    with open_lock(folder / "lock") as lock:
        try:
            # Blender looks at the lock for moments.
            for _ in range(20):
                if try_lock(lock):
                    break
                time.sleep(POLL_SECONDS)
            else:
                return LOCKED
        except OSError as error:
            runner = Runner(folder)
            runner.state |= {"code": 1, "error": f"the file system of the folder has no locks ({error}). Choose a folder on a local disk"}
            runner.write_end()
            return 1
        runner = Runner(folder)

        def end(*_) -> None:
            runner.is_stopped = True

        signal.signal(signal.SIGTERM, end)
        signal.signal(signal.SIGINT, end)
        try:
            return runner.run()
        except OSError as error:
            runner.state |= {"code": 1, "error": str(error)}
            runner.write_end()
            return 1


if __name__ == "__main__":
    sys.exit(main())
