"""The descriptor equations of a graph, as linear forms over any field of numbers.

The equations are the junction balances, with one more unknown for every storage that integrates. A form is
linear in unknowns, their rates and the derivatives of inputs.

The index is reduced by sparse substitution. Equations are solved for one rate each (Gauss-Jordan). One
without any rate is algebraic: it is solved for an unknown that, with its rate, is put into everything else;
an equation that loses its rate by that is solved anew. So every round stays among neighbours, and
constraints, algebraic loops and dependent storage are folded in until each unknown that is left has a state
equation. The irreducible blocks (Dulmage and Mendelsohn 1958) are the smallest square systems whose
determinants multiply to that of the whole.
"""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Self

from dynid.bondgraph.graph import SOURCES, Port, bond_sign
from dynid.bondgraph.program.program import Program, Register
from dynid.bondgraph.reduction.junctions import JunctionStructure
from dynid.errors import Singular

if TYPE_CHECKING:
    from dynid.bondgraph.graph import BondGraph
    from dynid.bondgraph.reduced_graph import ReducedGraph


# --- linear forms ---------------------------------------------------------------------------------

#: An unknown ("w", name), its rate ("dw", name), or the k-th derivative of an input ("u", name, k).
FormSymbol = tuple[str, str] | tuple[str, str, int]
#: Coefficients by symbol, none of them zero.
LinearForm = dict[FormSymbol, Any]


@dataclass(frozen=True)
class NumberField:
    """The numbers that equations are written in: exact rationals, or formulas in the parameters."""

    value: Callable[[str], Any]  # the value of an element or the modulus of a two-port, by name
    one: Any  # the number 1. Numbers have `+ - * /`, and are false where they are zero.

    @classmethod
    def rational(cls, graph: BondGraph) -> Self:
        """Return the field of the rationals, with the values of a graph; that of its irrational values."""
        from flint import fmpq

        if graph.field is not None:
            from dynid.arithmetic.field_polynomials import FieldNumber

            number = partial(FieldNumber, graph.field)
            return cls(lambda name: number(fmpq(*graph.value(name).as_integer_ratio())), number(fmpq(1)))

        def value(name: str) -> Any:
            exact = graph.value(name)
            return fmpq(exact.numerator, exact.denominator)

        return cls(value, fmpq(1))

    @classmethod
    def registers(cls, program: Program) -> Self:
        """Return the registers of a program as numbers."""
        unity = RegisterNumber(program, program.one)
        return cls(lambda name: RegisterNumber(program, program.parameter(name)), unity)


class RegisterNumber:
    """A number that is written down, not computed: a register of a program.

    `register`: what stands for the number; it is zero where its image at the program's point is.
    """

    __slots__ = ("program", "register")

    def __init__(self, program: Program, register: Register) -> None:
        self.program, self.register = program, register

    def _made(self, register: Register) -> Self:
        return type(self)(self.program, register)

    def __bool__(self) -> bool:
        return not self.program.is_zero(self.register)

    def __add__(self, other: Self) -> Self:
        return self._made(self.program.add(self.register, other.register))

    def __neg__(self) -> Self:
        return self._made(self.program.neg(self.register))

    def __mul__(self, other: Self | int) -> Self:
        if isinstance(other, int):  # of equations: a sign
            return self if other == 1 else -self if other == -1 else self._made(self.program.constant(0))
        return self._made(self.program.mul(self.register, other.register))

    __rmul__ = __mul__

    def __truediv__(self, other: Self) -> Self:
        return self._made(self.program.div(self.register, other.register))

    def __rtruediv__(self, other: int) -> Self:
        return self._made(self.program.one) * other / self


def add(form: LinearForm, summand: LinearForm, factor: Any = None) -> None:
    """Add a multiple of another form in place; zero coefficients disappear."""
    for symbol, value in summand.items():
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
    return {
        ("u", symbol[1], symbol[2] + 1) if len(symbol) == 3 else ("dw", symbol[1]): value
        for symbol, value in form.items()
    }


def contradiction() -> Singular:
    """Return the error for equations without a unique solution."""
    return Singular(
        "the state equations of this graph contradict each other or leave a variable open",
        remedy="Look for junctions without elements in a loop, or sources that meet without one.",
    )


# --- descriptor equations -------------------------------------------------------------------------


