"""Sampled controllers around a graph: the exact equations from sample to sample, their verdict and margins.

Every loop measures at the instants k T, before what is held changes, and holds its answer (zero-order hold)
from its computation time c = l T + ε on, so that over a period the held input is first u[k-l-1], for ε, and
then u[k-l] (the modified z-transform, exactly). With x of the graph, the answers under way and the states of
the controllers, the closed loops are a matrix M of matrix exponentials: balls of as many bits as the verdict
takes. Loop i, the others closed, has 1 + L_i = det(z - M)/det(z - M, loop i cut). On the plane of s with
z = (1 + s T/2)/(1 - s T/2) the unit circle is the axis s = j (2/T) tan(ω T/2), and the margins are those of a
rational function.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import replace
from fractions import Fraction
from functools import cached_property
from itertools import count, takewhile
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.arithmetic.ldl import reference
from dynid.arithmetic.numbers import rounded as rounded_number
from dynid.bondgraph.controller_circuits import Loop, Sampling, close_loops
from dynid.bondgraph.cut_loops import CutLoops
from dynid.bondgraph.graph import BondGraph, Port
from dynid.bondgraph.graph_state_space import rational_matrices
from dynid.bondgraph.reduced_graph import ReducedGraph
from dynid.defaults import ANSWERS_UNDER_WAY
from dynid.errors import UsageError
from dynid.lti.certified_roots import CertifiedRoot, certified_roots, repeated
from dynid.lti.discrete_controller import DiscreteController, Rows, as_fmpq, discrete_controller
from dynid.lti.margins import Margins, gain_crossings, margins
from dynid.lti.minimal_realisation import ExactSystem, minimal
from dynid.lti.sampled_system import SampledController
from dynid.lti.schur_cohn import roots_inside
from dynid.lti.stability import Verdict, combined
from dynid.number_format import counted

#: Bits of the first trial of a verdict and of the last one; bits that open loops are computed with and
#: rounded to (the difference is for cancellation); bits of a radius in double precision.
_FIRST_BITS, _LAST_BITS, _LOOP_BITS, _KEPT_BITS, _RADIUS_BITS = 128, 4096, 768, 256, 64
#: Trials of a sample time: their ratio, and that of the last one to the scene's; rests of a period at which
#: |L| is tried.
_TRIAL_RATIO, _TRIED_SPAN, _TRIED_RESTS = 1.125, 1e3, 4
#: Relative change at which a limit is accepted, and secants after which it is as it is.
_LIMIT_RTOL, _MOST_SECANTS = 1e-12, 100
#: Distance from the unit circle, in double precision, below which only the recursion decides.
_CIRCLE = 1e-12
#: A gain without structure: no mode that a loop moves stays where it is.
_GENERIC_GAIN = Fraction(104729, 7919)
#: Why the verdict on sampled loops around lines is open.
_LINES = "with a line (TL) between samples there is no finite polynomial in z; see the time response"
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
    """The sampled loops of a graph, all with one period.

    Raises `Singular` where the graph without feedback has no unique solution. Raises `UsageError` where what
    is measured has no value at an instant, or a controller has no discrete form.
    """

    def __init__(self, opened: BondGraph, loops: Sequence[Loop]) -> None:
        self.opened, self.loops = opened, tuple(loop for loop in loops if not loop.line)
        self.lines, loops = [loop for loop in loops if loop.line], self.loops
        self._timing = [loop.sampling or Sampling(Fraction(0)) for loop in loops]
        self.period = _exact(self._timing[0].period)
        self.computations = tuple(_exact(timing.computation) for timing in self._timing)
        self._quotients = [
            ([*map(_exact, loop.numerator)], [*map(_exact, loop.denominator)]) for loop in loops
        ]
        if self.lines:
            return
        generic = [
            replace(loop, numerator=[_GENERIC_GAIN], denominator=[Fraction(1)], sampling=None)
            for loop in loops
        ]
        self._generic = CutLoops(opened, generic)
        cut = cut_graph(_rational(opened), loops)
        reduced = ReducedGraph(
            cut.graph, list(dict.fromkeys(cut.held)), [*dict.fromkeys(cut.answered)], traced=False
        )
        exact = rational_matrices(reduced, (), cut.held)
        rows = [list(reduced.outputs).index(port) for port in cut.answered]
        direct, *higher = ([matrix.tolist()[row] for row in rows] for matrix in exact.feedthrough)
        for loop, *rates in zip(loops, *higher, strict=True):
            if any(map(any, rates)):
                raise UsageError(
                    f"'{loop.measured}' follows the rate of what a sampled controller holds, which jumps",
                    remedy="Measure another variable, or model the inertia or compliance that is left out.",
                    names=[loop.place],
                )
        states = exact.C.tolist()
        self.plant = minimal(
            ExactSystem(exact.A.tolist(), exact.B.tolist(), [states[row] for row in rows], direct)
        )
        self.controllers(self.period)  # raises

    def controllers(self, period: Fraction) -> list[DiscreteController]:
        """Return the controllers, made discrete for a period, s, in balls of the working precision."""
        return [
            discrete_controller(*quotient, timing.method, period, loop.place)
            for quotient, timing, loop in zip(self._quotients, self._timing, self.loops, strict=True)
        ]

    def float_controllers(self) -> tuple[SampledController, ...]:
        """Return the controllers in doubles."""
        from flint import ctx

        with ctx.workprec(_RADIUS_BITS):
            exact = self.controllers(self.period)

        def array(values: Any) -> NDArray[np.float64]:
            return np.array([[float(entry) for entry in row] for row in values])

        return tuple(
            SampledController(
                array(F).reshape(len(h), len(h)), array([g])[0], array([h])[0], float(d), computation
            )
            for (F, g, h, d), computation in zip(exact, self.computations, strict=True)
        )

    def matrix(
        self, period: Fraction, computations: Sequence[Fraction], closed: Collection[int], bits: int
    ) -> Any:
        """Return the matrix of the states from one sample to the next (flint `arb_mat`)."""
        from flint import arb_mat, ctx

        with ctx.workprec(bits):
            rows, size = self._equations(period, computations, closed, bits)
            return arb_mat([row[:size] for row in rows[:size]])

    def answers(self) -> tuple[NDArray[np.float64], ...]:
        """Return M, B, C and D of what the closed loops answer to sequences added to measurements."""
        rows, n = self._equations(self.period, self.computations, range(len(self.loops)), _RADIUS_BITS)
        values = np.array([[float(entry) for entry in row] for row in rows])
        return values[:n, :n], values[:n, n:], values[n:, :n], values[n:, n:]

    def _equations(
        self, period: Fraction, computations: Sequence[Fraction], closed: Collection[int], bits: int
    ) -> tuple[Rows, int]:
        """Return rows of the next states and of the answers, over states and what is added to measurements.

        The second value is the number of states.
        """
        from flint import arb, ctx

        with ctx.workprec(bits):
            controllers = self.controllers(period)
            steps = [int(delay // period) for delay in computations]
            rests = [delay - step * period for delay, step in zip(computations, steps, strict=True)]
            Phi, newest, before = _held(self.plant, period, rests)
            C, D = ([[arb(entry) for entry in row] for row in rows] for rows in (self.plant.C, self.plant.D))
            n, zero, one = len(Phi), arb(0), arb(1)
            depths = [
                step + bool(rest or any(row[j] for row in self.plant.D))
                for j, (step, rest) in enumerate(zip(steps, rests, strict=True))
            ]
            first = n + np.concatenate([[0], np.cumsum(depths)])
            states = first[-1] + np.concatenate([[0], np.cumsum([len(c.h) for c in controllers])])
            size = int(states[-1])
            total = size + len(controllers)
            matrix = [[zero] * total for _ in range(total)]

            def add(row: list[Any], addend: Iterable[tuple[int, Any]], factor: Any = one) -> None:
                for column, value in addend:
                    row[column] += factor * value

            measured = []
            for j in range(len(controllers)):
                late = [(int(first[i]) + steps[i], value) for i, value in enumerate(D[j]) if value != 0]
                now = [(i, value) for i, value in enumerate(C[j]) if value != 0]
                measured.append([*now, *late, (size + j, one)])
            for j, controller in enumerate(controllers):
                row = matrix[size + j]
                if j in closed:
                    add(row, ((int(states[j]) + i, value) for i, value in enumerate(controller.h)), -one)
                    add(row, measured[j], -controller.d)
                answer = [(column, value) for column, value in enumerate(row) if value != 0]
                held = [answer, *([(int(first[j]) + k, one)] for k in range(depths[j]))]
                for i in range(n):
                    add(matrix[i], held[steps[j]], newest[i][j])
                    if rests[j]:
                        add(matrix[i], held[steps[j] + 1], before[i][j])
                for k in range(depths[j]):
                    add(matrix[int(first[j]) + k], held[k])
                for i, (weights, gain) in enumerate(zip(controller.F, controller.g, strict=True)):
                    state = matrix[int(states[j]) + i]
                    add(state, ((int(states[j]) + k, value) for k, value in enumerate(weights)))
                    add(state, measured[j], gain)
            for i, weights in enumerate(Phi):
                add(matrix[i], enumerate(weights))
            return matrix, size

    # Verdicts

    @cached_property
    def verdict(self) -> Verdict:
        """The verdict on loops, controllers and every separate part of the graph."""
        if self.lines:
            return Verdict("undecided", _LINES, math.nan)
        return combined([self._shown, *self._generic.unseen()])

    @cached_property
    def _shown(self) -> Verdict:
        """The verdict on what the loops move, by Schur-Cohn in balls of as many bits as it takes."""
        outside = self.poles_outside(self.period, self.computations)
        sizes = sorted(np.abs(repeated(self.poles)).tolist(), reverse=True)
        if outside is None:
            nearest = min(self.poles, key=lambda pole: abs(abs(pole.value) - 1))
            if abs(abs(nearest.value) - 1) < _CIRCLE:
                place = f"{complex(nearest.value):.6g}".replace("+0j", "").replace("-0j", "")
                reason = f"a discrete pole lies on the unit circle at z = {place} within 2^-{_LAST_BITS}"
                return Verdict("at the limit", reason, math.nan)
            outside = sum(size > 1 for size in sizes)  # of reciprocal poles the recursion ends
        if not outside:
            return Verdict("stable", "", 0)
        verb = f"{counted(outside, 'discrete pole')} {'lies' if outside == 1 else 'lie'}"
        reason = f"{verb} outside the unit circle, the largest with |z| = {sizes[0]:.6g}"
        return Verdict("unstable", reason, outside)

    def poles_outside(self, period: Fraction, computations: Sequence[Fraction]) -> int | None:
        """Return the number of discrete poles outside the unit circle; None where it is not decided."""
        from flint import ctx

        bits = _FIRST_BITS
        while bits <= _LAST_BITS:
            with ctx.workprec(bits):
                matrix = self.matrix(period, computations, range(len(self.loops)), bits)
                inside = roots_inside(matrix.charpoly().coeffs())
            if inside is not None:
                return int(matrix.nrows()) - inside
            bits *= 2
        return None

    @cached_property
    def poles(self) -> Sequence[CertifiedRoot]:
        """The discrete poles of the closed loops, in the plane of z."""
        closed = range(len(self.loops))
        return certified_roots(_integers([self._characteristic(closed)])[0])

    def _characteristic(self, closed: Collection[int]) -> list[Any]:
        """Return det(z - M) as balls, ascending."""
        from flint import ctx

        with ctx.workprec(_LOOP_BITS):
            return list(self.matrix(self.period, self.computations, closed, _LOOP_BITS).charpoly().coeffs())

    def _radius(self, period: Fraction, computations: Sequence[Fraction]) -> float:
        """Return the largest |z| of the discrete poles in double precision; inf where it overflows."""
        matrix = self.matrix(period, computations, range(len(self.loops)), _RADIUS_BITS)
        entries = np.array([[float(entry) for entry in row] for row in matrix.tolist()])
        if not np.isfinite(entries).all():
            return math.inf
        return float(np.abs(np.linalg.eigvals(entries)).max(initial=0.0))

    @cached_property
    def largest_sample_time(self) -> float:
        """The sample time at which the loops lose stability, controllers made discrete for each, s.

        It is the first one above that of the scene, inf where none up to 1,000 times it is; of unstable loops
        the last one below, NaN where none down to 1/1,000 of it, or 1/100 of a computation, is, or at the
        limit.
        """
        if self._shown.kind == "at the limit":
            return math.nan
        start = self._radius(self.period, self.computations) - 1
        ratio = _TRIAL_RATIO if start < 0 else 1 / _TRIAL_RATIO
        span = math.ceil(math.log(_TRIED_SPAN) / math.log(_TRIAL_RATIO))
        trials = (float(self.period) * ratio**k for k in range(span + 1))
        shortest = float(max(self.computations)) / ANSWERS_UNDER_WAY.value
        limit = _first_change(
            lambda period: self._radius(Fraction(period), self.computations) - 1,
            takewhile(lambda period: period >= shortest, trials),
        )
        return limit if limit < math.inf or start < 0 else math.nan

    # Margins

    def loop(self, number: int) -> tuple[Any, Any]:
        """Return L of a loop, the others closed, on s of z = (1 + s T/2)/(1 - s T/2) (flint `fmpz_poly`)."""
        return self._loop(number, self.computations)

    def _loop(self, number: int, computations: Sequence[Fraction]) -> tuple[Any, Any]:
        from flint import ctx

        every = range(len(self.loops))
        with ctx.workprec(_LOOP_BITS):
            closed, cut = (
                self.matrix(self.period, computations, kept, _LOOP_BITS).charpoly().coeffs()
                for kept in (every, [loop for loop in every if loop != number])
            )
            above = [a - b for a, b in zip(closed, cut, strict=True)]
            top, bottom = _integers([_bilinear(p, self.period / 2) for p in (above, cut)])
        shared = top.gcd(bottom)
        return (top // shared, bottom // shared) if top != 0 else (top, 0 * top + 1)

    def frequency(self, tangent: float) -> float:
        """Return ω of (2/T) tan(ω T/2), rad/s; that of infinity is the Nyquist frequency."""
        half = float(self.period) / 2
        return math.atan(tangent * half) / half

    def margins(self, number: int) -> Margins:
        """Return the margins of a loop, the others closed."""
        plain, at = margins(*self.loop(number)), self.frequency
        return replace(
            plain,
            stable=self.verdict.stable,
            stability=self.verdict.text,
            unstable_poles=math.inf
            if math.isnan(self.verdict.unstable_poles)
            else self.verdict.unstable_poles,
            delay=self._delay_margin(number) if self.verdict.stable else math.nan,
            gain_crossover=at(plain.gain_crossover) if math.isfinite(plain.phase) else math.inf,
            phase_crossover=at(plain.phase_crossover)
            if math.isfinite(plain.gain) or plain.gain_reduction
            else math.inf,
            modulus_at=at(plain.modulus_at),
            Mt_at=at(plain.Mt_at),
        )

    def _delay_margin(self, number: int) -> float:
        """Return the further computation time of a loop that makes it unstable, s.

        Whole periods turn L alone, by ω T each; the rest ε of one changes |L|, too. The lag at which |L| = 1,
        over ω, has to be a whole number of periods. NaN where |L| reaches 1 at some rests alone.
        """
        period = float(self.period)

        def slack(rest: float) -> float:
            delays = list(self.computations)
            delays[number] += Fraction(rest)
            lags = gain_crossings(*self._loop(number, delays))
            return min((math.radians(lag) / self.frequency(at) for lag, at in lags), default=math.inf)

        prompt = slack(0.0)
        if prompt == math.inf:
            rests = (part * period / _TRIED_RESTS for part in range(1, _TRIED_RESTS))
            return math.inf if all(slack(rest) == math.inf for rest in rests) else math.nan
        periods = math.floor(prompt / period)

        def excess(rest: float) -> float:
            value = slack(rest) - periods * period
            return value if value < 2 * period else -rest  # a lag of 0 became one of 360 degrees

        rests = (part * period / _TRIED_RESTS for part in range(_TRIED_RESTS + 1))
        return periods * period + _first_change(excess, rests)

    def confused_modes(self) -> list[tuple[complex, complex]]:
        """Return pairs of natural modes of the graph that are nearly one for the samples.

        Sampling does not distinguish λ and μ = λ + 2πjk/T (Kalman, Ho & Narendra 1963).
        """
        if self.lines:
            return []
        A = np.array([[float(entry.p) / float(entry.q) for entry in row] for row in self.plant.A])
        values = np.linalg.eigvals(A) if len(A) else np.empty(0, complex)
        T = float(self.period)
        return [
            (a, b)
            for k, a in enumerate(values.tolist())
            for b in values[k + 1 :].tolist()
            if abs(a.imag - b.imag) * T > math.pi and abs(np.exp((a - b) * T) - 1) < _CONFUSED
        ]


def _first_change(function: Callable[[float], float], trials: Iterable[float]) -> float:
    """Return the first zero of a function between trials, by false position; inf where it keeps its sign.

    As a secant that keeps an end twice halves its value there (Illinois), some ten values suffice.
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
            below /= 2
        change, high, above = abs(middle - high), middle, value
        if not value or change <= _LIMIT_RTOL * abs(high):
            break
    return high


