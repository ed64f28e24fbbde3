"""Instruments of a record: gains, offsets, delays and clocks of its channels, gains and delays of its loads.

A channel records ``gain * y(t - delay) + offset`` of the quantity y of the model, at times t of its clock; a
load acts as ``gain * u(t - delay)`` of its signal u. Each number may depend on unknown parameters.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.arithmetic.dependent import Dependent, Real, evaluated
from dynid.arrays import Array
from dynid.lti.signals import Shifted, Signal
from dynid.lti.state_space import Matrices
from dynid.parameters import Parameter
from dynid.structure.ports import ChannelClock


class Numbers(NamedTuple):
    """Numbers of loads or channels, and their derivatives by the parameters' values (p x numbers)."""

    value: Array
    slopes: Array


class Instants(NamedTuple):
    """Times of the model that samples of the channels record (times x channels), s.

    `slopes` (p x times x channels): their derivatives by the parameters' values.
    """

    value: Array
    slopes: Array


class RecordSampling(NamedTuple):
    """Times at which a model is evaluated for channels that are delayed."""

    times: Array  # the sampling times and those of what delayed channels record, ascending (u), s
    rows: NDArray[np.int64]  # place among these of each recorded value (times x channels)
    own: NDArray[np.int64]  # place of each sampling time (times)

    @classmethod
    def of(cls, times: Array, delays: Array) -> RecordSampling | None:
        """Return the times for delays of the channels (channels), s; None where all are zero."""
        if not delays.any():
            return None
        shifted = times[:, None] - np.concatenate([[0.0], delays])
        order = np.argsort(shifted, axis=None, kind="stable")
        ascending = shifted.ravel()[order]
        # Times that are equal to rounding are one.
        step = float(np.min(np.diff(times), initial=np.inf))
        new = np.concatenate([[True], np.diff(ascending) > 1e-9 * (step if np.isfinite(step) else 1.0)])
        places = np.empty(shifted.size, dtype=np.int64)
        places[order] = np.cumsum(new) - 1
        rows = places.reshape(shifted.shape)
        return cls(ascending[new], rows[:, 1:], rows[:, 0])

    @classmethod
    def at_nodes(cls, nodes: Array, times: Array, channels: int) -> RecordSampling:
        """Return the sampling times, which are among the nodes of a timeline, for all channels."""
        own = np.searchsorted(nodes, times)
        return cls(nodes, np.repeat(own[:, None], channels, axis=1), own)

    def gathered(self, values: Array) -> Array:
        """Return values (u x channels x …) of each channel at its own times (times x channels x …)."""
        return np.asarray(values[self.rows, np.arange(self.rows.shape[1])])

    def spread(self, values: Array) -> Array:
        """Return recorded values (times x channels) at these times (u x channels), NaN elsewhere."""
        out = np.full((len(self.times), self.rows.shape[1]), np.nan)
        out[self.rows, np.arange(self.rows.shape[1])] = values
        return out


