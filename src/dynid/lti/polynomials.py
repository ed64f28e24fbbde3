"""Polynomial pieces of signals: holds between samples, Taylor polynomials of many lines."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

HOLDS = ("spline", "linear", "zero")

TAYLOR_DEGREE = 18
"""Over steps with (frequency x step) <= 1 the first term left out is 1/19! = 8e-18, below rounding."""


def hold_coefficients(values: Array, hold: str) -> Array:
    """Return the polynomial of every piece of a hold.

    Parameters
    ----------
    values
        Samples, one step apart.
    hold
        ``spline`` (cubic, not-a-knot ends), ``linear`` or ``zero``.

    Returns
    -------
    Array
        Coefficients (pieces x ascending powers of the fraction s of the step, 0 <= s <= 1); the zero
        hold continues the last sample for one step more, the others end at it.
    """
    if hold == "zero":
        return values[:, None].copy()
    rise = np.diff(values)
    if hold == "linear":
        return np.stack([values[:-1], rise], axis=1)
    slope = _spline_slopes(values)
    left, right = slope[:-1], slope[1:]
    return np.stack([values[:-1], left, 3 * rise - 2 * left - right, left + right - 2 * rise], axis=1)


def _spline_slopes(y: Array) -> Array:
    """Return the slopes (per step) of the not-a-knot cubic spline through equidistant samples."""
    n = len(y)
    if n < 4:  # one polynomial through all points
        p = np.polynomial.Polynomial.fit(np.arange(n), y, n - 1).deriv()
        return np.asarray(p(np.arange(n)))
    from scipy.linalg import solve_banded  # heavy import, needed here only

    # Interior rows: curvature is continuous; end rows: so is the third derivative one knot inside.
    band = np.ones((3, n))
    band[1, 1:-1] = 4.0
    band[0, 1] = band[2, -2] = 2.0
    right = np.empty(n)
    right[1:-1] = 3 * (y[2:] - y[:-2])
    right[0] = (-5 * y[0] + 4 * y[1] + y[2]) / 2
    right[-1] = (5 * y[-1] - 4 * y[-2] - y[-3]) / 2
    return np.asarray(solve_banded((1, 1), band, right))


def time_scale(omega: Array) -> float:
    """Return the step over which the fastest line turns by one radian, s."""
    return float(1 / np.max(np.abs(omega)))


def factorials() -> Array:
    """Return 0! … 18!."""
    return np.array([math.factorial(n) for n in range(TAYLOR_DEGREE + 1)], dtype=float)


def shift(degree: int, tau: float) -> tuple[Array, Array]:
    """Return the generator of a polynomial whose state is ``tau^j u^(j)``."""
    h = np.zeros(degree + 1)
    h[0] = 1.0
    return np.eye(degree + 1, k=1) / tau, h


def shifted_polynomials(c: Array, s: Array) -> Array:
    """Return the derivatives of ``sum_j c_j s^j`` (rows x orders) at s."""
    out = np.zeros_like(c)
    degree = c.shape[1] - 1
    for order in range(degree + 1):
        for power in range(degree, order - 1, -1):
            out[:, order] = out[:, order] * s + c[:, power] * math.perm(power, order)
    return out


def sum_lines(omega: Array, weights: NDArray[np.complex128], times: Array) -> Array:
    """Sum ``Re weights exp(i omega t)`` over lines.

    Parameters
    ----------
    omega
        Frequencies (lines), rad/s.
    weights
        Complex amplitudes (lines x columns).
    times
        Times, s.

    Returns
    -------
    Array
        The sums (times x columns).
    """
    out = np.empty((len(times), weights.shape[1]))
    chunk = max(1, min(len(times), 2_000_000 // max(1, len(omega))))  # keeps the table at 32 MB
    steps = np.diff(times)
    step = float(steps.mean()) if len(steps) else 0.0
    if np.all(np.abs(steps - step) <= 4 * np.finfo(float).eps * np.abs(times).max(initial=0.0)):
        chunk = min(chunk, 64)  # one table serves all chunks of equidistant times
        table = np.exp(1j * np.outer(np.arange(chunk) * step, omega))
        for first in range(0, len(times), chunk):
            part = slice(first, first + chunk)
            rows = table[: len(times[part])]
            out[part] = (rows @ (weights * np.exp(1j * omega * times[first])[:, None])).real
        return out
    for first in range(0, len(times), chunk):
        part = slice(first, first + chunk)
        out[part] = (np.exp(1j * np.outer(times[part], omega)) @ weights).real
    return out


def line_derivatives(omega: Array, c: NDArray[np.complex128], times: Array, tau: float) -> Array:
    """Return ``tau^j u^(j)`` (times x orders 0 … 18) of a sum of lines."""
    orders = np.arange(TAYLOR_DEGREE + 1)
    return sum_lines(omega, c[:, None] * (1j * omega[:, None] * tau) ** orders, times)
