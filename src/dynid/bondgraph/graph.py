"""Bond graphs as the user draws them: nodes, bonds, units, and tests of well-formedness.

Conventions (Park & Kim 1997, section 2): power e*f is positive along a bond's arrow. One-ports with
the bond pointing at them obey R: e = R f, I: e = s I f, C: f = s C e. Two-ports, bond 1 in and bond 2
out: TF of modulus n: e1 = n e2, f2 = n f1; GY of modulus r: e1 = r f2, e2 = r f1. A 0-junction has
one effort, a 1-junction one flow.
"""

from __future__ import annotations

import gc
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from copy import copy
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from itertools import chain
from operator import attrgetter
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, Protocol, get_args

from dynid.arithmetic.numbers import Irrational, OutOfRangeError, coded, field_of
from dynid.errors import UsageError
from dynid.suggestions import did_you_mean

if TYPE_CHECKING:
    from dynid.arithmetic.dependent import Dependent
    from dynid.arithmetic.real_field import RealField

NodeType = Literal["Se", "Sf", "I", "C", "R", "TF", "GY", "0", "1", "A"]
Quantity = Literal["e", "f", "q", "p"]

#: An activated bond with a gain, between two junctions: the common variable of the one before it, times its
#: value, enters the balance of the one behind it. It takes no power; feedback is made of it.
ACTIVATED: Literal["A"] = "A"
#: A line, which is expanded (`transmission_line.py`): scenes have it, graphs do not.
LINE = "TL"
#: The types of nodes that are drawn.
NODE_TYPES: tuple[NodeType, ...] = tuple(kind for kind in get_args(NodeType) if kind != ACTIVATED)
QUANTITIES: tuple[Quantity, ...] = get_args(Quantity)
SOURCES = frozenset({"Se", "Sf"})
STORAGES = frozenset({"I", "C"})
TWO_PORTS = frozenset({"TF", "GY"})
JUNCTIONS = frozenset({"0", "1"})
VALUED = frozenset({"I", "C", "R", "TF", "GY", ACTIVATED})
#: The types by number, as the library has them (`native/plan.c`).
NUMBER_OF_TYPE: dict[str, int] = {kind: number for number, kind in enumerate(get_args(NodeType))}
#: Bonds from which faults are looked for by arrays.
_ARRAY_CHECK_BONDS = 1000
ONE_PORTS = SOURCES | STORAGES | {"R"}
FIELDS = STORAGES | {"R"}


#: SI units by domain: of effort e, flow f, displacement q (the integral of f), momentum p (that of e).
#: `mechanical` is translation; thermal: temperature and heat flow, a pseudo bond graph.
UNITS: dict[str, dict[str, str]] = {
    "mechanical": {"e": "N", "f": "m/s", "q": "m", "p": "N.s"},
    "rotational": {"e": "N.m", "f": "rad/s", "q": "rad", "p": "N.m.s"},
    "electrical": {"e": "V", "f": "A", "q": "A.s", "p": "V.s"},
    "magnetic": {"e": "A", "f": "V", "q": "V.s", "p": "A.s"},
    "hydraulic": {"e": "Pa", "f": "m3/s", "q": "m3", "p": "Pa.s"},
    "acoustic": {"e": "Pa", "f": "m3/s", "q": "m3", "p": "Pa.s"},
    "thermal": {"e": "K", "f": "W", "q": "J", "p": "K.s"},
}
_FACTOR = re.compile(r"([A-Za-z]+)(\d*)")


def unit_quotient(above: str, below: str) -> str:
    """Return the unit of a quotient: `m/s` over `N` is `m/(N.s)`; `1` where nothing is left."""
    powers: dict[str, int] = {}
    for text, sign in ((above, 1), (below, -1)):
        for units, way in zip(text.split("/"), (sign, -sign), strict=False):
            for name, power in _FACTOR.findall(units):
                powers[name] = powers.get(name, 0) + way * int(power or 1)
    top = [_power(name, power) for name, power in powers.items() if power > 0]
    under = [_power(name, -power) for name, power in powers.items() if power < 0]
    if not under:
        return ".".join(top) or "1"
    bottom = ".".join(under)
    return f"{'.'.join(top) or '1'}/{f'({bottom})' if len(under) > 1 else bottom}"


def _power(name: str, power: int) -> str:
    return name if power == 1 else f"{name}{power}"


