"""Likelihood of records that share their parameters, with the priors of these.

Every record has its own loads, channels, sampling, noise and unknown initial state, or is a set of frequency
responses. Records are independent given the parameters: their likelihoods multiply, and information adds up.
A prior counts as an independent measurement.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Self
from weakref import WeakKeyDictionary

import numpy as np

from dynid.arrays import Array
from dynid.identification.information import Information, joint_information
from dynid.identification.likelihood.priors import PULL, Priors
from dynid.identification.likelihood.record_likelihood import RecordFit, RecordLikelihood
from dynid.identification.residual_tests import whiteness
from dynid.parameters import Parameter, coordinates, truths

# Informations that are kept of a fit: for the noise of a maximum of the likelihood, and an unbiased one.
_KEPT = 2


@dataclass(frozen=True, eq=False)
class Fit:
    """The fits of all records, in their order, at coordinates `eta` of the parameters (p)."""

    eta: Array
    parts: tuple[RecordFit, ...]

    @property
    def noise(self) -> list[Array]:
        """Standard deviations of the noise (channels) of each record, estimated from its residuals."""
        return [record_fit.noise for record_fit in self.parts]

    @property
    def residuals(self) -> list[Array]:
        """Residuals of each record (times x channels), NaN where missing."""
        return [record_fit.residual for record_fit in self.parts]


@dataclass(frozen=True, eq=False)
class Likelihood:
    """The likelihood of all records, as a function of the parameters, with their priors."""

    records: tuple[RecordLikelihood, ...]  # one or more, all with the same unknowns
    # The likelihood of the records without noise, if it is computed already.
    noiseless: Likelihood | None = field(default=None, kw_only=True)
    # Deviation of the pull of parameters to the middle of their limits, over the distance of these.
    pull: float = field(default=PULL, kw_only=True)
    # Priors and limits in place of those of the unknowns.
    stated_priors: Priors | None = field(default=None, kw_only=True)
    _last: WeakKeyDictionary[Fit, dict[tuple[Any, ...], Information]] = field(
        default_factory=WeakKeyDictionary, init=False, repr=False
    )

    @property
    def ideal(self) -> Likelihood:
        """The likelihood of the records without noise, as far as that is known."""
        white = all(record.data.colour is None for record in self.records)
        if self.noiseless is not None and white:
            return self.noiseless
        return Likelihood(tuple(record.ideal() for record in self.records))

    @cached_property
    def at_truth(self) -> Fit:
        """The fit at the true values, all of which are known."""
        return self.fit(coordinates(self.unknowns, truths(self.unknowns)))

    @property
    def unknowns(self) -> tuple[Parameter, ...]:
        """The unknown parameters (p)."""
        return self.records[0].unknowns

    @cached_property
    def priors(self) -> Priors:
        """Priors and limits of the parameters."""
        return self.stated_priors or Priors.of(self.unknowns, self.pull)

    @property
    def evaluations(self) -> int:
        """Number of responses computed so far."""
        return sum(record.system_model.evaluations for record in self.records)

    @property
    def most_evaluations(self) -> float:
        """Most evaluations that a search may take."""
        return math.inf

    def shortened(self, eta: Array) -> Self:  # noqa: ARG002
        """Return the likelihood of the first parts of large records at coordinates (p); itself of others."""
        return self

    @property
    def names(self) -> list[str]:
        """Names of the unknown parameters."""
        return [unknown.name for unknown in self.unknowns]

    def fit(self, eta: Array, noise: Sequence[Array] | None = None, *, clean: bool = False) -> Fit:
        """Fit the initial states at coordinates of the parameters (p).

        `noise`: standard deviations that weight the channels of each record; default: their RMS. `clean`: to
        the records without their noise, where these are known.
        """
        parts = []
        for k, record in enumerate(self.records):
            values = record.data.values
            if clean and record.data.clean is not None:
                values = record.data.clean
            parts.append(record.fit(eta, values, None if noise is None else noise[k]))
        return Fit(eta, tuple(parts))

    def information(self, fit: Fit, noise: Sequence[Array], *, prior: bool = True) -> Information:
        """Return the information on the parameters of a fit, for a noise of these deviations.

        With the priors, or of the records alone. The last two of a fit are kept, as long as it is.
        """
        kept = self._last.setdefault(fit, {})
        key = (prior, *(level.tobytes() for level in noise))
        if key not in kept:
            fits = zip(self.records, fit.parts, noise, strict=True)
            total = joint_information(
                [record.information(record_fit, level) for record, record_fit, level in fits]
            )
            total = total.with_rows(self.priors.rows()) if prior else total
            while len(kept) >= _KEPT:
                del kept[next(iter(kept))]
            kept[key] = total
        return kept[key]

    def weighted(self, fit: Fit, noise: Sequence[Array]) -> Array:
        """Return the residuals over noise, row by row as the information has them, priors at the end."""
        fits = zip(self.records, fit.parts, noise, strict=True)
        measured = [record.weighted(record_fit, level) for record, record_fit, level in fits]
        return np.concatenate([*measured, self.priors.residual(fit.eta)])

    def misfit(self, fit: Fit) -> float:
        """Return minus the logarithm of the likelihood, priors included, up to a constant.

        The noise of a channel whose deviation is not given is its maximum-likelihood estimate.
        """
        return self._prior_misfit(fit.eta) + self.record_misfit(fit)

    def misfit_at(self, eta: Array) -> float:
        """Return the misfit at these coordinates (p), without the derivatives that a fit has."""
        parts = [record.misfit(record.data.counts, record.residual_rms_at(eta)) for record in self.records]
        return self._prior_misfit(eta) + sum(parts)

    def misfits_at(self, etas: Array) -> Array:
        """Return the misfits at coordinates (count x p), NaN where there is no prediction."""
        misfits = np.array([self._prior_misfit(eta) for eta in etas])
        for record in self.records:
            sizes = record.residual_rms_of(etas)
            misfits += [record.misfit(record.data.counts, size) for size in sizes]
        return misfits

    def record_misfit(self, fit: Fit) -> float:
        """Return the misfit of the records alone, without the priors."""
        fits = zip(self.records, fit.parts, strict=True)
        return sum(record.misfit(record_fit.counts, record_fit.size) for record, record_fit in fits)

    def _prior_misfit(self, eta: Array) -> float:
        return float(np.sum(self.priors.residual(eta) ** 2)) / 2

    def likeliest(self, fit: Fit) -> list[Array]:
        """Return the noise given, else the RMS of the residuals, not below rounding (channels)."""
        fits = zip(self.records, fit.parts, strict=True)
        return [record.above_rounding(record_fit.size) for record, record_fit in fits]

    def residual_ratio(self, fit: Fit) -> Array:
        """Return the RMS of the residuals over that of the measured values (channels of all records)."""
        fits = zip(self.records, fit.parts, strict=True)
        return np.concatenate(
            [record.unwhitened_rms(record_fit) / record.data.rms for record, record_fit in fits]
        )

    # Noise model.

    @property
    def modelled(self) -> bool:
        """True if a model of the noise is to be estimated together with the parameters."""
        return any(record.modelled for record in self.records)

    def renewed(self, fit: Fit, *, settling: bool = False) -> Self:
        """Return the likelihood with the noise models of a fit; `settling`: of the orders that they have."""
        root = self.information(fit, self.likeliest(fit)).root
        fits = zip(self.records, fit.parts, strict=True)
        renewed = tuple(record.renewed(record_fit, root, settling=settling) for record, record_fit in fits)
        return replace(self, records=renewed)

    def with_noise_of(self, likelihood: Likelihood) -> Self:
        """Return the likelihood with the noise models of another one of the same records."""
        pairs = zip(self.records, likelihood.records, strict=True)
        return replace(self, records=tuple(record.with_noise_of(renewed) for record, renewed in pairs))

    def continuing(self, likelihood: Likelihood) -> Self:
        """Return the likelihood with the samples of another one of the same records."""
        pairs = zip(self.records, likelihood.records, strict=True)
        return replace(self, records=tuple(record.continuing(continued) for record, continued in pairs))

    def covering(self, eta: Array, *, narrowed: bool) -> Self:
        """Return the likelihood of records where every input is known at coordinates `eta`; itself if it is.

        `narrowed`: of all such samples; else of the present ones alone.
        """
        records = tuple(record.covering(eta, narrowed=narrowed) for record in self.records)
        same = all(new is old for new, old in zip(records, self.records, strict=True))
        return self if same else replace(self, records=records, noiseless=None)

    def whiteness(self, fit: Fit) -> float:
        """Return the p-value of the residuals' whiteness."""
        pairs = zip(self.records, fit.residuals, strict=True)
        series = (record.series(residual) for record, residual in pairs)
        return whiteness(*series, coefficients=[int(record.noise_orders.sum()) for record in self.records])
