"""Polynomials in s and the parameters of a graph: the formula behind a transfer function."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import Any, Self

from dynid.bondgraph.formula_printers import ATOM, POWER, PRODUCT, SUM, TEXT, FormulaPrinter, Printed
from dynid.bondgraph.program.factored import FactoredQuotient, PolynomialFactor

#: Products of terms that may be formed for every term that a polynomial may have.
_PRODUCTS_PER_TERM = 32


class FormulaTooLong(ArithmeticError):
    """A formula exceeds its limit of terms, or of work."""


class SymbolicQuotient(FactoredQuotient):
    """A quotient of multivariate integer polynomials (flint `fmpz_mpoly`).

    `factors` and `sign`: as for any quotient; all polynomials are of one context. `limit`: largest number of
    terms of a polynomial before `FormulaTooLong` is raised.
    """

    __slots__ = ("limit", "ring")

    def __init__(
        self, factors: Mapping[PolynomialFactor, int] | None, sign: int, ring: Any, limit: int
    ) -> None:
        super().__init__(factors, sign)
        self.ring, self.limit = ring, limit

    def _made(self, factors: Mapping[PolynomialFactor, int] | None, sign: int, operand: Self) -> Self:  # noqa: ARG002
        if any(len(factor.polynomial) > self.limit for factor in factors or ()):
            raise FormulaTooLong
        return type(self)(factors, sign, self.ring, self.limit)

    def _zero(self) -> Any:
        return self.ring.constant(0)

    def _multiplied(self, a: Any, b: Any) -> Any:
        """Multiply, as long as the number of products of terms is bounded."""
        if len(a) * len(b) > _PRODUCTS_PER_TERM * self.limit:
            raise FormulaTooLong
        return a * b

    def constant(self, value: Fraction) -> SymbolicQuotient:
        """Return a number as a formula of the same ring."""
        if value == 0:
            return SymbolicQuotient(None, 1, self.ring, self.limit)
        parts = ((abs(value.numerator), 1), (value.denominator, -1))
        powers = {number: power for number, power in parts if number != 1}
        factors = {PolynomialFactor(self.ring.constant(number)): power for number, power in powers.items()}
        return SymbolicQuotient(factors, 1 if value > 0 else -1, self.ring, self.limit)

    def as_integer(self) -> int | None:
        """Return the value where it is an integer."""
        numerator, denominator = self.lowest_terms()
        if denominator != 1 or not numerator.is_constant():
            return None
        return int(numerator.leading_coefficient()) if numerator != 0 else 0


def variables(names: list[str], limit: int) -> tuple[dict[str, SymbolicQuotient], SymbolicQuotient]:
    """Return a formula for every name, and the number 1; terms are ordered by powers of the first name."""
    from flint import fmpz_mpoly_ctx

    ring = fmpz_mpoly_ctx.get([(name.encode("ascii", "backslashreplace").decode()) for name in names], "lex")
    named = {
        name: SymbolicQuotient({PolynomialFactor(generator): 1}, 1, ring, limit)
        for name, generator in zip(names, ring.gens(), strict=True)
    }
    return named, SymbolicQuotient({}, 1, ring, limit)


def _read(spelled: str) -> str:
    """Return the text of flint in the names as they were given."""
    return spelled.encode().decode("unicode_escape")


def apply(operation: str, operands: list[SymbolicQuotient]) -> SymbolicQuotient:
    """Apply an arithmetic operation of an expression to formulas.

    Raises `KeyError` where the result is no rational function (a function, a power that is not a small
    integer).
    """
    match operation, operands:
        case "+", [a, b]:
            return a + b
        case "-", [a, b]:
            return a - b
        case "*", [a, b]:
            return a * b
        case "/", [a, b]:
            return a / b
        case "neg", [a]:
            return -a
        case "pos", [a]:
            return a
        case "**", [a, b]:
            power = b.as_integer()
            if power is not None and abs(power) <= 8:
                result = a.constant(Fraction(1))
                for _ in range(abs(power)):
                    result = result * a
                return result if power >= 0 else a.constant(Fraction(1)) / result
    raise KeyError(operation)


def plain(polynomial: Any) -> str:
    """Write a polynomial as SymPy would read it."""
    return _read(str(polynomial).replace("^", "**"))


def quotient(numerator: Any, denominator: Any) -> Printed:
    """Write a quotient of polynomials as SymPy would read it, its sign in front."""
    if denominator.leading_coefficient() < 0:
        numerator, denominator = -numerator, -denominator
    negative = numerator != 0 and all(c < 0 for c in numerator.coeffs())
    top = _plain(-numerator if negative else numerator)
    written = top if denominator == 1 else TEXT.quotient(top, _plain(denominator))
    return TEXT.negative(written) if negative else written


def _plain(polynomial: Any) -> Printed:
    text = plain(polynomial)
    if len(polynomial) > 1:
        return text, SUM
    return text, PRODUCT if "*" in text.replace("**", "") else POWER if "**" in text else ATOM


def written(polynomial: Any, hand: FormulaPrinter) -> Printed:
    """Write a polynomial term by term in any hand."""
    names = tuple(_read(name) for name in polynomial.context().names())
    terms = []
    for powers, coefficient in polynomial.terms():
        bases = [(hand.name(n), int(power)) for n, power in zip(names, powers, strict=True) if power]
        terms.append(hand.monomial(int(coefficient), bases))
    return hand.listed(terms)
