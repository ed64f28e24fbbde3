"""Complex numbers of twice the usual precision, with error bounds, for large graphs.

Every register is a block of frequencies (`LANES` of them), stored as six rows: real part and imaginary
part, each an unevaluated sum of two doubles (about 31 digits), the modulus, and a bound on the modulus of
the error. The sums and products are the error-free transformations of Dekker and Knuth with fused
multiply-adds; a reciprocal is a rounded one and a correction from its residual (Joldes, Muller & Popescu
2017). The bounds follow the moduli, so that they do not grow where the errors do not.

The module is compiled by numba; import it where a graph is large enough to pay for that.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum
from typing import Any, TypeVar, cast

import numba
import numpy as np
from numba.extending import intrinsic
from numpy.typing import NDArray

F = TypeVar("F", bound=Callable[..., Any])
Array = NDArray[np.float64]
Integers = NDArray[np.int64]

#: Frequencies in a block: a few cache lines of each row, so that the registers alive stay in the cache.
LANES = 64
ROWS = 6

# Relative error bounds of the operations: several times what an analysis of the algorithms gives (a sum 4, a
# product 16, a reciprocal about 100 units of 2^-106), so that no rounding of the bounds themselves counts.
_SUM, _PRODUCT, _RECIPROCAL = 2.0**-102, 2.0**-100, 2.0**-97
#: Absolute error of a product or reciprocal whose parts fall below the range of doubles.
_UNDERFLOW = 2.0**-1068
# Squared moduli that can be trusted: beyond them the square, or its low part, leaves the range of doubles.
_LEAST, _MOST = 2.0**-900, 2.0**900
#: A divisor known less well than this (nine digits of 31) is taken for one that may be zero.
_KNOWN = 2.0**-30
#: By how much an error of that size makes the bound of a reciprocal larger.
_SLACK = 1.0 + 2.0**-29
#: Largest power of s in a monomial, either way.
POWERS = 2


class TapeOperation(IntEnum):
    """The operations of a tape. A monomial is a real number times a power of s."""

    LOAD = 0  # a monomial
    SHIFT = 1  # a register plus a monomial
    ADD = 2
    SUB = 3
    MUL = 4
    INV = 5
    NEG = 6


_LOAD, _SHIFT, _ADD, _SUB, _MUL, _INV = (int(code) for code in tuple(TapeOperation)[:-1])


def compiled(function: F) -> F:
    """Compile a function, and keep the machine code for later runs where there is a place for it."""
    options: dict[str, Any] = {"nogil": True, "error_model": "numpy"}
    try:
        return cast("F", numba.njit(function, cache=True, **options))
    except RuntimeError:  # no directory for the cache can be written
        return cast("F", numba.njit(function, **options))


def _fused(typing: Any, a: Any, b: Any, c: Any) -> Any:  # noqa: ARG001 - numba's protocol
    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.fma(*arguments)

    return numba.float64(numba.float64, numba.float64, numba.float64), generate


#: a * b + c with one rounding.
fma: Any = intrinsic(_fused)


@compiled
def _two_sum(a: float, b: float) -> tuple[float, float]:
    """Return a + b rounded, and its error."""
    s = a + b
    t = s - a
    return s, (a - (s - t)) + (b - t)


@compiled
def _modulus(re: float, im: float) -> float:
    """Return |re + j im|, by the sum of the parts where their squares would leave the range."""
    square = re * re + im * im
    root = np.sqrt(square)
    return root if (square > _LEAST) & (square < _MOST) else abs(re) + abs(im)


@compiled
def _difference_of_products(
    ah: float, al: float, bh: float, bl: float, ch: float, cl: float, dh: float, dl: float
) -> tuple[float, float]:
    """Return a b - c d of double-doubles."""
    p = ah * bh
    q = ch * dh
    s, error = _two_sum(p, -q)
    error += fma(ah, bh, -p) - fma(ch, dh, -q)
    error += fma(ah, bl, al * bh) - fma(ch, dl, cl * dh)
    high = s + error
    return high, error - (high - s)


# --- real numbers: high part, low part and error bound ------------------------------------------------

Real = tuple[float, float, float]


@compiled
def real_sum(a: Real, b: Real) -> Real:
    """Return a + b."""
    s, e = _two_sum(a[0], b[0])
    e += a[1] + b[1]
    high = s + e
    return high, e - (high - s), a[2] + b[2] + _SUM * (abs(a[0]) + abs(b[0]))


@compiled
def real_product(a: Real, b: Real) -> Real:
    """Return a b."""
    p = a[0] * b[0]
    e = fma(a[0], b[0], -p) + fma(a[0], b[1], a[1] * b[0])
    high = p + e
    error = abs(a[0]) * b[2] + a[2] * (abs(b[0]) + b[2]) + (_PRODUCT * abs(high) + _UNDERFLOW)
    return high, e - (high - p), error


@compiled
def real_reciprocal(a: Real) -> Real:
    """Return 1 / a; the bound is infinite where a may be zero."""
    if not a[2] <= _KNOWN * abs(a[0]) or a[0] == 0.0:
        return 0.0, 0.0, np.inf
    q = 1.0 / a[0]
    e = (fma(-q, a[0], 1.0) - q * a[1]) * q
    high = q + e
    return high, e - (high - q), _SLACK * a[2] * q * q + (_RECIPROCAL * abs(q) + _UNDERFLOW)


# --- registers -----------------------------------------------------------------------------------------


@compiled
def _powers(omega: Array) -> Array:
    """Return the powers of a block of frequencies, rows of high part, low part and error bound."""
    table = np.zeros((2 * POWERS + 1, 3, LANES))
    for i in range(LANES):
        table[POWERS, 0, i] = 1.0
        up, down = (omega[i], 0.0, 0.0), real_reciprocal((omega[i], 0.0, 0.0))
        rising, falling = up, down
        for power in range(1, POWERS + 1):
            for part in range(3):
                table[POWERS + power, part, i] = rising[part]
                table[POWERS - power, part, i] = falling[part]
            rising, falling = real_product(rising, up), real_product(falling, down)
    return table


@compiled
def _at(number: Array, power: int) -> tuple[float, float, float, float]:
    """Return number j^power: high and low parts of its real and its imaginary part."""
    turn = -1.0 if power % 4 > 1 else 1.0
    high, low = turn * number[0], turn * number[1]
    return (high, low, 0.0, 0.0) if power % 2 == 0 else (0.0, 0.0, high, low)


@compiled
def _load(number: Array, power: int, powers: Array, c: Array) -> None:
    """Write number s^power to c."""
    rh, rl, ih, il = _at(number, power)
    size, error = abs(number[0]), number[2]
    w = powers[POWERS + power]
    for i in range(LANES):
        re, e = rh * w[0, i], fma(rh, w[1, i], rl * w[0, i])
        im, f = ih * w[0, i], fma(ih, w[1, i], il * w[0, i])
        c[i] = re
        c[LANES + i] = fma(rh, w[0, i], -re) + e
        c[2 * LANES + i] = im
        c[3 * LANES + i] = fma(ih, w[0, i], -im) + f
        modulus = abs(re) + abs(im)  # one of them is zero
        c[4 * LANES + i] = modulus
        c[5 * LANES + i] = size * w[2, i] + error * (w[0, i] + w[2, i]) + (_PRODUCT * modulus + _UNDERFLOW)


@compiled
def _shift(a: Array, number: Array, power: int, powers: Array, c: Array) -> None:
    """Write a + number s^power to c."""
    rh, rl, ih, il = _at(number, power)
    size, error = abs(number[0]), number[2]
    w = powers[POWERS + power]
    for i in range(LANES):
        p, q = rh * w[0, i], ih * w[0, i]
        s, e = _two_sum(a[i], p)
        t, f = _two_sum(a[2 * LANES + i], q)
        e += a[LANES + i] + (fma(rh, w[0, i], -p) + fma(rh, w[1, i], rl * w[0, i]))
        f += a[3 * LANES + i] + (fma(ih, w[0, i], -q) + fma(ih, w[1, i], il * w[0, i]))
        re, im = s + e, t + f
        c[i] = re
        c[LANES + i] = e - (re - s)
        c[2 * LANES + i] = im
        c[3 * LANES + i] = f - (im - t)
        c[4 * LANES + i] = _modulus(re, im)
        modulus = abs(p) + abs(q)  # one of them is zero
        added = size * w[2, i] + error * (w[0, i] + w[2, i]) + (_PRODUCT * modulus + _UNDERFLOW)
        c[5 * LANES + i] = a[5 * LANES + i] + added + _SUM * (a[4 * LANES + i] + modulus)


@compiled
def _sum(a: Array, b: Array, c: Array, sign: float) -> None:
    """Write a + sign b to c."""
    for i in range(LANES):
        s, e = _two_sum(a[i], sign * b[i])
        e += a[LANES + i] + sign * b[LANES + i]
        re = s + e
        c[LANES + i] = e - (re - s)
        s, e = _two_sum(a[2 * LANES + i], sign * b[2 * LANES + i])
        e += a[3 * LANES + i] + sign * b[3 * LANES + i]
        im = s + e
        c[3 * LANES + i] = e - (im - s)
        c[i] = re
        c[2 * LANES + i] = im
        c[4 * LANES + i] = _modulus(re, im)
        c[5 * LANES + i] = a[5 * LANES + i] + b[5 * LANES + i] + _SUM * (a[4 * LANES + i] + b[4 * LANES + i])


@compiled
def _product(a: Array, b: Array, c: Array) -> None:
    """Write a b to c."""
    for i in range(LANES):
        arh, arl, aih, ail = a[i], a[LANES + i], a[2 * LANES + i], a[3 * LANES + i]
        brh, brl, bih, bil = b[i], b[LANES + i], b[2 * LANES + i], b[3 * LANES + i]
        size_a, error_a = a[4 * LANES + i], a[5 * LANES + i]
        size_b, error_b = b[4 * LANES + i], b[5 * LANES + i]
        c[i], c[LANES + i] = _difference_of_products(arh, arl, brh, brl, aih, ail, bih, bil)
        c[2 * LANES + i], c[3 * LANES + i] = _difference_of_products(arh, arl, bih, bil, -aih, -ail, brh, brl)
        size = size_a * size_b
        c[4 * LANES + i] = size
        c[5 * LANES + i] = size_a * error_b + error_a * (size_b + error_b) + (_PRODUCT * size + _UNDERFLOW)


@compiled
def _reciprocal(a: Array, c: Array) -> None:
    """Write 1 / a to c; the bound is infinite where a may be zero, or too large or small to be squared."""
    for i in range(LANES):
        rh, rl, ih, il = a[i], a[LANES + i], a[2 * LANES + i], a[3 * LANES + i]
        size, error = a[4 * LANES + i], a[5 * LANES + i]
        square = rh * rh + ih * ih
        inverse = 1.0 / square
        ur, ui = rh * inverse, -ih * inverse
        # what the rounded reciprocal leaves over: 1 - a u, a sum of exact products
        p, q = rh * ur, ih * ui
        s, e = _two_sum(1.0, -p)
        t, f = _two_sum(s, q)
        left_r = t + (e + f + (fma(ih, ui, -q) - fma(rh, ur, -p)) - (rl * ur - il * ui))
        p, q = rh * ui, ih * ur
        t, f = _two_sum(-p, -q)
        left_i = t + (f - (fma(rh, ui, -p) + fma(ih, ur, -q)) - (rl * ui + il * ur))
        dr, di = left_r * ur - left_i * ui, left_r * ui + left_i * ur
        re, im = ur + dr, ui + di
        c[i] = re
        c[LANES + i] = dr - (re - ur)
        c[2 * LANES + i] = im
        c[3 * LANES + i] = di - (im - ui)
        modulus = size * inverse
        c[4 * LANES + i] = modulus
        sound = (error <= _KNOWN * size) & (square > _LEAST) & (square < _MOST)
        bound = _SLACK * error * inverse + (_RECIPROCAL * modulus + _UNDERFLOW)
        c[5 * LANES + i] = bound if sound else np.inf


@compiled
def run_tape(tape: Integers, numbers: Array, omega: Array, memory: Array) -> None:
    """Run a tape at one block of frequencies.

    Parameters
    ----------
    tape
        Rows of operation (`TapeOperation`), first operand, second operand and target (slots of the memory),
        and power of s in the monomial.
    numbers
        High part, low part and error bound of the monomial of each row.
    omega
        Angular frequencies, shape (LANES,).
    memory
        Working space, shape (slots, ROWS * LANES).
    """
    powers = _powers(omega)
    for step in range(len(tape)):
        op = tape[step, 0]
        a = memory[tape[step, 1]]
        c = memory[tape[step, 3]]
        if op == _INV:
            _reciprocal(a, c)
        elif op == _MUL:
            _product(a, memory[tape[step, 2]], c)
        elif op == _SHIFT:
            _shift(a, numbers[step], tape[step, 4], powers, c)
        elif op == _ADD:
            _sum(a, memory[tape[step, 2]], c, 1.0)
        elif op == _SUB:
            _sum(a, memory[tape[step, 2]], c, -1.0)
        elif op == _LOAD:
            _load(numbers[step], tape[step, 4], powers, c)
        else:
            for i in range(4 * LANES):
                c[i] = -a[i]
            for i in range(4 * LANES, ROWS * LANES):
                c[i] = a[i]
