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

# Part of a sampling step by which a sample may lie outside and still count as known: round-off of times.
_SAMPLE_TIME_TOL = 1e-6
# Part of a record that the range of delays that are sought may leave out at each end, beside their starts.
_MAX_SEARCHED_SHARE = 0.1
# Fewest samples to which a record may be shortened.
_MIN_SAMPLES = 2


class KnownSamples(NamedTuple):
    """Numbers of samples that are left out at the beginning (`before`) and at the end (`after`)."""

    before: int = 0
    after: int = 0

    def including(self, samples: KnownSamples) -> KnownSamples:
        """Return the samples that both leave."""
        return KnownSamples(max(self.before, samples.before), max(self.after, samples.after))


NONE_LEFT_OUT = KnownSamples()


def known_samples(
    model: ParametricModel, times: Array, eta: Array, reach: Array, *, at_rest_before: bool
) -> KnownSamples:
    """Return how many of the samples at these times to leave out: not every input is known there.

    `eta`, `reach`: coordinates of the parameters, and how far these may be off (p). `at_rest_before`: of
    simulated records, which follow the model from t = 0 on. Raises UsageError if hardly a sample is left.
    """
    nearest = _left_out(model, times, eta, 0.0 * reach, at_rest_before)
    if sum(nearest) > len(times) - _MIN_SAMPLES:
        raise UsageError(
            f"the delays leave {max(0, len(times) - sum(nearest))} of {len(times)} samples at which every "
            "input is known",
            remedy="Correct the delays of the channels and of the excitation (s), or take a longer record.",
            names=("channels", "excitation", "records"),
        )
    if not reach.any():
        return nearest
    farthest = _left_out(model, times, eta, reach, at_rest_before)
    max_count = int(_MAX_SEARCHED_SHARE * len(times))
    return KnownSamples(
        min(farthest.before, nearest.before + max_count), min(farthest.after, nearest.after + max_count)
    )


def _left_out(
    model: ParametricModel, times: Array, eta: Array, reach: Array, at_rest_before: bool
) -> KnownSamples:
    """Return the samples left out for delays within a range of the coordinates (centre and reach, p)."""
    loads_low, loads_high = _range(model, model.instruments.load_delays, eta, reach)
    low, high = _range(model, model.instruments.delays, eta, reach)
    begin, end = (0.0 if at_rest_before else -math.inf), math.inf
    for signal, earliest, latest in zip(model.signals, loads_low, loads_high, strict=True):
        first, last = _span(signal)
        begin, end = max(begin, first + latest), min(end, last + earliest)
    rounding = _SAMPLE_TIME_TOL * float(np.min(np.diff(times), initial=1.0))
    before = times - max(0.0, float(high.max(initial=0.0))) < begin - rounding
    after = times - min(0.0, float(low.min(initial=0.0))) > end + rounding
    return KnownSamples(int(np.count_nonzero(before)), int(np.count_nonzero(after)))


def _range(model: ParametricModel, delays: Sequence[Real], eta: Array, reach: Array) -> tuple[Array, Array]:
    """Return the least and greatest values of delays where coordinates are within their limits and reach."""
    unknowns = model.unknowns
    (value, slopes), rate = model.instruments.numbers(delays, named(unknowns, eta)), rates(unknowns, eta)
    ends = []
    for side in (-1.0, 1.0):
        limits = [unknown.low if side < 0 else unknown.high for unknown in unknowns]
        moved = [
            side * far
            if limit is None
            else side * max(0.0, min(far, side * (unknown.coordinate(limit) - at)))
            for unknown, limit, at, far in zip(unknowns, limits, eta.tolist(), reach.tolist(), strict=True)
        ]
        ends.append((np.array(moved) * rate)[:, None] * slopes)
    return value + np.minimum(*ends).sum(axis=0), value + np.maximum(*ends).sum(axis=0)


def _span(signal: Signal) -> tuple[float, float]:
    """Return the first and last time, s, at which a signal is known."""
    if isinstance(signal, Derivative):
        return _span(signal.signal)
    if isinstance(signal, Shifted):
        first, last = _span(signal.signal)
        return first + signal.delay, last + signal.delay
    return (signal.start, signal.stop) if isinstance(signal, Sampled) else (0.0, math.inf)
