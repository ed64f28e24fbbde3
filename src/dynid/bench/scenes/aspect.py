"""One thing that is chosen in a scene, and the alternatives to it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from dynid.bench.alternative import Alternative


def nothing(_: Any) -> float | None:
    """Know no yardstick."""
    return None


@dataclass(frozen=True)
class Aspect:
    """Ways to the same answer, of which a run took one.

    Parameters
    ----------
    title
        What is chosen, in a few words.
    size
        What a size counts.
    points
        Alternatives with the sizes they are tried at, the most trustworthy first: what comes to an end first
        in this order is what the others are compared with.
    chosen
        Names and sizes of the choices that the run made.
    because
        Why it made them.
    error
        Given what an alternative and what the reference found: its error; None where it found no number.
        Given the reference twice: how far that may be off.
    measure
        What the error is.
    yardstick
        Given what an alternative found: the least error that is to be expected of anyone; None: not known.
    """

    title: str
    size: str
    points: Sequence[tuple[Alternative, int]]
    chosen: frozenset[tuple[str, int]]
    because: str
    error: Callable[[Any, Any], float | None]
    measure: str
    yardstick: Callable[[Any], float | None] = nothing
