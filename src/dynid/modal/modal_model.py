"""Maximum likelihood of poles, participations, shapes and residual terms of a modal model.

``H_oi = sum_r psi_or l_ir / (s - lambda_r) + conj. + sum_e c_oi,e omega^e``, e = 0, −2, 2, −4 with complex
c; with real shapes ``psi l / ((s - lambda)(s - conj lambda))``. With two powers error bars cover 70 %
instead of 95. Residual terms are projected out of the data of every pair once, shapes are solved for
(variable projection), and Gauss–Newton steps of poles and participations have exact derivatives.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

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
# Numbers of products of columns that are in memory at once (128 MB).
_CHUNK_NUMBERS = 2**24
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
        # Of all pairs, references innermost: weights, orthonormal residual terms (of real and of imaginary
        # parts alike), and the data without them.
        self._weights = np.ascontiguousarray(np.moveaxis(frf.weights, 0, -1).reshape(-1, len(omega)))
        self._bases = np.linalg.qr(self._weights[:, :, None] * terms)[0]
        weighted = np.moveaxis(frf.weighted, 0, -1).reshape(-1, len(omega))
        data = np.stack([weighted.real, weighted.imag], axis=1)
        self._data = data - (data @ self._bases) @ self._bases.transpose(0, 2, 1)

    def _columns(self, poles: ComplexArray) -> Array:
        """Return derivatives by the parts of residues and, for unit residues, of poles (2 x L x …)."""
        s = 1j * self.frf.omega[:, None]
        a, b = 1 / (s - poles), 1 / (s - poles.conj())
        if self.real:
            square = (a * b) ** 2
            columns = np.hstack([a * b, 2 * (s - poles.real) * square, -2 * poles.imag * square])
        else:
            columns = np.hstack([a + b, 1j * (a - b), a**2 + b**2, 1j * (a**2 - b**2)])
        return np.stack([columns.real, columns.imag])

    def _scaled(self, matrix: Array, factor: ComplexArray) -> Array:
        """Return a matrix times that of the multiplication of residues (parts) by a factor each."""
        if self.real:
            return matrix * factor.real
        real, imaginary = np.split(matrix, 2, axis=-1)
        return np.concatenate(
            [
                real * factor.real + imaginary * factor.imag,
                imaginary * factor.real - real * factor.imag,
            ],
            axis=-1,
        )

    def _by_unknowns(self, matrix: Array, shape: ComplexArray, participation: ComplexArray) -> Array:
        """Return a matrix times that from parts of poles, participations and shape to its columns."""
        residues, forces = shape * participation, shape.shape[-1] * self._parts
        by_residues, by_poles = matrix[..., :forces], matrix[..., forces:]
        return np.concatenate(
            [
                by_poles * np.concatenate([residues.real] * 2, axis=-1)
                if self.real
                else self._scaled(by_poles, residues),
                self._scaled(by_residues, shape),
                self._scaled(by_residues, participation),
            ],
            axis=-1,
        )

    @property
    def _parts(self) -> int:
        return 1 if self.real else 2

    def _join(self, parts: Array) -> ComplexArray:
        """Return complex numbers from their parts."""
        m = len(parts) // self._parts
        return parts.astype(complex) if self.real else np.asarray(parts[:m] + 1j * parts[m:])

    def residues(self, poles: ComplexArray) -> ComplexArray:
        """Return the residues (responses x references x m) of linear least squares, every pair by itself."""
        forces = self._parts * len(poles)
        pairs = _Pairs(self, self._columns(poles)[:, :, :forces], slice(0, self.responses))
        residues = np.zeros((self.responses * self.references, len(poles)), dtype=complex)
        for row, (gram, product) in enumerate(zip(pairs.grams, pairs.times(pairs.data), strict=True)):
            scale = _scale(gram)
            normal = gram / np.outer(scale, scale)
            solution = np.linalg.lstsq(normal, product / scale, rcond=_DEPENDENT)[0] / scale
            residues[row] = self._join(np.asarray(solution, dtype=np.float64))
        return residues.reshape(self.responses, self.references, -1)

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
        m, parts = len(poles), self._parts
        columns, forces = self._columns(poles), self._parts * m
        # Unknowns: parts of the poles, then of the free participations, reference by reference.
        starts = 2 * m + np.concatenate([[0], np.cumsum(parts * free.sum(axis=1))]).astype(int)
        free_parts = [np.flatnonzero(np.tile(row, parts)) for row in free]
        N, gradient = np.zeros((starts[-1], starts[-1])), np.zeros(starts[-1])
        shapes = np.zeros((self.responses, m), dtype=complex)
        for o, reference in self.own.items():
            shapes[o] = L[reference]
        residual = np.zeros(self.frf.values.shape, dtype=complex)
        roots: list[Array | None] = [None] * self.responses
        slopes: list[Array | None] = [None] * self.responses
        poles_at, shape_at = np.arange(2 * m), 2 * m + forces
        for rows in self._chunks(columns.shape[2]):
            pairs = _Pairs(self, columns, rows)
            responses = range(rows.start, rows.stop)
            grams = pairs.grams.reshape(len(responses), self.references, *pairs.grams.shape[1:])
            rest = self._solve_shapes(pairs, grams, rows, L, shapes, roots)
            values = rest.reshape(len(responses), self.references, 2, -1)
            residual[:, rows] = np.moveaxis(values[:, :, 0] + 1j * values[:, :, 1], -1, 0)
            products = pairs.times(rest).reshape(len(responses), self.references, -1)
            for o, G, product in zip(responses, grams, products, strict=True):
                own, root = self.own.get(o), roots[o]
                half = self._by_unknowns(G, shapes[o], L[:, None]).transpose(0, 2, 1)
                H = self._by_unknowns(half, shapes[o], L[:, None])
                g = self._by_unknowns(product, shapes[o], L)
                cross = np.zeros((forces, len(N)))
                for i, free_at in enumerate(free_parts):
                    blocks = [(poles_at, poles_at), (np.arange(*starts[i : i + 2]), 2 * m + free_at)]
                    if own is not None:
                        blocks.append((np.arange(*starts[own : own + 2]), shape_at + free_parts[own]))
                    for index, at in blocks:
                        gradient[index] += g[i, at]
                        cross[:, index] += H[i][shape_at:, at]
                        for other, at_other in blocks:
                            N[np.ix_(index, other)] += H[i][np.ix_(at, at_other)]
                if root is not None:
                    moved = root.T @ cross
                    N -= moved.T @ moved
                    slopes[o] = -root @ moved
        chi2 = float(np.sum(np.abs(residual) ** 2))
        terms = 2 * len(RESIDUAL_POWERS) * self.responses * self.references
        linear = terms + forces * (self.responses - len(self.own))
        return ModalFit(poles, L, shapes, chi2, residual, N, gradient, free, roots, slopes, linear)

    def _solve_shapes(
        self,
        pairs: _Pairs,
        grams: Array,
        rows: slice,
        L: ComplexArray,
        shapes: ComplexArray,
        roots: list[Array | None],
    ) -> Array:
        """Set shapes that are no participations, and roots of their covariance; return the residuals."""
        forces = self._parts * shapes.shape[1]
        free = [o for o in range(rows.start, rows.stop) if o not in self.own]
        for o in free:
            half = self._scaled(grams[o - rows.start, :, :forces, :forces], L[:, None]).transpose(0, 2, 1)
            roots[o] = inverse_root(np.sum(self._scaled(half, L[:, None]), axis=0))
        rest = pairs.without(shapes[rows, None] * L, self._parts)
        for _ in range(2):  # the second time refines the solution of the normal equations
            products = pairs.times(rest)[:, :forces].reshape(-1, self.references, forces)
            g = np.sum(self._scaled(products, L), axis=1)
            for o in free:
                root = roots[o]
                assert root is not None
                shapes[o] += self._join(root @ (root.T @ g[o - rows.start]))
            rest = pairs.without(shapes[rows, None] * L, self._parts)
        return rest

    def _chunks(self, columns: int) -> Iterator[slice]:
        """Yield responses whose products of columns are computed together."""
        size = max(1, _CHUNK_NUMBERS // (self.references * columns**2))
        for start in range(0, self.responses, size):
            yield slice(start, min(start + size, self.responses))

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
            count = int(row.sum()) * self._parts
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


class _Pairs:
    """Pairs of some responses with all references: weighted columns (2 L x k), residual terms projected out.

    Their products are sums over lines of squared weights, which pairs differ in, times products of columns,
    which they share.
    """

    def __init__(self, model: ModalModel, columns: Array, responses: slice) -> None:
        rows = slice(responses.start * model.references, responses.stop * model.references)
        self.data, self._weights, self._bases = model._data[rows], model._weights[rows], model._bases[rows]
        self._columns = columns
        count, k, terms = len(self.data), columns.shape[2], self._bases.shape[2]
        weighted = (self._weights[:, :, None] * self._bases).transpose(0, 2, 1).reshape(count * terms, -1)
        shares = [(weighted @ part).reshape(count, terms, k) for part in columns]
        self._shares = np.stack(shares, axis=1)  # of the residual terms (count x 2 x terms x k)
        squares = self._weights**2
        self.grams = np.empty((count, k, k))
        for j in range(k):
            products = squares @ np.einsum("pl,plk->lk", columns[:, :, j], columns[:, :, j:])
            self.grams[:, j, j:] = self.grams[:, j:, j] = products
        flat = self._shares.reshape(count, 2 * terms, k)
        self.grams -= flat.transpose(0, 2, 1) @ flat

    def times(self, data: Array) -> Array:
        """Return the products of all columns with data (count x 2 x L) without residual terms."""
        weighted = self._weights[:, None] * data
        return np.asarray(weighted[:, 0] @ self._columns[0] + weighted[:, 1] @ self._columns[1])

    def without(self, residues: ComplexArray, parts: int) -> Array:
        """Return the data without the responses of residues (count x 2 x L)."""
        factors = np.concatenate([residues.real, residues.imag][:parts], axis=-1).reshape(len(self.data), -1)
        k = factors.shape[1]
        sums = np.stack([factors @ part[:, :k].T for part in self._columns], axis=1)
        terms = (self._shares[..., :k] @ factors[:, None, :, None])[..., 0]
        rest = self.data - self._weights[:, None] * sums + terms @ self._bases.transpose(0, 2, 1)
        return np.asarray(rest)


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
