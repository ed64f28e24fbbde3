"""Likelihood of records that share their parameters, with priors and bounds of these.

Every record has its own loads, channels, sampling, noise and unknown initial state, or is a set of frequency
responses. Records are independent given the parameters: their likelihoods multiply, and information adds up.
A prior counts as an independent measurement.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dynid.identification.filter import FilterPrior
from dynid.identification.information import Information, joint_information
from dynid.identification.record_likelihood import RecordFit, RecordLikelihood
from dynid.identification.residual_tests import whiteness
from dynid.identification.statistics import root_mean_square
from dynid.structure.joints import Unknown

Array = NDArray[np.float64]

# Residuals below this part of a channel's RMS are rounding.
_ROUNDING = 1e-13
# Information of the records on a parameter, relative to that of its prior, below which the two are not
# compared.
_INFORMATIVE = 1e-6


@dataclass(frozen=True, eq=False)
class Priors:
    """Bounds and priors of the logarithms of the parameters.

    Attributes
    ----------
    low, high
        Bounds (p), infinite where there are none.
    means, deviations
        Priors (p), NaN where there are none.
    """

    low: Array
    high: Array
    means: Array
    deviations: Array

    @classmethod
    def of(cls, unknowns: Sequence[Unknown]) -> Priors:
        """Return the priors and bounds of unknowns.

        The deviation of the logarithm is that of the log-normal distribution of the same relative deviation.
        """
        low = [math.log(unknown.low) if unknown.low else -math.inf for unknown in unknowns]
        high = [math.log(unknown.high) if unknown.high else math.inf for unknown in unknowns]
        beliefs = [unknown.belief for unknown in unknowns]
        means = [math.nan if belief is None else math.log(belief.value) for belief in beliefs]
        deviations = [
            math.nan if belief is None else math.sqrt(math.log1p(belief.relative_deviation**2))
            for belief in beliefs
        ]
        return cls(np.array(low), np.array(high), np.array(means), np.array(deviations))

    @property
    def given(self) -> NDArray[np.bool_]:
        """Mask of parameters that have a prior (p)."""
        return ~np.isnan(self.means)

    def clipped(self, logs: Array) -> Array:
        """Return the nearest logarithms within the bounds (p)."""
        return np.clip(logs, self.low, self.high)

    def at_bound(self, logs: Array) -> NDArray[np.bool_]:
        """Return the mask of logarithms that are at a bound (p)."""
        return (logs <= self.low) | (logs >= self.high)

    def blocked(self, logs: Array, direction: Array) -> NDArray[np.bool_]:
        """Return the mask of logarithms that a bound keeps from moving in this direction (p)."""
        return ((logs <= self.low) & (direction < 0)) | ((logs >= self.high) & (direction > 0))

    def rows(self) -> Array:
        """Return the sensitivities of the priors' pseudo-observations over their deviations (count x p)."""
        return np.asarray(np.diag(1 / self.deviations)[self.given])

    def residual(self, logs: Array) -> Array:
        """Return the residuals of the pseudo-observations over their deviations (count)."""
        return np.asarray(((self.means - logs) / self.deviations)[self.given])

    def conflict(self, logs: Array, deviations: Array) -> Array:
        """Return how far priors and records are apart, in deviations of that distance (p); 0 without a prior.

        It is the normalised residual of a pseudo-observation: its residual at the estimate over the deviation
        of that residual. 0 where the information of the records is less than a millionth of the prior's.

        Parameters
        ----------
        logs, deviations
            The estimate, and its deviations with the priors (p).
        """
        free = 1 - (deviations / self.deviations) ** 2
        compared = self.given & (free > _INFORMATIVE)
        apart = np.abs(self.means - logs) / self.deviations
        return np.where(compared, apart / np.sqrt(np.where(compared, free, 1.0)), 0.0)

    def combined(self, prior: FilterPrior) -> FilterPrior:
        """Return the prior of a filter's pass, updated by the pseudo-observations."""
        n = len(prior.state)
        z, S = np.concatenate([prior.state, prior.logs]), prior.root.copy()
        for k in np.flatnonzero(self.given):
            phi = S[n + k] / self.deviations[k]
            spread = float(phi @ phi) + 1.0
            gain = S @ phi / spread
            z += gain * (self.means[k] - z[n + k]) / self.deviations[k]
            S -= np.outer(gain / (1 + math.sqrt(1 / spread)), phi)
        return FilterPrior(z[:n], z[n:], S)


@dataclass(frozen=True, eq=False)
class Fit:
    """The fits of all records at the same parameters.

    Attributes
    ----------
    logs
        Logarithms of the parameters (p).
    parts
        One fit a record.
    """

    logs: Array
    parts: tuple[RecordFit, ...]

    @property
    def noise(self) -> list[Array]:
        """Standard deviations of the noise (channels) of each record, estimated from its residuals."""
        return [part.noise for part in self.parts]

    @property
    def residuals(self) -> list[Array]:
        """Residuals of each record (times x channels), NaN where missing."""
        return [part.residual for part in self.parts]


