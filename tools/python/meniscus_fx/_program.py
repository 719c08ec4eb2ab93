# SPDX-License-Identifier: MIT OR Apache-2.0
"""The program `meniscus` of the package: its path, and its jobs as processes with progress."""

from __future__ import annotations

import collections
import json
import os
import re
import signal
import stat
import subprocess
import sys
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Callable, Mapping, Sequence

from . import _toml
from ._errors import MeniscusError, ParameterError, ProgramError

# Last lines that are kept for the message of a failure.
MAX_LOG = 50
# Longest line that is taken for a report of progress [characters]; the program writes far shorter ones.
MAX_LINE = 1 << 20
INTERRUPTED = 130
# Time in which a program ends by itself that a terminal's Ctrl-C reached [s]; it gives itself four.
GRACE = 5.0
# Longest time that an interrupted program may take afterwards [s].
MAX_WAIT = 10.0


@dataclass(frozen=True)
class Progress:
    """How far a job is."""

    job: str
    """Its name: `simulate`, `mesh`, …"""
    percent: float
    """Finished part, 0 to 100."""
    text: str
    """What was last reported of a frame; empty at the start."""

    def __str__(self) -> str:
        return f"{self.job} {self.percent:.0f} %  {self.text}".rstrip()


@dataclass(frozen=True)
class Shot:
    """A shot folder."""

    folder: Path

    @property
    def frames(self) -> list[Path]:
        """The cached frames in their order, for `cache.read`."""
        return sorted((self.folder / "cache").glob("frame_*.mcf"), key=_number)

    @property
    def meshes(self) -> list[Path]:
        """The PLY meshes in the order of their frames."""
        return sorted((self.folder / "mesh").glob("*.ply"), key=_number)

    @property
    def manifest(self) -> dict[str, Any]:
        """The content of `shot.json` (docs/formats/shot.md)."""
        with open(self.folder / "shot.json", encoding="utf-8") as file:
            found: dict[str, Any] = json.load(file)
        return found


def _number(path: Path) -> tuple[int, str]:
    """The number that a file's name ends with, and the name."""
    digits = re.search(r"(\d+)$", path.stem)
    return int(digits.group(1)) if digits else 0, path.name


def program() -> Path:
    """The path of the program `meniscus`, which is part of the package; it can be run."""
    path = Path(__file__).resolve().parent / "bin" / ("meniscus.exe" if os.name == "nt" else "meniscus")
    if not path.is_file():
        hint = "install the wheel for this platform; a checkout has no program (docs/python.md)"
        raise MeniscusError(f"{path}: the program is missing: {hint}")
    if not os.access(path, os.X_OK):
        # Tools that unpack wheels without pip, such as Blender, leave the permission out.
        try:
            path.chmod(path.stat().st_mode | stat.S_IXUSR | stat.S_IXGRP | stat.S_IXOTH)
        except OSError as error:
            raise MeniscusError(f"{path}: cannot be made executable: {error}; run `chmod +x` on it") from None
    return path


def simulate(
    preset: str | os.PathLike[str],
    output: str | os.PathLike[str] | None = None,
    *,
    frames: str | None = None,
    quality: str | None = None,
    settings: Mapping[str, Any] | None = None,
    threads: int = 0,
    max_memory: str | None = None,
    force: bool = False,
    progress: Callable[[Progress], object] | None = None,
) -> Shot:
    """Simulates a preset into the cache of a shot folder, or continues a folder that was interrupted.

    A process of its own runs `meniscus simulate`: Ctrl-C stops it, and finished frames stay.

    Args:
        preset: A file or the name of a built-in preset (`run("presets")` lists them).
        output: The shot folder; None: named after preset and quality, in the current folder.
        frames: Frames to simulate, such as "1-48".
        quality: "draft", "preview" or "final".
        settings: Values of the preset to change, by key, such as {"liquid.cfl": 0.6}.
        threads: Threads to compute with; 0 uses every core. The result is the same for any number.
        max_memory: Refuses to start if about more memory would be needed, such as "8GiB".
        force: Deletes the cached frames of the folder first.
        progress: Called with the `Progress` whenever it changes, in the calling thread. An exception that it raises stops the
            job and is passed on.

    Raises:
        ProgramError: with the exit code and the problems of the preset.
    """
    return _shot("simulate", preset, output, frames, quality, settings, threads, max_memory, force, progress)


def shot(
    preset: str | os.PathLike[str],
    output: str | os.PathLike[str] | None = None,
    *,
    frames: str | None = None,
    quality: str | None = None,
    settings: Mapping[str, Any] | None = None,
    threads: int = 0,
    max_memory: str | None = None,
    force: bool = False,
    progress: Callable[[Progress], object] | None = None,
) -> Shot:
    """`simulate`, and then every output that the preset names: meshes, volumes, points."""
    return _shot("shot", preset, output, frames, quality, settings, threads, max_memory, force, progress)


def run(*arguments: str | os.PathLike[str], progress: Callable[[Progress], object] | None = None) -> str:
    """Runs the program with any arguments, and returns what it printed as its result.

    `run("mesh", "wave", "--set", "surface.voxel=0.25")` is `meniscus mesh wave --set surface.voxel=0.25`.

    Raises:
        ProgramError: with the exit code and the problems of the preset.
    """
    return _result([os.fspath(argument) for argument in arguments], progress)


