"""State equations of a graph, derived exactly: algebraic loops solved, dependent storage folded in.

The same index reduction gives the zero dynamics of a channel: the output is held at zero, and the input is
the unknown that does so.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from dynid.bondgraph.descriptor import (
    Descriptor,
    FormSymbol,
    LinearForm,
    NumberField,
    constrained,
    contradiction,
    irreducible_blocks,
    reduced_descriptor,
    solve,
    without_input_rates,
)
from dynid.bondgraph.graph import BondGraph, Port
from dynid.bondgraph.reduced_graph import ReducedGraph
from dynid.bondgraph.reduction.junctions import JunctionStructure
from dynid.errors import NumericalError, Singular

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from dynid.lti.refined_response import RationalMatrices
    from dynid.lti.state_space import StateSpace


Matrix = TypeVar("Matrix")


def state_space(reduced: ReducedGraph, initial: Sequence[str] = ()) -> StateSpace:
    """Return the exact state equations of a graph, rounded to doubles.

    The states are common variables of junctions and the efforts or flows of integrating elements, named
    as ports (`body.f`, `C_a.e`), in SI units; where the input's derivative enters the equations, a multiple
    of the input is taken off them.

    `reduced`: the graph with its inputs and outputs; only the part that the outputs depend on is modelled.
    `initial`: storages with energy at t = 0. Each adds an input `initial:NAME`: an impulse of strength f(0)
    on an I, e(0) on a C is the equivalent source of Park & Kim 1997, eqs 13 to 16. Raises `Singular` where
    the equations have no unique solution.
    """
    return rounded(*_derived(reduced, initial), [str(port) for port in reduced.outputs])


def rational_matrices(
    reduced: ReducedGraph, initial: Sequence[str], inputs: Sequence[str]
) -> RationalMatrices:
    """Return the matrices of `state_space` before they are rounded, with a column for each input named."""
    from flint import fmpq_mat

    from dynid.lti.refined_response import RationalMatrices

    _, rates, outputs, _ = _derived(reduced, initial)
    without_input_rates(rates, outputs)

    def filled(forms: Collection[LinearForm], symbols: Sequence[FormSymbol]) -> Any:
        entries = [_rational(form.get(symbol, 0)) for form in forms for symbol in symbols]
        return fmpq_mat(len(forms), len(symbols), entries)

    return RationalMatrices(*_matrices(rates, outputs, inputs, filled))


def _derived(
    reduced: ReducedGraph, initial: Sequence[str]
) -> tuple[Descriptor, dict[str, LinearForm], list[LinearForm], list[str]]:
    """Return the equations of a graph, its state equations, and its inputs with those of stored energy."""
    system = reduced_descriptor(reduced, NumberField.rational(reduced.graph), initial)
    rates, outputs = solve(system.equations, [system.output(port) for port in reduced.outputs])
    return system, rates, outputs, [*reduced.inputs, *(f"initial:{name}" for name in initial)]


def natural_order(
    graph: BondGraph,
    junctions: Collection[str] | None = None,
    structure: JunctionStructure | None = None,
) -> int:
    """Return the number of states of a graph with its values: the degree of its natural polynomial.

    `structure`: that structure, where what no output depends on is held; default: it is made of the graph.
    Raises `Singular` where the equations have no unique solution.
    """
    if structure is None:
        structure = JunctionStructure(graph)
        if structure.rings:
            raise contradiction()
    modelled = structure.junctions if junctions is None else junctions
    return len(solve(Descriptor(structure, modelled, NumberField.rational(graph)).equations, [])[0])


def zero_dynamics(reduced: ReducedGraph, port: Port, source: str) -> StateSpace:
    """Return the zero dynamics of a channel: the motion that is left while its output is held at zero.

    The output's equation y = 0 joins the graph's own, the input becomes an unknown, and the same index
    reduction as for `state_space` folds in the constraints that follow. The eigenvalues of A are the zeros
    of the channel, together with the natural modes that it hides (the invariant zeros); there are as many
    states. The only output is the input that holds y at zero.

    The equations are exact and substitution is sparse, but written in states of their own far parts of a
    long line of power weigh on each other by huge coefficients: for zeros alone use `zero_parts`.

    Raises `Singular` where the input does not reach the output: no input holds it, or every one does. Raises
    `NumericalError` where a coefficient leaves the range of doubles.
    """
    system, equations = constrained(reduced, port, source, NumberField.rational(reduced.graph))
    with _unreached(port, source):
        rates, outputs = solve(equations, [system.signal(source)])
    return rounded(system, rates, outputs, [], [source])


#: Most states of a part whose characteristic polynomial is formed.
_MAX_POLYNOMIAL_STATES = 150


@dataclass(frozen=True)
class ZeroPart:
    """An irreducible part of zero dynamics, exactly."""

    elements: tuple[str, ...]  # the one-ports that carry it
    states: tuple[str, ...]  # the names of its states
    #: Its characteristic polynomial over the integers (flint `fmpz_poly`): its roots are zeros. None where
    #: the part has more than 150 states, of which it would take minutes.
    polynomial: Any


def zero_parts(reduced: ReducedGraph, port: Port, source: str) -> tuple[ZeroPart, ...]:
    """Return the irreducible parts of the zero dynamics with their elements and characteristic polynomials.

    The constrained equations are brought to block triangular form by their structure alone, so that what lies
    at infinity is taken off without arithmetic and parts stay as small and as well scaled as those of the
    graph that they come from. A chain with the force at one end and the velocity at the other falls into one
    part a stage.

    Raises `Singular` where the input does not reach the output.
    """
    system, equations = constrained(reduced, port, source, NumberField.rational(reduced.graph))
    with _unreached(port, source):
        solved = [(block, solve(block.forms, [])[0]) for block in irreducible_blocks(equations)]
    parts = []
    for block, rates in solved:
        if not rates:
            continue
        small = len(rates) <= _MAX_POLYNOMIAL_STATES
        polynomial = _characteristic_polynomial(reduced.graph, rates) if small else None
        carriers = tuple(system.carriers(block.rows, block.unknowns))
        parts.append(ZeroPart(carriers, tuple(system.name(name) for name in rates), polynomial))
    return tuple(parts)


def natural_polynomial(reduced: ReducedGraph) -> Any:
    """Return the characteristic polynomial of the A of `state_space`, exactly, times a positive integer."""
    return _characteristic_polynomial(reduced.graph, _derived(reduced, ())[1])


def _characteristic_polynomial(graph: BondGraph, rates: dict[str, LinearForm]) -> Any:
    """Return det(s - A) of the rates of states, over the integers or the graph's field."""
    from flint import fmpq_mat, fmpz_mat

    rows = [[_rational(form.get(("w", name), 0)) for name in rates] for form in rates.values()]
    if graph.field is not None:
        from dynid.arithmetic.field_polynomials import FieldPolynomial

        return FieldPolynomial(graph.field, fmpq_mat(rows).charpoly()).numer()
    from dynid.lti.pencil.exact import determinant

    # rows have denominators of their own: a common one has as many digits as all of them
    scales = [math.lcm(*(int(number.q) for number in row)) for row in rows]
    size = len(rows)
    scaled = [number * scale for row, scale in zip(rows, scales, strict=True) for number in row]
    diagonal = [scale if i == j else 0 for i, scale in enumerate(scales) for j in range(size)]
    multiple = determinant(fmpz_mat(size, size, diagonal), fmpz_mat(size, size, [x.p for x in scaled]))
    return multiple // multiple.content()


