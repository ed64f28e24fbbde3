"""Errors of dynid, with a problem, a remedy and an exit code.

The analyses raise these; only the command line prints them.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any


class DynidError(Exception):
    """Base of all errors that dynid raises on purpose.

    Parameters
    ----------
    problem
        What is wrong, as one clear sentence without a full stop.
    remedy
        What to do, as one or more sentences; may be empty.
    names
        The nodes, parameters or files concerned; a scene finds its line through them.

    Attributes
    ----------
    result
        Result of a rejected fit, which shows why it is; None of other errors.
    """

    exit_code = 3
    result: Any = None

    def __init__(self, problem: str, *, remedy: str = "", names: Iterable[str] = ()) -> None:
        super().__init__(problem)
        self.problem = problem
        self.remedy = remedy
        self.names = tuple(names)

    def __str__(self) -> str:
        stop = "" if self.problem.endswith("?") else "."
        return f"{self.problem}{stop} {self.remedy}" if self.remedy else self.problem


class NumericalError(DynidError):
    """The scene is valid, but its result cannot be computed reliably."""


class Singular(NumericalError):
    """The equations have no solution or more than one."""


class Diverged(NumericalError):
    """An iteration or a filter diverged."""


class NotIdentifiable(NumericalError):
    """The record does not determine the parameters."""


class Unreachable(NumericalError):
    """The targets of a design cannot be reached."""


class Undecided(NumericalError):
    """A floating-point method leaves the result undecided; an exact one decides it."""


class FileError(DynidError):
    """A file could not be read or written."""

    exit_code = 4


class UsageError(DynidError):
    """Invalid arguments of a call or a command."""

    exit_code = 2


class UnknownPath(UsageError, KeyError):
    """A result has no array at a path; also a `KeyError`, as of every mapping."""


@dataclass(frozen=True, order=True)
class Fault:
    """One fault of a scene, with its place (lines and columns count from 1)."""

    file: str
    line: int
    column: int
    message: str

    def __str__(self) -> str:
        # One printable line, whatever text of the user it repeats.
        message = self.message
        if not message.isprintable():
            message = "".join(
                letter if letter.isprintable() else letter.encode("unicode_escape").decode()
                for letter in message
            )
        return f"{self.file}:{self.line}:{self.column}: {message}"


class SceneError(DynidError):
    """An invalid scene: all of its faults at once, in the order of the file."""

    exit_code = 2

    def __init__(self, faults: Iterable[Fault]) -> None:
        self.faults = tuple(sorted(set(faults)))
        super().__init__("\n".join(str(fault) for fault in self.faults))
