"""The zero dynamics as a graph: bicausal bonds from an output to an input (Gawthrop 1995).

The output becomes a source-sensor SS: both its effort and its flow are imposed, as zero. The input becomes
the opposite, an SS on which both are found. Bicausality leads from one to the other along a line of power,
on whose bonds effort and flow are imposed the same way. A junction on the line has its common variable
from there, and so imposes it on everything else beside the line; the rest takes its causality by the usual
procedure. Storages that still integrate are the states of the zero dynamics: as many as there are zeros.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, NamedTuple

from dynid.bondgraph.causality.report import Causality
from dynid.bondgraph.causality.scap import describe, run_scap
from dynid.bondgraph.causality.strokes import StrokeReason, Strokes
from dynid.bondgraph.graph import JUNCTIONS, ONE_PORTS, BondGraph, Port
from dynid.bondgraph.reduction.junctions import unique

End = Literal["tail", "head"]

#: Most lines of power that are compared, and most steps in their search.
_MAX_LINES, _MAX_SEARCH_STEPS = 32, 20_000


class BicausalBond(NamedTuple):
    """A bond and the ends that its effort and its flow are imposed towards: the same end where bicausal."""

    tail: str
    head: str
    effort: End
    flow: End
    set_by: StrokeReason


@dataclass(frozen=True)
class ZeroCausality:
    """The causality of a channel's zero dynamics."""

    bonds: tuple[BicausalBond, ...]  # every bond of the graph with the output's detector put in
    line: tuple[str, ...]  # the nodes of the bicausal line of power, from the input to the output
    inside: Causality  # the causality of what lies beside the line
    derivative: tuple[str, ...]  # storages that lose their own state, by being on the line or through it
    lines: int  # the number of lines of power that were compared; more than one can cancel each other


def zero_causality(graph: BondGraph, port: Port, source: str) -> ZeroCausality | None:
    """Assign bicausality from an output to an input, along the line that leaves most states.

    The best of the lines of power; None where none can be made bicausal.
    """
    kinds, bonds, detector = _with_detector(graph, port)
    best: ZeroCausality | None = None
    count = 0
    for line in _lines(kinds, bonds, detector, source):
        causality = _along(kinds, bonds, line, (detector, source))
        if causality is None:
            continue
        count += 1
        if best is None or causality.inside.order > best.inside.order:
            best = causality
        if count == _MAX_LINES:
            break
    if best is None:
        return None
    return ZeroCausality(best.bonds, best.line, best.inside, best.derivative, count)


def _with_detector(graph: BondGraph, port: Port) -> tuple[dict[str, str], list[tuple[str, str]], str]:
    """Put a detector of the output into the graph, on a junction of its own where it needs one."""
    kinds: dict[str, str] = {name: node.type for name, node in graph.nodes.items()}
    bonds = [(bond.tail, bond.head) for bond in graph.bonds]
    detector = unique(str(port), kinds)
    effort = graph.behind(port).quantity == "e"
    kind = "0" if effort else "1"
    at = port.node
    if kinds[at] in ONE_PORTS:
        at_bond = next(index for index, pair in enumerate(bonds) if at in pair)
        tail, head = bonds[at_bond]
        neighbour = tail if head == at else head
        if kinds[neighbour] == kind:
            at = neighbour
        else:
            at = unique(f"{'e' if effort else 'f'}_{port.node}", kinds)
            kinds[at] = kind
            bonds[at_bond : at_bond + 1] = [(tail, at), (at, head)]
    kinds[detector] = "SS"
    return kinds, [*bonds, (at, detector)], detector


def _lines(
    kinds: dict[str, str], bonds: list[tuple[str, str]], start: str, end: str
) -> Iterator[tuple[int, ...]]:
    """Yield simple paths of bonds from one node to another: the shortest, then others as they are met."""
    bonds_at: dict[str, list[int]] = {name: [] for name in kinds}
    for bond, ends in enumerate(bonds):
        for name in ends:
            bonds_at[name].append(bond)
    distance, queue = {end: 0}, [end]
    for node in queue:
        for bond in bonds_at[node]:
            neighbour = bonds[bond][bonds[bond][0] == node]
            if neighbour not in distance:
                distance[neighbour] = distance[node] + 1
                queue.append(neighbour)
    if start not in distance:
        return
    stack: list[tuple[str, tuple[int, ...], frozenset[str]]] = [(start, (), frozenset([start]))]
    for _ in range(_MAX_SEARCH_STEPS):
        if not stack:
            return
        node, line, seen = stack.pop()
        if node == end:
            yield line
            continue
        onward = []
        for bond in bonds_at[node]:
            neighbour = bonds[bond][bonds[bond][0] == node]
            if neighbour not in seen and (neighbour == end or kinds[neighbour] not in ONE_PORTS | {"SS"}):
                onward.append((neighbour, (*line, bond), seen | {neighbour}))
        stack += sorted(onward, key=lambda step: -distance[step[0]])


def _along(
    kinds: dict[str, str], bonds: list[tuple[str, str]], line: tuple[int, ...], ends: tuple[str, str]
) -> ZeroCausality | None:
    """Make one line bicausal and complete the rest; None where that contradicts a source."""
    nodes = [ends[0]]
    for bond in line:
        nodes.append(bonds[bond][bonds[bond][0] == nodes[-1]])
    # the bonds beside the line take causality from its junctions, which impose their common variables on them
    on_line = set(nodes)
    off_line = [bond for bond in range(len(bonds)) if bond not in set(line)]
    rest = {
        name: "held" if name in on_line else kind
        for name, kind in kinds.items()
        if name not in on_line or kind in JUNCTIONS
    }
    strokes = Strokes(rest, [bonds[bond] for bond in off_line])
    for index, bond in enumerate(off_line):
        for node in on_line.intersection(bonds[bond]):
            away = strokes.towards(node, index) is (kinds[node] == "1")
            if strokes.put(index, away, "bicausal") is not None:
                return None
    assigned = run_scap(strokes, [name for name, kind in rest.items() if kind in ONE_PORTS])
    if assigned.conflicts:
        return None
    inside = describe(assigned)
    table: dict[int, BicausalBond] = {}
    for bond, settled in zip(off_line, inside.bonds, strict=True):
        table[bond] = BicausalBond(
            settled.tail,
            settled.head,
            settled.stroke,
            "tail" if settled.stroke == "head" else "head",
            settled.set_by,
        )
    for node, bond in zip(nodes, line, strict=False):
        tail, head = bonds[bond]
        onward: End = "head" if tail == node else "tail"
        table[bond] = BicausalBond(tail, head, onward, onward, "bicausal")
    return ZeroCausality(
        bonds=tuple(table[bond] for bond in range(len(bonds))),
        line=tuple(reversed(nodes)),
        inside=inside,
        derivative=tuple(e.name for e in inside.elements if e.causality == "derivative"),
        lines=1,
    )
