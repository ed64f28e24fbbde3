"""SuperLU, of SciPy: minimum degree on A + Aᵀ, pivots on the diagonal."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array
from scipy.sparse.linalg import SuperLU, splu

from dynid.errors import Singular

Array = NDArray[np.float64]

# An off-diagonal pivot is taken only where the diagonal one is this much smaller.
_THRESHOLD = 1e-3
_ROUNDING = 2 * float(np.finfo(float).eps)


class _Factors:
    def __init__(self, lu: SuperLU, A: csc_array) -> None:
        self._lu, self._dtype = lu, A.dtype
        self._sizes = np.asarray(abs(A).max(axis=0).todense()).ravel()

    def solve(self, b: Array) -> Array:
        return np.asarray(self._lu.solve(np.asarray(b, dtype=self._dtype)))

    @property
    def negatives(self) -> int | None:
        """Signs of U's diagonal; they are an inertia only if rows and columns were permuted alike.

        Then P A Pᵀ = L U with unit L; A symmetric, so that U = D Lᵀ and D is congruent to A. A pivot that is
        rounding of its column has no sign.
        """
        if self._dtype.kind == "c" or not np.array_equal(self._lu.perm_r, self._lu.perm_c):
            return None
        pivots = self._lu.U.diagonal()[self._lu.perm_c]
        if np.any(np.abs(pivots) <= _ROUNDING * self._sizes):
            return None
        return int(np.count_nonzero(pivots < 0))

    @property
    def memory(self) -> int:
        return 12 * int(self._lu.nnz)  # a number and a row index for each entry


def factorised(A: csc_array, *, definite: bool) -> _Factors:
    """Factorise; of a definite matrix any diagonal pivot will do."""
    try:
        lu = splu(
            A,
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0 if definite else _THRESHOLD,
            options={"SymmetricMode": True},
        )
    except RuntimeError as error:
        if "singular" not in str(error):
            raise
        raise Singular(
            "the matrix is exactly singular",
            remedy="Look for DOFs without mass and stiffness, or shift the matrix.",
        ) from None
    return _Factors(lu, A)
