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


def solver(matrix: Matrix, what: str, remedy: str, size: Array | None = None) -> Callable[[Array], Array]:
    """Factorise a symmetric matrix; return what solves with it, every solution checked.

    Parameters
    ----------
    matrix
        The matrix (s x s), dense or sparse; it is scaled to a unit diagonal, or by `size`.
    what
        What is so if it is singular, as a clause.
    remedy
        What to do then.
    size
        The sizes of its diagonal entries (s), where these are differences.

    Raises
    ------
    Singular
        If it is singular to working precision.
    """
    if not matrix.shape[0]:
        return lambda right: right
    size = np.abs(np.asarray(matrix.diagonal())) if size is None else size
    scale = 1 / np.sqrt(np.where(size > 0, size, 1.0))
    factorised = _sparse if is_sparse(matrix) else _dense_factors
    try:
        solve, condition = factorised(matrix, scale)
    except Singular:
        condition = np.inf
    if not condition < _WORST:
        raise Singular(f"{what} (condition {condition:.2g})", remedy=remedy, names=("masters",))
    return lambda right: np.asarray(scale[:, None] * solve(scale[:, None] * right))


def _dense_factors(matrix: Any, scale: Array) -> tuple[Callable[[Array], Array], float]:
    """Return what solves with the scaled matrix, and its condition (1-norm, estimated).

    A norm below 1 is what differences have left of entries of size 1: it counts as 1.
    """
    from scipy.linalg import lapack, lu_solve

    scaled = matrix * scale * scale[:, None]
    factor, pivots, info = lapack.dgetrf(scaled)
    size = np.abs(scaled).sum(axis=0).max()
    reciprocal = lapack.dgecon(factor, size)[0] * min(size, 1.0) if info == 0 else 0.0

    def solve(b: Array) -> Array:
        x = lu_solve((factor, pivots), b)
        return np.asarray(x + lu_solve((factor, pivots), b - scaled @ x))

    return solve, 1 / reciprocal if reciprocal else np.inf


def _sparse(matrix: Any, scale: Array) -> tuple[Callable[[Array], Array], float]:
    from scipy.sparse import csc_array, diags_array
    from scipy.sparse.linalg import LinearOperator, onenormest

    from dynid.structure.factorisation import factorise

    D = diags_array(scale)
    factor = factorise(csc_array(D @ matrix @ D))
    inverse = LinearOperator(matrix.shape, matvec=factor.solve, rmatvec=factor.solve, dtype=np.float64)
    return factor.solve, float(onenormest(inverse)) * max(factor.size, 1.0)


def _dense(matrix: Matrix) -> Array:
    return matrix if isinstance(matrix, np.ndarray) else matrix.toarray()
