"""The method of steps for linear systems with constant delays inside (Bellman & Cooke 1963, 3.3).

Segment by segment u, v, z and y are Chebyshev polynomials, and x follows exactly by one matrix exponential
for every distinct length: no step is limited by stiffness. Break points b + Σ k_i τ_i are borders of
segments, as exact fractions, up to the order in which they no longer show; elsewhere segments are halved
until the polynomials are resolved.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Sequence
from fractions import Fraction
from heapq import heapify, heappop, heappush
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from dynid.arrays import Array, guarded
from dynid.errors import NumericalError, UsageError
from dynid.lti.exponential import balance, exponential, rescaled
from dynid.lti.generator import Signal
from dynid.lti.signals import Random
from dynid.lti.state_space import StateSpace
from dynid.lti.time_response import derivative_jumps, joint_generator

#: Most segments of a response, about two minutes.
MAX_SEGMENTS = 1_000_000
#: Degree of the polynomials, and their last coefficients, relative to the largest value, where they are
#: resolved.
_DEGREE, _TAIL_RTOL = 12, 1e-12
#: Last coefficients that are examined, and halvings of a segment after which it is not resolved.
_TAIL, _MAX_HALVINGS = 3, 60
#: Order of the derivative up to which jumps are borders: beyond, polynomials resolve them at once.
_MAX_BREAK_ORDER = 4
#: Coefficient k of the inputs is scaled by its power k: else the joint exponential loses digits.
_COEFFICIENT_SCALE = 8.0
#: Roundings of a sum of products that polynomials do not resolve.
_NOISE = 64 * float(np.finfo(float).eps)
#: Relative size of the jump of an input that is not rounding.
_JUMP_RTOL = 1e-9
#: Denominator to which break points of signals are rounded, relative to the duration: they are decimal
#: multiples, read from doubles.
_BREAK_DENOMINATOR = 10**9
#: Bits of the common denominator of delays and break points; of irrational ones they are many.
_MAX_DENOMINATOR_BITS = 4000
#: Bytes of the operators of distinct lengths that are kept.
_MAX_OPERATOR_BYTES = 200_000_000


class Segment(NamedTuple):
    """A stretch of a response: Chebyshev coefficients of y and of u (degree + 1 x outputs, x inputs)."""

    start: float  # s
    stop: float
    outputs: Array
    inputs: Array

    def at(self, times: Array) -> Array:
        """Return y at times within it (times x outputs)."""
        return _evaluate(self.outputs, (times - self.start) / (self.stop - self.start))


class _Past(NamedTuple):
    """A segment that delays still reach back to, its ends in ticks."""

    start: int
    stop: int
    outputs: Array  # coefficients of y and z


class Propagation:
    """The response of a system with internal delays from rest at t = 0, segment after segment.

    `lft`, `delays`: as of a `DelaySystem`.

    `signals`: one for each input u; None: an input that is held, 0 until `hold` changes it at the present
    time. A sampled controller advances to each instant (`for segment in run.segments(instant)`), reads what
    it measures just before (`run.now`), and holds its answer (`run.hold`). `stop`, s: the end, for a refusal
    beforehand of more than `MAX_SEGMENTS`. `period`: of such instants, which are then exact, as are delays
    and break points of signals.
    """

    def __init__(
        self,
        lft: StateSpace,
        delays: Sequence[Fraction],
        signals: Sequence[Signal | None],
        stop: float,
        *,
        period: Fraction = Fraction(1),
        degree: int = _DEGREE,
        rtol: float = _TAIL_RTOL,
    ) -> None:
        #: The numbers of inputs u and of outputs y.
        self._inputs, self._shown = (count - len(delays) for count in reversed(lft.D.shape))
        if len(signals) != self._inputs:
            raise UsageError(f"a system needs one signal per input: {self._inputs}, not {len(signals)}")
        self.signals, self.degree, self.rtol = list(signals), degree, rtol
        self.stop = _exact(stop)
        breaks = self._signal_breaks()
        self._unit = _common_denominator([*delays, self.stop, period, *(time for time, *_ in breaks)])
        #: Break points ahead: time in ticks, input, order of the derivative that jumps, Dirac strength.
        self._breaks: list[tuple[int, int, int, float]] = [
            (self._ticks(time), column, order, strength) for time, column, order, strength in breaks
        ]
        heapify(self._breaks)
        self._delays, self._now = [self._ticks(delay) for delay in delays], 0
        self._shortest = min(self._delays, default=self._ticks(self.stop or Fraction(1)))
        self._longest = max(self._delays, default=0)
        self.count = 0  #: The number of segments so far.
        self._refuse(-(-self._ticks(self.stop) // self._shortest))
        self._scale = balance(lft.A)
        self._A = rescaled(lft.A, self._scale)
        self._B, self._C = lft.B / self._scale[:, None], lft.C * self._scale
        self._direct = [lft.D, *lft.higher]
        self._x = np.zeros(len(lft.A))
        #: The nodes, the values of the polynomials at them, and the inverse; derivatives of coefficients.
        self._nodes = (1 - np.cos(np.pi * np.arange(degree + 1) / degree)) / 2
        self._values = chebyshev.chebvander(2 * self._nodes - 1, degree)
        self._inverse = np.linalg.inv(self._values)
        self._rate = np.zeros((degree + 1, degree + 1))  # by the fraction of the segment, not by θ
        for k in range(1, degree + 1):
            self._rate[:-1, k] = 2 * chebyshev.chebder(np.eye(degree + 1)[k])
        self._constant = np.eye(1, degree + 1)[0]
        self._operators: dict[float, tuple[Array, Array]] = {}
        self._bytes = 0
        self._held = np.zeros(self._inputs)
        self._past = deque([_Past(-self._longest - 1, 0, np.zeros((degree + 1, len(lft.C))))])
        self._cursors = [0] * len(delays)
        self._before: Array | None = None  # coefficients of all inputs on the last segment, by its length
        self._length = 1.0
        self._sizes = np.zeros(sum(lft.D.shape))
        self._orders = break_orders(lft)
        #: Outputs with a Dirac part.
        self.impulsive = np.zeros(self._shown, dtype=bool)
        self._readouts = [None if signal is None else signal.generator()[1] for signal in self.signals]

    @property
    def time(self) -> Fraction:
        """The present time, s."""
        return Fraction(self._now, self._unit)

    def _ticks(self, time: Fraction) -> int:
        return round(time * self._unit)

    def _signal_breaks(self) -> list[tuple[Fraction, int, int, float]]:
        """Return break points of signals: time, input, order of the derivative that jumps, Dirac strength."""
        breaks, stop = [], float(self.stop)
        for column, signal in enumerate(self.signals):
            if signal is None:
                continue
            if signal.jump:
                breaks.append((Fraction(0), column, -1, signal.jump))
            orders = range(_MAX_BREAK_ORDER + 1) if stop else ()
            order = next((k for k in orders if derivative_jumps(signal, k, stop)), None)
            if order is not None:
                times = {Fraction(0), *(_exact(time, self.stop) for time in signal.breakpoints(0.0, stop))}
                breaks += [(time, column, order, 0.0) for time in times]
        return breaks

    def hold(self, column: int, value: float) -> None:
        """Hold an input u that has no signal at a value from the present time on."""
        self._held[column] = value
        heappush(self._breaks, (self._now, column, 0, 0.0))

    @property
    def now(self) -> Array:
        """The outputs y just before the present time."""
        return np.asarray(self._past[-1].outputs.sum(axis=0)[: self._shown])

    @guarded("the time response", remedy="Shorten the time (stop), or stabilise the system.")
    def outputs(self, times: Array) -> Array:
        """Return y (times x outputs) up to the last of some times; values at a jump are those after it."""
        values, first = np.empty((len(times), self._shown)), 0
        # A time within its rounding of a border is on it; the last one has a segment of its own to begin.
        moved = times + 4 * np.finfo(float).eps * np.abs(times)
        end = _exact(float(times[-1]), self.stop)
        for segment in self.segments(end, beyond=True):
            last = int(np.searchsorted(moved, segment.stop)) if segment.stop <= float(end) else len(times)
            if last > first:
                values[first:last] = segment.at(times[first:last])
                first = last
        return values

    def segments(self, until: Fraction, *, beyond: bool = False) -> Iterator[Segment]:
        """Propagate to a time, and yield the segments up to there; `beyond`: one more that begins there."""
        end = self._ticks(until)
        while self._now < end:
            self._meet_breaks()
            yield from self._stretch(min([end, *(time for time, *_ in self._breaks[:1])]))
        if beyond:
            self._meet_breaks()
            ahead = min([self._now + self._shortest, *(time for time, *_ in self._breaks[:1])])
            yield next(self._stretch(ahead, beyond=True))

    # --- break points ---------------------------------------------------------------------------------

    def _meet_breaks(self) -> None:
        """Pass what jumps at the present time on to later times, and let the state jump by Dirac parts."""
        inputs = self._inputs
        orders = np.full(self._B.shape[1], np.inf)
        strengths = np.zeros((1, self._B.shape[1]))  # of δ, δ', …
        while self._breaks and self._breaks[0][0] <= self._now:
            _, column, order, strength = heappop(self._breaks)
            orders[column] = min(orders[column], order)
            if order < 0:
                strengths = np.pad(strengths, ((0, max(0, -order - len(strengths))), (0, 0)))
                strengths[-order - 1, column] += strength
        if np.isinf(orders).all():
            return
        if strengths.any():
            self._jump(strengths)
        passed_on = (self._orders + orders).min(axis=1)[self._shown :]
        for index, order in enumerate(passed_on):
            if order <= _MAX_BREAK_ORDER:
                time = self._now + self._delays[index]
                heappush(self._breaks, (time, inputs + index, max(int(order), 0), 0.0))

    def _jump(self, strengths: Array) -> None:
        """Apply Dirac impulses and their derivatives (orders x inputs) to the state and the outputs."""
        states = np.zeros((len(strengths), len(self._x)))  # of δ, δ', … in x
        power = self._B
        for shift in range(len(strengths)):  # x holds A^shift B times the integrals of what drives it
            self._x = self._x + power @ strengths[shift]
            for order in range(shift + 1, len(strengths)):
                states[order - 1 - shift] += power @ strengths[order]
            power = self._A @ power
        self._emit(strengths, states @ self._C.T)

    def _emit(self, strengths: Array, parts: Array) -> None:
        """Pass the Dirac parts of outputs on: those of the inputs, and of the states (orders x outputs)."""
        parts = np.pad(parts, ((0, len(self._direct) - 1), (0, 0)))
        for shift, matrix in enumerate(self._direct):
            parts[shift : shift + len(strengths)] += strengths @ matrix.T
        shown = self._shown
        self.impulsive |= (parts[:, :shown] != 0).any(axis=0)
        for order, index in zip(*np.nonzero(parts[:, shown:]), strict=True):
            time, column = self._now + self._delays[index], self._inputs + int(index)
            heappush(self._breaks, (time, column, -1 - int(order), float(parts[order, shown + index])))

    def _differentiate_jumps(self, coefficients: Array, length: float) -> None:
        """Pass Dirac parts on that come of jumps of inputs through derivatives of these."""
        count = len(self._direct) - 1
        jumps = np.zeros((count, coefficients.shape[1]))
        signs = (-1.0) ** np.arange(len(coefficients))
        before = self._before if self._before is not None else np.zeros_like(coefficients)
        for order in range(count):
            after, earlier = signs @ coefficients, before.sum(axis=0)
            size = np.maximum(np.abs(coefficients).sum(axis=0), np.abs(before).sum(axis=0))
            jumps[order] = np.where(np.abs(after - earlier) > _JUMP_RTOL * size, after - earlier, 0.0)
            coefficients = self._rate @ coefficients / length
            before = self._rate @ before / self._length
        if jumps.any():
            parts = np.zeros((count, len(self._C)))
            for order, matrix in enumerate(self._direct[1:], 1):
                for lower in range(order):
                    parts[order - 1 - lower] += matrix @ jumps[lower]
            self._emit(np.zeros((1, coefficients.shape[1])), parts)

    # --- segments -------------------------------------------------------------------------------------

    def _stretch(self, end: int, *, beyond: bool = False) -> Iterator[Segment]:
        """Propagate to a time without break points before it; `beyond`: signals continue as they begin."""
        self._refuse(self.count - (self._now - end) // self._shortest)
        fresh = True
        while self._now < end:
            pending = [(self._now, min(self._now + self._shortest, end), 0)]
            while pending:
                low, high, halvings = pending.pop()
                segment = self._segment(low, high, low if beyond else (low + high) // 2, fresh=fresh)
                if segment is None:
                    if halvings >= _MAX_HALVINGS:
                        raise NumericalError(
                            f"the time response is not resolved near {low / self._unit:.6g} s",
                            remedy="Shorten the time, or bring the values nearer to each other.",
                        )
                    middle = (low + high) // 2
                    pending += [(middle, high, halvings + 1), (low, middle, halvings + 1)]
                    continue
                fresh = False
                yield segment

    def _refuse(self, count: int) -> None:
        if count > MAX_SEGMENTS:
            raise UsageError(
                f"the time response takes {count:,} segments or more, one in every delay of "
                f"{self._shortest / self._unit:g} s; at most {MAX_SEGMENTS:,} are computed",
                remedy="Shorten the time (stop), or leave out a delay that is short beside it.",
                names=("analysis.time",),
            )

    def _segment(self, low: int, high: int, piece: int, *, fresh: bool) -> Segment | None:
        """Propagate over a segment; None where polynomials do not resolve it.

        `piece`: a time of the pieces of the signals that hold there.
        """
        start, length, count = low / self._unit, (high - low) / self._unit, self._B.shape[1]
        joined = np.empty((self.degree + 1, len(self._sizes)))  # coefficients of u, v, y, z
        inputs, outputs = joined[:, :count], joined[:, count:]
        for column in range(self._inputs):
            inputs[:, column] = self._driving(column, start, length, piece / self._unit)
        for index in range(len(self._delays)):
            inputs[:, self._inputs + index] = self._delayed(index, low, high)
        outputs_of, state_of = self._operator(length)
        known = np.concatenate([self._x, inputs.ravel()])
        outputs[:] = (outputs_of @ known).reshape(outputs.shape)
        sizes = np.abs(joined)
        tails, sizes = sizes[-_TAIL:].max(axis=0), np.maximum(self._sizes, sizes.max(axis=0))
        if (tails > self.rtol * sizes).any():
            # Signals are evaluated at rounded times, which moves them by what they change meanwhile.
            moved = high / self._unit / length * (np.arange(len(inputs)) @ np.abs(inputs))
            largest = np.abs(inputs).max(axis=0) + moved / 8
            rounding = np.concatenate([np.abs(self._x), (np.abs(inputs) + largest / 16).ravel()])
            lost = (np.abs(outputs_of) @ rounding).reshape(outputs.shape).max(axis=0)
            if np.any(tails > self.rtol * sizes + _NOISE * np.concatenate([largest, lost])):
                return None
        self.count += 1
        self._sizes = sizes
        if fresh and len(self._direct) > 1:
            self._differentiate_jumps(inputs, length)
        self._before, self._length = inputs, length
        self._x = state_of @ known
        self._now = high
        self._past.append(_Past(low, high, outputs))
        while self._past[0].stop <= high - self._longest and len(self._past) > 1:
            self._past.popleft()
            self._cursors = [max(cursor - 1, 0) for cursor in self._cursors]
        shown = self._shown
        return Segment(start, high / self._unit, outputs[:, :shown], inputs[:, : self._inputs])

    def _driving(self, column: int, start: float, length: float, piece: float) -> Array:
        """Return the coefficients of an input u on a segment."""
        signal, readout = self.signals[column], self._readouts[column]
        if signal is None or readout is None:
            return np.asarray(self._held[column] * self._constant)
        if len(readout) == 1:  # piecewise constant
            value = signal.states(np.array([start]), np.array([piece]))[0, 0] * readout[0]
            return np.asarray(value * self._constant)
        times = start + self._nodes * length
        if isinstance(signal, Random):  # without breakpoints, and cheaper than its derivatives
            return np.asarray(self._inverse @ signal.value(times))
        return np.asarray(self._inverse @ (signal.states(times, np.full(len(times), piece)) @ readout))

    def _delayed(self, index: int, low: int, high: int) -> Array:
        """Return the coefficients of v_i on a segment, from those of z_i a delay before."""
        row, past, k = self._shown + index, self._past, self._cursors[index]
        low, high = low - self._delays[index], high - self._delays[index]
        while past[k].stop <= low:
            k += 1
        self._cursors[index] = k
        if past[k].start == low and past[k].stop == high:
            return past[k].outputs[:, row]
        values, first = np.empty(self.degree + 1), 0
        while True:
            start, stop, outputs = past[k]
            last = len(values)
            if stop < high:
                last = int(np.searchsorted(self._nodes, (stop - low) / (high - low)))
            width = stop - start
            fraction = (low - start) / width + self._nodes[first:last] * ((high - low) / width)
            values[first:last] = _evaluate(outputs[:, row], fraction)
            if stop >= high:
                return np.asarray(self._inverse @ values)
            first, k = last, k + 1

    def _operator(self, length: float) -> tuple[Array, Array]:
        """Return the matrices from state and coefficients of inputs to those of outputs, and to the state."""
        if length not in self._operators:
            operators = self._built_operator(length)
            size = sum(matrix.nbytes for matrix in operators)
            if self._bytes + size > _MAX_OPERATOR_BYTES:
                self._operators.clear()
                self._bytes = 0
            self._operators[length] = operators
            self._bytes += size
        return self._operators[length]

    def _built_operator(self, length: float) -> tuple[Array, Array]:
        n, count, terms = len(self._A), self._B.shape[1], self.degree + 1
        directions = np.eye(n) if n < count else self._B  # fewer columns, fewer coefficients
        scale = np.asarray(_COEFFICIENT_SCALE ** np.arange(terms), dtype=np.float64)
        rate = self._rate * scale[:, None] / scale
        signs = np.asarray((-1.0) ** np.arange(terms), dtype=np.float64)
        drive = np.asarray(np.kron(directions * length, signs / scale), dtype=np.float64)
        rates = np.asarray(np.kron(np.eye(directions.shape[1]), rate), dtype=np.float64)
        joint = joint_generator(self._A * length, drive, rates)
        states = np.zeros((terms, n, n + count * terms))
        for k, node in enumerate(self._nodes.tolist() if n else ()):
            E = exponential(joint, node)[:n]
            forced = E[:, n:].reshape(n, directions.shape[1], terms) * scale
            if directions is not self._B:
                forced = np.einsum("abk,bm->amk", forced, self._B)
            states[k, :, :n] = E[:, :n]
            states[k, :, n:] = forced.transpose(0, 2, 1).reshape(n, -1)  # coefficients by inputs
        outputs = np.einsum("on,kna->koa", self._C, states)
        values = self._values
        for matrix in self._direct:
            direct = np.einsum("om,kt->kotm", matrix, values)
            outputs[:, :, n:] += direct.reshape(terms, len(self._C), -1)
            values = values @ self._rate / length
        coefficients = np.einsum("jk,koa->joa", self._inverse, outputs)
        return coefficients.reshape(-1, coefficients.shape[-1]), states[-1]


def _evaluate(coefficients: Array, fraction: Array) -> Array:
    """Return polynomials at fractions of their segment."""
    angle = np.arccos(np.clip(2 * fraction - 1, -1.0, 1.0))
    return np.asarray(np.cos(np.outer(angle, np.arange(len(coefficients)))) @ coefficients)


def _common_denominator(times: Sequence[Fraction]) -> int:
    """Return the ticks of a second: times are whole numbers of them, also halved, while it stays small."""
    denominator = 1
    for time in times:
        extended = math.lcm(denominator, time.denominator)
        if extended.bit_length() <= _MAX_DENOMINATOR_BITS:
            denominator = extended
    return denominator << _MAX_HALVINGS


def _exact(time: float, duration: Fraction | None = None) -> Fraction:
    """Return a time as the fraction of a small denominator that it rounds, relative to the duration."""
    unit = Fraction(10) ** math.floor(math.log10(float(duration or time or 1)) + 1)
    return (Fraction(time) / unit).limit_denominator(_BREAK_DENOMINATOR) * unit


def break_orders(lft: StateSpace) -> Array:
    """Return by how many orders a jump of each input is smoother in each output (outputs x inputs)."""
    matrices = [*lft.higher[::-1], lft.D]
    column = lft.B
    for _ in range(_MAX_BREAK_ORDER + 1):
        column = column / np.maximum(np.abs(column).max(axis=0, initial=0.0), np.finfo(float).tiny)
        matrices.append(lft.C @ column)
        column = lft.A @ column  # scaled: of these products only zeros count
    orders = np.full(lft.D.shape, np.inf)
    for order, matrix in enumerate(matrices, -len(lft.higher)):
        orders[(matrix != 0) & np.isinf(orders)] = order
    return orders
