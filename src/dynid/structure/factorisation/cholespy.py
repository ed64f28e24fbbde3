"""CHOLMOD by way of cholespy: positive definite matrices."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array

from dynid.errors import Singular

Array = NDArray[np.float64]

_MOST_COLUMNS = 128  # of right-hand sides that cholespy takes at a time


class _Factors:
    negatives = 0
    memory = 0  # cholespy does not tell

    def __init__(self, A: csc_array) -> None:
        from cholespy import CholeskySolverD, MatrixType

        try:
            self._solver = CholeskySolverD(A.shape[0], A.indptr, A.indices, A.data, MatrixType.CSC)
        except (RuntimeError, ValueError) as error:
            raise Singular(f"the matrix is not positive definite (cholespy: {error})") from None

    def solve(self, b: Array) -> Array:
        right = np.array(b, dtype=float, order="C")
        if right.ndim == 2 and right.shape[1] > _MOST_COLUMNS:
            halves = np.array_split(right, -(-right.shape[1] // _MOST_COLUMNS), axis=1)
            return np.concatenate([self.solve(half) for half in halves], axis=1)
        x = np.zeros_like(right)
        self._solver.solve(right, x)
        return x


def factorised(A: csc_array, *, definite: bool) -> _Factors:  # noqa: ARG001 - of definite matrices only
    """Factorise."""
    return _Factors(A)
