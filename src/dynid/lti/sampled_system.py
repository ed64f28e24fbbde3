"""Time responses of linear systems with sampled controllers, between the samples as well."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from heapq import heappop, heappush
from math import lcm
from typing import Any

import numpy as np

from dynid.arrays import Array
from dynid.errors import UsageError
from dynid.lti.delay_system import DelayedResponse, DelaySystem
from dynid.lti.generator import Signal
from dynid.lti.method_of_steps import MAX_SEGMENTS, Propagation, Segment

#: Part of a period after an instant at which signals are those after a jump there.
_AFTER = 1e-9


_Terms = list[tuple[float, int]]
"""Factors of states by their number, of what is measured, -1, and of what is beyond limits, -2, in order."""


@dataclass(frozen=True, eq=False)
class SampledController:
    """ξ[k+1] = F ξ[k] + g y[k] + t w[k], answer a = -(h ξ[k] + d y[k]), held from its computation time on.

    Of an answer with limits, what is beyond these is w.
    """

    F: Array
    g: Array
    h: Array
    d: float
    computation: Fraction  # s
    period: Fraction  # s
    t: Array
    low: float = -math.inf
    high: float = math.inf

    @property
    def limited(self) -> bool:
        """True if the answer has limits."""
        return self.low > -math.inf

    @cached_property
    def terms(self) -> tuple[_Terms, list[_Terms]]:
        """The answer, and every next state, as sums of products: the arithmetic of its C function, too."""
        weights = self.t if self.limited else 0 * self.t
        rows = [(-self.h, -self.d, 0.0), *zip(self.F, self.g, weights, strict=True)]
        answer, *states = (
            [
                (factor, k)
                for k, factor in [*enumerate(row.tolist()), (-1, float(gain)), (-2, float(weight))]
                if factor
            ]
            for row, gain, weight in rows
        )
        return answer, states

    def step(self, state: Sequence[float], measured: float) -> tuple[float, list[float]]:
        """Return the answer to what is measured, and the next state."""
        answer_terms, rates = self.terms
        answer = _sum_in_order(factor * [*state, measured][k] for factor, k in answer_terms)
        given = min(max(answer, self.low), self.high)
        values = [*state, answer - given, measured]
        return given, [_sum_in_order(factor * values[k] for factor, k in terms) for terms in rates]


def _sum_in_order(products: Iterable[float]) -> float:
    """Return a sum as C has it, without the compensation of `sum`."""
    total = 0.0
    for position, product in enumerate(products):
        total = total + product if position else product
    return total


@dataclass(frozen=True, eq=False)
class SampledSystem(DelaySystem):
    """A system whose last inputs u are held by sampled controllers, which measure its last outputs y.

    What is measured at an instant has the jumps of signals there, and what is held until then.
    """

    controllers: tuple[SampledController, ...]

    @property
    def period(self) -> Fraction:
        """The shortest period, s."""
        return min(controller.period for controller in self.controllers)

    @property
    def paces(self) -> tuple[Fraction, ...]:
        """The times, s, by which it acts on itself."""
        return (*self.delays, self.period)

    def with_inputs(self, names: Sequence[str]) -> DelaySystem:
        """Return it with these inputs u ahead of those that are held."""
        held = self.lft.inputs[self.inputs - len(self.controllers) : self.inputs]
        return super().with_inputs([*names, *held])

    def with_outputs(self, rows: Sequence[int]) -> DelaySystem:
        """Return it with these outputs y ahead of those that are measured."""
        measured = range(self.outputs - len(self.controllers), self.outputs)
        return super().with_outputs([*rows, *measured])

    def propagation(self, signals: Sequence[Signal], stop: float, **options: Any) -> Propagation:
        """Return a run of it from rest at t = 0."""
        return _SampledPropagation(self, signals, stop, **options)

    def response(self, signals: Sequence[Signal], times: Array) -> DelayedResponse:
        """Return the response as `DelaySystem.response` does, without what is measured."""
        response, shown = super().response(signals, times), slice(self.outputs - len(self.controllers))
        if response.impulsive[shown.stop :].any():
            raise UsageError(
                "what a sampled controller measures has a Dirac impulse, of which no sample has a value",
                remedy="Give the signal a duration (kind: impact), or let it act elsewhere.",
                names=("analysis.time",),
            )
        return response._replace(
            outputs=response.outputs[:, shown],
            error=response.error[shown],
            impulsive=response.impulsive[shown],
        )


class _SampledPropagation(Propagation):
    """The response of a `SampledSystem`, from one instant at which it measures or holds to the next."""

    def __init__(self, system: SampledSystem, signals: Sequence[Signal], stop: float, **options: Any) -> None:
        samples = stop / float(system.period)
        if not samples <= MAX_SEGMENTS:
            raise UsageError(
                f"the time response takes {samples:.2g} samples; at most {MAX_SEGMENTS:,} are computed",
                remedy="Shorten the time (stop), or lengthen the sample time.",
                names=("analysis.time",),
            )
        self._controllers, self._period = system.controllers, system.period
        periods = dict.fromkeys(controller.period for controller in system.controllers)
        times = [*periods, *(controller.computation for controller in system.controllers)]
        tick = Fraction(1, lcm(*(time.denominator for time in times)))
        every = [*signals, *(None for _ in system.controllers)]
        super().__init__(system.lft, system.delays, every, stop, period=tick, **options)
        self._states = [[0.0] * len(controller.h) for controller in system.controllers]
        #: Instants ahead: time, loop that holds and value, or -1 and the period of those that measure.
        self._events: list[tuple[Fraction, int, float | Fraction]] = [(Fraction(0), -1, p) for p in periods]

    def segments(self, until: Fraction, *, beyond: bool = False) -> Iterator[Segment]:
        """Propagate to a time, and yield the segments up to there; `beyond`: one more that begins there."""
        while self._events[0][0] <= until:
            yield from super().segments(self._events[0][0])
            time, loop, value = heappop(self._events)
            if loop >= 0:
                self.hold(self._inputs - len(self._controllers) + loop, float(value))
                continue
            for index, (controller, measured) in enumerate(
                zip(self._controllers, self._measured().tolist(), strict=True)
            ):
                if controller.period == value:
                    answer, self._states[index] = controller.step(self._states[index], measured)
                    heappush(self._events, (time + controller.computation, index, answer))
            heappush(self._events, (time + Fraction(value), -1, value))
        yield from super().segments(until, beyond=beyond)

    def _measured(self) -> Array:
        """Return the last outputs now, after jumps of signals, with what is held until now."""
        self._meet_breaks()
        inputs, orders = self._inputs, len(self._direct)
        now, after = float(self.time), _AFTER * float(self._period)
        values = np.zeros((orders, self._B.shape[1]))  # of inputs and their derivatives
        for column, signal in enumerate(self.signals):
            if signal is None:
                values[0, column] = self._held[column]
                continue
            G, readout = signal.generator()
            state = signal.states(np.array([now]), np.array([now + after]))[0]
            for order in range(orders):
                values[order, column] = readout @ state
                state = G @ state
        signs = (-1.0) ** np.arange(self.degree + 1)
        for index in range(len(self._delays)):
            coefficients = self._delayed(index, self._now, self._now + self._shortest)
            for order in range(orders):
                values[order, inputs + index] = signs @ coefficients
                coefficients = self._rate @ coefficients / (self._shortest / self._unit)
        outputs = self._C @ self._x
        for matrix, row in zip(self._direct, values, strict=True):
            outputs = outputs + matrix @ row
        shown = self._shown
        return np.asarray(outputs[shown - len(self._controllers) : shown])
