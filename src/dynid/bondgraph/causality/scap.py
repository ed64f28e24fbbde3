"""The sequential causality assignment procedure (Karnopp, Margolis & Rosenberg, System Dynamics, ch. 5).

Sources first, then storages one at a time in their preferred, integral causality, then resistances and
whatever is left, each with all that it forces. A stroke that leads to a contradiction is turned round.
Taken one at a time, storage elements cannot block each other to the wrong effect: sets of them that
integrate together are the feasible sets of a delta-matroid (of the matchings of the junctions), on which
the greedy choice is the largest (Bouchet 1987), as long as every step can still be completed. Where
forcing alone did not notice that, around a loop, the procedure is run again with a look-ahead at each step.

The look ahead is a perfect matching of junctions. Every junction takes its common variable from exactly one
bond. A bond between a 0 and a 1 sets both or neither, so that the setting bonds pair up the junctions that no
element sets: a perfect matching, which exists exactly where the matrix D + S of random entries (D: junctions
that an open element can set; S skew-symmetric: open bonds between junctions) has a nonzero determinant (Tutte
1947). Only junctions on loops need it: the trees attached to them can be completed either way.
"""

from __future__ import annotations

import random
from collections.abc import Iterable
from dataclasses import dataclass

from dynid.bondgraph.causality.report import (
    CausalBond,
    CausalElement,
    Causality,
    CausalState,
    algebraic_loops,
    explain_conflict,
    explain_dependent,
)
from dynid.bondgraph.causality.strokes import Contradiction, StrokeReason, Strokes
from dynid.bondgraph.graph import ONE_PORTS, SOURCES, STORAGES, BondGraph
from dynid.defaults import LOOKING_AHEAD

# --- look ahead -----------------------------------------------------------------------------------

_PRIME = (1 << 61) - 1


class _StrokeCompletion:
    """The loops of a graph, and whether strokes on them can be completed."""

    def __init__(self, strokes: Strokes) -> None:
        ends = {
            name: [_follow(strokes, name, bond)[0] for bond in strokes.bonds_at[name]]
            for name in strokes.setter
        }
        neighbours = {name: [end for end in linked if end in ends] for name, linked in ends.items()}
        degree = {name: len(linked) for name, linked in neighbours.items()}
        #: The junctions that are left when those with a single link to others are taken off in turn.
        self.loops = dict.fromkeys(strokes.setter)
        leaves = [name for name, count in degree.items() if count < 2]
        while leaves:
            leaf = leaves.pop()
            del self.loops[leaf]
            for end in neighbours[leaf]:
                degree[end] -= 1
                if end in self.loops and degree[end] == 1:
                    leaves.append(end)
        #: Whether there is anything to look at, and not too much of it.
        self.feasible = 0 < len(self.loops) <= LOOKING_AHEAD.value

    def possible(self, strokes: Strokes) -> bool:
        """Test whether the open bonds can be given strokes that obey every rule."""
        from flint import nmod_mat

        links, alone = self._links(strokes)
        names = sorted({*(name for pair in links for name in pair), *alone, *self._unset(strokes)})
        index_of = {name: index for index, name in enumerate(names)}
        draw = random.Random(0x5CA9)
        matrix = nmod_mat(len(names), len(names), _PRIME)
        for name in sorted(alone):
            matrix[index_of[name], index_of[name]] = draw.randrange(1, _PRIME)
        for a, b in links:
            size = draw.randrange(1, _PRIME)
            matrix[index_of[a], index_of[b]] = matrix[index_of[a], index_of[b]] + size
            matrix[index_of[b], index_of[a]] = matrix[index_of[b], index_of[a]] - size
        return int(matrix.det()) != 0

    def _unset(self, strokes: Strokes) -> list[str]:
        return [name for name in self.loops if strokes.setter[name] is None]

    def _links(self, strokes: Strokes) -> tuple[list[tuple[str, str]], set[str]]:
        """Return the open links between unset junctions, and the junctions that something else can set.

        Two junctions of which a link sets exactly one are linked through a junction of its own.
        """
        links: list[tuple[str, str]] = []
        alone: set[str] = set()
        for name in self._unset(strokes):
            for bond in strokes.bonds_at[name]:
                if strokes.at_head[bond] is not None:
                    continue
                end, last, sets_both = _follow(strokes, name, bond)
                if end not in self.loops:
                    alone.add(name)
                elif bond < last or (bond == last and name < end):  # each link is met from both of its ends
                    if sets_both:
                        links += [(name, end)] if name != end else []
                    else:
                        links += [(name, f"\0{bond}"), (f"\0{bond}", end)]
        return links, alone


