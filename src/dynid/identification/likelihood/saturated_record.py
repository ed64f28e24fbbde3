"""Channels of a record of time in directions of their saturated models.

Blocks of samples of all channels are projected onto the regressors and decays that these share, and what is
left of each channel is reflected into a triangle (`shared_decays.SharedTriangles`): memory does not grow with
the samples but for values and states. Channels with missing values, a clock of their own or coloured noise
have regressors of their own.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array
from dynid.identification.likelihood.saturated_model import (
    ChannelColumns,
    ForcedRegressors,
    Regressors,
    RegressorsInTime,
    SaturatedCoordinates,
    fault_columns,
    forced_regressors,
    most_delayed,
    most_regressors,
    regressors_in_time,
    saturated_coordinates,
    saturated_directions,
)
from dynid.identification.likelihood.shared_decays import SharedTriangles, sensitive_blocks
from dynid.identification.records.noise import Whitening
from dynid.identification.systems.free_decays import FreeDecays
from dynid.identification.systems.parametric_model import ParametricModel
from dynid.lti.signals import Sampled, Shifted, Signal
from dynid.parameters import named

if TYPE_CHECKING:
    from dynid.identification.likelihood.record_likelihood import RecordFit

# Most numbers of a block of samples with the columns of all channels: 16 MB, and copies.
_MAX_BLOCK_NUMBERS = 2_000_000
# Those of a record that is one block.
_MAX_WHOLE_NUMBERS = 4_000_000
# Fewest samples of a block: the factors of fewer ones are not worth merging.
_MIN_BLOCK_SAMPLES = 512
# Regressors of the forces of models, of which there may be so many.
_FORCED: WeakKeyDictionary[ParametricModel, dict[int, ForcedRegressors]] = WeakKeyDictionary()


class _Columns(NamedTuple):
    """Columns of channels at some samples: `outputs`, `measured` and `residual` over RMS (k x channels).

    `by_parameter` (k x p x channels), `by_state` (k x n x channels); all are 0 where a value is missing.
    """

    samples: slice
    outputs: Array
    measured: Array
    residual: Array
    by_parameter: Array
    by_state: Array

    def of(self, channels: list[int]) -> Array:
        """Return all columns of channels but delayed residuals side by side (k x w x channels)."""
        outputs, measured, residual = (part[:, channels] for part in self[1:4])
        parts = self.by_parameter[..., channels], self.by_state[..., channels]
        return np.concatenate([outputs[:, None], *parts, measured[:, None], residual[:, None]], axis=1)


def coordinates(record: Any, fit: RecordFit) -> list[SaturatedCoordinates]:
    """Return the channels, in units of their RMS, in directions of their saturated models."""
    decays = record.decays(fit.eta)
    there, clocks = ~np.isnan(fit.residual), record.model.instruments.clocks
    own_clock = np.array([clock is not None for clock in clocks])
    alone = ~there.all(axis=0) | own_clock | (record.colour is not None)
    groups = [[c] for c in np.flatnonzero(alone).tolist()]
    if not alone.all():
        groups.append(np.flatnonzero(~alone).tolist())
    n = record.nuisances if decays is None else 0
    samples, channels = there.shape
    lags = most_delayed(samples) if record.data.passed == 1 else 0
    width = channels * (record.model.parameters + n + 7 + lags)
    rows = max(_MIN_BLOCK_SAMPLES, _MAX_BLOCK_NUMBERS // width)
    rows = samples if samples * width <= _MAX_WHOLE_NUMBERS else min(rows, samples)
    bases = [_ChannelGroup(record, fit, group, there, rows, lags) for group in groups]
    for block in _column_blocks(record, fit, decays, there, rows):
        for group in bases:
            group.absorb(block, decays)
    out: dict[int, SaturatedCoordinates] = {}
    for group in bases:
        out.update(group.coordinates(n, decays))
    return [out[c] for c in range(channels)]


class _ChannelGroup:
    """Channels that share regressors: their columns, projected block by block."""

    def __init__(
        self, record: Any, fit: RecordFit, channels: list[int], there: NDArray[np.bool_], rows: int, lags: int
    ) -> None:
        self._record, self._channels, self._there = record, channels, there
        clock = record.model.instruments.clocks[channels[0]]
        shared = shared_regressors(record, fit) if clock is None else _of_clock(record, fit, channels[0])
        self._regressors = shared.blocks(rows)
        self._shared: Regressors | None = None
        self._complete = bool(there[:, channels].all())
        self._before, self._projected = np.zeros((lags, len(channels))), SharedTriangles()
        self._shape = 0, len(channels)
        self._white: Whitening | None = None
        if record.colour is not None:  # channel by channel, whether they are correlated or not
            self._white = Whitening(record.colour.of_channel(channels[0]), there[:, channels])

    def absorb(self, block: _Columns, decays: FreeDecays | None) -> None:
        """Add the columns of the next samples."""
        regressors, own, samples = next(self._regressors), block.of(self._channels), block.samples
        faults = fault_columns(own[:, 0], samples, len(self._there))
        there = self._there[samples][:, self._channels]
        if not self._complete:
            faults = faults * there[:, None]
            regressors = regressors.where(there[:, 0])
        own = np.concatenate([own[:, :-2], faults, own[:, -2:]], axis=1)
        if self._white is not None:
            d = regressors.values.shape[1]
            white = self._white.following(np.concatenate([regressors.values, own[..., 0]], axis=1)[:, None])
            regressors, own = regressors.whitened(white[:, 0, :d]), white[:, 0, d:, None]
        # A preparation filter correlates residuals that were white.
        lags, residual = len(self._before), np.concatenate([self._before, own[:, -1]])
        before = [residual[lags - lag : len(residual) - lag] * there for lag in range(1, lags + 1)]
        self._before = residual[len(residual) - lags :]
        own = np.concatenate([own[:, :-2], *(lagged[:, None] for lagged in before), own[:, -2:]], axis=1)
        beside = np.zeros((len(own), 0)) if decays is None else decays.columns[samples]
        self._projected.absorb(regressors.factors, own, beside)
        self._shared, self._shape = regressors, own.shape[1:]

    def coordinates(self, n: int, decays: FreeDecays | None) -> Iterator[tuple[int, SaturatedCoordinates]]:
        """Yield the channels in directions of their saturated models; `n`: number of columns by the state."""
        record, p = self._record, self._record.model.parameters
        R, inside, by_decays, outside = self._projected.ended(self._shape)
        assert self._shared is not None
        ranges = saturated_directions(R, self._shared.values.shape[1])
        widths = p, n, inside.shape[1] - p - n - 3 - len(self._before), len(self._before)
        for k, c in enumerate(self._channels):
            by_state = None
            if decays is not None:
                by_state = by_decays @ (decays.weights[c] @ (record.root / record.data.rms[c]))
            columns = ChannelColumns(inside[..., k], outside[..., k], widths, by_state)
            count = int(record.data.counts[c]) * min(1.0, record.data.passed)
            yield c, saturated_coordinates(self._shared, ranges, columns, count)


def _column_blocks(
    record: Any, fit: RecordFit, decays: FreeDecays | None, there: NDArray[np.bool_], rows: int
) -> Iterator[_Columns]:
    """Yield the columns of all channels at so many samples after the other."""
    assert fit.measured is not None
    rms, start = record.data.rms, fit.predicted.start
    for first, by_parameter, by_state in _sensitivities(record, fit.eta, start, rows, decays):
        here = slice(first, first + len(by_parameter))
        values = fit.predicted.outputs[here], fit.measured[here], fit.residual[here]
        states = np.moveaxis(by_state @ record.root, 1, 2) if by_state.size else by_state
        parts = [part / rms for part in (*values, by_parameter, states)]
        present = there[here]
        if not present.all():
            absent = ~present
            parts = [np.where(absent if part.ndim == 2 else absent[:, None], 0.0, part) for part in parts]
        yield _Columns(here, *parts)


def _sensitivities(
    record: Any, eta: Array, start: Array, rows: int, decays: FreeDecays | None
) -> Iterator[tuple[int, Array, Array]]:
    """Yield first samples, and derivatives by parameters (k x p x channels) and state (k x channels x n)."""
    samples = len(record.data.values)
    if decays is None:
        at_once = record.rows_at_once()
        at_once = rows if at_once < samples else samples
        for block in record.blocks(eta, start, record.model, at_once):
            for first in range(0, len(block.outputs), rows):
                part = slice(first, first + rows)
                by_parameter = np.moveaxis(block.by_parameter[part], 1, 2)
                yield block.samples.start + first, by_parameter, block.by_state[part]
        return
    done, channels = 0, len(record.data.rms)
    held: Array | None = None
    for block in sensitive_blocks(record.model, eta, start):
        left = block.by_parameter
        while len(left):
            if held is None:
                held = np.empty((min(rows, samples - done), *left.shape[1:]))
                filled = 0
            taken = left[: len(held) - filled]
            held[filled : filled + len(taken)] = taken
            filled, left = filled + len(taken), left[len(taken) :]
            if filled == len(held):
                yield done, held, np.zeros((filled, 0, channels))
                done, held = done + filled, None


def shared_regressors(record: Any, fit: RecordFit) -> RegressorsInTime:
    """Return the regressors of the saturated model that the channels share."""
    max_count = most_regressors(int(record.data.counts.min() * min(1.0, record.data.passed)))
    forced = _FORCED.setdefault(record.model, {})
    if max_count not in forced:
        inputs = [record.model.inputs(order) for order in (0, 1)]
        forced[max_count] = forced_regressors(record.model.signals, inputs, record.model.times, max_count)
    key, kept = fit.eta.tobytes(), record.kept_regressors
    shared: RegressorsInTime | None = kept.get(key)
    if shared is None:
        kept.clear()
        shared = kept[key] = regressors_in_time(forced[max_count], record.model.poles(fit.eta), max_count)
    return shared


def _of_clock(record: Any, fit: RecordFit, channel: int) -> RegressorsInTime:
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
    return regressors_in_time(forced, model.poles(fit.eta), max_count)


def _derivative(signal: Signal, order: int, times: Array) -> Array:
    """Return a derivative of a signal at times."""
    G, h = signal.generator()
    return np.asarray(signal.states(times, times) @ (h @ np.linalg.matrix_power(G, order)))
