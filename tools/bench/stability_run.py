"""Runs one shot of the tables of stability: the same for liquid, smoke, sheets, couplings and shots."""

import contextlib
import json
import pathlib
import subprocess
import tempfile


@contextlib.contextmanager
def simulated(tool, text):
    """The ended process of `meniscus simulate` with this preset, the records of its frames, and the shot's folder while it exists."""
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder)
        (path / "shot.toml").write_text(text)
        ran = subprocess.run([tool, "simulate", "shot.toml", "-o", "out"], cwd=path, capture_output=True, text=True)
        log = path / "out" / "log.jsonl"
        frames = [json.loads(line) for line in log.read_text().splitlines()] if log.exists() else []
        yield ran, frames, path / "out"


def refusal(stderr):
    """The error in one line; of a preset's, with the first label but without the excerpt."""
    if "-->" not in stderr:
        return " ".join(stderr[stderr.rindex("error: ") + 7 :].split()).replace("|", "/")
    lines = stderr[stderr.index("error: ") + 7 :].splitlines()
    labels = [line.split("^ ", 1)[1].strip() for line in lines if "^ " in line]
    return "; ".join([lines[0].strip(), *labels[:1]]).replace("|", "/")
