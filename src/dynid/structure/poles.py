"""Poles of damped structures: the lowest of sparse ones, and derivatives by unknown parameters.

Lowest oscillating poles, none of them missed: poles ``lambda^2 M + lambda C + K`` next to a real shift s > 0,
where ``Z(s)`` is positive definite, are the largest eigenvalues ``1 / (lambda - s)`` of the inverse of the
linearised problem, by Arnoldi's method: F. Tisseur, K. Meerbergen, *SIAM Review* 43 (2001), section 5. One
factorisation gives all of them. All poles within the farthest one found are known, so that those that
oscillate can be counted.

Derivatives: of the symmetric quadratic problem (lambda^2 M + lambda C + K) u = 0 a simple pole moves by

    d lambda = - u^T (lambda^2 dM + lambda dC + dK) u / (u^T (2 lambda M + C) u),

whatever the damping (R. L. Fox, M. P. Kapoor, AIAA J. 6 (1968) 2426–2429, for damped systems S. Adhikari,
AIAA J. 37 (1999) 1452–1458); a pole of multiplicity r splits into r branches, the eigenvalues of the r x r
matrix of the same form (W. C. Mills-Curran, AIAA J. 26 (1988) 867–871).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from dynid.arrays import Array, ComplexArray, guarded
from dynid.errors import NumericalError
from dynid.structure.matrices import as_array
from dynid.structure.model import StructuralModel
from dynid.structure.modes.modes import modes
from dynid.structure.rotors import whirl_modes

STILL = 1e-9
"""Poles with a smaller imaginary part, relative, do not oscillate."""

EQUAL = 1e-6
"""Frequencies that differ by less, relative, are equal."""

# The shift as a part of the lowest elastic frequency, and the part of the shift within which a pole is zero.
_SHIFT, _ZERO = 0.1, 1e-2
# Poles computed beyond those asked for; and how often their number is doubled where many do not oscillate.
_SPARE, _DOUBLED = 8, 3


def lowest_oscillating(
    matrices: tuple[Any, Any, Any], count: int, rigid: int, elastic: float
) -> tuple[ComplexArray, ComplexArray] | None:
    """Return the lowest poles with a positive imaginary part, ascending in magnitude, and their shapes.

    `matrices`: mass, damping and stiffness, sparse (n x n), the stiffness complex with structural damping;
    `count`: how many poles; `rigid`: number of rigid-body modes, which have poles of zero; `elastic`: the
    lowest elastic frequency without damping, rad/s. Raises NumericalError if too many poles do not oscillate.

    It returns at least `count` poles, with all that equal the last, and shapes (n x poles); None where that
    takes nearly all poles of the structure.
    """
    from scipy.sparse import csc_array, diags_array
    from scipy.sparse.linalg import ArpackError, LinearOperator, eigs

    from dynid.structure.backends import factorise

    M, C, K = matrices
    n, shift = M.shape[0], _SHIFT * elastic
    damping = C + shift * M
    Z = K + shift * damping
    lossy = np.iscomplexobj(K)
    scale = 1 / np.sqrt(np.abs(Z.diagonal()))
    balanced = diags_array(scale) @ csc_array(Z) @ diags_array(scale)
    factor = factorise(csc_array(balanced), definite=not lossy)

    def inverse(state: Array) -> Array:
        x, v = state[:n], elastic * state[n:]  # v is divided by a frequency: both are displacements
        forces = np.asarray(M @ v) + np.asarray(damping @ x)
        u = -scale * np.asarray(factor.solve(scale * forces))
        return np.concatenate([u, (x + shift * u) / elastic])

    operator = LinearOperator((2 * n, 2 * n), matvec=inverse, dtype=complex if lossy else float)
    start = np.random.Generator(np.random.PCG64(0)).standard_normal(2 * n)
    asked = 2 * (count + rigid) + _SPARE
    for _ in range(_DOUBLED + 1):
        if asked >= 2 * n - 2:
            return None
        try:
            mu, vectors = eigs(operator, k=asked, v0=inverse(start))
        except ArpackError as error:
            raise NumericalError(
                f"the damped modes were not found: {error}",
                remedy="Ask for fewer modes, or check damping and units of the structure.",
            ) from error
        poles = np.asarray(shift + 1 / mu)
        reach = float(np.abs(poles - shift).max()) - shift
        zero = _ZERO * shift if rigid else 0.0
        kept = np.flatnonzero((poles.imag > STILL * np.abs(poles)) & (np.abs(poles) > zero))
        kept = kept[np.argsort(np.abs(poles[kept]), kind="stable")]
        if len(kept) >= count and (last := (1 + EQUAL) * abs(poles[kept[count - 1]])) <= reach:
            kept = kept[np.abs(poles[kept]) <= last]
            return poles[kept], vectors[:n, kept]
        asked *= 2
    raise NumericalError(
        f"only {len(kept)} of {count} damped modes oscillate among the {len(poles)} lowest poles",
        remedy="Ask for fewer modes; check whether the damping is meant to be so high.",
    )


# Poles nearer to each other than this part of their size are one; those below this part of the largest belong
# to rigid bodies.
_SAME, _RIGID = 1e-7, 1e-9
# A pole whose u^T (2 lambda M + C) u is below this part of its terms has no derivative: critical damping.
_DEFECTIVE = 1e-6


class PoleSensitivities(NamedTuple):
    """Poles with Im >= 0, without rigid-body ones, ascending in size, with their derivatives.

    `poles` (m), rad/s; `omega` (m), their sizes, and `zeta` (m), damping ratios; `omega_slopes`,
    `zeta_slopes` (m x parameters): derivatives by each parameter, infinite where a pole is about to split
    faster than linearly (critical damping). Of a multiple pole each parameter has its own branches.
    """

    poles: ComplexArray
    omega: Array
    zeta: Array
    omega_slopes: Array
    zeta_slopes: Array


@guarded("the sensitivity of the modes")
def pole_sensitivities(model: StructuralModel, values: Mapping[str, float]) -> PoleSensitivities:
    """Return the poles of a structure with their exact derivatives by its unknown parameters.

    `values`: its unknown parameters by name: where the derivatives are taken. Raises NumericalError,
    UsageError as of `modes`.
    """
    if model.rotor is not None:
        M, D, K = model.dense(values, rotating=True)
        moved = [
            {letter: as_array(change) for letter, change in slopes.items()} for slopes in model.slopes(values)
        ]
        poles, U = whirl_modes(model, values)
    else:
        M, C, K = model.dense(values)
        undamped = modes(M, C, K, backend="dense")
        shapes, omega = undamped.shapes, undamped.omega
        M, D = np.eye(len(omega)), shapes.T @ C @ shapes
        loss = shapes.T @ model.dense(values, loss=True)[2].imag @ shapes if model.hysteretic else None
        moved = [
            {letter: shapes.T @ as_array(change) @ shapes for letter, change in slopes.items()}
            for slopes in model.slopes(values)
        ]
        poles, U = second_order_poles(omega, D, loss)
    slopes = np.zeros((len(poles), len(moved)), dtype=complex)
    clusters: list[list[int]] = []  # places of poles that are one, in the order of their size
    for row, pole in enumerate(poles):
        near = [c for c in clusters if abs(poles[c[0]] - pole) <= _SAME * abs(pole)]
        if near:
            near[0].append(row)
        else:
            clusters.append([row])
    for cluster in clusters:
        pole, u = poles[cluster].mean(), U[:, cluster]
        left = u
        if model.rotor is not None:  # the vectors that an unsymmetric Z(pole) annihilates from the left
            left = np.linalg.svd((K + pole * D + pole**2 * M).T)[2][-len(cluster) :].conj().T
        inertia = 2 * pole * (M @ u)
        gram = left.T @ (inertia + D @ u)
        scale = float(np.linalg.norm(inertia) + np.linalg.norm(D @ u))
        if np.linalg.svd(gram, compute_uv=False)[-1] <= _DEFECTIVE * scale:
            slopes[cluster] = np.inf
            continue
        for j, changes in enumerate(moved):
            powers = {"M": pole**2, "C": pole, "K": 1.0, "H": 1j}
            change = sum((powers[letter] * matrix for letter, matrix in changes.items()), np.zeros_like(D))
            branches = -np.linalg.solve(gram, left.T @ change @ u)
            slopes[cluster, j] = np.sort_complex(np.linalg.eigvals(branches))
    omega = np.abs(poles)
    zeta = -poles.real / omega
    finite = np.isfinite(slopes)
    known_slopes = np.where(finite, slopes, 0.0)
    by_omega = np.real(np.conj(poles)[:, None] * known_slopes) / omega[:, None]
    by_zeta = (-known_slopes.real - zeta[:, None] * by_omega) / omega[:, None]
    return PoleSensitivities(
        poles, omega, zeta, np.where(finite, by_omega, np.inf), np.where(finite, by_zeta, np.inf)
    )


def second_order_poles(
    omega: Array, D: Array, loss: Array | None = None
) -> tuple[ComplexArray, ComplexArray]:
    """Return the poles with Im >= 0 and their modal shapes of unit length (modes x poles).

    `omega`, `D`, `loss`: natural frequencies, modal damping and modal structural damping. In modal
    coordinates [omega q, q'] the undamped system is antisymmetric: its eigenvalues are exact to rounding
    however wide the spectrum.
    """
    m = len(omega)
    A = np.zeros((2 * m, 2 * m), dtype=float if loss is None else complex)
    A[:m, m:], A[m:, :m], A[m:, m:] = np.diag(omega), -np.diag(omega), -D
    if loss is not None:  # rigid-body modes strain nothing, and lose nothing
        A[m:, :m] -= 1j * loss / np.where(omega > 0, omega, np.inf)
    poles, vectors = np.linalg.eig(A)
    poles = poles.astype(complex)
    size = np.abs(poles)
    real = np.abs(poles.imag) <= _RIGID * size
    kept = np.flatnonzero((size > _RIGID * size.max(initial=0.0)) & (real | (poles.imag > 0)))
    kept = kept[np.argsort(size[kept], kind="stable")]
    U = vectors[m:, kept].astype(complex)
    return poles[kept], U / np.linalg.norm(U, axis=0)
