"""Findings of causality: strokes, states, derivative causality, algebraic loops and conflicts, in words.

With strokes on the bonds every effort and flow has one origin. Cut at storage elements, the dependences form
a directed graph; its strongly connected parts are the algebraic loops: signals that depend on themselves
without an integration in between.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

from dynid.bondgraph.causality.strokes import Contradiction, StrokeReason, Strokes
from dynid.bondgraph.graph import JUNCTIONS, SOURCES, STORAGES, TWO_PORTS

# --- tables ---------------------------------------------------------------------------------------


class CausalBond(NamedTuple):
    """A bond with its stroke."""

    #: tail, head: As in the graph.
    tail: str
    head: str
    stroke: Literal["tail", "head"]  # the end that effort is imposed towards
    #: What put it there: a source, a preferred storage, a free choice, what these force (propagated), or
    #: nothing that fits (conflict).
    set_by: StrokeReason


class CausalElement(NamedTuple):
    """A one-port: 'integral' or 'derivative' storage, 'resistive' or 'conductive' R, 'fixed' source."""

    name: str
    type: str
    causality: str
    set_by: StrokeReason


class CausalState(NamedTuple):
    """The state of a storage that integrates: the momentum p of an I, the displacement q of a C."""

    name: str
    element: str
    quantity: Literal["momentum", "displacement"]


class _CausalityRemark(NamedTuple):
    """A finding about some nodes, in words."""

    nodes: tuple[str, ...]  # the nodes concerned, the most important first
    meaning: str  # what it means physically
    equations: int = 0  # for a loop: how many linear equations have to be solved at once


@dataclass(frozen=True)
class Causality:
    """The causality of a graph."""

    bonds: tuple[CausalBond, ...]  # every bond with its stroke, in the graph's order
    elements: tuple[CausalElement, ...]  # every one-port with its causality
    #: The states: one for each storage that integrates; there are as many as the structure allows.
    states: tuple[CausalState, ...]
    dependent: tuple[_CausalityRemark, ...] = ()  # storages in derivative causality, and what they follow
    loops: tuple[_CausalityRemark, ...] = ()  # algebraic loops
    #: Rules that no assignment can obey; empty for a sound graph.
    conflicts: tuple[_CausalityRemark, ...] = field(default=())

    @property
    def order(self) -> int:
        """The number of states that the structure allows."""
        return len(self.states)


# --- explanations ---------------------------------------------------------------------------------

#: Most nodes that a sentence lists.
_MAX_LISTED_NODES = 6


def join_nodes(names: Sequence[str]) -> str:
    """Join names as in a sentence: a, b and c."""
    if len(names) > _MAX_LISTED_NODES:
        return f"{', '.join(names[:_MAX_LISTED_NODES])} and {len(names) - _MAX_LISTED_NODES} more"
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}" if names else ""


def join_with_types(kinds: Mapping[str, str], names: Iterable[str]) -> str:
    """Write nodes with their types: m1 (I) and k (C)."""
    return join_nodes(
        [
            f"{kinds[name]}-junction {name}" if kinds[name] in JUNCTIONS else f"{name} ({kinds[name]})"
            for name in names
        ]
    )


def explain_dependent(strokes: Strokes, name: str) -> _CausalityRemark:
    """Return what a storage in derivative causality follows, in words."""
    (bond,) = strokes.bonds_at[name]
    roots, inner = strokes.roots([bond])
    owners = [owner for owner in _owners(strokes, roots) if owner != name]
    quantity = "momentum" if strokes.kinds[name] == "I" else "displacement"
    two_ports = [node for node in inner if strokes.kinds[node] in TWO_PORTS]
    sources = [owner for owner in owners if strokes.kinds[owner] in SOURCES]
    storages = [owner for owner in owners if strokes.kinds[owner] in STORAGES]
    determining = join_with_types(strokes.kinds, [*storages, *sources]) or "the junctions around it"
    through = f" through {join_with_types(strokes.kinds, two_ports or inner)}" if inner else ""
    subject = join_with_types(strokes.kinds, [name])
    meaning = f"{subject} is in derivative causality: its {quantity} is determined by {determining}{through}"
    return _CausalityRemark((name, *storages, *sources, *(two_ports or inner)), meaning)


def explain_conflict(strokes: Strokes, bond: int, problem: Contradiction) -> _CausalityRemark:
    """Return which rules contradict each other, and where, in words."""
    involved = set(_owners(strokes, [bond, *problem.roots]))
    owners = [name for name in strokes.kinds if name in involved]
    kind = strokes.kinds.get(problem.node, "")
    sources = len(owners) > 1 and all(strokes.kinds[owner] in SOURCES for owner in owners)
    who = join_with_types(strokes.kinds, owners or problem.nodes)
    if kind in JUNCTIONS:
        common, others = ("effort", "flow") if kind == "0" else ("flow", "effort")
        where = join_with_types(strokes.kinds, [problem.node])
        if problem.surplus:
            meaning = f"{who} {'both' if len(owners) == 2 else 'at once'} set the {common} of {where}"
        else:
            verb = "imposes" if len(owners) == 1 else "impose"
            meaning = f"nothing is left to set the {common} of {where}: {who} {verb} every {others} on it"
    else:
        meaning = f"{who} cannot both impose on the bond {' -> '.join(strokes.bonds[bond])}"
    if sources:
        meaning += "; ideal sources meet with no element between them to take up the difference"
    return _CausalityRemark(tuple(dict.fromkeys([*owners, problem.node, *problem.nodes])), meaning)


def _owners(strokes: Strokes, bonds: Iterable[int]) -> list[str]:
    """Return the sources, storages and resistances at the ends of bonds."""
    one_ports = SOURCES | STORAGES | {"R"}
    ends = (end for bond in bonds for end in strokes.bonds[bond])
    return list(dict.fromkeys(end for end in ends if strokes.kinds[end] in one_ports))


# --- algebraic loops ------------------------------------------------------------------------------

_EFFORT, _FLOW = 0, 1


def algebraic_loops(strokes: Strokes) -> tuple[_CausalityRemark, ...]:
    """Name every algebraic loop of a graph with all strokes put."""
    import numpy as np
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    edges = list(_dependences(strokes))
    if not edges:
        return ()
    count = 2 * len(strokes.bonds)
    ends = np.array(edges).T
    graph = csr_array((np.ones(len(edges), dtype=np.int8), (ends[0], ends[1])), shape=(count, count))
    _, label = connected_components(graph, directed=True, connection="strong")
    members: dict[int, list[int]] = {}
    for signal in range(count):
        members.setdefault(int(label[signal]), []).append(signal)
    loops: dict[tuple[int, ...], int] = {}  # efforts and flows may run round the same bonds apart
    for signals in members.values():
        bonds = tuple(dict.fromkeys(signal // 2 for signal in signals))
        if len(signals) > 1:
            free = sum(strokes.how[bond] == "free" for bond in bonds)
            loops[bonds] = loops.get(bonds, 0) + max(1, free)
    return tuple(_remark(strokes, bonds, count) for bonds, count in loops.items())


def _dependences(strokes: Strokes) -> Iterator[tuple[int, int]]:
    """Yield (signal, signal that depends on it); bond k has effort 2k and flow 2k + 1."""
    for node, kind in strokes.kinds.items():
        bonds = strokes.bonds_at[node]
        effort_in = {bond: strokes.at_head[bond] is strokes.towards(node, bond) for bond in bonds}
        match kind:
            case "0" | "1":
                common, balance = (_EFFORT, _FLOW) if kind == "0" else (_FLOW, _EFFORT)
                setter = strokes.setter[node]
                for bond in bonds:
                    if setter is not None and bond != setter:
                        yield 2 * setter + common, 2 * bond + common
                        yield 2 * bond + balance, 2 * setter + balance
            case "R":
                (bond,) = bonds
                signals = 2 * bond + _EFFORT, 2 * bond + _FLOW
                yield signals if effort_in[bond] else signals[::-1]
            case "TF" | "GY":
                for entry, two in (bonds, bonds[::-1]):
                    imposed = _EFFORT if effort_in[entry] else _FLOW
                    yield 2 * entry + imposed, 2 * two + (imposed if kind == "TF" else 1 - imposed)


def _remark(strokes: Strokes, bonds: tuple[int, ...], count: int) -> _CausalityRemark:
    nodes = dict.fromkeys(end for bond in bonds for end in strokes.bonds[bond])
    resistances = [name for name in nodes if strokes.kinds[name] == "R"]
    inner = [name for name in nodes if strokes.kinds[name] in ("0", "1", "TF", "GY")]
    solved = "one linear equation has" if count == 1 else f"{count} linear equations have"
    through = f" through {join_nodes(inner)}" if inner else ""
    if not resistances:
        meaning = (
            f"what goes into {join_nodes(inner)} comes back upon itself with no element in between: {solved} "
            "to be solved, which fails where the gain once round is 1"
        )
    elif len(resistances) == 1:
        meaning = (
            f"{join_with_types(strokes.kinds, resistances)} depends on itself{through}: "
            f"{solved} to be solved at once"
        )
    else:
        depend = "each depend on the other" if len(resistances) == 2 else "depend on each other"
        meaning = (
            f"{join_with_types(strokes.kinds, resistances)} {depend}{through}: {solved} to be solved at once"
        )
    return _CausalityRemark((*resistances, *inner), meaning, count)
