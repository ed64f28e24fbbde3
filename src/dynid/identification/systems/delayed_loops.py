"""Loops with delays, known or not, of the linear systems that are identified.

The loops are cut: their delayed answers are further inputs v, the answers themselves further outputs z, and
``v_i(t) = z_i(t - τ_i)`` (linear fractional form). `matrices` have v as the last inputs, z as the last
outputs; `loop_delays` are the delays, s, and their derivatives by the values of the parameters (p x m).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from dynid.arithmetic.dependent import Real
from dynid.arrays import Array, ComplexArray
from dynid.bondgraph.controller_circuits import Loop, close_loops
from dynid.bondgraph.graph import BondGraph, Port
from dynid.errors import Singular, UsageError
from dynid.identification.systems.linear_system import Responses
from dynid.lti.generator import RecordTimes
from dynid.lti.signals import Sampled, Signal
from dynid.lti.state_space import Matrices

#: Degree of the history of a delayed answer from which poles are sought.
_HISTORY = 24
#: Poles whose derivatives are given.
_SENSITIVE_POLES = 12
#: Steps of Newton's iteration to a pole, the last one, and how far all may lead, relative.
_NEWTON_STEPS, _LAST_STEP_RTOL, _REACH_RTOL = 20, 1e-12, 0.05


LoopDelays: TypeAlias = tuple[Array, Array]


class DelayedAnswer(NamedTuple):
    """The answer of a loop with a delay that is cut: what the source gives is it, the delay (s) later."""

    source: str
    answer: Port
    delay: Real


def cut_graph(opened: BondGraph, loops: Sequence[Loop]) -> tuple[BondGraph, tuple[DelayedAnswer, ...]]:
    """Return a graph with feedback whose loops with delays are cut, and the delayed answers.

    Raises UsageError if a delay is not positive at its reference value.
    """
    late = [loop for loop in loops if loop.delayed]
    for loop in late:
        if not float(loop.delay) > 0:
            raise UsageError(
                f"the delay of an identified loop is positive, and this one is {float(loop.delay):g} s",
                remedy="Give its parameter a positive start, and true value; or leave the delay out.",
                names=(f"{loop.place}.controller.delay",),
            )
    closed = close_loops(opened, loops, cut=True)
    sources = zip(closed.delayed, late, strict=True)
    return closed.graph, tuple(
        DelayedAnswer(source, answer, loop.delay) for (source, answer), loop in sources
    )


def check_rest(signals: Sequence[Signal], record: RecordTimes, prepared: Sequence[str]) -> None:
    """Refuse a record of a loop with a delay that does not begin at rest, as its inputs or filters tell.

    Raises UsageError.
    """
    begins = [signal.start if isinstance(signal, Sampled) else 0.0 for signal in signals]
    if min(begins, default=record.start) < record.start - record.step / 2 or prepared:
        what = "it is prepared by filters" if prepared else "an input acts before its first sample"
        raise UsageError(
            f"a record of a loop with a delay begins at rest, before which nothing was under way: {what}",
            remedy="Give the record from its beginning on, as it was measured.",
            names=("measurement.prepare", "measurement", "records") if prepared else ("excitation",),
        )


def delayed_response(matrices: Matrices, loop_delays: LoopDelays, omega: Array) -> Responses:
    """Return frequency responses (L x channels x loads), and their derivatives by the values (… x p).

    With ``(s - A) x - E v = B u`` and ``(exp(s τ) - F) v - C x = D u`` as P [x, v] = Q u, and ``y = R [x,
    v] + T u``: H = T + R P^-1 Q, and dP/dτ = s exp(s τ).

    Raises Singular if a response is infinite.
    """
    (P, Q, R, T), (dP, dQ, dR, dT) = _blocks(matrices, loop_delays, np.asarray(1j * omega, dtype=complex))
    try:
        by_load, by_channel = np.linalg.solve(P, Q), np.linalg.solve(P.swapaxes(1, 2), R.swapaxes(1, 2))
    except np.linalg.LinAlgError:
        raise Singular(
            "a frequency response is infinite: a pole lies at one of the frequencies",
            remedy="Leave out that frequency (0 where something integrates).",
            names=("frequency",),
        ) from None
    moved = dT + dR @ by_load + by_channel.swapaxes(1, 2) @ (dQ - dP @ by_load)
    return T + R @ by_load, np.moveaxis(moved, 0, -1)


def _blocks(
    matrices: Matrices, loop_delays: LoopDelays, points: ComplexArray
) -> tuple[list[ComplexArray], list[ComplexArray]]:
    """Return P, Q, R and T of `delayed_response` at points s (L x …), and their derivatives (p x L x …)."""
    delays, late = loop_delays
    s = points[:, None, None]
    n, m = len(matrices.A), len(delays)
    nu, nc = matrices.B.shape[1] - m, len(matrices.C) - m

    def blocks(A: Any, B: Array, C: Array, D: Array, advance: Any) -> list[ComplexArray]:
        direct: Any = sum((s**k * D[..., None, k, :, :] for k in range(D.shape[-3])), np.zeros(()))
        shape = A.shape[:-2]
        B, C = (np.broadcast_to(part[..., None, :, :], (*shape, *part.shape[-2:])) for part in (B, C))
        upper = np.concatenate([A, -B[..., nu:]], axis=-1)
        lower = np.concatenate([-C[..., nc:, :], advance - direct[..., nc:, nu:]], axis=-1)
        Q = np.concatenate([B[..., :nu], direct[..., nc:, :nu]], axis=-2)
        R = np.concatenate([C[..., :nc, :], direct[..., :nc, nu:]], axis=-1)
        return [np.concatenate([upper, lower], axis=-2), Q, R, direct[..., :nc, :nu]]

    advance = np.exp(s * delays) * np.eye(m)
    slopes = np.broadcast_to(-matrices.A_slopes[:, None], (len(late), len(points), n, n))
    at = blocks(s * np.eye(n) - matrices.A, *matrices[1:4], advance)
    return at, blocks(slopes, *matrices[5:], s * advance * late[:, None, None, :])


def delayed_pole_slopes(matrices: Matrices, loop_delays: LoopDelays) -> tuple[ComplexArray, ComplexArray]:
    """Return the slowest poles (m), and their derivatives by the values (m x p): -y dP x / (y P' x)."""
    poles = delayed_poles(matrices, loop_delays)
    poles = poles[np.argsort(np.abs(poles), kind="stable")][:_SENSITIVE_POLES]
    (P, *_), (dP, *_) = _blocks(matrices, loop_delays, poles)
    delays, n = loop_delays[0], len(matrices.A)
    rates = np.zeros_like(P)
    rates[:, :n, :n] = np.eye(n)
    rates[:, n:, n:] = (delays * np.exp(poles[:, None, None] * delays)) * np.eye(len(delays))
    left, _, right = np.linalg.svd(P)
    y, x = left[:, :, -1].conj(), right[:, -1].conj()
    moved = np.einsum("mi,pmij,mj->mp", y, dP, x)
    return poles, -moved / np.einsum("mi,mij,mj->m", y, rates, x)[:, None]


def delayed_poles(matrices: Matrices, loop_delays: LoopDelays) -> ComplexArray:
    """Return poles, 1/s: of the infinitely many those whose motion a polynomial follows over a delay.

    They are roots of the characteristic function, sought from the eigenvalues of the equations with
    polynomials for the histories of the answers (Breda, Maset & Vermiglio 2005).
    """
    delays = loop_delays[0]
    n, m = len(matrices.A), len(delays)
    nu, nc = matrices.B.shape[1] - m, len(matrices.C) - m
    A, E, C, F = matrices.A, matrices.B[:, nu:], matrices.C[nc:], matrices.D[0, nc:, nu:]
    slope = _differentiation(np.cos(np.pi * np.arange(_HISTORY + 1) / _HISTORY))
    read = np.kron(np.eye(m), np.eye(1, _HISTORY, _HISTORY - 1))  # a delay before: v
    z = np.concatenate([C, F @ read], axis=1)
    moving = np.kron(np.diag(2 / delays), slope[1:, 1:])
    lower = np.concatenate([np.zeros((m * _HISTORY, n)), moving], axis=1)
    lower += np.kron(np.diag(2 / delays), slope[1:, :1]) @ z
    generator = np.concatenate([np.concatenate([A, E @ read], axis=1), lower])
    eye, roots = np.eye(m), list[complex]()
    for start in np.linalg.eigvals(generator).tolist():
        root = start
        for _ in range(_NEWTON_STEPS):
            advance = np.exp(root * delays) * eye
            P = np.block([[root * np.eye(n) - A, -E], [-C, advance - F]])
            slopes = np.block([[np.eye(n), np.zeros((n, m))], [np.zeros((m, n)), delays * advance]])
            if not np.isfinite(P).all():
                break
            try:
                step = 1 / np.trace(np.linalg.solve(P, slopes))
            except np.linalg.LinAlgError:  # at the root
                step = 0.0
            root -= step
            if not abs(root - start) <= _REACH_RTOL * abs(start):
                break
            if abs(step) <= _LAST_STEP_RTOL * abs(root):
                roots.append(root)
                break
    return np.array(roots, dtype=complex)


def _differentiation(points: Array) -> Array:
    """Return the matrix from values of a polynomial at points to those of its derivative."""
    apart = points[:, None] - points + np.eye(len(points))
    weights = 1 / apart.prod(axis=1)
    matrix = weights / weights[:, None] / apart
    np.fill_diagonal(matrix, 0.0)
    return np.asarray(matrix - np.diag(matrix.sum(axis=1)))
