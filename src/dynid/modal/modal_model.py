"""Maximum likelihood of poles, participations, shapes and residual terms of a modal model.

``H_oi = sum_r psi_or l_ir / (s - lambda_r) + conj. + sum_e c_oi,e omega^e``, e = 0, −2, 2, −4 with complex
c; with real shapes ``psi l / ((s - lambda)(s - conj lambda))``. With two powers error bars cover 70 %
instead of 95. Residual terms are projected out of the data of every pair once, shapes are solved for
(variable projection), and Gauss–Newton steps of poles and participations have exact derivatives.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array, ComplexArray
from dynid.errors import NumericalError
from dynid.modal.frf_matrix import FrfMatrix

#: Powers of the frequency of the residual terms.
RESIDUAL_POWERS = (0, -2, 2, -4)
# Decrease of chi-squared expected of a step that ends the search, a tenth of a standard error, and limits of
# steps and of their damping.
_DECREASE, MAX_STEPS, _MAX_DAMPINGS = 1e-2, 40, 12
# Damping of the first step, relative to the diagonal, and its factors.
_DAMPING, _DAMPING_FACTOR, _MIN_DAMPING = 1e-3, 10.0, 1e-12
# Steps before that are mixed into one.
_DEPTH = 5
# Reciprocal condition of a scaled normal matrix below which shapes or poles are dependent.
_DEPENDENT = 1e-14


@dataclass(frozen=True, eq=False)
class ModalFit:
    """Modes fitted to frequency responses, with the information on them."""

    poles: ComplexArray  # (m), rad/s
    participation: ComplexArray  # (references x m)
    shapes: ComplexArray  # (responses x m)
    chi2: float
    residual: ComplexArray  # weighted (L x responses x references)
    information: Array  # of poles and free participations, shapes eliminated
    gradient: Array
    free: NDArray[np.bool_]  # unknown participations (references x m)
    # Of each response with shapes of its own: a root of the shapes' covariance at fixed poles, and how shapes
    # follow from poles and participations; None of a reciprocal one, whose shapes are participations.
    shape_roots: Sequence[Array | None]
    shape_slopes: Sequence[Array | None]
    linear: int  # number of real parameters solved for: shapes and residual terms

    @property
    def parameters(self) -> int:
        """Number of real parameters."""
        return self.linear + len(self.information)

    def covariance(self) -> Array:
        """Return the covariance of poles (real parts, imaginary parts) and free participations."""
        scale = _scale(self.information)
        inverse = np.linalg.inv(self.information / np.outer(scale, scale))
        return np.asarray(inverse / np.outer(scale, scale))

    def shape_covariance(self, response: int, covariance: Array) -> Array | None:
        """Return the covariance of the shapes' parts at a response; None of a reciprocal one."""
        root, slopes = self.shape_roots[response], self.shape_slopes[response]
        if root is None or slopes is None:
            return None
        return np.asarray(root @ root.T + slopes @ covariance @ slopes.T)


