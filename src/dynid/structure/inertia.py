"""How many eigenvalues lie below a value, counted by signs of pivots (Sylvester's law of inertia).

``K - s M = L D L^T`` has as many negative pivots as ``K phi = lambda M phi`` has eigenvalues below s, for M
positive semidefinite; infinite ones (of massless directions) do not count where K is positive there.
(B. N. Parlett, The Symmetric Eigenvalue Problem, section 3.3.)
"""

from __future__ import annotations

import numpy as np

from dynid.errors import NumericalError, Singular
from dynid.structure.matrices import Array, Matrix, combined, is_sparse

# Backward error, without refinement, of factors whose signs of pivots are those of the eigenvalues.
_ROUNDING = 1e-12
_NUDGES = (0.0, 1e-10, 1e-9, 1e-8)
_DENSE = 3000
"""Size up to which a sparse matrix whose pivots do not tell is counted by dense pivots."""


def negatives(A: Matrix, backend: str = "splu") -> int:
    """Return the number of negative eigenvalues of a symmetric matrix.

    Parameters
    ----------
    A
        The matrix (n x n), dense (Bunch–Kaufman pivots) or sparse (the backend's pivots).
    backend
        The factorisation backend of sparse matrices, one that takes indefinite ones.

    Raises
    ------
    Singular
        If a pivot is zero to rounding.
    NumericalError
        If the sparse pivots do not tell and the matrix is too large for dense ones.
    """
    if not is_sparse(A):
        return _of_dense(np.asarray(A))
    from dynid.structure.factorisation import factorise

    for diagonal in (False, True) if backend == "splu" else (False,):
        try:
            factor = factorise(A, backend, definite=diagonal)
        except NumericalError:
            if not diagonal:
                raise
            break  # SuperLU's pivots on the diagonal at any price: the price was too high
        if factor.error <= _ROUNDING and (found := factor.negatives) is not None:
            return found
        del factor  # before the next one is made
    if A.shape[0] > _DENSE:
        raise NumericalError(
            f"the inertia count of the backend {backend} needs pivots off the diagonal",
            remedy="Count at another value, or use the backend pardiso.",
        )
    return _of_dense(A.toarray())


def _of_dense(A: Array) -> int:
    from scipy.linalg import ldl

    D = ldl(A, lower=True)[1]
    # D is block diagonal; the 2x2 blocks of Bunch–Kaufman have one eigenvalue of either sign.
    twos = np.flatnonzero(np.diag(D, -1))
    single = np.ones(len(D), dtype=bool)
    single[twos] = single[twos + 1] = False
    pivots = np.diag(D)[single]
    if np.any(np.abs(pivots) <= np.finfo(float).eps * np.abs(A).max(initial=0.0)):
        raise Singular("the matrix is singular to rounding: its inertia cannot be told")
    return int(np.count_nonzero(pivots < 0)) + len(twos)


def eigenvalues_below(K: Matrix, M: Matrix, value: float, backend: str = "splu") -> tuple[int, float]:
    """Count the eigenvalues of ``K phi = lambda M phi`` below a value.

    Parameters
    ----------
    K, M
        Stiffness and mass (n x n), symmetric, scaled to entries of like size; M positive semidefinite.
    value
        The value.
    backend
        As of `negatives`.

    Returns
    -------
    count, value
        The count, and the value it is for: up to 1e-8 higher where the one given hits an eigenvalue or its
        pivots do not tell.

    Raises
    ------
    NumericalError
        If no pivots tell.
    """
    for nudge in _NUDGES:
        nudged = value + nudge * abs(value)
        try:
            return negatives(combined(1.0, K, -nudged, M), backend), nudged
        except NumericalError:
            continue
    raise NumericalError(
        f"the modes below {np.sqrt(max(value, 0.0)):.6g} rad/s cannot be counted",
        remedy="Ask for another number of modes, or another limit.",
    )
