"""Masters and slaves: partitions of the matrices, and how the slaves follow the masters."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from dynid.errors import Singular
from dynid.structure.matrices import Array, Label, Matrix, is_sparse
from dynid.structure.model import StructuralModel
from dynid.structure.reduction.masters import Indices

# Condition of the scaled matrix beyond which fewer than two digits of a solution are left.
_WORST = 1e14
_RESIDUAL = 1e-9


class Partition(NamedTuple):
    """Masters (m) and slaves (s) of a structure, by index."""

    model: StructuralModel
    masters: Indices
    slaves: Indices

    @property
    def labels(self) -> tuple[Label, ...]:
        """Labels of the masters."""
        return tuple(self.model.dofs[k] for k in self.masters)

    def coupling(self, matrix: Matrix) -> Array:
        """Return the slaves' rows at the masters' columns (s x m), dense."""
        return _dense(matrix[:, self.masters][self.slaves])

    def inner(self, matrix: Matrix) -> Matrix:
        """Return the slaves' rows at the slaves' columns (s x s)."""
        rows: Any = matrix[:, self.slaves]
        block: Matrix = rows[self.slaves]
        return block

    def basis(self, slaves: Array, modes: Array | None = None) -> Array:
        """Return T (n x (m + k)), unit at the masters, from rows of slaves (s x m) and modes (s x k)."""
        m = len(self.masters)
        T = np.zeros((self.model.size, m + (0 if modes is None else modes.shape[1])))
        T[self.masters, np.arange(m)] = 1.0
        T[self.slaves, :m] = slaves
        if modes is not None:
            T[self.slaves, m:] = modes
        return T


def partition(model: StructuralModel, masters: Indices) -> Partition:
    """Cut a structure at its masters."""
    return Partition(model, masters, np.setdiff1d(np.arange(model.size), masters))


def solver(matrix: Matrix, what: str, remedy: str) -> Callable[[Array], Array]:
    """Factorise a symmetric matrix; return what solves with it, residuals checked.

    Parameters
    ----------
    matrix
        The matrix (s x s), dense or sparse; it is scaled to a unit diagonal.
    what
        What does not exist if it is singular, the subject of the error's sentence.
    remedy
        What to do then.

    Raises
    ------
    Singular
        If it is singular to working precision.
    """
    if not matrix.shape[0]:
        return lambda right: right
    size = np.abs(np.asarray(matrix.diagonal()))
    scale = 1 / np.sqrt(np.where(size > 0, size, 1.0))
    scaled, solve, condition = _factorised(matrix, scale)
    if not condition < _WORST:
        raise Singular(f"{what} (condition {condition:.2g})", remedy=remedy, names=("masters",))

    def checked(right: Array) -> Array:
        b = scale[:, None] * right
        x = solve(b)
        x = x + solve(b - scaled @ x)  # one refinement: the pivots of a sparse factorisation are not the best
        left = np.linalg.norm(b - scaled @ x, axis=0)
        if np.any(left > _RESIDUAL * (np.linalg.norm(x, axis=0) + np.linalg.norm(b, axis=0))):
            raise Singular(what, remedy=remedy, names=("masters",))
        return np.asarray(scale[:, None] * x)

    return checked


def _factorised(matrix: Matrix, scale: Array) -> tuple[Any, Callable[[Array], Array], float]:
    """Return the scaled matrix, what solves with it, and its condition (1-norm, estimated)."""
    if not is_sparse(matrix):
        from scipy.linalg import lapack, lu_solve

        scaled = np.asarray(matrix * scale * scale[:, None])
        if not np.isfinite(scaled).all():
            return scaled, lambda right: right, np.inf
        norm = np.abs(scaled).sum(axis=0).max()
        factor, pivots, info = lapack.dgetrf(scaled)
        reciprocal = 0.0 if info > 0 else lapack.dgecon(factor, norm)[0]
        condition = 1 / reciprocal if reciprocal else np.inf
        return scaled, lambda right: np.asarray(lu_solve((factor, pivots), right)), condition
    from scipy.sparse import diags_array
    from scipy.sparse.linalg import LinearOperator, onenormest, splu

    D = diags_array(scale)
    sparse = (D @ matrix @ D).tocsc()
    try:
        lu = splu(sparse, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    except RuntimeError:  # exactly singular
        return sparse, lambda right: right, np.inf
    inverse = LinearOperator(sparse.shape, matvec=lu.solve, rmatvec=lu.solve, dtype=np.float64)
    condition = float(onenormest(inverse) * abs(sparse).sum(axis=0).max())
    return sparse, lu.solve, condition


def _dense(matrix: Matrix) -> Array:
    return matrix if isinstance(matrix, np.ndarray) else matrix.toarray()
