"""Rise time, settling time, overshoot and peak of step responses, from exact transfer functions.

The response to a unit step from rest, T(s)/s, is its steady state and a sum of exponentials
(`lti/exponential_sums.py`), in which every extreme is found; crossings of levels are refined in ball
arithmetic. Nothing depends on a time step.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from dynid.errors import NumericalError
from dynid.lti.certified_roots import certified_roots
from dynid.lti.exponential_sums import ExponentialSum
from dynid.lti.stability import SidedRoot, stability

#: The band around the final value, and the levels between which the response rises, relative to it.
BAND, LOW, HIGH = 0.02, 0.1, 0.9
#: Why a step response has no characteristics.
NO_STEADY_STATE = (
    "there is no steady state; {}; stabilise it by damping or by the gains of a feedback, or take a time "
    "response"
)
IMPROPER = (
    "the response to a step has an impulse (the channel is improper); take the impulse response, or another "
    "output"
)
#: An envelope below this is a response at rest.
_MIN_ENVELOPE = 1e-280


@dataclass(frozen=True)
class StepInfo:
    """The characteristics of the response to a unit step, from rest; None where one is not defined."""

    status: str  # `defined`, or the reason why some or all are not
    #: The limits at t -> ∞ and t = 0+.
    final_value: float | None = None
    initial_value: float | None = None
    #: The time from 10 % to 90 % of the final value, each reached for the first time, s.
    rise_time: float | None = None
    #: The time from which on the response stays within 2 % of the final value, s.
    settling_time: float | None = None
    #: The time from which on it differs from the final value by at most 2 % of its largest difference, s.
    transient_time: float | None = None
    #: The largest excess over the final value, and beyond 0 on the other side, in % of the final value.
    overshoot: float | None = None
    undershoot: float | None = None
    #: The value of the largest magnitude, and when it is taken, s; inf where it is the final value, which is
    #: approached from below.
    peak: float | None = None
    peak_time: float | None = None


def step_info(numerator: Any, denominator: Any) -> StepInfo:
    """Return the characteristics of a step response of T(s) in lowest terms (flint `fmpz_poly`)."""
    if numerator == 0:
        return StepInfo("undefined: the input does not reach the output")
    poles: tuple[SidedRoot, ...] = certified_roots(denominator)
    if not all(pole.side == -1 for pole in poles):
        return StepInfo(f"undefined: {NO_STEADY_STATE.format(stability(poles))}")
    if numerator.degree() > denominator.degree():
        return StepInfo(f"undefined: {IMPROPER}")
    if not poles:
        value = _quotient(numerator[0], denominator[0])
        return StepInfo("defined", value, value, 0.0, 0.0, 0.0, 0.0, 0.0, value, 0.0)
    try:
        return Step(numerator, denominator).info()
    except NumericalError as error:
        return StepInfo(f"not computed: {error.problem}")


def _quotient(above: Any, below: Any) -> float:
    return int(above) / int(below)


class Step:
    """A step response of which the characteristics are sought."""

    def __init__(self, numerator: Any, denominator: Any) -> None:
        from flint import arb, ctx, fmpq

        self.transient = ExponentialSum(numerator, denominator)
        order = denominator.degree()
        self.initial = _quotient(numerator[order], denominator[order])
        self.final = _quotient(numerator[0], denominator[0])
        with ctx.workprec(self.transient.precision):
            # the final value in the units of the transient, and its rounding
            self.ball = arb(fmpq(numerator[0], denominator[0])) / self.transient.size
            self.limit = float(self.ball.mid())
        if self.limit == 0 and self.final != 0:
            raise NumericalError("the final value is beyond double precision beside the transient")

    def info(self) -> StepInfo:
        """Return the characteristics."""
        above, below = self._largest(1), self._largest(-1)
        largest = max(above, below, key=lambda extreme: extreme[0])
        transient_time = self._last_outside(largest[0], self._difference(largest[1]) / 50)
        if self.final == 0:
            status = (
                "partly defined: rise time, settling time and overshoot refer to the final value, which is 0"
            )
            return StepInfo(
                status,
                self.final,
                self.initial,
                transient_time=transient_time,
                peak=self._value(largest[1]),
                peak_time=self._seconds(largest[1]),
            )
        final = abs(self.limit)
        beyond, before = (above, below) if self.limit > 0 else (below, above)
        if beyond[0] >= before[0] - 2 * final and beyond[0] > 0:
            peak, time = self._value(beyond[1]), self._seconds(beyond[1])
        elif before[0] > 2 * final:
            peak, time = self._value(before[1]), self._seconds(before[1])
        else:
            peak, time = self.final, math.inf
        return StepInfo(
            "defined",
            self.final,
            self.initial,
            rise_time=self._seconds(self._reached(HIGH) - self._reached(LOW)),
            settling_time=self._last_outside(final, abs(self.ball) / 50),
            transient_time=transient_time,
            overshoot=self._percent(beyond[1]) if beyond[0] > 0 else 0.0,
            undershoot=self._percent(before[1], 1) if before[0] > (1 - 1e-9) * final else 0.0,
            peak=peak,
            peak_time=time,
        )

    # Extremes

    def _largest(self, sign: int) -> tuple[float, Any]:
        """Return the supremum of sign · d over t > 0 and its time; 0 at inf where d has the other sign."""
        transient = self.transient
        start = float(sign * transient.at(0, 0).mid())
        best, bracket = max(start, 0.0), None
        ever = transient.last_extreme()
        low = 0.0
        while True:
            high = min(2 * low or 1.0, ever) if ever > low else low
            for times, values in transient.pieces(low, high) if high > low else ():
                index = int(np.argmax(sign * values))
                if sign * values[index] > best:
                    best = float(sign * values[index])
                    bracket = (times[max(index - 1, 0)], times[min(index + 1, len(times) - 1)], times[index])
            envelope = transient.bound(high)
            if envelope <= best or high >= ever or envelope < _MIN_ENVELOPE:
                break
            low = high
        if bracket is None:
            return (best, 0.0) if best > 0 else (0.0, math.inf)
        return best, self._turning(*bracket)

    def _turning(self, low: float, high: float, near: float) -> Any:
        """Return the time of an extreme."""
        rate = self.transient.at
        for width in (1e-9, 1e-6, 1e-3):  # a bracket with one extreme, as narrow as it may be
            ends = max(low, near * (1 - width)), min(high, near * (1 + width))
            if bool(rate(ends[0], 1).mid() > 0) is not bool(rate(ends[1], 1).mid() > 0):
                return self.transient.root(1, 0, *ends)
        return near

    def _difference(self, time: Any) -> Any:
        """Return |d| at a time, as a ball."""
        return abs(self.transient.at(time, 0))

    def _percent(self, time: Any, beyond: int = 0) -> float:
        """Return |d| at a time in % of the final value, beyond so many times this value."""
        from flint import arb, ctx

        with ctx.workprec(self.transient.precision):
            excess = self._difference(time) / abs(self.ball) - beyond
            return float((100 * excess).mid()) if excess > arb(0) else 0.0

    def _value(self, time: Any) -> float:
        """Return the response at a time."""
        from flint import ctx

        with ctx.workprec(self.transient.precision):
            return float(((self.ball + self.transient.at(time, 0)) * self.transient.size).mid())

    def _seconds(self, time: Any) -> float:
        from flint import arb, ctx

        with ctx.workprec(self.transient.precision):
            return float((arb(time) * self.transient.time).mid())

    # Levels

    def _reached(self, fraction: float) -> Any:
        """Return the first time at which the response is at least a part of its final value."""
        from flint import arb, fmpq

        transient, sign = self.transient, 1 if self.limit > 0 else -1
        level = float((fraction - 1) * self.limit) * sign
        exact = self.ball * (arb(fmpq(round(1000 * fraction), 1000)) - 1)
        if sign * float(transient.at(0, 0).mid()) >= level:
            return arb(0)
        low, late = 0.0, transient.horizon(-level)
        high = min(1.0, late)
        while True:
            for times, values in transient.pieces(low, high):
                over = np.flatnonzero(sign * values[1:] >= level)
                if len(over):
                    return transient.root(0, exact, times[over[0]], times[over[0] + 1])
            low, high = high, min(2 * high, late)

    def _last_outside(self, reference: float, level: Any) -> float:
        """Return the last time, s, at which |d| exceeds a level, `BAND` of the reference; 0 if never."""
        transient = self.transient
        high = transient.horizon(BAND * reference)
        while high > 0:
            low = high / 2 if high > 1e-3 else 0.0
            for times, values in transient.pieces(low, high, backward=True):
                over = np.flatnonzero(np.abs(values[:-1]) > BAND * reference)
                if len(over):
                    at = over[-1]
                    bound = level if values[at] > 0 else -level
                    return self._seconds(transient.root(0, bound, times[at], times[at + 1]))
            high = low
        return 0.0
