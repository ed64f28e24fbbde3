"""State equations in the user's symbols: the same index reduction, run on a growing program."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from dynid.bondgraph.descriptor import LinearForm, NumberField, constrained, reduced_descriptor, solve
from dynid.bondgraph.formula_printers import TEXT, Printed
from dynid.bondgraph.formulas.expressions import free_letter, length, print_register, shared
from dynid.bondgraph.formulas.transfer import symbol_names, symbol_value
from dynid.bondgraph.graph import Port
from dynid.bondgraph.program.factored import prime_for, random_point
from dynid.bondgraph.program.program import ModularPoint, Program, Register
from dynid.bondgraph.reduced_graph import ReducedGraph
from dynid.errors import UsageError

#: Most symbols and terms with which coefficients are brought to lowest terms.
_MAX_SYMBOLS, _MAX_WRITTEN_TERMS = 100, 12
#: Else: most operations of a coefficient that is written out whole; of one that is made of named parts.
_MAX_COEFFICIENT_OPERATIONS, _MAX_NAMED_OPERATIONS = 24, 12


@dataclass(frozen=True)
class _StateEquations:
    """State equations as text."""

    #: Parts that coefficients share, each in terms of those before it (`t1 = …`); empty where all are short.
    definitions: tuple[str, ...]
    states: tuple[str, ...]  # one equation for the rate of each state
    outputs: tuple[str, ...]  # one equation for each output


def state_equations(reduced: ReducedGraph, states: Sequence[str]) -> _StateEquations:
    """Write the state equations of a graph in its symbols.

    They hold for all values of the parameters but those that make a divisor vanish; where the graph's own
    values do, or leave other states, they are written for these values.

    Raises `Singular` where the equations have no unique solution.
    """
    return _written(reduced, states, None)


def zero_dynamics_equations(
    reduced: ReducedGraph, port: Port, source: str, states: Sequence[str]
) -> _StateEquations:
    """Write the zero dynamics of a channel in the graph's symbols; the output is the input that holds it.

    Raises `Singular` where the input does not reach the output.
    """
    return _written(reduced, states, (port, source))


def _written(reduced: ReducedGraph, states: Sequence[str], held: tuple[Port, str] | None) -> _StateEquations:
    numeric = reduced.modulo()
    prime = prime_for(reduced.exact.values())
    general = _Solved(reduced, random_point(reduced.valued, prime), held)
    if general.states == tuple(states) and not general.program.vanishing(general.registers, (), numeric):
        return general.written()
    return _Solved(reduced, numeric, held).written()


class _Solved:
    """State equations whose coefficients are registers."""

    def __init__(self, reduced: ReducedGraph, point: ModularPoint, held: tuple[Port, str] | None) -> None:
        self.reduced, self.graph = reduced, reduced.graph
        program = self.program = Program(point)
        field = NumberField.registers(program)
        if held is None:
            self.system = reduced_descriptor(reduced, field)
            forms = [self.system.output(port) for port in reduced.outputs]
            equations, self.ports = self.system.equations, [str(port) for port in reduced.outputs]
        else:
            self.system, equations = constrained(reduced, *held, field)
            forms, self.ports = [self.system.signal(held[1])], [held[1]]
        self.rates, self.outputs = solve(equations, forms)
        self.places = {name: k for names in (self.rates, reduced.inputs) for k, name in enumerate(names)}
        self.states = tuple(self.system.name(name) for name in self.rates)

    @property
    def registers(self) -> list[Register]:
        """The coefficients."""
        return [value.register for form in (*self.rates.values(), *self.outputs) for value in form.values()]

    def written(self) -> _StateEquations:
        coefficients_written = self._lowest_terms()
        nodes, coefficients = self.graph.nodes, set(self.registers)
        labels: dict[Register, str] = {}  # what coefficients share, where one of them would be long
        if not coefficients_written and any(
            length(self.program, register, _MAX_COEFFICIENT_OPERATIONS) >= _MAX_COEFFICIENT_OPERATIONS
            for register in coefficients
        ):
            formulas = (node.formula.names for node in nodes.values() if node.formula)
            letter = free_letter({*nodes, *(name for names in formulas for name in names)})
            named = [
                r
                for r in shared(self.program, coefficients, _MAX_NAMED_OPERATIONS)
                if length(self.program, r, 4) == 4
            ]
            labels = {register: f"{letter}{k}" for k, register in enumerate(named, 1)}
        if not coefficients_written:
            coefficients_written = {
                register: TEXT.name(labels[register])
                if register in labels
                else print_register(self.program, register, nodes, labels)
                for register in self.registers
            }
        left = [f"d/dt {name}" for name in self.states]
        return _StateEquations(
            tuple(
                f"{name} = {print_register(self.program, r, nodes, labels)[0]}" for r, name in labels.items()
            ),
            tuple(self._equations(left, self.rates.values(), coefficients_written)),
            tuple(self._equations(self.ports, self.outputs, coefficients_written)),
        )

    def _lowest_terms(self) -> dict[Register, Printed]:
        """Return coefficients as quotients of polynomials; empty where one of them grows long."""
        from dynid.bondgraph.formulas.symbolic import FormulaTooLong, quotient, variables

        try:
            names = symbol_names(self.reduced)
            if len(names) > _MAX_SYMBOLS:
                return {}
            symbols, unity = variables(names or ["s"], _MAX_WRITTEN_TERMS**2)
            values = {name: symbol_value(self.reduced, name, symbols, unity) for name in self.reduced.valued}
            ratios = self.program.run(self.registers, values, unity, unity)
            lowest = {register: value.lowest_terms() for register, value in ratios.items()}
        except (UsageError, FormulaTooLong, KeyError, ZeroDivisionError):
            return {}
        if any(max(len(above), len(below)) > _MAX_WRITTEN_TERMS for above, below in lowest.values()):
            return {}
        return {register: quotient(above, below) for register, (above, below) in lowest.items()}

    def _equations(
        self, left: Iterable[str], forms: Iterable[LinearForm], coefficients: dict[Register, Printed]
    ) -> Iterable[str]:
        for name, form in zip(left, forms, strict=True):
            terms = []
            # states first, in their order, then inputs, then their derivatives
            for symbol in sorted(form, key=lambda s: (1 + s[2] if len(s) == 3 else 0, self.places[s[1]])):
                if len(symbol) == 2:
                    variable = self.system.name(symbol[1])
                else:
                    times = "" if symbol[2] == 1 else str(symbol[2])
                    variable = f"(d{times}/dt{times} {symbol[1]})" if symbol[2] else symbol[1]
                terms.append(TEXT.scaled(coefficients[form[symbol].register], variable))
            yield f"{name} = {TEXT.listed(terms)[0]}"
