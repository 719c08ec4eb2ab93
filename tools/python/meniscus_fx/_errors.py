# SPDX-License-Identifier: MIT OR Apache-2.0
"""What can go wrong."""

from __future__ import annotations

from typing import Any


class MeniscusError(Exception):
    """Any error of this package."""


class ParameterError(MeniscusError, ValueError):
    """A parameter is unknown or out of range: the message names it, the value that was found, and the range."""


class ParticleError(MeniscusError, ValueError):
    """An array of particles has the wrong shape or holds numbers that are not finite; the message has the index."""


class OutOfMemoryError(MeniscusError, MemoryError):
    """A surface needs more memory than `max_memory` allows or the system grants."""


class Interrupted(MeniscusError):
    """The call was cancelled from another thread."""


class ProgramError(MeniscusError, RuntimeError):
    """The program `meniscus` failed.

    `code` is its exit code (`meniscus --help` lists them), `problems` has a dictionary for each mistake in a preset or setting
    (`message`, `key`, `file`, `line`, `column`, `label`, `help`, `nearest`), and `log` the last lines that the program printed.
    """

    def __init__(self, message: str, code: int, problems: list[dict[str, Any]], log: list[str]):
        super().__init__(message)
        self.code = code
        self.problems = problems
        self.log = log

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (str(self), self.code, self.problems, self.log)


class SurfaceWarning(UserWarning):
    """Particles that a surface does not show as they are, by number; or a mesh that is not closed, manifold and oriented."""
