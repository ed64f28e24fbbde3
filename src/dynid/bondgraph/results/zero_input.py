"""The output that stored energy alone makes, in the Laplace domain (Park & Kim 1997, eqs 13 to 16)."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import Any

from dynid.bondgraph.graph import Port
from dynid.bondgraph.natural import characteristic_polynomials
from dynid.bondgraph.reduced import ReducedGraph
from dynid.bondgraph.results.dynamics import add_ratio
from dynid.bondgraph.transfer import TransferFunction
from dynid.result import Result


def add_zero_input(result: Result, reduced: ReducedGraph, initial: Mapping[str, float | Fraction]) -> None:
    """Add the Laplace transform of every output, all inputs zero, over the polynomial of the natural modes.

    Common factors stay: a numerator that shares a root with the natural modes does not excite that mode.

    Parameters
    ----------
    result, reduced
        Where to add it, and of what.
    initial
        The flow of an I or the effort of a C at t = 0, by name.
    """
    for port, output in zero_input_outputs(reduced, initial).items():
        add_ratio(result, f"bond_graph/zero_input/{port}", output)
    result.annotate(
        "bond_graph/zero_input", initial=", ".join(f"{n} = {float(v):g}" for n, v in initial.items())
    )


def zero_input_outputs(
    reduced: ReducedGraph, initial: Mapping[str, float | Fraction]
) -> dict[Port, TransferFunction]:
    """Return every output's transform as numerator over natural polynomial, not in lowest terms.

    The displacement or momentum of what is no storage has a factor s more below: it integrates.
    """
    from flint import fmpq, fmpq_poly

    stored, natural = reduced.stored(initial), characteristic_polynomials(reduced)
    ratios = reduced.rational(stored.values())
    outputs = {}
    for port in reduced.outputs:
        answers = {name: TransferFunction.of(ratios[stored[port, name]]) for name in initial}
        below = _common(natural[port], answers.values(), fmpq_poly)
        above = fmpq_poly(0)
        for name, answer in answers.items():
            value = Fraction(initial[name])
            share = fmpq_poly(answer.numerator) * (below // fmpq_poly(answer.denominator))
            above += fmpq(value.numerator, value.denominator) * share
        outputs[port] = TransferFunction(above.numer(), below.numer() * above.denom())
    return outputs


def _common(natural: Any, answers: Any, polynomial: Any) -> Any:
    """Return the natural polynomial, with a factor s where an answer integrates it."""
    below = polynomial(natural)
    if all(below % polynomial(answer.denominator) == 0 for answer in answers):
        return below
    return below * polynomial([0, 1])
