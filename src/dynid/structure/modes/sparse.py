"""The lowest modes of large structures: shift-invert Lanczos, and a count that proves none is missing.

The shift is negative, so that the shifted stiffness is definite with rigid bodies too. Below a limit the
modes are counted first, by signs of pivots, and so many are computed; a given number of modes is computed
with a few more, and counted in a gap above the last.

The count uses Sylvester's law of inertia: ``K - s M = L D L^T`` has as many negative pivots as
``K phi = lambda M phi`` has eigenvalues below s, for M positive semidefinite; infinite ones (of massless
directions) do not count where K is positive there (B. N. Parlett, The Symmetric Eigenvalue Problem,
section 3.3).

The iteration is a thick-restart Lanczos method in the inner product of the mass (K. Wu, H. Simon, SIAM J.
Matrix Anal. Appl. 22 (2000) 602–616), with full reorthogonalisation, which costs little beside the solves.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csc_array

from dynid.arrays import Array
from dynid.errors import Diverged, NumericalError, Singular
from dynid.number_format import frequency_text
from dynid.structure.backends import BACKENDS, Factorisation, Order, backend_for, factorise
from dynid.structure.matrices import Matrix, combined, congruent, is_sparse
from dynid.structure.modes.dense import by_windows
from dynid.structure.modes.pencil import Pencil, StrainEnergy, absolute, blocks, times, too_many

# Residual of a converged pair, relative to its eigenvalue, whose own error is of the square of that.
_CONVERGED = 1e-10
_RESTARTS = 200
# The rounding that remains of a vector in the span of the others.
_DEPENDENT_VECTOR_TOL = 1e-11
# Steps between looks at the convergence, at least; and as a part of the modes asked for.
_LOOK, _LOOK_PART = 3, 8
# Quarters of the modes asked for that a basis holds: many modes converge in 2.1 to 2.2 times as many steps.
_WIDTH_PART = 9


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
    basis = _Basis(solve, M, held + max(_WIDTH_PART * count // 4, count + 30), rng)
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
    """`size` mass-orthonormal vectors V with ``A^-1 M V = V T + coupling v e^T``; v stands behind them.

    Of the products with M, which orthogonality needs, only that of v is kept: V is most of the memory.
    """

    def __init__(
        self, solve: Callable[[Array], Array], M: csc_array, width: int, rng: np.random.Generator
    ) -> None:
        n = M.shape[0]
        self.solve, self.M, self.rng = solve, M, rng
        self.width = min(n, width)
        # Zeros, not what memory held: vectorised products may read it and raise for its bits.
        self.V = np.zeros((n, self.width + 1), order="F")
        self.p = np.zeros(n)  # M v
        self.T = np.zeros((self.width, self.width))
        self.size, self.coupling = 0, 0.0
        self.held = 0  # vectors that T couples with the one behind

    def hold(self, theta: Array, X: Array) -> None:
        """Start from eigenpairs."""
        self.size = len(theta)
        self.V[:, : self.size] = X
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
        w = self.solve(self.p)
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
        rest = self.coupling * S[-1:] / theta if self.coupling else S[:0]
        return theta, self.V[:, : self.size + len(rest)] @ np.concatenate([S, rest])

    def restart(self, held: int) -> None:
        """Keep the leading Ritz vectors, and the vector behind."""
        held = min(held, self.size - 1)
        S = self.S[:, :held]
        self.V[:, :held], self.V[:, held] = self.V[:, : self.size] @ S, self.V[:, self.size].copy()
        self.T[:] = 0.0
        self.T[:held, :held] = np.diag(self.theta[:held])
        self.size = self.held = held

    def _project_out(self, w: Array, recent: int, count: int) -> Array:
        """Make w orthogonal to the first `count` vectors, in place; return its components.

        It is done twice, at first for those from `recent` on, which are all that it has large components of.
        """
        components = np.zeros(count)
        for first in (recent, 0):
            coefficients = self.V[:, first:count].T @ (self.M @ w)
            w -= self.V[:, first:count] @ coefficients
            components[first:] += coefficients
        return components

    def _put(self, w: Array, negligible: float) -> float:
        """Put w behind the others, normed; return its norm, 0 if it is negligible."""
        p = self.M @ w
        length = _norm(w, p)
        if length <= negligible:
            return 0.0
        self.V[:, self.size], self.p = w / length, p / length
        return length


def _norm(w: Array, p: Array) -> float:
    return float(np.sqrt(max(float(w @ p), 0.0)))


_SHIFT_ATTEMPTS = 6
# Modes computed above those asked for, to find a gap; and the relative gap wide enough to count in.
_SPARE, _GAP = 1, 1e-6
# Condition up to which rounding moves no eigenvalue across a gap, so that the stiffness needs no shift.
_MAX_CONDITION = _GAP / (4 * float(np.finfo(float).eps))
# A body has six rigid motions at most: one of seven pairs is elastic, and gives the distance of the others.
_RIGID_BODY_MODES = 6
# Relative distance of a limit to a mode at which rounding decides on which side of it the mode lies.
_HIT = 1e-8
# Shifts tried, relative to the pencil's: the first that leaves the stiffness definite and well enough posed.
_SHIFTS = (1.0, 1e3, 1e6)
# How much larger a shift is tried where pairs are short.
_RAISED = 1e4
# Residuals of pairs, relative to their sizes, beyond which they are improved, and how often at most.
_FINE, _POLISHES = 1e-10, 3
# Backward error, without refinement, of factors whose signs of pivots are those of the eigenvalues.
_SIGN_BACKWARD_ERROR = 1e-12
_NUDGES = (0.0, 1e-10, 1e-9, 1e-8)
# Size up to which a sparse matrix without conclusive pivots is counted by dense ones.
_DENSE = 3000


@dataclass(eq=False)
class SparseSpectrum:
    """The lowest eigenpairs of a sparse pencil, ascending; more are added beside those found.

    `square` (pairs) are eigenvalues, `shapes` (n x pairs) scaled eigenvectors of unit modal mass.
    """

    pencil: Pencil
    backend: str
    seed: int = 0

    def __post_init__(self) -> None:
        self.K, self.M = csc_array(self.pencil.K), csc_array(self.pencil.M)
        self.square, self.shapes = np.zeros(0), np.zeros((self.pencil.size, 0))
        self.exhausted = False
        mass = self.M.diagonal()
        self._ratios = (self.K.diagonal() / np.where(mass > 0, mass, 1.0))[mass > 0]
        self._rng = np.random.Generator(np.random.PCG64(self.seed))
        self._solve: Callable[[Array], Array] | None = None  # with the shifted stiffness
        self._order: Order | None = None  # of elimination, once a factorisation has found it
        self._shift = self._first_shift = self.pencil.shift

    def start_from(self, factor: Factorisation, scale: Array, condition: float) -> None:
        """Use the factors of the stiffness without a shift, if it is definite and well enough conditioned.

        `scale` (n): of its rows and columns; `condition`: of the stiffness so scaled.
        """
        if factor.name == self.backend and factor.negatives == 0 and condition < _MAX_CONDITION:
            ratio = scale / self.pencil.scale
            self._solve = lambda force: ratio * factor.solve(ratio * force)
            self._order, self._shift = factor.order, 0.0

    def lowest(self, count: int, *, proof: bool) -> tuple[Array, Array, float]:
        """Return the lowest pairs, and the value below which a count proved that none is missing (or 0).

        There may be some more than asked for.

        Raises UsageError if there are not so many finite ones, and NumericalError if modes stay missing, or
        cannot be counted.
        """
        self._extend(count + _SPARE)
        if len(self.square) <= _RIGID_BODY_MODES and self.square.max(initial=0.0) < self._shift:
            self._extend(_RIGID_BODY_MODES + _SPARE)
        value = self._proved(count) if proof else 0.0
        if len(self.square) < count:
            raise too_many(count, len(self.square))
        self._polish()
        return self.square, self.shapes, value

    def below(self, limit: float) -> tuple[Array, Array, float]:
        """Return all pairs below a limit, and the limit, nudged if it hits an eigenvalue.

        Raises NumericalError if modes stay missing, or cannot be counted.
        """
        self._first_shift = min(limit, self.pencil.shift)  # from far below, all of them would look alike
        count, limit = self._count(limit)
        for _ in range(_SHIFT_ATTEMPTS):
            number = int(np.count_nonzero(self.square < limit))
            if np.any(np.abs(self.square - limit) <= _HIT * limit):  # copies may lie on either side
                count, limit = self._count(limit * (1 + 10 * _HIT))
            elif number == count:
                self._polish()
                return self.square[:count], self.shapes[:, :count], limit
            elif number > count:
                break
            else:
                self._extend(len(self.square) + count - number)
        raise _stay_missing(self.backend)

    def _extend(self, count: int) -> None:
        """Compute at least so many pairs, as far as there are so many (Rayleigh–Ritz at the end).

        Beside a DOF that is nearly free all others are rounding of the inverse: where pairs are short or do
        not converge, they are looked for with a larger shift, beside those found.
        """
        from scipy.linalg import eigh

        while True:
            if self._solve is None:
                factor, self._shift = self._shifted()
                self._solve, self._order = factor.solve, factor.order
                del factor
            start_pairs = (1 / (self.square + self._shift), self.shapes) if len(self.square) else None
            try:
                theta, shapes = largest(self._solve, self.M, count, self._rng, start_pairs)
            except Diverged:
                if self._raised():
                    continue
                raise
            self.exhausted = len(theta) < count
            if len(theta):
                stiffness, mass = congruent(shapes, self.K), congruent(shapes, self.M)
                self.square, mixed = eigh(stiffness, mass)
                self.shapes = shapes @ mixed
            if len(theta) >= min(count, len(self._ratios)) or not self._raised():
                return

    def _polish(self) -> None:
        """Improve pairs with large residuals: by the inverse about the highest, and energies summed exactly.

        Beside softer ones a pair is as wrong as their eigenvalues are lower.
        """
        if not len(self.square) or self._residual() <= _FINE:
            return
        factor = factorise(self.K + float(self.square.max()) * self.M, self.backend, definite=True)
        strain = StrainEnergy(self.K)
        for _ in range(_POLISHES):
            X = factor.solve(np.asarray(self.M @ self.shapes))
            X = X / np.sqrt(np.einsum("ij,ij->j", X, times(self.M, X)))
            mass = X.T @ times(self.M, X)
            self.square, mixed = by_windows(strain.gram(X, X), (mass + mass.T) / 2)
            order = np.argsort(self.square, kind="stable")
            self.square, self.shapes = self.square[order], X @ mixed[:, order]
            if self._residual() <= _FINE:
                break

    def _residual(self) -> float:
        """Return the largest residual of the pairs, relative to their sizes."""
        worst, stiffness, mass = 0.0, absolute(self.K), absolute(self.M)
        for block in blocks(len(self.square)):
            square, shapes = self.square[block], self.shapes[:, block]
            sizes = np.linalg.norm(
                times(stiffness, np.abs(shapes)) + np.abs(square) * times(mass, np.abs(shapes)), axis=0
            )
            wrong = times(self.K, shapes) - square * times(self.M, shapes)
            residuals = np.linalg.norm(wrong, axis=0) / np.where(sizes > 0, sizes, 1.0)
            worst = max(worst, float(residuals.max()))
        return worst

    def _raised(self) -> bool:
        """Raise the shift; False if it is as high as the fastest DOF already."""
        higher = _RAISED * self._first_shift
        if not len(self._ratios) or higher > self._ratios.max():
            return False
        self._solve, self._first_shift = None, higher
        return True

    def _shifted(self) -> tuple[Factorisation, float]:
        """Factorise the stiffness, shifted by a little mass."""
        for factor in _SHIFTS:
            shift = factor * self._first_shift
            try:
                return factorise(self.K + shift * self.M, self.backend, definite=True), shift
            except Singular:
                continue
        raise Singular(
            "the stiffness matrix is indefinite, or a motion has neither inertia nor stiffness",
            remedy="Check signs and units of the stiffness; give massless DOFs mass, or join them.",
        )

    def _proved(self, count: int) -> float:
        """Complete so many pairs; return the value, in a gap above them, below which none is missing."""
        for _ in range(_SHIFT_ATTEMPTS):
            tail = self.square[max(min(count, len(self.square)) - 1, 0) :]
            wide = np.diff(tail) > _GAP * (np.abs(tail[1:]) + 1e3 * self._shift)
            if wide.any():
                first = int(np.argmax(wide))
                gap = float(tail[first : first + 2].mean())
            elif self.exhausted:
                gap = 4 * (float(np.abs(self.square).max(initial=0.0)) + self._shift)
            else:  # no gap so far
                self._extend(2 * len(self.square))
                continue
            counted, value = self._count(gap)
            missing = counted - int(np.count_nonzero(self.square < value))
            if missing == 0:
                return value
            if missing < 0:
                break
            self._extend(len(self.square) + missing)
        raise _stay_missing(self.backend)

    def _count(self, value: float) -> tuple[int, float]:
        self._solve = None  # two factorisations at a time would double the memory
        backend = self.backend
        if not BACKENDS[backend].indefinite:
            backend = backend_for(self.pencil.size, self.K.nnz)
        return eigenvalues_below(self.K, self.M, value, backend, self._order)


def _stay_missing(backend: str) -> NumericalError:
    return NumericalError(
        f"the modes computed and the modes counted disagree (factorisation backend {backend})",
        remedy="Use another backend, or ask for another number of modes.",
    )


def negative_eigenvalues(A: Matrix, backend: str = "splu", order: Order | None = None) -> int:
    """Return the number of negative eigenvalues of a symmetric matrix.

    `A`: the matrix (n x n), dense (Bunch–Kaufman pivots) or sparse (the backend's pivots); `backend`: the
    factorisation backend of sparse matrices, one that takes indefinite ones; `order`: a good order of
    elimination (n) where one is known. Raises Singular if a pivot is zero to rounding, and NumericalError if
    the sparse pivots are not conclusive and the matrix is too large for dense ones.
    """
    if not is_sparse(A):
        return _negatives_dense(np.asarray(A))
    pivots_alike = backend in ("ldl", "splu")
    for diagonal in (False, True) if pivots_alike else (False,):
        try:
            factor = factorise(A, "splu" if diagonal else backend, definite=diagonal, order=order)
        except NumericalError:
            if not diagonal:
                raise
            break  # SuperLU's pivots on the diagonal at any price: the price was too high
        if factor.error <= _SIGN_BACKWARD_ERROR and (negatives := factor.negatives) is not None:
            return negatives
        del factor  # before the next one is made
    if A.shape[0] > _DENSE:
        raise NumericalError(
            f"the inertia count of the backend {backend} needs pivots off the diagonal",
            remedy="Count at another value, or use the backend pardiso.",
        )
    return _negatives_dense(A.toarray())


def _negatives_dense(A: Array) -> int:
    from scipy.linalg import ldl

    D = ldl(A, lower=True)[1]
    # D is block diagonal; the 2x2 blocks of Bunch–Kaufman have one eigenvalue of either sign.
    twos = np.flatnonzero(np.diag(D, -1))
    single = np.ones(len(D), dtype=bool)
    single[twos] = single[twos + 1] = False
    pivots = np.diag(D)[single]
    if np.any(np.abs(pivots) <= np.finfo(float).eps * np.abs(A).max(initial=0.0)):
        raise Singular("the matrix is singular to rounding: its inertia cannot be told")
    return int(np.count_nonzero(pivots < 0)) + len(twos)


def eigenvalues_below(
    K: Matrix, M: Matrix, value: float, backend: str = "splu", order: Order | None = None
) -> tuple[int, float]:
    """Count the eigenvalues of ``K phi = lambda M phi`` below a value.

    `K`, `M`: stiffness and mass (n x n), symmetric, scaled to entries of like size; M positive semidefinite;
    `backend`: as of `negative_eigenvalues`; `order`: a good order of elimination (n) where one is known.
    Raises NumericalError if no pivots are conclusive.

    It returns the count, and the value it is for: up to 1e-8 higher where the one given hits an eigenvalue or
    its pivots are not conclusive.
    """
    for nudge in _NUDGES:
        nudged = value + nudge * abs(value)
        try:
            return negative_eigenvalues(combined(1.0, K, -nudged, M), backend, order), nudged
        except NumericalError:
            continue
    raise NumericalError(
        f"the modes below {frequency_text(np.sqrt(max(value, 0.0)), 6)} cannot be counted",
        remedy="Ask for another number of modes, or another limit.",
    )
