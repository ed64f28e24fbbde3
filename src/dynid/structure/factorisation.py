"""Direct factorisation of sparse symmetric matrices, by the backend that is named or fits the matrix."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csc_array, issparse

from dynid.defaults import BACKEND, FULL_ROWS, LARGE_MATRICES
from dynid.errors import Singular, UsageError
from dynid.structure.backends import BACKENDS, Factorisation, Order
from dynid.suggestions import did_you_mean

# Backward error, without refinement, of factors without pivoting above which the matrix is pivoted.
_UNPIVOTED = 1e-12


def backend_for(size: int, entries: int = 0) -> str:
    """Return the backend that a matrix is factorised by unless one is named.

    `size`: the number of its rows; `entries`: the number of its entries; 0: unknown.
    """
    has_library = not BACKENDS[BACKEND.value].missing()
    large = size > LARGE_MATRICES.value and (not has_library or entries > FULL_ROWS.value * size)
    if large and not BACKENDS["pardiso"].missing():
        return "pardiso"
    return BACKEND.value if has_library else "splu"


def factorise(
    A: csc_array, backend: str = "auto", *, definite: bool = False, order: Order | None = None
) -> Factorisation:
    """Factorise a symmetric sparse matrix.

    A random right-hand side is solved at once, so that a backend that returns wrong solutions is refused
    before anything is built on it.

    `A`: the matrix (n x n), symmetric, scaled so that its entries are of like size; a complex one, symmetric
    too and not Hermitian, is taken by `splu` alone; `backend`: one of `BACKENDS`, or ``auto``: that of
    `backend_for`; ``ldl`` leaves a matrix that is not definite, and not to be factorised without pivoting, to
    ``splu``; `definite`: True of a positive definite matrix: some backends take no others, and others are
    faster then; `order`: a good order of elimination (n), of a matrix of the same pattern.

    Raises UsageError if the matrix is not sparse and square, or a backend does not exist, is not installed,
    or does not take such matrices, Singular if the matrix is singular, or not definite where it should be,
    and NumericalError if the backend's solutions are wrong.
    """
    if not issparse(A) or A.shape[0] != A.shape[1]:
        raise UsageError("a matrix to be factorised must be sparse and square")
    A = csc_array(A, dtype=complex if np.iscomplexobj(A) else float)
    if backend == "auto":
        backend = "splu" if np.iscomplexobj(A) else backend_for(A.shape[0], A.nnz)
    A.sort_indices()
    if not np.isfinite(A.data).all():
        raise UsageError("a matrix to be factorised has entries that are not finite numbers")
    _check_backend(backend, definite=definite, real=not np.iscomplexobj(A))
    if backend == "ldl" and not definite:
        try:
            factor = BACKENDS[backend](A, definite=False, order=order)
            if factor.error <= _UNPIVOTED:
                _ = factor.condition
                return factor
        except Singular:
            pass
        backend = "splu"
    factor = BACKENDS[backend](A, definite=definite, order=order)
    _ = factor.condition  # which is a checked solve
    return factor


def _check_backend(name: str, *, definite: bool, real: bool) -> None:
    """Refuse a backend that does not exist, is not installed, or does not take such matrices."""
    backend = BACKENDS.get(name)
    if backend is None:
        problem = f"there is no factorisation backend {name!r}{did_you_mean(name, BACKENDS)}"
        remedy = f"Use one of {', '.join(BACKENDS)}."
    elif backend.missing():
        problem = f"the factorisation backend {name} is not installed"
        remedy = f"Install {backend.requirement}, or use splu, which is always there."
    elif not real and name != "splu":
        problem = f"the factorisation backend {name} takes real matrices only"
        remedy = "Of complex ones use splu."
    elif not (definite or backend.indefinite):
        takes = ", ".join(alternative for alternative, its in BACKENDS.items() if its.indefinite)
        problem = f"the factorisation backend {name} takes positive definite matrices only"
        remedy = f"Of indefinite ones use {takes}."
    else:
        return
    raise UsageError(problem, remedy=remedy, names=(name,))
