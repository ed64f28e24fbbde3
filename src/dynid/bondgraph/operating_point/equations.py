"""The equations of a graph with laws: an effort and a flow for every bond, a state for every integral.

Junctions, sources, transformers and elements give the algebraic equations; a state's rate is an effort or a
flow (p of an I: its effort, q of a C: its flow). At an equilibrium all rates vanish. A combination of states
whose rate is zero by the junctions alone is conserved, as the sum of two charges in series: there its value
at the start takes the place of a rate.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from dynid.bondgraph.graph import ACTIVATED, ONE_PORTS, SOURCES, STORAGES, TWO_PORTS, Port, bond_sign
from dynid.bondgraph.operating_point.element_laws import Law, LawGraph
from dynid.errors import Singular

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from scipy.sparse import csr_array

#: A linear equation: coefficients by column, and what they add up to.
Row = dict[int, Fraction]


@dataclass(frozen=True)
class LawRow:
    """An equation with a law: a variable equals sign x law; of a modulus times another variable."""

    node: str
    out: int  # column of the variable
    sign: int
    arguments: tuple[int, ...]  # columns of the law's variables
    #: Column of the variable that a modulus multiplies; -1: the law gives the variable itself.
    factor: int = -1


@dataclass(frozen=True)
class _Conserved:
    """A combination of states whose rate is zero, or the constant that sources give it."""

    weights: Mapping[Port, Fraction]  # its coefficients, by state
    rate: Mapping[str, Fraction]  # its rate by source: coefficients


@dataclass
class LawEquations:
    """The equations of a graph with laws.

    Columns are e and f of every bond, then the states.
    """

    model: LawGraph
    #: Displacements and momenta that are outputs, beside those of storages and laws.
    integrals: Iterable[Port] = ()
    rows: list[tuple[str, Row, str]] = field(default_factory=list)  # node, coefficients, source on the right
    laws: list[LawRow] = field(default_factory=list)

    def __post_init__(self) -> None:
        graph = self.model.graph
        self._bonds: dict[str, list[int]] = {name: [] for name in graph.nodes}
        for index, bond in enumerate(graph.bonds):
            self._bonds[bond.tail].append(index)
            self._bonds[bond.head].append(index)
        needed = [port for law in self.model.laws.values() for port in law.ports]
        of_storages = [
            Port(name, "p" if node.type == "I" else "q")
            for name, node in graph.nodes.items()
            if node.type in STORAGES
        ]
        integrals = [port for port in (*needed, *self.integrals) if port.quantity in "qp"]
        of_outputs = [Port(port.node, port.quantity) for port in integrals]
        self.states: tuple[Port, ...] = tuple(dict.fromkeys([*of_storages, *of_outputs]))
        first = 2 * len(graph.bonds)
        self._places = {state: first + k for k, state in enumerate(self.states)}
        self.size = first + len(self.states)
        #: Columns of the rates of the states.
        rates = (Port(port.node, "e" if port.quantity == "p" else "f") for port in self.states)
        self.rates = list(map(self.column, rates))
        for name in graph.nodes:
            self._add(name)

    def column(self, port: Port) -> int:
        """Return the column of a variable."""
        if port.quantity in "qp":
            return self._places[Port(port.node, port.quantity)]
        return 2 * self._bonds[port.node][0] + (port.quantity == "f")

    def port(self, column: int) -> Port:
        """Return the variable of a column: at an element, else at a junction where it is common."""
        first = 2 * len(self.model.graph.bonds)
        if column >= first:
            return self.states[column - first]
        bond, nodes = self.model.graph.bonds[column // 2], self.model.graph.nodes
        common = "1" if column % 2 else "0"
        ends = [end for end in bond if nodes[end].type in ONE_PORTS]
        ends += [end for end in bond if nodes[end].type == common]
        ends += [end for end in bond if nodes[end].type not in TWO_PORTS]
        return Port([*ends, bond.tail][0], "f" if column % 2 else "e")

    def beside(self, column: int) -> list[int]:
        """Return the columns of the same quantity at the bonds of both ends of a bond."""
        places = [k for end in self.model.graph.bonds[column // 2] for k in self._bonds[end]]
        return [2 * bond + column % 2 for bond in places]

    def _add(self, name: str) -> None:
        graph, kind = self.model.graph, self.model.graph.nodes[name].type
        at = self._bonds[name]
        unity, law = Fraction(1), self.model.laws.get(name)
        if kind in ("0", "1"):
            same, balanced = (0, 1) if kind == "0" else (1, 0)
            for bond in at[1:]:
                self.rows.append((name, {2 * at[0] + same: unity, 2 * bond + same: -unity}, ""))
            signs = {2 * bond + balanced: unity if graph.bonds[bond].head == name else -unity for bond in at}
            self.rows.append((name, signs, ""))
        elif kind in SOURCES:
            self.rows.append((name, {2 * at[0] + (kind == "Sf"): unity}, name))
        elif kind == ACTIVATED:
            self._add_activated(name)
        elif kind in TWO_PORTS:
            into, out = (at[0], at[1]) if graph.bonds[at[0]].head == name else (at[1], at[0])
            pairs = (
                ((2 * into, 2 * out), (2 * out + 1, 2 * into + 1))
                if kind == "TF"
                else ((2 * into, 2 * out + 1), (2 * out, 2 * into + 1))
            )
            for left, right in pairs:
                if law is None:
                    self.rows.append((name, {left: unity, right: -graph.value(name)}, ""))
                else:
                    self.laws.append(LawRow(name, left, 1, self._arguments(law), right))
        else:
            self._add_element(name, law)

    def _add_activated(self, name: str) -> None:
        """Add the signal of a junction's common variable into the balance of another; it loads neither."""
        graph = self.model.graph
        (into, tail), (out, head) = (
            (bond, next(end for end in graph.bonds[bond] if end != name))
            for bond in sorted(self._bonds[name], key=lambda bond: graph.bonds[bond].head != name)
        )
        common, fed = graph.nodes[tail].type == "1", graph.nodes[head].type == "0"
        self.rows.append((name, {2 * into + (not common): Fraction(1)}, ""))
        self.rows.append((name, {2 * out + fed: Fraction(1), 2 * into + common: -graph.value(name)}, ""))

    def _add_element(self, name: str, law: Law | None) -> None:
        graph, kind = self.model.graph, self.model.graph.nodes[name].type
        e, f = self.column(Port(name, "e")), self.column(Port(name, "f"))
        sign = bond_sign(graph, name)
        if law is not None:
            out, factor = (f if law.gives == "f" else e), (f if law.gives == "value" else -1)
            self.laws.append(LawRow(name, out, sign, self._arguments(law), factor))
            return
        value = graph.value(name)
        if kind == "R":
            self.rows.append((name, {e: Fraction(1), f: -sign * value}, ""))
        else:
            out, state = (f, Port(name, "p")) if kind == "I" else (e, Port(name, "q"))
            self.rows.append((name, {out: value, self.column(state): Fraction(-sign)}, ""))

    def _arguments(self, law: Law) -> tuple[int, ...]:
        return tuple(self.column(port) for port in law.ports)

    def same_state(self, port: Port) -> tuple[Port, Fraction]:
        """Return the state of a storage that an integral is a multiple of (but for a constant), else it."""
        graph = self.model.graph
        for kept in self.conserved if port.quantity in "qp" and not graph.is_state(port) else ():
            others = [port_kept for port_kept in kept.weights if port_kept != port]
            if port in kept.weights and len(others) == 1 and graph.is_state(others[0]) and not kept.rate:
                return others[0], -kept.weights[others[0]] / kept.weights[port]
        return port, Fraction(1)

    @cached_property
    def conserved(self) -> list[_Conserved]:
        """Return the combinations of states whose rates the junctions determine, by exact elimination."""
        # Only equations of efforts and flows: junctions, sources, transformers and resistances.
        first = 2 * len(self.model.graph.bonds)
        pivots: dict[int, dict[Any, Fraction]] = {}
        sums = []

        def reduced(row: dict[Any, Fraction]) -> dict[Any, Fraction]:
            while columns := [key for key in row if isinstance(key, int) and key in pivots]:
                column = columns[0]
                factor, pivot = row[column], pivots[column]
                for key, value in pivot.items():
                    row[key] = row.get(key, Fraction(0)) - factor * value
                    if not row[key]:
                        del row[key]
            return row

        def keep(row: dict[Any, Fraction]) -> bool:
            column = next((key for key in row if isinstance(key, int)), None)
            if column is not None:
                pivots[column] = {key: value / row[column] for key, value in row.items()}
            return column is not None

        for _, coefficients, source in self.rows:
            if max(coefficients) >= first:
                continue
            row: dict[Any, Fraction] = {key: value for key, value in coefficients.items() if value}
            row = reduced(row | ({("u", source): Fraction(-1)} if source else {}))
            keep(row)
        for state, rate in zip(self.states, self.rates, strict=True):
            row = reduced({rate: Fraction(1), ("x", state): Fraction(-1)})
            if not keep(row):
                weights = {key[1]: -value for key, value in row.items() if key[0] == "x"}
                sources = {key[1]: value for key, value in row.items() if key[0] == "u"}
                sums.append(_Conserved(weights, sources))
        return sums


