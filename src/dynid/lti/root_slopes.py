"""Poles and zeros of parametric systems with their exact derivatives.

A simple root z of a matrix P(s) moves by dz = -w^H dP v / (w^H P' v), with the null vectors w and v of P(z)
(P. Lancaster, Numer. Math. 6 (1964) 377–387). P is sI - A for poles, and for the zeros of one input and one
output the system pencil [sI - A, -b; c, d]. The zeros themselves are the eigenvalues of the zero dynamics,
which are split off by orthogonal transformations (A. Emami-Naeini, P. Van Dooren, Automatica 18 (1982)
415–430).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.lti.exponential import balance, rescaled
from dynid.lti.parametric import System

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

# Relative size below which a singular value or a direct term is rounding.
_ROUNDING = 1e-10
# Roots nearer than this part of their size are one; a root whose w^H P' v is below it has no derivative.
_SAME, _DEFECTIVE = 1e-7, 1e-6


class Roots(NamedTuple):
    """Finite roots of a parametric matrix, those at the origin first, then by size.

    `values` (m), exactly 0 at the origin; `slopes` (m x p): their derivatives by the parameters, 0 at the
    origin, infinite where a root is multiple or defective; `origin`: number of roots at the origin.
    """

    values: ComplexArray
    slopes: ComplexArray
    origin: int


def poles(A: Array, slopes: Array | None = None, scale: Array | None = None) -> Roots:
    """Return the eigenvalues of A (n x n), and their derivatives where those of A (p x n x n) are given.

    `scale` (n) balances it, as that of a matrix nearby does; absent: its own.
    """
    n, d = len(A), balance(A) if scale is None else scale
    A = rescaled(A, d)
    origin = _at_origin(A)
    if slopes is None:
        return _ordered(np.linalg.eigvals(A).astype(np.complex128), np.zeros((n, 0), complex), origin)
    values, right = np.linalg.eig(A)
    same, left = np.linalg.eig(A.T)
    left = left[:, np.argmin(np.abs(values[:, None] - same), axis=1)]
    strength = np.einsum("ik,ik->k", left, right)
    moved = np.einsum("ik,pij,jk->kp", left, rescaled(slopes, d), right, optimize=True)
    return _ordered(values.astype(np.complex128), _divided(moved, strength), origin)


def zeros(system: System, *, slopes: bool = True, scale: Array | None = None) -> Roots | None:
    """Return the finite zeros of a system, with their derivatives unless `slopes` is False.

    None where the input does not affect the output. `scale` (n) balances A, as that of a system nearby does;
    absent: its own.
    """
    n, p = len(system.A), len(system.A_slopes)
    if scale is None:
        scale = balance(system.A)
    A, b, c = rescaled(system.A, scale), system.b / scale, system.c * scale
    speed = max(float(np.linalg.norm(A)), np.finfo(float).tiny)
    of_b, of_c = float(np.linalg.norm(b)), float(np.linalg.norm(c))
    if not (of_b and of_c):  # what is left is the direct term: zeros where the modes are not involved
        return poles(system.A, system.A_slopes if slopes else None) if system.d else None
    gain = speed / (of_b * of_c)
    dynamics = _zero_dynamics(A / speed, b / of_b, c / of_c, system.d * gain)
    if dynamics is None:
        return None
    values: ComplexArray = np.linalg.eigvals(dynamics).astype(np.complex128)
    origin = _at_origin(dynamics)
    if not slopes or not len(values):
        return _ordered(
            np.asarray(values * speed), np.zeros((len(values), p if slopes else 0), complex), origin
        )
    pencil = np.zeros((len(values), n + 1, n + 1), dtype=complex)
    pencil[:, :n, :n] = values[:, None, None] * np.eye(n) - A / speed
    pencil[:, :n, n], pencil[:, n, :n], pencil[:, n, n] = -b / of_b, c / of_c, system.d * gain
    U, _, Vh = np.linalg.svd(pencil)
    left, right = U[:, :, -1].conj(), Vh[:, -1].conj()
    strength = np.einsum("ki,ki->k", left[:, :n], right[:, :n])
    change = np.zeros((p, n + 1, n + 1))
    change[:, :n, :n] = -rescaled(system.A_slopes, scale) / speed
    change[:, :n, n] = -system.b_slopes / scale / of_b
    change[:, n, :n], change[:, n, n] = system.c_slopes * scale / of_c, system.d_slopes * gain
    moved = -np.einsum("ki,pij,kj->kp", left, change, right, optimize=True)
    return _ordered(np.asarray(values * speed), _divided(moved * speed, strength), origin)


def _zero_dynamics(A: Array, b: Array, c: Array, d: float) -> Array | None:
    """Return the matrix of the motions that are possible while the output is 0; None without a transfer."""
    while abs(d) <= _ROUNDING * max(1.0, float(np.linalg.norm(b))):
        length = float(np.linalg.norm(c))
        if not len(A) or length <= _ROUNDING:
            return None
        # The output's direction first, by a reflection: H = 1 - share v v^T.
        v = c.copy()
        v[0] += math.copysign(length, v[0])
        share = 2 / float(v @ v)
        A = A - np.outer(share * v, v @ A)
        A -= np.outer(A @ v, share * v)
        b = b - share * float(v @ b) * v
        A, b, c, d = A[1:, 1:], b[1:], A[0, 1:], float(b[0])
    return A - np.outer(b, c) / d


def _at_origin(A: Array) -> int:
    """Return the number of eigenvalues at the origin: null spaces are split off until none is left."""
    size, count = float(np.linalg.norm(A)), 0
    while len(A):
        _, s, Vt = np.linalg.svd(A)
        null = int(np.count_nonzero(s <= _ROUNDING * size))
        if not null:
            break
        kept = Vt[: len(A) - null]
        A, count = kept @ A @ kept.T, count + null
    return count


def _divided(moved: ComplexArray, strength: ComplexArray) -> ComplexArray:
    """Return derivatives (m x p), infinite where the divisor (m) says that there are none."""
    weak = np.abs(strength) <= _DEFECTIVE
    found = moved / np.where(weak, 1.0, strength)[:, None]
    found[weak] = np.inf
    return np.asarray(found)


def _ordered(values: ComplexArray, slopes: ComplexArray, origin: int) -> Roots:
    """Return roots by size, those at the origin exact, multiple ones without derivatives."""
    size = np.round(np.log(np.abs(values) + np.finfo(float).tiny), 9)
    order = np.lexsort((-values.imag, size))
    if origin:  # the smallest ones, whatever rounding left of them
        order = np.concatenate([np.argsort(np.abs(values), kind="stable")[:origin], order])
        order = np.array(list(dict.fromkeys(order.tolist())), dtype=int)
    values, slopes = values[order], slopes[order].copy()
    values[:origin], slopes[:origin] = 0.0, 0.0
    rest = values[origin:]
    near = np.abs(rest[:, None] - rest) <= _SAME * np.abs(rest)
    multiple = np.count_nonzero(near, axis=1) > 1
    slopes[origin:][multiple] = np.inf
    return Roots(values, slopes, origin)
