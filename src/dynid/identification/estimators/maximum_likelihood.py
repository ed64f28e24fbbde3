"""Maximum likelihood by output error: Levenberg–Marquardt on the coordinates of the parameters.

The initial state is linear for fixed parameters and is solved for in every step (variable projection: G. H.
Golub, V. Pereyra, SIAM J. Numer. Anal. 10 (1973) 413–432), so that steps are taken in the parameters alone,
with exact sensitivities. Where the noise of a channel is not given, what is minimised is the concentrated
likelihood, the sum over channels of the count of values times the logarithm of the residuals' RMS.

`Huber` makes it robust: Huber's loss, channel by channel, around any estimator of maximum likelihood.

With residuals r, their robust deviation s (the median absolute deviation over 0.6745) and Huber's function
psi(z) = max(-c, min(c, z)), c = 1.345, the estimate solves ``sum J^T psi(r / s) = 0``: small residuals count
as in least squares, and the influence of a large one is bounded. Each iteration is a Gaussian fit to the
pseudo-values ``prediction + s psi(r / s) / m``, m the mean of psi', which stay the same once it has
converged. They scatter by ``s sqrt(mean psi^2) / m``, which is the noise in the asymptotic (sandwich)
covariance of the estimate; so error bars, weights of channels, and tests of the residuals are those of the
Gaussian fit. For Gaussian noise it has 95 % of the efficiency of least squares.

P. J. Huber, Ann. Math. Statist. 35 (1964) 73–101; P. J. Huber, Robust Statistics, 1981, sections 6.4, 7.8.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeVar

import numpy as np

from dynid.arrays import Array, guarded
from dynid.defaults import HUBER
from dynid.errors import Diverged, DynidError, UsageError
from dynid.identification.estimators.estimate import Estimate, EstimationStage, Estimator
from dynid.identification.estimators.filter import check_run_away
from dynid.identification.information import Information
from dynid.identification.least_squares import least_squares
from dynid.identification.likelihood.likelihood import Fit, Likelihood
from dynid.identification.records.measurement import RobustLoss
from dynid.identification.residual_tests import robust_deviation
from dynid.identification.statistics import root_mean_square
from dynid.progress import report_progress

#: Longest step of a coordinate in its unit: of a logarithm a factor of 4.5.
_MAX_STEP = 1.5
#: First damping, its least, also that near an optimum, and its most; it falls and rises tenfold.
_FIRST_DAMPING, _MIN_DAMPING, _MAX_DAMPING = 1e-3, 1e-10, 1e6
#: A step is the last if the distance left is below this part of the standard errors, or this size.
_LAST_DISTANCE_DEVIATIONS, _LAST_DISTANCE_UNITS = 1e-3, 1e-11
#: A step below this part of that one which does not improve is rounding: shorter ones are not tried.
_MIN_STEP_RATIO = 1e-3
# Pulls to the middle of limits, over their distance: first about the deviation of a uniform distribution.
_PULLS = (0.3, 3.0)
L = TypeVar("L", bound=Likelihood)
#: Most iterations, and the step (in standard errors) that is the last.
_MAX_ITERATIONS, _LAST_STEP_DEVIATIONS = 100, 1e-3
# Iterations after which scales and parts of bounded values are fixed: both jump where a sample crosses the
# bound, and could alternate for ever. With fixed ones the iteration contracts.
_SETTLING = 10
# Rounds in which the order of a noise model is chosen.
_CHOOSING = 3
# A robust deviation below this part of a channel's RMS is rounding.
_DEVIATION_FLOOR = 1e-12


class Refined(NamedTuple):
    """The end of a search for the greatest likelihood (`fit`), after so many `steps`."""

    fit: Fit
    steps: int


@dataclass(frozen=True)
class OutputError:
    """Estimator: maximum likelihood from the start values, without a filter."""

    iterations: int = 50  # most steps
    name: str = "output-error"
    # The noise (channels of each record) of a nearby model whose estimate the origin is; None: it is a start.
    noise: Sequence[Array] | None = None

    def __post_init__(self) -> None:
        if self.iterations < 1:
            raise UsageError("output error needs at least one iteration")

    def run(self, likelihood: Likelihood, origin: Array) -> Estimate:
        """Estimate, from the coordinates `origin` (p).

        Raises Diverged if the parameters run away.
        """
        way = refine(likelihood, origin, self.iterations, self.noise)
        final, way = with_noise(likelihood, way)
        stage = EstimationStage.at("output error", final, way.fit, way.steps)
        return Estimate(way.fit, [], [stage], likelihood=final if likelihood.modelled else None)


def refine(
    likelihood: Likelihood,
    eta: Array,
    iterations: int = 50,
    noise: Sequence[Array] | None = None,
    *,
    least_gain: float = 0.0,
) -> Refined:
    """Go to the nearest maximum of the likelihood.

    Where records leave a direction between limits open, it is a narrow curved valley of the posterior, which
    is followed from the middle: with a strong pull to it first, and then with weaker ones.

    `eta`: coordinates to start from (p); `iterations`: most steps; `noise`: that of a nearby model whose
    estimate they are; `least_gain`: where two steps gain less of the logarithm of the likelihood, the search
    ends. Raises Diverged if a parameter leaves its start by a factor of a million.
    """
    eta, steps = likelihood.priors.clipped(eta), 0
    if likelihood.priors.pulled.any():
        fit = likelihood.fit(eta)
        deviations = likelihood.information(fit, likelihood.likeliest(fit)).deviations()
        for pull in _PULLS if likelihood.priors.open(deviations).any() else ():
            middle = _nearest_maximum(replace(likelihood, pull=pull), eta, iterations)
            eta, steps = middle.fit.eta, steps + middle.steps
    maximum = _nearest_maximum(likelihood, eta, iterations, noise, least_gain)
    return Refined(maximum.fit, maximum.steps + steps)


def _nearest_maximum(
    likelihood: Likelihood,
    eta: Array,
    iterations: int,
    noise: Sequence[Array] | None = None,
    least_gain: float = 0.0,
) -> Refined:
    """Go to the nearest maximum of the likelihood by Levenberg and Marquardt's steps within the limits."""
    fit = likelihood.fit(eta, noise)
    misfit = likelihood.misfit(fit)
    damping = _FIRST_DAMPING if noise is None else _MIN_DAMPING
    before, smallest = 0.0, _LAST_DISTANCE_UNITS * likelihood.priors.units
    gains = [np.inf, np.inf]  # of the last steps
    superposes = all(record.superposes for record in likelihood.records)
    may_idle = any(record.may_idle for record in likelihood.records)
    for number in range(1, iterations + 1):
        report_progress(f"maximum likelihood, step {number}")
        noise = likelihood.likeliest(fit)
        information = likelihood.information(fit, noise)
        residual = likelihood.weighted(fit, noise)
        # Parameters of a joint that never slips or closes have no influence: they stay. Where those of a
        # linear model have none the search has run away, and `deviations` fails.
        idle = np.asarray(~information.projected.any(axis=0) & may_idle)
        held = idle | likelihood.priors.blocked(fit.eta, information.projected.T @ residual)
        deviations = (
            np.linalg.norm(information.root_of(~idle), axis=1) if idle.any() else information.deviations()
        )
        is_unbounded = likelihood.priors.open(deviations).any()
        # Of a direction that only limits determine, a part of their distance.
        deviations = np.fmin(deviations, likelihood.priors.spreads)
        held_up, better, negligible = (
            False,
            None,
            np.maximum(_LAST_DISTANCE_DEVIATIONS * deviations, smallest),
        )
        while better is None and damping <= _MAX_DAMPING:
            step = _damped_step(information.without(held), residual, damping, likelihood.priors.units)
            step = np.where(held, 0.0, step)
            target = likelihood.priors.clipped(fit.eta + step)
            if not np.array_equal(target, fit.eta + step):
                target = _bounded_target(likelihood, information, residual, damping, fit.eta)
            better, step = _improved(likelihood, target, noise, misfit), target - fit.eta
            damping *= 1.0 if better else 10.0
            held_up |= better is None
            if better is None and np.all(np.abs(step) <= _MIN_STEP_RATIO * negligible):
                break
        if better is None:  # no step improves: rounding is all that is left
            return Refined(fit, number - 1)
        gains = [gains[-1], misfit - better[1]]
        fit, misfit = better
        check_run_away(likelihood.unknowns, fit.eta, eta, likelihood.records[0].observed.astray)
        size = float(np.max(np.abs(step) / negligible))
        # The sum of all steps to come, after two of these sizes: a geometric series.
        left = size * size / (before - size) if size < before / 2 else size
        if max(gains) < least_gain:
            return Refined(fit, number)
        is_open = damping > _MIN_DAMPING and is_unbounded
        if left <= 1.0 and not is_open:
            return Refined(fit, number)
        # Damping holds up the pull to the middle of limits where the records leave a direction open.
        if left <= 1.0:
            damping = _MIN_DAMPING
        elif (
            not held_up or superposes
        ):  # in curved valleys a shorter step than the last one would be refused again
            damping = max(damping / 10, _MIN_DAMPING)
        before = size
    return Refined(fit, iterations)