@dataclass(frozen=True, eq=False)
class Likelihood:
    """The likelihood of all records, as a function of the parameters, with their priors.

    Attributes
    ----------
    records
        One or more, all with the same unknowns.
    noiseless
        The likelihood of the records without noise, if it is computed already.
    """

    records: tuple[RecordLikelihood, ...]
    noiseless: Likelihood | None = field(default=None, kw_only=True)

    @property
    def ideal(self) -> Likelihood:
        """The likelihood of the records without noise, as far as that is known."""
        if self.noiseless is not None:
            return self.noiseless
        return Likelihood(tuple(record.on(record.data.without_noise()) for record in self.records))

    @cached_property
    def at_truth(self) -> Fit:
        """The fit at the true values, all of which are known."""
        return self.fit(np.log([unknown.true or np.nan for unknown in self.unknowns]))

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        """The unknown parameters (p)."""
        return self.records[0].unknowns

    @cached_property
    def priors(self) -> Priors:
        """Priors and bounds of the parameters."""
        return Priors.of(self.unknowns)

    @property
    def names(self) -> list[str]:
        """Names of the unknown parameters."""
        return [unknown.name for unknown in self.unknowns]

    def fit(self, logs: Array, noise: Sequence[Array] | None = None, *, clean: bool = False) -> Fit:
        """Fit the initial states at the parameters exp(logs).

        Parameters
        ----------
        logs
            Logarithms of the parameters (p).
        noise
            Standard deviations that weight the channels of each record; absent: their RMS.
        clean
            True: fit the records without their noise, where these are known.
        """
        parts = []
        for k, record in enumerate(self.records):
            values = record.data.values
            if clean and record.data.clean is not None:
                values = record.data.clean
            parts.append(record.fit(logs, values, None if noise is None else noise[k]))
        return Fit(logs, tuple(parts))

    def information(self, fit: Fit, noise: Sequence[Array], *, prior: bool = True) -> Information:
        """Return the information on the parameters of a fit, for a noise of these deviations.

        With the priors, or of the records alone.
        """
        each = zip(self.records, fit.parts, noise, strict=True)
        found = joint_information([record.information(part, level) for record, part, level in each])
        return found.beside(self.priors.rows()) if prior else found

    def weighted(self, fit: Fit, noise: Sequence[Array]) -> Array:
        """Return the residuals over noise, row by row as the information has them, priors at the end."""
        each = zip(self.records, fit.parts, noise, strict=True)
        measured = [record.weighted(part, level) for record, part, level in each]
        return np.concatenate([*measured, self.priors.residual(fit.logs)])

    def misfit(self, fit: Fit) -> float:
        """Return minus the logarithm of the likelihood, priors included, up to a constant.

        The noise of a channel whose deviation is not given is its maximum-likelihood estimate.
        """
        return self._misfit(fit.logs, [part.counts for part in fit.parts], [part.size for part in fit.parts])

    def misfit_at(self, logs: Array) -> float:
        """Return the misfit at these logarithms (p), without the derivatives that a fit has."""
        sizes = [root_mean_square(record.residual(logs)) for record in self.records]
        return self._misfit(logs, [record.data.counts for record in self.records], sizes)

    def _misfit(self, logs: Array, counts: Sequence[NDArray[np.int_]], sizes: Sequence[Array]) -> float:
        total = float(np.sum(self.priors.residual(logs) ** 2)) / 2
        for record, count, size in zip(self.records, counts, sizes, strict=True):
            level = _likeliest(record, size)
            squares = np.where(np.isnan(record.given), 0.0, size / level) ** 2
            total += float(count @ (np.log(level) + squares / 2))
        return total

    def likeliest(self, fit: Fit) -> list[Array]:
        """Return the noise given, else the RMS of the residuals, not below rounding (channels)."""
        each = zip(self.records, fit.parts, strict=True)
        return [_likeliest(record, part.size) for record, part in each]

    def residual_ratio(self, fit: Fit) -> Array:
        """Return the RMS of the residuals over that of the measured values (channels of all records)."""
        each = zip(self.records, fit.parts, strict=True)
        return np.concatenate([part.size / record.data.rms for record, part in each])

    def whiteness(self, fit: Fit) -> float:
        """Return the p-value of the residuals' whiteness."""
        each = zip(self.records, fit.residuals, strict=True)
        return whiteness(*(record.series(residual) for record, residual in each))


def _likeliest(record: RecordLikelihood, size: Array) -> Array:
    """Return the noise given, else this RMS of the residuals, not below rounding (channels)."""
    return record.given_or(np.hypot(size, _ROUNDING * record.data.rms))
