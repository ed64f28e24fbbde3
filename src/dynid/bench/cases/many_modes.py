"""More and more modes of one plate: by dense matrices, which give all of them, or by sparse Lanczos."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

from dynid.bench.alternative import Alternative, Benchmark
from dynid.bench.cases.modes import plate

#: DOFs, about.
_DOFS = 600


def _house(backend: str) -> Callable[[int], Callable[[], Any]]:
    def prepare(count: int) -> Callable[[], Any]:
        from scipy.sparse import csc_array

        from dynid.structure.modes import modes

        K, M = plate(_DOFS)
        return lambda: modes(M, csc_array(K.shape), K, count, backend=backend).omega ** 2

    return prepare


def _eigsh(count: int) -> Callable[[], Any]:
    from scipy.sparse.linalg import eigsh

    K, M = plate(_DOFS)
    return lambda: eigsh(K, count, M, sigma=0.0)[0]


def _eigh(count: int) -> Callable[[], Any]:
    from scipy.linalg import eigh

    K, M = plate(_DOFS)
    return lambda: eigh(K.toarray(), M.toarray(), eigvals_only=True, subset_by_index=[0, count - 1])


@lru_cache(maxsize=1)
def _true() -> Any:
    """Return all eigenvalues from the inverse problem, whose largest are the lowest, by Cholesky's factor."""
    import numpy as np
    from scipy.linalg import cholesky, eigvalsh, solve_triangular

    K, M = (part.toarray() for part in plate(_DOFS))
    factor = cholesky(K, lower=True)
    half = solve_triangular(factor, solve_triangular(factor, M, lower=True).T, lower=True)
    return np.sort(1 / eigvalsh((half + half.T) / 2))


def _error(count: int, found: Any) -> float:
    import numpy as np

    true = _true()[:count]
    return float(np.max(np.abs(np.sort(found) - true) / true))


def _default(count: int) -> str:
    from dynid.structure.modes import solver_for

    return solver_for(plate(_DOFS)[0].shape[0], count, None)


BENCHMARK = Benchmark(
    title="The lowest modes, few or many, of a simply supported plate of 600 DOFs",
    size="modes",
    sizes=(20, 200),
    full=(50, 100, 150, 400),
    alternatives=(
        Alternative("splu", _house("splu")),
        Alternative("dense", _house("dense")),
        Alternative("eigsh", _eigsh, peer=True),
        Alternative("eigh", _eigh, peer=True),
    ),
    error=_error,
    measure="largest relative difference of omega^2 from those of the inverse problem",
    default=_default,
    remark="eigsh does not prove that no mode is missed; eigh has no shapes, and fails on a singular mass",
)
