"""What an estimate is worth, whatever it was made from: error bars, bounds, residuals, verdict."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from dynid.errors import Diverged, NotIdentifiable
from dynid.identification.diagnostics import is_coloured, is_explained, whiteness
from dynid.identification.ensemble import JointFit, Likelihood
from dynid.identification.estimators.estimation import Estimation
from dynid.identification.information import Information, untold
from dynid.identification.model_error import ModelError
from dynid.identification.residuals import Consistency
from dynid.identification.verdict import Sensor

Array = NDArray[np.float64]

# Residuals above this part of a channel's RMS void the estimates if they are not noise …
_VOID = 0.5
# … and above this one (all channels together) whatever they are.
_NOTHING = 1.0
# A standard error of the logarithm beyond which not even the order of magnitude is known: a factor of e^10.
_BLIND = 10.0


class Named(Protocol):
    """Something measured."""

    @property
    def name(self) -> str:
        """Its name."""

    @property
    def unit(self) -> str:
        """Its unit, SI."""


class Place(NamedTuple):
    """Record and column of a channel, its name in results and its unit."""

    record: int
    column: int
    name: str
    unit: str


@dataclass(frozen=True, eq=False)
class Findings(ABC):
    """What an identification found.

    Attributes
    ----------
    ensemble
        The likelihood of what was observed.
    method
        Name of the estimator.
    estimation
        What the estimator found.
    model_error
        What the reduction of the model does to it, if it is reduced.
    """

    ensemble: Likelihood
    method: str
    estimation: Estimation
    model_error: ModelError | None = field(default=None, kw_only=True)

    @property
    @abstractmethod
    def measured(self) -> Sequence[Sequence[Named]]:
        """What is measured, record by record."""

    @property
    @abstractmethod
    def word(self) -> str:
        """What a record is called."""

    @property
    def sensors(self) -> Sequence[Sensor]:
        """The channels as records of time, to look for what goes wrong with these."""
        return ()

    @property
    def consistency(self) -> Consistency | None:
        """How consistent the innovations of a filter are."""
        return None

    @property
    def remarks(self) -> Sequence[str]:
        """What else to be wary of, in words."""
        return ()

    @property
    def residual_rms(self) -> Array:
        """RMS of the residuals (channels of all records), in the channels' units."""
        return np.concatenate([part.size for part in self.final.parts])

    @property
    def final(self) -> JointFit:
        """The fit at the estimate."""
        return self.estimation.fit

    @property
    def noise(self) -> list[Array]:
        """Noise given or seen in the residuals; not below rounding, so that it can be divided by."""
        each = zip(self.final.noise, self.ensemble.records, strict=True)
        return [np.maximum(noise, np.finfo(float).eps * record.data.rms) for noise, record in each]

    @cached_property
    def information(self) -> Information:
        """The Fisher information at the estimate, for the noise given or seen in the residuals."""
        return self.ensemble.information(self.final, self.noise)

    @cached_property
    def whiteness_p(self) -> float:
        """The p-value of the residuals' whiteness."""
        return self.ensemble.whiteness(self.final)

    @cached_property
    def residual_ratio(self) -> Array:
        """RMS of the residuals over that of the measured values (channels of all records)."""
        return self.ensemble.residual_ratio(self.final)

    @property
    def explained(self) -> bool:
        """Whether the residuals are small, or noise."""
        return is_explained(self.residual_ratio, self.whiteness_p)

    @cached_property
    def step(self) -> Array:
        """The Gauss–Newton step from the estimate to the optimum of the records, in logarithms (p)."""
        residual = self.ensemble.weighted(self.final, self.noise)
        direction = self.information.projected.T @ residual
        held = self.ensemble.knowledge.blocked(self.final.logs, direction)
        return self.information.without(held).step(residual)

    @cached_property
    def channels(self) -> list[Place]:
        """All channels, record by record."""
        return [
            Place(k, column, f"record_{k + 1}.{channel.name}" if self.several else channel.name, channel.unit)
            for k, channels in enumerate(self.measured)
            for column, channel in enumerate(channels)
        ]

    def series(self, place: Place) -> Array:
        """Return what should be white of a channel (rows x columns)."""
        residual = self.final.residuals[place.record][:, [place.column]]
        return self.ensemble.records[place.record].series(residual)

    @property
    def several(self) -> bool:
        """Whether there is more than one record."""
        return len(self.measured) > 1

    def check(self) -> None:
        """Refuse estimates whose prediction does not explain the records.

        The prediction must explain some of the records as a whole; and what it leaves of a channel may be
        more than half only where that looks like white noise.

        Raises
        ------
        Diverged
            Naming the parameters.
        NotIdentifiable
            Naming those of which the records tell nothing, not even the order of magnitude.
        """
        each = zip(self.ensemble.records, self.final.parts, strict=True)
        # Corrected for what the fit takes up of any record.
        left = np.concatenate([record.scatter(p.counts, p.size) / record.data.rms for record, p in each])
        if not np.mean(left**2) < _NOTHING**2:
            raise _void(
                self.ensemble, f"the prediction explains nothing of the {self.word}{'s' * self.several}"
            )
        for unexplained, place in zip(left, self.channels, strict=True):
            if unexplained > _VOID and is_coloured(whiteness(self.series(place))):
                raise _void(
                    self.ensemble,
                    f"{100 * unexplained:.0f} % of {place.name} is unexplained, and what is left is no noise",
                )
        blind = self.information.deviations() > _BLIND
        if blind.any():
            raise untold([name for name, yes in zip(self.ensemble.names, blind, strict=True) if yes])

    @property
    def true(self) -> Array:
        """True values of the parameters (p), NaN where they are not known."""
        unknowns = self.ensemble.unknowns
        return np.array([np.nan if unknown.true is None else unknown.true for unknown in unknowns])

    @cached_property
    def bound(self) -> Array:
        """The Cramér–Rao bound (p), at the true values and noise where they are known, with the priors."""
        return self.bound_with(prior=True)

    def bound_with(self, *, prior: bool) -> Array:
        """Return the bound (p), with the priors or of the records alone: infinite if these see nothing."""
        told_by, fit, values, true = self.ensemble, self.final, np.exp(self.final.logs), self.true
        if not np.isnan(true).any():
            told_by = self.ensemble.ideal
            fit, values = told_by.at_truth, true
        each = zip(self.ensemble.records, self.noise, strict=True)
        noise = [seen if record.data.noise is None else record.data.noise for record, seen in each]
        if not all(level.all() for level in noise):
            return np.zeros(len(true))  # clean data
        told = told_by.information(fit, noise, prior=prior)
        if not prior:
            try:
                told.check()
            except NotIdentifiable:
                return np.full(len(values), np.inf)
        return np.asarray(values * told.deviations())


def _void(ensemble: Likelihood, why: str) -> Diverged:
    names = ensemble.names
    subject = "the estimates of" if len(names) > 1 else "the estimate of"
    verb = "are" if len(names) > 1 else "is"
    return Diverged(
        f"{subject} {', '.join(names)} {verb} void: {why}",
        remedy="Start nearer to the true values, add passes, or check model, units and excitation.",
        names=names,
    )
