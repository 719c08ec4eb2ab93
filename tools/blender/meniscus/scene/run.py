# SPDX-License-Identifier: MIT OR Apache-2.0
"""Jobs of the engine as Blender sees them: start, stop, and what their logs report. Reading never waits.

A job runs in a session of its own (runner.py) and writes logs into the folder `run` next to the preset. Blender reads what was
added to them, so a job is the same whether this Blender started it or another that was closed.
"""

import json
import os
import re
import subprocess
import sys
import time
import uuid
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from ..folder import read_limited
from ..messages import ShotError, printable
from . import assets, runner
from .names import QUALITIES

RUN, SHOWN_MESSAGES = "run", 200
MAX_STATE_BYTES, MAX_PLAN_BYTES = 1 << 16, 4 << 20
# Read from a log at once: a second of the fastest engine has some kilobytes.
MAX_READ, MAX_LOG = 1 << 18, 1 << 26
MAX_LINE = 1 << 16
# A job has its lock after this time, or has not started.
START_SECONDS = 30.0
# What is made while a simulation runs, and the command for it: those that follow its frames one by one, and those that are repeated for
# all frames so far, as their files hold all frames or a frame needs those before it.
SURFACES, VOLUMES, SHEETS, SOLIDS, WHITEWATER = "surfaces", "volumes", "sheets", "solids", "whitewater"
FOLLOWING = {SURFACES: ["mesh", "{}", "--follow"], VOLUMES: ["volume", "{}", "--follow"]}
REPEATED = {SHEETS: ["export", "{}", "--format", "pc2"], SOLIDS: ["colliders", "{}"], WHITEWATER: ["whitewater", "{}"]}
# The log of what is wrong with a preset.
PROBLEMS = runner.PROBLEMS
# The steps of a job and what they are for.
LABELS = {"simulate": "Simulating", "outputs": "Writing outputs", "plan": "Planning", "mesh": "Meshing", "whitewater": "Whitewater", "colliders": "Writing bodies"}
REASONS = {
    1: "failed",
    2: "the preset is refused",
    3: "some frames failed",
    10: "there are no frames yet. Simulate first",
    11: "the folder is locked by another process",
    12: "a file is corrupt",
    13: "the folder is of another version of Meniscus",
    14: "the folder has frames of other settings. Start Over replaces them, another folder keeps them",
    20: "the simulation diverged",
    28: "the disk is full",
    33: "more memory is needed than is allowed",
}
PAUSED = runner.INTERRUPTED
# Part of the engine's note on a frame without particles.
EMPTY = "no particles, so its"
# The frame in the name of a file of the cache.
CACHED = re.compile(r"frame_(\d{1,9})\.mcf")


class Log:
    """Complete lines that were added to a file since the last look."""

    def __init__(self, path: Path) -> None:
        self.path, self.offset, self.rest = path, 0, b""

    def all_lines(self) -> Iterator[list[str]]:
        """What is left of the log of a job that has ended, part by part."""
        first, before = self.offset, -1
        while self.offset != before and self.offset - first < MAX_LOG:
            before = self.offset
            yield self.lines()
        if self.offset != before:
            yield [f"{self.path.name}: longer than {MAX_LOG >> 20} MiB; the rest is not shown"]

    def lines(self) -> list[str]:
        if not self.path.is_file():
            return []
        try:
            with open(self.path, "rb") as file:
                file.seek(self.offset)
                added = file.read(MAX_READ)
        except OSError:
            return []
        self.offset += len(added)
        *whole, self.rest = (self.rest + added).split(b"\n")
        # A line without an end is no line of the engine.
        self.rest = self.rest[:MAX_LINE]
        return [line[:MAX_LINE].decode("utf-8", "replace") for line in whole if line]


