"""Formats of result files: every format ever released is read, each by one step to the next.

Today there is one. A second one comes with the step `STEPS[1]` from results of the first.
"""

from __future__ import annotations

from collections.abc import Callable

from dynid.errors import FileError
from dynid.result import Result

#: The format that is written.
CURRENT = 1

#: For an older format: what turns a result as read into what the next format would have held.
STEPS: dict[int, Callable[[Result], Result]] = {}


def refuse_unknown(number: int, name: str) -> None:
    """Refuse a file of a format that this version cannot read.

    Raises
    ------
    FileError
        Naming the formats that can be read.
    """
    if number > CURRENT:
        problem = f"{name} has format {number}; this dynid reads formats up to {CURRENT}"
        raise FileError(problem, remedy="Update dynid to read it.", names=[name])
    if number < CURRENT and number not in STEPS:
        problem = f"{name} has format {number}, which no dynid has ever written"
        raise FileError(problem, remedy="Run its scene again.", names=[name])


def as_current(result: Result, number: int) -> Result:
    """Return a result read from a file of an older format as the current format holds it."""
    for older in range(number, CURRENT):
        result = STEPS[older](result)
    return result
