"""Bounds at other amplitudes of the excitation, for joints whose laws act beyond one alone."""

from __future__ import annotations

import numpy as np

from dynid.arrays import Array, guarded
from dynid.errors import DynidError
from dynid.identification.identifiability import ExpectedRecords
from dynid.identification.information import information
from dynid.identification.likelihood.nonlinear_record import NonlinearRecord
from dynid.identification.records.measurement import Experiment, sampled_loads
from dynid.identification.systems.parametric_model import Model, parametric_model
from dynid.result import Result

GROUP = "plan/amplitude"
# Factors of the present excitation.
_FACTORS = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0)


def add_amplitudes(result: Result, model: Model, experiment: Experiment, expected: ExpectedRecords) -> None:
    """Add ``plan/amplitude/``: the relative `bound` (factor x parameter) with `factor` times the excitation.

    The noise stays as it is. NaN where the motion cannot be followed.
    """
    rows = [_bounds(model, experiment, expected, factor) for factor in _FACTORS]
    result.add_axes(GROUP, factor=_FACTORS, parameter=expected.likelihood.names)
    result.add(f"{GROUP}/bound", rows, ("factor", "parameter"))


def _bounds(model: Model, experiment: Experiment, expected: ExpectedRecords, factor: float) -> Array:
    """Return the relative bounds (p) with a multiple of the excitation, and of the first state."""
    record, fit, eta = expected.likelihood.records[0], expected.fit.parts[0], expected.fit.eta
    assert isinstance(record, NonlinearRecord)
    measurement = experiment.measurement
    loads = sampled_loads(experiment.loads, measurement.record)
    loads = [load._replace(gain=factor * load.gain) for load in loads]
    scaled = parametric_model(model, loads, measurement.channels, record.model.times)
    start = fit.predicted.start.copy()
    start[: record.model.states] *= factor
    other = record.with_model(scaled)
    try:
        with guarded("the prediction"):
            predicted = other.prediction_from(eta, start, record.model)
    except DynidError:
        return np.full(len(eta), np.nan)
    weight = 1 / expected.noise[0][:, None]
    by_parameter = (predicted.by_parameter * weight).reshape(-1, len(eta))
    by_state = (predicted.by_state @ other.root * weight).reshape(len(by_parameter), -1)
    signal = float(np.linalg.norm(predicted.outputs / expected.noise[0]))
    names, size = tuple(expected.likelihood.names), predicted.outputs.size
    bounds = information(names, by_parameter, by_state, signal, size).bounds()
    return bounds * expected.relative_rates