@dataclass
class Progress:
    """What the events of one log add up to."""

    job: str = ""
    percent: float = 0.0
    # Of the first look that found some, and when that was.
    first_percent: float | None = None
    first_time: float = 0.0
    frames: set[int] = field(default_factory=set)

    def add(self, event: str, data: dict) -> None:
        if event == "begin":
            self.job, self.percent, self.first_percent = str(data.get("text", "")).partition(":")[0], 0.0, None
        elif event == "progress" and isinstance(data.get("percent"), (int, float)):
            self.percent = min(max(float(data["percent"]), 0.0), 100.0)
        elif event == "frame":
            _, _, number = str(data.get("text", "")).partition("frame ")
            digits = number.split(" ")[0]
            if digits.isdecimal() and len(digits) < 10:
                self.frames.add(int(digits))

    def end_look(self) -> None:
        """A look at the log has ended: speed counts from the first that found a percentage, which may be that of earlier frames."""
        if self.first_percent is None and self.percent > 0.0:
            self.first_percent, self.first_time = self.percent, time.time()


class Job:
    """One job of a folder: running, or as it ended."""

    def __init__(self, root: Path) -> None:
        self.root, self.folder = root, root / RUN
        self.process: subprocess.Popen | None = None
        self.messages: deque[str] = deque(maxlen=SHOWN_MESSAGES)
        self.error = ""
        # Frames without particles.
        self.empty: set[int] = set()
        self.is_running = False
        self.code: int | None = None
        self.description: dict = {}
        self.state: dict = {}
        self.logs: dict[str, Log] = {}
        self.progress: dict[str, Progress] = {}

    @property
    def owner(self) -> str:
        """The .blend and scene that started the job."""
        return f"{os.path.basename(str(self.description.get('blend') or 'another Blender'))}, {self.description.get('scene', '')}"

    @property
    def tier(self) -> str:
        return str(self.description.get("tier", ""))

    @property
    def action(self) -> str:
        return str(self.description.get("action", ""))

    @property
    def step(self) -> str:
        return str(self.state.get("step", ""))

    @property
    def shot(self) -> Path:
        """The folder of the shot."""
        return self.root / (self.tier if self.tier in QUALITIES else QUALITIES[-1])

    def is_stopping(self) -> bool:
        return self.is_running and (self.folder / "stop").exists()

    def update(self) -> bool:
        """Reads what is new; whether anything changed. Never waits."""
        if self.process is not None:
            self.process.poll()
        was_running, had = self.is_running, (self.step, len(self.messages), self.percent())
        # First the lock, then the state: what a job writes before its end is then read.
        locked = is_locked(self.folder)
        state = read_json(self.folder / "state.json", MAX_STATE_BYTES)
        is_of_job = state.get("id") == self.description.get("id")
        self.state = state if is_of_job else {}
        self.is_running = (locked and is_of_job) or self.is_starting(is_of_job)
        for name in [*FOLLOWING, PROBLEMS, *(step["name"] for step in self.description.get("steps", []))]:
            self.read(name)
        if not self.is_running:
            if self.empty:
                self.messages.append(f"{len(self.empty)} frame(s) are empty: there were no particles")
                self.empty.clear()
            code = self.state.get("code")
            self.code = code if isinstance(code, int) else None
            if self.code in (0, PAUSED):
                # The engine reports an interruption as an error.
                self.error = ""
            elif was_running:
                self.error = self.error or self.reason()
        return was_running != self.is_running or had != (self.step, len(self.messages), self.percent())

    def is_starting(self, is_of_job: bool) -> bool:
        """Whether the process of a job, of this Blender or of one that was closed, may still come to its lock."""
        if is_of_job or (self.process is not None and self.process.poll() is not None):
            return False
        started = self.description.get("started")
        return isinstance(started, (int, float)) and 0.0 <= time.time() - started < START_SECONDS

    def read(self, name: str) -> None:
        """Takes the new events of one log."""
        log = self.logs.setdefault(name, Log(self.folder / f"{name}.log"))
        progress = self.progress.setdefault(name, Progress())
        parts = [log.lines()] if self.is_running else log.all_lines()
        for line in (line for part in parts for line in part):
            try:
                entry = json.loads(line)
                event, data = entry["event"], entry["data"]
                progress.add(event, data)
                text = printable(data.get("text", ""), 2000)
            except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
                # Not JSON: usage errors, diagnostics of a preset, what a system's library prints.
                self.messages.append(printable(line, 2000))
                continue
            if event == "error":
                self.error = text
            if event == "note" and EMPTY in text:
                # One for each frame before an emitter starts, of each product.
                self.empty.add(int((CACHED.findall(text) or [-1])[-1]))
            # Several commands of a job note the same.
            elif event == "note" and text not in self.messages:
                self.messages.append(text)
        progress.end_look()

    def reason(self) -> str:
        """Why a job ended without its result."""
        if isinstance(self.state.get("error"), str):
            return printable(self.state["error"], 500)
        if self.code is None:
            started = self.process is not None and not self.state
            code = self.process.poll() if self.process is not None else None
            if started and code == runner.LOCKED:
                return REASONS[11]
            # A runner that ends by itself without a state could not write it, and printed why.
            printed = self.last_printed() if code is not None and code > 0 else ""
            return printed or ("the job did not start" if started else "the job was ended from outside; Resume continues it")
        return REASONS.get(self.code, f"exit code {self.code}")

    def last_printed(self) -> str:
        """The last line that the runner itself printed; empty if there is none."""
        lines = Log(self.folder / "runner.log").lines()
        return printable(lines[-1], 500) if lines else ""

    def percent(self) -> float:
        return self.progress.get(self.step, Progress()).percent

    def eta(self) -> float | None:
        """Seconds until the end of the step at the mean speed since the first look; None if that is not known."""
        progress = self.progress.get(self.step)
        if progress is None or progress.first_percent is None:
            return None
        done, elapsed = progress.percent - progress.first_percent, time.time() - progress.first_time
        return elapsed * (100.0 - progress.percent) / done if done > 1.0 and elapsed > 2.0 else None

    def frames_of(self, product: str) -> set[int]:
        """Frames of which this job has reported a product that follows the simulation."""
        return self.progress.get(product, Progress()).frames

    def passes(self) -> dict[str, int]:
        """How often each product was made that is repeated."""
        found = self.state.get("passes")
        found = found if isinstance(found, dict) else {}
        return {name: count for name, count in found.items() if name in REPEATED and isinstance(count, int)}

    def products(self) -> set[str]:
        """What is made while the job simulates."""
        steps = self.description.get("steps")
        lists = [step.get(key, []) for step in steps if isinstance(step, dict) for key in ("follow", "repeat")] if isinstance(steps, list) else []
        names = {each.get("name") for some in lists if isinstance(some, list) for each in some if isinstance(each, dict)}
        return names & (FOLLOWING.keys() | REPEATED.keys())

    def stop(self) -> None:
        """Pauses the job: the engine finishes its step, and keeps its frames. Raises ShotError."""
        assets.write(self.folder / "stop", b"")