@dataclass(frozen=True, eq=False)
class Instruments:
    """The instruments of a record."""

    parameters: tuple[str, ...]  # names of the parameters (p)
    # `load_gains`, `load_delays`: of the loads; delays in s
    load_gains: tuple[Real, ...]
    load_delays: tuple[Real, ...]
    # `gains`, `offsets`, `delays`: of the channels; offsets in their units
    gains: tuple[Real, ...]
    offsets: tuple[Real, ...]
    delays: tuple[Real, ...]
    clocks: tuple[ChannelClock | None, ...]  # of the channels; None: that of the record

    @classmethod
    def of(cls, parameters: Sequence[str], loads: Sequence[Any], channels: Sequence[Any]) -> Instruments:
        """Return the instruments of loads and channels."""
        return cls(
            tuple(parameters),
            tuple(load.gain for load in loads),
            tuple(load.delay for load in loads),
            tuple(channel.gain for channel in channels),
            tuple(channel.offset for channel in channels),
            tuple(channel.delay for channel in channels),
            tuple(getattr(channel, "clock", None) for channel in channels),
        )

    def acting(self, signals: Sequence[Signal], values: Mapping[str, float]) -> list[Signal]:
        """Return the signals as they act at values of the parameters, delayed; gains are in `applied`."""
        delays = self.numbers(self.load_delays, values).value.tolist()
        return [
            Shifted(signal, delay) if delay else signal for signal, delay in zip(signals, delays, strict=True)
        ]

    @property
    def clocked(self) -> bool:
        """True if a channel has a clock of its own."""
        return any(clock is not None for clock in self.clocks)

    @property
    def drifts(self) -> tuple[Real, ...]:
        """The drifts of the channels' clocks."""
        return tuple(0.0 if clock is None else clock.drift for clock in self.clocks)

    def synchronous(self) -> Instruments:
        """Return the instruments with the clock of the record for all channels."""
        return replace(self, clocks=(None,) * len(self.clocks))

    def present(self, samples: int) -> NDArray[np.bool_]:
        """Return where channels have one of so many samples (samples x channels)."""
        counts = [samples if clock is None else clock.samples for clock in self.clocks]
        return np.asarray(np.arange(samples)[:, None] < np.array(counts))

    def instants(self, times: Array, values: Mapping[str, float]) -> Instants:
        """Return when each sample is recorded, less the delay, at values of the parameters.

        `times`: those of the record's samples, from the first one on, s. After the last sample of a channel
        its time repeats.
        """
        (delay, late), (drift, slower) = (
            self.numbers(numbers, values) for numbers in (self.delays, self.drifts)
        )
        instants, elapsed = times[:, None] - delay, np.zeros((len(times), len(delay)))
        for column, clock in enumerate(self.clocks):
            if clock is not None:
                elapsed[:, column] = clock.step * np.minimum(np.arange(len(times)), clock.samples - 1)
                first = times[0] + clock.start - delay[column]
                instants[:, column] = first + elapsed[:, column] * (1 + drift[column])
        return Instants(instants, slower[:, None] * elapsed - late[:, None])

    @property
    def ideal(self) -> bool:
        """True if they change nothing but the times of samples."""
        gains, rest = (*self.load_gains, *self.gains), (*self.load_delays, *self.offsets, *self.delays)
        numbers = all(not isinstance(number, Dependent) for number in (*gains, *rest))
        return numbers and all(gain == 1 for gain in gains) and not any(rest)

    @property
    def delayed(self) -> bool:
        """True if a load or channel has a delay, known or not."""
        return any(isinstance(delay, Dependent) or delay for delay in (*self.load_delays, *self.delays))

    @property
    def unknown_delays(self) -> bool:
        """True if a delay depends on parameters."""
        return any(isinstance(delay, Dependent) for delay in (*self.load_delays, *self.delays))

    def numbers(self, numbers: Sequence[Real], values: Mapping[str, float]) -> Numbers:
        """Return numbers of loads or channels at values of the parameters, with their derivatives."""
        evaluations = [evaluated(number, values) for number in numbers]
        slopes = np.zeros((len(self.parameters), len(numbers)))
        for column, evaluation in enumerate(evaluations):
            for name, slope in evaluation.slopes.items():
                if name in self.parameters:
                    slopes[self.parameters.index(name), column] = slope
        return Numbers(np.array([evaluation.value for evaluation in evaluations]), slopes)

    def applied(self, matrices: Matrices, values: Mapping[str, float]) -> Matrices:
        """Return the matrices from the signals, delayed, to what the channels record, but for offsets.

        With G_u and G_y the gains: B G_u, G_y C, G_y D G_u. The derivative of a record by the delay of its
        channel is minus the rate of the output, C A x + C B u + D du/dt; with clocks it is `readout`'s. That
        by the delay of a load enters through -du/dt, of which the part of D is here and that of B is
        `ParametricModel.transition`'s.
        """
        if self.ideal:
            return matrices
        (gu, gu_slopes), (gy, gy_slopes) = (
            self.numbers(gains, values) for gains in (self.load_gains, self.gains)
        )
        B, C = matrices.B * gu, gy[:, None] * matrices.C
        D = gy[:, None] * matrices.D * gu
        B_slopes = matrices.B_slopes * gu + matrices.B * gu_slopes[:, None, :]
        C_slopes = gy[:, None] * matrices.C_slopes + gy_slopes[:, :, None] * matrices.C
        D_slopes = gy[:, None] * matrices.D_slopes * gu
        D_slopes = D_slopes + (gy_slopes[:, None, :, None] * (matrices.D * gu))
        D_slopes = D_slopes + gy[:, None] * matrices.D * gu_slopes[:, None, None, :]
        (_, late_u), (_, late_y) = (
            self.numbers(delays, values) for delays in (self.load_delays, self.delays)
        )
        if self.clocked:
            late_y = np.zeros_like(late_y)
        if late_y.any() or late_u.any():
            C_slopes = C_slopes - late_y[:, :, None] * (C @ matrices.A)
            none = np.zeros((1, *D.shape[1:]))
            D, rates = np.concatenate([D, none]), np.concatenate([(C @ B)[None], D])
            D_slopes = np.concatenate([D_slopes, np.zeros((len(D_slopes), *none.shape))], axis=1)
            D_slopes = D_slopes - late_y[:, None, :, None] * rates
            D_slopes[:, 1:] -= D[:-1] * late_u[:, None, None, :]
        return Matrices(matrices.A, B, C, D, matrices.A_slopes, B_slopes, C_slopes, D_slopes)


def with_spreads(
    parameters: Sequence[Parameter], instruments: Instruments, step: float, sizes: Array
) -> tuple[Parameter, ...]:
    """Return parameters with the spread of first guesses of offsets, delays and drifts that have none.

    `parameters`: the unknown parameters (p); `instruments`: those of a record. `step`: its sampling step, s;
    `sizes`: RMS of its channels (channels).
    """
    values = {parameter.name: parameter.start for parameter in parameters}
    spans = [
        (instruments.offsets, 2 * sizes),
        (instruments.delays, np.full(len(instruments.delays), 4 * step)),
        (instruments.load_delays, np.full(len(instruments.load_delays), 4 * step)),
        # Four samples over the record.
        (instruments.drifts, np.array([4 / clock.samples if clock else 0.0 for clock in instruments.clocks])),
    ]
    spreads = np.zeros(len(parameters))
    for numbers, span in spans:
        slopes = np.abs(instruments.numbers(numbers, values).slopes)
        reach = np.divide(span, slopes, out=np.zeros_like(slopes), where=slopes > 0)
        spreads = np.maximum(spreads, reach.max(axis=1, initial=0.0))
    bounded = (
        parameter.prior or (parameter.low is not None and parameter.high is not None)
        for parameter in parameters
    )
    return tuple(
        parameter
        if parameter.logarithmic or fixed or not span
        else replace(parameter, spread=max(span, parameter.spread or 0.0, 2 * abs(parameter.start)))
        for parameter, fixed, span in zip(parameters, bounded, spreads.tolist(), strict=True)
    )
