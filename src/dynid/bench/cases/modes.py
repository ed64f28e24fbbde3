"""The lowest ten modes of a plate."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

from dynid.bench.alternative import Alternative, Benchmark

COUNT = 10


@lru_cache(maxsize=1)
def plate(dofs: int) -> tuple[Any, Any]:
    """Return stiffness and mass of a plate of about so many DOFs."""
    from dynid.bench.meshes import plate as mesh

    return mesh(max(2, round((dofs / 3) ** 0.5) - 1))


def _house(backend: str, *, proof: bool = True) -> Callable[[int], Callable[[], Any]]:
    def prepare(dofs: int) -> Callable[[], Any]:
        from scipy.sparse import csc_array

        from dynid.structure.modes import modes

        K, M = plate(dofs)
        return lambda: modes(M, csc_array(K.shape), K, COUNT, backend=backend, proof=proof).omega ** 2

    return prepare


def _eigsh(dofs: int) -> Callable[[], Any]:
    from scipy.sparse.linalg import eigsh

    K, M = plate(dofs)
    return lambda: eigsh(K, COUNT, M, sigma=0.0)[0]


def _error(dofs: int, found: Any) -> float:
    import numpy as np

    true = reference(dofs)
    return float(np.max(np.abs(np.sort(found) - true) / true))


@lru_cache(maxsize=1)
def reference(dofs: int) -> Any:
    """Return the eigenvalues that a subspace iteration ends at, begun where `eigsh` ends."""
    import numpy as np
    from scipy.linalg import eigh
    from scipy.sparse.linalg import eigsh, splu

    K, M = plate(dofs)
    _, shapes = eigsh(K, COUNT + 4, M, sigma=0.0, tol=0)
    factor = splu(K, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}, diag_pivot_thresh=0.0)
    for _ in range(2):
        shapes = np.linalg.qr(factor.solve(M @ shapes))[0]
    small = [shapes.T @ (matrix @ shapes) for matrix in (K, M)]
    return eigh(*small, eigvals_only=True)[:COUNT]


def _default(dofs: int) -> str:
    """Return the backend that is chosen for a plate of about so many DOFs."""
    from dynid.structure.modes import solver_for

    return solver_for(plate(dofs)[0].shape[0], COUNT, None)


BENCHMARK = Benchmark(
    title="The lowest ten modes of a simply supported plate",
    size="DOFs",
    sizes=(100, 1000, 5000),
    alternatives=(
        Alternative("splu", _house("splu")),
        Alternative("splu-uncounted", _house("splu", proof=False)),
        Alternative("dense", _house("dense"), most=4000),
        Alternative("cholespy", _house("cholespy"), needs=("cholespy",)),
        Alternative("pardiso", _house("pardiso"), needs=("pypardiso",)),
        Alternative("eigsh", _eigsh, peer=True),
    ),
    error=_error,
    measure="largest relative difference of omega^2 from a subspace iteration",
    default=_default,
    full=(200, 400, 4000, 10_000, 100_000),
    remark="dense computes all modes whatever is asked for: its time is what the limit of all modes costs; "
    "splu-uncounted and the peer do not prove that no mode is missed, as splu does by one more "
    "factorisation; errors below 1e-10 are roundings, and the front among them changes from run to run",
)
