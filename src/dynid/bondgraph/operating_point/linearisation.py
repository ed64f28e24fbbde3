"""The linearisation of a graph with laws: a bond graph whose values are slopes, with activated bonds.

The slope of a law by its own variable becomes the value of the element; the slope by another variable an
activated bond from a sensor of that variable into the balance beside the element. A modulus n(x) of a
transformer gives two: de1 = n de2 + e2 n' dx and df2 = n df1 + f1 n' dx. A slope of zero makes an element a
junction of one bond, with the effort or the flow zero.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction
from math import isfinite
from typing import TYPE_CHECKING, Any

from dynid.arithmetic.dependent import Real
from dynid.arithmetic.numbers import OutOfRangeError
from dynid.bondgraph.controller_circuits import Circuit
from dynid.bondgraph.graph import STORAGES, TWO_PORTS, Bond, BondGraph, Node, NodeType, Port, Quantity
from dynid.bondgraph.reduction.junctions import unique
from dynid.errors import Singular

if TYPE_CHECKING:
    from dynid.bondgraph.operating_point.equations import LawRow
    from dynid.bondgraph.operating_point.equilibrium import OperatingPoint

_SLOPE_BITS = 256


@dataclass(frozen=True)
class _LawSlopes:
    """An equation of a law at a point: what it gives, and its slopes."""

    row: LawRow  # the equation
    value: float  # what the law gives, times another variable where it is a modulus
    slopes: dict[int, Any]  # derivatives by column, those by the element's own variable and by others


@dataclass(frozen=True)
class Linearisation:
    """A graph with laws as a linear one."""

    graph: BondGraph
    variables: dict[Port, Port]  # variables that are elsewhere in it, under the names that they had
    slopes: tuple[_LawSlopes, ...]  # the slopes of the laws, rounded to doubles
    #: Nodes whose law has the slope zero by its own variable: they are junctions of one bond.
    flat: tuple[str, ...]
    point: OperatingPoint


def linearised(point: OperatingPoint) -> Linearisation:
    """Return the linearisation of a graph at a point; every slope is rounded once.

    Raises `Singular` where a law has a kink at the point, or no finite slope.
    """
    from flint import ctx

    with ctx.workprec(_SLOPE_BITS):
        exact = _law_slopes(point)
        circuit = _LinearCircuit(point, exact)
    rounded = tuple(
        _LawSlopes(
            law_slopes_of.row,
            law_slopes_of.value,
            {column: float(slope) for column, slope in law_slopes_of.slopes.items()},
        )
        for law_slopes_of in exact
    )
    graph = BondGraph(circuit.nodes.values(), circuit.bonds)
    return Linearisation(graph, circuit.variables, rounded, tuple(dict.fromkeys(circuit.flat)), point)


def _law_slopes(point: OperatingPoint) -> list[_LawSlopes]:
    """Return the equations of the laws with their slopes, at high precision."""
    from flint import arb

    laws, z = point.equations.model.laws, point.solution.exact
    rows = []
    for row in point.equations.laws:
        law = laws[row.node]
        gradient, arguments = law.gradient(high=True), [z[column] for column in row.arguments]
        where = ", ".join(f"{n} = {float(v):.6g}" for n, v in zip(law.variables, arguments, strict=True))
        try:
            (value, right), (_, left) = gradient(arguments), gradient(arguments, side=-1.0)
        except OutOfRangeError as error:
            problem = f"cannot be linearised at the operating point ({where}): {error}"
            raise _no_slope(row.node, problem) from None
        factor = z[row.factor] if row.factor >= 0 else arb(1)
        slopes: dict[int, Any] = {} if row.factor < 0 else {row.factor: value}
        for name, column, upper, lower in zip(law.variables, row.arguments, right, left, strict=True):
            if not upper.overlaps(lower):
                sides = f"{float(lower):.6g} on one side and {float(upper):.6g} on the other"
                kink = f"has a kink at the operating point ({where}): its slope by {name} is {sides}"
                raise _no_slope(row.node, kink)
            slopes[column] = slopes.get(column, arb(0)) + factor * upper
        if not all(isfinite(float(number)) for number in (value * factor, *slopes.values())):
            problem = f"has a slope beyond the range of numbers at the operating point ({where})"
            raise _no_slope(row.node, problem)
        rows.append(_LawSlopes(row, float(value * factor), slopes))
    return rows


def _no_slope(node: str, problem: str) -> Singular:
    return Singular(
        f"the law of '{node}' {problem}",
        remedy="Choose another operating point, or a law that is smooth there.",
        names=(node, "operating_point"),
    )


class _LinearCircuit(Circuit):
    """The linear graph at a point."""

    part = "law"

    def __init__(self, point: OperatingPoint, slopes: list[_LawSlopes]) -> None:
        self._equations = equations = point.equations
        self.flat: list[str] = []
        self._measured: dict[Port, tuple[str, Real]] = {}
        self._ends: dict[
            int, str
        ] = {}  # by bond the node that a law stands for, where it is not that of the law
        super().__init__(self._valued(slopes))
        places = {}
        for law_slope in slopes:
            own, slopes_of_law = self._own(law_slope), law_slope.slopes.items()
            slope_of_others = {
                column: slope for column, slope in slopes_of_law if column != own and float(slope)
            }
            if slope_of_others or law_slope.row.node in self.flat:
                places[law_slope.row] = self._balance(law_slope.row), slope_of_others
        for row, (junction, others) in places.items():
            at_head = equations.model.graph.bonds[row.out // 2].head == row.node
            ports = dict(zip(row.arguments, equations.model.laws[row.node].ports, strict=True))
            for column, slope in others.items():
                gain = Fraction(float(-row.sign * slope if at_head else row.sign * slope))
                sensor, scale = self.measure(ports[column], row.node)
                self._activate(sensor, junction, gain * scale)

    def measure(self, port: Port, owner: str) -> tuple[str, Real]:
        """Return a junction whose common variable, times a factor, is a variable of the graph.

        An integral that a storage has as its state, but for a constant, is measured there.
        """
        if port not in self._measured:
            state, factor = self._equations.same_state(port)
            at, scale = super().measure(state, owner)
            self._measured[port] = at, factor * scale
        return self._measured[port]

    def _activate(self, tail: str, head: str, gain: Real) -> None:
        """Add an activated bond; to a junction that is one with its own, a resistance of minus the gain."""
        if not gain or head not in self._merged(tail):
            super()._activate(tail, head, gain)
            return
        value = -gain if self.nodes[head].type == "1" else -1 / gain
        resistance = self._add("R", f"{tail}_to_{head.rpartition('.')[2]}", value)
        self.bonds.append(Bond(head, resistance))

    def _merged(self, junction: str) -> set[str]:
        """Return the junctions of one kind that bonds join to a junction."""
        kind, reached, queue = self.nodes[junction].type, {junction}, [junction]
        while queue:
            current = queue.pop()
            ends = {end for bond in self.bonds if current in bond for end in bond} - reached
            queue += (new := [end for end in ends if self.nodes[end].type == kind])
            reached.update(new)
        return reached

    def _own(self, law_slope: _LawSlopes) -> int:
        """Return the column by which the slope of a law is the value of its node."""
        model = self._equations.model
        two_port = model.graph.nodes[law_slope.row.node].type in TWO_PORTS
        return law_slope.row.factor if two_port else self._equations.column(model.own(law_slope.row.node))

    def _valued(self, slopes: list[_LawSlopes]) -> BondGraph:
        """Return the graph with slopes as values; where one is zero, with a junction of one bond."""
        graph = self._equations.model.graph
        nodes, bonds = dict(graph.nodes), list(graph.bonds)
        for law_slope in slopes:
            name, kind, gives = (
                law_slope.row.node,
                graph.nodes[law_slope.row.node].type,
                law_slope.row.out % 2,
            )
            slope = law_slope.slopes.get(self._own(law_slope), 0.0)
            if float(slope):
                inverse = kind in STORAGES or (gives and kind == "R")
                value = Fraction(float(1 / slope if inverse else slope))
                nodes[name] = replace(nodes[name], value=value, formula=None, dependent=None)
                continue
            self.flat.append(name)
            index, end = law_slope.row.out // 2, name
            if name in self.flat[:-1]:  # the other side of a two-port
                end = unique(name, nodes)
                bond = bonds[index]
                bonds[index] = Bond(*(end if one_end == name else one_end for one_end in bond))
            self._ends[index] = end
            nodes[end] = Node(end, "0" if gives else "1", domain=nodes[name].domain, part=self.part)
        return BondGraph(nodes.values(), bonds)

    def _balance(self, row: LawRow) -> str:
        """Return the junction beside a node, in whose balance what other variables contribute enters.

        The effort or flow that an element has with it is measured in front of that junction.
        """
        kind: NodeType = "0" if row.out % 2 else "1"
        end = self._ends.get(row.out // 2, row.node)
        stem = f"{row.node}.{'ef'[row.out % 2]}"
        index = end if row.node in self.flat else self._insert(kind, f"{stem}_sum", end, row)
        if self._equations.model.graph.nodes[row.node].type not in TWO_PORTS:
            outer: NodeType = "1" if row.out % 2 else "0"
            sensor = self._insert(outer, f"{stem}_total", index, row)
            quantities: tuple[Quantity, ...] = ("f", "q") if row.out % 2 else ("e", "p")
            name = row.node
            self.variables |= {Port(name, q): Port(sensor, q, f"{name}.{q}") for q in quantities}
        return index

    def _insert(self, kind: NodeType, preferred: str, end: str, row: LawRow) -> str:
        """Insert a junction into the bond of a law, beside one of the nodes along it."""
        at_head = self._equations.model.graph.bonds[row.out // 2].head == row.node
        index = next(k for k, bond in enumerate(self.bonds) if (bond.head if at_head else bond.tail) == end)
        tail, head = self.bonds[index]
        junction = self._add(kind, preferred)
        self.bonds[index : index + 1] = [Bond(tail, junction), Bond(junction, head)]
        return junction
