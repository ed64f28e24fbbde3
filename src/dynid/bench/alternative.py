"""What a benchmark is: alternatives that do the same work at several sizes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any


@dataclass(frozen=True)
class Alternative:
    """One way to do the work of a benchmark.

    Parameters
    ----------
    name
        Its name, as in the results.
    prepare
        Given a size, everything that is not to be timed; returns the work to time.
    needs
        Packages that it needs beyond dynid's own.
    most
        Largest size that it is tried at.
    """

    name: str
    prepare: Callable[[int], Callable[[], Any]]
    needs: tuple[str, ...] = ()
    most: int | None = None

    def missing(self) -> str:
        """Say which packages are not installed; empty where it can run."""
        absent = [package for package in self.needs if find_spec(package) is None]
        return f"{', '.join(absent)} not installed" if absent else ""


@dataclass(frozen=True)
class Benchmark:
    """Work of several sizes, and the ways to do it.

    Parameters
    ----------
    title
        The work, in a few words.
    size
        What a size counts.
    sizes
        The sizes of a default run.
    alternatives
        The ways, the house's own first.
    error
        Given a size and what the work returned: its error against an exact or high-precision reference.
    measure
        What the error is.
    """

    title: str
    size: str
    sizes: tuple[int, ...]
    alternatives: Sequence[Alternative]
    error: Callable[[int, Any], float]
    measure: str = "largest relative error"