@dataclass
class LawSystem:
    """Equations to solve: linear ones and laws."""

    equations: LawEquations
    #: The linear equations: their node, coefficients and right side.
    linear: Sequence[tuple[str, Row, Fraction]]
    lines: bool = False  # whether lines among the linear equations stand in for the laws
    fixed: tuple[int, ...] = ()  # columns of variables that are not solved for; their derivatives are zero

    def __post_init__(self) -> None:
        laws = self.equations.model.laws
        self._laws = [] if self.lines else self.equations.laws
        self._gradients = [laws[row.node].gradient() for row in self._laws]
        self.nodes = [node for node, _, _ in self.linear] + [row.node for row in self._laws]
        entries = [
            (k, column, float(value))
            for k, (_, row, _) in enumerate(self.linear)
            for column, value in row.items()
        ]
        self._where = [np.array([entry[axis] for entry in entries], dtype=int) for axis in (0, 1)]
        self._values = np.array([entry[2] for entry in entries])
        self._right = np.array([float(right) for _, _, right in self.linear])
        self._is_fixed = np.zeros(self.equations.size, dtype=bool)
        self._is_fixed[list(self.fixed)] = True

    def residual(self, z: NDArray[np.float64]) -> tuple[NDArray[np.float64], csr_array]:
        """Return the residuals, and their derivatives by the columns.

        Raises `OutOfRangeError` where a law has no finite value or slope.
        """
        from scipy.sparse import csr_array

        count = len(self.linear)
        rows, columns, slopes, residuals = [], [], [], []
        for k, (law, gradient) in enumerate(zip(self._laws, self._gradients, strict=True), count):
            value, rates = gradient([z[column] for column in law.arguments])
            factor = law.sign * (z[law.factor] if law.factor >= 0 else 1.0)
            residuals.append(z[law.out] - factor * value)
            law_residuals = [
                (law.out, 1.0),
                *((c, -factor * rate) for c, rate in zip(law.arguments, rates, strict=True)),
            ]
            if law.factor >= 0:
                law_residuals.append((law.factor, -law.sign * value))
            rows += [k] * len(law_residuals)
            columns += [column for column, _ in law_residuals]
            slopes += [slope for _, slope in law_residuals]
        shape = (count + len(residuals), self.equations.size)
        where = (
            np.concatenate([self._where[0], rows]).astype(int),
            np.concatenate([self._where[1], columns]).astype(int),
        )
        if self.fixed:
            values, slopes = (
                np.where(self._is_fixed[self._where[1]], 0.0, self._values),
                [
                    0.0 if self._is_fixed[column] else slope
                    for column, slope in zip(columns, slopes, strict=True)
                ],
            )
        else:
            values = self._values
        derivative = csr_array((np.concatenate([values, slopes]), where), shape=shape)
        linear = csr_array((self._values, self._where), shape=(count, shape[1])) @ z - self._right
        return np.concatenate([linear, residuals]), derivative

    def high_residual(self, z: Sequence[Any], gradients: Sequence[Any]) -> list[tuple[Any, Any]]:
        """Return the residuals at high precision, each with the sum of the magnitudes of its terms."""
        from flint import arb, fmpq

        residuals = []
        for _, row, right in self.linear:
            terms = [arb(fmpq(v.numerator, v.denominator)) * z[column] for column, v in row.items()]
            terms.append(-arb(fmpq(right.numerator, right.denominator)))
            residuals.append((sum(terms, arb(0)), sum(map(abs, terms), arb(0))))
        for law, gradient in zip(self.equations.laws, gradients, strict=True):
            value, _ = gradient([z[column] for column in law.arguments])
            term = law.sign * value * (z[law.factor] if law.factor >= 0 else 1)
            residuals.append((z[law.out] - term, abs(z[law.out]) + abs(term)))
        return residuals


