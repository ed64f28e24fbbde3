"""Derivatives of poles with respect to the unknown parameters of a structure.

Of the symmetric quadratic problem (lambda^2 M + lambda C + K) u = 0 a simple pole moves by

    d lambda = - u^T (lambda^2 dM + lambda dC + dK) u / (u^T (2 lambda M + C) u),

whatever the damping (R. L. Fox, M. P. Kapoor, AIAA J. 6 (1968) 2426–2429, for damped systems S. Adhikari,
AIAA J. 37 (1999) 1452–1458); a pole of multiplicity r splits into r branches, the eigenvalues of the r x r
matrix of the same form (W. C. Mills-Curran, AIAA J. 26 (1988) 867–871).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.lti.floating import guarded
from dynid.structure.matrices import Array, as_array
from dynid.structure.model import StructuralModel
from dynid.structure.modes.modes import modes

ComplexArray = NDArray[np.complex128]

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

    Parameters
    ----------
    model
        The structure.
    values
        Its unknown parameters by name: where the derivatives are taken.

    Raises
    ------
    NumericalError, UsageError
        As of `modes`.
    """
    M, C, K = model.dense(values)
    found = modes(M, C, K, backend="dense")
    shapes, omega = found.shapes, found.omega
    D = shapes.T @ C @ shapes
    moved = [
        {letter: shapes.T @ as_array(change) @ shapes for letter, change in slopes.items()}
        for slopes in model.slopes(values)
    ]
    poles, U = second_order_poles(omega, D)
    slopes = np.zeros((len(poles), len(moved)), dtype=complex)
    clusters: list[list[int]] = []  # places of poles that are one, in the order of their size
    for place, pole in enumerate(poles):
        near = [c for c in clusters if abs(poles[c[0]] - pole) <= _SAME * abs(pole)]
        if near:
            near[0].append(place)
        else:
            clusters.append([place])
    for cluster in clusters:
        pole, u = poles[cluster].mean(), U[:, cluster]
        gram = u.T @ (2 * pole * u + D @ u)
        scale = float(np.linalg.norm(2 * pole * u) + np.linalg.norm(D @ u))
        if np.linalg.svd(gram, compute_uv=False)[-1] <= _DEFECTIVE * scale:
            slopes[cluster] = np.inf
            continue
        for j, changes in enumerate(moved):
            powers = {"M": pole**2, "C": pole, "K": 1.0}
            change = sum((powers[letter] * part for letter, part in changes.items()), np.zeros_like(D))
            branches = -np.linalg.solve(gram, u.T @ change @ u)
            slopes[cluster, j] = np.sort_complex(np.linalg.eigvals(branches))
    omega = np.abs(poles)
    zeta = -poles.real / omega
    finite = np.isfinite(slopes)
    known = np.where(finite, slopes, 0.0)
    by_omega = np.real(np.conj(poles)[:, None] * known) / omega[:, None]
    by_zeta = (-known.real - zeta[:, None] * by_omega) / omega[:, None]
    return PoleSensitivities(
        poles, omega, zeta, np.where(finite, by_omega, np.inf), np.where(finite, by_zeta, np.inf)
    )


def second_order_poles(omega: Array, D: Array) -> tuple[ComplexArray, ComplexArray]:
    """Return the poles with Im >= 0 and their modal shapes of unit length (modes x poles).

    In modal coordinates [omega q, q'] the undamped system is antisymmetric: its eigenvalues are exact to
    rounding however wide the spectrum.
    """
    m = len(omega)
    A = np.zeros((2 * m, 2 * m))
    A[:m, m:], A[m:, :m], A[m:, m:] = np.diag(omega), -np.diag(omega), -D
    poles, vectors = np.linalg.eig(A)
    poles = poles.astype(complex)
    size = np.abs(poles)
    real = np.abs(poles.imag) <= _RIGID * size
    kept = np.flatnonzero((size > _RIGID * size.max(initial=0.0)) & (real | (poles.imag > 0)))
    kept = kept[np.argsort(size[kept], kind="stable")]
    U = vectors[m:, kept].astype(complex)
    return poles[kept], U / np.linalg.norm(U, axis=0)
