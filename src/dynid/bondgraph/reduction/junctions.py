"""The junction structure of a graph: one unknown and one balance for every junction.

A junction's unknown is its common variable (effort of a 0, flow of a 1), its equation the balance of
the other one: what leaves through elements and bonds equals what sources feed in. One-ports weigh on
their own junction (admittance on a 0, impedance on a 1); a bond, TF or GY couples two junctions with
opposite signs. A source either feeds the balance (flow into a 0, effort into a 1) or fixes the unknown.

Like junctions joined by a plain bond are one junction; where a bond, TF or GY needs a junction that the
user did not draw, a bare one is put in. Neither changes the physics.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass, field
from itertools import count
from typing import NamedTuple

from dynid.bondgraph.graph import ACTIVATED, JUNCTIONS, SOURCES, TWO_PORTS, Bond, BondGraph
from dynid.errors import Singular, UsageError

#: A flow source feeds a 0 and fixes a 1; an effort source feeds a 1 and fixes a 0.
_FIXING = {("0", "Se"), ("1", "Sf")}

#: What fixes a common variable that the equations leave open and nothing depends on: no source, zero.
UNDETERMINED = ""


@dataclass(slots=True)
class Junction:
    """One junction after merging."""

    name: str  # the name of the first user's junction in it, or a made-up one (`a_b`) for a bare junction
    kind: str  # '0' or '1'
    members: list[str] = field(default_factory=list)  # the user's junctions in it; empty for a bare one
    between: tuple[str, ...] = ()  # the user's nodes that a bare junction was put between
    elements: list[str] = field(default_factory=list)  # names of the passive one-ports on it
    #: Sources that feed its balance, with +1 where the arrow points at the junction.
    feeding: list[tuple[str, int]] = field(default_factory=list)
    #: The source that fixes its common variable, if any; `UNDETERMINED` where it is held at zero.
    fixing: str | None = None


class Coupling(NamedTuple):
    """The tail's balance has +c times the head's unknown, the head's has -c times the tail's.

    `two_port` names the TF or GY whose modulus m gives c = m, or c = 1/m where `inverse`; without one
    c = 1. An activated bond is `one_way`: only the head's balance has an entry.
    """

    tail: str
    head: str
    two_port: str | None = None
    inverse: bool = False
    one_way: bool = False

    @property
    def entries(self) -> tuple[tuple[str, str, int], ...]:
        """Row, column and sign of c in the balances."""
        back = (self.head, self.tail, -1)
        return (back,) if self.one_way else ((self.tail, self.head, 1), back)


class JunctionStructure:
    """Junctions, the couplings that tie them, and the place of every one-port.

    `rings`: bonds that close a ring of like junctions: the variable that these do not share is undetermined
    in the ring, and nothing depends on it. Raises `Singular` where two sources fix the same junction.
    """

    def __init__(self, graph: BondGraph) -> None:
        self.graph = graph
        self._names = NameRegistry(graph.nodes)
        self.junctions: dict[str, Junction] = {}
        self.couplings: list[Coupling] = []
        self.place: dict[str, str] = {}
        self._merged, self.rings = _merge_like_junctions(graph)
        self._between: dict[tuple[str, str], str] = {}  # bare junction of a bond at a two-port
        for name, root in self._merged.items():
            junction = self.junctions.setdefault(root, Junction(root, graph.nodes[name].type))
            junction.members.append(name)
            self.place[name] = root
        inner = TWO_PORTS | {ACTIVATED}
        two_ports = {name: None for name, node in graph.nodes.items() if node.type in inner}
        for tail, head in graph.bonds:
            if tail not in two_ports and head not in two_ports:
                a, b = self._merged.get(tail), self._merged.get(head)
                if a is not None and b is not None:
                    if a != b:
                        self.couplings.append(Coupling(a, b))
                elif a is not None:
                    self._attach(head, a, incoming=False)
                elif b is not None:
                    self._attach(tail, b, incoming=True)
                else:  # two one-ports face to face
                    kind = "0" if "Sf" in (self.graph.nodes[tail].type, self.graph.nodes[head].type) else "1"
                    bare = self._bare((tail, head), kind)
                    self._attach(tail, bare, incoming=True)
                    self._attach(head, bare, incoming=False)
        for name in two_ports:
            self._add_two_port(name)
        self.tied: dict[str, list[Coupling]] = {name: [] for name in self.junctions}
        for coupling in self.couplings:
            self.tied[coupling.tail].append(coupling)
            self.tied[coupling.head].append(coupling)

    @property
    def loops(self) -> int:
        """The number of independent loops of a connected structure."""
        return len(self.couplings) - len(self.junctions) + 1

    def _attach(self, name: str, at: str, *, incoming: bool) -> None:
        """Put a one-port on a junction; `incoming` where its arrow points at the junction."""
        junction, node = self.junctions[at], self.graph.nodes[name]
        self.place[name] = at
        if node.type not in SOURCES:
            if not node.value and (junction.kind, node.type) in {("0", "R"), ("0", "I"), ("1", "C")}:
                # its immittance here would be infinite; on a junction of the other kind it is zero
                bare = self._bare((at, name), "1" if junction.kind == "0" else "0")
                self.couplings.append(Coupling(bare, at) if incoming else Coupling(at, bare))
                self.place[name] = bare
                junction = self.junctions[bare]
            junction.elements.append(name)
        elif (junction.kind, node.type) not in _FIXING:
            junction.feeding.append((name, 1 if incoming else -1))
        elif junction.fixing is None:
            junction.fixing = name
        else:
            effort = junction.kind == "0"
            kind, arrangement = ("effort", "parallel") if effort else ("flow", "series")
            remedy_kind, between = ("1", "an R or an I") if effort else ("0", "an R or a C")
            raise Singular(
                f"{kind} sources '{junction.fixing}' and '{name}' both fix the {kind} of junction "
                f"'{junction.name}' (two ideal sources in {arrangement})",
                remedy=f"Put '{name}' on a {remedy_kind}-junction of its own, with {between} that takes up "
                f"the difference of the {kind}s, or drop one of them.",
                names=(name, str(junction.fixing), junction.name),
            )

    def _add_two_port(self, name: str) -> None:
        node = self.graph.nodes[name]
        (inward,) = (bond.tail for bond in self.graph.bonds_of(name) if bond.head == name)
        (outward,) = (bond.head for bond in self.graph.bonds_of(name) if bond.tail == name)
        if node.type == ACTIVATED:
            coupling = Coupling(self._merged[inward], self._merged[outward], name, one_way=True)
            if coupling.tail == coupling.head:  # a one-port on the junction, of minus the value
                raise UsageError(f"activated bond '{name}' ends at the junction where it starts")
            self.couplings.append(coupling)
            return
        primary = self._side(inward, name, incoming=True)
        secondary = self._side(outward, name, incoming=False)
        alike = self.junctions[primary].kind == self.junctions[secondary].kind
        if alike is (node.type == "TF"):
            kind = "1" if self.junctions[primary].kind == "0" else "0"
            bare = self._bare((inward, name), kind)
            self.couplings.append(Coupling(primary, bare))
            primary = bare
        inverse = self.junctions[primary].kind == "0"
        if primary != secondary:  # a GY back onto its own junction neither gives nor takes power
            self.couplings.append(Coupling(primary, secondary, name, inverse))

    def _side(self, neighbour: str, two_port: str, *, incoming: bool) -> str:
        """Return the junction on one side of a two-port, bare where the user drew none."""
        if neighbour in self._merged:
            return self._merged[neighbour]
        bond = (neighbour, two_port) if incoming else (two_port, neighbour)
        if bond not in self._between:
            kind = "0" if self.graph.nodes[neighbour].type == "Sf" else "1"
            self._between[bond] = self._bare(bond, kind)
            if self.graph.nodes[neighbour].type not in TWO_PORTS:
                self._attach(neighbour, self._between[bond], incoming=incoming)
        return self._between[bond]

    def _bare(self, between: tuple[str, str], kind: str) -> str:
        name = self._names.fresh("_".join(between))
        self.junctions[name] = Junction(name, kind, between=between)
        return name


def unique(name: str, names: Collection[str]) -> str:
    """Return a name that is not taken: itself, or with a number behind."""
    if name not in names:
        return name
    return next(numbered for number in count(2) if (numbered := f"{name}_{number}") not in names)


class NameRegistry:
    """Names that are taken, and the last number given to each, so that numbering stays fast."""

    def __init__(self, names: Iterable[str]) -> None:
        self._taken = set(names)
        self._number: dict[str, int] = {}

    def has(self, name: str) -> bool:
        """Test whether a name is taken."""
        return name in self._taken

    def fresh(self, preferred: str) -> str:
        """Return a name that is not taken, and take it: itself, or with a number behind."""
        name = preferred
        while name in self._taken:
            self._number[preferred] = self._number.get(preferred, 1) + 1
            name = f"{preferred}_{self._number[preferred]}"
        self._taken.add(name)
        return name


def _merge_like_junctions(graph: BondGraph) -> tuple[dict[str, str], list[Bond]]:
    """Map every junction to the first of those it is one with (like junctions joined by plain bonds).

    Bonds that close a ring are returned as well.
    """
    kinds = {name: node.type for name, node in graph.nodes.items() if node.type in JUNCTIONS}
    root = {name: name for name in kinds}
    like = [bond for bond in graph.bonds if bond.tail in kinds and kinds[bond.tail] == kinds.get(bond.head)]
    rings: list[Bond] = []
    if not like:
        return root, rings
    order = {name: index for index, name in enumerate(root)}

    def find(name: str) -> str:
        while root[name] != name:
            root[name] = root[root[name]]
            name = root[name]
        return name

    for bond in like:
        a, b = sorted(map(find, bond), key=order.__getitem__)
        if a == b:
            rings.append(bond)
        else:
            root[b] = a
    return {name: find(name) for name in root}, rings


def ring_text(graph: BondGraph, bond: Bond) -> str:
    """Return the warning of a bond that closes a ring of like junctions."""
    kind = graph.nodes[bond.tail].type
    what, medium = ("flow", "effort") if kind == "0" else ("effort", "flow")
    return (
        f"the {what} through the bond '{bond}' is not determined: it closes a ring of {kind}-junctions, "
        f"which share their {medium} already; nothing else depends on it: drop this bond"
    )
