"""The result of an identification, as named arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dynid.errors import Diverged, NotIdentifiable
from dynid.identification.diagnostics import (
    is_coloured,
    is_explained,
    is_settled,
    root_mean_square,
    whiteness,
)
from dynid.identification.ensemble import Ensemble, JointFit
from dynid.identification.estimators.estimation import Estimation, Sweep
from dynid.identification.filtering.filter import Pass
from dynid.identification.information import Information, untold
from dynid.identification.measurement import Experiment
from dynid.identification.model_error import ModelError
from dynid.identification.record_results import (
    add_history,
    add_innovations,
    add_measurement,
    add_spectrum,
    add_states,
    add_truth,
)
from dynid.identification.residuals import Consistency, autocorrelation, consistency
from dynid.identification.states import state_deviations
from dynid.identification.verdict import Facts, Sensor, verdict, warnings
from dynid.result import Result
from dynid.structure.matrices import Label
from dynid.structure.response import common_unit

Array = NDArray[np.float64]

# Residuals above this part of a channel's RMS void the estimates if they are not noise …
_VOID = 0.5
# … and above this one (all channels together) whatever they are.
_NOTHING = 1.0
# A standard error of the logarithm beyond which not even the order of magnitude is known: a factor of e^10.
_BLIND = 10.0


@dataclass(frozen=True, eq=False)
class Outcome:
    """What an identification found.

    Attributes
    ----------
    ensemble
        Model and records.
    experiments
        What was measured, under which loads, record by record.
    dofs
        Labels of the DOFs.
    method
        Name of the estimator.
    estimation
        What the estimator found.
    model_error
        What the reduction of the model does to it, if it is reduced.
    """

    ensemble: Ensemble
    experiments: Sequence[Experiment]
    dofs: Sequence[Label]
    method: str
    estimation: Estimation
    model_error: ModelError | None = None

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

    @cached_property
    def step(self) -> Array:
        """The Gauss–Newton step from the estimate to the optimum of the records, in logarithms (p)."""
        residual = self.ensemble.weighted(self._final, self._noise)
        direction = self.information.projected.T @ residual
        held = self.ensemble.knowledge.blocked(self._final.logs, direction)
        return self.information.without(held).step(residual)

    @property
    def _channels(self) -> list[tuple[int, int, str]]:
        """Record, column and name of every channel."""
        several = len(self.experiments) > 1
        return [
            (k, column, f"record_{k + 1}.{channel.name}" if several else channel.name)
            for k, experiment in enumerate(self.experiments)
            for column, channel in enumerate(experiment.measurement.channels)
        ]

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
        each = zip(self.ensemble.records, self._final.residuals, strict=True)
        # Corrected for what the fit takes up of any record.
        left = np.concatenate([record.scatter(residual) / record.data.rms for record, residual in each])
        if not np.mean(left**2) < _NOTHING**2:
            raise _void(self.ensemble, f"the prediction explains nothing of the record{'s' * self._several}")
        for unexplained, (k, column, name) in zip(left, self._channels, strict=True):
            if unexplained > _VOID and is_coloured(whiteness(self._final.residuals[k][:, [column]])):
                raise _void(
                    self.ensemble,
                    f"{100 * unexplained:.0f} % of {name} is unexplained, and what is left is no noise",
                )
        blind = self.information.deviations() > _BLIND
        if blind.any():
            raise untold([name for name, yes in zip(self.ensemble.names, blind, strict=True) if yes])

    @cached_property
    def innovations(self) -> list[Array] | None:
        """Innovations of the filter's last pass; none of a first one, which assumes a noise of its own."""
        sweeps = self.estimation.histories
        if self.method != "filter" or len(sweeps) < 2:
            return None
        return [history.innovations for history in sweeps[-1] if history.innovations is not None]

    @property
    def _consistency(self) -> Consistency | None:
        """Mean square of the innovations of all records, as of one channel."""
        every = self.innovations
        return None if every is None else consistency(np.concatenate([e.ravel() for e in every])[:, None])

    @cached_property
    def _state_deviations(self) -> list[Array]:
        """Deviations of the states (times x n, scaled) of each record, given all records."""
        known = self.information.root()
        each = zip(self.ensemble.records, self._final.parts, self._noise, strict=True)
        return [state_deviations(record, part, noise, known) for record, part, noise in each]

    def result(self, true_states: Sequence[Array | None]) -> Result:
        """Return everything under ``identification/``.

        Parameters
        ----------
        true_states
            Of each record the states (times x n) that it was made with, where they are known.
        """
        result = Result("identification")
        self._add_parameters(result)
        sweeps = self.estimation.histories or [self._whole_records()]
        self._add_sweep(result, "identification/history", sweeps[-1])
        if len(sweeps) > 1:
            self._add_sweep(result, "identification/first_pass", sweeps[0])
        self._add_stages(result)
        for k, record in enumerate(self.ensemble.records):
            group = self._group("identification/measurement", k)
            add_measurement(result, group, record, self.experiments[k], self._final.parts[k])
            self._add_findings(result, k, true_states[k])
        self._add_diagnostics(result)
        if self.model_error is not None:
            self.model_error.add_to(result, [name for _, _, name in self._channels])
        return result

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
        fit, values, true = self._final, np.exp(self._final.logs), self._true
        if not np.isnan(true).any():
            fit, values = self.ensemble.fit(np.log(true), clean=True), true
        each = zip(self.ensemble.records, self._noise, strict=True)
        noise = [seen if record.data.noise is None else record.data.noise for record, seen in each]
        if not all(level.all() for level in noise):
            return np.zeros(len(true))  # clean data
        told = self.ensemble.information(fit, noise, prior=prior)
        if not prior:
            try:
                told.check()
            except NotIdentifiable:
                return np.full(len(values), np.inf)
        return np.asarray(values * told.deviations())

    def _whole_records(self) -> Sweep:
        """Return the history of an estimator of whole records: it knows as much at any time."""
        sweep, deviations = [], self.information.deviations()
        for part, bands in zip(self._final.parts, self._state_deviations, strict=True):
            every = np.ones((len(part.residual), 1))
            states, root = part.predicted.states, np.diag(deviations)
            sweep.append(Pass(every * part.logs, every * deviations, states, bands, root))
        return sweep

    @property
    def _several(self) -> bool:
        return len(self.experiments) > 1

    def _group(self, parent: str, k: int) -> str:
        """Return the group of a record: of a single one the parent itself."""
        return f"{parent}/record_{k + 1}" if self._several else parent

    def _add_sweep(self, result: Result, parent: str, sweep: Sweep) -> None:
        for k, (record, history) in enumerate(zip(self.ensemble.records, sweep, strict=True)):
            measurement = self.experiments[k].measurement
            group = self._group(parent, k)
            add_history(result, group, record.model, measurement, self.dofs, history)

    def _add_findings(self, result: Result, k: int, true: Array | None) -> None:
        """Add what is found of a record beside its prediction: states, residuals, innovations."""
        model, part = self.ensemble.records[k].model, self._final.parts[k]
        measurement = self.experiments[k].measurement
        add_truth(result, self._group("identification/history", k), model, true)
        states = (part.predicted.states * model.scale, self._state_deviations[k] * model.scale)
        add_states(result, self._group("identification/states", k), measurement, self.dofs, states, true)
        add_spectrum(result, self._group("identification/residual_spectrum", k), measurement, part)
        if self.innovations is not None:
            group = self._group("identification/innovations", k)
            add_innovations(result, group, measurement, self.innovations[k])

    def _add_stages(self, result: Result) -> None:
        group, stages = "identification/stages", self.estimation.stages
        result.annotate("identification", estimator=self.method)
        result.add_axis(f"{group}/stage", [stage.name for stage in stages])
        result.add_axis(f"{group}/parameter", [unknown.name for unknown in self.ensemble.unknowns])
        estimates = np.exp([stage.fit.logs for stage in stages])
        unit = self._common_unit_of_parameters()
        result.add(f"{group}/estimate", estimates, ("stage", "parameter"), unit)
        left = [np.max(self.ensemble.residual_ratio(stage.fit)) for stage in stages]
        result.add(f"{group}/residual_ratio", left, ("stage",))
        result.add(f"{group}/iterations", [len(stage.fits) - 1 for stage in stages], ("stage",))
        chosen = [stage.fit is self._final for stage in stages].index(True) + 1
        result.add(f"{group}/chosen", chosen)

    def _add_diagnostics(self, result: Result) -> None:
        group = "identification/diagnostics"
        deviations = self.information.deviations()
        settled = is_settled(self.step, deviations)
        explained = is_explained(self.residual_ratio, self.whiteness_p)
        result.add(f"{group}/converged", settled and explained)
        result.add(f"{group}/settled", settled)
        result.add(f"{group}/explained", explained)
        result.add_axis(f"{group}/parameter", [unknown.name for unknown in self.ensemble.unknowns])
        result.add(f"{group}/distance_to_optimum", np.abs(self.step) / deviations, ("parameter",))
        result.add_axis(f"{group}/channel", [name for _, _, name in self._channels])
        every = [channel for experiment in self.experiments for channel in experiment.measurement.channels]
        unit = common_unit(channel.unit for channel in every)
        rms = np.concatenate([root_mean_square(residual) for residual in self._final.residuals])
        result.add(f"{group}/residual_rms", rms, ("channel",), unit)
        result.add(f"{group}/residual_ratio", self.residual_ratio, ("channel",))
        result.add(f"{group}/whiteness_p", self.whiteness_p)
        result.add(f"{group}/white", not is_coloured(self.whiteness_p))
        result.add(f"{group}/condition", self.information.condition())
        for name, fact in self.estimation.facts.items():
            result.add(f"{group}/{name}", fact)
        result.add(f"{group}/passes", len(self.estimation.histories))
        self._add_autocorrelation(result)
        self._add_words(result, settled=settled, explained=explained)

    def _add_autocorrelation(self, result: Result) -> None:
        group, residuals = "identification/diagnostics", self._final.residuals
        found = [autocorrelation(residual) for residual in residuals]
        lags = min(len(r) for r, _ in found)
        result.add_axis(f"{group}/lag", np.arange(1, lags + 1))
        joined = np.concatenate([r[:lags] for r, _ in found], axis=1)
        result.add(f"{group}/autocorrelation", joined, ("lag", "channel"))
        band = np.concatenate([band for _, band in found])
        result.add(f"{group}/autocorrelation_band", band, ("channel",))
        p = [whiteness(residuals[k][:, [column]]) for k, column, _ in self._channels]
        result.add(f"{group}/channel_whiteness_p", p, ("channel",))

    def _add_words(self, result: Result, *, settled: bool, explained: bool) -> None:
        """Add the verdict and the warnings."""
        group, names = "identification/diagnostics", self.ensemble.names
        deviations, bound = self.information.deviations(), self._bound
        off = np.abs(np.exp(self._final.logs) - self._true)
        errors = np.where(bound > 0, off / np.where(bound > 0, bound, 1.0), np.nan)
        sensors = [
            Sensor(
                name,
                self.ensemble.records[k].data.values[:, column],
                self._final.residuals[k][:, column],
                self.experiments[k].measurement.step,
            )
            for k, column, name in self._channels
        ]
        correlation = self.information.correlation()
        facts = Facts(names, deviations, correlation, errors, sensors, self._consistency)
        distance = np.abs(self.step) / deviations
        result.add(f"{group}/verdict", verdict(names, distance, settled=settled, explained=explained))
        said = warnings(facts)
        if self.model_error is not None and self.model_error.warning:
            said.append(self.model_error.warning)
        result.add_axis(f"{group}/warnings", np.array(said, dtype=object))


def _void(ensemble: Ensemble, why: str) -> Diverged:
    names = ensemble.names
    subject = "the estimates of" if len(names) > 1 else "the estimate of"
    verb = "are" if len(names) > 1 else "is"
    return Diverged(
        f"{subject} {', '.join(names)} {verb} void: {why}",
        remedy="Start nearer to the true values, add passes, or check model, units and excitation.",
        names=names,
    )