@contextmanager
def no_collection() -> Iterator[None]:
    """Suspend the search for reference cycles: building a plan makes millions of small objects and no cycle.

    Objects made meanwhile count as old: they are not traversed at once when collection begins again.
    """
    collecting = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collecting:
            if not gc.get_freeze_count():  # objects that a caller has frozen stay frozen
                gc.freeze()
                gc.unfreeze()
            gc.enable()


class _ValueExpression(Protocol):
    """An arithmetic expression that can be evaluated over any number type."""

    @property
    def text(self) -> str:
        """As written."""

    @property
    def names(self) -> frozenset[str]:
        """The names it needs."""

    def fold(self, leaf: Callable[[Fraction | str], Any], apply: Callable[[str, list[Any]], Any], /) -> Any:
        """Evaluate it: `leaf` gives numbers and names a value, `apply` an operation."""


@dataclass(frozen=True, slots=True)
class Node:
    """A node of a bond graph.

    Raises `UsageError` where there is no such domain.
    """

    name: str  # its name, unique in the graph
    type: NodeType  # one of Se, Sf, I, C, R, TF, GY, 0, 1
    #: Inertia, compliance, resistance or modulus in SI units (exact); None for sources and junctions.
    value: Fraction | None = None
    #: The expression behind the value, where formulas are to be written in its names; default: the node's own
    #: name stands for its value.
    formula: _ValueExpression | None = None
    domain: str = ""  # its physical domain, where it is given: one of `UNITS`
    #: The value as a function of unknown parameters, where it is one; `value` is that at the reference.
    dependent: Dependent | None = None
    #: The field or structure that the node was expanded from; empty of a node that the user drew.
    part: str = ""

    def __post_init__(self) -> None:
        if not self.domain:
            return
        if self.domain not in UNITS:
            raise UsageError(
                f"node '{self.name}': there is no domain '{self.domain}'{did_you_mean(self.domain, UNITS)}",
                remedy=f"It is one of {', '.join(UNITS)}.",
                names=(self.name,),
            )


class Bond(NamedTuple):
    """One bond; power is positive from `tail` to `head`."""

    tail: str
    head: str

    def __str__(self) -> str:
        return f"{self.tail} -> {self.head}"


@dataclass(frozen=True)
class Port:
    """A variable of the graph: effort, flow, displacement or momentum at a node.

    `name` is what it is called; default: ``<node>.<quantity>``.
    """

    node: str
    quantity: Quantity
    name: str = ""

    def __str__(self) -> str:
        return self.name or f"{self.node}.{self.quantity}"


@dataclass(frozen=True)
class _GraphFault:
    """A fault of a graph: at a node, or at the bond of that index."""

    message: str
    node: str | None = None
    bond: int | None = None