# --- exact numbers and balls -----------------------------------------------------------------------


def _exact(number: Any) -> Fraction:
    return rounded_number(reference(number))


def _rational(graph: BondGraph) -> BondGraph:
    """Return a graph with irrational values rounded to many bits."""
    if graph.field is None:
        return graph
    nodes = (
        node if node.value is None else replace(node, value=rounded_number(node.value))
        for node in graph.nodes.values()
    )
    return BondGraph(nodes, graph.bonds)


def _held(plant: ExactSystem, period: Fraction, rests: Sequence[Fraction]) -> tuple[Rows, Rows, Rows]:
    """Return e^(AT), and what an input held over the end of a period adds, and one held over its begin.

    `rests`: by input how long the one before is held, s.
    """
    from flint import arb, arb_mat

    n, inputs = len(plant.A), len(rests)

    def exponential(columns: Sequence[int], time: Fraction) -> tuple[Any, Any]:
        rows = [[*plant.A[i], *(plant.B[i][j] for j in columns)] for i in range(n)]
        joint = [*rows, *([[0] * (n + len(columns))] * len(columns))]
        E = (arb_mat([[arb(entry) for entry in row] for row in joint]) * arb(as_fmpq(time))).exp().tolist()
        return arb_mat([row[:n] for row in E[:n]]), arb_mat([row[n:] for row in E[:n]])

    if not n:
        return [], [], []
    Phi, gains = exponential(range(inputs), period)
    newest, before = gains.tolist(), [[arb(0)] * inputs for _ in range(n)]
    for j, rest in enumerate(rests):
        if rest:
            _, early = exponential([j], rest)
            later, late = exponential([j], period - rest)
            early = later * early
            for i in range(n):
                newest[i][j], before[i][j] = late[i, 0], early[i, 0]
    return Phi.tolist(), newest, before


