"""Records that share their parameters, fitted together; one record is an ensemble of one.

Every record has its own loads, channels, sampling, noise and unknown initial state. The records are
independent given the parameters: likelihoods add up, and so does the information.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dynid.identification.diagnostics import root_mean_square, whiteness
from dynid.identification.fit import Fitter
from dynid.identification.information import Information, joined
from dynid.identification.knowledge import Knowledge
from dynid.identification.observed import Fit, Observed
from dynid.structure.joints import Unknown

Array = NDArray[np.float64]

# Residuals below this part of a channel's RMS are rounding.
_ROUNDING = 1e-13


@dataclass(frozen=True, eq=False)
class JointFit:
    """The fits of all records at the same parameters.

    Attributes
    ----------
    logs
        Logarithms of the parameters (p).
    parts
        One fit a record.
    """

    logs: Array
    parts: tuple[Fit, ...]

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
    """The likelihood of all that is observed, as a function of the parameters.

    Attributes
    ----------
    records
        What is observed, all with the same unknowns.
    noiseless
        The same without its noise, if it is made already.
    """

    records: tuple[Observed, ...]
    noiseless: Likelihood | None = field(default=None, kw_only=True)

    @property
    def ideal(self) -> Likelihood:
        """The same without the records' noise, as far as that is known."""
        if self.noiseless is not None:
            return self.noiseless
        return Likelihood(tuple(record.on(record.data.without_noise()) for record in self.records))

    @cached_property
    def at_truth(self) -> JointFit:
        """The fit at the true values, all of which are known."""
        return self.fit(np.log([unknown.true or np.nan for unknown in self.unknowns]))

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        """The unknown parameters (p)."""
        return self.records[0].unknowns

    @cached_property
    def knowledge(self) -> Knowledge:
        """What is known of the parameters besides the records."""
        return Knowledge.of(self.unknowns)

    @property
    def names(self) -> list[str]:
        """Names of the unknown parameters."""
        return [unknown.name for unknown in self.unknowns]

    def fit(self, logs: Array, noise: Sequence[Array] | None = None, *, clean: bool = False) -> JointFit:
        """Fit the initial states at the parameters exp(logs).

        Parameters
        ----------
        logs
            Logarithms of the parameters (p).
        noise
            What the channels of each record count by; absent: their RMS.
        clean
            Whether to fit the records without their noise, where these are known.
        """
        parts = []
        for k, record in enumerate(self.records):
            values = record.data.values
            if clean and record.data.clean is not None:
                values = record.data.clean
            parts.append(record.fit(logs, values, None if noise is None else noise[k]))
        return JointFit(logs, tuple(parts))

    def information(self, fit: JointFit, noise: Sequence[Array], *, prior: bool = True) -> Information:
        """Return the information on the parameters of a fit, for a noise of these deviations.

        With what is known beforehand, or of the records alone.
        """
        each = zip(self.records, fit.parts, noise, strict=True)
        found = joined([record.information(part, level) for record, part, level in each])
        return found.beside(self.knowledge.rows()) if prior else found

    def weighted(self, fit: JointFit, noise: Sequence[Array]) -> Array:
        """Return the residuals over noise, row by row as the information has them, priors at the end."""
        each = zip(self.records, fit.parts, noise, strict=True)
        measured = [record.weighted(part, level) for record, part, level in each]
        return np.concatenate([*measured, self.knowledge.residual(fit.logs)])

    def misfit(self, fit: JointFit) -> float:
        """Return minus the logarithm of the likelihood, priors included, up to a constant.

        The noise of a channel whose deviation is not given is the one that makes the likelihood largest.
        """
        return self._misfit(fit.logs, [part.counts for part in fit.parts], [part.size for part in fit.parts])

    def misfit_at(self, logs: Array) -> float:
        """Return the misfit of the fit at these logarithms (p), without making the rest of it."""
        sizes = [root_mean_square(record.residual(logs)) for record in self.records]
        return self._misfit(logs, [record.data.counts for record in self.records], sizes)

    def _misfit(self, logs: Array, counts: Sequence[NDArray[np.int_]], sizes: Sequence[Array]) -> float:
        total = float(np.sum(self.knowledge.residual(logs) ** 2)) / 2
        for record, count, size in zip(self.records, counts, sizes, strict=True):
            level = _likeliest(record, size)
            squares = np.where(np.isnan(record.given), 0.0, size / level) ** 2
            total += float(count @ (np.log(level) + squares / 2))
        return total

    def likeliest(self, fit: JointFit) -> list[Array]:
        """Return the noise given, else the RMS of the residuals, not below rounding (channels)."""
        each = zip(self.records, fit.parts, strict=True)
        return [_likeliest(record, part.size) for record, part in each]

    def residual_ratio(self, fit: JointFit) -> Array:
        """Return the RMS of the residuals over that of the measured values (channels of all records)."""
        each = zip(self.records, fit.parts, strict=True)
        return np.concatenate([part.size / record.data.rms for record, part in each])

    def whiteness(self, fit: JointFit) -> float:
        """Return the p-value of the residuals' whiteness."""
        each = zip(self.records, fit.residuals, strict=True)
        return whiteness(*(record.series(residual) for record, residual in each))


def _likeliest(record: Observed, size: Array) -> Array:
    """Return the noise given, else this RMS of the residuals, not below rounding (channels)."""
    return record.known_or(np.hypot(size, _ROUNDING * record.data.rms))


@dataclass(frozen=True, eq=False)
class Ensemble(Likelihood):
    """Records of time that share their parameters.

    Attributes
    ----------
    records
        One fitter a record, all of the same unknowns.
    """

    records: tuple[Fitter, ...]
