"""The lowest ten modes of a mesh, by every solver, and a reference."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

from dynid.bench.alternative import Alternative, Benchmark

COUNT = 10

#: Stiffness and mass of a mesh of about so many DOFs.
Mesh = Callable[[int], tuple[Any, Any]]


def lowest_modes(mesh: Mesh, solvers: Sequence[str], **described: Any) -> Benchmark:
    """Return the benchmark of a mesh by some of the solvers, described as in `Benchmark`."""
    every = (
        Alternative("splu", _house(mesh, "splu")),
        Alternative("splu-uncounted", _house(mesh, "splu", proof=False)),
        Alternative("dense", _house(mesh, "dense"), most=4000),
        Alternative("cholespy", _house(mesh, "cholespy"), needs=("cholespy",)),
        Alternative("pardiso", _house(mesh, "pardiso"), needs=("pypardiso",)),
        Alternative("eigsh", _eigsh(mesh), peer=True),
    )

    def error(dofs: int, found: Any) -> float:
        import numpy as np

        true = reference(mesh, dofs)
        return float(np.max(np.abs(np.sort(found) - true) / true))

    def default(dofs: int) -> str:
        from dynid.structure.modes import solver_for

        return solver_for(mesh(dofs)[0].shape[0], COUNT, None)

    return Benchmark(
        size="DOFs",
        alternatives=[each for each in every if each.name in solvers],
        error=error,
        measure="largest relative difference of omega^2 from a subspace iteration",
        default=default,
        **described,
    )


def _house(mesh: Mesh, backend: str, *, proof: bool = True) -> Callable[[int], Callable[[], Any]]:
    def prepare(dofs: int) -> Callable[[], Any]:
        from scipy.sparse import csc_array

        from dynid.structure.modes import modes

        K, M = mesh(dofs)
        return lambda: modes(M, csc_array(K.shape), K, COUNT, backend=backend, proof=proof).omega ** 2

    return prepare


def _eigsh(mesh: Mesh) -> Callable[[int], Callable[[], Any]]:
    def prepare(dofs: int) -> Callable[[], Any]:
        from scipy.sparse.linalg import eigsh

        K, M = mesh(dofs)
        return lambda: eigsh(K, COUNT, M, sigma=0.0)[0]

    return prepare


@lru_cache(maxsize=1)
def reference(mesh: Mesh, dofs: int) -> Any:
    """Return the eigenvalues that a subspace iteration ends at, begun where `eigsh` ends."""
    import numpy as np
    from scipy.linalg import eigh
    from scipy.sparse.linalg import eigsh, splu

    K, M = mesh(dofs)
    _, shapes = eigsh(K, COUNT + 4, M, sigma=0.0, tol=0)
    factor = splu(K, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}, diag_pivot_thresh=0.0)
    for _ in range(2):
        shapes = np.linalg.qr(factor.solve(M @ shapes))[0]
    small = [shapes.T @ (matrix @ shapes) for matrix in (K, M)]
    return eigh(*small, eigvals_only=True)[:COUNT]
