"""Samples of a record at which every input of its model is known.

A sampled signal is known from its first sample to its last, any other one from t = 0 on. A channel that is
late by d records the model's output of d before, which depends on the inputs up to then: of its first samples
the inputs are not known, and of its last ones where it is early.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from dynid.arithmetic.dependent import Real
from dynid.arrays import Array
from dynid.errors import UsageError
from dynid.identification.systems.parametric_model import ParametricModel
from dynid.lti.signals import Derivative, Sampled, Shifted, Signal
from dynid.parameters import named, rates

#: Part of a sampling step by which a sample may lie outside and still count as known: round-off of times.
SAMPLE_TIME_TOL = 1e-6
# Part of a record that the range of delays that are sought may leave out at each end, beside their starts.
_MAX_SEARCHED_SHARE = 0.1
# Fewest samples to which a record may be shortened.
_MIN_SAMPLES = 2


class KnownSamples(NamedTuple):
    """Numbers of samples that are left out at the beginning (`before`) and at the end (`after`).

    Of channels with clocks of their own the numbers `of_channels`, channel by channel, instead.
    """

    before: int = 0
    after: int = 0
    of_channels: tuple[tuple[int, int], ...] = ()

    @property
    def total(self) -> int:
        """Number of samples, or with clocks of values, that are left out."""
        return self.before + self.after + sum(map(sum, self.of_channels))

    def including(self, samples: KnownSamples) -> KnownSamples:
        """Return the samples that both leave."""
        both = self.of_channels, samples.of_channels
        pairs = zip(both[0] or both[1], both[1] or both[0], strict=True)
        of_channels = tuple((max(a, c), max(b, d)) for (a, b), (c, d) in pairs)
        return KnownSamples(max(self.before, samples.before), max(self.after, samples.after), of_channels)


NONE_LEFT_OUT = KnownSamples()


def known_samples(
    model: ParametricModel, times: Array, eta: Array, reach: Array, *, at_rest_before: bool
) -> KnownSamples:
    """Return how many of the samples at these times to leave out: not every input is known there.

    `eta`, `reach`: coordinates of the parameters, and how far these may be off (p). `at_rest_before`: of
    simulated records, which follow the model from t = 0 on. Raises UsageError if hardly a sample is left.
    """
    left_out = _left_out_by_clocks if model.instruments.clocked else _left_out
    nearest = left_out(model, times, eta, 0.0 * reach, at_rest_before)
    counts = model.instruments.present(len(times)).sum(axis=0)
    left = counts - [sum(of_channel) for of_channel in nearest.of_channels or [nearest[:2]] * len(counts)]
    if left.min() < _MIN_SAMPLES:
        what = "delays, and clocks of channels," if model.instruments.clocked else "delays"
        raise UsageError(
            f"the {what} leave {max(0, left.min())} of {counts[left.argmin()]} samples at which every "
            "input is known",
            remedy="Correct the delays of the channels and of the excitation (s), or take a longer record.",
            names=("channels", "excitation", "records"),
        )
    if not reach.any():
        return nearest
    farthest = left_out(model, times, eta, reach, at_rest_before)
    max_count = int(_MAX_SEARCHED_SHARE * len(times))
    return KnownSamples(
        min(farthest.before, nearest.before + max_count),
        min(farthest.after, nearest.after + max_count),
        tuple(
            (min(far[0], near[0] + max_count), min(far[1], near[1] + max_count))
            for far, near in zip(farthest.of_channels, nearest.of_channels, strict=True)
        ),
    )


def _left_out_by_clocks(
    model: ParametricModel, times: Array, eta: Array, reach: Array, at_rest_before: bool
) -> KnownSamples:
    """Return the samples of each channel that are left out, as of `_left_out`."""
    begin, end = known_span(model, eta, reach)
    begin = max(begin, 0.0) if at_rest_before else begin
    instants = model.instruments.instants(times, named(model.unknowns, eta))
    low, high = _reached(model, instants.value, instants.slopes, eta, reach)
    rounding = SAMPLE_TIME_TOL * float(np.min(np.diff(times), initial=1.0))
    present = model.instruments.present(len(times))
    before = np.count_nonzero(present & (low < begin - rounding), axis=0)
    after = np.count_nonzero(present & (high > end + rounding), axis=0)
    return KnownSamples(of_channels=tuple(zip(before.tolist(), after.tolist(), strict=True)))


def _left_out(
    model: ParametricModel, times: Array, eta: Array, reach: Array, at_rest_before: bool
) -> KnownSamples:
    """Return the samples left out for delays within a range of the coordinates (centre and reach, p)."""
    begin, end = known_span(model, eta, reach)
    begin = max(begin, 0.0) if at_rest_before else begin
    low, high = _range(model, model.instruments.delays, eta, reach)
    rounding = SAMPLE_TIME_TOL * float(np.min(np.diff(times), initial=1.0))
    before = times - max(0.0, float(high.max(initial=0.0))) < begin - rounding
    after = times - min(0.0, float(low.min(initial=0.0))) > end + rounding
    return KnownSamples(int(np.count_nonzero(before)), int(np.count_nonzero(after)))


def known_span(model: ParametricModel, eta: Array, reach: Array | None = None) -> tuple[float, float]:
    """Return first and last time, s, at which every input is known at coordinates within a reach (p)."""
    begin, end, reach = -math.inf, math.inf, 0.0 * eta if reach is None else reach
    loads_low, loads_high = _range(model, model.instruments.load_delays, eta, reach)
    for signal, earliest, latest in zip(model.signals, loads_low, loads_high, strict=True):
        first, last = _span(signal)
        begin, end = max(begin, first + latest), min(end, last + earliest)
    return begin, end


def _range(model: ParametricModel, delays: Sequence[Real], eta: Array, reach: Array) -> tuple[Array, Array]:
    """Return the least and greatest values of delays where coordinates are within their limits and reach."""
    return _reached(model, *model.instruments.numbers(delays, named(model.unknowns, eta)), eta, reach)


def _reached(
    model: ParametricModel, value: Array, slopes: Array, eta: Array, reach: Array
) -> tuple[Array, Array]:
    """Return the ends of numbers (…) with derivatives (p x …) where coordinates are within their reach."""
    unknowns, ends = model.unknowns, []
    rate = rates(unknowns, eta)
    for side in (-1.0, 1.0):
        limits = [unknown.low if side < 0 else unknown.high for unknown in unknowns]
        moved = [
            side * far
            if limit is None
            else side * max(0.0, min(far, side * (unknown.coordinate(limit) - at)))
            for unknown, limit, at, far in zip(unknowns, limits, eta.tolist(), reach.tolist(), strict=True)
        ]
        ends.append((np.array(moved) * rate).reshape(-1, *[1] * value.ndim) * slopes)
    return value + np.minimum(*ends).sum(axis=0), value + np.maximum(*ends).sum(axis=0)


def _span(signal: Signal) -> tuple[float, float]:
    """Return the first and last time, s, at which a signal is known."""
    if isinstance(signal, Derivative):
        return _span(signal.signal)
    if isinstance(signal, Shifted):
        first, last = _span(signal.signal)
        return first + signal.delay, last + signal.delay
    return (signal.start, signal.stop) if isinstance(signal, Sampled) else (0.0, math.inf)
