"""What is told of a scene before it is run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from dynid.errors import DynidError
from dynid.result import Result
from dynid.scene.explanations.cost import Cost


class Fact(NamedTuple):
    """Something to know, in words: a `topic` of a word or two, and what is said of it."""

    topic: str
    text: str


@dataclass(frozen=True)
class Explanation:
    """What is told of a scene before it is run.

    Parameters
    ----------
    result
        Causality or identifiability, where a run has them, too.
    facts
        The rest in words, in the order of the work.
    cost
        What a run costs; None where it is bound to fail.
    obstacle
        Why the run is bound to fail; None where nothing is known against it.
    """

    result: Result
    facts: Sequence[Fact]
    cost: Cost | None = None
    obstacle: DynidError | None = field(default=None)
