"""A factorised matrix whose every solution is checked, whatever backend made the factors."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, issparse

from dynid.errors import NumericalError, Singular, UsageError
from dynid.structure.factorisation.backends import Solver, bare

Array = NDArray[np.float64]

# Backward error, norm by norm, beyond which a solution is refined, and beyond which it is refused.
_FINE = 1e-14
_WORST = 1e-11


@dataclass(frozen=True, eq=False)
class Factor:
    """A symmetric matrix with its factors.

    `name` is the backend's; `memory` the size of the factors, bytes; `negatives` the number of negative
    pivots, which is that of the negative eigenvalues (Sylvester), or None where the factors do not tell.
    """

    name: str
    matrix: csc_array
    solver: Solver
    size: float

    @cached_property
    def condition(self) -> float:
        """A lower bound of the condition, sharp to a small factor: how a random right-hand side grows."""
        b = np.random.Generator(np.random.PCG64(0)).standard_normal(self.matrix.shape[0])
        return self.size * float(np.abs(self.solve(b)).max(initial=0.0) / np.abs(b).max(initial=1.0))

    @property
    def error(self) -> float:
        """Backward error of the factors themselves, seen on a random right-hand side without refinement."""
        b = np.random.Generator(np.random.PCG64(1)).standard_normal(self.matrix.shape[0])
        x = self._bare(b)
        return self._error(x, b, b - self.matrix @ x)

    @property
    def memory(self) -> int:
        """Size of the factors, bytes."""
        return self.solver.memory

    @property
    def negatives(self) -> int | None:
        """Number of negative eigenvalues, or None."""
        return self.solver.negatives

    def solve(self, b: Array) -> Array:
        """Solve A x = b; the backward error is checked, and one step of refinement taken where it pays.

        Parameters
        ----------
        b
            One right-hand side (n) or several (n x columns).

        Raises
        ------
        NumericalError
            If the solution is wrong even then.
        """
        x = self._bare(b)
        residual = b - self.matrix @ x
        error = self._error(x, b, residual)
        if error > _FINE:
            refined = x + self._bare(residual)
            closer = self._error(refined, b, b - self.matrix @ refined)
            if closer < error:
                x, error = refined, closer
        if error > _WORST:
            raise NumericalError(
                f"the solutions of the factorisation backend {self.name} are wrong "
                f"(relative residual {error:.1g} after a step of refinement)",
                remedy="Use another backend; if all fail, the matrix is singular to rounding.",
                names=(self.name,),
            )
        return x

    def _bare(self, b: Array) -> Array:
        x = np.asarray(self.solver.solve(b))
        if not np.isfinite(x).all():
            raise Singular(
                f"the matrix is singular to rounding (backend {self.name})",
                remedy="Look for DOFs without mass and stiffness, or shift the matrix.",
            )
        return x

    def _error(self, x: Array, b: Array, residual: Array) -> float:
        """Return the normwise backward error, the worst of the columns."""
        columns = (np.abs(part).max(axis=0, initial=0.0) for part in (residual, x, b))
        left, solution, right = columns
        scale = self.size * solution + right
        return float(np.max(left / np.where(scale > 0, scale, 1.0)))


def factorise(A: csc_array, backend: str = "splu", *, definite: bool = False) -> Factor:
    """Factorise a symmetric sparse matrix.

    A random right-hand side is solved at once, so that a backend that returns wrong solutions is refused
    before anything is built on it.

    Parameters
    ----------
    A
        The matrix (n x n), symmetric, scaled so that its entries are of like size. A complex one, symmetric
        too and not Hermitian, is taken by `splu` alone.
    backend
        One of `BACKENDS`.
    definite
        Whether the matrix is positive definite; some backends take no others, and others are faster then.

    Raises
    ------
    UsageError
        If the matrix is not sparse and square, or there is no such backend, or it is not installed.
    Singular
        If the matrix is singular, or not definite where it should be.
    NumericalError
        If the backend's solutions are wrong.
    """
    if not issparse(A) or A.shape[0] != A.shape[1]:
        raise UsageError("a matrix to be factorised must be sparse and square")
    A = csc_array(A, dtype=complex if np.iscomplexobj(A) else float)
    A.sort_indices()
    if not np.isfinite(A.data).all():
        raise UsageError("a matrix to be factorised has entries that are not finite numbers")
    size = float(np.asarray(abs(A).sum(axis=0)).max(initial=0.0))
    factor = Factor(backend, A, bare(A, backend, definite=definite), size)
    _ = factor.condition  # which is a checked solve
    return factor
