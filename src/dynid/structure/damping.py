"""Damping from mass and stiffness: proportional, or given ratios of the modes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynid.errors import UsageError
from dynid.structure.matrices import Array, Matrix, as_array, combined

_MOST_MODAL = 3000


@dataclass(frozen=True)
class ProportionalDamping:
    """``C = alpha M + beta K`` (Rayleigh); alpha in 1/s, beta in s."""

    alpha: float = 0.0
    beta: float = 0.0

    def __post_init__(self) -> None:
        for name, value in (("alpha", self.alpha), ("beta", self.beta)):
            if not (math.isfinite(value) and value >= 0):
                raise UsageError(f"{name} of the damping must be finite and not negative")

    def matrix(self, M: Matrix, K: Matrix) -> Matrix:
        """Return C (n x n)."""
        return combined(self.alpha, M, self.beta, K)


@dataclass(frozen=True)
class ModalDamping:
    """``C = M Phi diag(2 zeta omega) Phi^T M``: a ratio for all modes, or a list from the lowest mode on.

    Modes beyond the list are undamped; rigid-body modes count, but have no damping.
    """

    ratio: float | Sequence[float]

    def __post_init__(self) -> None:
        values = np.atleast_1d(np.asarray(self.ratio, dtype=float))
        if not np.all(np.isfinite(values) & (values >= 0)):
            raise UsageError("damping ratios must be finite and not negative")

    def matrix(self, M: Matrix, K: Matrix) -> Matrix:
        """Return C (n x n).

        Raises
        ------
        UsageError
            If there are too many DOFs to solve for all modes, or fewer modes than ratios.
        """
        n = int(M.shape[0])
        if n > _MOST_MODAL:
            raise UsageError(
                f"modal damping takes all modes, which {n} DOFs are too many for",
                remedy="Use alpha and beta.",
            )
        omega, momentum = _all_modes(as_array(M), as_array(K))
        zeta = np.zeros(len(omega))
        ratios = np.asarray(self.ratio, dtype=float)
        if ratios.ndim and len(ratios) > len(omega):
            raise UsageError(f"there are {len(ratios)} damping ratios, but {len(omega)} modes")
        zeta[: len(ratios) if ratios.ndim else None] = ratios
        C = (momentum * (2 * zeta * omega)) @ momentum.T
        return (C + C.T) / 2


def _all_modes(M: Array, K: Array) -> tuple[Array, Array]:
    """Return all finite natural frequencies and ``M Phi``, mass possibly singular, rigid bodies possible.

    Solved as ``M phi = mu (K + s M) phi``, mu = 1 / (omega^2 + s): massless motions have mu = 0.
    """
    from scipy.linalg import eigh  # heavy import, needed here only

    size = np.sqrt(np.where(np.diag(K) > 0, np.diag(K), 1.0))
    mass, stiffness = M / size / size[:, None], K / size / size[:, None]
    # Small beside any elastic mode, so that those lose no digits; large enough to carry rigid bodies.
    shift = 1e-6 * float(np.trace(stiffness)) / max(float(np.trace(mass)), np.finfo(float).tiny) / len(M)
    mu, shapes = eigh(mass, stiffness + shift * mass)
    there = mu > 1e-12 * mu[-1]
    mu, shapes = mu[there][::-1], shapes[:, there][:, ::-1]
    square = 1 / mu - shift
    omega = np.sqrt(np.where(square > 1e-6 * shift, square, 0.0))
    momentum = mass @ shapes / np.sqrt(mu)
    return omega, np.asarray(momentum * size[:, None])
