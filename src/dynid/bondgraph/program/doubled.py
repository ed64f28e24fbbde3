"""Complex numbers of twice the usual precision, with error bounds, for large graphs.

Every register is a block of frequencies, stored as six rows: real part and imaginary part, each an
unevaluated sum of two doubles (about 31 digits), the modulus, and a bound on the modulus of the error. The
sums and products are the error-free transformations of Dekker and Knuth with fused multiply-adds; a
reciprocal is a rounded one and a correction from its residual (Joldes, Muller & Popescu 2017). The bounds
follow the moduli, so that they do not grow where the errors do not.

`native/doubled.c` does the same many times faster, and is used where the library is.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array
from dynid.native import call, compiled

Integers = NDArray[np.int64]

#: Frequencies in a block of the library: a few cache lines of each row, so that the registers alive stay in
#: the cache.
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


def fma(a: Any, b: Any, c: Any) -> Any:
    """Return a b + c of doubles: exact where c is -a b rounded, else with one rounding more than fused."""
    p = a * b
    t, u = 134217729.0 * a, 134217729.0 * b  # 2^27 + 1: halves of 26 bits (Veltkamp)
    ah, bh = t - (t - a), u - (u - b)
    al, bl = a - ah, b - bh
    error = al * bl - (((p - ah * bh) - al * bh) - ah * bl)
    s, rest = _two_sum(p, c)
    return s + (error + rest)


def _two_sum(a: Any, b: Any) -> tuple[Any, Any]:
    """Return a + b rounded, and its error."""
    s = a + b
    t = s - a
    return s, (a - (s - t)) + (b - t)


def _modulus(re: Array, im: Array) -> Array:
    """Return |re + j im|, by the sum of the parts where their squares would leave the range."""
    square = re * re + im * im
    return np.where((square > _LEAST) & (square < _MOST), np.sqrt(square), abs(re) + abs(im))


def _difference_of_products(
    ah: Array, al: Array, bh: Array, bl: Array, ch: Array, cl: Array, dh: Array, dl: Array
) -> tuple[Array, Array]:
    """Return a b - c d of double-doubles."""
    p = ah * bh
    q = ch * dh
    s, error = _two_sum(p, -q)
    error = error + fma(ah, bh, -p) - fma(ch, dh, -q)
    error = error + fma(ah, bl, al * bh) - fma(ch, dl, cl * dh)
    high = s + error
    return high, error - (high - s)


# --- real numbers: high part, low part and error bound ------------------------------------------------

Real = tuple[Any, Any, Any]


def real_sum(a: Real, b: Real) -> Real:
    """Return a + b."""
    s, e = _two_sum(a[0], b[0])
    e = e + (a[1] + b[1])
    high = s + e
    return high, e - (high - s), a[2] + b[2] + _SUM * (abs(a[0]) + abs(b[0]))


def real_product(a: Real, b: Real) -> Real:
    """Return a b."""
    p = a[0] * b[0]
    e = fma(a[0], b[0], -p) + fma(a[0], b[1], a[1] * b[0])
    high = p + e
    error = abs(a[0]) * b[2] + a[2] * (abs(b[0]) + b[2]) + (_PRODUCT * abs(high) + _UNDERFLOW)
    return high, e - (high - p), error


def real_reciprocal(a: Real) -> Real:
    """Return 1 / a; the bound is infinite where a may be zero."""
    sound = (a[2] <= _KNOWN * abs(a[0])) & (a[0] != 0.0)
    q = 1.0 / np.where(sound, a[0], 1.0)
    e = (fma(-q, a[0], 1.0) - q * a[1]) * q
    high = q + e
    bound = _SLACK * a[2] * q * q + (_RECIPROCAL * abs(q) + _UNDERFLOW)
    return np.where(sound, high, 0.0), np.where(sound, e - (high - q), 0.0), np.where(sound, bound, np.inf)


# --- registers -----------------------------------------------------------------------------------------


def _powers(omega: Array) -> dict[int, Real]:
    """Return the powers of a block of frequencies."""
    zero = np.zeros_like(omega)
    up: Real = (omega, zero, zero)
    down = real_reciprocal(up)
    table: dict[int, Real] = {0: (zero + 1.0, zero, zero)}
    rising, falling = up, down
    for power in range(1, POWERS + 1):
        table[power], table[-power] = rising, falling
        rising, falling = real_product(rising, up), real_product(falling, down)
    return table


def _monomial(number: Array, power: int, powers: dict[int, Real]) -> Array:
    """Return number s^power."""
    w, sign = powers[power], -1.0 if power % 4 > 1 else 1.0
    high, low, error = sign * number[0], sign * number[1], number[2]
    p = high * w[0]
    rest = fma(high, w[0], -p) + fma(high, w[1], low * w[0])
    modulus, zero = abs(p), np.zeros_like(p)
    bound = abs(high) * w[2] + error * (w[0] + w[2]) + (_PRODUCT * modulus + _UNDERFLOW)
    parts = (p, rest, zero, zero) if power % 2 == 0 else (zero, zero, p, rest)
    return np.stack((*parts, modulus, bound))


def _sum(a: Array, b: Array, sign: float) -> Array:
    """Return a + sign b."""
    s, e = _two_sum(a[0], sign * b[0])
    e = e + (a[1] + sign * b[1])
    t, f = _two_sum(a[2], sign * b[2])
    f = f + (a[3] + sign * b[3])
    re, im = s + e, t + f
    bound = a[5] + b[5] + _SUM * (a[4] + b[4])
    return np.stack((re, e - (re - s), im, f - (im - t), _modulus(re, im), bound))


def _product(a: Array, b: Array) -> Array:
    """Return a b."""
    re = _difference_of_products(a[0], a[1], b[0], b[1], a[2], a[3], b[2], b[3])
    im = _difference_of_products(a[0], a[1], b[2], b[3], -a[2], -a[3], b[0], b[1])
    size = a[4] * b[4]
    bound = a[4] * b[5] + a[5] * (b[4] + b[5]) + (_PRODUCT * size + _UNDERFLOW)
    return np.stack((*re, *im, size, bound))


def _reciprocal(a: Array) -> Array:
    """Return 1 / a; the bound is infinite where a may be zero, or too large or small to be squared."""
    rh, rl, ih, il, size, error = a
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
    modulus = size * inverse
    sound = (error <= _KNOWN * size) & (square > _LEAST) & (square < _MOST)
    bound = np.where(sound, _SLACK * error * inverse + (_RECIPROCAL * modulus + _UNDERFLOW), np.inf)
    return np.stack((re, dr - (re - ur), im, di - (im - ui), modulus, bound))


_OPPOSITE = np.array([-1.0, -1.0, -1.0, -1.0, 1.0, 1.0])[:, None]


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
        Angular frequencies; `LANES` of them for the library.
    memory
        Working space, shape (slots, ROWS, frequencies).
    """
    if compiled():
        call("dynid_run_tape", len(tape), tape, numbers, omega, memory)
        return
    with np.errstate(all="ignore"):
        powers = _powers(omega)
        for (op, a, b, c, power), number in zip(tape.tolist(), numbers, strict=True):
            if op == _INV:
                memory[c] = _reciprocal(memory[a])
            elif op == _MUL:
                memory[c] = _product(memory[a], memory[b])
            elif op == _SHIFT:
                memory[c] = _sum(memory[a], _monomial(number, power, powers), 1.0)
            elif op == _ADD:
                memory[c] = _sum(memory[a], memory[b], 1.0)
            elif op == _SUB:
                memory[c] = _sum(memory[a], memory[b], -1.0)
            elif op == _LOAD:
                memory[c] = _monomial(number, power, powers)
            else:
                memory[c] = _OPPOSITE * memory[a]
