"""Periodic functions as Fourier series, their products with windows, and quadrature of parts of a cycle.

A function is ``c_0 + sum c_h cos(h theta) + s_h sin(h theta)``, stored as [c_0, c_1, s_1, c_2, …].
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array, ComplexArray


def to_complex(coefficients: Array) -> ComplexArray:
    """Return amplitudes a_h of ``Re sum a_h exp(i h theta)`` (H + 1 x …) from coefficients (2 H + 1 x …)."""
    first = coefficients[:1].astype(complex)
    return np.concatenate([first, coefficients[1::2] - 1j * coefficients[2::2]])


def to_real(amplitudes: ComplexArray) -> Array:
    """Return Fourier coefficients (2 H + 1 x …) of amplitudes (H + 1 x …)."""
    out = np.empty((2 * len(amplitudes) - 1, *amplitudes.shape[1:]))
    out[0], out[1::2], out[2::2] = amplitudes[0].real, amplitudes[1:].real, -amplitudes[1:].imag
    return out


def series(theta: Array, harmonics: int) -> Array:
    """Return the functions of a Fourier series at angles (angles x 2 H + 1)."""
    powers = np.cumprod(np.broadcast_to(np.exp(1j * theta)[:, None], (len(theta), harmonics)), axis=1)
    T = np.empty((len(theta), 2 * harmonics + 1))
    T[:, 0], T[:, 1::2], T[:, 2::2] = 1.0, powers.real, powers.imag
    return T


def basis(theta: Array, harmonics: int) -> tuple[Array, Array]:
    """Return the functions of a Fourier series at angles, and their derivatives (angles x 2 H + 1)."""
    T = series(theta, harmonics)
    return T, derivatives(T)


def derivatives(T: Array) -> Array:
    """Return the derivatives of the functions of a series by the angle (angles x 2 H + 1)."""
    order, D = np.arange(1, T.shape[1] // 2 + 1), np.zeros_like(T)
    D[:, 1::2], D[:, 2::2] = -order * T[:, 2::2], order * T[:, 1::2]
    return D


def rate_of(q: Array) -> Array:
    """Return the coefficients of the derivatives of series by the angle (… x 2 H + 1)."""
    order, out = np.arange(1, q.shape[-1] // 2 + 1), np.zeros_like(q)
    out[..., 1::2], out[..., 2::2] = order * q[..., 2::2], -order * q[..., 1::2]
    return out


def further_harmonics(harmonics: int) -> int:
    """Return the highest harmonic of the force that is computed, to see what a truncation leaves out."""
    return harmonics + 6


@cache
def sampled(harmonics: int, samples: int) -> tuple[Array, Array, Array]:
    """Return the basis at equal angles, its derivative, and the projection on it (2 J + 1 x samples)."""
    theta = 2 * np.pi * np.arange(samples) / samples
    T, D = basis(theta, further_harmonics(harmonics))
    projection = T.T * (2 / samples)
    projection[0] /= 2
    size = 2 * harmonics + 1
    return np.ascontiguousarray(T[:, :size]), np.ascontiguousarray(D[:, :size]), projection


@cache
def _products(rows: int, columns: int) -> tuple[NDArray[np.int_], Array, NDArray[np.int_], Array]:
    """Return products of two functions of a series as halves of sums of two others, with signs.

    Indices into ``[C_0, …, C_(J+H), S_0, …, S_(J+H)]``, cosines and sines (2 J + 1 x 2 H + 1), J = `rows`.
    """
    j, k = ((np.arange(2 * n + 1)[:, None] + 1) // 2 for n in (rows, columns))
    of_j, of_k = ((np.arange(2 * n + 1)[:, None] % 2 == 0) & (np.arange(2 * n + 1)[:, None] > 0)
                  for n in (rows, columns))  # fmt: skip
    k, of_k = k.T, of_k.T
    sines = (of_j ^ of_k) * (rows + columns + 1)
    of_sum = np.where(of_j & of_k, -0.5, 0.5)
    of_difference = np.where(of_j ^ of_k, 0.5 * np.sign(np.where(of_j, j - k, k - j)), 0.5)
    return j + k + sines, of_sum, np.abs(j - k) + sines, of_difference


@cache
def clenshaw_curtis(n: int) -> tuple[Array, Array, Array]:
    """Return nodes in [0, 1] (n), weights, and the matrix of integrals from 0 to each node (n x n)."""
    chebyshev, x = np.polynomial.chebyshev, _nodes(n)
    integrals = chebyshev.chebint(np.eye(n), lbnd=-1, scl=0.5)
    at = chebyshev.chebvander(2 * x - 1, n) @ integrals @ to_chebyshev(n)
    return x, at[-1], at


def _nodes(n: int) -> Array:
    return np.asarray((1 - np.cos(np.pi * np.arange(n) / (n - 1))) / 2)


@cache
def to_chebyshev(n: int) -> Array:
    """Return the matrix from values at the nodes to coefficients of Chebyshev polynomials (n x n)."""
    return np.asarray(np.linalg.inv(np.polynomial.chebyshev.chebvander(2 * _nodes(n) - 1, n - 1)))


def multiplied(window: NDArray[Any], rows: int, columns: int) -> Array:
    """Return the matrix by which a window multiplies a series (2 J + 1 x 2 H + 1).

    `window`: integrals of ``window exp(i h theta)`` over a cycle (J + H + 1).
    """
    parts = np.concatenate([window.real, window.imag])
    of_sum, sum_sign, of_difference, difference_sign = _products(rows, columns)
    matrix = (parts[of_sum] * sum_sign + parts[of_difference] * difference_sign) / np.pi
    matrix[0] /= 2
    return np.asarray(matrix)
