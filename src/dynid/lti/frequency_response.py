"""Frequency responses of state-space and second-order systems, also at an undamped pole.

Around an undamped pole s0 = j omega the equations are Z(s) = Z0 + Z1 (s - s0) + Z2 (s - s0)^2. With the null
vectors V of Z0 on the right and U on the left, Z(s)^-1 begins with V D^-1 U^H / (s - s0)^q, where
D = U^H Zq V is the first of U^H Z1 V and U^H Z2 V that does not vanish. A channel in which this term does not
vanish is infinite, except at omega = 0, where velocities and accelerations count as powers of s. In the other
channels the next term is finite.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dynid.arrays import Array, ComplexArray, guarded
from dynid.errors import Singular, UsageError
from dynid.lti.exponential import balance, rescaled
from dynid.lti.state_space import StateSpace
from dynid.number_format import frequency_text

QUANTITIES = {"displacement": 0, "velocity": 1, "acceleration": 2}
"""Output quantities and their powers of i omega (receptance, mobility, accelerance)."""
WORST_CONDITION = 1e14
"""Condition number beyond which a solution in double precision has fewer than two digits."""
_SOLVE_RESIDUAL = 1e-12
#: Singular values below this part of the largest belong to a pole.
_NULL_RTOL = 1e-14
#: Quantities below the first times the noise of a null vector are zero, above the second they are not.
_ZERO_RATIO, _NONZERO_RATIO = 30.0, 3e3


@guarded("the frequency response")
def frequency_response(system: StateSpace, omega: ArrayLike) -> ComplexArray:
    """Evaluate ``C (i omega - A)^-1 B + D + i omega D1 + …`` (omega x output x input).

    Every solve is balanced, its condition bounded by a probe and its residual checked. The response is
    infinite at an undamped pole in the channel; `Singular` where rounding hides which responses are.
    """
    w = _frequencies(omega)
    n = len(system.A)
    d = balance(system.A)
    A, B = rescaled(system.A, d), system.B / d[:, None]
    row_size = np.abs(A).sum(axis=1)

    def matrices(omega: Array) -> tuple[ComplexArray, Array]:
        scale = 1 / np.sqrt(_positive(omega[:, None] + row_size))
        return np.asarray(1j * omega[:, None, None] * np.eye(n) - A), scale

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
    """Evaluate ``(i omega)^power outputs (K + i omega C - omega^2 M)^-1 forces``, as `frequency_response`.

    `forces` are columns (n x inputs), `outputs` displacement rows (outputs x n), each with its power of i
    omega: 0 receptance, 1 mobility, 2 accelerance.
    """
    w = _frequencies(omega)
    stiffness, mass, damping = (np.abs(np.diag(matrix)) for matrix in (K, M, C))

    def matrices(omega: Array) -> tuple[ComplexArray, Array]:
        s = 1j * omega[:, None, None]
        column = omega[:, None]
        scale = 1 / np.sqrt(_positive(stiffness + column**2 * mass + column * damping))
        return K + s * C + s**2 * M, scale

    def slopes(omega: float) -> tuple[ComplexArray, Array]:
        return C + 2j * omega * M, M

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
    """Return s^power rows Z^-1 B in blocks of frequencies (omega x rows x columns of B)."""
    n = len(B)
    out = np.empty((len(omega), len(rows), B.shape[1]), dtype=complex)
    # A fixed random direction has a part in the worst one: its growth estimates the condition.
    probe = np.random.Generator(np.random.PCG64(0)).standard_normal((n, 1))
    chunk = max(1, 1_000_000 // max(1, n * n))
    for first in range(0, len(omega), chunk):
        block = slice(first, first + chunk)
        w = omega[block]
        Z, scale = equations.matrices(w)
        balanced = scale[:, :, None] * Z * scale[:, None, :]
        right = np.concatenate([scale[:, :, None] * B, np.broadcast_to(probe, (len(Z), n, 1))], axis=2)
        solution, bad = checked_solve(balanced, right)
        out[block] = rows @ (scale[:, :, None] * solution[:, :, :-1])
        out[block] *= ((1j * w[:, None]) ** powers)[:, :, None]
        for at in np.flatnonzero(bad):
            across = scale[at][:, None] * scale[at]
            Z1, Z2 = (across * block for block in equations.slopes(float(w[at])))
            sides = rows * scale[at], scale[at][:, None] * B
            out[first + at] = at_a_pole((balanced[at], Z1, Z2), *sides, powers, float(w[at]))
    return out


def checked_solve(Z: ComplexArray, right: Array | ComplexArray) -> tuple[ComplexArray, NDArray[np.bool_]]:
    """Solve balanced equations (L x n x n); return solutions (L x n x columns) and a mask of bad ones (L).

    The last right-hand side is a probe, whose growth estimates the condition; bad ones are ill conditioned,
    or leave a large residual.
    """
    try:
        solution = np.linalg.solve(Z, right.astype(complex))
    except np.linalg.LinAlgError:
        if len(Z) == 1:
            return np.zeros(right.shape, dtype=complex), np.ones(1, dtype=bool)
        # One matrix has a pivot of exactly zero: bisect to find it.
        halves = [checked_solve(Z[half], right[half]) for half in np.array_split(np.arange(len(Z)), 2)]
        solutions, bads = zip(*halves, strict=True)
        return np.concatenate(solutions), np.concatenate(bads)
    size = np.abs(Z).sum(axis=2).max(axis=1, initial=0.0)
    growth = np.abs(solution[:, :, -1]).max(axis=1, initial=0.0) / np.abs(right[:, :, -1]).max(
        axis=1, initial=1.0
    )
    residual = np.abs(Z @ solution - right).max(axis=1, initial=0.0)
    allowed = _SOLVE_RESIDUAL * (
        size[:, None] * np.abs(solution).max(axis=1, initial=0.0) + np.abs(right).max(axis=1, initial=0.0)
    )
    bad = (size * growth > WORST_CONDITION) | ~np.all(residual <= allowed, axis=1)
    return np.asarray(solution), bad


def at_a_pole(
    Z: tuple[Array | ComplexArray, Array | ComplexArray, Array | ComplexArray],
    left: Array,
    right: Array,
    powers: NDArray[np.int64],
    omega: float,
) -> ComplexArray:
    """Return ``s^power left Z(s)^-1 right`` (outputs x inputs) in the limit of s at a pole j omega.

    Z0, Z1 and Z2 (n x n) are scaled so that their entries have similar sizes; `powers` has that of each
    output. Infinite limits are inf; `Singular` where rounding hides which these are.
    """
    Z0, Z1, Z2 = Z
    U, sizes, Vh = np.linalg.svd(Z0)
    kept = sizes > _NULL_RTOL * sizes[0] if sizes[0] > 0 else np.zeros(len(sizes), dtype=bool)
    if kept.all():
        raise on_a_pole(omega)
    noise = np.finfo(float).eps * len(Z0) * (sizes[0] / sizes[kept][-1] if kept.any() else 1.0)
    V, Uh = Vh[~kept].conj().T, U[:, ~kept].conj().T
    first_order = np.abs(Uh @ Z1 @ V).max() > _ZERO_RATIO * noise * np.abs(Z1).max()
    Zq, order = (Z1, 1) if first_order else (Z2, 2)
    D = Uh @ Zq @ V
    if (order == 2 and omega > 0) or not np.linalg.cond(D) < 1 / noise:
        raise on_a_pole(omega)
    reach, drive = left @ V, np.linalg.solve(D, Uh @ right)
    smallest = np.linalg.svd(D, compute_uv=False)[-1]
    bound = np.linalg.norm(left, axis=1)[:, None] * np.linalg.norm(right, axis=0) / smallest
    share = np.abs(reach @ drive) / np.where(bound > 0, bound, 1.0)
    if np.any((share > _ZERO_RATIO * noise) & (share < _NONZERO_RATIO * noise)):
        raise on_a_pole(omega)
    driven = np.asarray(share >= _NONZERO_RATIO * noise)  # channels with a part in the modes at the pole
    inverse = (Vh[kept].conj().T / sizes[kept]) @ U[:, kept].conj().T
    remainder = right - Zq @ (V @ drive)
    limit = (left - np.linalg.solve(D.T, reach.T).T @ (Uh @ Zq)) @ (inverse @ remainder)
    if omega > 0:
        response = (1j * omega) ** powers[:, None] * limit
        return np.where(driven, complex(np.inf), response)
    # At omega = 0, s^power cancels s^-order.
    net = powers[:, None] - order
    response = np.where(powers[:, None] == 0, limit, 0)
    response = np.where(driven & (net == 0), reach @ drive, response)
    return np.asarray(np.where(driven & (net < 0), complex(np.inf), response))


def on_a_pole(omega: float) -> Singular:
    """Return the error for a frequency at which rounding hides which responses are infinite."""
    return Singular(
        f"the frequency response at {frequency_text(omega, 12)}: this frequency lies on an undamped pole, or "
        "so near that rounding hides which responses are infinite there",
        remedy="Leave that frequency out, or give the system some damping.",
    )
