"""Channels of a record of time in directions of their saturated models."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import numpy as np

from dynid.arrays import Array
from dynid.identification.likelihood.saturated_model import (
    ChannelColumns,
    ForcedRegressors,
    Regressors,
    SaturatedCoordinates,
    delayed_residuals,
    fault_columns,
    forced_regressors,
    most_regressors,
    regressors_in_time,
    saturated_coordinates,
)
from dynid.identification.systems.parametric_model import ParametricModel
from dynid.lti.signals import Sampled, Shifted, Signal
from dynid.parameters import named

if TYPE_CHECKING:
    from dynid.identification.likelihood.record_likelihood import RecordFit

# Numbers of the largest regressors that are kept.
_MAX_KEPT_NUMBERS = 1_000_000
# Regressors of the forces of models, of which there may be so many.
_FORCED: WeakKeyDictionary[ParametricModel, dict[int, ForcedRegressors]] = WeakKeyDictionary()


def coordinates(record: Any, fit: RecordFit) -> list[SaturatedCoordinates]:
    """Return the channels, in units of their RMS, in directions of their saturated models."""
    assert fit.measured is not None
    white, decays = record.data.passed == 1, record.decays(fit.eta)
    shared = shared_regressors(record, fit)
    channels, clocks = [], record.model.instruments.clocks
    # The derivatives by the first state are in the range of the regressors and decays.
    inside = None if decays is None else shared.directions[1] @ decays.columns
    for c, predicted in record.channelwise(fit, by_state=False):
        rms = record.data.rms[c]
        there = ~np.isnan(fit.residual[:, c])
        outputs, residual = predicted.outputs[:, 0] / rms, fit.residual[:, c] / rms
        measured = np.nan_to_num(fit.measured[:, c]) / rms
        if decays is None or inside is None:
            by_state = np.ascontiguousarray(predicted.by_state[:, 0]) @ (record.root / rms)
        else:
            by_state = np.asarray(inside @ (decays.weights[c] @ (record.root / rms)))
        by_parameter = predicted.by_parameter[:, 0] / rms
        regressors = shared if clocks[c] is None else _regressors_of_clock(record, fit, c)
        if not there.all():
            outputs, residual = np.where(there, outputs, 0.0), np.where(there, residual, 0.0)
            by_state, by_parameter = by_state * there[:, None], by_parameter * there[:, None]
        faults = fault_columns(outputs) if there.all() else fault_columns(outputs) * there[:, None]
        if record.colour is not None:  # channel by channel, whether they are correlated or not
            parts = (regressors.values, outputs, measured, residual, by_state, by_parameter, faults)
            white_values, outputs, measured, residual, by_state, by_parameter, faults = (
                record.colour.of_channel(c, there, parts)
            )
            regressors = replace(regressors, values=white_values, decays=None)
        # A preparation filter correlates residuals that were white.
        before = delayed_residuals(residual) if white else np.zeros((len(there), 0))
        before = before if there.all() else before * there[:, None]
        columns = ChannelColumns(outputs, measured, residual, by_state, by_parameter, faults, before)
        channels.append(
            saturated_coordinates(
                regressors.where(there),
                columns,
                int(record.data.counts[c]) * min(1.0, record.data.passed),
                state_in_range=decays is not None,
            )
        )
    return channels


def shared_regressors(record: Any, fit: RecordFit) -> Regressors:
    """Return the regressors of the saturated model that the channels share (times x any)."""
    times = record.model.times
    max_count = most_regressors(int(record.data.counts.min() * min(1.0, record.data.passed)))
    forced = _FORCED.setdefault(record.model, {})
    if max_count not in forced:
        inputs = [record.model.inputs(order) for order in (0, 1)]
        forced[max_count] = forced_regressors(record.model.signals, inputs, times, max_count)
    key, kept = fit.eta.tobytes(), record.kept_regressors
    shared: Regressors | None = kept.get(key)
    if shared is None:
        shared = regressors_in_time(forced[max_count], record.model.poles(fit.eta), times, max_count)
        kept.clear()
        if shared.values.size <= _MAX_KEPT_NUMBERS:
            kept[key] = shared
    return shared


def _regressors_of_clock(record: Any, fit: RecordFit, channel: int) -> Regressors:
    """Return the regressors of a channel at the times of its own clock."""
    model, clock = record.model, record.model.instruments.clocks[channel]
    assert clock is not None
    at = named(record.unknowns, fit.eta)
    first, second = model.instruments.instants(model.times[:2], at).value[:, channel]
    times = first + (second - first) * np.arange(len(model.times))
    # Beyond their samples, signals keep the last one.
    acting = [
        Shifted(signal, 0.0) if isinstance(signal, Sampled) else signal
        for signal in model.instruments.acting(model.signals, at)
    ]
    inputs = [np.column_stack([_derivative(signal, order, times) for signal in acting]) for order in (0, 1)]
    max_count = most_regressors(int(record.data.counts.min() * min(1.0, record.data.passed)))
    forced = forced_regressors(model.signals, inputs, times, max_count)
    return regressors_in_time(forced, model.poles(fit.eta), times, max_count)


def _derivative(signal: Signal, order: int, times: Array) -> Array:
    """Return a derivative of a signal at times."""
    G, h = signal.generator()
    return np.asarray(signal.states(times, times) @ (h @ np.linalg.matrix_power(G, order)))