def with_noise(likelihood: L, way: Refined) -> tuple[L, Refined]:
    """Return the likelihood with the noise model that belongs to its maximum, and that maximum.

    The noise model is estimated from the residuals, and the maximum from the likelihood with it, in turn,
    until the estimates change by less than a thousandth of their standard errors. Estimates of parameters and
    of noise are asymptotically independent, so that this contracts fast: by about the part of the values that
    the parameters take. The order of an autoregression is chosen in the first rounds alone.

    Raises Diverged if this does not end.
    """
    if not likelihood.modelled:
        return likelihood, way
    fit, steps, units = way.fit, way.steps, likelihood.priors.units
    for number in range(1, _MAX_ITERATIONS + 1):
        report_progress(f"noise model, round {number}")
        likelihood = likelihood.renewed(fit, settling=number > _CHOOSING)
        way = refine(likelihood, fit.eta)
        change, fit, steps = np.abs(way.fit.eta - fit.eta), way.fit, steps + way.steps
        deviations = likelihood.information(fit, likelihood.likeliest(fit)).deviations()
        if number > 1 and np.all(change <= np.maximum(_LAST_STEP_DEVIATIONS * deviations, 1e-10 * units)):
            return likelihood, Refined(fit, steps)
    raise Diverged(
        f"the noise model has not converged in {_MAX_ITERATIONS} rounds",
        remedy="Give the order of the noise as a number, lower it, or assume white noise.",
        names=("measurement.noise",),
    )


