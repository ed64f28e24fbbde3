"""Causal strokes on bonds, and what one stroke forces on others.

The stroke of a bond marks the end that effort is imposed towards; flow is imposed the other way. A
0-junction takes its effort from exactly one bond, a 1-junction its flow; a TF passes effort on, so that
one of its two strokes is at it, and a GY turns effort into flow, so that both are or neither is.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from dynid.bondgraph.graph import JUNCTIONS, TWO_PORTS

StrokeReason = Literal["source", "preferred", "free", "propagated", "bicausal", "conflict"]


@dataclass(frozen=True)
class Contradiction:
    """Strokes that cannot stand together."""

    node: str  # the node whose rule they break
    surplus: bool  # whether the node's rule is met twice; else it is not met at all
    roots: tuple[int, ...]  # the bonds whose strokes were chosen, not forced, that it follows from
    nodes: tuple[str, ...]  # the nodes that lie between


class Strokes:
    """A partial assignment of strokes, closed under what they force."""

    def __init__(self, kinds: Mapping[str, str], bonds: Sequence[tuple[str, str]]) -> None:
        self.kinds, self.bonds = kinds, bonds
        self.bonds_at: dict[str, list[int]] = {name: [] for name in kinds}
        for bond, ends in enumerate(bonds):
            for end in ends:
                self.bonds_at[end].append(bond)
        #: Whether the stroke is at the head; None while it is open.
        self.at_head: list[bool | None] = [None] * len(bonds)
        self.how: list[StrokeReason] = ["propagated"] * len(bonds)
        self.causes: list[tuple[int, ...]] = [()] * len(bonds)
        self.between: dict[int, tuple[str, ...]] = {}
        self.setter: dict[str, int | None] = {n: None for n, kind in kinds.items() if kind in JUNCTIONS}
        self._open = {name: len(self.bonds_at[name]) for name in self.setter}
        self._latest: list[int] = []

    def copy(self) -> Strokes:
        """Return an independent copy."""
        copied = Strokes(self.kinds, self.bonds)
        copied.at_head, copied.how, copied.causes = self.at_head[:], self.how[:], self.causes[:]
        copied.between, copied.setter, copied._open = dict(self.between), dict(self.setter), dict(self._open)
        return copied

    # --- reading -------------------------------------------------------------------------------

    def other_end(self, bond: int, node: str) -> str:
        """Return the node at the other end of a bond."""
        tail, head = self.bonds[bond]
        return tail if node == head else head

    def sets(self, node: str, bond: int, at_head: bool | None = None) -> bool:
        """Test whether a bond sets the common variable of a junction at its end."""
        stroke = self.at_head[bond] if at_head is None else at_head
        return (stroke is (self.bonds[bond][1] == node)) is (self.kinds[node] == "0")

    def towards(self, node: str, bond: int) -> bool:
        """Return the value of `at_head` that puts the stroke at this node."""
        return self.bonds[bond][1] == node

    def roots(self, bonds: Iterable[int]) -> tuple[tuple[int, ...], tuple[str, ...]]:
        """Return the chosen strokes that these strokes follow from, and the inner nodes on the way."""
        seen, nodes = dict.fromkeys(bonds), dict[str, None]()
        queue = deque(seen)
        roots = []
        while queue:
            bond = queue.popleft()
            nodes |= dict.fromkeys((*self.bonds[bond], *self.between.get(bond, ())))
            if not self.causes[bond]:
                roots.append(bond)
            for cause in self.causes[bond]:
                if cause not in seen:
                    seen[cause] = None
                    queue.append(cause)
        inner = (name for name in nodes if self.kinds[name] in JUNCTIONS | TWO_PORTS)
        return tuple(roots), tuple(inner)

    # --- writing -------------------------------------------------------------------------------

    def put(
        self, bond: int, at_head: bool, how: StrokeReason, causes: tuple[int, ...] = ()
    ) -> Contradiction | None:
        """Put a stroke and all that it forces, or nothing where that leads to a contradiction."""
        trail = self._latest = []
        queue = deque([(bond, at_head, how, causes)])
        while queue:
            current, value, reason, because = queue.popleft()
            if self.at_head[current] is not None:
                if self.at_head[current] is value:
                    continue
                # a stroke that is wanted at one end stands at the other
                end = next((end for end in self.bonds[current] if end in self.setter), None)
                surplus = end is None or self.sets(end, current, value)
                clashing = (current, *because)
                problem = self._contradiction(end or self.bonds[current][0], clashing, surplus=surplus)
            else:
                self.at_head[current], self.how[current], self.causes[current] = value, reason, because
                trail.append(current)
                for node in self.bonds[current]:
                    if node in self._open:
                        self._open[node] -= 1
                problem = None
                for node in self.bonds[current]:
                    problem = problem or self._force(node, current, queue)
            if problem is not None:
                self.take_back()
                return problem
        return None

    def _force(
        self, node: str, bond: int, queue: deque[tuple[int, bool, StrokeReason, tuple[int, ...]]]
    ) -> Contradiction | None:
        """Queue what a new stroke forces at one of its ends."""
        kind = self.kinds[node]
        if kind in TWO_PORTS:
            for neighbour in self.bonds_at[node]:
                if neighbour != bond:
                    here = (self.at_head[bond] is self.towards(node, bond)) is (kind == "GY")
                    queue.append((neighbour, here is self.towards(node, neighbour), "propagated", (bond,)))
        elif kind in JUNCTIONS and self.sets(node, bond):
            earlier = self.setter[node]
            if earlier is not None:
                return self._contradiction(node, (earlier, bond), surplus=True)
            self.setter[node] = bond
            for neighbour in self.bonds_at[node]:
                if self.at_head[neighbour] is None:
                    queue.append((neighbour, not self.setting(node, neighbour), "propagated", (bond,)))
        elif kind in JUNCTIONS and self.setter[node] is None and self._open[node] < 2:
            last = [open_bond for open_bond in self.bonds_at[node] if self.at_head[open_bond] is None]
            others = tuple(other for other in self.bonds_at[node] if self.at_head[other] is not None)
            if not last:
                return self._contradiction(node, others, surplus=False)
            queue.append((last[0], self.setting(node, last[0]), "propagated", others))
        return None

    def setting(self, node: str, bond: int) -> bool:
        """Return the value of `at_head` with which a bond sets a junction."""
        return self.towards(node, bond) is (self.kinds[node] == "0")

    def _contradiction(self, node: str, bonds: tuple[int, ...], *, surplus: bool) -> Contradiction:
        roots, nodes = self.roots(bonds)
        return Contradiction(node, surplus, roots, nodes)

    def take_back(self) -> int:
        """Take back all that was put last; return how many strokes that were."""
        count = len(self._latest)
        for bond in self._latest:
            for node in self.bonds[bond]:
                if node in self._open:
                    self._open[node] += 1
                    if self.setter[node] == bond:
                        self.setter[node] = None
            self.at_head[bond], self.causes[bond] = None, ()
        self._latest = []
        return count
