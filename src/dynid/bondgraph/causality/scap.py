"""The sequential causality assignment procedure (Karnopp, Margolis & Rosenberg, System Dynamics, ch. 5).

Sources first, then storages one at a time in their preferred, integral causality, then resistances and
whatever is left, each with all that it forces. A stroke that leads to a contradiction is turned round.
Taken one at a time, storages cannot block each other to the wrong effect: sets of storages that
integrate together are the feasible sets of a delta-matroid (of the matchings of the junctions), on which
the greedy choice is the largest (Bouchet 1987), as long as every step can still be completed. Where
forcing alone was blind for that, around a loop, the procedure is run again with a look ahead at each step.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from dynid.bondgraph.causality.completion import Completion
from dynid.bondgraph.causality.strokes import Contradiction, How, Strokes
from dynid.bondgraph.graph import SOURCES, STORAGES


@dataclass
class Assigned:
    """Strokes on every bond, and what could not be had.

    Parameters
    ----------
    strokes
        The strokes.
    conflicts
        The bonds that were left over, with the contradiction that each led to.
    """

    strokes: Strokes
    conflicts: list[tuple[int, Contradiction]]


def run_scap(strokes: Strokes, elements: Iterable[str]) -> Assigned:
    """Complete strokes by the procedure.

    Parameters
    ----------
    strokes
        What is settled already; completed in place where forcing suffices.
    elements
        The one-ports to treat, in the order of preference within their stage.
    """
    elements = list(elements)
    before = strokes.copy()
    assigned = _Procedure(strokes, None).run(elements)
    if any(assigned.strokes.how[bond] != "source" for bond, _ in assigned.conflicts):
        ahead = Completion(before)
        if ahead.feasible:
            return _Procedure(before, ahead).run(elements)
    return assigned


class _Procedure:
    def __init__(self, strokes: Strokes, ahead: Completion | None) -> None:
        self.strokes, self.ahead = strokes, ahead
        self.conflicts: list[tuple[int, Contradiction]] = []

    def run(self, elements: list[str]) -> Assigned:
        strokes, kinds = self.strokes, self.strokes.kinds
        for name in [name for name in strokes.setter if len(strokes.bonds_at[name]) == 1]:
            self._put(
                strokes.bonds_at[name][0], strokes.setting(name, strokes.bonds_at[name][0]), "propagated"
            )
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
        return Assigned(strokes, self.conflicts)

    def _bond(self, name: str) -> int:
        return self.strokes.bonds_at[name][0]

    def _wanted(self, name: str) -> bool:
        """Return the stroke that an element imposes or prefers; a free R imposes effort."""
        bond = self._bond(name)
        return self.strokes.towards(name, bond) is (self.strokes.kinds[name] in ("Sf", "I"))

    def _put(self, bond: int, at_head: bool, how: How) -> None:
        """Put a stroke that has no alternative."""
        problem = self.strokes.put(bond, at_head, how)
        if problem is not None:
            self.strokes.how[bond] = how
            self.conflicts.append((bond, problem))

    def _choose(self, bond: int, at_head: bool) -> None:
        """Put a stroke that is free, at the end from which it settles more: fewer equations are left."""
        strokes = self.strokes
        if strokes.at_head[bond] is None:
            here, there = (self._reach(bond, value) for value in (at_head, not at_head))
            self._prefer(bond, at_head if here >= there else not at_head, "free")

    def _reach(self, bond: int, at_head: bool) -> int:
        """Count the strokes that a stroke would settle."""
        if self._try(bond, at_head, "free") is not None:
            return 0
        return self.strokes.take_back()

    def _prefer(self, bond: int, at_head: bool, how: How) -> None:
        """Put a stroke if it can stand, else its opposite."""
        strokes = self.strokes
        if strokes.at_head[bond] is not None or any(bond == other for other, _ in self.conflicts):
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

    def _try(self, bond: int, at_head: bool, how: How) -> Contradiction | None:
        strokes = self.strokes
        problem = strokes.put(bond, at_head, how)
        if problem is None and self.ahead is not None and not self.ahead.possible(strokes):
            strokes.take_back()
            settled = [b for b, value in enumerate(strokes.at_head) if value is not None]
            return Contradiction("", False, *strokes.roots(settled))
        return problem