def _damped_step(information: Information, residual: Array, damping: float, units: Array) -> Array:
    """Return a damped Gauss–Newton step (Marquardt's scaling), no coordinate moved too far."""
    J = information.projected
    size = np.linalg.norm(J, axis=0)
    size = np.where(size > 0, size, 1.0)
    p = len(size)
    rows = np.concatenate([J / size, np.sqrt(damping) * np.eye(p)])
    right = np.concatenate([residual, np.zeros(p)])
    step = least_squares(rows, right, 0.0) / size
    return np.asarray(step * min(1.0, _MAX_STEP / float(np.abs(step / units).max(initial=_MAX_STEP))))


def _bounded_target(
    likelihood: Likelihood, information: Information, residual: Array, damping: float, eta: Array
) -> Array:
    """Return where a damped Gauss–Newton step within the limits leads, no coordinate moved too far."""
    J, units = information.projected, likelihood.priors.units
    size = np.linalg.norm(J, axis=0)
    damped = np.diag(np.sqrt(damping) * np.where(size > 0, size, 1.0))
    Q, R = np.linalg.qr(np.concatenate([J, damped]))
    right = Q.T @ np.concatenate([residual, np.zeros(len(size))])
    step = likelihood.priors.nearest(R, right + R @ eta) - eta
    return np.asarray(eta + step * min(1.0, _MAX_STEP / float(np.abs(step / units).max(initial=_MAX_STEP))))


