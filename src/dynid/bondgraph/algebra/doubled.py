"""Programs run on complex numbers of twice the usual precision, with error bounds, for large graphs.

Every register is a block of frequencies (`LANES` of them), stored as six rows: real part and imaginary
part, each an unevaluated sum of two doubles (about 31 digits), the modulus, and a bound on the modulus of
the error. The sums and products are the error-free transformations of Dekker and Knuth with fused
multiply-adds; a quotient is a rounded one and a correction from its residual (Joldes, Muller & Popescu
2017). The bounds follow the moduli, so that they do not grow where the errors do not.

The module is compiled by numba; import it where a graph is large enough to pay for that.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
import numpy as np
from numba.extending import intrinsic
from numpy.typing import NDArray

from dynid.bondgraph.reduction.program import Op

F = TypeVar("F", bound=Callable[..., Any])
Array = NDArray[np.float64]

#: Frequencies in a block: a few cache lines of each row, so that the registers alive stay in the cache.
LANES = 64
ROWS = 6

# Relative error bounds of the operations: several times what an analysis of the algorithms gives (a sum 4, a
# product 16, a quotient about 100 units of 2^-106), so that no rounding of the bounds themselves counts.
_SUM, _PRODUCT, _QUOTIENT = 2.0**-102, 2.0**-100, 2.0**-97
#: Absolute error of a product or quotient whose parts fall below the range of doubles.
_UNDERFLOW = 2.0**-1068
# Squared moduli that can be trusted: beyond them the square, or its low part, leaves the range of doubles.
_LEAST, _MOST = 2.0**-900, 2.0**900

_LAPLACE, _ADD, _SUB = int(Op.LAPLACE), int(Op.ADD), int(Op.SUB)
_MUL, _DIV, _NEG = int(Op.MUL), int(Op.DIV), int(Op.NEG)


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
        size_a, error_a, size_b, error_b = (
            a[4 * LANES + i],
            a[5 * LANES + i],
            b[4 * LANES + i],
            b[5 * LANES + i],
        )
        re, low = _difference_of_products(arh, arl, brh, brl, aih, ail, bih, bil)
        c[LANES + i] = low
        im, low = _difference_of_products(arh, arl, bih, bil, -aih, -ail, brh, brl)
        c[3 * LANES + i] = low
        c[i] = re
        c[2 * LANES + i] = im
        c[4 * LANES + i] = _modulus(re, im)
        c[5 * LANES + i] = (
            size_a * error_b + error_a * (size_b + error_b) + (_PRODUCT * (size_a * size_b) + _UNDERFLOW)
        )


@compiled
def _quotient(a: Array, b: Array, c: Array) -> None:
    """Write a / b to c; the bound is infinite where b may be zero, or too large or small to be squared."""
    for i in range(LANES):
        arh, arl, aih, ail = a[i], a[LANES + i], a[2 * LANES + i], a[3 * LANES + i]
        brh, brl, bih, bil = b[i], b[LANES + i], b[2 * LANES + i], b[3 * LANES + i]
        size_b, error_a, error_b = b[4 * LANES + i], a[5 * LANES + i], b[5 * LANES + i]
        square = brh * brh + bih * bih
        inverse = 1.0 / square
        ur, ui = brh * inverse, -bih * inverse
        qr, qi = arh * ur - aih * ui, arh * ui + aih * ur
        # what the rounded quotient leaves over: a - b q, a sum of exact products
        p, q = brh * qr, bih * qi
        s, e = _two_sum(arh, -p)
        t, f = _two_sum(s, q)
        left_r = t + (e + f + (fma(bih, qi, -q) - fma(brh, qr, -p)) + (arl - brl * qr + bil * qi))
        p, q = brh * qi, bih * qr
        s, e = _two_sum(aih, -p)
        t, f = _two_sum(s, -q)
        left_i = t + (e + f - (fma(brh, qi, -p) + fma(bih, qr, -q)) + (ail - brl * qi - bil * qr))
        dr, di = left_r * ur - left_i * ui, left_r * ui + left_i * ur
        re, im = qr + dr, qi + di
        c[LANES + i] = dr - (re - qr)
        c[3 * LANES + i] = di - (im - qi)
        c[i] = re
        c[2 * LANES + i] = im
        size = _modulus(re, im)
        c[4 * LANES + i] = size
        least = size_b - error_b
        bound = (error_a + size * error_b) / least + (_QUOTIENT * size + _UNDERFLOW * (1.0 + 1.0 / size_b))
        sound = (least > 0.0) & (square > _LEAST) & (square < _MOST)
        c[5 * LANES + i] = bound if sound else np.inf


@compiled
def evaluate(tape: NDArray[np.int64], constants: Array, omega: Array, memory: Array) -> None:
    """Run a tape at one block of frequencies.

    Parameters
    ----------
    tape
        Rows of operation, first operand, second operand and target: slots of the memory. The first operand
        of a constant is its row in `constants`.
    constants
        High part, low part and error bound of each.
    omega
        Angular frequencies, shape (LANES,).
    memory
        Working space, shape (slots, ROWS * LANES).
    """
    for step in range(len(tape)):
        op = tape[step, 0]
        c = memory[tape[step, 3]]
        if op == _ADD:
            _sum(memory[tape[step, 1]], memory[tape[step, 2]], c, 1.0)
        elif op == _SUB:
            _sum(memory[tape[step, 1]], memory[tape[step, 2]], c, -1.0)
        elif op == _MUL:
            _product(memory[tape[step, 1]], memory[tape[step, 2]], c)
        elif op == _DIV:
            _quotient(memory[tape[step, 1]], memory[tape[step, 2]], c)
        elif op == _NEG:
            a = memory[tape[step, 1]]
            for i in range(4 * LANES):
                c[i] = -a[i]
            for i in range(4 * LANES, ROWS * LANES):
                c[i] = a[i]
        elif op == _LAPLACE:
            for i in range(LANES):
                c[i] = 0.0
                c[LANES + i] = 0.0
                c[2 * LANES + i] = omega[i]
                c[3 * LANES + i] = 0.0
                c[4 * LANES + i] = omega[i]
                c[5 * LANES + i] = 0.0
        else:
            value = constants[tape[step, 1]]
            for i in range(LANES):
                c[i] = value[0]
                c[LANES + i] = value[1]
                c[2 * LANES + i] = 0.0
                c[3 * LANES + i] = 0.0
                c[4 * LANES + i] = abs(value[0])
                c[5 * LANES + i] = value[2]
