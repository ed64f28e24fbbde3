"""Linear forms in unknowns, their rates and the derivatives of inputs, over any field of numbers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

from dynid.errors import Singular

if TYPE_CHECKING:
    from dynid.bondgraph.graph import BondGraph

#: An unknown ("w", name), its rate ("dw", name), or the k-th derivative of an input ("u", name, k).
Symbol = tuple[str, str] | tuple[str, str, int]
#: Coefficients by symbol, none of them zero.
Form = dict[Symbol, Any]


@dataclass(frozen=True)
class Field:
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


def add(form: Form, other: Form, factor: Any = None) -> None:
    """Add a multiple of another form in place; zero coefficients disappear."""
    for symbol, value in other.items():
        term = value if factor is None else factor * value
        total = form[symbol] + term if symbol in form else term
        if total:
            form[symbol] = total
        else:
            form.pop(symbol, None)


def scaled(form: Form, factor: Any) -> Form:
    """Return a multiple of a form."""
    return {symbol: factor * value for symbol, value in form.items()}


def rate(form: Form) -> Form:
    """Differentiate a form in time."""
    return {_rate_of(symbol): value for symbol, value in form.items()}


def _rate_of(symbol: Symbol) -> Symbol:
    if len(symbol) == 3:
        return ("u", symbol[1], symbol[2] + 1)
    return ("dw", symbol[1])


def contradiction() -> Singular:
    """Return the error for equations without a unique solution."""
    return Singular(
        "the state equations of this graph contradict each other or leave a variable open",
        remedy="Look for junctions without elements in a loop, or sources that meet without one.",
    )
