"""Polynomial pieces of signals: holds between samples, and the shift of a polynomial."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

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
    """Return the step over which the fastest line turns by one radian, s (1 s of a constant)."""
    fastest = float(np.max(np.abs(omega), initial=0.0))
    return 1 / fastest if fastest > 0 else 1.0


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
