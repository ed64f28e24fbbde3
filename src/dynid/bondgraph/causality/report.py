"""What causality says of a graph."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from dynid.bondgraph.causality.strokes import How


@dataclass(frozen=True)
class CausalBond:
    """A bond with its stroke.

    Parameters
    ----------
    tail, head
        As in the graph.
    stroke
        The end that effort is imposed towards.
    set_by
        What put it there: a source, a preferred storage, a free choice, what these force (propagated), or
        nothing that fits (conflict).
    """

    tail: str
    head: str
    stroke: Literal["tail", "head"]
    set_by: How


@dataclass(frozen=True)
class CausalElement:
    """A one-port: 'integral' or 'derivative' storage, 'resistive' or 'conductive' R, 'fixed' source."""

    name: str
    type: str
    causality: str
    set_by: How


@dataclass(frozen=True)
class CausalState:
    """The state of a storage that integrates: the momentum p of an I, the displacement q of a C."""

    name: str
    element: str
    quantity: Literal["momentum", "displacement"]


@dataclass(frozen=True)
class Remark:
    """Something to know about some nodes, in words.

    Parameters
    ----------
    nodes
        The nodes concerned, the most telling first.
    meaning
        What it means physically.
    equations
        For a loop: how many linear equations have to be solved at once.
    """

    nodes: tuple[str, ...]
    meaning: str
    equations: int = 0


@dataclass(frozen=True)
class Causality:
    """The causality of a graph.

    Parameters
    ----------
    bonds
        Every bond with its stroke, in the graph's order.
    elements
        Every one-port with its causality.
    states
        The states: one for each storage that integrates; there are as many as the structure allows.
    dependent
        Storages in derivative causality, and what they follow.
    loops
        Algebraic loops.
    conflicts
        Rules that no assignment can obey; empty for a sound graph.
    """

    bonds: tuple[CausalBond, ...]
    elements: tuple[CausalElement, ...]
    states: tuple[CausalState, ...]
    dependent: tuple[Remark, ...] = ()
    loops: tuple[Remark, ...] = ()
    conflicts: tuple[Remark, ...] = field(default=())

    @property
    def order(self) -> int:
        """The number of states that the structure allows."""
        return len(self.states)