def _improved(
    likelihood: Likelihood, eta: Array, noise: Sequence[Array], misfit: float
) -> tuple[Fit, float] | None:
    """Return the fit at these coordinates and its misfit if that is below this one, else None."""
    try:
        with guarded("the prediction"):
            new = likelihood.fit(eta, noise)
    except DynidError:  # numbers leave their range
        return None
    reached = likelihood.misfit(new)
    return (new, reached) if reached < misfit else None


@dataclass(frozen=True)
class Huber:
    """Estimator: Huber's loss instead of squares."""

    inner: Estimator  # the estimator of maximum likelihood from whose estimate it starts

    @property
    def name(self) -> str:
        """Name of the estimator."""
        return self.inner.name

    def run(self, likelihood: Likelihood, origin: Array) -> Estimate:
        """Estimate, from the coordinates `origin` (p).

        Raises Diverged if the estimates run away, or the iteration does not end.
        """
        if likelihood.modelled and likelihood.records[0].sampling_step is not None:
            raise UsageError(
                "a robust loss is for independent residuals, and the noise is coloured",
                remedy="Leave out 'loss: huber', or 'noise: {kind: coloured}'.",
                names=("estimator.loss", "estimator"),
            )
        estimate = self.inner.run(likelihood, origin)
        likelihood = estimate.likelihood or likelihood
        fit, pseudo = estimate.fit, likelihood
        for number in range(1, _MAX_ITERATIONS + 1):
            report_progress(f"Huber's loss, iteration {number}")
            pseudo = bounded(likelihood if number <= _SETTLING else pseudo, fit)
            way = refine(pseudo, fit.eta)
            change, fit = np.abs(way.fit.eta - fit.eta), way.fit
            deviations = pseudo.information(fit, pseudo.likeliest(fit)).deviations()
            if np.all(
                change <= np.maximum(_LAST_STEP_DEVIATIONS * deviations, 1e-10 * likelihood.priors.units)
            ):
                stage = EstimationStage.at("Huber's loss", pseudo, fit, number)
                stages = [*estimate.stages, stage]
                return replace(estimate, fit=fit, stages=stages, likelihood=pseudo, comparison=None)
        raise Diverged(
            f"Huber's loss has not converged in {_MAX_ITERATIONS} iterations",
            remedy="Correct or leave out the outliers (empty cells), or start nearer to the true values.",
            names=("estimator.loss",),
        )


def bounded(likelihood: L, fit: Fit) -> L:
    """Return the likelihood of the pseudo-values about a fit.

    Records of pseudo-values keep their scales, and the parts of them that are bounded.
    """
    records = []
    for record, record_fit in zip(likelihood.records, fit.parts, strict=True):
        data, predicted = record.data, record_fit.predicted.outputs
        residual, robust = data.recorded - predicted, data.robust
        if robust is None:
            rounding = _DEVIATION_FLOOR * root_mean_square(data.recorded)
            scale = np.maximum(record.scatter(record_fit.counts, robust_deviation(residual)), rounding)
            beyond = np.where(np.isnan(residual), np.nan, np.abs(residual) >= HUBER.value * scale)
            robust = RobustLoss(data.recorded, scale, np.nanmean(beyond, axis=0), data.given_noise)
        psi = np.clip(residual / robust.scale, -HUBER.value, HUBER.value)
        values = predicted + robust.scale * psi / (1 - robust.clipped)
        records.append(record.on(replace(data, values=values, given=None, robust=robust)))
    return replace(likelihood, records=tuple(records))
