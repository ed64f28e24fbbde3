"""Frequency response of state-space and second-order systems."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dynid.errors import UsageError
from dynid.lti.exponential import balance, rescaled
from dynid.lti.floating import guarded
from dynid.lti.model import StateSpace
from dynid.lti.resonance import at_a_pole

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
        The response (omega x output x input); inf at an undamped pole that is in it.

    Raises
    ------
    Singular
        If a frequency lies on an undamped pole, and it cannot be told which responses are infinite there.
    """
    w = _frequencies(omega)
    n = len(system.A)
    d = balance(system.A)
    A, B = rescaled(system.A, d), system.B / d[:, None]
    row_size = np.abs(A).sum(axis=1)

    def matrices(part: Array) -> tuple[ComplexArray, Array]:
        scale = 1 / np.sqrt(_positive(part[:, None] + row_size))
        return np.asarray(1j * part[:, None, None] * np.eye(n) - A), scale

    def slopes(_: float) -> tuple[Array, Array]:
        return np.eye(n), np.zeros((n, n))

    out = _solved(_Equations(matrices, slopes), B, system.C * d, np.zeros(len(system.C), dtype=int), w)
    out += system.D
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
        The response (omega x output x input); inf at an undamped pole that is in it.

    Raises
    ------
    Singular
        If a frequency lies on an undamped pole, and it cannot be told which responses are infinite there.
    """
    w = _frequencies(omega)
    stiffness, mass, damping = (np.abs(np.diag(part)) for part in (K, M, C))

    def matrices(part: Array) -> tuple[ComplexArray, Array]:
        s = 1j * part[:, None, None]
        column = part[:, None]
        scale = 1 / np.sqrt(_positive(stiffness + column**2 * mass + column * damping))
        return K + s * C + s**2 * M, scale

    def slopes(part: float) -> tuple[ComplexArray, Array]:
        return C + 2j * part * M, M

    return _solved(_Equations(matrices, slopes), forces, outputs, np.asarray(powers, dtype=int), w)


class _Equations(NamedTuple):
    """Z(j omega) at several frequencies and its scales; dZ/ds and half the second derivative at one."""

    matrices: Callable[[Array], tuple[ComplexArray, Array]]
    slopes: Callable[[float], tuple[Array | ComplexArray, Array]]


def _frequencies(omega: ArrayLike) -> Array:
    w = np.atleast_1d(np.asarray(omega, dtype=float))
    if w.ndim != 1 or not np.all(np.isfinite(w)) or np.any(w < 0):
        raise UsageError("frequencies must be a list of finite numbers, none negative")
    return w


def _positive(size: Array) -> Array:
    return np.where(size > 0, size, 1.0)


def _solved(
    equations: _Equations, B: Array, rows: Array, powers: NDArray[np.int64], omega: Array
) -> ComplexArray:
    """Return s^power rows Z^-1 B by blocks of frequencies (omega x rows x columns of B)."""
    n = len(B)
    out = np.empty((len(omega), len(rows), B.shape[1]), dtype=complex)
    # A fixed random direction is not orthogonal to the worst one: its growth bounds the condition.
    probe = np.random.Generator(np.random.PCG64(0)).standard_normal((n, 1))
    chunk = max(1, 1_000_000 // max(1, n * n))
    for first in range(0, len(omega), chunk):
        part = slice(first, first + chunk)
        w = omega[part]
        Z, scale = equations.matrices(w)
        balanced = scale[:, :, None] * Z * scale[:, None, :]
        right = np.concatenate([scale[:, :, None] * B, np.broadcast_to(probe, (len(Z), n, 1))], axis=2)
        solution, bad = _checked_solve(balanced, right)
        out[part] = rows @ (scale[:, :, None] * solution[:, :, :-1])
        out[part] *= ((1j * w[:, None]) ** powers)[:, :, None]
        for at in np.flatnonzero(bad):
            across = scale[at][:, None] * scale[at]
            Z1, Z2 = (across * part for part in equations.slopes(float(w[at])))
            sides = rows * scale[at], scale[at][:, None] * B
            out[first + at] = at_a_pole((balanced[at], Z1, Z2), *sides, powers, float(w[at]))
    return out


def _checked_solve(Z: ComplexArray, right: Array) -> tuple[ComplexArray, NDArray[np.bool_]]:
    """Return the solutions, and which are not to be trusted."""
    try:
        solution = np.linalg.solve(Z, right.astype(complex))
    except np.linalg.LinAlgError:
        return _one_by_one(Z, right)
    size = np.abs(Z).sum(axis=2).max(axis=1, initial=0.0)
    growth = np.abs(solution[:, :, -1]).max(axis=1, initial=0.0) / np.abs(right[:, :, -1]).max(
        axis=1, initial=1.0
    )
    residual = np.abs(Z @ solution - right).max(axis=1, initial=0.0)
    allowed = _RESIDUAL * (
        size[:, None] * np.abs(solution).max(axis=1, initial=0.0) + np.abs(right).max(axis=1, initial=0.0)
    )
    bad = (size * growth > WORST_CONDITION) | ~np.all(residual <= allowed, axis=1)
    return np.asarray(solution), bad


def _one_by_one(Z: ComplexArray, right: Array) -> tuple[ComplexArray, NDArray[np.bool_]]:
    """Return what `_checked_solve` does where one of the matrices has a pivot of exactly zero."""
    if len(Z) == 1:
        return np.zeros(right.shape, dtype=complex), np.ones(1, dtype=bool)
    halves = [_checked_solve(Z[part], right[part]) for part in np.array_split(np.arange(len(Z)), 2)]
    solutions, bad = zip(*halves, strict=True)
    return np.concatenate(solutions), np.concatenate(bad)
