"""Exact time response of linear systems to continuous-time signals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dynid.choices import LONG_STEPS
from dynid.errors import NumericalError, UsageError
from dynid.lti.exponential import accurate_exponential, balance, exponential, rescaled
from dynid.lti.floating import guarded
from dynid.lti.generator import Signal
from dynid.lti.lines import sum_lines
from dynid.lti.model import StateSpace
from dynid.lti.recurrence import recurrence
from dynid.lti.signals import Impulse, Multisine, Random
from dynid.lti.timeline import Timeline, timeline

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

# A Fourier line closer to a pole than this (relative to its frequency) is propagated with its generator:
# particular and homogeneous part would cancel there, and lose as many digits as the distance has.
_NEAR_POLE = 1e-4


# From this many steps in one on, the exponential over them is worth its digits.
_MANY = 100
# Phase, rad, beyond which double precision keeps less than three digits of a motion.
_FARTHEST_PHASE = 1e-3 / float(np.finfo(float).eps)
# A motion that has decayed by this exponent has no phase that matters.
_DECAYED = 40.0


class _NearLines(Multisine):
    """The lines of a random signal beside a pole."""

    kind = "random"
    pace = "band"


class Response(NamedTuple):
    """A time response: `outputs` (times x outputs), `states` (times x states), `inputs` (times x inputs)."""

    outputs: Array
    states: Array
    inputs: Array


@guarded("the time response")
def response(
    system: StateSpace,
    signals: Sequence[Signal],
    times: ArrayLike,
    x0: ArrayLike | None = None,
    start: float | None = None,
) -> Response:
    """Propagate a system exactly; values at a jump are those right after it.

    Each interval takes one product with the exponential of system and signal generator joined, one
    exponential a distinct interval length. The many lines of a random signal enter as particular solutions
    ``(i omega - A)^-1 B`` beside the homogeneous response. No step size, stiffness or resonance matters.

    Parameters
    ----------
    system
        The system.
    signals
        One signal an input. An impulse makes the state jump at t = 0; Dirac parts of an output (through D
        or the higher feedthrough matrices) are not shown.
    times
        Strictly increasing times, s.
    x0
        State at `start`, before a jump there; absent: rest.
    start
        Time from which on to propagate, s; absent: 0, or the first time if that is negative.

    Raises
    ------
    UsageError
        If shapes or times make no sense.
    NumericalError
        If the response overflows, or turns so often that double precision knows no phase of it.
    """
    t = np.asarray(times, dtype=float)
    _check(system, signals, x0)
    if start is None:
        start = min(0.0, float(t.flat[0])) if t.size else 0.0
    initial = np.zeros(len(system.A)) if x0 is None else np.asarray(x0, dtype=float)
    poles = np.linalg.eigvals(rescaled(system.A, balance(system.A))).astype(complex)
    generated, spread = _split(poles, signals)
    line = timeline(generated, t, start)
    check_phase(poles, float(t[-1]) - start)
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
    outputs = _seen(system, states, inputs)
    if not (np.isfinite(outputs).all() and np.isfinite(states).all()):
        raise NumericalError(
            "the time response overflows", remedy="The system is unstable: shorten the time."
        )
    return Response(outputs, states, inputs[0])


def _seen(system: StateSpace, states: Array, inputs: Array) -> Array:
    """Return the outputs of states (times x n) and of the inputs' derivatives (orders x times x inputs)."""
    outputs = states @ system.C.T
    for feedthrough, derivative in zip((system.D, *system.higher), inputs, strict=True):
        outputs = outputs + derivative @ feedthrough.T
    return np.asarray(outputs)


def _check(system: StateSpace, signals: Sequence[Signal], x0: ArrayLike | None) -> None:
    if len(signals) != system.B.shape[1]:
        raise UsageError(f"a system needs one signal an input: {system.B.shape[1]}, not {len(signals)}")
    if x0 is not None and np.shape(x0) != (len(system.A),):
        raise UsageError(f"an initial state of shape {np.shape(x0)} for {len(system.A)} states")
    if x0 is not None and not np.all(np.isfinite(np.asarray(x0, dtype=float))):
        raise UsageError("the initial state must be finite numbers")


