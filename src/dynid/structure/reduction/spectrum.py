"""Modes of structures that may be massless and free."""

from __future__ import annotations

import numpy as np

from dynid.structure.matrices import Matrix, as_array
from dynid.structure.modes import Modes


def modes(M: Matrix, C: Matrix, K: Matrix, count: int | None = None, below: float | None = None) -> Modes:
    """Return the lowest modes by dense matrices."""
    from scipy.linalg import eigh

    M, C, K = as_array(M), as_array(C), as_array(K)
    s = np.abs(K).max() / max(np.abs(M).max(), 1e-300) * 1e-6
    mu, X = eigh(M, K + s * M)
    finite = mu > 1e-12 * mu.max()
    mu, X = mu[finite][::-1], X[:, finite][:, ::-1]
    sq = 1 / mu - s
    sq[np.abs(sq) < 1e-9 * s] = 0
    omega = np.sqrt(np.maximum(sq, 0))
    keep = len(omega) if below is None else int(np.count_nonzero(omega < below))
    keep = min(keep, len(omega) if count is None else count)
    return Modes(omega[:keep], np.zeros(keep), X[:, :keep] / np.sqrt(mu[:keep]))