class BondGraph:
    """A well-formed linear bond graph.

    Irrational values keep their exact meaning: they are coded as fractions (`RealField`).

    `bonds`: the bonds; power is positive from tail to head. Raises `UsageError` where `graph_faults` finds
    anything, or a value is missing.
    """

    @no_collection()
    def __init__(self, nodes: Iterable[Node], bonds: Iterable[Bond]) -> None:
        self.nodes: dict[str, Node] = {node.name: node for node in nodes}
        self.bonds: tuple[Bond, ...] = tuple(bonds)
        faults: list[_GraphFault] = []
        if len(self.bonds) < _ARRAY_CHECK_BONDS or not self._sound():
            faults += graph_faults({name: node.type for name, node in self.nodes.items()}, self.bonds)
        unvalued = [node for node in self.nodes.values() if node.type in VALUED and not node.value]
        faults += [
            _GraphFault(f"{node.type} '{node.name}' has no value", node=node.name)
            for node in unvalued
            if node.value is None
        ]
        faults += [
            _GraphFault(f"the modulus of {node.type} '{node.name}' is zero", node=node.name)
            for node in unvalued
            if node.type in TWO_PORTS and node.value == 0
        ]
        if faults:
            raise UsageError("; ".join(fault.message for fault in faults))
        self.field = self._code()

    def over(self, numbers: Iterable[Fraction]) -> BondGraph:
        """Return the graph over a field that holds other numbers, too."""
        irrational = [number for number in numbers if isinstance(number, Irrational)]
        if not irrational:
            return self
        graph = copy(self)
        graph.nodes = dict(self.nodes)
        graph.field = graph._code(irrational)
        return graph

    def _code(self, others: Sequence[Irrational] = ()) -> RealField | None:
        """Code values that are irrational (`RealField`); return their field, None where all are rational."""
        values = {name: node.value for name, node in self.nodes.items()}
        irrational = {name: value for name, value in values.items() if isinstance(value, Irrational)}
        if not irrational and not others:
            return None
        storages = sum(node.type in STORAGES for node in self.nodes.values())
        try:
            field = field_of([*irrational.values(), *others], storages)
        except OutOfRangeError as error:
            raise UsageError(f"irrational values: {error}", names=tuple(irrational)) from None
        assert field is not None
        for name, value in irrational.items():
            self.nodes[name] = replace(self.nodes[name], value=coded(value, field))
        exact = [
            *(self.nodes[name].value for name in irrational),
            *(coded(number, field) for number in others),
        ]
        return field if any(isinstance(value, Irrational) for value in exact) else None

    def _sound(self) -> bool:
        """Test whether `graph_faults` would find nothing, by arrays; False for bonds to other names, too."""
        import numpy as np

        try:
            tails, heads = self.ends.reshape(-1, 2).T
        except KeyError:
            return False
        inward, outward = (np.bincount(end, minlength=len(self.nodes)) for end in (heads, tails))
        one_port, two_port = (
            np.isin(self.kinds, [NUMBER_OF_TYPE[kind] for kind in kinds])
            for kinds in (ONE_PORTS, TWO_PORTS | {ACTIVATED})
        )
        count = inward + outward
        faulty = (count == 0) | (one_port & (count > 1)) | (two_port & ((inward != 1) | (outward != 1)))
        return not (faulty.any() or (tails == heads).any())

    @cached_property
    def _bonds_at(self) -> dict[str, list[Bond]]:
        bonds_at: dict[str, list[Bond]] = {name: [] for name in self.nodes}
        for bond in self.bonds:
            for end in bond:
                if end in bonds_at:
                    bonds_at[end].append(bond)
        return bonds_at

    @cached_property
    def kinds(self) -> Any:
        """The types of the nodes by number (`NUMBER_OF_TYPE`): an array of shape (nodes,)."""
        import numpy as np

        kinds = [NUMBER_OF_TYPE[node.type] for node in self.nodes.values()]
        return np.array(kinds, dtype=np.int8)

    @cached_property
    def numbers(self) -> dict[str, int]:
        """The numbers of the nodes, by name."""
        return dict(zip(self.nodes, range(len(self.nodes)), strict=True))

    @cached_property
    def ends(self) -> Any:
        """The numbers of tail and head of every bond, one bond after the other: an array of integers."""
        import numpy as np

        number = self.numbers.__getitem__
        return np.fromiter(map(number, chain.from_iterable(self.bonds)), np.int64, 2 * len(self.bonds))

    def value(self, name: str) -> Fraction:
        """Return the exact value of an element or the modulus of a two-port."""
        value = self.nodes[name].value
        if value is None:
            raise UsageError(f"'{name}' has no value")
        return value

    def with_values(self, values: Mapping[str, Fraction]) -> BondGraph:
        """Return the graph with other values of some of its elements."""
        graph = copy(self)
        graph.nodes = {
            name: replace(node, value=values[name], dependent=None) if name in values else node
            for name, node in self.nodes.items()
        }
        graph.field = graph._code()
        return graph

    def rounded(self) -> BondGraph:
        """Return the graph with every value rounded to the nearest double, which is then its exact value.

        Values of nodes that were expanded from a matrix stay: its entries are what is rounded, before.
        """
        nodes = (
            node if node.value is None or node.part else replace(node, value=Fraction(float(node.value)))
            for node in self.nodes.values()
        )
        return BondGraph(nodes, self.bonds)

    def is_state(self, port: Port) -> bool:
        """Test whether an output is the state of a storage: the q of a C, the p of an I."""
        return (self.nodes[port.node].type, port.quantity) in (("C", "q"), ("I", "p"))

    def integrates(self, port: Port) -> bool:
        """Test whether an output is an integral that is no mode of the graph (a storage's own state is)."""
        return port.quantity in "qp" and not self.is_state(port)

    def behind(self, port: Port) -> Port:
        """Return the effort or flow that an output is made of (e of q = C e, f of p = I f and q = ∫f)."""
        effort = port.quantity in ("eq" if self.is_state(port) else "ep")
        return Port(port.node, "e" if effort else "f")

    def bonds_of(self, name: str) -> list[Bond]:
        """Return the bonds at a node, in the user's order."""
        return list(self._bonds_at[name])


