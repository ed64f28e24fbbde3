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
from dynid.identification.diagnostics import (
    is_coloured,
    is_explained,
    is_settled,
    whiteness,
)
from dynid.identification.ensemble import JointFit, Likelihood
from dynid.identification.estimators.estimation import Estimation
from dynid.identification.information import Information, untold
from dynid.identification.model_error import ModelError
from dynid.identification.residuals import Consistency, autocorrelation
from dynid.identification.verdict import CONTRADICTED, Facts, Sensor, verdict, warnings
from dynid.result import Result
from dynid.structure.response import common_unit

Array = NDArray[np.float64]

# Residuals above this part of a channel's RMS void the estimates if they are not noise …
_VOID = 0.5
# … and above this one (all channels together) whatever they are.
_NOTHING = 1.0
# A standard error of the logarithm beyond which not even the order of magnitude is known: a factor of e^10.
_BLIND = 10.0
# Errors of logarithms below this are rounding, of which a bound of clean data may say anything.
_ROUNDING = 1e-9
#: What the autocorrelation of the residuals is told by.
_AUTOCORRELATION = ("lag", "autocorrelation", "autocorrelation_band", "channel_whiteness_p")


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
    def _measured(self) -> Sequence[Sequence[Named]]:
        """What is measured, record by record."""

    @property
    @abstractmethod
    def _word(self) -> str:
        """What a record is called."""

    @property
    def _sensors(self) -> Sequence[Sensor]:
        """The channels as records of time, to look for what goes wrong with these."""
        return ()

    @property
    def _consistency(self) -> Consistency | None:
        """How consistent the innovations of a filter are."""
        return None

    @property
    def _remarks(self) -> Sequence[str]:
        """What else to be wary of, in words."""
        return ()

    @property
    def _residual_rms(self) -> Array:
        """RMS of the residuals (channels of all records), in the channels' units."""
        return np.concatenate([part.size for part in self._final.parts])

    @property
    def _final(self) -> JointFit:
        return self.estimation.fit

    @property
    def _noise(self) -> list[Array]:
        """Noise given or seen in the residuals; not below rounding, so that it can be divided by."""
        each = zip(self._final.noise, self.ensemble.records, strict=True)
        return [np.maximum(noise, np.finfo(float).eps * record.data.rms) for noise, record in each]

    @cached_property
    def information(self) -> Information:
        """The Fisher information at the estimate, for the noise given or seen in the residuals."""
        return self.ensemble.information(self._final, self._noise)

    @cached_property
    def whiteness_p(self) -> float:
        """The p-value of the residuals' whiteness."""
        return self.ensemble.whiteness(self._final)

    @cached_property
    def residual_ratio(self) -> Array:
        """RMS of the residuals over that of the measured values (channels of all records)."""
        return self.ensemble.residual_ratio(self._final)

    @property
    def explained(self) -> bool:
        """Whether the residuals are small, or noise."""
        return is_explained(self.residual_ratio, self.whiteness_p)

    @cached_property
    def step(self) -> Array:
        """The Gauss–Newton step from the estimate to the optimum of the records, in logarithms (p)."""
        residual = self.ensemble.weighted(self._final, self._noise)
        direction = self.information.projected.T @ residual
        held = self.ensemble.knowledge.blocked(self._final.logs, direction)
        return self.information.without(held).step(residual)

    @cached_property
    def _channels(self) -> list[Place]:
        """All channels, record by record."""
        return [
            Place(
                k, column, f"record_{k + 1}.{channel.name}" if self._several else channel.name, channel.unit
            )
            for k, channels in enumerate(self._measured)
            for column, channel in enumerate(channels)
        ]

    def _series(self, place: Place) -> Array:
        """Return what should be white of a channel (rows x columns)."""
        residual = self._final.residuals[place.record][:, [place.column]]
        return self.ensemble.records[place.record].series(residual)

    @property
    def _several(self) -> bool:
        return len(self._measured) > 1

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
        each = zip(self.ensemble.records, self._final.parts, strict=True)
        # Corrected for what the fit takes up of any record.
        left = np.concatenate([record.scatter(p.counts, p.size) / record.data.rms for record, p in each])
        if not np.mean(left**2) < _NOTHING**2:
            raise _void(
                self.ensemble, f"the prediction explains nothing of the {self._word}{'s' * self._several}"
            )
        for unexplained, place in zip(left, self._channels, strict=True):
            if unexplained > _VOID and is_coloured(whiteness(self._series(place))):
                raise _void(
                    self.ensemble,
                    f"{100 * unexplained:.0f} % of {place.name} is unexplained, and what is left is no noise",
                )
        blind = self.information.deviations() > _BLIND
        if blind.any():
            raise untold([name for name, yes in zip(self.ensemble.names, blind, strict=True) if yes])

    def _add_parameters(self, result: Result) -> None:
        group, dims = "identification/parameters", ("parameter",)
        unknowns = self.ensemble.unknowns
        names = self.ensemble.names
        estimate = np.exp(self._final.logs)
        true = self._true
        result.add_axis(f"{group}/parameter", names)
        result.add(f"{group}/name", names, dims)
        result.add(f"{group}/unit", [unknown.unit for unknown in unknowns], dims)
        unit = self._common_unit_of_parameters()
        result.add(f"{group}/start", [unknown.start for unknown in unknowns], dims, unit)
        result.add(f"{group}/true", true, dims, unit)
        result.add(f"{group}/estimate", estimate, dims, unit)
        result.add(f"{group}/standard_error", estimate * self.information.deviations(), dims, unit)
        if result.wants(f"{group}/cramer_rao"):
            result.add(f"{group}/cramer_rao", self._bound, dims, unit)
        knowledge = self.ensemble.knowledge
        result.add(f"{group}/at_bound", knowledge.at_bound(self._final.logs), dims)
        if knowledge.believed.any():
            result.add(f"{group}/cramer_rao_without_prior", self._bound_with(prior=False), dims, unit)
        result.add(f"{group}/error_percent", 100 * np.abs(estimate / true - 1), dims, "%")
        # An axis of its own: two axes of one name could not be told apart.
        result.add_axis(f"{group}/other", names)
        result.add(f"{group}/correlation", self.information.correlation(), ("parameter", "other"))

    def _common_unit_of_parameters(self) -> str:
        return common_unit(unknown.unit for unknown in self.ensemble.unknowns)

    @property
    def _true(self) -> Array:
        """True values of the parameters (p), NaN where they are not known."""
        unknowns = self.ensemble.unknowns
        return np.array([np.nan if unknown.true is None else unknown.true for unknown in unknowns])

    @cached_property
    def _bound(self) -> Array:
        """The Cramér–Rao bound (p), at the true values and noise where they are known, with the priors."""
        return self._bound_with(prior=True)

    def _bound_with(self, *, prior: bool) -> Array:
        """Return the bound (p), with the priors or of the records alone: infinite if these see nothing."""
        told_by, fit, values, true = self.ensemble, self._final, np.exp(self._final.logs), self._true
        if not np.isnan(true).any():
            told_by = self.ensemble.ideal
            fit, values = told_by.at_truth, true
        each = zip(self.ensemble.records, self._noise, strict=True)
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

    def _add_stages(self, result: Result) -> None:
        group, stages = "identification/stages", self.estimation.stages
        result.annotate("identification", estimator=self.method)
        result.add_axis(f"{group}/stage", [stage.name for stage in stages])
        result.add_axis(f"{group}/parameter", [unknown.name for unknown in self.ensemble.unknowns])
        estimates = np.exp([stage.logs for stage in stages])
        unit = self._common_unit_of_parameters()
        result.add(f"{group}/estimate", estimates, ("stage", "parameter"), unit)
        left = [np.max(stage.residual_ratio) for stage in stages]
        result.add(f"{group}/residual_ratio", left, ("stage",))
        result.add(f"{group}/iterations", [stage.iterations for stage in stages], ("stage",))
        chosen = [stage.logs is self._final.logs for stage in stages].index(True) + 1
        result.add(f"{group}/chosen", chosen)

    def _add_diagnostics(self, result: Result) -> None:
        group = "identification/diagnostics"
        deviations = self.information.deviations()
        settled = is_settled(self.step, deviations)
        explained = self.explained
        result.add(f"{group}/converged", settled and explained)
        result.add(f"{group}/settled", settled)
        result.add(f"{group}/explained", explained)
        result.add_axis(f"{group}/parameter", [unknown.name for unknown in self.ensemble.unknowns])
        result.add(f"{group}/distance_to_optimum", np.abs(self.step) / deviations, ("parameter",))
        if self.ensemble.knowledge.believed.any():
            conflict = self.ensemble.knowledge.conflict(self._final.logs, deviations)
            result.add(f"{group}/prior_conflict", conflict, ("parameter",))
            result.add(f"{group}/prior_contradicted", conflict > CONTRADICTED, ("parameter",))
        result.add_axis(f"{group}/channel", [place.name for place in self._channels])
        unit = common_unit(place.unit for place in self._channels)
        result.add(f"{group}/residual_rms", self._residual_rms, ("channel",), unit)
        result.add(f"{group}/residual_ratio", self.residual_ratio, ("channel",))
        result.add(f"{group}/whiteness_p", self.whiteness_p)
        result.add(f"{group}/white", not is_coloured(self.whiteness_p))
        result.add(f"{group}/condition", self.information.condition())
        for name, fact in self.estimation.facts.items():
            result.add(f"{group}/{name}", fact)
        result.add(f"{group}/passes", len(self.estimation.histories))
        if any(result.wants(f"{group}/{name}") for name in _AUTOCORRELATION):
            self._add_autocorrelation(result)
        if any(result.wants(f"{group}/{name}") for name in ("verdict", "warnings")):
            self._add_words(result, settled=settled, explained=explained)

    def _add_autocorrelation(self, result: Result) -> None:
        group = "identification/diagnostics"
        found = [autocorrelation(self._series(place)) for place in self._channels]
        lags = min(len(r) for r, _ in found)
        result.add_axis(f"{group}/lag", np.arange(1, lags + 1))
        # Of real and imaginary parts, which are alike, the mean.
        joined = np.column_stack([r[:lags].mean(axis=1) for r, _ in found])
        result.add(f"{group}/autocorrelation", joined, ("lag", "channel"))
        band = [float(np.mean(band) / np.sqrt(len(band))) for _, band in found]
        result.add(f"{group}/autocorrelation_band", band, ("channel",))
        p = [whiteness(self._series(place)) for place in self._channels]
        result.add(f"{group}/channel_whiteness_p", p, ("channel",))

    def _add_words(self, result: Result, *, settled: bool, explained: bool) -> None:
        """Add the verdict and the warnings."""
        group, names = "identification/diagnostics", self.ensemble.names
        deviations, bound = self.information.deviations(), self._bound
        off = np.abs(np.exp(self._final.logs) - self._true)
        errors = np.where(bound > 0, off / np.maximum(bound, _ROUNDING), np.nan)
        correlation = self.information.correlation()
        judged = any(np.isnan(record.given).any() for record in self.ensemble.records)
        spare = self.information.freedom - len(names) if judged else None
        conflict = self.ensemble.knowledge.conflict(self._final.logs, deviations)
        facts = Facts(
            names, deviations, correlation, errors, self._sensors, self._consistency, spare, conflict
        )
        distance = np.abs(self.step) / deviations
        result.add(f"{group}/verdict", verdict(names, distance, settled=settled, explained=explained))
        said = [*warnings(facts), *self._remarks]
        if self.model_error is not None and self.model_error.warning:
            said.append(self.model_error.warning)
        result.add_axis(f"{group}/warnings", np.array(said, dtype=object))


def _void(ensemble: Likelihood, why: str) -> Diverged:
    names = ensemble.names
    subject = "the estimates of" if len(names) > 1 else "the estimate of"
    verb = "are" if len(names) > 1 else "is"
    return Diverged(
        f"{subject} {', '.join(names)} {verb} void: {why}",
        remedy="Start nearer to the true values, add passes, or check model, units and excitation.",
        names=names,
    )
