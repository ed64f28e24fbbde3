"""Rational functions as fraction-free pairs of polynomials.

A greatest common divisor at every step is what makes exact rational arithmetic slow. Along a reduction
the immittance and the source of one junction share their denominator, and dividing one by the other
cancels it without any search; common factors are looked for only where a degree exceeds what the
storage elements behind the value can explain.
"""

from __future__ import annotations

from typing import Any

#: Beyond the storages behind it, a value may carry one factor s (a momentum or displacement output).
_SLACK = 1


class Ratio:
    """A quotient of two integer polynomials in s (flint `fmpz_poly`), not necessarily in lowest terms.

    Parameters
    ----------
    numerator, denominator
        Polynomials; the denominator is not zero.
    storages
        Bit mask of the storage elements behind the value.
    """

    __slots__ = ("denominator", "numerator", "storages")

    def __init__(self, numerator: Any, denominator: Any, storages: int = 0) -> None:
        self.numerator = numerator
        self.denominator = denominator
        self.storages = storages

    def reduced(self) -> Ratio:
        """Return the same function in lowest terms (integer content included)."""
        common = self.numerator.gcd(self.denominator)
        if common.degree() <= 0 and common.is_one():
            return self
        return Ratio(self.numerator // common, self.denominator // common, self.storages)

    def _kept_small(self) -> Ratio:
        degree = max(self.numerator.degree(), self.denominator.degree())
        return self.reduced() if degree > self.storages.bit_count() + _SLACK else self

    def __add__(self, other: Ratio) -> Ratio:
        storages = self.storages | other.storages
        if self.denominator == other.denominator:
            return Ratio(self.numerator + other.numerator, self.denominator, storages)._kept_small()
        numerator = self.numerator * other.denominator + other.numerator * self.denominator
        return Ratio(numerator, self.denominator * other.denominator, storages)._kept_small()

    def __neg__(self) -> Ratio:
        return Ratio(-self.numerator, self.denominator, self.storages)

    def __sub__(self, other: Ratio) -> Ratio:
        return self + (-other)

    def __mul__(self, other: Ratio | int) -> Ratio:
        if isinstance(other, int):
            return Ratio(self.numerator * other, self.denominator, self.storages)
        storages = self.storages | other.storages
        if self.denominator == other.numerator:
            return Ratio(self.numerator, other.denominator, storages)
        if self.numerator == other.denominator:
            return Ratio(other.numerator, self.denominator, storages)
        product = Ratio(self.numerator * other.numerator, self.denominator * other.denominator, storages)
        return product._kept_small()

    def __truediv__(self, other: Ratio) -> Ratio:
        if other.numerator == 0:
            raise ZeroDivisionError("a pivot is zero with these values")
        return self * Ratio(other.denominator, other.numerator, other.storages)
