"""Quotients of polynomials that stay factored.

A greatest common divisor at every step is what makes exact rational arithmetic slow. Along a reduction
the same polynomials (the pivots) come back as numerators and denominators again and again, so a value is
kept as a product of powers of factors: products and quotients only add exponents, and what meets its own
inverse is gone without any search. Only a sum multiplies out, and only what its terms do not share.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from functools import reduce
from typing import Any, Self


class Factor:
    """A polynomial (of any ring type of flint); two factors are the same only if they are one object."""

    __slots__ = ("polynomial",)

    def __init__(self, polynomial: Any) -> None:
        self.polynomial = polynomial


class Quotient(ABC):
    """A product of powers of polynomials, not necessarily in lowest terms.

    Parameters
    ----------
    factors
        Exponent by factor, negative below the fraction bar; empty for 1, and None for 0.
    sign
        1 or -1.
    """

    __slots__ = ("factors", "sign")

    def __init__(self, factors: Mapping[Factor, int] | None, sign: int = 1) -> None:
        self.factors = factors
        self.sign = sign

    @abstractmethod
    def _made(self, factors: Mapping[Factor, int] | None, sign: int, other: Self) -> Self:
        """Return the result of an operation with `other`; each kind of number keeps it small in its way."""

    @abstractmethod
    def _zero(self) -> Any:
        """Return the polynomial 0."""

    @property
    def is_zero(self) -> bool:
        """Whether the value is 0."""
        return self.factors is None

    def lowest_terms(self) -> tuple[Any, Any]:
        """Return numerator and denominator as polynomials without a common factor."""
        numerator, denominator = self.multiplied_out()
        common = numerator.gcd(denominator)
        return numerator // common, denominator // common

    def multiplied_out(self) -> tuple[Any, Any]:
        """Return numerator and denominator as polynomials, which may have common factors."""
        if self.factors is None:
            return self._zero(), self._zero() ** 0
        above = {factor: power for factor, power in self.factors.items() if power > 0}
        below = {factor: -power for factor, power in self.factors.items() if power < 0}
        numerator = self._product(above)
        return numerator if self.sign > 0 else -numerator, self._product(below)

    def _product(self, factors: Mapping[Factor, int]) -> Any:
        """Multiply out a product of positive powers, short factors first."""
        parts = [f.polynomial if power == 1 else f.polynomial**power for f, power in factors.items()]
        return reduce(self._multiplied, sorted(parts, key=len)) if parts else self._zero() ** 0

    def _multiplied(self, a: Any, b: Any) -> Any:
        """Multiply two polynomials."""
        return a * b

    def __neg__(self) -> Self:
        return self._made(self.factors, -self.sign, self)

    def __mul__(self, other: Self | int) -> Self:
        if isinstance(other, int):
            return self._times_integer(other)
        if self.factors is None or other.factors is None:
            return self._made(None, 1, other)
        return self._made(_combined(self.factors, other.factors, 1), self.sign * other.sign, other)

    def _times_integer(self, integer: int) -> Self:
        """Multiply by a constant of a program: -1, 0 or 1."""
        return self._made(self.factors if integer else None, self.sign if integer > 0 else -self.sign, self)

    def __truediv__(self, other: Self) -> Self:
        if other.factors is None:
            raise ZeroDivisionError("a pivot is zero with these values")
        if self.factors is None:
            return self._made(None, 1, other)
        return self._made(_combined(self.factors, other.factors, -1), self.sign * other.sign, other)

    def __sub__(self, other: Self) -> Self:
        return self + (-other)

    def __add__(self, other: Self) -> Self:
        if self.factors is None or other.factors is None:
            return self if other.factors is None else other
        shared, *own = _shared(self.factors, other.factors)
        left, right = (self._product(factors) for factors in own)
        if self.sign != other.sign:
            right = -right
        total = left + right
        if total == 0:
            return self._made(None, 1, other)
        return self._made(shared if total == 1 else {Factor(total): 1, **shared}, self.sign, other)


def _shared(
    a: Mapping[Factor, int], b: Mapping[Factor, int]
) -> tuple[dict[Factor, int], dict[Factor, int], dict[Factor, int]]:
    """Return what two products have in common, so that what is left of either has no negative powers."""
    shared: dict[Factor, int] = {}
    left: dict[Factor, int] = {}
    right: dict[Factor, int] = {}
    for factor in {**a, **b}:
        p, q = a.get(factor, 0), b.get(factor, 0)
        if p > q:
            left[factor] = p - q
        elif q > p:
            right[factor] = q - p
        if least := min(p, q):
            shared[factor] = least
    return shared, left, right


def _combined(a: Mapping[Factor, int], b: Mapping[Factor, int], times: int) -> dict[Factor, int]:
    """Add the exponents of two products, those of the second multiplied by `times`."""
    if len(a) < len(b) and times == 1:
        a, b = b, a
    result = dict(a)
    for factor, power in b.items():
        total = result.get(factor, 0) + times * power
        if total:
            result[factor] = total
        else:
            del result[factor]
    return result