def check_free(root: Path) -> None:
    """Raises ShotError while a job of any Blender reads the files of a folder."""
    if is_locked(root / RUN):
        raise ShotError(f"{printable(root)}: a job is running in this folder. Pause it, or wait for its end")


def is_locked(folder: Path) -> bool:
    """Whether a process holds the lock of a folder; a file alone, or a number of a process in it, proves nothing."""
    path = folder / "lock"
    if not path.is_file() or path.is_symlink():
        return False
    try:
        with open(path, "r+b") as file:
            return not runner.try_lock(file)
    except OSError:
        return False


def read_json(path: Path, limit: int) -> dict:
    """A JSON object from a file that a runner wrote; empty if there is none."""
    if not path.is_file():
        return {}
    try:
        data = json.loads(read_limited(path, limit, "Remove it"))
    except (ShotError, ValueError, RecursionError):
        return {}
    return data if isinstance(data, dict) else {}


def start(root: Path, program: Path, action: str, tier: str, steps: list[dict], frames: list[int], blend: str = "", scene: str = "") -> Job:
    """Starts a job of the folder for a scene of a .blend. Raises ShotError if one is running, or the folder cannot be written."""
    job = Job(root)
    try:
        job.folder.mkdir(parents=True, exist_ok=True)
        inside = os.path.realpath(job.folder) == os.path.join(os.path.realpath(root), RUN)
    except OSError as error:
        raise assets.cannot_write(job.folder, error) from None
    if not inside:
        raise ShotError(f"{printable(job.folder)}: leads out of the folder through a symbolic link. Remove it")
    if is_locked(job.folder):
        raise ShotError(f"{printable(root)}: a job is running in this folder. Pause it, or wait for its end")
    try:
        logs = [f"{step}.{ending}" for step in {*LABELS, *FOLLOWING, *REPEATED, PROBLEMS} for ending in ("log", "out")]
        for name in ["stop", "state.json", *logs]:
            (job.folder / name).unlink(missing_ok=True)
    except OSError as error:
        raise assets.cannot_write(job.folder, error) from None
    job.description = {
        "id": uuid.uuid4().hex,
        "started": time.time(),
        "action": action,
        "tier": tier,
        "program": str(program),
        "cwd": str(root),
        "steps": steps,
        "frames": frames,
        "blend": blend,
        "scene": scene,
    }
    assets.write(job.folder / "job.json", json.dumps(job.description, indent=1).encode("utf-8"))
    # A console without a window: a process without any cannot send the event that stops the engine.
    flags = {"creationflags": subprocess.CREATE_NO_WINDOW | subprocess.CREATE_NEW_PROCESS_GROUP} if os.name == "nt" else {}
    options = flags or {"start_new_session": True}
    command = [sys.executable, "-I", "-S", str(Path(runner.__file__)), str(job.folder)]
    try:
        with runner.open_own(job.folder / "runner.log") as log:
            job.process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=log, stderr=log, close_fds=True, **options
            )
    except OSError as error:
        raise ShotError(f"{printable(sys.executable)}: cannot be started ({printable(error, 200)})") from None
    job.is_running = True
    return job


