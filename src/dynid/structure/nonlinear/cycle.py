"""Force of a joint's law over a cycle of a periodic deflection, as Fourier coefficients with derivatives.

The alternating frequency/time scheme (T. M. Cameron, J. H. Griffin 1989), with events instead of samples: a
law is followed from guard to guard, each event is located on the trigonometric polynomial, and the force of a
regime is integrated in closed form where it is affine, else by Clenshaw–Curtis quadrature. Coefficients and
derivatives have no error of sampling, also with friction, whose derivatives are continuous in the deflection
alone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from dynid.arrays import Array, ComplexArray
from dynid.errors import NumericalError
from dynid.structure.law import BoundLaw, Slopes
from dynid.structure.nonlinear.fourier import (
    basis,
    clenshaw_curtis,
    derivatives,
    further_harmonics,
    multiplied,
    rate_of,
    sampled,
    series,
    to_chebyshev,
    to_real,
)
from dynid.structure.nonlinear.masing import MasingCycle

# Points of a cycle at which guards are scanned for their first zero, over the highest harmonic.
_SCAN = 16
# Events of a cycle beyond which a joint chatters.
_MAX_EVENTS = 400
# Cycles until a hysteresis loop has to be closed.
_MAX_CYCLES = 60
# Change of a hidden state over a cycle, relative to the deflection, whose effect is added to first order.
_NEAR_TOL = 0.03
# Change of hidden states in the iteration of a panel, relative to the deflection: round-off.
_ROUND_OFF = 1e-13
# Length of a panel of collocation of hidden states, rad, and its nodes.
_PANEL, _PANEL_NODES = np.pi / 3, 20
# Smallest interval in which an event is located, rad, the most iterations that this takes, and the step
# of Newton's iteration after which the error, of the order of its square, is less.
_EVENT_TOL, _MAX_LOCATIONS, _EVENT_STEP = 1e-13, 60, 1e-7
# Jump of a force at an event, relative to the force, that is round-off.
_JUMP_TOL = 1e-9
# Derivative of a hidden state by itself a cycle before, less than 1 by which a loop forgets it.
_FREE_TOL = 1e-9
# Force at the highest sampled harmonics of a smooth law, relative to its largest, that is round-off, and the
# most samples of a cycle.
_ALIAS_TOL, _MAX_SAMPLES = 1e-13, 4096


class CycleForce(NamedTuple):
    """Force of a law over a cycle.

    `coefficients` (2 J + 1, J > H): of the force, also beyond the H harmonics of the deflection; `by_motion`
    (2 H + 1 x 2 H + 1), `by_omega` (2 H + 1), `by_parameters` (2 H + 1 x parameters and offset, or none):
    derivatives; `hidden`: hidden state and regime at the beginning of a cycle.
    """

    coefficients: Array
    by_motion: Array
    by_omega: Array
    by_parameters: Array
    hidden: tuple[float, int]


def cycle_force(
    law: BoundLaw,
    q: Array,
    omega: float,
    hidden: tuple[float, int] | None = None,
    *,
    parameters: bool = False,
) -> CycleForce:
    """Return the force of a law over a cycle of the deflection q (2 H + 1) at a frequency, rad/s.

    `hidden`: hidden state and regime near those of the closed loop; default: sliders as they are before they
    first slip; `parameters`: True: derivatives by the parameters as well.

    Raises NumericalError if a loop does not close or a regime changes without end.
    """
    if law.law.remembers:
        masing, size = MasingCycle(law, q, parameters=parameters), len(q)
        by_motion, by_parameters = masing.slopes[:, :size], masing.slopes[:, size:]
        return CycleForce(masing.coefficients, by_motion, np.zeros(size), by_parameters, (0.0, 0))
    if not law.law.hidden and not law.guards(law.regime(0.0, 0.0, 0.0), 0.0, 0.0, 0.0):
        return _smooth(law, q, omega, parameters=parameters)
    return _Cycle(law, q, omega, parameters=parameters).closed(hidden)


def _smooth(law: BoundLaw, q: Array, omega: float, *, parameters: bool) -> CycleForce:
    """Return the force of a law without regimes, from samples as many as its harmonics need."""
    harmonics = len(q) // 2
    samples = max(64, 1 << (8 * harmonics + 7).bit_length())
    while True:
        T, D, projection = sampled(harmonics, samples)
        rate = D @ q
        f = law.force(0, T @ q, omega * rate, 0.0)
        size = np.abs(np.fft.rfft(np.broadcast_to(f.value, samples)))
        if size[-samples // 8 :].max() <= _ALIAS_TOL * size.max() or samples >= _MAX_SAMPLES:
            break
        samples *= 2
    rows = projection[: len(q)]

    def projected(slope: Array, at: Array) -> Array:
        return np.asarray((rows * slope) @ at)

    by_motion = projected(f.d, T) + projected(omega * np.asarray(f.v), D)
    by_p = [rows @ np.broadcast_to(slope, samples) for slope in f.p] if parameters else []
    return CycleForce(
        projection @ np.broadcast_to(f.value, samples), by_motion, rows @ (f.v * rate),
        np.array(by_p).reshape(-1, len(q)).T, (0.0, 0),
    )  # fmt: skip


class _Segment(NamedTuple):
    """A part of a cycle in one regime: its nodes, weights, and the hidden state there with its columns.

    With a constant hidden state its ends alone.
    """

    theta: Array
    weights: Array | None
    z: Array
    slopes: Array  # columns of the hidden state (nodes or 1 x columns)
    regime: int

    def with_nodes(self, harmonics: int) -> _Segment:
        """Return the segment with nodes and weights for a deflection of so many harmonics."""
        if self.weights is not None:
            return self
        low, length = self.theta[0], self.theta[1] - self.theta[0]
        x, weights, _ = clenshaw_curtis(16 + 8 * int(np.ceil(length * (harmonics + 1) / 6)))
        return self._replace(theta=low + length * x, weights=length * weights)


class _Cycle:
    """A law followed over cycles of a deflection.

    Columns are derivatives by the coefficients of the deflection, the frequency, the first hidden state, and
    the parameters, if these are asked for.
    """

    def __init__(self, law: BoundLaw, q: Array, omega: float, *, parameters: bool) -> None:
        self.law, self.q, self.omega = law, q, omega
        self.harmonics = len(q) // 2
        self.parameters = len(law.values) + 1 if parameters else 0
        self.columns = len(q) + 2 + self.parameters
        samples = max(128, _SCAN * self.harmonics)
        T, D, _ = sampled(self.harmonics, samples)
        self.scan = np.linspace(0.0, 2 * np.pi, samples + 1)[1:]
        d, v = T @ q, omega * (D @ q)
        self.d, self.v = (np.concatenate([x[1:], x[:1]]) for x in (d, v))
        self.size = float(np.abs(self.d).max())
        self._orders = np.arange(1, self.harmonics + 1)
        self._phasors = self._orders ** np.arange(3)[:, None] * (q[1::2] - 1j * q[2::2])
        self._mean = float(q[0])
        self.flows = law.rate(0, 0.0, 1.0, 0.0) is not None

    def phases(self, theta: float) -> ComplexArray:
        """Return ``exp(i h theta)`` of the harmonics."""
        return np.asarray(np.exp(1j * theta * self._orders))

    def at(self, phases: ComplexArray) -> tuple[float, float, float]:
        """Return deflection, its rate and acceleration at an angle."""
        of_d, of_v, of_a = (self._phasors @ phases).tolist()
        return self._mean + of_d.real, -self.omega * of_v.imag, -(self.omega**2) * of_a.real

    def rows(self, theta: Array) -> tuple[Array, Array]:
        """Return the columns of deflection and rate at angles (angles x columns)."""
        T, D = basis(theta, self.harmonics)
        of_d, of_v = np.zeros((2, len(theta), self.columns))
        size = len(self.q)
        of_d[:, :size], of_v[:, :size], of_v[:, size] = T, self.omega * D, D @ self.q
        return of_d, of_v

    def _of_parameters(self, f: Slopes) -> Iterator[tuple[int, Any]]:
        """Yield the columns of the parameters, and the slopes by these."""
        if self.parameters:
            yield from enumerate(f.p, len(self.q) + 2)

    def closed(self, hidden: tuple[float, int] | None) -> CycleForce:
        """Return the force of the closed loop, to first order in the change of a hidden state.

        In Newton's iteration on the deflection, of which each evaluation begins where the last one closed,
        the remaining error vanishes with the step.
        """
        virgin = self._virgin()
        z, regime = virgin if hidden is None else hidden
        place, cycles = len(self.q) + 1, 0
        while cycles < _MAX_CYCLES:
            segments, end, slopes, last, jumps = self._followed(z, regime)
            cycles += 1
            change, free = end - z, 1.0 - slopes[place]
            if not self.flows and abs(free) < _FREE_TOL and (z, regime) != virgin:
                z, regime = virgin  # a slider that does not slip is where it was before it ever did
            elif last == regime and abs(change) <= _NEAR_TOL * (self.size + abs(z)):
                return self._projected(segments, slopes, jumps, (z, regime), change)
            else:
                z = z + change / free if last == regime and self.flows and free > _FREE_TOL else end
                regime = last
        raise NumericalError(
            f"the hysteresis of a joint does not close in {_MAX_CYCLES} cycles",
            remedy="Lower the amplitude, or change the parameters of its law.",
        )

    def _virgin(self) -> tuple[float, int]:
        d, v = float(self.d[-1]), float(self.v[-1])
        centre, width = self.law.law.range_of_hidden(self.law.values, d)
        z = centre if self.flows else float(np.clip(0.0, centre - width, centre + width))
        z = float(z) if self.law.law.hidden else 0.0
        return z, self.law.regime(d, v, z)

    def _followed(
        self, z: float, regime: int
    ) -> tuple[list[_Segment], float, Array, int, list[tuple[float, float, Array]]]:
        """Follow a cycle; return segments, the last hidden state with its columns and regime, and jumps.

        A jump of the force: its angle, its size before less after, and the columns of the angle.
        """
        theta, slopes = 0.0, np.zeros(self.columns)
        slopes[len(self.q) + 1] = 1.0
        segments: list[_Segment] = []
        jumps: list[tuple[float, float, Array]] = []
        for _ in range(_MAX_EVENTS):
            segment, ending = (self._flow if self.flows else self._rest)(theta, z, slopes, regime)
            segments.append(segment)
            theta, z, slopes = float(segment.theta[-1]), float(segment.z[-1]), segment.slopes[-1]
            if ending is not None:
                z, slopes, regime = self._switched(theta, z, slopes, regime, ending, jumps)
            elif theta >= 2 * np.pi:
                return segments, z, slopes, regime, jumps
        raise NumericalError(
            "the regimes of a joint change without end in a cycle",
            remedy="Change the amplitude or the parameters of its law.",
        )

    def _rest(
        self, low: float, z: float, slopes: Array, regime: int
    ) -> tuple[_Segment, tuple[int, int] | None]:
        """Return the segment of a regime with a constant hidden state, its guard, and the next regime."""
        first = int(np.searchsorted(self.scan, low + _EVENT_TOL))
        theta = np.concatenate([[low], self.scan[first:]])
        guards = self.law.guards(regime, self.d[first:], self.v[first:], z)
        values = [_along(guard.function.value, len(theta) - 1) for guard in guards]
        high, ending = self._first_zero(theta, values, lambda _: z, regime)
        segment = _Segment(np.array([low, high]), None, np.full(1, z), slopes[None], regime)
        return segment, None if ending is None else (ending, guards[ending].following)

    def _flow(
        self, low: float, z: float, slopes: Array, regime: int
    ) -> tuple[_Segment, tuple[int, int] | None]:
        """Return a panel of a regime whose hidden state changes, its guard, and the next regime."""
        high = min(low + _PANEL, 2 * np.pi)
        panel = self._collocated(low, high, z, slopes, regime)
        of_d, of_v = self._motion(panel.theta)
        guards = self.law.guards(regime, of_d[1:], of_v[1:], panel.z[1:])
        values = [_along(guard.function.value, len(panel.theta) - 1) for guard in guards]
        series = to_chebyshev(_PANEL_NODES) @ panel.z

        def hidden(theta: float) -> float:
            return float(np.polynomial.chebyshev.chebval(2 * (theta - low) / (high - low) - 1, series))

        zero, ending = self._first_zero(panel.theta, values, hidden, regime)
        if ending is not None and zero < high:
            panel = self._collocated(low, zero, z, slopes, regime)
        return panel, None if ending is None else (ending, guards[ending].following)

    def _first_zero(
        self, theta: Array, values: Sequence[Array], hidden: Callable[[float], float], regime: int
    ) -> tuple[float, int | None]:
        """Return the first angle at which a guard vanishes, and its number; the last angle if none does.

        `values`: of the guards at the angles after the first.
        """
        high, ending = float(theta[-1]), None
        for number, guard in enumerate(values):
            negative = np.flatnonzero(guard < 0)
            if len(negative) and theta[negative[0]] < high:
                at = int(negative[0])
                bracket = float(theta[at]), float(theta[at + 1])
                below = float(guard[at - 1]) if at else self._guard(bracket[0], hidden, regime, number)[0]
                zero = self._zero(bracket, (below, float(guard[at])), hidden, regime, number)
                if zero < high or ending is None:
                    high, ending = zero, number
        return high, ending

    def _guard(
        self, theta: float, hidden: Callable[[float], float], regime: int, number: int
    ) -> tuple[float, float]:
        """Return a guard and its derivative by the angle."""
        (d, v, a), z = self.at(self.phases(theta)), hidden(theta)
        law, values = self.law.law, self.law.values
        d += self.law.offset if law.preloaded else 0.0
        f = law.guards(values, regime, d, v, z)[number].function
        rate = law.rate(values, regime, d, v, z) if self.flows else None
        by_time = f.d * v + f.v * a + (0.0 if rate is None else f.z * rate.value)
        return float(f.value), float(by_time) / self.omega

    def _zero(
        self, bracket: tuple[float, float], values: tuple[float, float], hidden: Callable[[float], float],
        regime: int, number: int,
    ) -> float:  # fmt: skip
        """Return the zero of a guard that is negative at the upper angle (Newton, kept in the bracket)."""
        low, high = bracket
        if values[0] <= 0:
            return low
        theta = low + (high - low) * values[0] / (values[0] - values[1])
        for _ in range(_MAX_LOCATIONS):
            value, slope = self._guard(theta, hidden, regime, number)
            low, high = (theta, high) if value > 0 else (low, theta)
            step = -value / slope if slope < 0 else np.inf
            inside = low <= theta + step <= high
            theta = theta + step if inside else (low + high) / 2
            if (inside and abs(step) <= _EVENT_STEP) or high - low <= _EVENT_TOL:
                break
        return float(theta)

    def _motion(self, theta: Array) -> tuple[Array, Array]:
        T = series(theta, self.harmonics)
        return T @ self.q, self.omega * (T @ rate_of(self.q))

    def _collocated(self, low: float, high: float, z: float, slopes: Array, regime: int) -> _Segment:
        """Return a panel whose hidden state has its rate at all nodes (Newton), with its columns."""
        x, weights, integrals = clenshaw_curtis(_PANEL_NODES)
        theta, S = low + (high - low) * x, integrals * ((high - low) / self.omega)
        d, v = self._motion(theta)
        state = np.full(len(x), z)
        for _ in range(_MAX_LOCATIONS):
            rate = self.law.rate(regime, d, v, state)
            assert rate is not None
            matrix = np.eye(len(x)) - S * np.broadcast_to(rate.z, len(x))
            change = np.linalg.solve(matrix, z + S @ rate.value - state)
            state = state + change
            if np.abs(change).max() <= _ROUND_OFF * (self.size + np.abs(state).max()):
                break
        rate = self.law.rate(regime, d, v, state)
        assert rate is not None
        of_d, of_v = self.rows(theta)
        source = _column(rate.d, of_d) + _column(rate.v, of_v)
        for column, slope in self._of_parameters(rate):
            source[:, column] += slope
        source[:, len(self.q)] -= rate.value / self.omega
        columns = np.linalg.solve(matrix, slopes + S @ source)
        return _Segment(theta, (high - low) * weights, state, columns, regime)

    def _switched(
        self, theta: float, z: float, slopes: Array, regime: int, ending: tuple[int, int],
        jumps: list[tuple[float, float, Array]],
    ) -> tuple[float, Array, int]:  # fmt: skip
        """Return the hidden state, its columns and the regime after an event; add the jump of the force."""
        law, (number, following), (d, v, a) = self.law, ending, self.at(self.phases(theta))
        entered = law.entered(regime, following, d, z)
        state = z if entered is None else float(entered.value)

        def flow(which: int, state: float) -> float:
            rate = law.rate(which, d, v, state) if self.flows else None
            return 0.0 if rate is None else float(rate.value)

        before, after = flow(regime, z), flow(following, state)
        along = before if entered is None else float(entered.d * v + entered.v * a + entered.z * before)
        forces = [float(law.force(*at).value) for at in ((regime, d, v, z), (following, d, v, state))]
        jump = forces[0] - forces[1]
        jumps_there = abs(jump) > _JUMP_TOL * max(map(abs, forces))
        moves = abs(along - after) > _ROUND_OFF * self.omega * self.size * self.harmonics**2
        if entered is None and not (moves or jumps_there):
            return state, slopes, following  # wherever the event is
        of_d, of_v = (rows[0] for rows in self.rows(np.full(1, theta)))

        def total(f: Slopes) -> Array:
            out = np.asarray(f.d * of_d + f.v * of_v + f.z * slopes)
            for column, slope in self._of_parameters(f):
                out[column] += slope
            return out

        columns = slopes if entered is None else total(entered)
        if moves or jumps_there:
            f = law.guards(regime, d, v, z)[number].function
            by_time = f.d * v + f.v * a + f.z * before
            shift = -total(f) / by_time if by_time else np.zeros(self.columns)  # of the event's time
            columns = columns + (along - after) * shift
            if jumps_there:
                jumps.append((theta, jump, self.omega * shift))
        return state, np.asarray(columns), following

    def _projected(
        self, segments: Sequence[_Segment], end: Array, jumps: Sequence[tuple[float, float, Array]],
        hidden: tuple[float, int], change: float,
    ) -> CycleForce:  # fmt: skip
        """Return the Fourier coefficients of the force along the segments of a closed cycle."""
        size, further = len(self.q), further_harmonics(self.harmonics)
        coefficients, slopes = np.zeros(2 * further + 1), np.zeros((size, self.columns))
        curved = []
        affine: list[tuple[_Segment, Slopes]] = []
        for segment in segments:
            f = self.law.force(segment.regime, self.d[:1], self.v[:1], segment.z)
            resting = segment.weights is None and np.ndim(f.d) == np.ndim(f.v) == 0 and not self.parameters
            affine += [(segment, f)] if resting else []
            curved += [] if resting else [segment.with_nodes(self.harmonics)]
        if affine:
            self._add_affine(affine, coefficients, slopes)
        if curved:
            self._add_curved(curved, coefficients, slopes)
        for theta, jump, shift in jumps:
            at = basis(np.full(1, theta), self.harmonics)[0][0] / np.pi
            at[0] /= 2
            slopes += np.outer(at * jump, shift)
        free, (z, regime) = 1.0 - end[size + 1], hidden
        if abs(free) > _FREE_TOL:
            first_hidden = slopes[:, size + 1].copy()
            slopes += np.outer(first_hidden, end / free)
            coefficients[:size] += first_hidden * (change / free)
            z += change / free
        return CycleForce(coefficients, slopes[:, :size], slopes[:, size], slopes[:, size + 2 :], (z, regime))

    def _add_affine(
        self, parts: Sequence[tuple[_Segment, Slopes]], coefficients: Array, slopes: Array
    ) -> None:
        """Add the coefficients of affine forces and their slopes, integrated in closed form."""
        size, rate = len(self.q), rate_of(self.q)
        further = len(coefficients) // 2
        order = np.arange(1, further + self.harmonics + 1)
        ends = np.array([segment.theta for segment, _ in parts])
        waves = np.exp(1j * ends[:, :, None] * order)
        integrals = np.column_stack([ends[:, 1] - ends[:, 0], (waves[:, 1] - waves[:, 0]) / (1j * order)])
        of_d, of_v, of_z = ([float(getattr(f, name)) for _, f in parts] for name in "dvz")
        rest = [
            float(f.value[0] - f.d * self.d[0] - f.v * self.v[0]) / np.pi for _, f in parts
        ]  # of d = v = 0
        series = to_real(integrals.T[: further + 1].conj())  # of windows (2 J + 1 x segments)
        series[0] /= 2
        coefficients += series @ rest
        slopes += (series[:size] * of_z / np.pi) @ np.array([segment.slopes[0] for segment, _ in parts])
        if any(of_d):
            by_d = multiplied(integrals.T @ of_d, further, self.harmonics)
            coefficients += by_d @ self.q
            slopes[:, :size] += by_d[:size]
        if any(of_v):
            by_v = multiplied(integrals.T @ of_v, further, self.harmonics)
            coefficients += self.omega * (by_v @ rate)
            slopes[:, :size] -= self.omega * rate_of(by_v[:size])
            slopes[:, size] += by_v[:size] @ rate

    def _add_curved(self, segments: Sequence[_Segment], coefficients: Array, slopes: Array) -> None:
        """Add the coefficients of forces and their slopes, integrated at nodes."""
        size = len(self.q)
        T = series(np.concatenate([s.theta for s in segments]), len(coefficients) // 2)
        rows = T.T * (np.concatenate([s.weights for s in segments]) / np.pi)
        rows[0] /= 2
        d, v = T[:, :size] @ self.q, self.omega * (T[:, :size] @ rate_of(self.q))
        value, by_d, by_v = np.empty((3, len(d)))
        first = 0
        for segment in segments:
            here = slice(first, first + len(segment.theta))
            first = here.stop
            f = self.law.force(segment.regime, d[here], v[here], segment.z)
            value[here], by_d[here], by_v[here] = f.value, f.d, f.v
            weighted = rows[:size, here]
            if np.any(f.z):
                slopes += (
                    _column(weighted * f.z, segment.slopes)
                    if len(segment.z) > 1
                    else np.outer(weighted @ np.broadcast_to(f.z, len(segment.theta)), segment.slopes[0])
                )
            for column, slope in self._of_parameters(f):
                slopes[:, column] += weighted @ np.broadcast_to(slope, len(segment.theta))
        coefficients += rows @ value
        slopes[:, :size] += (rows[:size] * by_d) @ T[:, :size]
        if by_v.any():
            slopes[:, :size] += (rows[:size] * by_v) @ (self.omega * derivatives(T[:, :size]))
            slopes[:, size] += rows[:size] @ (by_v * v / self.omega)


def _along(value: Array | float, length: int) -> Array:
    return np.asarray(value) if np.ndim(value) else np.full(length, value)


def _column(factor: Array | float, rows: Array) -> Array:
    """Return rows times factors of each, or a matrix of factors times rows."""
    factors = np.asarray(factor)
    if factors.ndim == 2:
        return np.asarray(factors @ rows)
    return np.asarray(np.broadcast_to(factors, len(rows))[:, None] * rows)
