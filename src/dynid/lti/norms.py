"""H2 norm and local maxima of the response of one input and one output, with exact derivatives by parameters.

The H2 norm is that of the impulse response, sqrt(c P c^T) with A P + P A^T + b b^T = 0; its derivatives need
only the dual Gramian (K. Zhou, J. C. Doyle, K. Glover, Robust and Optimal Control, 1996, section 4.6). A
maximum of |T(j omega)| moves with its parameters as the response at fixed frequency does (the envelope
theorem), since its derivative by the frequency vanishes.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array, ComplexArray
from dynid.lti.exponential import balance, rescaled
from dynid.lti.state_space import ParametricSystem

#: Real parts below this part of a pole, or of the size of A, are on the imaginary axis.
_AXIS_RTOL, _NORM_ROUNDING = 1e-11, 1e-14
#: A mode whose residue is below this part of the product of its factors is not seen in the response.
_HIDDEN_RTOL = 1e-10
#: Points of the grid a decade, and its margin around the poles.
_POINTS_PER_DECADE, _RANGE_FACTOR = 24, 1e3
#: Points near each pole, in its distances from the imaginary axis.
_NEAR = np.array([-4.0, -2.0, -1.0, -0.5, -0.2, 0.0, 0.2, 0.5, 1.0, 2.0, 4.0])
#: Steps of the search for a maximum in its bracket (bisection alone would need 60), and its last step.
_MAX_NORM_STEPS, _NORM_RTOL = 80, 1e-12


class _SystemModes(NamedTuple):
    """Eigenvalues of A (n), and True for each that the response does not show."""

    values: ComplexArray
    hidden: NDArray[np.bool_]

    @property
    def poles(self) -> ComplexArray:
        """The poles of the response."""
        return np.asarray(self.values[~self.hidden])


class Maxima(NamedTuple):
    """Local maxima of a magnitude over a band, its ends included where it is largest there."""

    omega: Array  # their frequencies (m), rad/s; infinite for the limit at high frequencies
    magnitude: Array  # the magnitudes there (m)
    slopes: Array  # derivatives of the magnitudes by the parameters (m x p)
    fixed: int = 0  # how many of them, the last ones, are values at fixed frequencies instead


def modes(system: ParametricSystem) -> _SystemModes:
    """Return the eigenvalues of a system and which of them are hidden."""
    scaled = _balanced(system)
    values, right, left = _eigenvectors(scaled.A)
    return _SystemModes(values, _is_hidden(scaled, right, left))


def on_axis(values: ComplexArray, size: float) -> NDArray[np.bool_]:
    """Return True for each pole that is on the imaginary axis to rounding; `size` is that of A."""
    return np.asarray(np.abs(values.real) <= np.maximum(_AXIS_RTOL * np.abs(values), _NORM_ROUNDING * size))


def without_hidden(system: ParametricSystem) -> tuple[ParametricSystem, ComplexArray]:
    """Return a system with hidden modes that are not stable moved to the left, and its poles.

    The response and its derivatives stay the same where these modes are hidden for all values.
    """
    scaled = _balanced(system)
    values, right, left = _eigenvectors(scaled.A)
    hidden = _is_hidden(scaled, right, left)
    size = float(np.linalg.norm(scaled.A)) or 1.0
    moved = hidden & ((values.real > 0) | on_axis(values, size))
    if moved.any():
        shift = np.zeros(scaled.A.shape, dtype=complex)
        for k in np.flatnonzero(moved):
            strength = left[:, k] @ right[:, k]
            shift += (
                np.outer(right[:, k], left[:, k]) / strength * (2 * max(values[k].real, 0.0) + 0.1 * size)
            )
        scaled = scaled._replace(A=scaled.A - shift.real)
    return scaled, np.asarray(values[~hidden])


def h2_norm(system: ParametricSystem) -> tuple[float, Array]:
    """Return the H2 norm of a stable system without direct term, and its derivatives by the parameters (p).

    It is the root of the mean square of the response to white noise of intensity 1, and of the integral of
    the squared impulse response. Hidden modes must be stable (`without_hidden`).
    """
    from scipy.linalg import solve_continuous_lyapunov

    A, b, c = system.A, system.b, system.c
    P = solve_continuous_lyapunov(A, -np.outer(b, b))
    Q = solve_continuous_lyapunov(A.T, -np.outer(c, c))
    square = float(c @ P @ c)
    moved = 2 * (
        np.einsum("ij,pjk,ki->p", Q, system.A_slopes, P, optimize=True)
        + system.b_slopes @ (Q @ b)
        + system.c_slopes @ (P @ c)
    )
    norm = math.sqrt(max(square, 0.0))
    return norm, moved / (2 * norm) if norm else np.zeros(len(moved))


def maxima(system: ParametricSystem, poles: ComplexArray, low: float = 0.0, high: float = math.inf) -> Maxima:
    """Return the local maxima of the magnitude of a response over a band (rad/s), with their derivatives.

    Between the points of a grid that is dense around every pole, each change of sign of the derivative by the
    frequency is narrowed down to rounding. No pole may lie on the imaginary axis within the band.
    """
    grid = _grid(poles, low, high)
    rising = _slope(system, grid)[0]
    peaks = np.flatnonzero((rising[:-1] > 0) & (rising[1:] <= 0))
    inside = _refined(system, grid[peaks], grid[peaks + 1])
    ends = [low] if low == 0 or rising[0] <= 0 else []
    if math.isfinite(high) and rising[-1] > 0:
        ends.append(high)
    omega = np.concatenate([inside, ends])
    magnitude, slopes = at_frequencies(system, omega)
    if math.isinf(high):
        size = abs(system.d)
        omega, magnitude = np.append(omega, np.inf), np.append(magnitude, size)
        slopes = np.concatenate([slopes, (np.sign(system.d) * system.d_slopes)[None]])
    return Maxima(omega, magnitude, slopes)


def followed(system: ParametricSystem, reference: Maxima, low: float = 0.0, high: float = math.inf) -> Maxima:
    """Return the same maxima of a system with slightly other parameters."""
    omega = reference.omega.copy()
    free = np.isfinite(omega) & (omega > low) & (omega < high)
    free[len(omega) - reference.fixed :] = False
    for _ in range(6 if free.any() else 0):
        slope, bend = _slope(system, omega[free])
        step = np.where(bend < 0, -slope / np.where(bend < 0, bend, -1.0), 0.0)
        omega[free] += np.clip(step, -0.1 * omega[free], 0.1 * omega[free])
        if np.all(np.abs(step) <= _NORM_RTOL * omega[free]):
            break
    finite = np.isfinite(omega)
    magnitude, slopes = np.empty(len(omega)), np.empty((len(omega), len(system.A_slopes)))
    magnitude[finite], slopes[finite] = at_frequencies(system, omega[finite])
    magnitude[~finite], slopes[~finite] = abs(system.d), np.sign(system.d) * system.d_slopes
    return Maxima(omega, magnitude, slopes, reference.fixed)


def at_frequencies(system: ParametricSystem, omega: Array) -> tuple[Array, Array]:
    """Return the magnitudes of a response at frequencies (m), and their derivatives at these (m x p)."""
    T, x, y = _response(system, omega)
    moved = (
        system.d_slopes
        + x @ system.c_slopes.T
        + y @ system.b_slopes.T
        + np.einsum("mi,pij,mj->mp", y, system.A_slopes, x, optimize=True)
    )
    size = np.abs(T)
    turned = T.conj() / np.where(size > 0, size, 1.0)
    return size, np.real(turned[:, None] * moved)


def response(system: ParametricSystem, omega: Array) -> ComplexArray:
    """Return the response at frequencies (m)."""
    return _response(system, omega)[0]


def _response(system: ParametricSystem, omega: Array) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
    """Return T (m), (j omega - A)^-1 b and (j omega - A)^-T c (m x n)."""
    n = len(system.A)
    matrix = 1j * omega[:, None, None] * np.eye(n) - system.A
    x = np.linalg.solve(matrix, np.broadcast_to(system.b[:, None], (len(omega), n, 1)).astype(complex))
    y = np.linalg.solve(
        matrix.transpose(0, 2, 1), np.broadcast_to(system.c[:, None], (len(omega), n, 1)).astype(complex)
    )
    return x[:, :, 0] @ system.c + system.d, np.asarray(x[:, :, 0]), np.asarray(y[:, :, 0])


def _slope(system: ParametricSystem, omega: Array) -> tuple[Array, Array]:
    """Return first and second derivative of |T|^2 / 2 by the frequency (m)."""
    matrix = 1j * omega[:, None, None] * np.eye(len(system.A)) - system.A
    x = np.linalg.solve(
        matrix, np.broadcast_to(system.b[:, None].astype(complex), (len(omega), len(system.b), 1))
    )
    z = np.linalg.solve(matrix, x)
    T = x[:, :, 0] @ system.c + system.d
    first = -1j * (z[:, :, 0] @ system.c)
    second = -2 * (np.linalg.solve(matrix, z)[:, :, 0] @ system.c)
    return np.real(T.conj() * first), np.abs(first) ** 2 + np.real(T.conj() * second)


def _refined(system: ParametricSystem, left: Array, right: Array) -> Array:
    """Return the zero of a falling derivative in each bracket, by Newton steps within bisection."""
    left, right = left.copy(), right.copy()
    omega = (left + right) / 2
    for _ in range(_MAX_NORM_STEPS):
        if not len(omega) or np.all(right - left <= 2 * np.spacing(right)):
            break
        slope, bend = _slope(system, omega)
        left, right = np.where(slope > 0, omega, left), np.where(slope > 0, right, omega)
        newton = omega - slope / np.where(bend < 0, bend, -1.0)
        usable = (bend < 0) & (newton > left) & (newton < right)
        following = np.where(usable, newton, (left + right) / 2)
        settled = np.all(np.abs(following - omega) <= _NORM_RTOL * omega)
        omega = following
        if settled:
            break
    return omega


def _grid(poles: ComplexArray, low: float, high: float) -> Array:
    """Return frequencies in a band that are dense around every pole."""
    sizes = np.abs(poles[poles != 0])
    smallest, largest = (sizes.min(), sizes.max()) if len(sizes) else (1.0, 1.0)
    begin, end = max(low, smallest / _RANGE_FACTOR), min(high, largest * _RANGE_FACTOR)
    if end <= begin:
        begin, end = (low, high) if math.isfinite(high) else (max(low, 1e-3), max(low, 1e-3) * _RANGE_FACTOR)
    points = max(
        2, math.ceil(_POINTS_PER_DECADE * math.log10(end / begin)) if begin > 0 else _POINTS_PER_DECADE
    )
    spread = np.geomspace(begin, end, points) if begin > 0 else np.linspace(begin, end, points)
    near = (np.abs(poles.imag)[:, None] + np.abs(poles.real)[:, None] * _NEAR).ravel()
    near = near[(near > begin) & (near < end)]
    ends = [begin, end, *([low] if low > 0 else []), *([high] if math.isfinite(high) else [])]
    return np.unique(np.concatenate([spread, near, ends]))


def _balanced(system: ParametricSystem) -> ParametricSystem:
    d = balance(system.A)
    return ParametricSystem(
        rescaled(system.A, d),
        system.b / d,
        system.c * d,
        system.d,
        rescaled(system.A_slopes, d),
        system.b_slopes / d,
        system.c_slopes * d,
        system.d_slopes,
    )


def _eigenvectors(A: Array) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
    """Return eigenvalues, right and left eigenvectors (columns), in one order."""
    values, right = np.linalg.eig(A)
    same, left = np.linalg.eig(A.T)
    left = left[:, np.argmin(np.abs(values[:, None] - same), axis=1)] if len(A) else left
    return values.astype(complex), right.astype(complex), left.astype(complex)


def _is_hidden(system: ParametricSystem, right: ComplexArray, left: ComplexArray) -> NDArray[np.bool_]:
    scale = float(np.linalg.norm(system.c)) * float(np.linalg.norm(system.b))
    seen = np.abs(system.c @ right) * np.abs(system.b @ left)
    return np.asarray(seen <= _HIDDEN_RTOL * scale)