def _shot(
    verb: str,
    preset: str | os.PathLike[str],
    output: str | os.PathLike[str] | None,
    frames: str | None,
    quality: str | None,
    settings: Mapping[str, Any] | None,
    threads: int,
    max_memory: str | None,
    force: bool,
    progress: Callable[[Progress], object] | None,
) -> Shot:
    """Runs a job and gives its folder."""
    words = [verb, "--threads", str(threads)]
    for flag, value in [("--frames", frames), ("--quality", quality), ("--max-memory", max_memory)]:
        words += [] if value is None else [f"{flag}={value}"]
    for key, value in (settings or {}).items():
        # A text may be a value in TOML, as on the command line.
        words.append("--set=" + (f"{key}={value}" if isinstance(value, str) else _toml.setting(key, value)))
    words += ["--force"] if force else []
    folder = os.fspath(output) if output is not None else _folder(Path(preset), quality)
    _result([*words, f"--output={folder}", "--", os.fspath(preset)], progress)
    return Shot(Path(folder))


def _folder(preset: Path, quality: str | None) -> str:
    """The folder that the program chooses without `--output`."""
    name = preset.stem if preset.suffix == ".toml" else preset.name
    return name if quality is None else f"{name}-{quality}"


def _result(arguments: Sequence[str], progress: Callable[[Progress], object] | None) -> str:
    """What the program prints on its standard output, if it succeeds."""
    command = [str(program()), "--progress", "json", *arguments]
    log: collections.deque[str] = collections.deque(maxlen=MAX_LOG)
    failure: dict[str, Any] = {}
    printed: list[str] = []
    process = reader = None
    try:
        process = _started(command)
        # The program would wait for a reader of its result while this waits for its reports.
        reader = threading.Thread(target=_read, args=(process.stdout, printed))
        reader.start()
        for event, data in _events(process.stderr, log):
            if event == "error":
                failure = data
            elif progress is not None:
                progress(data)
        reader.join()
        code = process.wait()
    except BaseException as error:
        if process is not None:
            # A terminal's Ctrl-C reaches the program, too, and a second signal might stop it while it finishes.
            _stop(process, GRACE if isinstance(error, KeyboardInterrupt) else 0.0)
        raise
    finally:
        if reader is not None and reader.ident is not None:
            reader.join()
        for pipe in (process.stdout, process.stderr) if process is not None else ():
            if pipe is not None:
                pipe.close()
    # Ctrl-C raises KeyboardInterrupt here by itself: a program that something else interrupted has failed.
    if code != 0:
        raise ProgramError(_message(code, failure, log), code, failure.get("problems", []), list(log))
    return printed[0]


def _started(command: list[str]) -> subprocess.Popen[str]:
    try:
        return subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, encoding="utf-8", errors="replace"
        )  # fmt: skip
    except ValueError as error:
        raise ParameterError(f"an argument cannot be passed to the program: {error}") from None
    except OSError as error:
        raise MeniscusError(f"{command[0]}: the program cannot be started: {error}; install meniscus-fx again") from None


def _read(pipe: Any, printed: list[str]) -> None:
    printed.append(pipe.read())


def _events(lines: Any, log: collections.deque[str]) -> Any:
    """The reports of the program: ("progress", Progress) and ("error", what it has); other lines go to the log."""
    job, percent, text = "", 0.0, ""
    for line in iter(lambda: lines.readline(MAX_LINE), ""):
        try:
            report = json.loads(line)
            event, data = report["event"], report["data"]
            if event == "error":
                yield event, dict(data)
                continue
            if event == "progress":
                job, percent = str(data["job"]), float(data["percent"])
            else:
                text = str(data["text"])
                log.append(text)
        except (ValueError, KeyError, TypeError):
            log.append(line.rstrip("\n"))
            continue
        yield "progress", Progress(job, percent, text)


def _message(code: int, failure: Mapping[str, Any], log: Sequence[str]) -> str:
    """Why the program failed."""
    problems = failure.get("problems") or []
    lines = []
    for problem in problems:
        place = f"{problem['file']}:{problem['line']}:{problem['column']}"
        lines.append(f"{place}: {problem['message']}: {problem['label']}")
        lines += [f"    {problem['help']}"] if problem.get("help") else []
    if not lines:
        lines = [failure["text"]] if "text" in failure else list(log)[-10:]
        lines += [f"    {failure['help']}"] if failure.get("help") else []
    if code in (INTERRUPTED, -signal.SIGINT):
        lines.append(f"the program was interrupted from outside (exit code {code}); run it again to go on")
    return "\n".join(lines) or f"the program ended with exit code {code} and no message"


def _stop(process: subprocess.Popen[str], grace: float) -> None:
    """Ends the program as Ctrl-C does, so that it keeps what is finished; after a while at once.

    It is given `grace` seconds to end by itself, for it may have had the signal already.
    """
    timers = [threading.Timer(grace, _interrupt, [process]), threading.Timer(grace + MAX_WAIT, process.kill)]
    for timer in timers:
        # They go on if Ctrl-C is pressed again meanwhile; a program that has ended gets no signal.
        timer.daemon = True
        timer.start()
    for _ in process.stderr or ():
        pass
    process.wait()
    for timer in timers:
        timer.cancel()


def _interrupt(process: subprocess.Popen[str]) -> None:
    # On Windows Ctrl-C reaches the processes of the console by itself, and another process can only be ended.
    process.kill() if os.name == "nt" else process.send_signal(signal.SIGINT)


def main() -> None:
    """The command `meniscus`: the program takes the place of this process."""
    try:
        path = str(program())
    except MeniscusError as error:
        sys.exit(f"error: {error}")
    if os.name == "nt":
        # Windows has no exec that keeps the console; Ctrl-C reaches both processes.
        with subprocess.Popen([path, *sys.argv[1:]]) as process:
            while True:
                try:
                    sys.exit(process.wait())
                except KeyboardInterrupt:
                    continue
    os.execv(path, [path, *sys.argv[1:]])