class ModalModel:
    """Likelihood of a modal model of frequency responses.

    `real`: shapes are real. `reciprocal`: response and reference of each DOF that is both; its shapes are its
    participations. The data must have more lines than residual terms.
    """

    def __init__(
        self, frf: FrfMatrix, *, real: bool = False, reciprocal: Sequence[tuple[int, int]] = ()
    ) -> None:
        self.frf, self.real, self.own = frf, real, dict(reciprocal)
        _, self.responses, self.references = frf.values.shape
        omega = frf.omega
        relative = omega / np.sqrt(omega[0] * omega[-1])
        terms = np.stack([relative**power for power in RESIDUAL_POWERS], axis=1)
        self._residual_bases: dict[tuple[int, int], Array] = {}
        self._data: dict[tuple[int, int], Array] = {}
        for pair in self._pairs():
            weights = frf.weights[:, pair[0], pair[1]]
            basis, _ = np.linalg.qr(weights[:, None] * terms)  # of real and of imaginary parts
            data = _stacked(frf.weighted[:, [pair[0]], pair[1]]).reshape(2, len(omega), 1)
            self._residual_bases[pair] = basis
            self._data[pair] = (data - basis @ (basis.T @ data)).ravel()

    def _pairs(self) -> list[tuple[int, int]]:
        return [(o, i) for o in range(self.responses) for i in range(self.references)]

    def _columns(self, poles: ComplexArray) -> Array:
        """Return derivatives by the parts of residues and, for unit residues, of poles (2 L x …)."""
        s = 1j * self.frf.omega[:, None]
        a, b = 1 / (s - poles), 1 / (s - poles.conj())
        if self.real:
            square = (a * b) ** 2
            return _stacked(np.hstack([a * b, 2 * (s - poles.real) * square, -2 * poles.imag * square]))
        return _stacked(np.hstack([a + b, 1j * (a - b), a**2 + b**2, 1j * (a**2 - b**2)]))

    def _map(self, factor: ComplexArray) -> Array:
        """Return the matrix of the multiplication of residues (parts) by a factor each."""
        if self.real:
            return np.diag(factor.real)
        real, imaginary = np.diag(factor.real), np.diag(factor.imag)
        return np.block([[real, -imaginary], [imaginary, real]])

    def _pole_map(self, residues: ComplexArray) -> Array:
        """Return the matrix from changes of poles (parts) to those of the responses of residues."""
        return np.diag(np.tile(residues.real, 2)) if self.real else self._map(residues)

    def _join(self, parts: Array) -> ComplexArray:
        """Return complex numbers from their parts."""
        m = len(parts) // (1 if self.real else 2)
        return parts.astype(complex) if self.real else np.asarray(parts[:m] + 1j * parts[m:])

    def residues(self, poles: ComplexArray) -> ComplexArray:
        """Return the residues (responses x references x m) of linear least squares, every pair by itself."""
        columns = self._columns(poles)[:, : len(poles) * (1 if self.real else 2)]
        residues = np.zeros((self.responses, self.references, len(poles)), dtype=complex)
        for pair in self._pairs():
            X = _Columns(columns, *self._weighting(pair)).projected
            solution = np.asarray(np.linalg.lstsq(X, self._data[pair], rcond=None)[0], dtype=np.float64)
            residues[pair] = self._join(solution)
        return residues

    def _weighting(self, pair: tuple[int, int]) -> tuple[Array, Array]:
        return self.frf.weights[:, pair[0], pair[1]], self._residual_bases[pair]

    def start(self, poles: ComplexArray) -> ComplexArray:
        """Return participations (references x m) of the residues' best rank-one approximations."""
        residues = self.residues(poles).transpose(2, 0, 1)
        return np.array([np.linalg.svd(R, full_matrices=False)[2][0] for R in residues]).T

    def _gauge(self, participation: ComplexArray) -> tuple[ComplexArray, NDArray[np.bool_]]:
        """Return participations, the largest of each mode 1 and known; with reciprocity all are free."""
        free = np.ones(participation.shape, dtype=bool)
        if self.real:
            turn = np.exp(-0.5j * np.angle(np.sum(participation**2, axis=0)))
            participation = (participation * turn).real.astype(complex)
        if self.own:
            return participation, free
        modes = np.arange(participation.shape[1])
        largest = np.argmax(np.abs(participation), axis=0)
        free[largest, modes] = False
        return participation / participation[largest, modes], free

    def evaluate(self, poles: ComplexArray, L: ComplexArray, free: NDArray[np.bool_]) -> ModalFit:
        """Return the fit at poles and participations, shapes solved for."""
        m, parts = len(poles), 1 if self.real else 2
        columns, forces = self._columns(poles), parts * m
        # Unknowns: parts of the poles, then of the free participations, reference by reference.
        starts = 2 * m + np.concatenate([[0], np.cumsum(parts * free.sum(axis=1))]).astype(int)
        free_parts = [np.flatnonzero(np.tile(row, parts)) for row in free]
        N, gradient = np.zeros((starts[-1], starts[-1])), np.zeros(starts[-1])
        shapes = np.zeros((self.responses, m), dtype=complex)
        residual = np.zeros(self.frf.values.shape, dtype=complex)
        roots: list[Array | None] = []
        slopes: list[Array | None] = []
        chi2 = 0.0
        factors = [self._map(L[i]) for i in range(self.references)]
        for o in range(self.responses):
            X = [_Columns(columns, *self._weighting((o, i))) for i in range(self.references)]
            y = [self._data[o, i] for i in range(self.references)]
            grams = [x.gram for x in X]
            own = self.own.get(o)
            if own is None:
                K = sum(T.T @ G[:forces, :forces] @ T for T, G in zip(factors, grams, strict=True))
                root = inverse_root(np.asarray(K))
                psi, rest = np.zeros(forces), y
                for _ in range(2):  # the second time refines the solution of the normal equations
                    g = sum(T.T @ x.times(r)[:forces] for T, x, r in zip(factors, X, rest, strict=True))
                    psi = psi + root @ (root.T @ g)
                    rest = [a - x.sum(T @ psi) for T, x, a in zip(factors, X, y, strict=True)]
                shapes[o] = self._join(psi)
            else:
                shapes[o] = L[own]
                own_parts = np.concatenate([L[own].real, L[own].imag])[:forces]
                rest = [a - x.sum(T @ own_parts) for T, x, a in zip(factors, X, y, strict=True)]
            cross = np.zeros((forces, len(N)))
            of_shape = self._map(shapes[o])
            for i in range(self.references):
                B = np.zeros((len(grams[i]), len(N)))
                B[forces:, : 2 * m] = self._pole_map(shapes[o] * L[i])
                B[:forces, starts[i] : starts[i + 1]] += of_shape[:, free_parts[i]]
                used = [np.arange(2 * m), np.arange(starts[i], starts[i + 1])]
                if own is not None:
                    B[:forces, starts[own] : starts[own + 1]] += factors[i][:, free_parts[own]]
                    used += [np.arange(starts[own], starts[own + 1])] if own != i else []
                index = np.concatenate(used)
                B = B[:, index]
                product = grams[i] @ B
                N[np.ix_(index, index)] += B.T @ product
                gradient[index] += B.T @ X[i].times(rest[i])
                if own is None:
                    cross[:, index] += factors[i].T @ product[:forces]
                chi2 += float(rest[i] @ rest[i])
                residual[:, o, i] = _unstacked(rest[i])
            if own is None:
                moved = root.T @ cross
                N -= moved.T @ moved
                roots.append(root)
                slopes.append(-root @ moved)
            else:
                roots.append(None)
                slopes.append(None)
        terms = 2 * len(RESIDUAL_POWERS) * self.responses * self.references
        linear = terms + forces * (self.responses - len(self.own))
        return ModalFit(poles, L, shapes, chi2, residual, N, gradient, free, roots, slopes, linear)

    def fit(self, poles: ComplexArray, participation: ComplexArray, max_steps: int = MAX_STEPS) -> ModalFit:
        """Return the fit of largest likelihood from a start, by damped Gauss–Newton steps.

        Raises `NumericalError` where the start has dependent modes.
        """
        L, free = self._gauge(participation)
        fit, damping = self.evaluate(poles, L, free), _DAMPING
        history = _History()
        for _ in range(max_steps):
            scale = _scale(fit.information)
            scaled = fit.information / np.outer(scale, scale)
            for _ in range(_MAX_DAMPINGS):
                step = np.linalg.solve(scaled + damping * np.eye(len(scale)), fit.gradient / scale) / scale
                if fit.gradient @ step < _DECREASE:
                    return fit
                # Within standard errors of the optimum, steps are those of a linear iteration.
                near = fit.gradient @ step < len(step)
                move = history.mixed(step, scale) if near else step
                moved = self._moved(fit, move)
                if moved is not None and moved.chi2 <= fit.chi2:
                    break
                damping *= 1 if history.steps else _DAMPING_FACTOR
                history = _History()
            else:
                break
            assert moved is not None  # the search for it ended with one
            fit = moved
            if near:
                history.add(step, move)
            damping = max(damping / _DAMPING_FACTOR, _MIN_DAMPING)
        return fit

    def _moved(self, fit: ModalFit, move: Array) -> ModalFit | None:
        """Return the fit after a step; None where poles leave the upper half plane or modes are dependent."""
        m, at = len(fit.poles), 2 * len(fit.poles)
        poles, L = fit.poles + move[:m] + 1j * move[m:at], fit.participation.copy()
        if np.any(poles.imag <= 0):
            return None
        for i, row in enumerate(fit.free):
            count = int(row.sum()) * (1 if self.real else 2)
            L[i, row] += self._join(move[at : at + count])
            at += count
        try:
            return self.evaluate(poles, L, fit.free)
        except NumericalError:
            return None

    def synthesis(self, fit: ModalFit) -> ComplexArray:
        """Return the receptances of a fit with its residual terms (L x responses x references)."""
        weights = self.frf.weights
        weighted = self.frf.weighted - fit.residual
        return np.asarray(np.where(weights > 0, weighted / np.where(weights > 0, weights, 1.0), np.nan))