def _rational(number: Any) -> Any:
    """Return a coefficient as a rational number (flint `fmpq`), one of a field as it is coded."""
    from flint import fmpq

    return fmpq(number.p, number.q) if number else fmpq(0)


@contextmanager
def _unreached(port: Port, source: str) -> Iterator[None]:
    """Replace the error of a singular constrained system by one that names input and output."""
    try:
        yield
    except Singular:
        raise Singular(
            f"the zero dynamics of '{port}' from '{source}' are not defined: "
            "the input does not reach the output",
            remedy="Ask for another output, or for another input.",
            names=(source, port.node),
        ) from None


def rounded(
    system: Descriptor,
    rates: dict[str, LinearForm],
    outputs: list[LinearForm],
    columns: Sequence[str],
    ports: Sequence[str],
) -> StateSpace:
    """Round exact state equations to matrices; the input's derivatives are taken off the states."""
    from dynid.lti.state_space import StateSpace

    without_input_rates(rates, outputs)
    A, B, C, feedthrough = _matrices(rates, outputs, columns, _matrix)
    return StateSpace(
        A=A,
        B=B,
        C=C,
        D=feedthrough[0],
        higher=feedthrough[1:],
        inputs=tuple(columns),
        outputs=tuple(ports),
        states=tuple(system.name(name) for name in rates),
    )


def _matrices(
    rates: dict[str, LinearForm],
    outputs: list[LinearForm],
    columns: Sequence[str],
    filled: Callable[[Collection[LinearForm], Sequence[FormSymbol]], Matrix],
) -> tuple[Matrix, Matrix, Matrix, tuple[Matrix, ...]]:
    """Return A, B, C and the feedthrough matrices, each filled from forms, one row a form."""
    highest = max((s[2] for form in outputs for s in form if len(s) == 3), default=0)
    states: list[FormSymbol] = [("w", name) for name in rates]
    inputs: list[list[FormSymbol]] = [[("u", name, k) for name in columns] for k in range(highest + 1)]
    return (
        filled(rates.values(), states),
        filled(rates.values(), inputs[0]),
        filled(outputs, states),
        tuple(filled(outputs, symbols) for symbols in inputs),
    )


def _matrix(forms: Collection[LinearForm], columns: Sequence[FormSymbol]) -> NDArray[np.float64]:
    """Round forms to a matrix, one row a form."""
    column_of = {symbol: column for column, symbol in enumerate(columns)}
    matrix = np.zeros((len(forms), len(columns)))
    for row, form in enumerate(forms):
        for symbol, value in form.items():
            if symbol in column_of:
                try:
                    matrix[row, column_of[symbol]] = int(value.p) / int(value.q)
                except OverflowError:
                    raise NumericalError(
                        "a coefficient of the state equations is beyond the range of numbers",
                        remedy="Choose units that bring the parameters nearer to 1.",
                    ) from None
    return matrix
