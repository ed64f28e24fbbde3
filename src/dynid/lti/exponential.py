"""The matrix exponential with its derivatives with respect to parameters, and balancing."""

from __future__ import annotations

import math

import numpy as np

from dynid.arrays import Array, ComplexArray
from dynid.errors import NumericalError

_TAYLOR_DEGREE = 16
# The Taylor remainder at this norm is 0.8^17 / 17! = 6e-17.
_LARGEST_NORM = 0.8
_COEFFICIENTS = np.array([1 / math.factorial(k) for k in range(_TAYLOR_DEGREE + 1)])
_BLOCKS = _COEFFICIENTS[:_TAYLOR_DEGREE].reshape(4, 4).copy()
_BLOCKS[0, 0] = 0.0  # exp - 1
# Largest exponent of the scale of a state: quotients of two scales stay in range.
_MAX_SCALE_EXPONENT = 400


def exponential_with_derivatives(A: Array, dA: Array, h: float) -> tuple[Array, Array]:
    """Return exp(A h) and its derivatives with respect to parameters that A depends on.

    Scaling and squaring with a Taylor polynomial of degree 16 (Paterson–Stockmeyer, six products); the
    product rule is applied to every product, so value and derivatives have the same accuracy. The relative
    error is a few roundings times max(1, norm(A h)), the condition of the problem itself for oscillatory A.
    Balance A first (`balance`) where its units make the norm larger than its eigenvalues.
    """
    S = np.concatenate([A[None], dA])
    with np.errstate(over="ignore", invalid="ignore"):
        np.multiply(S, h, out=S)
        norm = float(np.abs(S[0]).sum(axis=0).max(initial=0.0))
        if not math.isfinite(norm):
            raise NumericalError("the matrix of an exponential has entries that are not finite")
        squarings = max(0, math.ceil(math.log2(norm / _LARGEST_NORM))) if norm > 0 else 0
        if squarings:
            S = S * 0.5**squarings
        powers = np.zeros((4, *S.shape))
        powers[0, 0].flat[:: S.shape[1] + 1] = 1.0
        powers[1] = S
        powers[2] = _product(S, S)
        powers[3] = _product(powers[2], S)
        fourth = _product(powers[2], powers[2])
        blocks = (_BLOCKS @ powers.reshape(4, -1)).reshape(powers.shape)
        D: Array = blocks[3] + _COEFFICIENTS[_TAYLOR_DEGREE] * fourth
        for block in blocks[2::-1]:
            D = _product(D, fourth)
            D += block
        # exp - 1 is squared, not exp: beside a stiff part the slow one would be lost in the rounding of 1.
        for _ in range(squarings):
            D = _product(D, D) + 2 * D
        D[0].flat[:: S.shape[1] + 1] += 1.0
    if not np.isfinite(D).all():
        raise NumericalError("a matrix exponential overflows", remedy="Shorten the time span.")
    return D[0], D[1:]


def exponentials(matrices: ComplexArray) -> ComplexArray:
    """Return exp of each of a stack of matrices, all scaled and squared alike."""
    norm = float(np.abs(matrices).sum(axis=-2).max(initial=0.0))
    squarings = max(0, math.ceil(math.log2(norm / _LARGEST_NORM))) if norm > 0 else 0
    A, unity = matrices * 0.5**squarings, np.eye(matrices.shape[-1])
    powers = [unity, A, A @ A]
    powers.append(powers[2] @ A)
    fourth = powers[2] @ powers[2]
    blocks = [sum(c * X for c, X in zip(row, powers, strict=True)) for row in _BLOCKS.tolist()]
    D = blocks[3] + _COEFFICIENTS[_TAYLOR_DEGREE] * fourth
    for block in blocks[2::-1]:
        D = D @ fourth + block
    for _ in range(squarings):
        D = D @ D + 2 * D
    return np.asarray(D + unity)


def exponential(A: Array, h: float) -> Array:
    """Return exp(A h); see `exponential_with_derivatives`."""
    return exponential_with_derivatives(A, np.empty((0, *A.shape)), h)[0]


def accurate_exponential(A: Array, h: float) -> Array:
    """Return exp(A h) accurate to all digits for any norm of A h, by ball arithmetic.

    `exponential` loses digits as norm(A h) grows, also of the amplitude of an undamped oscillation.
    """
    from flint import arb, arb_mat, ctx

    n = len(A)
    norm = float(np.abs(A).sum(axis=1).max(initial=0.0)) * abs(h)
    with ctx.workprec(128 + 2 * math.ceil(math.log2(1.0 + norm))):
        E = (arb_mat(A.tolist()) * arb(h)).exp()
        return np.array([[float(E[i, j].mid()) for j in range(n)] for i in range(n)]).reshape(n, n)


def _product(X: Array, Y: Array) -> Array:
    """Multiply two matrices stacked with their derivatives (first axis)."""
    out: Array = (X.reshape(len(X) * X.shape[1], X.shape[2]) @ Y[0]).reshape(X.shape)
    out[1:] += X[0] @ Y[1:]
    return out


def balance(A: Array) -> Array:
    """Return the diagonal d, powers of two, that makes ``A_ij d_j / d_i`` small (Osborne's iteration).

    The scales (n) of the states lie between 2^-400 and 2^400; scaling by them is exact.
    """
    size = np.abs(A) * (1.0 - np.eye(len(A)))
    exponents = np.zeros(len(A), dtype=int)
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        for _ in range(30):
            balanced = True
            columns, rows = size.sum(axis=0), size.sum(axis=1)
            there = (columns > 0) & (rows > 0)
            apart = np.log2(np.where(there, rows, 1.0)) - np.log2(np.where(there, columns, 1.0))
            for i in np.flatnonzero(np.abs(apart) > 0.9).tolist():  # else e is 0
                # scale a state where that makes its row and column smaller
                column, row = float(size[:, i].sum()), float(size[i].sum())
                if not (0 < column < math.inf and 0 < row < math.inf):
                    continue
                e = round((math.log2(row) - math.log2(column)) / 2)  # never a quotient: it may overflow
                so_far = int(exponents[i])
                e = max(-_MAX_SCALE_EXPONENT - so_far, min(_MAX_SCALE_EXPONENT - so_far, e))
                if e == 0 or not math.ldexp(column, e) + math.ldexp(row, -e) < 0.95 * (column + row):
                    continue
                size[:, i] = np.ldexp(size[:, i], e)
                size[i] = np.ldexp(size[i], -e)
                exponents[i] += e
                balanced = False
            if balanced:
                break
    return np.ldexp(1.0, exponents)


def rescaled(A: Array, d: Array) -> Array:
    """Return ``A_ij d_j / d_i`` (… x n x n) without intermediate overflow."""
    return np.asarray(A * (d / d[:, None]))
