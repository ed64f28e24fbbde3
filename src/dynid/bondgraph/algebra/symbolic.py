"""Polynomials in s and the parameters of a graph: the formula behind a transfer function."""

from __future__ import annotations

from typing import Any


class TooLong(ArithmeticError):
    """A formula has outgrown what a reader would read."""


class Formula:
    """A quotient of two multivariate integer polynomials (flint `fmpz_mpoly`).

    Parameters
    ----------
    numerator, denominator
        Polynomials of one context.
    limit
        Largest number of terms in either before `TooLong` is raised.
    """

    __slots__ = ("denominator", "limit", "numerator")

    def __init__(self, numerator: Any, denominator: Any, limit: int) -> None:
        self.numerator, self.denominator, self.limit = numerator, denominator, limit

    def reduced(self) -> Formula:
        """Return the same function in lowest terms."""
        common = self.numerator.gcd(self.denominator)
        numerator, denominator = self.numerator / common, self.denominator / common
        if denominator.leading_coefficient() < 0:
            numerator, denominator = -numerator, -denominator
        return Formula(numerator, denominator, self.limit)

    def _checked(self, numerator: Any, denominator: Any) -> Formula:
        formula = Formula(numerator, denominator, self.limit)
        if max(len(numerator), len(denominator)) > self.limit:
            formula = formula.reduced()
            if max(len(formula.numerator), len(formula.denominator)) > self.limit:
                raise TooLong
        return formula

    def __add__(self, other: Formula) -> Formula:
        if self.denominator == other.denominator:
            return self._checked(self.numerator + other.numerator, self.denominator)
        numerator = self.numerator * other.denominator + other.numerator * self.denominator
        return self._checked(numerator, self.denominator * other.denominator)

    def __neg__(self) -> Formula:
        return Formula(-self.numerator, self.denominator, self.limit)

    def __sub__(self, other: Formula) -> Formula:
        return self + (-other)

    def __mul__(self, other: Formula | int) -> Formula:
        if isinstance(other, int):
            return Formula(self.numerator * other, self.denominator, self.limit)
        if self.denominator == other.numerator:
            return Formula(self.numerator, other.denominator, self.limit)
        if self.numerator == other.denominator:
            return Formula(other.numerator, self.denominator, self.limit)
        return self._checked(self.numerator * other.numerator, self.denominator * other.denominator)

    def __truediv__(self, other: Formula) -> Formula:
        if other.numerator == 0:
            raise ZeroDivisionError("a pivot is zero")
        return self * Formula(other.denominator, other.numerator, self.limit)

    def __str__(self) -> str:
        numerator, denominator = _text(self.numerator), _text(self.denominator)
        if self.denominator == 1:
            return numerator
        return f"({numerator})/({denominator})"


def variables(names: list[str], limit: int) -> tuple[dict[str, Formula], Formula]:
    """Return a formula for every name, and the number 1; terms are ordered by powers of the first name."""
    from flint import fmpz_mpoly_ctx

    context = fmpz_mpoly_ctx.get(names, "lex")
    one = context.constant(1)
    return {name: Formula(gen, one, limit) for name, gen in zip(names, context.gens(), strict=True)}, Formula(
        one, one, limit
    )


def apply(operation: str, operands: list[Formula]) -> Formula:
    """Apply an arithmetic operation of an expression to formulas.

    Raises
    ------
    KeyError
        Where the result is no rational function (a function, a power that is not a small integer).
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
        case "**", [a, b] if b.numerator.is_constant() and b.denominator == 1:
            return _power(a, int(b.numerator.leading_coefficient() if b.numerator != 0 else 0))
    raise KeyError(operation)


def _power(base: Formula, exponent: int) -> Formula:
    if not 0 <= exponent <= 8:
        raise KeyError("**")
    return Formula(base.numerator**exponent, base.denominator**exponent, base.limit)


def _text(polynomial: Any) -> str:
    return str(polynomial).replace("^", "**")
