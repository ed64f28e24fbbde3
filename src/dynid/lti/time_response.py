"""Exact time responses of linear systems to continuous-time signals.

A driven system is propagated over a timeline: requested times, breakpoints of signals and substeps, merged.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dynid.arrays import REMEDY, Array, ComplexArray, guarded
from dynid.defaults import LONG_STEPS
from dynid.errors import NumericalError, UsageError
from dynid.lti.exponential import accurate_exponential, balance, exponential, rescaled
from dynid.lti.generator import Signal
from dynid.lti.recurrence import recurrence
from dynid.lti.signals import Impulse, Multisine, Random
from dynid.lti.state_space import StateSpace
from dynid.lti.waveforms import sum_lines
from dynid.number_format import root_text

Indices = NDArray[np.int64]

# Most substeps of a signal: seconds for a response, minutes for a filter.
_MAX_SUBSTEPS = 1_000_000
# Most numbers in the table of generator states (800 MB with temporaries).
_MAX_GENERATOR_NUMBERS = 50_000_000


@dataclass(frozen=True, eq=False)
class Timeline:
    """Intervals between nodes, in each of which all signals follow one joint generator."""

    nodes: Array  # times (intervals + 1), s, ascending
    lengths: Array  # the distinct interval lengths, s
    which: Indices  # for each interval the index of its length
    wanted: Indices  # nodes of the requested times
    #: Joint generator ``w' = G w``, ``u = H w`` (states x states, inputs x states).
    G: Array
    H: Array
    W: Array  # generator states at the beginning of each interval and at the end (nodes x states)
    jumps: Array  # Dirac strengths (inputs) at t = 0
    jump_node: int  # the node at t = 0 if an impulse acts there, else -1
    signals: Sequence[Signal]  # as they act

    def sample_of(self) -> Indices:
        """Return the index of every node among the requested times, or -1 (nodes)."""
        out = np.full(len(self.nodes), -1, dtype=np.int64)
        out[self.wanted] = np.arange(len(self.wanted))
        return out

    def inputs(self, order: int = 0, chosen: slice | NDArray[np.int64] = slice(None)) -> Array:
        """Return the `order`-th derivative of inputs at requested times, or chosen ones (times x inputs)."""
        readout = self.H @ np.linalg.matrix_power(self.G, order)
        return np.asarray(self.W[self.wanted[chosen]] @ readout.T)


def timeline(signals: Sequence[Signal], times: Array, start: float) -> Timeline:
    """Merge the requested times with the breakpoints and substeps of the signals, one per input.

    Propagation begins at `start`, s, at or before the first requested time. `UsageError` if the times do not
    increase, or a signal is too fast for their span.
    """
    if times.ndim != 1 or len(times) == 0 or not np.all(np.isfinite(times)):
        raise UsageError("the times of a response must be a list of finite numbers")
    if np.any(np.diff(times) <= 0):
        raise UsageError("the times of a response must increase")
    if not start <= times[0]:
        raise UsageError(f"a response cannot start at {start:g} s, after its first time {times[0]:g} s")
    jumps = np.array([signal.jump for signal in signals], dtype=float)
    nodes = _nodes(signals, times, start, bool(np.any(jumps)))
    gaps = np.diff(nodes)
    lengths, which = np.empty(0), np.empty(len(gaps), dtype=np.int64)
    if len(gaps):  # lengths that are equal to rounding are one, their mean
        order = np.argsort(gaps)
        new_group = np.diff(gaps[order]) > 8 * np.finfo(float).eps * float(np.max(np.abs(nodes)))
        which[order] = np.concatenate([[0], np.cumsum(new_group)])
        lengths = np.bincount(which, weights=gaps) / np.bincount(which)
    generators = [signal.generator() for signal in signals]
    size = sum(len(block) for block, _ in generators)
    G, H = np.zeros((size, size)), np.zeros((len(generators), size))
    first = 0
    for row, (block, readout) in enumerate(generators):
        here = slice(first, first + len(block))
        G[here, here] = block
        H[row, here] = readout
        first += len(block)
    if len(nodes) * len(G) > _MAX_GENERATOR_NUMBERS:
        largest = max(signals, key=lambda signal: len(signal.generator()[1]))
        raise UsageError(
            f"{len(nodes):,} times are too many for signals of {len(G)} generator states",
            remedy="Ask for fewer times, or for a signal of fewer sines.",
            names=[largest.kind, largest.pace],
        )
    middles = np.append((nodes[:-1] + nodes[1:]) / 2, nodes[-1])
    W = np.concatenate([np.empty((len(nodes), 0)), *(s.states(nodes, middles) for s in signals)], axis=1)
    zero = np.flatnonzero(nodes == 0.0) if np.any(jumps) else np.empty(0, dtype=np.int64)
    jump_node = int(zero[0]) if len(zero) else -1
    wanted = np.searchsorted(nodes, times)
    return Timeline(nodes, lengths, which, wanted, G, H, W, jumps, jump_node, signals)


def _nodes(signals: Sequence[Signal], times: Array, start: float, impulse: bool) -> Array:
    """Return requested times, start, breakpoints (snapped to requested times within rounding), substeps."""
    base = times if start == times[0] else np.concatenate([[start], times])
    breaks = [signal.breakpoints(float(base[0]), float(base[-1])) for signal in signals]
    extra = np.unique(np.concatenate([np.empty(0), *breaks, *([[0.0]] if impulse else [])]))
    extra = extra[(extra > base[0]) & (extra < base[-1])]
    spacing = float(np.min(np.diff(base), initial=math.inf))
    right = np.clip(np.searchsorted(base, extra), 1, max(1, len(base) - 1))
    right = np.minimum(right, len(base) - 1)
    left = np.maximum(right - 1, 0)
    nearest = base[np.where(np.abs(extra - base[left]) <= np.abs(base[right] - extra), left, right)]
    tolerance = 1e-9 * spacing if math.isfinite(spacing) else 0.0
    nodes = np.union1d(base, extra[np.abs(extra - nearest) > tolerance])
    if not signals:
        return nodes
    fastest = min(signals, key=lambda signal: signal.longest_step)
    return _subdivided(nodes, fastest)


def _subdivided(nodes: Array, fastest: Signal) -> Array:
    """Return the nodes with every interval longer than the fastest signal allows cut into equal parts."""
    gaps, longest = np.diff(nodes), fastest.longest_step
    if not len(gaps) or gaps.max() <= longest:
        return nodes
    with np.errstate(over="ignore", divide="ignore"):
        parts = np.maximum(1.0, np.ceil(gaps / longest * (1 - 1e-12)))
    if not parts.sum() - len(parts) <= _MAX_SUBSTEPS:
        raise UsageError(
            f"the {fastest.kind} is too fast for its duration: it takes {parts.sum():.2g} substeps of "
            f"{longest:.2g} s; at most {_MAX_SUBSTEPS:,} are allowed",
            remedy="Shorten the time, or lower the frequencies.",
            names=(fastest.kind, fastest.pace),
        )
    repeats = parts.astype(int)
    first = np.repeat(np.cumsum(repeats) - repeats, repeats)
    fraction = (np.arange(repeats.sum()) - first) / np.repeat(repeats, repeats)
    inner = np.repeat(nodes[:-1], repeats) + fraction * np.repeat(gaps, repeats)
    return np.append(inner, nodes[-1])


# A Fourier line nearer to a pole than this part of its frequency is propagated with its generator: the
# particular and the homogeneous solution would cancel there.
_POLE_RTOL = 1e-4
# Number of equal steps from which on the exponential over all of them is computed to all digits.
_MANY_STEPS = 100
# Phase, rad, of which double precision keeps three digits.
_LARGEST_PHASE = 1e-3 / float(np.finfo(float).eps)
# Exponent of a growing mode beyond which it explains an overflow: that of doubles is 709.
_MAX_GROWTH_EXPONENT = 300.0
# Decay exponent beyond which the phase of an oscillation is irrelevant.
_DECAYED_EXPONENT = 40.0
# Relative differences of this size are rounding: of the pieces of a spline, of sin(pi).
_JUMP_TOL = 1e-9


class _NearLines(Multisine):
    """The lines of a random signal near a pole."""

    kind = "random"
    pace = "band"


class TimeResponse(NamedTuple):
    """A time response: `outputs` (times x outputs), `states` (times x states), `inputs` (times x inputs)."""

    outputs: Array
    states: Array
    inputs: Array


@guarded("the time response")
def propagate(
    system: StateSpace,
    signals: Sequence[Signal],
    times: ArrayLike,
    x0: ArrayLike | None = None,
    start: float | None = None,
) -> TimeResponse:
    """Propagate a system exactly, one signal per input; values at a jump are those right after it.

    Each interval takes one product with the exponential of the system joined with its signal generators;
    there is one exponential per distinct interval length. The lines of a random signal enter as particular
    solutions ``(i omega - A)^-1 B``, added to the homogeneous response. The result depends neither on a step
    size nor on stiffness or resonance.

    Times (s) strictly increase; propagation starts at `start`, default 0, or the first time if that is
    negative, with the state `x0` before a jump there. An impulse makes the state jump at t = 0; Dirac parts
    of an output (through D or the higher feedthrough matrices) are not returned. `NumericalError` if the
    response overflows, or its phase exceeds double precision.
    """
    t = np.asarray(times, dtype=float)
    if len(signals) != system.B.shape[1]:
        raise UsageError(f"a system needs one signal per input: {system.B.shape[1]}, not {len(signals)}")
    if x0 is not None and np.shape(x0) != (len(system.A),):
        raise UsageError(f"an initial state of shape {np.shape(x0)} for {len(system.A)} states")
    if x0 is not None and not np.all(np.isfinite(np.asarray(x0, dtype=float))):
        raise UsageError("the initial state must be finite numbers")
    if start is None:
        start = min(0.0, float(t.flat[0])) if t.size else 0.0
    initial = np.zeros(len(system.A)) if x0 is None else np.asarray(x0, dtype=float)
    poles = np.linalg.eigvals(rescaled(system.A, balance(system.A))).astype(complex)
    generated, spread = _split_lines(poles, signals)
    line = timeline(generated, t, start)
    check_phase(poles, float(t[-1]) - start)
    with guarded("the time response", remedy=_remedy(poles, float(t[-1]) - start)):
        return _response(system, line, initial, spread, t, start)


def _remedy(poles: ComplexArray, duration: float) -> str:
    """Return what to do where the response overflows, with the mode whose growth explains it."""
    fastest = poles[poles.real.argmax()] if len(poles) else 0.0
    if not fastest.real * duration > _MAX_GROWTH_EXPONENT:
        return REMEDY
    mode = root_text(complex(fastest.real, abs(fastest.imag)))
    growth = f"e^{fastest.real * duration:.4g} in {duration:.4g} s"
    remedy = "shorten the time (stop), or stabilise the system"
    return f"The natural mode at {mode} rad/s grows by {growth}: {remedy}."


def _response(
    system: StateSpace,
    line: Timeline,
    initial: Array,
    spread: Sequence[tuple[int, Array, ComplexArray, float]],
    t: Array,
    start: float,
) -> TimeResponse:
    """Return the response to a timeline and to lines of random signals that are spread over frequencies."""
    highest = len(system.higher)
    inputs = np.stack([line.inputs(order) for order in range(highest + 1)])
    states = np.zeros((len(t), len(initial)))
    for column, omega, c, period in spread:
        X = _particular(system.A, system.B[:, column], omega) * c[:, None]
        initial = initial - sum_lines(omega, X, np.array([start]))[0]
        orders = c[:, None] * (1j * omega[:, None]) ** np.arange(highest + 1)
        sums = sum_lines(omega, np.concatenate([X, orders], axis=1), t, period)
        states += sums[:, : len(initial)]
        inputs[:, :, column] += sums[:, len(initial) :].T
    states += _propagated(system, line, initial)
    outputs = states @ system.C.T
    for feedthrough, derivative in zip((system.D, *system.higher), inputs, strict=True):
        outputs = outputs + derivative @ feedthrough.T
    outputs = np.asarray(outputs)
    if not (np.isfinite(outputs).all() and np.isfinite(states).all()):
        raise OverflowError
    return TimeResponse(outputs, states, inputs[0])


def _split_lines(
    poles: ComplexArray, signals: Sequence[Signal]
) -> tuple[list[Signal], list[tuple[int, Array, ComplexArray, float]]]:
    """Separate the lines of random signals from the generated signals, except lines near a pole."""
    generated, spread = list(signals), []
    for column, signal in enumerate(signals):
        if not isinstance(signal, Random):
            continue
        omega, c = signal.lines
        near = np.zeros(len(omega), dtype=bool)
        for pole in poles:
            near |= np.abs(1j * omega - pole) < _POLE_RTOL * omega
        spread.append((column, omega[~near], c[~near], signal.period))
        generated[column] = Impulse(0.0)
        if near.any():  # c = -i a exp(i phase)
            sines = (np.abs(c[near]), omega[near], np.angle(1j * c[near]))
            generated[column] = _NearLines(*(tuple(values.tolist()) for values in sines))
    return generated, spread


def check_phase(poles: ComplexArray, duration: float, names: Sequence[str] = ()) -> None:
    """Raise a `NumericalError` for oscillations whose phase exceeds double precision.

    That is where one that has not decayed turns by more than about 4e12 rad.
    """
    lasting = duration * np.maximum(-poles.real, 0.0) < _DECAYED_EXPONENT
    phase = float(np.abs(poles.imag[lasting]).max(initial=0.0)) * duration
    if phase > _LARGEST_PHASE:
        raise NumericalError(
            f"a natural oscillation turns by {phase:.1g} rad in {duration:g} s, beyond the phase that double "
            "precision resolves",
            remedy="Replace very stiff parts by rigid ones, or shorten the time.",
            names=names,
        )


def _particular(A: Array, b: Array, omega: Array) -> ComplexArray:
    """Solve (i omega - A) X = b for all lines (lines x states); no line lies on a pole."""
    n = len(b)
    X = np.empty((len(omega), n), dtype=complex)
    d = balance(A)
    scaled = rescaled(A, d)
    chunk = max(1, 2_000_000 // max(1, n * n))
    for first in range(0, len(omega), chunk):
        columns = slice(first, first + chunk)
        matrices = 1j * omega[columns, None, None] * np.eye(n) - scaled
        X[columns] = np.linalg.solve(matrices, (b / d)[:, None].astype(complex))[..., 0] * d
    return X


def _propagated(system: StateSpace, line: Timeline, initial: Array) -> Array:
    """Return the states at the wanted times, from `initial` at the first node on."""
    n = len(initial)
    d = balance(system.A)
    A, drive = rescaled(system.A, d), system.B @ line.H / d[:, None]
    scale = drive_scale(A, drive)
    joint = joint_generator(A, drive * scale, line.G)
    exponentials = [exponential(joint, h) for h in line.lengths]  # Phi and scale * Gamma
    x = initial / d
    jump = system.B @ line.jumps / d
    forcing = np.empty((len(line.which), n))
    for k, E in enumerate(exponentials):
        here = line.which == k
        forcing[here] = line.W[:-1][here] @ (E[:n, n:] / scale).T
    # Stretches of equal steps, ending at the jump as well.
    changes = np.flatnonzero(np.diff(line.which)) + 1
    at_jump = [line.jump_node] if 0 < line.jump_node < len(line.which) else []
    ends = np.unique([0, *changes.tolist(), *at_jump, len(line.which)])
    states = np.empty((len(line.nodes), n))
    with np.errstate(over="ignore", invalid="ignore"):
        states[0] = x + jump if line.jump_node == 0 else x
        for first, last in pairwise(ends.tolist()):
            k = line.which[first]

            def power(count: int, h: float = line.lengths[k]) -> Array | None:
                accurate = count >= _MANY_STEPS and n <= LONG_STEPS.value
                return accurate_exponential(A, count * h) if accurate else None

            inside = recurrence(
                exponentials[k][:n, :n], forcing[first:last, None], states[first, None], power
            )
            states[first + 1 : last + 1] = inside[:, 0]
            if last == line.jump_node:
                states[last] += jump
    return np.asarray(states[line.wanted] * d)


def joint_generator(A: Array, drive: Array, G: Array) -> Array:
    """Return the matrix ``[[A, drive], [0, G]]``."""
    n, p = drive.shape
    joint = np.zeros((n + p, n + p))
    joint[:n, :n] = A
    joint[:n, n:] = drive
    joint[n:, n:] = G
    return joint


def drive_scale(A: Array, drive: Array) -> float:
    """Return the power of two that keeps the drive from raising the norm of the joint generator."""
    size, reference = (float(np.abs(matrix).sum(axis=0).max(initial=0.0)) for matrix in (drive, A))
    if not (0 < size < np.inf and 0 < reference < np.inf):
        return 1.0
    exponent = math.ceil(math.log2(size) - math.log2(reference))
    return math.ldexp(1.0, max(-1000, min(1000, -exponent)))


def impulsive_outputs(system: StateSpace, signals: Sequence[Signal], stop: float) -> NDArray[np.bool_]:
    """Return a mask of the outputs with a Dirac impulse, or a derivative of one, at a time in [0, stop].

    An output has one where it follows a derivative of an input of which a lower derivative jumps. Before
    t = 0 every signal is zero.
    """
    impulsive = np.zeros(len(system.C), dtype=bool)
    for order, feedthrough in enumerate((system.D, *system.higher)):
        for column in np.flatnonzero(feedthrough.any(axis=0)):
            if any(derivative_jumps(signals[int(column)], below, stop) for below in range(-1, order)):
                impulsive |= feedthrough[:, column] != 0
    return impulsive


def derivative_jumps(signal: Signal, order: int, stop: float) -> bool:
    """Return True where a derivative of a signal jumps; of order -1, where the signal is an impulse."""
    if order < 0:
        return signal.jump != 0
    G, h = signal.generator()
    if not len(h):
        return False
    readout = h @ np.linalg.matrix_power(G, order)
    points = np.unique(np.concatenate([[0.0], signal.breakpoints(0.0, stop)]))
    points = points[points < stop]
    ends = np.append(points, stop)
    middles = (ends[:-1] + ends[1:]) / 2
    after, between = (signal.states(times, middles) @ readout for times in (points, middles))
    before = np.zeros(len(points))
    if len(points) > 1:
        before[1:] = signal.states(points[1:], middles[:-1]) @ readout
    size = max(np.abs(values).max() for values in (after, before, between))
    return bool(np.any(np.abs(after - before) > _JUMP_TOL * size))