def at_rest(
    equations: LawEquations, inputs: Mapping[str, Fraction], start: Mapping[Port, Fraction]
) -> LawSystem:
    """Return the equations of an equilibrium.

    `inputs`: constant values of sources; others are zero. `start`: values of states at the start, which
    determine what is conserved; others are zero. Raises `Singular` where sources change a combination of
    states at a constant rate.
    """
    right = {name: inputs.get(name, Fraction(0)) for name in equations.model.graph.nodes}
    linear = [(node, row, right[source] if source else Fraction(0)) for node, row, source in equations.rows]
    dropped = set()
    for kept in equations.conserved:
        rate = sum((value * right[source] for source, value in kept.rate.items()), Fraction(0))
        if rate:
            names = [str(port) for port in kept.weights]
            raise Singular(
                f"there is no equilibrium: {', '.join(kept.rate)} changes {' and '.join(names)} at a "
                "constant rate",
                remedy="Set the source to zero in 'operating_point.inputs', or add an element that takes it.",
                names=("operating_point", *kept.rate),
            )
        state = list(kept.weights)[-1]
        dropped.add(state)
        value = sum((w * start.get(port, Fraction(0)) for port, w in kept.weights.items()), Fraction(0))
        linear.append((state.node, {equations.column(port): w for port, w in kept.weights.items()}, value))
    for state, column in zip(equations.states, equations.rates, strict=True):
        if state not in dropped:
            linear.append((state.node, {column: Fraction(1)}, Fraction(0)))
    return LawSystem(equations, linear)


def at_point(equations: LawEquations, inputs: Mapping[str, Fraction], values: Iterable[Port]) -> LawSystem:
    """Return the equations beside given variables: rates are free, and so are sources without a value."""
    linear = [
        (node, row, inputs[source] if source else Fraction(0))
        for node, row, source in equations.rows
        if not source or source in inputs
    ]
    return LawSystem(equations, linear, fixed=tuple(map(equations.column, values)))
