"""Complex numbers of twice the usual precision, with error bounds, for large graphs.

A number is stored as six rows: real part and imaginary part, each an unevaluated sum of two doubles (about 31
digits), the modulus, and a bound on the modulus of the error. The sums and products are the error-free
transformations of Dekker and Knuth with fused multiply-adds; a reciprocal is a rounded one and a correction
from its residual (Joldes, Muller & Popescu 2017). The bounds follow the moduli, so that they do not grow
where the errors do not.

`native/doubled.c` computes the same many times faster, and is used where the library is.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from itertools import chain
from typing import Any

import numpy as np

from dynid.arrays import Array

# Relative error bounds of the operations: several times what an analysis of the algorithms gives (a sum 4, a
# product 16, a reciprocal about 100 units of 2^-106), so that no rounding of the bounds themselves counts.
_SUM_ERROR, _PRODUCT_ERROR, _RECIPROCAL_ERROR = 2.0**-102, 2.0**-100, 2.0**-97
#: Absolute error of a product or reciprocal whose parts fall below the range of doubles.
_UNDERFLOW_ERROR = 2.0**-1068
# Squared moduli that can be trusted: beyond them the square, or its low part, leaves the range of doubles.
_MIN_SQUARE, _MAX_SQUARE = 2.0**-900, 2.0**900
#: A divisor with a larger relative error (nine digits of 31) is taken for one that may be zero.
_MAX_DIVISOR_ERROR = 2.0**-30
#: By how much an error of that size makes the bound of a reciprocal larger.
_RECIPROCAL_SLACK = 1.0 + 2.0**-29
#: Relative and absolute error of an exact number that is stored in two doubles.
_STORED_ERROR, _STORED_UNDERFLOW = 2.0**-104, 2.0**-1070

_CONJUGATED = np.array([-1.0, -1.0, -1.0, -1.0, 1.0, 1.0])[:, None]


class DoubledComplex:
    """Complex numbers of twice the usual precision; a divisor that may be zero makes the bound infinite.

    Parameters
    ----------
    rows
        High and low part of the real part, of the imaginary part, the modulus, and the error bound; shape
        (6, numbers).
    """

    __slots__ = ("rows",)

    def __init__(self, rows: Array) -> None:
        self.rows = rows

    @classmethod
    def real(cls, number: Fraction | int) -> DoubledComplex:
        """Return a real number."""
        ((high, low, bound),) = doubled_reals([number])
        return cls(np.array([high, low, 0.0, 0.0, abs(high), bound])[:, None])

    @classmethod
    def on_axis(cls, omega: Array) -> DoubledComplex:
        """Return the numbers j omega, exactly."""
        zero = np.zeros_like(omega)
        return cls(np.stack((zero, zero, omega, zero, np.abs(omega), zero)))

    def __neg__(self) -> DoubledComplex:
        return DoubledComplex(_CONJUGATED * self.rows)

    def __add__(self, other: DoubledComplex) -> DoubledComplex:
        a, b = self.rows, other.rows
        s, e = _two_sum(a[0], b[0])
        e = e + (a[1] + b[1])
        t, f = _two_sum(a[2], b[2])
        f = f + (a[3] + b[3])
        re, im = s + e, t + f
        bound = a[5] + b[5] + _SUM_ERROR * (a[4] + b[4])
        return DoubledComplex(np.stack((re, e - (re - s), im, f - (im - t), _modulus(re, im), bound)))

    def __sub__(self, other: DoubledComplex) -> DoubledComplex:
        return self + -other

    def __mul__(self, other: DoubledComplex | int) -> DoubledComplex:
        if isinstance(other, int):
            other = DoubledComplex.real(other)
        a, b = self.rows, other.rows
        re = _difference_of_products(a[0], a[1], b[0], b[1], a[2], a[3], b[2], b[3])
        im = _difference_of_products(a[0], a[1], b[2], b[3], -a[2], -a[3], b[0], b[1])
        modulus = a[4] * b[4]
        bound = a[4] * b[5] + a[5] * (b[4] + b[5]) + (_PRODUCT_ERROR * modulus + _UNDERFLOW_ERROR)
        return DoubledComplex(np.stack((*re, *im, modulus, bound)))

    def __truediv__(self, other: DoubledComplex) -> DoubledComplex:
        return self * other.reciprocal()

    def reciprocal(self) -> DoubledComplex:
        """Return 1 / z; the bound is infinite where z may be zero, or too large or small to be squared."""
        rh, rl, ih, il, modulus, error = self.rows
        square = rh * rh + ih * ih
        inverse = 1.0 / square
        ur, ui = rh * inverse, -ih * inverse
        # what the rounded reciprocal leaves over: 1 - z u, a sum of exact products
        p, q = rh * ur, ih * ui
        s, e = _two_sum(1.0, -p)
        t, f = _two_sum(s, q)
        left_r = t + (e + f + (_fma(ih, ui, -q) - _fma(rh, ur, -p)) - (rl * ur - il * ui))
        p, q = rh * ui, ih * ur
        t, f = _two_sum(-p, -q)
        left_i = t + (f - (_fma(rh, ui, -p) + _fma(ih, ur, -q)) - (rl * ui + il * ur))
        dr, di = left_r * ur - left_i * ui, left_r * ui + left_i * ur
        re, im = ur + dr, ui + di
        size = modulus * inverse
        sound = (error <= _MAX_DIVISOR_ERROR * modulus) & (square > _MIN_SQUARE) & (square < _MAX_SQUARE)
        bound = _RECIPROCAL_SLACK * error * inverse + (_RECIPROCAL_ERROR * size + _UNDERFLOW_ERROR)
        bound = np.where(sound, bound, np.inf)
        return DoubledComplex(np.stack((re, dr - (re - ur), im, di - (im - ui), size, bound)))


def _two_sum(a: Any, b: Any) -> tuple[Any, Any]:
    """Return a + b rounded, and its error."""
    s = a + b
    t = s - a
    return s, (a - (s - t)) + (b - t)


def _fma(a: Any, b: Any, c: Any) -> Any:
    """Return a b + c of doubles: exact where c is -a b rounded, else with one rounding more than fused."""
    p = a * b
    t, u = 134217729.0 * a, 134217729.0 * b  # 2^27 + 1: halves of 26 bits (Veltkamp)
    ah, bh = t - (t - a), u - (u - b)
    al, bl = a - ah, b - bh
    error = al * bl - (((p - ah * bh) - al * bh) - ah * bl)
    s, rest = _two_sum(p, c)
    return s + (error + rest)


def _modulus(re: Array, im: Array) -> Array:
    """Return |re + j im|, by the sum of the parts where their squares would leave the range."""
    square = re * re + im * im
    return np.where((square > _MIN_SQUARE) & (square < _MAX_SQUARE), np.sqrt(square), abs(re) + abs(im))


def _difference_of_products(
    ah: Array, al: Array, bh: Array, bl: Array, ch: Array, cl: Array, dh: Array, dl: Array
) -> tuple[Array, Array]:
    """Return a b - c d of double-doubles."""
    p = ah * bh
    q = ch * dh
    s, error = _two_sum(p, -q)
    error = error + _fma(ah, bh, -p) - _fma(ch, dh, -q)
    error = error + _fma(ah, bl, al * bh) - _fma(ch, dl, cl * dh)
    high = s + error
    return high, error - (high - s)


def doubled_reals(exact: Sequence[Fraction | int]) -> Array:
    """Return numbers as sums of two doubles, with bounds on what they miss; shape (numbers, 3)."""
    above, below = zip(*(number.as_integer_ratio() for number in exact), strict=True) if exact else ((), ())
    if max(map(abs, chain(above, below)), default=2**53) >= 2**53:
        return np.array([_doubled_real(number) for number in exact]).reshape(-1, 3)
    numerator, denominator = np.array(above, dtype=float), np.array(below, dtype=float)
    high = numerator / denominator
    low = -_fma(high, denominator, -numerator) / denominator  # what is left of the numerator is exact
    return np.column_stack((high, low, _STORED_ERROR * abs(high) + _STORED_UNDERFLOW))


def _doubled_real(exact: Fraction | int) -> tuple[float, float, float]:
    numerator, denominator = exact.as_integer_ratio()
    try:
        high = numerator / denominator
        above, below = high.as_integer_ratio()
        low = (numerator * below - above * denominator) / (denominator * below)
    except OverflowError:
        return np.inf, 0.0, np.inf
    return high, low, _STORED_ERROR * abs(high) + _STORED_UNDERFLOW
