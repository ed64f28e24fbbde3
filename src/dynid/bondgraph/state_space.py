"""State equations of a graph, derived exactly: algebraic loops solved, dependent storage folded in.

The junction balances with one more unknown for every storage that integrates are E w' = A w + B u with a
diagonal E. Algebraic equations are solved for one unknown each and put into the others, together with
their time derivative, until every unknown that is left has a state equation (index reduction by
substitution). Derivatives of the input that this brings in are taken out of the state equations by a
change of state; what remains of them is the improper part of the outputs.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np

from dynid.bondgraph.graph import SOURCES, Port, bond_sign
from dynid.bondgraph.reduced import ReducedGraph
from dynid.bondgraph.reduction.junctions import Coupling, JunctionStructure
from dynid.errors import NumericalError, Singular

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from dynid.lti.model import StateSpace

#: A linear form: coefficients of unknowns ("w", name), their rates ("dw", name) and the k-th derivative of
#: an input ("u", name, k).
Symbol = tuple[str, str] | tuple[str, str, int]
Form = dict[Symbol, Fraction]


def state_space(reduced: ReducedGraph, initial: Sequence[str] = ()) -> StateSpace:
    """Return the exact state equations of a graph, rounded to doubles.

    The states are common variables of junctions and the efforts or flows of storages that integrate, named
    as ports (`body.f`, `C_a.e`), in SI units; where the input's derivative enters the equations, a multiple
    of the input is taken off them.

    Parameters
    ----------
    reduced
        The graph with its inputs and outputs; only the part that the outputs depend on is modelled.
    initial
        Storages with energy at t = 0. Each adds an input `initial:NAME`: an impulse of strength f(0) on an
        I, e(0) on a C is the equivalent source of Park & Kim 1997, eqs 13 to 16.

    Raises
    ------
    Singular
        Where the equations have no unique solution.
    """
    junctions = {name for reduction in reduced.reductions.values() for name in reduction.junctions}
    system = _Descriptor(reduced.structure, junctions, reduced.inputs, initial)
    forms = [system.output(port) for port in reduced.outputs]
    rates = _solve(system.equations, forms)
    columns = [*reduced.inputs, *(f"initial:{name}" for name in initial)]
    names = [system.name(symbol[1]) for symbol in rates]
    return _as_state_space(rates, forms, columns, [str(port) for port in reduced.outputs], names)


class _Descriptor:
    """The equations of a graph, each a form that equals zero, and the outputs as forms."""

    def __init__(
        self,
        structure: JunctionStructure,
        junctions: Iterable[str],
        inputs: Iterable[str],
        initial: Iterable[str],
    ) -> None:
        self.structure, self.graph = structure, structure.graph
        self.inputs, self.initial = set(inputs), set(initial)
        self.equations: list[Form] = []
        self.responses: dict[str, Form] = {}
        self.balance: dict[str, Form] = {name: {} for name in structure.junctions if name in set(junctions)}
        for name, balance in self.balance.items():
            for element in structure.junctions[name].elements:
                self.responses[element] = self._response(element, name)
                _add(balance, self.responses[element])
            for source, sign in structure.junctions[name].feeding:
                _add(balance, self._input(source), Fraction(-sign))
        for coupling in structure.couplings:
            self._couple(coupling)
        self.equations += [
            form for name, form in self.balance.items() if structure.junctions[name].fixing is None
        ]

    def _couple(self, coupling: Coupling) -> None:
        size = Fraction(1) if coupling.two_port is None else self.graph.value(coupling.two_port)
        size = 1 / size if coupling.inverse else size
        for row, column, sign in coupling.entries:
            if row in self.balance:
                _add(self.balance[row], self._common(column), sign * size)

    def _input(self, source: str) -> Form:
        return {("u", source, 0): Fraction(1)} if source in self.inputs else {}

    def _common(self, junction: str) -> Form:
        """Return the common variable of a junction."""
        fixing = self.structure.junctions[junction].fixing
        return {("w", junction): Fraction(1)} if fixing is None else self._input(fixing)

    def _response(self, element: str, place: str) -> Form:
        """Return what an element answers the common variable with (effort on a 1, flow on a 0)."""
        node, value = self.graph.nodes[element], self.graph.value(element)
        on_one = self.structure.junctions[place].kind == "1"
        stored: Form = {("u", f"initial:{element}", 0): -value} if element in self.initial else {}
        if node.type == "R":
            return _scaled(self._common(place), value if on_one else 1 / value)
        if on_one is (node.type == "I"):  # it answers with a rate: e = I f' - I f(0) delta(t)
            return {**_scaled(_rate(self._common(place)), value), **stored}
        # it integrates: C e' = f + C e(0) delta(t)
        equation: Form = {("dw", element): value, **stored}
        _add(equation, self._common(place), Fraction(-1))
        self.equations.append(equation)
        return {("w", element): Fraction(1)}

    def name(self, unknown: str) -> str:
        """Name an unknown as the variable that it is."""
        if unknown in self.balance:
            return f"{unknown}.{'f' if self.structure.junctions[unknown].kind == '1' else 'e'}"
        if unknown in self.graph.nodes:
            return f"{unknown}.{'e' if self.graph.nodes[unknown].type == 'C' else 'f'}"
        return unknown

    def output(self, port: Port) -> Form:
        """Return a variable of the graph as a form; but for a storage's own state q and p are integrals."""
        if self.graph.is_state(port):
            sign = bond_sign(self.graph, port.node)
            form = self._variable(port.node, "e" if port.quantity == "q" else "f")
            return _scaled(form, sign * self.graph.value(port.node))
        form = self._variable(port.node, "f" if port.quantity in "fq" else "e")
        if port.quantity in "ef":
            return form
        name = f"integral:{port}"
        self.equations.append({("dw", name): Fraction(1), **_scaled(form, Fraction(-1))})
        return {("w", name): Fraction(1)}

    def _variable(self, name: str, quantity: str) -> Form:
        node, place = self.graph.nodes[name], self.structure.place[name]
        junction = self.structure.junctions[place]
        if node.type in SOURCES and quantity == ("e" if node.type == "Se" else "f"):
            return self._input(name)
        if quantity == ("f" if junction.kind == "1" else "e"):
            return self._common(place)
        sign = Fraction(bond_sign(self.graph, name))
        if node.type in SOURCES:  # the reaction of a source that fixes the junction
            return _scaled(self.balance[place], -sign)
        return _scaled(self.responses[name], sign)


