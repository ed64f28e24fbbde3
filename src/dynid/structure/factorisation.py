"""Direct factorisation of sparse symmetric matrices by one of several backends; all solutions are checked."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csc_array, issparse

from dynid.arrays import Array
from dynid.errors import NumericalError, Singular, UsageError
from dynid.structure.backends import BareFactors, Order, backend_for, bare

# Backward error (normwise) above which a solution is refined, and above which it is refused.
_FINE, _WORST = 1e-14, 1e-11
# Backward error, without refinement, of factors without pivoting above which the matrix is pivoted.
_UNPIVOTED = 1e-12


@dataclass(frozen=True, eq=False)
class Factorisation:
    """A symmetric matrix with its factors, whose solutions are checked.

    `name` is the backend's, `factors` are its bare factors, `size` is the 1-norm of the matrix.
    """

    name: str
    matrix: csc_array
    factors: BareFactors
    size: float

    @cached_property
    def condition(self) -> float:
        """A lower bound of the condition, sharp to a small factor: the growth of a random right-hand side."""
        b, x = self._trial
        return self.size * float(np.abs(self._improved(x, b)).max(initial=0.0) / np.abs(b).max(initial=1.0))

    @property
    def error(self) -> float:
        """Backward error of the factors themselves: of a random right-hand side, without refinement."""
        b, x = self._trial
        return self._error(x, b, b - self.matrix @ x)

    @cached_property
    def _trial(self) -> tuple[Array, Array]:
        """A random right-hand side and its solution, without refinement."""
        b = np.random.Generator(np.random.PCG64(0)).standard_normal(self.matrix.shape[0])
        return b, self._bare(b)

    @property
    def order(self) -> Order | None:
        """The order of elimination (n), or None."""
        return self.factors.order

    @property
    def memory(self) -> int:
        """Size of the factors, bytes."""
        return self.factors.memory

    @property
    def negatives(self) -> int | None:
        """Number of negative eigenvalues (Sylvester's law of inertia), or None."""
        return self.factors.negatives

    def solve(self, b: Array) -> Array:
        """Solve A x = b; the backward error is checked, and one step of refinement taken where it helps.

        Parameters
        ----------
        b
            One right-hand side (n) or several (n x columns).

        Raises
        ------
        NumericalError
            If the solution is wrong even then.
        """
        return self._improved(self._bare(b), b)

    def _improved(self, x: Array, b: Array) -> Array:
        """Return a solution that is checked, and refined where that helps."""
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
        x = np.asarray(self.factors.solve(b))
        if not np.isfinite(x).all():
            raise Singular(
                f"the matrix is singular to rounding (backend {self.name})",
                remedy="Look for DOFs without mass and stiffness, or shift the matrix.",
            )
        return x

    def _error(self, x: Array, b: Array, residual: Array) -> float:
        """Return the normwise backward error, the worst of the columns."""
        columns = (np.abs(array).max(axis=0, initial=0.0) for array in (residual, x, b))
        left, solution, right = columns
        scale = self.size * solution + right
        return float(np.max(left / np.where(scale > 0, scale, 1.0)))


def factorise(
    A: csc_array, backend: str = "auto", *, definite: bool = False, order: Order | None = None
) -> Factorisation:
    """Factorise a symmetric sparse matrix.

    A random right-hand side is solved at once, so that a backend that returns wrong solutions is refused
    before anything is built on it.

    Parameters
    ----------
    A
        The matrix (n x n), symmetric, scaled so that its entries are of like size. A complex one, symmetric
        too and not Hermitian, is taken by `splu` alone.
    backend
        One of `dynid.structure.backends.BACKENDS`, or ``auto``: that of `backend_for`. ``ldl`` leaves a
        matrix that is not definite, and not to be factorised without pivoting, to ``splu``.
    definite
        True of a positive definite matrix: some backends take no others, and others are faster then.
    order
        A good order of elimination (n), of a matrix of the same pattern (`Factorisation.order`).

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
    if backend == "auto":
        backend = "splu" if np.iscomplexobj(A) else backend_for(A.shape[0], A.nnz)
    A.sort_indices()
    if not np.isfinite(A.data).all():
        raise UsageError("a matrix to be factorised has entries that are not finite numbers")
    size = float(np.asarray(abs(A).sum(axis=0)).max(initial=0.0))
    if backend == "ldl" and not definite:
        try:
            factor = Factorisation(backend, A, bare(A, backend, definite=False, order=order), size)
            if factor.error <= _UNPIVOTED:
                _ = factor.condition
                return factor
        except Singular:
            pass
        backend = "splu"
    factor = Factorisation(backend, A, bare(A, backend, definite=definite, order=order), size)
    _ = factor.condition  # which is a checked solve
    return factor