class _History:
    """Gauss-Newton steps and the moves that followed, whose mixture makes slow directions converge quickly.

    Source: D. G. Anderson, *J. ACM* 12 (1965) 547–560.
    """

    def __init__(self) -> None:
        self.steps: list[Array] = []
        self._moves: list[Array] = []

    def add(self, step: Array, move: Array) -> None:
        """Add a step and the move that was made at it."""
        self.steps, self._moves = [*self.steps, step][-_DEPTH:], [*self._moves, move][-_DEPTH:]

    def mixed(self, step: Array, scale: Array) -> Array:
        """Return the move to where steps would vanish if they were linear in the unknowns."""
        if not self.steps:
            return step
        changes = np.diff(np.array([*self.steps, step]), axis=0).T
        weights = np.linalg.lstsq(scale[:, None] * changes, scale * step, rcond=None)[0]
        return np.asarray(step - (np.array(self._moves).T + changes) @ weights)


class _Columns:
    """Weighted columns (2 L x k) of a pair, residual terms projected out: as a product only where asked."""

    def __init__(self, columns: Array, weights: Array, basis: Array) -> None:
        self._weighted = (weights[:, None] * columns.reshape(2, len(weights), -1)).reshape(columns.shape)
        self._basis = basis
        self._shares = basis.T @ self._halves(self._weighted)  # of the residual terms (2 x terms x k)

    def _halves(self, values: Array) -> Array:
        """Return real and imaginary parts, one above the other, side by side (2 x L x …)."""
        return values.reshape(2, len(self._basis), *values.shape[1:])

    @property
    def gram(self) -> Array:
        """Products of all columns with each other (k x k)."""
        shares = self._shares.reshape(-1, self._shares.shape[2])
        return np.asarray(self._weighted.T @ self._weighted - shares.T @ shares)

    @property
    def projected(self) -> Array:
        """The columns (2 L x k)."""
        return self._weighted - (self._basis @ self._shares).reshape(self._weighted.shape)

    def times(self, data: Array) -> Array:
        """Return the products of all columns with data (2 L) without residual terms."""
        return np.asarray(self._weighted.T @ data)

    def sum(self, factors: Array) -> Array:
        """Return the sum of the first columns times factors (2 L)."""
        k = len(factors)
        residual = self._basis @ (self._shares[:, :, :k] @ factors)[:, :, None]
        return np.asarray(self._weighted[:, :k] @ factors - residual.ravel())


def _stacked(values: ComplexArray) -> Array:
    return np.concatenate([values.real, values.imag])


def _unstacked(values: Array) -> Any:
    half = len(values) // 2
    return values[:half] + 1j * values[half:]


def _scale(information: Array) -> Array:
    diagonal = np.sqrt(np.maximum(np.diag(information), 0.0))
    return np.where(diagonal > 0, diagonal, 1.0)


def inverse_root(K: Array) -> Array:
    """Return W with W W' the inverse of a normal matrix.

    Raises `NumericalError` where it is singular.
    """
    scale = _scale(K)
    try:
        lower = np.linalg.cholesky(K / np.outer(scale, scale))
    except np.linalg.LinAlgError:
        lower = np.zeros((1, 1))
    if not np.min(np.diag(lower)) ** 2 > _DEPENDENT:
        raise NumericalError(
            "the modes of a fit are dependent at the responses",
            remedy="Widen the band, or measure at more lines.",
        )
    return np.asarray(np.linalg.inv(lower).T / scale[:, None])