def _split(
    poles: ComplexArray, signals: Sequence[Signal]
) -> tuple[list[Signal], list[tuple[int, Array, ComplexArray, float]]]:
    """Take the lines of random signals out of the generators, except those beside a pole."""
    generated, spread = list(signals), []
    for column, signal in enumerate(signals):
        if not isinstance(signal, Random):
            continue
        omega, c = signal.lines
        near = np.zeros(len(omega), dtype=bool)
        for pole in poles:
            near |= np.abs(1j * omega - pole) < _NEAR_POLE * omega
        spread.append((column, omega[~near], c[~near], signal.period))
        generated[column] = Impulse(0.0)
        if near.any():  # c = -i a exp(i phase)
            sines = (np.abs(c[near]), omega[near], np.angle(1j * c[near]))
            generated[column] = _NearLines(*(tuple(part.tolist()) for part in sines))
    return generated, spread


def check_phase(poles: ComplexArray, duration: float, names: Sequence[str] = ()) -> None:
    """Refuse motions of which double precision knows no phase any more.

    Parameters
    ----------
    poles
        The poles, rad/s.
    duration
        Time that they are propagated over, s.
    names
        What an error names.

    Raises
    ------
    NumericalError
        If an oscillation that has not decayed turns by more than some 4e12 rad.
    """
    living = duration * np.maximum(-poles.real, 0.0) < _DECAYED
    phase = float(np.abs(poles.imag[living]).max(initial=0.0)) * duration
    if phase > _FARTHEST_PHASE:
        raise NumericalError(
            f"a natural motion turns by {phase:.1g} rad in {duration:g} s, and double precision knows no "
            "phase of it",
            remedy="Make what is that stiff rigid, or shorten the time.",
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
        part = slice(first, first + chunk)
        matrices = 1j * omega[part, None, None] * np.eye(n) - scaled
        X[part] = np.linalg.solve(matrices, (b / d)[:, None].astype(complex))[..., 0] * d
    return X


def _propagated(system: StateSpace, line: Timeline, initial: Array) -> Array:
    """Return the states at the wanted times, from `initial` at the first node on."""
    n = len(initial)
    d = balance(system.A)
    A, drive = rescaled(system.A, d), system.B @ line.H / d[:, None]
    steps = [joint_step(A, drive, line.G, h) for h in line.lengths]
    x = initial / d
    jump = system.B @ line.jumps / d
    forcing = np.empty((len(line.which), n))
    for k, (_, Gamma) in enumerate(steps):
        here = line.which == k
        forcing[here] = line.W[:-1][here] @ Gamma.T
    states = np.empty((len(line.nodes), n))
    with np.errstate(over="ignore", invalid="ignore"):
        states[0] = x + jump if line.jump_node == 0 else x
        for first, last in _runs(line):
            k = line.which[first]
            power = partial(_power, A, line.lengths[k])
            inside = recurrence(steps[k][0], forcing[first:last, None], states[first, None], power)
            states[first + 1 : last + 1] = inside[:, 0]
            if last == line.jump_node:
                states[last] += jump
    return np.asarray(states[line.wanted] * d)


def _runs(line: Timeline) -> list[tuple[int, int]]:
    """Return the first and last nodes of stretches of equal steps without a jump on the way."""
    changes = np.flatnonzero(np.diff(line.which)) + 1
    jump = [line.jump_node] if 0 < line.jump_node < len(line.which) else []
    ends = np.unique([0, *changes.tolist(), *jump, len(line.which)])
    return list(pairwise(ends.tolist()))


def _power(A: Array, h: float, count: int) -> Array | None:
    """Return exp(A h)^count to all digits where that many steps would lose some; else none."""
    return accurate_exponential(A, count * h) if count >= _MANY and len(A) <= LONG_STEPS.value else None


def joint_step(A: Array, drive: Array, G: Array, h: float) -> tuple[Array, Array]:
    """Return Phi and Gamma of ``x(t+h) = Phi x(t) + Gamma w(t)`` for ``x' = A x + drive w``, ``w' = G w``.

    Parameters
    ----------
    A, drive, G
        Matrices (n x n, n x p, p x p), 1/s.
    h
        Step, s.
    """
    n = len(A)
    scale = drive_scale(A, drive)
    E = exponential(joint_generator(A, drive * scale, G), h)
    return E[:n, :n], E[:n, n:] / scale


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
    size, reference = (float(np.abs(part).sum(axis=0).max(initial=0.0)) for part in (drive, A))
    if not (0 < size < np.inf and 0 < reference < np.inf):
        return 1.0
    exponent = math.ceil(math.log2(size) - math.log2(reference))
    return math.ldexp(1.0, max(-1000, min(1000, -exponent)))
