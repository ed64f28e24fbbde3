"""PARDISO of Intel's MKL, by way of pypardiso: LLᵀ, or LDLᵀ with Bunch–Kaufman pivots."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, csr_matrix, triu

from dynid.errors import NumericalError, Singular

Array = NDArray[np.float64]

_DEFINITE, _INDEFINITE = 2, -2
_ANALYSE_AND_FACTORISE, _SOLVE, _RELEASE = 12, 33, -1
# Entries of iparm (from 0) that differ from, or must be said besides, PARDISO's defaults.
_SETTINGS = {
    0: 1,  # the rest is given here
    1: 2,  # nested dissection by METIS
    7: -1,  # no refinement of its own: ours is checked
    9: 8,  # perturb pivots below 1e-8 (as PARDISO does by itself for symmetric indefinite matrices)
    20: 1,  # 1x1 and 2x2 Bunch–Kaufman pivots
    34: 0,  # indices from 1
}
_NEGATIVES, _NOT_DEFINITE, _PERTURBED, _FACTOR_ENTRIES = 22, -4, 13, 17


class _Factors:
    def __init__(self, A: csc_array, definite: bool) -> None:
        from pypardiso.pardiso_wrapper import PyPardisoError, PyPardisoSolver

        self._upper = csr_matrix(triu(A, format="csr"))
        self._upper.sort_indices()
        self._solver: Any = PyPardisoSolver(mtype=_DEFINITE if definite else _INDEFINITE)
        self._solver.perm = np.zeros(A.shape[0], dtype=np.int32)
        for entry, value in _SETTINGS.items():
            self._solver.iparm[entry] = value
        self._definite = definite
        try:
            self._call(_ANALYSE_AND_FACTORISE, np.zeros(A.shape[0]))
        except PyPardisoError as error:
            if error.value == _NOT_DEFINITE:
                raise Singular("the matrix is singular, or not positive definite (PARDISO)") from None
            raise NumericalError(f"PARDISO failed with its error {error.value}") from None

    def _call(self, phase: int, b: Array) -> Array:
        self._solver.set_phase(phase)
        return np.asarray(self._solver._call_pardiso(self._upper, b))

    def solve(self, b: Array) -> Array:
        return self._call(_SOLVE, np.asfortranarray(b, dtype=float))

    @property
    def negatives(self) -> int | None:
        if self._definite:
            return 0
        return None if self._solver.iparm[_PERTURBED] else int(self._solver.iparm[_NEGATIVES])

    @property
    def memory(self) -> int:
        return 8 * int(self._solver.iparm[_FACTOR_ENTRIES])

    def __del__(self) -> None:
        if hasattr(self, "_solver"):
            self._call(_RELEASE, np.zeros(self._upper.shape[0]))


def factorised(A: csc_array, *, definite: bool) -> _Factors:
    """Factorise."""
    return _Factors(A, definite)
