"""Modes of a plate and of a solid: the lowest ten by every solver, and few to many modes of one plate.

With `--size modes=100000` the plate has 99,739 DOFs; with `--size modes-of-solids=86000` the solid has 86,490
DOFs, whose modes take minutes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache, partial
from typing import Any

import numpy as np

from dynid.bench.benchmark import Alternative, Benchmark

#: Approximate DOFs of the plate with many modes.
_DOFS = 600
_MODE_COUNT = 10
#: Stiffness and mass of a mesh, by its approximate number of DOFs.
Mesh = Callable[[int], tuple[Any, Any]]


def _lowest(task: tuple[Any, Any, int], backend: str, *, proof: bool = True) -> Any:
    """Return omega^2 of the lowest modes by a solver of dynid."""
    from scipy.sparse import csc_array

    from dynid.structure.modes import modes

    K, M, count = task
    return modes(M, csc_array(K.shape), K, count, backend=backend, proof=proof).omega ** 2


def _eigsh(task: tuple[Any, Any, int]) -> Any:
    from scipy.sparse.linalg import eigsh

    K, M, count = task
    return eigsh(K, count, M, sigma=0.0)[0]


def _error(omega: Any, true: Any) -> float:
    return float(np.max(np.abs(np.sort(omega) - true) / true))


def _default(task: tuple[Any, Any, int]) -> str:
    from dynid.structure.modes import solver_for

    K, _, count = task
    return solver_for(K.shape[0], count, None, K.nnz)


def lowest_modes(mesh: Mesh, solvers: Sequence[str], **described: Any) -> Benchmark:
    """Return the benchmark of a mesh with some of the solvers, described as in `Benchmark`."""

    def task(dofs: int) -> tuple[Any, Any, int]:
        return *mesh(dofs), _MODE_COUNT

    candidates = (
        *(Alternative(name, partial(_lowest, backend=name)) for name in ("ldl", "splu")),
        Alternative("ldl-uncounted", partial(_lowest, backend="ldl", proof=False)),
        Alternative("dense", partial(_lowest, backend="dense"), max_size=4000),
        Alternative("cholespy", partial(_lowest, backend="cholespy"), needs=("cholespy",)),
        Alternative("pardiso", partial(_lowest, backend="pardiso"), needs=("pypardiso",)),
        Alternative("eigsh", _eigsh, peer=True),
    )

    return Benchmark(
        size="DOFs",
        alternatives=[alternative for alternative in candidates if alternative.name in solvers],
        error=lambda dofs, omega: _error(omega, reference(mesh, dofs)),
        problem=task,
        measure="largest relative difference of omega^2 from a subspace iteration",
        default=lambda dofs: _default(task(dofs)),
        **described,
    )


@lru_cache(maxsize=1)
def reference(mesh: Mesh, dofs: int) -> Any:
    """Return the eigenvalues of a subspace iteration started from those of `eigsh`."""
    from scipy.linalg import eigh
    from scipy.sparse.linalg import eigsh, splu

    K, M = mesh(dofs)
    _, shapes = eigsh(K, _MODE_COUNT + 4, M, sigma=0.0, tol=0)
    factor = splu(K, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}, diag_pivot_thresh=0.0)
    for _ in range(2):
        shapes = np.linalg.qr(factor.solve(M @ shapes))[0]
    small = [shapes.T @ (matrix @ shapes) for matrix in (K, M)]
    return eigh(*small, eigvals_only=True)[:_MODE_COUNT]


@lru_cache(maxsize=1)
def plate(dofs: int) -> tuple[Any, Any]:
    """Return stiffness and mass of a plate with about so many DOFs."""
    from dynid.bench.meshes import plate as mesh

    return mesh(max(2, round((dofs / 3) ** 0.5) - 1))


@lru_cache(maxsize=1)
def solid(dofs: int) -> tuple[Any, Any]:
    """Return stiffness and mass of a block, clamped on one face, with about so many DOFs."""
    from dynid.bench.meshes import solid as mesh

    return mesh(max(2, round((dofs / 3) ** (1 / 3) - 2 / 3)))


PLATE = lowest_modes(
    plate,
    ("ldl", "ldl-uncounted", "splu", "dense", "cholespy", "pardiso", "eigsh"),
    title="The lowest ten modes of a simply supported plate",
    sizes=(100, 1000, 5000),
    full=(200, 400, 4000, 10_000, 100_000),
    remark="dense computes all modes, whatever their requested number; ldl-uncounted and the peer do not "
    "prove that no mode is missed, as ldl and splu do by one more factorisation; errors below 1e-10 are "
    "round-off, and the front among them changes from run to run",
)
SOLID = lowest_modes(
    solid,
    ("ldl", "ldl-uncounted", "splu", "pardiso", "eigsh"),
    title="The lowest ten modes of an elastic block, clamped on one face",
    sizes=(300,),
    full=(2000, 8000),
    remark="ldl-uncounted and the peer do not prove that no mode is missed",
)


def _task_on_plate(count: int) -> tuple[Any, Any, int]:
    return *plate(_DOFS), count


def _eigh(task: tuple[Any, Any, int]) -> Any:
    from scipy.linalg import eigh

    K, M, count = task
    return eigh(K.toarray(), M.toarray(), eigvals_only=True, subset_by_index=[0, count - 1])


@lru_cache(maxsize=1)
def _inverse_problem() -> Any:
    """Return all eigenvalues by the inverse problem, whose largest ones are accurate (Cholesky)."""
    from scipy.linalg import cholesky, eigvalsh, solve_triangular

    K, M = (matrix.toarray() for matrix in plate(_DOFS))
    factor = cholesky(K, lower=True)
    half = solve_triangular(factor, solve_triangular(factor, M, lower=True).T, lower=True)
    return np.sort(1 / eigvalsh((half + half.T) / 2))


MANY = Benchmark(
    title="The lowest modes, few or many, of a simply supported plate of 600 DOFs",
    size="modes",
    sizes=(20, 200),
    full=(50, 100, 150, 400),
    alternatives=(
        *(Alternative(name, partial(_lowest, backend=name)) for name in ("ldl", "dense")),
        Alternative("eigsh", _eigsh, peer=True),
        Alternative("eigh", _eigh, peer=True),
    ),
    error=lambda count, omega: _error(omega, _inverse_problem()[:count]),
    problem=_task_on_plate,
    measure="largest relative difference of omega^2 from those of the inverse problem",
    default=lambda count: _default(_task_on_plate(count)),
    remark="eigsh does not prove that no mode is missed; eigh has no shapes, and fails on a singular mass",
)
