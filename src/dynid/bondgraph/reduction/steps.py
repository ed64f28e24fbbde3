"""The steps of a reduction: what was done, to which nodes, and what it means."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from dynid.bondgraph.reduction.program import Register
from dynid.bondgraph.reduction.writing import Hand, Written

#: A formula in names that were defined before.
Formula = Callable[[Hand], Written]
#: A name, and the registers that sum up to it, each with the variable that it multiplies (empty: none); or
#: a formula.
Definition = tuple[str, tuple[tuple[Register, str], ...] | Formula]


@dataclass(frozen=True)
class Step:
    """One step of a reduction.

    Parameters
    ----------
    rule
        series, parallel, reflection, source swap, merge, junction elimination, constraint or prototype.
    nodes
        The nodes it consumed.
    definitions
        What it defines, in order.
    meaning
        What happens, physically, in one sentence.
    """

    rule: str
    nodes: tuple[str, ...]
    definitions: tuple[Definition, ...]
    meaning: str


def listed(names: Iterable[str]) -> str:
    """Join names as in a sentence: a, b and c."""
    *first, last = names
    return f"{', '.join(first)} and {last}" if first else last