def _solve(equations: list[Form], outputs: list[Form]) -> dict[Symbol, Form]:
    """Return w' as a form in w and inputs for every unknown that is left; outputs are rewritten in place."""
    pending = [dict(form) for form in equations]
    while True:
        rates, algebraic = _split(pending)
        if not algebraic:
            break
        pending = [*rates.values()]
        for form in algebraic:
            _eliminate(form, pending, algebraic, outputs)
    open_unknowns = {s[1] for form in pending for s in form if s[0] == "w"} - {pivot[1] for pivot in rates}
    if open_unknowns:
        raise _contradiction()
    solved = {
        pivot: _scaled({k: v for k, v in form.items() if k != pivot}, Fraction(-1))
        for pivot, form in rates.items()
    }
    for form in outputs:
        for pivot, rate in solved.items():
            if pivot in form:
                _add(form, rate, form.pop(pivot))
    return solved


def _split(forms: list[Form]) -> tuple[dict[Symbol, Form], list[Form]]:
    """Gauss-Jordan on the rates: equations solved for one rate each, and equations without any."""
    rates: dict[Symbol, Form] = {}
    algebraic: list[Form] = []
    for form in forms:
        for known, row in rates.items():
            if known in form:
                _add(form, row, -form[known])
        pivot = next((symbol for symbol in form if symbol[0] == "dw"), None)
        if pivot is None:
            algebraic.append(form)
            continue
        solved = _scaled(form, 1 / form[pivot])
        for row in rates.values():
            if pivot in row:
                _add(row, solved, -row[pivot])
        rates[pivot] = solved
    return rates, algebraic