def _follow(strokes: Strokes, start: str, bond: int) -> tuple[str, int, bool]:
    """Follow a bond through TF and GY; return the end, the last bond, and whether it sets both ends."""
    at_head = strokes.setting(start, bond)
    node = strokes.other_end(bond, start)
    while strokes.kinds[node] in ("TF", "GY"):
        stroke_here = (at_head is strokes.towards(node, bond)) is (strokes.kinds[node] == "GY")
        bond = next(onward for onward in strokes.bonds_at[node] if onward != bond)
        at_head = stroke_here is strokes.towards(node, bond)
        node = strokes.other_end(bond, node)
    return node, bond, node in strokes.setter and strokes.sets(node, bond, at_head)


# --- procedure ------------------------------------------------------------------------------------


@dataclass
class _AssignedStrokes:
    """Strokes on every bond, and the conflicts that are left."""

    strokes: Strokes
    #: The bonds that were left over, with the contradiction that each led to.
    conflicts: list[tuple[int, Contradiction]]


def run_scap(strokes: Strokes, elements: Iterable[str]) -> _AssignedStrokes:
    """Complete strokes by the procedure.

    `strokes`: what is settled already; completed in place where forcing suffices. `elements`: the one-ports
    to treat, in the order of preference within their stage.
    """
    elements = list(elements)
    before = strokes.copy()
    assigned = _Procedure(strokes, None).run(elements)
    if any(assigned.strokes.how[bond] != "source" for bond, _ in assigned.conflicts):
        ahead = _StrokeCompletion(before)
        if ahead.feasible:
            return _Procedure(before, ahead).run(elements)
    return assigned


class _Procedure:
    def __init__(self, strokes: Strokes, ahead: _StrokeCompletion | None) -> None:
        self.strokes, self.ahead = strokes, ahead
        self.conflicts: list[tuple[int, Contradiction]] = []

    def run(self, elements: list[str]) -> _AssignedStrokes:
        strokes, kinds = self.strokes, self.strokes.kinds
        for name in [name for name in strokes.setter if len(strokes.bonds_at[name]) == 1]:
            self._put(self._bond(name), strokes.setting(name, self._bond(name)), "propagated")
        for name in [name for name in elements if kinds[name] in SOURCES]:
            self._put(self._bond(name), self._wanted(name), "source")
        if self.ahead is not None and not self.ahead.possible(strokes):
            self.ahead = None  # a conflict in any case
        for name in [name for name in elements if kinds[name] in STORAGES]:
            self._prefer(self._bond(name), self._wanted(name), "preferred")
        for name in [name for name in elements if kinds[name] == "R"]:
            self._choose(self._bond(name), self._wanted(name))
        for bond in range(len(strokes.bonds)):
            self._choose(bond, True)
        return _AssignedStrokes(strokes, self.conflicts)

    def _bond(self, name: str) -> int:
        return self.strokes.bonds_at[name][0]

    def _wanted(self, name: str) -> bool:
        """Return the stroke that an element imposes or prefers; a free R imposes effort."""
        bond = self._bond(name)
        return self.strokes.towards(name, bond) is (self.strokes.kinds[name] in ("Sf", "I"))

    def _put(self, bond: int, at_head: bool, how: StrokeReason) -> None:
        """Put a stroke that has no alternative."""
        problem = self.strokes.put(bond, at_head, how)
        if problem is not None:
            self.strokes.how[bond] = how
            self.conflicts.append((bond, problem))

    def _choose(self, bond: int, at_head: bool) -> None:
        """Put a stroke that is free, at the end from which it settles more: fewer equations are left."""
        strokes = self.strokes
        if strokes.at_head[bond] is None:
            settled = []
            for value in (at_head, not at_head):
                blocked = self._try(bond, value, "free") is not None
                settled.append(0 if blocked else strokes.take_back())
            self._prefer(bond, at_head if settled[0] >= settled[1] else not at_head, "free")

    def _prefer(self, bond: int, at_head: bool, how: StrokeReason) -> None:
        """Put a stroke if it can stand, else its opposite."""
        strokes = self.strokes
        if strokes.at_head[bond] is not None or any(bond == conflicting for conflicting, _ in self.conflicts):
            return
        problem = self._try(bond, at_head, how)
        if problem is None:
            return
        roots = tuple(root for root in problem.roots if root != bond)
        strokes.between[bond] = problem.nodes
        second = strokes.put(bond, not at_head, "propagated" if roots else how, roots)
        if second is not None:
            strokes.how[bond] = "conflict"
            self.conflicts.append((bond, second))

    def _try(self, bond: int, at_head: bool, how: StrokeReason) -> Contradiction | None:
        strokes = self.strokes
        problem = strokes.put(bond, at_head, how)
        if problem is None and self.ahead is not None and not self.ahead.possible(strokes):
            strokes.take_back()
            settled = [b for b, value in enumerate(strokes.at_head) if value is not None]
            return Contradiction("", False, *strokes.roots(settled))
        return problem


