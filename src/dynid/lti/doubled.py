"""Arrays of numbers in double-double arithmetic: unevaluated sums of two doubles, about 31 digits.

Sums and products are the error-free transformations of Knuth and Dekker, which need neither fused
multiply-add nor a compiler: a result does not depend on the array that holds the number. Their relative
errors are at most 3 and 10 units of 2^-106 (Joldes, Muller & Popescu, "Tight and rigorous error bounds for
basic building blocks of double-word arithmetic", ACM TOMS 44 (2017) 15).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array

_SPLITTER = 2.0**27 + 1


def _two_sum(a: Array, b: Array) -> tuple[Array, Array]:
    """Return a + b rounded, and its error."""
    s = a + b
    t = s - a
    return s, (a - (s - t)) + (b - t)


def _quick_two_sum(a: Array, b: Array) -> tuple[Array, Array]:
    """Return a + b rounded, and its error, where b is the smaller one."""
    s = a + b
    return s, b - (s - a)


def _halves(a: Array) -> tuple[Array, Array]:
    """Split into two numbers of half the bits."""
    c = _SPLITTER * a
    high = c - (c - a)
    return high, a - high


def two_product(a: Array, b: Array) -> tuple[Array, Array]:
    """Return a b rounded, and its error."""
    p = a * b
    (ah, al), (bh, bl) = _halves(a), _halves(b)
    return p, ((ah * bh - p) + ah * bl + al * bh) + al * bl


@dataclass(frozen=True, eq=False)
class Doubled:
    """Real numbers high + low, where high is the double nearest to the sum.

    The magnitudes of factors must stay within 2^-450 and 2^450.
    """

    high: Array
    low: Array

    @classmethod
    def of(cls, value: Array) -> Doubled:
        """Return doubles as double-double numbers."""
        return cls(value, np.zeros_like(value))

    def __add__(self, other: Doubled) -> Doubled:
        s, e = _two_sum(self.high, other.high)
        t, f = _two_sum(self.low, other.low)
        s, e = _quick_two_sum(s, e + t)
        return Doubled(*_quick_two_sum(s, e + f))

    def __neg__(self) -> Doubled:
        return Doubled(-self.high, -self.low)

    def __sub__(self, other: Doubled) -> Doubled:
        return self + (-other)

    def __mul__(self, other: Doubled) -> Doubled:
        p, e = two_product(self.high, other.high)
        return Doubled(*_quick_two_sum(p, e + (self.high * other.low + self.low * other.high)))

    def __getitem__(self, index: Any) -> Doubled:
        return Doubled(self.high[index], self.low[index])

    def scaled(self, exponent: NDArray[np.int64]) -> Doubled:
        """Return the numbers times 2^exponent, exact within the range of doubles."""
        return Doubled(np.ldexp(self.high, exponent), np.ldexp(self.low, exponent))

    def sqrt(self) -> Doubled:
        """Return the square root of positive numbers, to a relative 2^-100."""
        root = Doubled.of(np.sqrt(self.high))
        rest = self - root * root
        return root + Doubled.of(rest.high / (2 * root.high))

    def rounds_the_same(self, radius: Array) -> NDArray[np.bool_]:
        """Return a mask of where every number within the radius is rounded to `high`."""
        slack = radius + 2.0**-52 * np.abs(self.low)
        same: NDArray[np.bool_] = (self.high + (self.low - slack) == self.high) & (
            self.high + (self.low + slack) == self.high
        )
        return same


@dataclass(frozen=True, eq=False)
class DoubledComplex:
    """Complex numbers with double-double parts."""

    real: Doubled
    imag: Doubled

    @classmethod
    def of(cls, value: NDArray[np.complex128]) -> DoubledComplex:
        """Return complex doubles as double-double numbers."""
        return cls(Doubled.of(value.real.copy()), Doubled.of(value.imag.copy()))

    def __add__(self, other: DoubledComplex) -> DoubledComplex:
        return DoubledComplex(self.real + other.real, self.imag + other.imag)

    def __neg__(self) -> DoubledComplex:
        return DoubledComplex(-self.real, -self.imag)

    def __sub__(self, other: DoubledComplex) -> DoubledComplex:
        return DoubledComplex(self.real - other.real, self.imag - other.imag)

    def __mul__(self, other: DoubledComplex) -> DoubledComplex:
        return DoubledComplex(
            self.real * other.real - self.imag * other.imag, self.real * other.imag + self.imag * other.real
        )

    def __getitem__(self, index: Any) -> DoubledComplex:
        return DoubledComplex(self.real[index], self.imag[index])

    @property
    def rounded(self) -> NDArray[np.complex128]:
        """The nearest complex doubles."""
        value = np.empty(self.real.high.shape, dtype=np.complex128)
        value.real, value.imag = self.real.high, self.imag.high
        return value
