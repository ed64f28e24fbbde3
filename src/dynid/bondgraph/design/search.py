"""Search for a design: wanted roots by least squares with bounds, least norms by quadratic programs.

A peak, and a sum of peaks, is not smooth where two maxima are equal; but each maximum is a smooth function of
the parameters. With a bound t on the maxima of every norm the problem is smooth: minimise the sum of the
bounds, all maxima at most t and all wanted roots met. Sequential quadratic programs with exact derivatives
approach the solution; Newton's method on its first-order conditions ends at rounding (J. Nocedal,
S. J. Wright, Numerical Optimization, 2006, chapter 18).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array
from dynid.bondgraph.design.functions import DesignFunctions, Evaluation
from dynid.bondgraph.design.quadratic import quadratic_program
from dynid.errors import NumericalError

#: Largest residual of a target that is met.
MET = 1e-9
#: Largest first-order residual of a minimum, over the size of the gradients that balance.
STATIONARY = 1e-8
#: Steps of each method; width of the central differences of the exact gradients.
_MAX_PROGRAMS, _MAX_NEWTON_STEPS, _DIFFERENCE_WIDTH = 60, 12, 1e-4
#: A decrease of the scaled norms below this is left to Newton's method.
_PREDICTED_RTOL = 1e-10
#: Multipliers below this part of the largest belong to pieces that are not active.
_ACTIVE_RTOL = 1e-5


class _Conditions(NamedTuple):
    """First- and second-order conditions of a minimum."""

    #: The gradient of the Lagrangian in the free coordinates, over the sum of its terms, or the norms if
    #: these are larger.
    stationarity: float
    #: The least curvature along the coordinates that the active pieces leave free; infinite where they leave
    #: none.
    curvature: float
    active: int  # how many maxima are active: equal, and as large as the norm
    verified: bool  # True if both conditions hold, and no multiplier has the wrong sign


@dataclass(frozen=True, eq=False)
class Solution:
    """The end of a search."""

    evaluation: Evaluation
    objective: float  # the weighted sum of the norms; 0 without any
    met: bool  # True if every wanted root is reached
    conditions: _Conditions | None = None  # of the minimum; None without a norm to minimise


# --- wanted roots ----------------------------------------------------------------------------------


def meet_roots(functions: DesignFunctions, start: Array) -> Evaluation:
    """Return the targets where the wanted roots are met best, near a start (p)."""
    from scipy.optimize import least_squares

    here = functions.at(start)
    if not len(here.residuals) or not np.isfinite(here.residuals).all():
        return here
    low, high = functions.low, functions.high
    free = high > low
    evaluations: dict[bytes, Evaluation] = {}
    if not free.any():
        return here

    def at(x: Array) -> Evaluation:
        eta = start.copy()
        eta[free] = x
        if (key := eta.tobytes()) not in evaluations:
            evaluations[key] = functions.at(eta)
        return evaluations[key]

    def residuals(x: Array) -> Array:
        return at(x).residuals

    def jacobian(x: Array) -> Array:
        return at(x).jacobian[:, free]

    inside, limits = np.clip(start[free], low[free], high[free]), (low[free], high[free])
    fit = least_squares(
        residuals, inside, jacobian, bounds=limits, xtol=1e-15, ftol=1e-15, gtol=1e-15, max_nfev=100
    )
    return _corrected(functions, at(fit.x))


def _corrected(functions: DesignFunctions, here: Evaluation) -> Evaluation:
    """Return the targets after shortest Newton steps of the wanted roots, within the limits."""
    low, high = functions.low, functions.high
    near = 1e-7 * (1 + np.abs(here.eta))
    eta = np.where(here.eta - low < near, low, np.where(high - here.eta < near, high, here.eta))
    best = here
    if (eta != here.eta).any():
        moved = functions.at(eta)
        if np.linalg.norm(moved.residuals) <= np.linalg.norm(here.residuals) * (1 + 1e-9) + MET:
            best = moved
    for _ in range(_MAX_NEWTON_STEPS):
        free = (best.eta > low) & (best.eta < high)
        if not free.any() or not np.linalg.norm(best.residuals) > 0:
            break
        step = np.linalg.lstsq(best.jacobian[:, free], -best.residuals, 1e-10)[0]
        eta = best.eta.copy()
        eta[free] += step
        following = functions.at(np.clip(eta, low, high))
        if not np.linalg.norm(following.residuals) < np.linalg.norm(best.residuals):
            break
        best = following
    return best


# --- least norms -----------------------------------------------------------------------------------


class _Problem(NamedTuple):
    """The pieces of all norms and the residuals of all roots at a point, scaled."""

    #: values, slopes: The pieces (k, k x p), times scale and weight.
    values: Array
    slopes: Array
    owner: NDArray[np.intp]  # the norm of each piece (k)
    #: residuals, jacobian: Of the roots.
    residuals: Array
    jacobian: Array

    @property
    def tops(self) -> Array:
        """The norms."""
        return np.array([self.values[self.owner == i].max() for i in range(self.owner.max() + 1)])


class _Multipliers(NamedTuple):
    """Multipliers of the pieces (k) and of the residuals (r)."""

    pieces: Array
    roots: Array


def minimise(functions: DesignFunctions, start: Evaluation) -> Solution:
    """Return the least weighted sum of norms near a start at which all of them are finite."""
    search = _Search(functions, start)
    here = search.programs(start)
    return search.finished(here)


class _Search:
    """A search from one start."""

    def __init__(self, functions: DesignFunctions, start: Evaluation) -> None:
        self.functions = functions
        self.low, self.high = functions.low, functions.high
        self.weights = np.array([criterion.weight for criterion in functions.design.criteria])
        size = float(self.weights @ np.array([norm.value for norm in start.norms]))
        self.scale = 1 / size if size > 0 else 1.0

    def objective(self, at: Evaluation) -> float:
        return float(self.weights @ np.array([norm.value for norm in at.norms]))

    def problem(self, at: Evaluation) -> _Problem:
        factors = self.scale * self.weights
        return _Problem(
            np.concatenate([factor * norm.values for factor, norm in zip(factors, at.norms, strict=True)]),
            np.concatenate([factor * norm.slopes for factor, norm in zip(factors, at.norms, strict=True)]),
            np.concatenate([np.full(len(norm.values), k) for k, norm in enumerate(at.norms)]),
            at.residuals,
            at.jacobian,
        )

    def hessian(self, at: Evaluation, multipliers: _Multipliers) -> Array:
        """Return the Hessian of the Lagrangian, by central differences of exact gradients."""
        p = len(at.eta)
        factors = self.scale * self.weights
        rows = np.zeros((p, p))
        for k in range(p):
            gradients = []
            for side in (1, -1):
                eta = at.eta.copy()
                eta[k] += side * _DIFFERENCE_WIDTH
                jacobian, slopes = self.functions.gradients(eta, at)
                pieces = np.concatenate([f * slope for f, slope in zip(factors, slopes, strict=True)])
                gradients.append(multipliers.pieces @ pieces + multipliers.roots @ jacobian)
            rows[k] = (gradients[0] - gradients[1]) / (2 * _DIFFERENCE_WIDTH)
        return np.asarray((rows + rows.T) / 2)

    def programs(self, here: Evaluation) -> Evaluation:
        """Return the end of sequential quadratic programs within a trust region."""
        radius, penalty = 0.5, 10.0
        multipliers: _Multipliers | None = None
        for _ in range(_MAX_PROGRAMS):
            now = self.problem(here)
            guess = multipliers or self._guess(now)
            if len(guess.pieces) != len(now.values):
                guess = self._guess(now)
            try:
                values, vectors = np.linalg.eigh(self.hessian(here, guess))
                # convex by the moduli of the eigenvalues, none of them tiny
                least = 1e-6 * max(1.0, float(np.abs(values).max(initial=0.0)))
                B = np.asarray((vectors * np.maximum(np.abs(values), least)) @ vectors.T)
            except NumericalError:
                B = np.eye(len(here.eta))
            accepted, seen = False, here
            while radius > 1e-7:
                step, found_multipliers, predicted = self._step(now, here.eta, B, radius, penalty)
                if predicted < -_PREDICTED_RTOL:  # the program was not solved: standing still is better
                    radius *= 0.3
                    continue
                if predicted <= _PREDICTED_RTOL:
                    return here
                trial = self.functions.at(np.clip(here.eta + step, self.low, self.high))
                penalty = max(penalty, 2 * float(np.abs(found_multipliers.roots).max(initial=0.0)))
                gained = self._merit(here, penalty) - self._merit(trial, penalty)
                if gained >= 0.1 * predicted:
                    far = float(np.abs(step).max()) >= 0.99 * radius
                    radius = min(2 * radius, 2.0) if gained >= 0.75 * predicted and far else radius
                    same = seen is here and len(found_multipliers.pieces) == sum(
                        len(norm.values) for norm in trial.norms
                    )
                    multipliers = found_multipliers if same else None
                    here, accepted = trial, True
                    break
                radius = 0.3 * min(radius, float(np.abs(step).max()))
                if trial.exists:  # a maximum that appears on the way limits the next step
                    seen = self.functions.with_frequencies(seen, trial)
                    now = self.problem(seen)
            if not accepted:
                break
        return here

    def _guess(self, now: _Problem) -> _Multipliers:
        tops = now.tops
        weight = np.array([value == tops[i] for value, i in zip(now.values, now.owner, strict=True)], float)
        return _Multipliers(weight, np.zeros(len(now.residuals)))

    def _merit(self, at: Evaluation, penalty: float) -> float:
        if not at.exists:
            return np.inf
        return self.scale * self.objective(at) + penalty * float(np.abs(at.residuals).sum())

    def _step(
        self, now: _Problem, eta: Array, B: Array, radius: float, penalty: float
    ) -> tuple[Array, _Multipliers, float]:
        """Return the step of a quadratic program, its multipliers, and the decrease that it predicts.

        Unknowns: the step (p), a bound above the pieces of each norm, and one on the size of each residual.
        """
        p, norms, r, k = len(eta), int(now.owner.max()) + 1, len(now.residuals), len(now.values)
        n = p + norms + r
        H = np.zeros((n, n))
        H[:p, :p] = B
        c = np.concatenate([np.zeros(p), np.ones(norms), np.full(r, penalty)])
        tops = now.tops
        A = np.zeros((k + 2 * r + 2 * p, n))
        A[:k, :p] = now.slopes
        A[np.arange(k), p + now.owner] = -1.0
        A[k : k + r, :p], A[k + r : k + 2 * r, :p] = now.jacobian, -now.jacobian
        for block in (slice(k, k + r), slice(k + r, k + 2 * r)):
            A[block, p + norms :] = -np.eye(r)
        A[k + 2 * r : k + 2 * r + p, :p], A[k + 2 * r + p :, :p] = np.eye(p), -np.eye(p)
        b = np.concatenate(
            [
                tops[now.owner] - now.values,  # bounds are counted from the norms
                -now.residuals,
                now.residuals,
                np.minimum(radius, self.high - eta),
                np.minimum(radius, eta - self.low),
            ]
        )
        x, dual = quadratic_program(H, c, A, b)
        step = x[:p]
        after = np.array([(now.values + now.slopes @ step)[now.owner == i].max() for i in range(norms)])
        linear = np.abs(now.residuals + now.jacobian @ step).sum() - np.abs(now.residuals).sum()
        predicted = -float(after.sum() - tops.sum() + step @ B @ step / 2 + penalty * linear)
        return step, _Multipliers(dual[:k], dual[k : k + r] - dual[k + r : k + 2 * r]), predicted

    # The end: Newton's method on the first-order conditions

    def finished(self, here: Evaluation) -> Solution:
        """Return the solution after Newton steps on the first-order conditions, with these."""
        best, conditions, step = self._conditions(here)
        for _ in range(_MAX_NEWTON_STEPS):
            if step is None or not np.abs(step).max(initial=0.0) > 0:
                break
            eta = np.clip(best.eta + step, self.low, self.high)
            trial = self.functions.at(eta)
            if not trial.exists or np.abs(step).max() > 0.1:
                break
            following, after, next_step = self._conditions(trial)
            tolerance = 1e-6 * abs(self.objective(best))
            if self.objective(following) > self.objective(best) + tolerance:
                break
            if not (after.stationarity < conditions.stationarity or _size(next_step) < _size(step)):
                break
            best, conditions, step = following, after, next_step
        met = bool(np.abs(best.residuals).max(initial=0.0) <= MET)
        return Solution(best, self.objective(best), met, conditions)

    def _conditions(self, here: Evaluation) -> tuple[Evaluation, _Conditions, Array | None]:
        """Return the conditions at a point, and the Newton step on the first-order ones, None without one.

        The active pieces are those of a quadratic program in a small trust region.
        """
        here = self._at_limits(here)
        now = self.problem(here)
        guess = self._step(now, here.eta, np.eye(len(here.eta)), 1e-3, 1e3)[1]
        active = guess.pieces > _ACTIVE_RTOL * guess.pieces.max()
        for i in range(int(now.owner.max()) + 1):  # each norm has one at least
            of_norm = np.flatnonzero(now.owner == i)
            active[of_norm[np.argmax(now.values[of_norm])]] = True
        at_low, at_high = here.eta <= self.low, here.eta >= self.high
        free = ~(at_low | at_high)
        pieces = np.flatnonzero(active)
        rows, c = self._equations(now, pieces)
        gradient, multipliers_now = self._multipliers(now, pieces, rows, free)
        sizes = np.abs(multipliers_now.pieces) @ np.abs(now.slopes) + np.abs(multipliers_now.roots) @ np.abs(
            now.jacobian
        )
        size = max(float(sizes.max(initial=0.0)), float(now.tops.sum()))
        stationarity = float(np.abs(gradient[free]).max(initial=0.0)) / size
        signs = multipliers_now.pieces[pieces].min(initial=0.0) >= -1e-7
        small = STATIONARY * size
        held = (gradient[at_low] >= -small).all() and (gradient[at_high] <= small).all()
        try:
            B = self.hessian(here, multipliers_now)[np.ix_(free, free)]
        except NumericalError:
            return here, _Conditions(stationarity, np.nan, len(pieces), verified=False), None
        curvature = _reduced_curvature(B, rows[:, free])
        flat = curvature >= -1e-6 * max(1.0, float(np.abs(B).max(initial=0.0)))
        verified = bool(stationarity <= STATIONARY and signs and held and flat)
        conditions = _Conditions(stationarity, curvature, len(pieces), verified)
        count = len(rows)
        matrix = np.zeros((len(B) + count, len(B) + count))
        matrix[: len(B), : len(B)] = B
        matrix[: len(B), len(B) :], matrix[len(B) :, : len(B)] = rows[:, free].T, rows[:, free]
        right = np.concatenate([-gradient[free], -c])
        moved = np.linalg.lstsq(matrix, right, 1e-12)[0][: len(B)]
        step = np.zeros(len(here.eta))
        step[free] = moved
        return here, conditions, step

    def _at_limits(self, here: Evaluation) -> Evaluation:
        """Return the point with coordinates that are at a limit to rounding exactly there."""
        eta = np.where(np.abs(here.eta - self.low) < 1e-8, self.low, here.eta)
        eta = np.where(np.abs(eta - self.high) < 1e-8, self.high, eta)
        if (eta == here.eta).all():
            return here
        moved = self.functions.at(eta)
        return moved if moved.exists else here

    def _equations(self, now: _Problem, pieces: NDArray[np.intp]) -> tuple[Array, Array]:
        """Return the equations that hold at the solution: equal pieces of each norm, and met roots."""
        rows, right = [now.jacobian], [now.residuals]
        for i in range(int(now.owner.max()) + 1):
            first, *others = pieces[now.owner[pieces] == i]
            rows.append(now.slopes[others] - now.slopes[first])
            right.append(now.values[others] - now.values[first])
        return np.concatenate(rows), np.concatenate(right)

    def _multipliers(
        self, now: _Problem, pieces: NDArray[np.intp], rows: Array, free: NDArray[np.bool_]
    ) -> tuple[Array, _Multipliers]:
        """Return the gradient of the Lagrangian, and the multipliers for which it is least."""
        first = np.array([pieces[now.owner[pieces] == i][0] for i in range(int(now.owner.max()) + 1)])
        plain = now.slopes[first].sum(axis=0)
        solution = (
            np.linalg.lstsq(rows[:, free].T, -plain[free], 1e-12)[0] if free.any() else np.zeros(len(rows))
        )
        weights = np.zeros(len(now.values))
        weights[first] = 1.0
        index = len(now.residuals)
        for i, lead in enumerate(first):
            for piece in pieces[now.owner[pieces] == i][1:]:
                weights[piece] += solution[index]
                weights[lead] -= solution[index]
                index += 1
        return plain + solution @ rows, _Multipliers(weights, solution[: len(now.residuals)])


def _size(step: Array | None) -> float:
    return np.inf if step is None else float(np.abs(step).max(initial=0.0))


def _reduced_curvature(B: Array, rows: Array) -> float:
    """Return the least eigenvalue of B where the rows vanish; infinite where they leave nothing."""
    if not len(B):
        return float(np.inf)
    _, s, Vt = np.linalg.svd(rows) if len(rows) else (None, np.zeros(0), np.eye(len(B)))
    rank = int(np.count_nonzero(s > 1e-9 * s.max(initial=0.0))) if len(s) else 0
    free = Vt[rank:]
    return float(np.linalg.eigvalsh(free @ B @ free.T).min()) if len(free) else float(np.inf)
