"""Rise time, settling time, overshoot and peak of step responses of systems with delays.

The response is propagated (`lti/delay_system.py`) until the deviation from its steady state stays below a
small part of its largest over several time constants and delays. Extremes and crossings are those of its
polynomials, jumps included.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction

import numpy as np
from numpy.polynomial import chebyshev

from dynid.arrays import Array
from dynid.errors import NumericalError
from dynid.lti.delay_system import DelaySystem
from dynid.lti.signals import Step
from dynid.lti.step_info import BAND, IMPROPER, StepInfo
from dynid.lti.step_info import Step as StepResponse

#: Deviation from the steady state, relative to its largest, at which a response has settled.
_SETTLED_RTOL = 1e-9
#: Time constants of the slowest pole, and largest delays, over which it has settled.
_TIME_CONSTANTS, _DELAYS = 3, 3
#: Most segments of a response, some seconds.
_MAX_SEGMENTS = 20_000
#: Excess, relative to the final value, and final value, relative to the largest deviation, that is rounding.
_ROUNDING = 1e-12
#: Points of each segment at which extremes and crossings are looked for.
_POINTS = 25


def delayed_steps(system: DelaySystem, finals: Sequence[float], slowest: float) -> list[StepInfo]:
    """Return the characteristics of the first outputs of a stable system with one input.

    `finals`: the steady state of each output. `slowest`: the largest real part of a pole, rad/s, negative.
    """
    window = max(_TIME_CONSTANTS / -slowest, _DELAYS * float(max(system.paces)))
    shortest = float(min(system.paces))
    if window > _MAX_SEGMENTS * shortest:
        slow = f"a time constant of {-1 / slowest:.3g} s takes too many delays of {shortest:.3g} s"
        return [StepInfo(f"not computed: {slow}")] * len(finals)
    longest = _MAX_SEGMENTS * shortest
    run = system.propagation([Step()], longest)
    starts, stops, coefficients = [], [], []
    largest, quiet_from = np.zeros(len(finals)), 0.0
    try:
        for segment in run.segments(Fraction(longest)):
            starts.append(segment.start)
            stops.append(segment.stop)
            outputs = segment.outputs[:, : len(finals)]
            coefficients.append(outputs)
            deviation = np.abs(outputs).sum(axis=0) - np.abs(outputs[0]) + np.abs(outputs[0] - finals)
            largest = np.maximum(largest, deviation)
            if np.any(deviation > _SETTLED_RTOL * largest):
                quiet_from = segment.stop
            if segment.stop - quiet_from >= window or run.count > _MAX_SEGMENTS:
                break
    except NumericalError as error:
        return [StepInfo(f"not computed: {error.problem}")] * len(finals)
    if stops[-1] - quiet_from < window:
        problem = f"the response has not settled after {run.count:,} delays or parts of them"
        return [StepInfo(f"not computed: {problem}")] * len(finals)
    finals = np.where(np.abs(finals) > _ROUNDING * largest, finals, 0.0).tolist()
    times = np.array([starts, stops])
    stacked = np.stack(coefficients)  # segments x coefficients x outputs
    return [
        StepInfo(f"undefined: {IMPROPER}")
        if run.impulsive[output]
        else _DelayedStep(times, stacked[:, :, output], final).info()
        for output, final in enumerate(finals)
    ]


class _DelayedStep(StepResponse):
    """A step response as polynomials, of which the characteristics are sought."""

    def __init__(self, times: Array, coefficients: Array, final: float) -> None:
        self.final = self.limit = self.ball = final
        self._starts, self._stops = times
        self._deviations = coefficients.copy()
        self._deviations[:, 0] -= final
        self._points = (1 - np.cos(np.pi * np.arange(_POINTS) / (_POINTS - 1))) / 2
        values = chebyshev.chebvander(2 * self._points - 1, coefficients.shape[1] - 1)
        self._values = self._deviations @ values.T  # segments x points
        self.initial = float(final + self._values[0, 0])
        self._extremes: dict[float, float] = {math.inf: 0.0}

    def _largest(self, sign: int) -> tuple[float, float]:
        """Return the supremum of sign · d over t > 0 and its time; 0 at inf where d has the other sign."""
        values = sign * self._values
        best = float(values.max())
        if best <= 0:
            return 0.0, math.inf
        segment, point = divmod(int((values >= best * (1 - _ROUNDING)).argmax()), _POINTS)  # the first one
        at, value = self._points[point], float(values[segment, point])
        slope = np.trim_zeros(chebyshev.chebder(self._deviations[segment]), "b")
        roots = chebyshev.chebroots(slope) if len(slope) > 1 else np.zeros(0)
        for root in roots[np.abs(roots.imag) < 1e-9].real:
            size = float(sign * chebyshev.chebval(root, self._deviations[segment]))
            if -1 < root < 1 and size > value * (1 + _ROUNDING):
                at, value = (root + 1) / 2, size
        time = self._time(segment, at)
        self._extremes[time] = sign * value
        return value, time

    def _time(self, segment: int, fraction: float) -> float:
        start, stop = self._starts[segment], self._stops[segment]
        return float(start + fraction * (stop - start))

    def _difference(self, time: float) -> float:
        return abs(self._extremes[time])

    def _percent(self, time: float, beyond: int = 0) -> float:
        excess = self._difference(time) / abs(self.final) - beyond
        return 100 * excess if excess > _ROUNDING else 0.0

    def _value(self, time: float) -> float:
        return self.final + self._extremes[time]

    def _seconds(self, time: float) -> float:
        return time

    def _reached(self, fraction: float) -> float:
        """Return the first time at which the response is at least a part of its final value."""
        sign = 1 if self.final > 0 else -1
        over = np.asarray(sign * self._values >= (fraction - 1) * self.final * sign)
        segment = int(over.any(axis=1).argmax())
        point = int(np.argmax(over[segment]))
        return self._crossing(segment, point - 1, point, (fraction - 1) * self.final)

    def _last_outside(self, reference: float, level: float) -> float:
        """Return the last time, s, at which |d| exceeds `BAND` of the reference; 0 if never."""
        outside = np.abs(self._values) > BAND * reference
        if not outside.any():
            return 0.0
        segment = int(np.flatnonzero(outside.any(axis=1))[-1])
        point = _POINTS - 1 - int(np.argmax(outside[segment, ::-1]))
        level = math.copysign(BAND * reference, self._values[segment, point])
        return self._crossing(segment, point, point + 1, level)

    def _crossing(self, segment: int, low: int, high: int, level: float) -> float:
        """Return the time at which d takes a level between two points; a jump lies between segments."""
        from scipy.optimize import brentq

        if low < 0 or high >= _POINTS:
            return self._time(segment, 0.0 if low < 0 else 1.0)
        coefficients, ends = self._deviations[segment], self._points[[low, high]].tolist()
        if self._values[segment, low] == level or self._values[segment, high] == level:
            return self._time(segment, ends[int(self._values[segment, high] == level)])

        def excess(fraction: float) -> float:
            return float(chebyshev.chebval(2 * fraction - 1, coefficients)) - level

        return self._time(segment, brentq(excess, ends[0], ends[1], xtol=1e-15))