def _bilinear(polynomial: Sequence[Any], half: Fraction) -> list[Any]:
    """Return p(z)(1 - half s)^n of z = (1 + half s)/(1 - half s) as balls, ascending."""
    from flint import arb, fmpz_poly

    degree, scale = len(polynomial) - 1, as_fmpq(half)
    sums = [arb(0)] * (degree + 1)
    for power, coefficient in enumerate(polynomial):
        weights = fmpz_poly([1, 1]) ** power * fmpz_poly([1, -1]) ** (degree - power)
        for k in range(degree + 1):
            sums[k] += coefficient * int(weights[k])
    return [value * arb(scale**k) for k, value in enumerate(sums)]


def _integers(polynomials: Sequence[Sequence[Any]]) -> list[Any]:
    """Return polynomials of balls rounded to integers (flint `fmpz_poly`), all times one number.

    A ball around zero is zero: poles at z = 1 (integrators) and z = 0 (answers under way) stay what they are.
    """
    from flint import fmpq, fmpq_poly

    rounded = []
    for polynomial in polynomials:
        exact = []
        for ball in polynomial:
            mantissa, exponent = (
                (int(part) for part in ball.mid().man_exp()) if not ball.contains(0) else (0, 0)
            )
            surplus = max(mantissa.bit_length() - _KEPT_BITS, 0)
            mantissa, exponent = mantissa >> surplus, exponent + surplus
            exact.append(fmpq(mantissa << max(exponent, 0), 1 << max(-exponent, 0)))
        rounded.append(fmpq_poly(exact))
    common = math.lcm(*(int(polynomial.denom()) for polynomial in rounded))
    return [(polynomial * common).numer() for polynomial in rounded]