def last_id(root: Path) -> object:
    """The number of the last job of a folder; None if there is none."""
    return read_json(root / RUN / "job.json", MAX_STATE_BYTES).get("id")


def attach(root: Path) -> Job | None:
    """The last job of a folder, which may be running; None if there was none."""
    job = Job(root)
    job.description = read_json(job.folder / "job.json", MAX_STATE_BYTES)
    steps = job.description.get("steps")
    is_sound = isinstance(steps, list) and all(isinstance(step, dict) and step.get("name") in LABELS for step in steps)
    if not is_sound or not isinstance(job.description.get("id"), str):
        return None
    job.update()
    if not job.is_running and job.code not in (0, PAUSED):
        job.error = job.error or job.reason()
    return job


def steps_of(action: str, tier: str, preset: Path, changes: list[str], threads: int, products: set[str]) -> list[dict]:
    """The engine's commands of an action; `changes` are values for --set, `products` are made while frames arrive."""
    common = ["--progress", "json", *(["--threads", str(threads)] if threads else [])]
    of_preset = [preset.name, "--quality", tier]
    if action == "plan":
        return [{"name": "plan", "arguments": ["plan", *of_preset, "--json", *common]}]
    if action in ("mesh", "whitewater"):
        sets = [part for change in changes for part in ("--set", change)]
        return [{"name": action, "arguments": [action, tier, *sets, *common]}]
    force = ["--force"] if action == "start_over" else []
    simulate = {"name": "simulate", "arguments": ["simulate", *of_preset, "-o", tier, *force, *common]}
    for key, table in (("follow", FOLLOWING), ("repeat", REPEATED)):
        commands = [(name, [part.format(tier) for part in command]) for name, command in table.items() if name in products]
        if commands:
            simulate[key] = [{"name": name, "arguments": [*command, *common]} for name, command in commands]
    steps = [simulate, {"name": "outputs", "arguments": ["shot", *of_preset, "-o", tier, *common]}]
    # Bodies are written with other outputs, and are no output that a preset can name.
    return steps + ([{"name": "colliders", "arguments": ["colliders", tier, *common]}] if products == {SOLIDS} else [])