def _eliminate(form: Form, pending: list[Form], algebraic: list[Form], outputs: list[Form]) -> None:
    """Solve an algebraic equation for one unknown, and put it and its rate into everything else."""
    moving = {symbol[1] for other in pending for symbol in other if symbol[0] == "dw"}
    unknowns = [symbol for symbol in form if symbol[0] == "w"]
    if not unknowns:
        raise _contradiction()
    pivot = min(unknowns, key=lambda symbol: symbol[1] in moving)
    value = _scaled({k: v for k, v in form.items() if k != pivot}, -1 / form[pivot])
    rate_symbol, rate = ("dw", pivot[1]), _rate(value)
    form.clear()
    for other in [*pending, *algebraic, *outputs]:
        if rate_symbol in other:
            _add(other, rate, other.pop(rate_symbol))
        if pivot in other:
            _add(other, value, other.pop(pivot))


def _contradiction() -> Singular:
    return Singular(
        "the state equations of this graph contradict each other or leave a variable open",
        remedy="Look for junctions without elements in a loop, or sources that meet without one.",
    )


def _rate(form: Form) -> Form:
    """Differentiate a form in time."""
    return {
        ("dw", symbol[1]) if symbol[0] == "w" else ("u", symbol[1], symbol[2] + 1): value  # type: ignore[misc]
        for symbol, value in form.items()
    }


def _add(form: Form, other: Form, factor: Fraction = Fraction(1)) -> None:
    """Add a multiple of another form in place; zero coefficients disappear."""
    for symbol, value in list(other.items()):
        total = form.get(symbol, 0) + factor * value
        if total:
            form[symbol] = total
        else:
            form.pop(symbol, None)


def _scaled(form: Form, factor: Fraction) -> Form:
    return {symbol: factor * value for symbol, value in form.items()}


def _as_state_space(
    rates: dict[Symbol, Form],
    outputs: list[Form],
    inputs: list[str],
    ports: list[str],
    names: list[str],
) -> StateSpace:
    from dynid.lti.model import StateSpace

    states = [symbol[1] for symbol in rates]
    highest = max((s[2] for form in [*rates.values(), *outputs] for s in form if s[0] == "u"), default=0)  # type: ignore[misc]
    dynamic, orders = list(rates.values()), range(highest + 1)
    a = _matrix(dynamic, [("w", name) for name in states])
    c = _matrix(outputs, [("w", name) for name in states])
    b = [_matrix(dynamic, [("u", name, k) for name in inputs]) for k in orders]
    d = [_matrix(outputs, [("u", name, k) for name in inputs]) for k in orders]
    for k in reversed(orders[1:] if states else ()):  # w = v + B_k u^(k-1) takes u^(k) out of w'
        b[k - 1] = b[k - 1] + a @ b[k]
        d[k - 1] = d[k - 1] + c @ b[k]
    feedthrough = [_floats(table) for table in d]
    while len(feedthrough) > 1 and not feedthrough[-1].any():
        feedthrough.pop()
    return StateSpace(
        A=_floats(a),
        B=_floats(b[0]),
        C=_floats(c),
        D=feedthrough[0],
        higher=tuple(feedthrough[1:]),
        inputs=tuple(inputs),
        outputs=tuple(ports),
        states=tuple(names),
    )


def _matrix(forms: list[Form], columns: list[Symbol]) -> NDArray[np.object_]:
    entries = [form.get(column, Fraction(0)) for form in forms for column in columns]
    return np.array(entries, dtype=object).reshape(len(forms), len(columns))


def _floats(table: NDArray[np.object_] | list[Fraction]) -> NDArray[np.float64]:
    """Round exact numbers to doubles."""
    try:
        return np.asarray(table, dtype=float)
    except OverflowError:
        raise NumericalError(
            "a coefficient of the state equations is beyond the range of numbers",
            remedy="Choose units that bring the parameters nearer to 1.",
        ) from None
