"""Certified eigenvalues of a sparse pencil, refined by dense or by sparse factors."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from dynid.bench.benchmark import Alternative, Benchmark
from dynid.defaults import SPARSE_REFINEMENT


def _pencil(size: int) -> tuple[Any, Any]:
    """Return F and G of sF - G of a chain of unit masses and springs between two walls, with size states."""
    from scipy.sparse import block_array, diags_array, eye_array

    masses = size // 2
    K = diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(masses, masses))
    blocks: Any = [[None, eye_array(masses)], [-K, None]]
    return eye_array(size).tocsr(), block_array(blocks).tocsr()


def _house(*, sparse: bool) -> Callable[[int], Callable[[], Any]]:
    def prepare(size: int) -> Callable[[], Any]:
        from dynid.lti.pencil.eigenvalues import finite_eigenvalues

        F, G = _pencil(size)
        return lambda: finite_eigenvalues(F, G, sparse=sparse).values

    return prepare


def _eigvals(size: int) -> Callable[[], Any]:
    import numpy as np

    A = _pencil(size)[1].toarray()
    return lambda: np.linalg.eigvals(A)


def _error(size: int, found: Any) -> float:
    import numpy as np

    masses = size // 2
    omega = 2 * np.sin(np.pi * np.arange(1, masses + 1) / (2 * (masses + 1)))
    true = 1j * np.concatenate([-omega[::-1], omega])
    return float(np.max(np.abs(found[np.argsort(found.imag)] - true) / np.abs(true)))


BENCHMARK = Benchmark(
    title="Natural frequencies of a chain between two walls, each with a bound on its error",
    size="states",
    sizes=(80, 160),
    full=(40, 120, 240, 480),
    alternatives=(
        Alternative("dense", _house(sparse=False)),
        Alternative("sparse", _house(sparse=True)),
        Alternative("eigvals", _eigvals, peer=True),
    ),
    error=_error,
    measure="largest relative error of an eigenvalue",
    default=lambda size: "sparse" if size >= SPARSE_REFINEMENT.value else "dense",
    remark="eigvals bounds no error",
)