# --- causality of a graph -------------------------------------------------------------------------


def assign_causality(graph: BondGraph) -> Causality:
    """Assign causality to every bond of a graph (SCAP).

    It reads nodes and bonds only, no values, and takes time linear in their number; around loops a step
    may have to be looked ahead.

    Strokes, states, dependent storage elements and algebraic loops; conflicts where the graph contradicts
    itself, with the strokes of the rest.
    """
    kinds = {name: node.type for name, node in graph.nodes.items()}
    strokes = Strokes(kinds, [(bond.tail, bond.head) for bond in graph.bonds])
    one_ports = [name for name, kind in kinds.items() if kind in ONE_PORTS]
    return describe(run_scap(strokes, one_ports))


def describe(assigned: _AssignedStrokes) -> Causality:
    """Return the findings of an assignment as tables and words."""
    strokes = assigned.strokes
    kinds = strokes.kinds
    elements = []
    for name, kind in kinds.items():
        if kind not in ONE_PORTS:
            continue
        (bond,) = strokes.bonds_at[name]
        at_head, how = strokes.at_head[bond], strokes.how[bond]
        effort_in = at_head is strokes.towards(name, bond)
        if kind in SOURCES:
            causality = "fixed"
        elif at_head is None:
            causality = "conflict"
        elif kind in STORAGES:
            causality = "integral" if effort_in is (kind == "I") else "derivative"
        else:
            causality = "conductive" if effort_in else "resistive"
        elements.append(CausalElement(name, kind, causality, "conflict" if at_head is None else how))
    integral = [element.name for element in elements if element.causality == "integral"]
    derivative = [element.name for element in elements if element.causality == "derivative"]
    return Causality(
        bonds=tuple(_bond(strokes, bond) for bond in range(len(strokes.bonds))),
        elements=tuple(elements),
        states=tuple(
            CausalState(f"p_{name}", name, "momentum")
            if kinds[name] == "I"
            else CausalState(f"q_{name}", name, "displacement")
            for name in integral
        ),
        dependent=tuple(explain_dependent(strokes, name) for name in derivative),
        loops=() if assigned.conflicts else algebraic_loops(strokes),
        conflicts=tuple(explain_conflict(strokes, bond, problem) for bond, problem in assigned.conflicts),
    )


def _bond(strokes: Strokes, bond: int) -> CausalBond:
    tail, head = strokes.bonds[bond]
    at_head = strokes.at_head[bond]
    how = "conflict" if at_head is None else strokes.how[bond]
    return CausalBond(tail, head, "tail" if at_head is False else "head", how)