def bond_sign(graph: BondGraph, name: str) -> int:
    """Return 1 where the arrow of a one-port's bond points at it, else -1."""
    return 1 if graph.bonds_of(name)[0].head == name else -1


def graph_faults(types: Mapping[str, str], bonds: Sequence[Bond]) -> list[_GraphFault]:
    """Return the faults of a graph's shape: loose ends, and nodes with too many bonds.

    `bonds`: bonds between those nodes; bonds to other names are left to the caller to report.
    """
    faults = [
        _GraphFault(f"the bond '{bond}' ends where it starts", bond=index)
        for index, bond in enumerate(bonds)
        if bond.tail == bond.head
    ]
    proper = [bond for bond in bonds if bond.tail != bond.head] if faults else bonds
    ins, outs = (Counter(map(attrgetter(end), proper)) for end in ("head", "tail"))
    for name, kind in types.items():
        inward, outward = ins.get(name, 0), outs.get(name, 0)
        count = inward + outward
        if count == 0:
            message = "has no bond; connect it or drop it"
        elif kind in ONE_PORTS and count > 1:
            message = f"has {count} bonds but only one port; put a junction between"
        elif kind in TWO_PORTS | {ACTIVATED, LINE} and (inward, outward) != (1, 1):
            message = f"needs one bond in and one bond out; it has {inward} in and {outward} out"
        else:
            continue
        what = f"{kind}-junction" if kind in JUNCTIONS else kind
        faults.append(_GraphFault(f"{what} '{name}' {message}", node=name))
    return faults


def port_fault(types: Mapping[str, str], port: Port) -> str:
    """Return the reason why a variable cannot be an output, or an empty text."""
    kind = types[port.node]
    if kind in TWO_PORTS | {LINE}:
        return f"'{port}': {kind} '{port.node}' has two ports; name the junction or element beside it"
    common = {"0": ("e", "p"), "1": ("f", "q")}.get(kind)
    if common and port.quantity not in common:
        name = "effort" if kind == "0" else "flow"
        instead = f"'{port.node}.{common[0]}'"
        return f"'{port}': a {kind}-junction has one {name} only; ask for {instead} or an element's"
    return ""


def spread_domains(graph: BondGraph, seeds: Mapping[str, str]) -> dict[str, str]:
    """Return the domain of every node that has one for sure.

    A bond joins nodes of one domain; only a TF or GY may stand between two. It has a domain itself where both
    of its sides have the same.
    """
    domains = dict(seeds)
    queue = list(seeds)
    for name in queue:
        for bond in graph.bonds_of(name):
            neighbour = bond.head if bond.tail == name else bond.tail
            if neighbour not in domains and graph.nodes[neighbour].type not in TWO_PORTS | {ACTIVATED}:
                domains[neighbour] = domains[name]
                queue.append(neighbour)
    for name, node in graph.nodes.items():
        if node.type in TWO_PORTS:
            ends = {end for bond in graph.bonds_of(name) for end in (bond.tail, bond.head)} - {name}
            sides = {domains.get(end, "") for end in ends}
            if len(sides) == 1 and "" not in sides:
                domains[name] = sides.pop()
    return domains


class GraphUnits:
    """The units of a graph's variables, as far as domains determine them; else empty.

    `graph`: the graph; its nodes may name their domains.
    """

    def __init__(self, graph: BondGraph) -> None:
        self._graph = graph

    @cached_property
    def domains(self) -> dict[str, str]:
        """The domain of every node that has one for sure."""
        marked = {name: node.domain for name, node in self._graph.nodes.items() if node.domain}
        return spread_domains(self._graph, marked) if marked else {}

    def of(self, node: str, quantity: str) -> str:
        """Return the unit of e, f, q or p at a node."""
        domain = self.domains.get(node, "")
        return UNITS[domain][quantity] if domain else ""

    def of_output(self, port: Port) -> str:
        """Return the unit of an output."""
        return self.of(port.node, port.quantity)

    def of_input(self, source: str) -> str:
        """Return the unit of what a source gives."""
        return self.of(source, "e" if self._graph.nodes[source].type == "Se" else "f")

    def of_channel(self, port: Port, source: str) -> str:
        """Return the unit of output over input; `1` where both have the same."""
        above, below = self.of_output(port), self.of_input(source)
        return unit_quotient(above, below) if above and below else ""
