"""Modes of a plate and of a solid: the lowest ten by every solver, and few to many modes of one plate.

With `--size modes=100000` the plate has 99,739 DOFs; with `--size modes-of-solids=86000` the solid has 86,490
DOFs, whose modes take minutes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

from dynid.bench.benchmark import Alternative, Benchmark

#: Approximate DOFs of the plate with many modes.
_DOFS = 600
COUNT = 10
#: Stiffness and mass of a mesh, by its approximate number of DOFs.
Mesh = Callable[[int], tuple[Any, Any]]


#: K, M and the number of modes, by the size.
Task = Callable[[int], tuple[Any, Any, int]]


def _lowest(task: Task, backend: str, *, proof: bool = True) -> Callable[[int], Callable[[], Any]]:
    """Return omega^2 of the lowest modes by a solver of dynid."""

    def prepare(size: int) -> Callable[[], Any]:
        from scipy.sparse import csc_array

        from dynid.structure.modes import modes

        K, M, count = task(size)
        return lambda: modes(M, csc_array(K.shape), K, count, backend=backend, proof=proof).omega ** 2

    return prepare


def _eigsh(task: Task) -> Callable[[int], Callable[[], Any]]:
    def prepare(size: int) -> Callable[[], Any]:
        from scipy.sparse.linalg import eigsh

        K, M, count = task(size)
        return lambda: eigsh(K, count, M, sigma=0.0)[0]

    return prepare


def _error(omega: Any, true: Any) -> float:
    import numpy as np

    return float(np.max(np.abs(np.sort(omega) - true) / true))


def _default(task: Task) -> Callable[[int], str]:
    """Return the function of a size that names the solver chosen by default."""

    def default(size: int) -> str:
        from dynid.structure.modes import solver_for

        K, _, count = task(size)
        return solver_for(K.shape[0], count, None, K.nnz)

    return default


def lowest_modes(mesh: Mesh, solvers: Sequence[str], **described: Any) -> Benchmark:
    """Return the benchmark of a mesh with some of the solvers, described as in `Benchmark`."""

    def task(dofs: int) -> tuple[Any, Any, int]:
        return *mesh(dofs), COUNT

    candidates = (
        Alternative("ldl", _lowest(task, "ldl")),
        Alternative("ldl-uncounted", _lowest(task, "ldl", proof=False)),
        Alternative("splu", _lowest(task, "splu")),
        Alternative("dense", _lowest(task, "dense"), max_size=4000),
        Alternative("cholespy", _lowest(task, "cholespy"), needs=("cholespy",)),
        Alternative("pardiso", _lowest(task, "pardiso"), needs=("pypardiso",)),
        Alternative("eigsh", _eigsh(task), peer=True),
    )

    return Benchmark(
        size="DOFs",
        alternatives=[alternative for alternative in candidates if alternative.name in solvers],
        error=lambda dofs, omega: _error(omega, reference(mesh, dofs)),
        measure="largest relative difference of omega^2 from a subspace iteration",
        default=_default(task),
        **described,
    )


@lru_cache(maxsize=1)
def reference(mesh: Mesh, dofs: int) -> Any:
    """Return the eigenvalues of a subspace iteration started from those of `eigsh`."""
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


def _eigh(count: int) -> Callable[[], Any]:
    from scipy.linalg import eigh

    K, M = plate(_DOFS)
    return lambda: eigh(K.toarray(), M.toarray(), eigvals_only=True, subset_by_index=[0, count - 1])


@lru_cache(maxsize=1)
def _inverse_problem() -> Any:
    """Return all eigenvalues by the inverse problem, whose largest ones are accurate (Cholesky)."""
    import numpy as np
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
        Alternative("ldl", _lowest(_task_on_plate, "ldl")),
        Alternative("dense", _lowest(_task_on_plate, "dense")),
        Alternative("eigsh", _eigsh(_task_on_plate), peer=True),
        Alternative("eigh", _eigh, peer=True),
    ),
    error=lambda count, omega: _error(omega, _inverse_problem()[:count]),
    measure="largest relative difference of omega^2 from those of the inverse problem",
    default=_default(_task_on_plate),
    remark="eigsh does not prove that no mode is missed; eigh has no shapes, and fails on a singular mass",
)