class Descriptor:
    """The equations of a part of a graph, each a form that equals zero.

    `inputs`: sources that are inputs; all others are zero. `initial`: storages with energy at t = 0, each an
    input `initial:NAME`. `freed`: a source whose signal is an unknown, not an input.
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
            if coupling.tail not in self._balance and coupling.head not in self._balance:
                continue
            size = field.one if coupling.two_port is None else field.value(coupling.two_port)
            size = field.one / size if coupling.inverse else size
            for row, column, sign in coupling.entries:
                if row in self._balance:
                    add(self._balance[row], self._common(column), size * sign)
        for name, form in self._balance.items():
            if structure.junctions[name].fixing is None:
                self.equations.append(form)
                self._owners.append(name)
        self.equations += self._integrals.values()
        self._owners += self._integrals

    def signal(self, source: str) -> LinearForm:
        """Return the signal of a source as a form."""
        if source == self.freed:
            return {("w", source): self.field.one}
        return {("u", source, 0): self.field.one} if source in self.inputs else {}

    def _common(self, junction: str) -> LinearForm:
        fixing = self.structure.junctions[junction].fixing
        return {("w", junction): self.field.one} if fixing is None else self.signal(fixing)

    def _response(self, element: str, junction: str) -> LinearForm:
        """Return the effort (on a 1) or flow (on a 0) of an element in terms of the common variable."""
        node, value = self.graph.nodes[element], self.field.value(element)
        on_one = self.structure.junctions[junction].kind == "1"
        stored: LinearForm = {("u", f"initial:{element}", 0): -value} if element in self.initial else {}
        if node.type == "R":
            size = value if on_one else self.field.one / value
            return scaled(self._common(junction), size) if size else {}
        if on_one is (node.type == "I"):  # it answers with a rate: e = I f' - I f(0) delta(t)
            return {**scaled(rate(self._common(junction)), value), **stored} if value else {}
        # it integrates: C e' = f + C e(0) delta(t); what it stores is given along the arrow of its bond
        stored = scaled(stored, self.field.one * bond_sign(self.graph, element))
        equation: LinearForm = {("dw", element): value, **stored} if value else {}
        add(equation, self._common(junction), -self.field.one)
        self._integrals[element] = equation
        return {("w", element): self.field.one}

    def models(self, junction: str) -> bool:
        """Test whether a junction is modelled."""
        return junction in self._balance

    def name(self, unknown: str) -> str:
        """Name an unknown as the variable that it is."""
        if unknown in self._balance:
            return f"{unknown}.{'f' if self.structure.junctions[unknown].kind == '1' else 'e'}"
        if unknown in self.graph.nodes:
            return f"{unknown}.{'e' if self.graph.nodes[unknown].type in ('C', 'Se') else 'f'}"
        return unknown

    def carriers(self, rows: Iterable[int], unknowns: Collection[str]) -> list[str]:
        """Name the one-ports that act on these unknowns in these equations of the graph."""
        names: dict[str, None] = {}
        for owner in (self._owners[row] for row in rows if row < len(self._owners)):
            if owner in self._responses:
                names[owner] = None
                continue
            for element in self.structure.junctions[owner].elements:
                if any(symbol[1] in unknowns for symbol in self._responses[element]):
                    names[element] = None
        return [name for name in self.graph.nodes if name in names]

    def output(self, port: Port) -> LinearForm:
        """Return a variable of the graph as a form; q and p are integrals unless they are a state."""
        name, quantity = port.node, self.graph.behind(port).quantity
        kind, junction = self.graph.nodes[name].type, self.structure.place[name]
        sign = bond_sign(self.graph, name)
        if kind in SOURCES and quantity == ("e" if kind == "Se" else "f"):
            form = self.signal(name)
        elif quantity == ("f" if self.structure.junctions[junction].kind == "1" else "e"):
            form = self._common(junction)
        elif kind in SOURCES:  # the reaction of a source that fixes the junction
            form = scaled(self._balance[junction], -(self.field.one * sign))
        else:
            form = scaled(self._responses[name], self.field.one * sign)
        if self.graph.is_state(port):
            value = self.field.value(name) * sign
            return scaled(form, value) if value else {}
        if port.quantity in "ef":
            return form
        integral = f"integral:{port}"
        self.equations.append({("dw", integral): self.field.one, **scaled(form, -self.field.one)})
        return {("w", integral): self.field.one}


def reduced_descriptor(reduced: ReducedGraph, field: NumberField, initial: Iterable[str] = ()) -> Descriptor:
    """Return the equations of the part of a graph that its outputs depend on."""
    junctions = {name for reduction in reduced.reductions.values() for name in reduction.junctions}
    return Descriptor(reduced.structure, junctions, field, inputs=reduced.inputs, initial=initial)


def constrained(
    reduced: ReducedGraph, port: Port, source: str, field: NumberField
) -> tuple[Descriptor, list[LinearForm]]:
    """Return the equations of a channel with its output at zero and its input unknown, all others zero."""
    system = Descriptor(reduced.structure, reduced.reductions[port].junctions, field, freed=source)
    output = system.output(port)
    return system, [*system.equations, output]


# --- index reduction ------------------------------------------------------------------------------


def solve(
    equations: Sequence[LinearForm], outputs: Sequence[LinearForm]
) -> tuple[dict[str, LinearForm], list[LinearForm]]:
    """Return the rate of every unknown that is left, and the outputs, as forms in these and the inputs.

    `equations`: forms that equal zero, in unknowns, rates and inputs. Raises `Singular` where the equations
    contradict each other or leave an unknown open.
    """
    return _IndexReduction(equations, outputs).run()


class _IndexReduction:
    def __init__(self, equations: Sequence[LinearForm], outputs: Sequence[LinearForm]) -> None:
        self.count = len(equations)  # rows from here on are outputs
        self.rows: dict[int, LinearForm] = {k: dict(form) for k, form in enumerate([*equations, *outputs])}
        self.rows_with: dict[FormSymbol, dict[int, None]] = {}
        self.rank: dict[str, int] = {}  # the order in which unknowns were met
        for row, form in self.rows.items():
            for symbol in form:
                if symbol[0] != "u":
                    self.rows_with.setdefault(symbol, {})[row] = None
                    self.rank.setdefault(symbol[1], len(self.rank))
        self.rate_row: dict[FormSymbol, int] = {}
        self.pivot: dict[int, FormSymbol] = {}
        self.waiting = deque(range(self.count))
        self.algebraic: list[tuple[int, int]] = []  # a heap of (length when pushed, row)

    def run(self) -> tuple[dict[str, LinearForm], list[LinearForm]]:
        while self.waiting or self.algebraic:
            while self.waiting:
                self._solve_for_a_rate(self.waiting.popleft())
            if self.algebraic:
                length, row = heapq.heappop(self.algebraic)
                if length == len(self.rows[row]):
                    self._solve_for_an_unknown(row)
                else:
                    heapq.heappush(self.algebraic, (len(self.rows[row]), row))
        rates: dict[str, LinearForm] = {}
        for pivot in sorted(self.rate_row, key=lambda symbol: self.rank[symbol[1]]):
            form = self.rows[self.rate_row[pivot]]
            rates[pivot[1]] = scaled({k: v for k, v in form.items() if k != pivot}, -1)
        outputs = [self.rows[row] for row in range(self.count, self.count + len(self.rows) - len(rates))]
        for output in outputs:
            for symbol in [symbol for symbol in output if symbol in self.rate_row]:
                add(output, rates[symbol[1]], output.pop(symbol))
        for form in (*rates.values(), *outputs):
            if any(symbol[0] == "dw" or (symbol[0] == "w" and symbol[1] not in rates) for symbol in form):
                raise contradiction()
        return rates, outputs

    def _add(self, row: int, form: LinearForm, factor: object) -> None:
        """Add a multiple of a form to a row, and keep the index of rows up to date."""
        target = self.rows[row]
        add(target, form, factor)
        for symbol in form:
            if symbol[0] == "u":
                continue
            if symbol in target:
                self.rows_with.setdefault(symbol, {})[row] = None
            else:
                self.rows_with.get(symbol, {}).pop(row, None)

    def _solve_for_a_rate(self, row: int) -> None:
        form = self.rows[row]
        for symbol in [symbol for symbol in form if symbol in self.rate_row]:
            self._add(row, self.rows[self.rate_row[symbol]], -form[symbol])
        pivot = min(
            (symbol for symbol in form if symbol[0] == "dw"),
            key=lambda symbol: (len(self.rows_with[symbol]), self.rank[symbol[1]]),
            default=None,
        )
        if pivot is None:
            heapq.heappush(self.algebraic, (len(form), row))
            return
        form = self.rows[row] = scaled(form, 1 / form[pivot])
        for row_with_pivot in [
            row_with_pivot for row_with_pivot in self.rows_with[pivot] if row_with_pivot in self.pivot
        ]:
            self._add(row_with_pivot, form, -self.rows[row_with_pivot][pivot])
        self.rate_row[pivot], self.pivot[row] = row, pivot

    def _solve_for_an_unknown(self, row: int) -> None:
        """Solve an algebraic equation for one unknown, and put it and its rate into everything else.

        An unknown whose rate stands nowhere is preferred, then one in few equations, then a late one.
        """
        form = self.rows[row]
        unknowns = [symbol for symbol in form if symbol[0] == "w"]
        if not unknowns:
            raise contradiction()
        moving = {symbol: bool(self.rows_with.get(("dw", symbol[1]))) for symbol in unknowns}
        unknown = min(
            unknowns,
            key=lambda s: (moving[s], len(self.rows_with[s]) if not moving[s] else 0, -self.rank[s[1]]),
        )
        value = scaled({k: v for k, v in form.items() if k != unknown}, -1 / form[unknown])
        for symbol in form:
            if symbol[0] == "w":
                self.rows_with[symbol].pop(row)
        del self.rows[row]
        self._substitute(("dw", unknown[1]), rate(value))
        self._substitute(unknown, value)

    def _substitute(self, symbol: FormSymbol, value: LinearForm) -> None:
        for row in list(self.rows_with.pop(symbol, ())):
            if symbol[0] == "dw" and row in self.pivot:
                del self.rate_row[self.pivot.pop(row)]
                self.waiting.append(row)
            self._add(row, value, self.rows[row].pop(symbol))


def without_input_rates(rates: dict[str, LinearForm], outputs: list[LinearForm]) -> None:
    """Take derivatives of inputs out of the state equations, in place, by a change of state.

    With x = v + B_k u^(k-1), the k-th derivative leaves x'; what remains of it is the improper part of the
    outputs.
    """
    forms = [*rates.values(), *outputs]
    highest = max((s[2] for form in rates.values() for s in form if len(s) == 3), default=0)
    for k in range(highest, 0, -1):
        shifts: dict[FormSymbol, LinearForm] = {}
        for name, form in rates.items():
            rates_k = [symbol for symbol in form if len(symbol) == 3 and symbol[2] == k]
            moved: LinearForm = {("u", symbol[1], k - 1): form.pop(symbol) for symbol in rates_k}
            if moved:
                shifts["w", name] = moved
        for form in forms:
            for symbol in [symbol for symbol in form if symbol in shifts]:
                add(form, shifts[symbol], form[symbol])


# --- irreducible blocks ---------------------------------------------------------------------------


@dataclass(frozen=True)
class _IrreducibleBlock:
    """A square part of a system: the places of its equations, and their terms in its own unknowns."""

    rows: list[int]
    forms: list[LinearForm]

    @property
    def unknowns(self) -> set[str]:
        """The names of its unknowns."""
        return {symbol[1] for form in self.forms for symbol in form}


def irreducible_blocks(equations: Sequence[LinearForm]) -> list[_IrreducibleBlock]:
    """Split equations into the smallest square systems whose determinants multiply to that of the whole.

    Equations and unknowns can be ordered so that the system is block triangular; each block is returned
    without what stands beside the diagonal: terms in unknowns of other blocks, and inputs.

    `equations`: forms that equal zero; an unknown and its rate are one column. Raises `Singular` where the
    determinant vanishes whatever the coefficients are.
    """
    columns_of: dict[str, int] = {}
    columns: list[int] = []
    starts = [0]
    for form in equations:
        columns += {
            columns_of.setdefault(symbol[1], len(columns_of)): None for symbol in form if symbol[0] != "u"
        }
        starts.append(len(columns))
    size = len(equations)
    if len(columns_of) != size:
        raise contradiction()
    if not size:
        return []
    import numpy as np
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components, maximum_bipartite_matching

    def pattern(indices: Any) -> Any:
        return csr_array((np.ones(len(columns)), indices, starts), shape=(size, size))

    column_of = maximum_bipartite_matching(pattern(columns), perm_type="column")
    if (column_of < 0).any():
        raise contradiction()
    row_of = np.empty(size, dtype=int)
    row_of[column_of] = np.arange(size)
    _, label = connected_components(pattern(row_of[columns]), directed=True, connection="strong")
    by_row, by_column = label.tolist(), label[row_of].tolist()
    blocks = [_IrreducibleBlock([], []) for _ in range(max(by_row) + 1)]
    block_of = {name: by_column[column] for name, column in columns_of.items()}
    for row, form in enumerate(equations):
        inside = {s: v for s, v in form.items() if s[0] != "u" and block_of[s[1]] == by_row[row]}
        blocks[by_row[row]].rows.append(row)
        blocks[by_row[row]].forms.append(inside)
    return blocks
