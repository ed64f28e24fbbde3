"""Sampled controllers around a graph: their verdict and margins.

From sample to sample the closed loops are a matrix M (`lti/sampled_equations.py`), of balls of as many bits
as the verdict takes. Loop i, the others closed, has 1 + L_i = det(z - M)/det(z - M, loop i cut). On the plane
of s with z = (1 + s T/2)/(1 - s T/2) the unit circle is the axis s = j (2/T) tan(ω T/2), and the margins are
those of a rational function. Loops that are not sampled belong to the graph; for those with delays, and
lines, see `sampled_delays.py`.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from fractions import Fraction
from functools import cache, cached_property
from itertools import accumulate, count, pairwise, takewhile
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.arithmetic.ldl import reference
from dynid.arithmetic.numbers import rounded as rounded_number
from dynid.arrays import Array, ComplexArray
from dynid.bondgraph.controller_circuits import Loop, Sampling, close_loops
from dynid.bondgraph.cut_loops import CutLoops, in_proportion
from dynid.bondgraph.graph import BondGraph, Port
from dynid.bondgraph.graph_state_space import rational_matrices
from dynid.bondgraph.reduced_graph import ReducedGraph
from dynid.defaults import ANSWERS_UNDER_WAY
from dynid.errors import UsageError
from dynid.lti.certified_roots import CertifiedRoot, certified_roots, repeated
from dynid.lti.discrete_controller import DiscreteController, as_fmpq, discrete_controller
from dynid.lti.margins import Margins, changes, gain_crossings, lag
from dynid.lti.minimal_realisation import ExactSystem, minimal
from dynid.lti.quasi_polynomials import QuasiPolynomial, on_axis
from dynid.lti.sampled_equations import DOUBLE_BITS, SampledEquations
from dynid.lti.sampled_system import SampledController
from dynid.lti.schur_cohn import roots_inside
from dynid.lti.stability import Verdict, combined
from dynid.number_format import counted

#: Bits of the two trials of a verdict: few of random loops, a margin of gain of 1e-25, take the second one.
_TRIED_BITS = (96, 1024)
#: Bits that the coefficients of an open loop are rounded to, more of each degree, as the roots of
#: polynomials lose some; of those from which crossings alone are taken; and how many times as many they are
#: computed with, as they are differences of determinants.
_KEPT_BITS, _KEPT_BY_DEGREE, _CROSSING_BITS, _CANCELLED = 128, 4, 80, 3
#: Trials of a sample time: their ratio, and that of the last one to the scene's; rests of a period at which
#: |L| is tried.
_TRIAL_RATIO, _TRIED_SPAN, _TRIED_RESTS = 1.125, 1e3, 4
#: Relative change at which a limit is accepted, and secants after which it is as it is.
_LIMIT_RTOL, _MOST_SECANTS = 1e-12, 100
#: First ratio of frequencies in such a search, and the part of a period to which exact crossings confirm a
#: delay margin that was computed from the crossing next to another.
_FIRST_STEP, _CONFIRMED_RTOL = 1 + 1e-4, 1e-11
#: Distance from the unit circle, in double precision, below which only the recursion decides.
_CIRCLE = 1e-12
#: A gain without structure: no mode that a loop moves stays where it is.
_GENERIC_GAIN = Fraction(104729, 7919)
#: Why a verdict is marginal.
_AT_REST = "a discrete pole lies at z = 1: a controller integrates what settles at 0 by itself"
#: Relative distance of e^(λT) of two natural modes below which sampling nearly confuses them.
_CONFUSED = 1e-3


class _CutGraph(NamedTuple):
    """A graph whose sampled loops are cut, driven by what they hold."""

    graph: BondGraph
    held: tuple[str, ...]  # the source through which each loop acts
    answered: tuple[Port, ...]  # what each controller answers to
    variables: dict[Port, Port]  # variables of the driven sources, under the names that they had
    delayed: tuple[tuple[str, Port], ...] = ()  # of lines: what arrives, a source, and what leaves


def cut_graph(opened: BondGraph, loops: Sequence[Loop], lines: Sequence[Loop] = ()) -> _CutGraph:
    """Return a graph with its loops cut, each with a source in place of its answer, and lines cut open."""
    names = {*opened.nodes, *(name for loop in loops for name in (loop.reference, loop.setpoint))}
    cut = list[Loop]()
    for loop in loops:
        probes = (f"{loop.source}_held{number or ''}" for number in count())
        cut.append(replace(loop.cut(next(name for name in probes if name not in names)), sampling=None))
        names.add(cut[-1].reference)
    closed = close_loops(opened, [*cut, *lines], cut=True)
    held = tuple(loop.reference for loop in cut)
    return _CutGraph(closed.graph, held, closed.answered[: len(cut)], closed.variables, closed.delayed)


class SampledLoops:
    """The sampled loops of a graph; loops without `sampling` belong to the graph.

    With one period T they are a system in z = exp(s T); for several see `MultirateLoops`.

    Raises `Singular` where the graph without feedback has no unique solution. Raises `UsageError` where what
    is measured has no value at an instant, or a controller has no discrete form.
    """

    refusal = ""  #: Why there is neither a verdict nor a margin.

    def __init__(self, opened: BondGraph, loops: Sequence[Loop]) -> None:
        self.opened = opened
        self.continuous = [loop for loop in loops if loop.sampling is None]
        self.loops = tuple(loop for loop in loops if loop.sampling is not None)
        self._timing = [loop.sampling or Sampling(Fraction(0)) for loop in self.loops]
        self.periods = tuple(_exact(timing.period) for timing in self._timing)
        self.period = min(self.periods)
        self.computations = tuple(_exact(timing.computation) for timing in self._timing)
        self._quotients = [
            ([*map(_exact, loop.numerator)], [*map(_exact, loop.denominator)]) for loop in self.loops
        ]
        #: Delays in the graph, of lines and continuous loops, s.
        self.delays = tuple(in_proportion([_exact(loop.delay) for loop in self.continuous if loop.delayed]))
        generic = [
            replace(loop, numerator=[_GENERIC_GAIN], denominator=[Fraction(1)], sampling=None)
            for loop in self.loops
        ]
        self._generic = CutLoops(opened, [*generic, *self.continuous])
        self._discrete = dict[tuple[Fraction, int], list[DiscreteController]]()
        self.plant = self._plant()
        self._equations = SampledEquations(self.plant, self.controllers)
        self.controllers(self.period)  # raises

    def _plant(self) -> ExactSystem:
        """Return the graph between what is held, and arrives by delays, and what is measured, and leaves."""
        cut = cut_graph(with_rational_values(self.opened), self.loops, self.continuous)
        columns = [*cut.held, *(source for source, _ in cut.delayed)]
        ports = [*cut.answered, *(port for _, port in cut.delayed)]
        reduced = ReducedGraph(cut.graph, list(dict.fromkeys(columns)), [*dict.fromkeys(ports)], traced=False)
        exact = rational_matrices(reduced, (), columns)
        rows = [list(reduced.outputs).index(port) for port in ports]
        direct, *higher = ([matrix.tolist()[row] for row in rows] for matrix in exact.feedthrough)
        names = [loop.place for loop in self.loops]
        for k, rates in enumerate(zip(*higher, strict=True)):
            if any(map(any, rates)):
                measured = f"'{self.loops[k].measured}'" if k < len(names) else "what passes through a delay"
                raise UsageError(
                    f"{measured} follows the rate of what a sampled controller holds, which jumps",
                    remedy="Measure another variable, or model the inertia or compliance that is left out.",
                    names=names[k : k + 1] or names,
                )
        states = exact.C.tolist()
        return minimal(ExactSystem(exact.A.tolist(), exact.B.tolist(), [states[row] for row in rows], direct))

    def controllers(self, period: Fraction) -> list[DiscreteController]:
        """Return the controllers, made discrete for a period, s, exactly or in balls (`method: zoh`)."""
        from flint import ctx

        bits = ctx.prec if any(timing.method == "zoh" for timing in self._timing) else 0
        if (period, bits) not in self._discrete:
            self._discrete[period, bits] = [
                discrete_controller(*quotient, timing.method, own, loop.place, _tracking(loop))
                for quotient, timing, loop, own in zip(
                    self._quotients, self._timing, self.loops, self._sample_times(period), strict=True
                )
            ]
        return self._discrete[period, bits]

    def _sample_times(self, period: Fraction) -> Sequence[Fraction]:
        """Return the sample time of each loop where that of all is a period."""
        return [period] * len(self.loops)

    def float_controllers(self, *, limited: bool = False) -> tuple[SampledController, ...]:
        """Return the controllers in doubles, `limited`: with the limits of their answers."""
        from flint import ctx

        with ctx.workprec(DOUBLE_BITS):
            exact = self.controllers(self.period)

        def array(values: Any) -> NDArray[np.float64]:
            return np.array([[float(entry) for entry in row] for row in values])

        return tuple(
            SampledController(
                *(array(F).reshape(len(h), len(h)), array([g])[0], array([h])[0], float(d), computation),
                *(period, array([weights])[0]),
                *(map(float, loop.limits[:2]) if limited and loop.limits is not None else ()),
            )
            for loop, (F, g, h, d, weights), computation, period in zip(
                self.loops, exact, self.computations, self.periods, strict=True
            )
        )

    def answers(self) -> Callable[[ComplexArray], ComplexArray]:
        """Return what the closed loops hold in answer to what is added to measurements, by z."""
        M, B, C, D = self._equations.answers(self.period, self.computations)

        def evaluate(z: ComplexArray) -> ComplexArray:
            resolvents = z[:, None, None] * np.eye(len(M)) - M
            return np.asarray(C @ np.linalg.solve(resolvents, np.broadcast_to(B, (len(z), *B.shape))) + D)

        return evaluate

    # Verdicts

    @cached_property
    def verdict(self) -> Verdict:
        """The verdict on loops, controllers and every separate part of the graph."""
        return combined([self._shown, *self._generic.unseen()])

    @cached_property
    def _shown(self) -> Verdict:
        """The verdict on what the loops move, by Schur-Cohn in balls of as many bits as it takes."""
        for bits in _TRIED_BITS:
            matrix = self._closed(bits)
            outside, marginal = self._outside(matrix, bits)
            if outside:
                return outside_verdict(outside, _radius(matrix))
            if outside == 0:
                return Verdict("marginal", _AT_REST, 0) if marginal else Verdict("stable", "", 0)
        nearest = min(self.poles, key=lambda pole: abs(abs(pole.value) - 1))
        if abs(abs(nearest.value) - 1) < _CIRCLE:
            place = f"{complex(nearest.value):.6g}".replace("+0j", "").replace("-0j", "")
            reason = f"a discrete pole lies on the unit circle at z = {place} within 2^-{_TRIED_BITS[-1]}"
            return Verdict("at the limit", reason, math.nan)
        outside = int((np.abs(repeated(self.poles)) > 1).sum())  # of reciprocal poles the recursion ends
        return outside_verdict(outside, _radius(matrix)) if outside else Verdict("stable", "", 0)

    def _closed(self, bits: int) -> Any:
        """Return the matrix of the states from one sample to the next, all loops closed (flint `arb_mat`)."""
        every = range(len(self.loops))
        return self._equations.matrices(self.period, self.computations, [every], bits)[0]

    def _outside(self, matrix: Any, bits: int) -> tuple[int | None, bool]:
        """Return the number of discrete poles outside the unit circle, None where it is not decided.

        The second value is true where one lies at z = 1, exactly.
        """
        from flint import ctx

        with ctx.workprec(bits):
            coefficients = matrix.charpoly().coeffs()
            if marginal := sum(coefficients).contains(0) and self._integrates:
                coefficients = [*accumulate(reversed(coefficients[1:]))][::-1]  # over z - 1
            inside = roots_inside(coefficients)
        return None if inside is None else len(coefficients) - 1 - inside, marginal

    @cached_property
    def _integrates(self) -> bool:
        """True if z = 1 is a discrete pole, at all sample times: at rest A x + B u = 0 something is held."""
        from flint import fmpq_mat

        A, B, C, D = self.plant
        rows = [[*states, *held] for states, held in zip(A, B, strict=True)]
        for j, ((above, below), timing) in enumerate(zip(self._quotients, self._timing, strict=True)):
            top, bottom = (
                as_fmpq(sum(part, Fraction(0)) if timing.method == "z" else part[-1])
                for part in (above, below)
            )
            answer = [top * gain + (bottom if i == j else 0) for i, gain in enumerate(D[j])]
            rows.append([*(top * entry for entry in C[j]), *answer])
        return bool(fmpq_mat(rows).det() == 0)

    @cached_property
    def poles(self) -> Sequence[CertifiedRoot]:
        """The discrete poles of the closed loops, in the plane of z."""
        return certified_roots(
            _integers([self._characteristics(0, self.computations, None)[0]], self._kept(None))[0]
        )

    @property
    def listed_poles(self) -> ComplexArray:
        """The discrete poles that are listed, with their multiplicities."""
        return repeated(self.poles)

    @cached_property
    def largest_sample_time(self) -> float:
        """The sample time at which the loops lose stability, controllers made discrete for each, s.

        It is the first one above that of the scene, inf where none up to 1,000 times it is; of unstable loops
        the last one below, NaN where none down to 1/1,000 of it, or 1/100 of a computation, is, or at the
        limit.
        """
        if self._shown.kind == "at the limit" or self._integrates:
            return math.nan

        def excess(period: float) -> float:
            (matrix,) = self._equations.matrices(
                Fraction(period), self.computations, [range(len(self.loops))], DOUBLE_BITS
            )
            return _radius(matrix) - 1

        start = excess(float(self.period))
        ratio = _TRIAL_RATIO if start < 0 else 1 / _TRIAL_RATIO
        span = math.ceil(math.log(_TRIED_SPAN) / math.log(_TRIAL_RATIO))
        trials = (float(self.period) * ratio**k for k in range(span + 1))
        shortest = float(max(self.computations)) / ANSWERS_UNDER_WAY.value
        limit = _first_change(excess, takewhile(lambda period: period >= shortest, trials))
        return limit if limit < math.inf or start < 0 else math.nan

    # Margins

    def _characteristics(
        self, number: int, computations: Sequence[Fraction], kept: int | None
    ) -> tuple[list[Any], list[Any]]:
        """Return det(z - M) of all loops, and with a loop cut, as balls, ascending; `kept`: their bits."""
        from flint import ctx

        every, bits = range(len(self.loops)), _CANCELLED * self._kept(kept)
        with ctx.workprec(bits):
            sets = [every, [loop for loop in every if loop != number]]
            matrices = self._equations.matrices(self.period, computations, sets, bits)
            closed, cut = (matrix.charpoly().coeffs() for matrix in matrices)
        return closed, cut

    def _kept(self, kept: int | None) -> int:
        return kept or _KEPT_BITS + _KEPT_BY_DEGREE * len(self.plant.A)

    def loop_in_z(self, number: int) -> tuple[Any, Any]:
        """Return L of a loop, the others closed, on z (flint `fmpz_poly`)."""
        return self._loop(number, self.computations, in_z=True)

    def loop(self, number: int) -> tuple[Any, Any]:
        """Return L of a loop, the others closed, on s of z = (1 + s T/2)/(1 - s T/2) (flint `fmpz_poly`)."""
        return self._loop(number, self.computations)

    def _loop(
        self, number: int, computations: Sequence[Fraction], kept: int | None = None, *, in_z: bool = False
    ) -> tuple[Any, Any]:
        from flint import ctx

        closed, cut = self._characteristics(number, computations, kept)
        with ctx.workprec(_CANCELLED * self._kept(kept)):
            polynomials = [[a - b for a, b in zip(closed, cut, strict=True)], cut]
            if not in_z:
                polynomials = [_bilinear(p, self.period / 2) for p in polynomials]
            top, bottom = _integers(polynomials, self._kept(kept))
        shared = top.gcd(bottom)
        return (top // shared, bottom // shared) if top != 0 else (top, 0 * top + 1)

    def gain(self, number: int, omega: Array) -> ComplexArray:
        """Return L of a loop, the others closed, at frequencies, rad/s."""
        half = float(self.period) / 2
        top, bottom = (QuasiPolynomial({Fraction(0): polynomial}) for polynomial in self.loop(number))
        return np.asarray(on_axis(top, bottom, (np.tan(omega * half) / half).tolist()))

    def frequency(self, tangent: float) -> float:
        """Return ω of (2/T) tan(ω T/2), rad/s; that of infinity is the Nyquist frequency."""
        half = float(self.period) / 2
        return math.atan(tangent * half) / half

    def margins(self, number: int) -> Margins:
        """Return the margins of a loop, the others closed."""
        plain, at = changes(*self.loop(number)), self.frequency
        return self._judged(
            number,
            replace(
                plain,
                gain_crossover=at(plain.gain_crossover) if math.isfinite(plain.phase) else math.inf,
                phase_crossover=at(plain.phase_crossover)
                if math.isfinite(plain.gain) or plain.gain_reduction
                else math.inf,
                modulus_at=at(plain.modulus_at),
                Mt_at=at(plain.Mt_at),
            ),
        )

    def _judged(self, number: int, plain: Margins) -> Margins:
        """Return margins with the verdict on all loops and the delay margin."""
        return replace(
            plain,
            stable=self.verdict.stable,
            stability=self.verdict.text,
            unstable_poles=math.inf
            if math.isnan(self.verdict.unstable_poles)
            else self.verdict.unstable_poles,
            delay=self._delay_margin(number) if self.verdict.stable else math.nan,
        )

    def crossings(self, number: int, computations: Sequence[Fraction]) -> list[tuple[float, float]]:
        """Return the phase lags, degrees, that turn L to -1 where |L| = 1, with ω, rad/s."""
        lags = gain_crossings(*self._loop(number, computations, _CROSSING_BITS))
        return [(lag, self.frequency(at)) for lag, at in lags]

    def late_gain(
        self, number: int, computations: Sequence[Fraction]
    ) -> Callable[[ComplexArray], ComplexArray]:
        """Return L of a loop, the others closed, by z, with these computation times, in double precision."""
        return self._equations.loop(number, self.period, computations)

    def _delay_margin(self, number: int) -> float:
        """Return the further computation time of a loop that makes it unstable, s.

        Whole periods turn L alone, by ω T each; the rest ε of one changes |L|, too. The lag at which |L| = 1,
        over ω, has to be a whole number of periods. NaN where |L| reaches 1 at some rests alone.
        """
        period = float(self.period)

        def delays(rest: float) -> list[Fraction]:
            added = Fraction(rest)
            return [delay + added * (loop == number) for loop, delay in enumerate(self.computations)]

        @cache
        def slack(rest: float) -> tuple[float, float]:
            lags = self.crossings(number, delays(rest))
            return min(((math.radians(lag) / at, at) for lag, at in lags), default=(math.inf, math.inf))

        rests = [part * period / _TRIED_RESTS for part in range(_TRIED_RESTS + 1)]
        prompt, _ = slack(0.0)
        if prompt == math.inf:
            return math.inf if all(slack(rest)[0] == math.inf for rest in rests[:-1]) else math.nan
        periods = math.floor(prompt / period)

        def excess(rest: float, late: float | None = None) -> float:
            value = (slack(rest)[0] if late is None else late) - periods * period
            return value if value < 2 * period else -rest  # a lag of 0 became one of 360 degrees

        ends = next((ends for ends in pairwise(rests) if excess(ends[1]) <= 0), None)
        if ends is None:
            return math.inf
        start = slack(ends[0])[1]

        def near(rest: float) -> float:
            """Return the excess at the crossing next to that of the begin."""
            gain = self.late_gain(number, delays(rest))
            omega = _secant(
                lambda at: math.log(abs(gain(np.exp([1j * at * period]))[0])), start, start * _FIRST_STEP
            )
            return excess(rest, math.radians(lag(gain(np.exp([1j * omega * period]))[0])) / omega)

        with contextlib.suppress(np.linalg.LinAlgError, ValueError):
            limit = _first_change(near, ends)
            if abs(excess(limit)) <= _CONFIRMED_RTOL * period:
                return periods * period + limit
        return periods * period + _first_change(excess, ends)

    def confused_modes(self) -> list[tuple[complex, complex]]:
        """Return pairs of natural modes of the graph that are nearly one for the samples.

        Sampling does not distinguish λ and μ = λ + 2πjk/T (Kalman, Ho & Narendra 1963).
        """
        A = np.array([[float(entry.p) / float(entry.q) for entry in row] for row in self.plant.A])
        values = np.linalg.eigvals(A) if len(A) else np.empty(0, complex)
        T = float(self.period)
        return [
            (a, b)
            for k, a in enumerate(values.tolist())
            for b in values[k + 1 :].tolist()
            if abs(a.imag - b.imag) * T > math.pi and abs(np.exp((a - b) * T) - 1) < _CONFUSED
        ]


class MultirateLoops(SampledLoops):
    """Sampled loops of several periods: the verdict is on the states from one common sample to the next."""

    refusal = "loops with several sample times have no L(z)"

    @cached_property
    def common_period(self) -> Fraction:
        """The time after which all loops sample together again, s."""
        return common_multiple(self.periods)

    def _sample_times(self, _: Fraction) -> Sequence[Fraction]:
        return self.periods

    def _closed(self, bits: int) -> Any:
        """Return the matrix of the states from one common sample to the next (flint `arb_mat`)."""
        return self._equations.monodromy(self.periods, self.computations, self.common_period, bits)

    @cached_property
    def poles(self) -> Sequence[CertifiedRoot]:
        """The discrete poles of the closed loops, over the common period."""
        from flint import ctx

        bits = _CANCELLED * self._kept(None)
        with ctx.workprec(bits):
            coefficients = self._closed(bits).charpoly().coeffs()
        return certified_roots(_integers([coefficients], self._kept(None))[0])

    @property
    def largest_sample_time(self) -> float:
        """It is not computed: there are several."""
        return math.nan

    def answers(self) -> Callable[[ComplexArray], ComplexArray]:
        """Raise: to a sequence of one sample time they answer by several."""
        raise UsageError(
            "loops with several sample times have no frequency response",
            remedy="Leave it out, or give all loops one sample time.",
            names=("analysis.frequency",),
        )

    def confused_modes(self) -> list[tuple[complex, complex]]:
        """Modes that samples of one period confuse differ for those of another: none is compared."""
        return []


def common_multiple(periods: Sequence[Fraction]) -> Fraction:
    """Return the least common multiple of times."""
    denominator = math.lcm(*(period.denominator for period in periods))
    return Fraction(math.lcm(*(int(period * denominator) for period in periods)), denominator)


def outside_verdict(outside: int, largest: float) -> Verdict:
    """Return the verdict on loops with discrete poles outside the unit circle, the largest of some |z|."""
    verb = f"{counted(outside, 'discrete pole')} {'lies' if outside == 1 else 'lie'}"
    reason = f"{verb} outside the unit circle, the largest with |z| = {largest:.6g}"
    return Verdict("unstable", reason, outside)


def _radius(matrix: Any) -> float:
    """Return the largest |z| of the eigenvalues in double precision; inf where it overflows."""
    entries = np.array([[float(entry) for entry in row] for row in matrix.tolist()])
    return (
        float(np.abs(np.linalg.eigvals(entries)).max(initial=0.0)) if np.isfinite(entries).all() else math.inf
    )


def _secant(function: Callable[[float], float], low: float, high: float) -> float:
    """Return the zero of a function that secants lead to."""
    below, above = function(low), function(high)
    for _ in range(_MOST_SECANTS):
        if above == below or abs(high - low) <= _LIMIT_RTOL * abs(high):
            break
        low, high = high, high - above * (high - low) / (above - below)
        below, above = above, function(high)
    return high


def _first_change(function: Callable[[float], float], trials: Iterable[float]) -> float:
    """Return the first zero of a function between trials, by false position; inf where it keeps its sign.

    A secant that keeps an end twice lowers the value there as the new one fell (Anderson & Björck 1973).
    """
    low, below = math.nan, math.nan
    for trial in trials:
        high, above = trial, function(trial)
        if below * above <= 0:
            break
        low, below = high, above
    else:
        return math.inf
    for _ in range(_MOST_SECANTS):
        slope_known = math.isfinite(above) and math.isfinite(below)
        middle = (low * above - high * below) / (above - below) if slope_known else (low + high) / 2
        value = function(middle)
        if value * above < 0:
            low, below = high, above
        else:
            fall = 1 - value / above
            below *= fall if 0 < fall < 1 else 0.5
        change, high, above = abs(middle - high), middle, value
        if not value or change <= _LIMIT_RTOL * abs(high):
            break
    return high


# --- exact numbers and balls -----------------------------------------------------------------------


def _exact(number: Any) -> Fraction:
    return rounded_number(reference(number))


def _tracking(loop: Loop) -> Fraction:
    return Fraction(0) if loop.limits is None else loop.limits.tracking


def with_rational_values(graph: BondGraph) -> BondGraph:
    """Return a graph with irrational values rounded to many bits."""
    if graph.field is None:
        return graph
    nodes = (
        node if node.value is None else replace(node, value=rounded_number(node.value))
        for node in graph.nodes.values()
    )
    return BondGraph(nodes, graph.bonds)


def _bilinear(polynomial: Sequence[Any], half: Fraction) -> list[Any]:
    """Return p(z)(1 - half s)^n of z = (1 + half s)/(1 - half s) as balls, ascending."""
    from flint import arb, arb_mat

    scale = as_fmpq(half)
    sums = arb_mat(_bilinear_weights(len(polynomial) - 1)) * arb_mat(len(polynomial), 1, list(polynomial))
    return [value * arb(scale**k) for k, (value,) in enumerate(sums.tolist())]


@cache
def _bilinear_weights(degree: int) -> Any:
    """Return the coefficients of (1 + s)^k (1 - s)^(degree - k), one column each (flint `fmpz_mat`)."""
    from flint import fmpz_mat, fmpz_poly

    columns = [fmpz_poly([1, 1]) ** k * fmpz_poly([1, -1]) ** (degree - k) for k in range(degree + 1)]
    return fmpz_mat([[column[power] for column in columns] for power in range(degree + 1)])


def _integers(polynomials: Sequence[Sequence[Any]], kept: int) -> list[Any]:
    """Return polynomials of balls, rounded, as integers (flint `fmpz_poly`), all times one number.

    A ball around zero is zero: poles at z = 1 (integrators) and z = 0 (answers under way) stay what they are.
    """
    from flint import fmpz_poly

    rounded: list[list[tuple[int, int]]] = []
    for polynomial in polynomials:
        rounded.append([])
        for ball in polynomial:
            mantissa, exponent = (0, 0) if ball.contains(0) else map(int, ball.mid().man_exp())
            surplus = max(mantissa.bit_length() - kept, 0)
            rounded[-1].append((mantissa >> surplus, exponent + surplus))
    least = min((exponent for part in rounded for mantissa, exponent in part if mantissa), default=0)
    return [
        fmpz_poly([mantissa << exponent - least if mantissa else 0 for mantissa, exponent in part])
        for part in rounded
    ]
