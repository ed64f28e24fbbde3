"""The descriptor equations of a graph, as linear forms over any field of numbers.

The equations are the junction balances, with one more unknown for every storage that integrates. A form is
linear in unknowns, their rates and the derivatives of inputs.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

from dynid.bondgraph.graph import SOURCES, Port, bond_sign
from dynid.bondgraph.reduction.junctions import Coupling, JunctionStructure
from dynid.errors import Singular

if TYPE_CHECKING:
    from dynid.bondgraph.graph import BondGraph
    from dynid.bondgraph.plan import ReducedGraph


# --- linear forms ---------------------------------------------------------------------------------

#: An unknown ("w", name), its rate ("dw", name), or the k-th derivative of an input ("u", name, k).
FormSymbol = tuple[str, str] | tuple[str, str, int]
#: Coefficients by symbol, none of them zero.
LinearForm = dict[FormSymbol, Any]


@dataclass(frozen=True)
class NumberField:
    """The numbers that equations are written in: exact rationals, or formulas in the parameters.

    Parameters
    ----------
    value
        The value of an element or the modulus of a two-port, by name.
    one
        The number 1. Numbers have `+ - * /`, and are false where they are zero.
    """

    value: Callable[[str], Any]
    one: Any

    @classmethod
    def rational(cls, graph: BondGraph) -> Self:
        """Return the field of the rationals, with the values of a graph."""
        from flint import fmpq

        def value(name: str) -> Any:
            exact = graph.value(name)
            return fmpq(exact.numerator, exact.denominator)

        return cls(value, fmpq(1))


def add(form: LinearForm, other: LinearForm, factor: Any = None) -> None:
    """Add a multiple of another form in place; zero coefficients disappear."""
    for symbol, value in other.items():
        term = value if factor is None else factor * value
        total = form[symbol] + term if symbol in form else term
        if total:
            form[symbol] = total
        else:
            form.pop(symbol, None)


def scaled(form: LinearForm, factor: Any) -> LinearForm:
    """Return a multiple of a form."""
    return {symbol: factor * value for symbol, value in form.items()}


def rate(form: LinearForm) -> LinearForm:
    """Differentiate a form in time."""
    return {_rate_of(symbol): value for symbol, value in form.items()}


def _rate_of(symbol: FormSymbol) -> FormSymbol:
    if len(symbol) == 3:
        return ("u", symbol[1], symbol[2] + 1)
    return ("dw", symbol[1])


def contradiction() -> Singular:
    """Return the error for equations without a unique solution."""
    return Singular(
        "the state equations of this graph contradict each other or leave a variable open",
        remedy="Look for junctions without elements in a loop, or sources that meet without one.",
    )


# --- descriptor equations -------------------------------------------------------------------------


class Descriptor:
    """The equations of a part of a graph, each a form that equals zero.

    Parameters
    ----------
    structure
        The junction structure.
    junctions
        The junctions to model.
    field
        The numbers to write in.
    inputs
        Sources that are inputs; all others are zero.
    initial
        Storages with energy at t = 0, each an input `initial:NAME`.
    freed
        A source whose signal is an unknown, not an input.
    """

    def __init__(
        self,
        structure: JunctionStructure,
        junctions: Iterable[str],
        field: NumberField,
        *,
        inputs: Iterable[str] = (),
        initial: Iterable[str] = (),
        freed: str | None = None,
    ) -> None:
        self.structure, self.graph, self.field = structure, structure.graph, field
        self.inputs, self.initial, self.freed = set(inputs), set(initial), freed
        modelled = set(junctions)
        self.equations: list[LinearForm] = []
        self._owners: list[str] = []  # the storage or junction behind each equation
        self._responses: dict[str, LinearForm] = {}
        self._integrals: dict[str, LinearForm] = {}
        self._balance: dict[str, LinearForm] = {name: {} for name in structure.junctions if name in modelled}
        for name, balance in self._balance.items():
            for element in structure.junctions[name].elements:
                self._responses[element] = self._response(element, name)
                add(balance, self._responses[element])
            for source, sign in structure.junctions[name].feeding:
                add(balance, self.signal(source), -sign)
        for coupling in structure.couplings:
            self._couple(coupling)
        for name, form in self._balance.items():
            if structure.junctions[name].fixing is None:
                self.equations.append(form)
                self._owners.append(name)
        self.equations += self._integrals.values()
        self._owners += self._integrals

    def _couple(self, coupling: Coupling) -> None:
        if coupling.tail not in self._balance and coupling.head not in self._balance:
            return
        one = self.field.one
        size = one if coupling.two_port is None else self.field.value(coupling.two_port)
        size = one / size if coupling.inverse else size
        for row, column, sign in coupling.entries:
            if row in self._balance:
                add(self._balance[row], self._common(column), size * sign)

    def signal(self, source: str) -> LinearForm:
        """Return what a source imposes."""
        if source == self.freed:
            return {("w", source): self.field.one}
        return {("u", source, 0): self.field.one} if source in self.inputs else {}

    def _common(self, junction: str) -> LinearForm:
        """Return the common variable of a junction."""
        fixing = self.structure.junctions[junction].fixing
        return {("w", junction): self.field.one} if fixing is None else self.signal(fixing)

    def _response(self, element: str, place: str) -> LinearForm:
        """Return what an element answers the common variable with (effort on a 1, flow on a 0)."""
        node, value = self.graph.nodes[element], self.field.value(element)
        on_one = self.structure.junctions[place].kind == "1"
        stored: LinearForm = {("u", f"initial:{element}", 0): -value} if element in self.initial else {}
        if node.type == "R":
            size = value if on_one else self.field.one / value
            return scaled(self._common(place), size) if size else {}
        if on_one is (node.type == "I"):  # it answers with a rate: e = I f' - I f(0) delta(t)
            return {**scaled(rate(self._common(place)), value), **stored} if value else {}
        # it integrates: C e' = f + C e(0) delta(t); what it stores is given along the arrow of its bond
        stored = scaled(stored, self.field.one * bond_sign(self.graph, element))
        equation: LinearForm = {("dw", element): value, **stored} if value else {}
        add(equation, self._common(place), -self.field.one)
        self._integrals[element] = equation
        return {("w", element): self.field.one}

    def name(self, unknown: str) -> str:
        """Name an unknown as the variable that it is."""
        if unknown in self._balance:
            return f"{unknown}.{'f' if self.structure.junctions[unknown].kind == '1' else 'e'}"
        if unknown in self.graph.nodes:
            return f"{unknown}.{'e' if self.graph.nodes[unknown].type in ('C', 'Se') else 'f'}"
        return unknown

    def carriers(self, rows: Iterable[int], unknowns: Collection[str]) -> list[str]:
        """Name the one-ports that act on these unknowns in these equations of the graph."""
        found: dict[str, None] = {}
        for owner in (self._owners[row] for row in rows if row < len(self._owners)):
            if owner in self._responses:
                found[owner] = None
                continue
            for element in self.structure.junctions[owner].elements:
                if any(symbol[1] in unknowns for symbol in self._responses[element]):
                    found[element] = None
        return [name for name in self.graph.nodes if name in found]

    def output(self, port: Port) -> LinearForm:
        """Return a variable of the graph as a form; but for a storage's own state q and p are integrals."""
        form = self._variable(port.node, self.graph.behind(port).quantity)
        if self.graph.is_state(port):
            value = self.field.value(port.node) * bond_sign(self.graph, port.node)
            return scaled(form, value) if value else {}
        if port.quantity in "ef":
            return form
        name = f"integral:{port}"
        self.equations.append({("dw", name): self.field.one, **scaled(form, -self.field.one)})
        return {("w", name): self.field.one}

    def _variable(self, name: str, quantity: str) -> LinearForm:
        node, place = self.graph.nodes[name], self.structure.place[name]
        junction = self.structure.junctions[place]
        if node.type in SOURCES and quantity == ("e" if node.type == "Se" else "f"):
            return self.signal(name)
        if quantity == ("f" if junction.kind == "1" else "e"):
            return self._common(place)
        sign = self.field.one * bond_sign(self.graph, name)
        if node.type in SOURCES:  # the reaction of a source that fixes the junction
            return scaled(self._balance[place], -sign)
        return scaled(self._responses[name], sign)


def constrained(
    reduced: ReducedGraph, port: Port, source: str, field: NumberField
) -> tuple[Descriptor, list[LinearForm]]:
    """Return the equations of a channel with its output at zero and its input unknown, all others zero."""
    system = Descriptor(reduced.structure, reduced.reductions[port].junctions, field, freed=source)
    output = system.output(port)
    return system, [*system.equations, output]
