"""The result of an identification from records of time, as named arrays."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dynid.identification.ensemble import Ensemble
from dynid.identification.estimators.estimation import Sweep
from dynid.identification.filtering.filter import Pass
from dynid.identification.findings import Findings, Named
from dynid.identification.findings_result import add_diagnostics, add_parameters, add_stages
from dynid.identification.measurement import Experiment
from dynid.identification.record_results import (
    add_history,
    add_innovations,
    add_measurement,
    add_spectrum,
    add_states,
    add_truth,
)
from dynid.identification.residuals import Consistency, consistency
from dynid.identification.states import state_deviations
from dynid.identification.thinning import kept
from dynid.identification.verdict import Sensor
from dynid.result import Result
from dynid.structure.matrices import Label

Array = NDArray[np.float64]

#: Groups that have the samples of a record for an axis.
_OF_TIME = tuple(
    f"identification/{group}"
    for group in ("history", "first_pass", "measurement", "states", "residual_spectrum", "innovations")
)


@dataclass(frozen=True, eq=False)
class Outcome(Findings):
    """What an identification from records of time found.

    Attributes
    ----------
    ensemble
        Model and records.
    experiments
        What was measured, under which loads, record by record.
    dofs
        Labels of the DOFs.
    """

    ensemble: Ensemble
    experiments: Sequence[Experiment]
    dofs: Sequence[Label]

    @property
    def measured(self) -> Sequence[Sequence[Named]]:
        """What is measured, record by record."""
        return [experiment.measurement.channels for experiment in self.experiments]

    @property
    def word(self) -> str:
        """What a record is called."""
        return "record"

    @property
    def sensors(self) -> list[Sensor]:
        """The channels as records of time."""
        return [
            Sensor(
                place.name,
                self.ensemble.records[place.record].data.values[:, place.column],
                self.final.residuals[place.record][:, place.column],
                self.experiments[place.record].measurement.step,
            )
            for place in self.channels
        ]

    @cached_property
    def innovations(self) -> list[Array] | None:
        """Innovations of the filter's last pass; none of a first one, which assumes a noise of its own."""
        sweeps = self.estimation.histories
        if self.method != "filter" or len(sweeps) < 2:
            return None
        return [history.innovations for history in sweeps[-1] if history.innovations is not None]

    @property
    def consistency(self) -> Consistency | None:
        """Mean square of the innovations of all records, as of one channel."""
        every = self.innovations
        return None if every is None else consistency(np.concatenate([e.ravel() for e in every])[:, None])

    @cached_property
    def _state_deviations(self) -> list[Array]:
        """Deviations of the states (rows that are kept x n, scaled) of each record, given all records."""
        known = self.information.root()
        each = zip(self.ensemble.records, self.final.parts, self.noise, strict=True)
        return [state_deviations(record, part, noise, known) for record, part, noise in each]

    def result(self, result: Result, true_states: Callable[[], Sequence[Array | None]]) -> Result:
        """Return everything under ``identification/``, as far as it is wanted.

        Parameters
        ----------
        result
            What to add it to.
        true_states
            Gives of each record the states (times x n) that it was made with, where they are known.
        """
        add_parameters(result, self)
        if any(map(result.wants_below, _OF_TIME)):
            self._add_histories(result, true_states())
        add_stages(result, self)
        add_diagnostics(result, self)
        if self.model_error is not None:
            self.model_error.add_to(result, [place.name for place in self.channels])
        return result

    def _add_histories(self, result: Result, true_states: Sequence[Array | None]) -> None:
        """Add what has the samples of a record for an axis."""
        sweeps = self.estimation.histories or [self._whole_records()]
        self._add_sweep(result, "identification/history", sweeps[-1])
        if len(sweeps) > 1:
            self._add_sweep(result, "identification/first_pass", sweeps[0])
        for k, record in enumerate(self.ensemble.records):
            group = self._group("identification/measurement", k)
            add_measurement(result, group, record, self.experiments[k], self.final.parts[k])
            self._add_findings(result, k, true_states[k])

    def _whole_records(self) -> Sweep:
        """Return the history of an estimator of whole records: it knows as much at any time."""
        sweep, deviations = [], self.information.deviations()
        for part, bands in zip(self.final.parts, self._state_deviations, strict=True):
            states, root = part.predicted.states[kept(len(part.residual))], np.diag(deviations)
            every = np.ones((len(states), 1))
            sweep.append(Pass(every * part.logs, every * deviations, states, bands, root))
        return sweep

    def _group(self, parent: str, k: int) -> str:
        """Return the group of a record: of a single one the parent itself."""
        return f"{parent}/record_{k + 1}" if self.several else parent

    def _add_sweep(self, result: Result, parent: str, sweep: Sweep) -> None:
        for k, (record, history) in enumerate(zip(self.ensemble.records, sweep, strict=True)):
            measurement = self.experiments[k].measurement
            group = self._group(parent, k)
            add_history(result, group, record.model, measurement, self.dofs, history)

    def _add_findings(self, result: Result, k: int, true: Array | None) -> None:
        """Add what is found of a record beside its prediction: states, residuals, innovations."""
        model, part = self.ensemble.records[k].model, self.final.parts[k]
        measurement = self.experiments[k].measurement
        rows = kept(len(part.residual))
        states = (part.predicted.states[rows] * model.scale, self._state_deviations[k] * model.scale)
        true = None if true is None else true[rows]
        add_truth(result, self._group("identification/history", k), model, true)
        add_states(result, self._group("identification/states", k), measurement, self.dofs, states, true)
        add_spectrum(result, self._group("identification/residual_spectrum", k), measurement, part)
        if self.innovations is not None:
            group = self._group("identification/innovations", k)
            add_innovations(result, group, measurement, self.innovations[k])
