"""Frequency response of state-space and second-order systems."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dynid.errors import Singular, UsageError
from dynid.lti.exponential import balance, rescaled
from dynid.lti.floating import guarded
from dynid.lti.model import StateSpace

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

QUANTITIES = {"displacement": 0, "velocity": 1, "acceleration": 2}
"""Output quantities with the power of i omega each takes (receptance, mobility, accelerance)."""

WORST_CONDITION = 1e14
"""Condition beyond which an answer in double precision keeps fewer than two digits."""

_RESIDUAL = 1e-12


@guarded("the frequency response")
def frequency_response(system: StateSpace, omega: ArrayLike) -> ComplexArray:
    """Evaluate ``C (i omega - A)^-1 B + D + i omega D1 + …``.

    Every solve is balanced, its condition bounded by a probe and its residual checked.

    Parameters
    ----------
    system
        The system.
    omega
        Angular frequencies, rad/s.

    Returns
    -------
    ComplexArray
        The response (omega x output x input).

    Raises
    ------
    Singular
        If a frequency lies on an undamped pole, to rounding.
    """
    w = _frequencies(omega)
    n = len(system.A)
    d = balance(system.A)
    A, B = rescaled(system.A, d), system.B / d[:, None]
    row_size = np.abs(A).sum(axis=1)

    def matrices(part: Array) -> tuple[ComplexArray, Array]:
        scale = 1 / np.sqrt(_positive(part[:, None] + row_size))
        return np.asarray(1j * part[:, None, None] * np.eye(n) - A), scale

    X = _solved(matrices, B, w)
    out: ComplexArray = (system.C * d) @ X + system.D
    for order, feedthrough in enumerate(system.higher, 1):
        out += (1j * w[:, None, None]) ** order * feedthrough
    return out


@guarded("the frequency response")
def second_order_response(
    M: Array, C: Array, K: Array, forces: Array, outputs: Array, powers: ArrayLike, omega: ArrayLike
) -> ComplexArray:
    """Evaluate ``(i omega)^power outputs (K + i omega C - omega^2 M)^-1 forces``.

    Parameters
    ----------
    M, C, K
        Mass, damping and stiffness (n x n).
    forces
        Force directions (n x inputs).
    outputs
        Displacement rows (outputs x n).
    powers
        The power of i omega of each output: 0 receptance, 1 mobility, 2 accelerance.
    omega
        Angular frequencies, rad/s.

    Returns
    -------
    ComplexArray
        The response (omega x output x input).

    Raises
    ------
    Singular
        If a frequency lies on an undamped pole, to rounding.
    """
    w = _frequencies(omega)
    stiffness, mass, damping = (np.abs(np.diag(part)) for part in (K, M, C))

    def matrices(part: Array) -> tuple[ComplexArray, Array]:
        s = 1j * part[:, None, None]
        column = part[:, None]
        scale = 1 / np.sqrt(_positive(stiffness + column**2 * mass + column * damping))
        return K + s * C + s**2 * M, scale

    X = _solved(matrices, forces, w)
    factor = (1j * w[:, None]) ** np.asarray(powers, dtype=int)
    return np.asarray(factor[:, :, None] * (outputs @ X))


def _frequencies(omega: ArrayLike) -> Array:
    w = np.atleast_1d(np.asarray(omega, dtype=float))
    if w.ndim != 1 or not np.all(np.isfinite(w)) or np.any(w < 0):
        raise UsageError("frequencies must be a list of finite numbers, none negative")
    return w


def _positive(size: Array) -> Array:
    return np.where(size > 0, size, 1.0)


def _solved(matrices: Callable[[Array], tuple[ComplexArray, Array]], B: Array, omega: Array) -> ComplexArray:
    """Solve Z(omega) X = B by blocks of frequencies (omega x n x columns of B)."""
    n = len(B)
    X = np.empty((len(omega), *B.shape), dtype=complex)
    # A fixed random direction is not orthogonal to the worst one: its growth bounds the condition.
    probe = np.random.Generator(np.random.PCG64(0)).standard_normal((n, 1))
    chunk = max(1, 1_000_000 // max(1, n * n))
    for first in range(0, len(omega), chunk):
        part = slice(first, first + chunk)
        Z, scale = matrices(omega[part])
        balanced = scale[:, :, None] * Z * scale[:, None, :]
        right = np.concatenate([scale[:, :, None] * B, np.broadcast_to(probe, (len(Z), n, 1))], axis=2)
        solution = _checked_solve(balanced, right, omega[part])
        X[part] = scale[:, :, None] * solution[:, :, :-1]
    return X


def _checked_solve(Z: ComplexArray, right: Array, omega: Array) -> ComplexArray:
    try:
        solution = np.linalg.solve(Z, right.astype(complex))
    except np.linalg.LinAlgError:
        smallest = np.linalg.svd(Z, compute_uv=False)[:, -1]
        raise on_a_pole(float(omega[np.argmin(smallest)])) from None
    size = np.abs(Z).sum(axis=2).max(axis=1, initial=0.0)
    growth = np.abs(solution[:, :, -1]).max(axis=1, initial=0.0) / np.abs(right[:, :, -1]).max(
        axis=1, initial=1.0
    )
    residual = np.abs(Z @ solution - right).max(axis=1, initial=0.0)
    allowed = _RESIDUAL * (
        size[:, None] * np.abs(solution).max(axis=1, initial=0.0) + np.abs(right).max(axis=1, initial=0.0)
    )
    bad = (size * growth > WORST_CONDITION) | ~np.all(residual <= allowed, axis=1)
    if bad.any():
        raise on_a_pole(float(omega[np.argmax(bad)]))
    return np.asarray(solution)


def on_a_pole(omega: float) -> Singular:
    """Return the refusal of a frequency at which a response is infinite."""
    return Singular(
        f"the frequency response at {omega:.12g} rad/s is infinite or cannot be told from it: "
        "that frequency lies on an undamped pole",
        remedy="Leave that frequency out, or give the system some damping.",
    )
