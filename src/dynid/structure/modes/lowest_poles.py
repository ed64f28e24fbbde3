"""The lowest oscillating poles of a sparse damped structure, none of them missed.

Poles ``lambda^2 M + lambda C + K`` next to a real shift s > 0, where ``Z(s)`` is positive definite, are the
largest eigenvalues ``1 / (lambda - s)`` of the inverse of the linearised problem, by Arnoldi's method: F.
Tisseur, K. Meerbergen, *SIAM Review* 43 (2001), section 5. One factorisation gives all of them. All poles
within the farthest one found are known, so that those that oscillate can be counted.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.errors import NumericalError
from dynid.structure.matrices import Array

ComplexArray = NDArray[np.complex128]

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

    Parameters
    ----------
    matrices
        Mass, damping and stiffness, sparse (n x n).
    count
        How many poles.
    rigid
        Number of rigid-body modes, which have poles of zero.
    elastic
        The lowest elastic frequency without damping, rad/s.

    Returns
    -------
    tuple or None
        At least `count` poles, with all that equal the last, and shapes (n x poles); None where that takes
        nearly all poles of the structure.

    Raises
    ------
    NumericalError
        If too many poles do not oscillate.
    """
    from scipy.sparse import csc_array, diags_array
    from scipy.sparse.linalg import ArpackError, LinearOperator, eigs

    from dynid.structure.factorisation import factorise

    M, C, K = matrices
    n, shift = M.shape[0], _SHIFT * elastic
    damping = C + shift * M
    Z = K + shift * damping
    scale = 1 / np.sqrt(Z.diagonal())
    balanced = diags_array(scale) @ csc_array(Z) @ diags_array(scale)
    factor = factorise(csc_array(balanced), definite=True)

    def inverse(state: Array) -> Array:
        x, v = state[:n], elastic * state[n:]  # v is divided by a frequency: both are displacements
        forces = np.asarray(M @ v) + np.asarray(damping @ x)
        u = -scale * np.asarray(factor.solve(scale * forces))
        return np.concatenate([u, (x + shift * u) / elastic])

    operator = LinearOperator((2 * n, 2 * n), matvec=inverse, dtype=float)
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
