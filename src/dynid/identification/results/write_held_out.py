"""Records that are held out: what an estimate explains of records that it was not fitted to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynid.arrays import Array
from dynid.errors import UsageError
from dynid.identification.likelihood.nonlinear_record import NonlinearRecord
from dynid.identification.likelihood.time_record import TimeRecord
from dynid.identification.problem import Problem
from dynid.identification.records.measurement import Experiment
from dynid.identification.systems.parametric_model import Model
from dynid.identification.systems.record_values import data
from dynid.result import Result, common_unit

HELD_OUT = "identification/held_out"


@dataclass(frozen=True, eq=False)
class HeldOut:
    """A record of time that is predicted, from the initial state that its first samples, or all, have."""

    experiment: Experiment
    initial_samples: int | None = None


def add_held_out(
    result: Result, problem: Problem, model: Model, eta: Array, records: Sequence[HeldOut]
) -> None:
    """Add the predictions of records at coordinates `eta` (p) of the parameters of a model.

    ``identification/held_out/``: `residual_rms` and `residual_ratio` (to the RMS of the record) by channel,
    and of each record ``record_k/{time, channel, measured, predicted, unit}``.
    """
    names, sizes, ratios, units = [], [], [], []
    for number, record in enumerate(records, 1):
        values = data(problem.truth, *record.experiment, None)
        likelihood = problem.record(model, record.experiment, values)
        if not isinstance(likelihood, TimeRecord):
            raise UsageError("a record that is held out is one of time")
        measured = likelihood.data.values
        predicted = _predicted(likelihood, eta, record.initial_samples)
        channels, group = record.experiment.measurement.channels, f"{HELD_OUT}/record_{number}"
        result.add_axis(f"{group}/time", likelihood.times, "s")
        result.add_axis(f"{group}/channel", [channel.name for channel in channels])
        if likelihood.model.instruments.clocked:
            result.add(f"{group}/channel_time", likelihood.channel_times(eta), ("time", "channel"), "s")
            predicted = np.where(likelihood.known, predicted, np.nan)
        unit = common_unit(channel.unit for channel in channels)
        result.add_all(group, ("time", "channel"), unit, measured=measured, predicted=predicted)
        result.add(f"{group}/unit", [channel.unit for channel in channels], ("channel",))
        rms = np.sqrt(np.nanmean((measured - predicted) ** 2, axis=0))
        names += [f"record_{number}.{channel.name}" for channel in channels]
        units += [channel.unit for channel in channels]
        sizes += rms.tolist()
        ratios += (rms / np.sqrt(np.nanmean(measured**2, axis=0))).tolist()
    result.add_axis(f"{HELD_OUT}/channel", names)
    result.add(f"{HELD_OUT}/residual_rms", sizes, ("channel",), common_unit(units))
    result.add(f"{HELD_OUT}/residual_ratio", ratios, ("channel",))
    result.add(f"{HELD_OUT}/unit", units, ("channel",))


def _predicted(likelihood: TimeRecord, eta: Array, initial_samples: int | None) -> Array:
    """Return the outputs (times x channels) from the initial state that fits the first samples, or all."""
    values = likelihood.data.values.copy()
    if initial_samples is None or initial_samples >= len(values):
        return likelihood.fit(eta, values).predicted.outputs
    if isinstance(likelihood, NonlinearRecord):  # marched through these samples alone until it is estimated
        head = likelihood.first(initial_samples)
        start = head.fit(eta, values[:initial_samples]).predicted.start
        return likelihood.prediction_from(eta, start, head.model).outputs
    values[initial_samples:] = np.nan
    return likelihood.fit(eta, values).predicted.outputs
