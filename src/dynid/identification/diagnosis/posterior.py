"""Posterior of the parameters at an estimate: intervals, bounds, identifiability and convergence.

It is Gaussian in the coordinates of the parameters, and the same for records of time and frequency responses.
`diagnosis.verdict` states it in words, `results.write_result` as named arrays.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array
from dynid.errors import Diverged, DynidError, NotIdentifiable
from dynid.identification.diagnosis.calibration import CalibrationSlopes, calibration_slopes
from dynid.identification.diagnosis.intervals import LimitedPosterior, Profile
from dynid.identification.diagnosis.residuals import Residuals
from dynid.identification.information import Information, below_noise, joint_information, vanished
from dynid.identification.likelihood.lack_of_fit import ModelComparison, compare_models
from dynid.identification.residual_tests import is_optimal
from dynid.parameters import logarithmic, rates, truths, values

if TYPE_CHECKING:
    from dynid.identification.diagnosis.equivalent_optima import EquivalentOptima
    from dynid.identification.diagnosis.model_error import ModelError
    from dynid.identification.diagnosis.proportional_noise import GrowingResiduals


# A standard error of the logarithm beyond which not even the order of magnitude is known: a factor of e^10.
_UNKNOWN_LOG_DEVIATION = 10.0
#: Part of the deviation of a prior above which the data leave a parameter to the prior or its limits.
UNDECIDED = 0.8
#: One beyond which a parameter is poorly known.
UNCERTAIN = 0.5
# Half the 95 % quantile of chi-squared with one degree of freedom: misfits within it of the least.
_HALF_CHI_SQUARED = 1.92
# Distance of the logarithm at which a value counts as 0: a factor of a thousand.
_FAR_DISTANCE = float(np.log(1e3))
# Distance of the logarithm at which the records contradict a value of which they know the order of magnitude.
_TENFOLD = float(np.log(10))
# Misfit within which a value of an undetermined parameter leaves the others as they are, to one standard
# error; and the parts of the way to its start that are tried.
_ADMITTED, _TOWARDS_START = 0.5, (1.0, 0.75, 0.5, 0.25)
# Errors of coordinates below this are round-off, for which the bound of clean data has no meaning.
_MIN_REL_BOUND = 1e-9


@dataclass(frozen=True, eq=False)
class Posterior(Residuals):
    """The posterior of the parameters at an estimate, beside its residuals."""

    model_error: ModelError | None = None  # error that the reduction of the model causes, if it is reduced
    mistakes: tuple[str, ...] = ()  # mistakes of instruments that explain the lack of fit, in words
    next_laws: str = ""  # what to do about a nonlinear joint, if laws were compared for it
    # Residuals that grow with the response, where these are not explained by mistakes.
    growing: GrowingResiduals | None = None
    rejection: DynidError | None = None  # error that rejects the fit; None where it is accepted
    # Optima that explain the records as well; None where they were not sought.
    optima: EquivalentOptima | None = None
    # Parameters that the records do not determine: fixed at the values that the likelihood has.
    undetermined: tuple[str, ...] = ()
    # Start of each parameter (p) as the scene has it; empty: those of the likelihood.
    starts: tuple[float, ...] = ()

    # Intervals and bounds.

    @cached_property
    def gaussian(self) -> LimitedPosterior:
        """The posterior of the linearised model, within the limits of the parameters."""
        priors = self.likelihood.priors
        residual = self.likelihood.weighted(self.fit, self.noise)
        return LimitedPosterior.of(
            self.fit.eta,
            self.information.deviations(),
            self.information.projected,
            residual,
            (priors.low, priors.high),
        )

    @cached_property
    def limited(self) -> LimitedPosterior:
        """The posterior within the limits of the parameters, no narrower than the profile likelihood."""
        flat = None if self.optima is None else self.optima.flat
        if flat is None or flat.intervals is None:
            return self.gaussian
        return self.gaussian.widened(*flat.intervals)

    @property
    def deviations(self) -> Array:
        """Standard errors of the coordinates (p), within the limits."""
        return self.limited.deviations

    @cached_property
    def gaussian_root(self) -> Array:
        """A root of the covariance of the coordinates (p x p), of the linearised model within the limits."""
        samples = self.gaussian.samples
        if samples is None:
            return self.information.root
        apart = (samples - samples.mean(axis=0)) / np.sqrt(len(samples))
        return np.asarray(np.linalg.qr(apart, mode="r")).T

    @cached_property
    def root(self) -> Array:
        """A root of the covariance of the coordinates (p x p), with their standard errors."""
        if self.limited is self.gaussian:
            return self.gaussian_root
        return self.gaussian_root * (self.deviations / self.gaussian.deviations)[:, None]

    @property
    def intervals(self) -> tuple[Array, Array]:
        """Ends of the 95 % intervals of the parameters (p)."""
        unknowns, limited = self.likelihood.unknowns, self.limited
        with np.errstate(over="ignore"):  # infinite where not even the order of magnitude is known
            low, high = values(unknowns, limited.low), values(unknowns, limited.high)
        # Of a parameter that is not identifiable all values of its scale.
        log = np.where(logarithmic(unknowns), 0.0, -np.inf)
        low, high = np.where(self.identifiable, low, log), np.where(self.identifiable, high, np.inf)
        return self._within_limits(low, free=~self.identifiable), self._within_limits(
            high, free=~self.identifiable
        )

    def _within_limits(self, parameters: Array, free: NDArray[np.bool_] | None = None) -> Array:
        """Return values of the parameters (p) without the round-off of their coordinates at limits."""
        # Those that are `free` (p) stay.
        unknowns = self.likelihood.unknowns
        low = [-np.inf if unknown.low is None else unknown.low for unknown in unknowns]
        high = [np.inf if unknown.high is None else unknown.high for unknown in unknowns]
        clipped = np.clip(parameters, low, high)
        return clipped if free is None else np.where(free, parameters, clipped)

    @cached_property
    def decided_by(self) -> list[str]:
        """The source of each parameter: ``data``, its ``prior`` or ``limits`` alone, or ``nothing``."""
        priors = self.likelihood.priors
        alone = self.deviations > UNDECIDED * np.where(np.isnan(priors.spreads), np.inf, priors.spreads)
        by_limits = ~priors.has_prior | (priors.spreads < priors.deviations)
        sources = np.where(alone, np.where(by_limits, "limits", "prior"), "data")
        return [str(source) for source in np.where(self.identifiable, sources, "nothing")]

    @property
    def relative_errors(self) -> Array:
        """Standard errors over the estimates (p); 0 of parameters of any sign, which may be 0."""
        log = logarithmic(self.likelihood.unknowns)
        return np.where(log, self.deviations, 0.0)

    @cached_property
    def step(self) -> Array:
        """The Gauss–Newton step from the estimate to the optimum within the limits, in coordinates (p)."""
        priors, eta = self.likelihood.priors, self.fit.eta
        residual = self.likelihood.weighted(self.fit, self.noise)
        step = self.information.without(self.held).step(residual)
        if np.array_equal(priors.clipped(eta + step), eta + step):
            return step
        Q, R = np.linalg.qr(self.information.projected)
        return priors.nearest(R, Q.T @ residual + R @ eta) - eta

    @property
    def distance_to_optimum(self) -> Array:
        """Length of the Gauss–Newton step in standard errors (p)."""
        return np.asarray(np.abs(self.step) / self.deviations)

    @cached_property
    def held(self) -> NDArray[np.bool_]:
        """Mask of parameters at a limit beyond which the likelihood is greater (p)."""
        direction = self.information.projected.T @ self.likelihood.weighted(self.fit, self.noise)
        return self.likelihood.priors.blocked(self.fit.eta, direction)

    @property
    def prior_conflict(self) -> Array:
        """Distance of priors and records in deviations of that distance (p), 0 without a prior."""
        return self.likelihood.priors.conflict(self.fit.eta, self.information.deviations())

    @cached_property
    def scaled_deviations(self) -> Array:
        """Standard errors of the coordinates (p) for the observed noise instead of the given one.

        The weights stay those of the noise given: H^-1 J^T D J H^-1, with D the ratios of variances.
        """
        ratio, rows, first = np.nan_to_num(self.noise_test.ratio, nan=1.0), [], 0
        for record, record_fit in zip(self.likelihood.records, self.fit.parts, strict=True):
            rows.append(record.by_row(ratio[first : first + len(record_fit.counts)]))
            first += len(record_fit.counts)
        projected, root = self.information.projected, self.information.root
        scale = np.concatenate([*rows, np.ones(len(projected) - sum(map(len, rows)))])
        spread = root @ (root.T @ (projected * scale[:, None]).T)
        left = self.deviations / self.information.deviations()  # what the limits leave
        return np.asarray(left * np.sqrt(np.sum(spread**2, axis=1)))

    @property
    def true(self) -> Array:
        """True values of the parameters (p), NaN where they are not known."""
        return truths(self.likelihood.unknowns)

    @property
    def values(self) -> Array:
        """The estimates (p)."""
        unknowns = self.likelihood.unknowns
        fixed = self.likelihood.priors.fixed  # theirs without the round-off of a logarithm
        estimates = self._within_limits(values(unknowns, self.fit.eta))
        return np.where(fixed, [unknown.start for unknown in unknowns], estimates)

    @property
    def rates(self) -> Array:
        """Derivatives of the parameters by their coordinates at the estimate (p)."""
        return rates(self.likelihood.unknowns, self.fit.eta)

    @cached_property
    def bound(self) -> Array:
        """The Cramér–Rao bound (p), at the true values and noise where they are known, with the priors."""
        return self.bound_with(prior=True)

    def bound_with(self, *, prior: bool) -> Array:
        """Return the bound (p), with the priors or of the records alone: infinite where not identifiable."""
        likelihood, fit, rate, true = self.likelihood, self.fit, self.rates, self.true
        ideal = not np.isnan(true).any()
        if ideal:
            likelihood = self.likelihood.ideal
            fit = likelihood.at_truth
            rate = rates(likelihood.unknowns, fit.eta)
        pairs = zip(self.likelihood.records, self.noise, strict=True)
        noise = [record.level(estimated, ideal=ideal) for record, estimated in pairs]
        if not all(level.all() for level in noise):
            return np.zeros(len(true))  # clean data
        information = likelihood.information(fit, noise, prior=prior)
        if not prior:
            try:
                information.check()
            except NotIdentifiable:
                return np.full(len(rate), np.inf)
        deviations = information.deviations()
        return np.where(likelihood.priors.open(deviations), np.inf, rate * deviations)

    @property
    def error_in_bounds(self) -> Array:
        """Distance of the estimates from the true values in bounds (p), NaN where the truth is not known."""
        off = np.abs(self.values - self.true)
        return np.where(
            self.bound > 0, off / np.maximum(self.bound, _MIN_REL_BOUND * np.abs(self.true)), np.nan
        )

    @property
    def calibration_slopes(self) -> CalibrationSlopes:
        """Slopes of the estimates by the gains and delay of the instruments."""
        return calibration_slopes(self.likelihood, self.fit, self.noise, self.held)

    @property
    def considered_deviations(self) -> Array | None:
        """Deviations of the coordinates (p) with the effect of considered parameters; None without such."""
        system = self.likelihood.records[0].considered
        if not system:
            return None
        slopes, deviations = (
            self.calibration_slopes,
            {parameter.name: parameter.deviation for parameter in system},
        )
        sizes = np.array([deviations.get(name, 0.0) for name in slopes.quantities])
        return np.asarray(np.hypot(self.deviations, np.linalg.norm(slopes.slopes * sizes, axis=1)))

    # Convergence, and tests of the model.

    @cached_property
    def comparison(self) -> ModelComparison:
        """The scene's model compared with no model and with the saturated one."""
        comparison = self.estimate.comparison
        return (
            compare_models(self.likelihood, self.fit, self.whiteness_p) if comparison is None else comparison
        )

    @cached_property
    def optimal(self) -> bool:
        """True if the estimate is at the optimum."""
        return is_optimal(self.step, self.deviations) and not self.estimate.disputed

    @property
    def ambiguous(self) -> bool:
        """True if another optimum explains the records as well, and neither priors nor limits decide."""
        return self.optima is not None and self.optima.ambiguous

    @property
    def converged(self) -> bool:
        """True if the estimate is at the one optimum, and the model explains what could contradict it."""
        explained = self.rejection is None and self.comparison.explained
        unique = not (self.ambiguous or self.undetermined)
        return self.optimal and explained and self.comparison.redundancy > 0 and unique

    @cached_property
    def free_information(self) -> Information:
        """The Fisher information as if no undetermined parameter were fixed."""
        fits = zip(self.likelihood.records, self.fit.parts, self.noise, strict=True)
        information = joint_information(
            [record.information(record_fit, level) for record, record_fit, level in fits]
        )
        return information.with_rows(self.likelihood.priors.rows(fixed=False))

    @cached_property
    def identifiable(self) -> NDArray[np.bool_]:
        """Mask of parameters that the records and priors determine by themselves (p)."""
        names = self.likelihood.names
        if not self.undetermined:
            return np.ones(len(names), dtype=bool)
        bounds, log = self.free_information.bounds(), logarithmic(self.likelihood.unknowns)
        held = np.array([name in self.undetermined for name in names])
        return np.asarray(np.isfinite(bounds) & ~held & ~(log & (bounds > _UNKNOWN_LOG_DEVIATION)))

    @cached_property
    def unknown(self) -> NDArray[np.bool_]:
        """Mask of parameters of which not even the order of magnitude is known (p).

        The standard error of the logarithm exceeds 10, and the records admit ten times the estimate or a
        tenth of it. They do not where it is the derivative alone that vanishes: halfway between the optima of
        interchangeable parameters, where these are equal. Or the records admit both a thousand times the
        estimate and a thousandth of it, whatever the derivatives at an optimum that noise made.
        """
        uncertain = logarithmic(self.likelihood.unknowns) & (self.deviations > UNCERTAIN)
        uncertain &= ~self.likelihood.priors.limited
        if not np.any(
            self.deviations[~self.likelihood.priors.fixed] <= UNCERTAIN
        ):  # the records have to know another one for that
            uncertain &= self.deviations > _UNKNOWN_LOG_DEVIATION
        unknown = np.zeros(len(uncertain), dtype=bool)
        for k in np.flatnonzero(uncertain).tolist():
            eta, far = float(self.fit.eta[k]), self.deviations[k] > _UNKNOWN_LOG_DEVIATION
            ends = (self._accepted(k, eta + side * (_TENFOLD if far else _FAR_DISTANCE)) for side in (1, -1))
            unknown[k] = any(ends) if far else all(ends)
        return unknown

    def admitted(self, k: int) -> float:
        """Return the coordinate nearest to the start (or prior) of a parameter that the records admit.

        The others follow. If that is not the start, it lies between the start and the estimate.
        """
        unknown, eta = self.likelihood.unknowns[k], float(self.fit.eta[k])
        start = unknown.coordinate(unknown.start)
        for fraction in _TOWARDS_START:
            if self._accepted(k, coordinate := eta + fraction * (start - eta), _ADMITTED):
                return coordinate
        return eta

    def check(self) -> None:
        """Refuse estimates whose prediction does not explain the records.

        The prediction must explain a part of the records as a whole; and the residual of a channel may exceed
        half of its signal only where it is white noise. Records without any response are not refused: the
        verdict states that.

        Raises Diverged, naming the parameters; or those without effect at the end of a search that found no
        optimum. Raises NotIdentifiable, naming those whose order of magnitude the records do not determine.
        """
        unexplained = self.unexplained
        unknown = np.zeros(len(self.values), dtype=bool) if unexplained else self.unknown
        # Of a record that is noise alone there is no estimate to refuse; the verdict states that.
        if (unexplained or unknown.any()) and not self.comparison.has_signal:
            return
        names = self.likelihood.names
        if unexplained:
            several = len(names) > 1
            raise Diverged(
                f"the estimate{'s' * several} of {', '.join(names)} {'are' if several else 'is'} invalid: "
                f"{unexplained}",
                remedy=self.likelihood.records[0].observed.astray
                if self.likelihood.records[0].modal
                else "Start nearer to the true values, add passes, or check model, units and excitation: a "
                "joint may be nonlinear (friction, gap, a stiffness that depends on the amplitude).",
                names=names,
            )
        if unknown.any():
            lost = [
                name for name, yes in zip(names, unknown, strict=True) if yes or name in self.undetermined
            ]
            if self.estimate.disputed:
                raise Diverged(
                    f"{self.estimate.counts['starts']} starts ended at different optima, none of which "
                    f"explains the {self.noun}{'s' * self.several}; at the best of them, {', '.join(lost)} "
                    f"no longer {'have' if len(lost) > 1 else 'has'} any effect",
                    remedy="Start nearer to the true values, bound the unknowns, or check the model.",
                    names=lost,
                )
            vanishing = self.indistinguishable_from_zero
            if zero := [name for name, yes in zip(names, vanishing & unknown, strict=True) if yes]:
                raise vanished(zero, self.noun)
            raise below_noise(lost, self.likelihood.records[0].observed)

    @cached_property
    def indistinguishable_from_zero(self) -> NDArray[np.bool_]:
        """Mask of logarithmic parameters of which the records give no more than an upper limit (p).

        The standard error of the logarithm exceeds 0.5; by likelihood ratio, the other parameters moved to
        their optimum, a thousandth of the estimate is within the 95 % interval, and the start or, if that is
        more, a thousand times the estimate is not.
        """
        uncertain = self.relative_errors > UNCERTAIN
        indistinguishable, eta = np.zeros(len(uncertain), dtype=bool), self.fit.eta
        for k in np.flatnonzero(uncertain).tolist():
            unknown = self.likelihood.unknowns[k]
            large = max(eta[k] + _FAR_DISTANCE, unknown.coordinate(unknown.start))
            indistinguishable[k] = self._accepted(k, eta[k] - _FAR_DISTANCE) and not self._accepted(k, large)
        return indistinguishable

    def _accepted(self, k: int, coordinate: float, ratio: float = _HALF_CHI_SQUARED) -> bool:
        """Return True if a coordinate of a parameter raises the misfit by no more than `ratio`."""
        # By default that of its 95 % interval by likelihood ratio.
        return Profile(self.likelihood, self.fit, k).at(coordinate).rise <= ratio
