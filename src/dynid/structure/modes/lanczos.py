"""Thick-restart Lanczos iteration in the inner product of the mass.

K. Wu, H. Simon, Thick-restart Lanczos method for large symmetric eigenvalue problems, SIAM J. Matrix Anal.
Appl. 22 (2000); with full reorthogonalisation, which costs little beside the solves.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.sparse import csc_array

from dynid.arrays import Array
from dynid.errors import Diverged

# Residual of a converged pair, relative to its eigenvalue, whose own error is of the square of that.
_CONVERGED = 1e-10
_RESTARTS = 200
# The rounding that remains of a vector in the span of the others.
_DEPENDENT_VECTOR_TOL = 1e-11
# Steps between looks at the convergence, at least; and as a part of the modes asked for.
_LOOK, _LOOK_PART = 3, 8


def largest(
    solve: Callable[[Array], Array],
    M: csc_array,
    count: int,
    rng: np.random.Generator,
    start_pairs: tuple[Array, Array] | None = None,
) -> tuple[Array, Array]:
    """Return eigenpairs of ``A^-1 M x = theta x``, those with the largest absolute theta.

    `solve`: solves with A (n x n, symmetric); `M`: mass, positive semidefinite; its null space, of infinite
    modes, is never entered; `count`: how many are wanted, known ones included; `rng`: where start vectors are
    drawn from; `start_pairs`: eigenpairs already found, of unit modal mass; the iteration goes on beside
    them. Raises Diverged if they do not converge.

    It returns eigenvalues and eigenvectors (n x pairs) of unit modal mass; fewer than `count` only if there
    are no more. Of a multiple eigenvalue copies may be missing.
    """
    held = 0 if start_pairs is None else len(start_pairs[0])
    basis = _Basis(solve, M, held + max(2 * count, count + 30), rng)
    if start_pairs is not None:
        basis.hold(*start_pairs)
    alive = basis.begin()
    look = max(_LOOK, count // _LOOK_PART)
    for _ in range(_RESTARTS):
        while alive and basis.size < basis.width:
            alive = basis.extend()
            if basis.size >= count + 2 and basis.size % look == 0 and basis.converged() >= count:
                return basis.pairs(count)
        if not alive:  # the whole space is spanned: all pairs are exact
            return basis.pairs(min(count, basis.size))
        if basis.converged() >= count:
            return basis.pairs(count)
        basis.restart(count + (basis.width - count) // 2)
    raise Diverged(
        f"{count} modes did not converge in {_RESTARTS} restarts of the Lanczos iteration",
        remedy="Ask for fewer modes, or use the dense method.",
    )


class _Basis:
    """`size` mass-orthonormal vectors V with ``A^-1 M V = V T + coupling v e^T``; v stands behind them."""

    def __init__(
        self, solve: Callable[[Array], Array], M: csc_array, width: int, rng: np.random.Generator
    ) -> None:
        n = M.shape[0]
        self.solve, self.M, self.rng = solve, M, rng
        self.width = min(n, width)
        # Zeros, not what memory held: vectorised products may read it and raise for its bits.
        self.V = np.zeros((n, self.width + 1), order="F")
        self.P = np.zeros(self.V.shape, order="F")  # M V
        self.T = np.zeros((self.width, self.width))
        self.size, self.coupling = 0, 0.0
        self.held = 0  # vectors that T couples with the one behind

    def hold(self, theta: Array, X: Array) -> None:
        """Start from eigenpairs."""
        self.size = len(theta)
        self.V[:, : self.size], self.P[:, : self.size] = X, self.M @ X
        self.T[: self.size, : self.size] = np.diag(theta)

    def begin(self) -> bool:
        """Put a random vector behind the others; False if nothing is left of it."""
        w = self.solve(self.M @ self.rng.standard_normal(len(self.V)))
        self.coupling, self.held = 0.0, self.size
        before = _norm(w, self.M @ w)
        self._project_out(w, 0, self.size)
        return self._put(w, _DEPENDENT_VECTOR_TOL * before) > 0

    def extend(self) -> bool:
        """Take the vector behind the others in; False if that exhausts the space."""
        w = self.solve(self.P[:, self.size])
        recent = 0 if self.size == self.held else self.size - 1
        column = self._project_out(w, recent, self.size + 1)
        self.T[: self.size + 1, self.size] = self.T[self.size, : self.size + 1] = column
        self.size += 1
        self.coupling = self._put(w, _DEPENDENT_VECTOR_TOL * float(np.linalg.norm(column)))
        return self.coupling > 0 or self.begin()

    def converged(self) -> int:
        """Return the number of leading pairs that have converged."""
        self.theta, self.S = np.linalg.eigh(self.T[: self.size, : self.size])
        order = np.argsort(-np.abs(self.theta), kind="stable")
        self.theta, self.S = self.theta[order], self.S[:, order]
        settled = np.abs(self.coupling * self.S[-1]) <= _CONVERGED * np.abs(self.theta)
        return int(np.argmin([*settled, False]))

    def pairs(self, count: int) -> tuple[Array, Array]:
        """Return the leading pairs, the operator applied once more, which the recurrence gives for nothing.

        It damps the remainder of high frequencies, where a residual of the stiffness is large.
        """
        self.converged()
        theta, S = self.theta[:count], self.S[:, :count]
        rest = self.V[:, self.size, None] * (self.coupling * S[-1] / theta)
        return theta, self.V[:, : self.size] @ S + (rest if self.coupling else 0.0)

    def restart(self, held: int) -> None:
        """Keep the leading Ritz vectors, and the vector behind."""
        held = min(held, self.size - 1)
        S = self.S[:, :held]
        for vectors in (self.V, self.P):
            vectors[:, :held], vectors[:, held] = vectors[:, : self.size] @ S, vectors[:, self.size].copy()
        self.T[:] = 0.0
        self.T[:held, :held] = np.diag(self.theta[:held])
        self.size = self.held = held

    def _project_out(self, w: Array, recent: int, count: int) -> Array:
        """Make w orthogonal to the first `count` vectors, in place; return its components.

        It is done twice, at first for those from `recent` on, which are all that it has large components of.
        """
        components = np.zeros(count)
        for first in (recent, 0):
            coefficients = self.P[:, first:count].T @ w
            w -= self.V[:, first:count] @ coefficients
            components[first:] += coefficients
        return components

    def _put(self, w: Array, negligible: float) -> float:
        """Put w behind the others, normed; return its norm, 0 if it is negligible."""
        p = self.M @ w
        length = _norm(w, p)
        if length <= negligible:
            return 0.0
        self.V[:, self.size], self.P[:, self.size] = w / length, p / length
        return length


def _norm(w: Array, p: Array) -> float:
    return float(np.sqrt(max(float(w @ p), 0.0)))
