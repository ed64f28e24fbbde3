"""Time responses whose digits are checked, and recomputed in multiple precision where doubles lose them.

An output may be a small difference of large states (values in SI units span up to 24 orders of magnitude),
and no step size shows it. Therefore part of the response is repeated with every coefficient changed by one
rounding. Where an output changes by that, it is computed again from the exact coefficients.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dynid.arrays import Array
from dynid.errors import NumericalError
from dynid.lti.generator import Signal
from dynid.lti.signals import Random
from dynid.lti.state_space import StateSpace
from dynid.lti.time_response import Timeline, TimeResponse, propagate, timeline

#: Relative changes of an output: up to the first it is accepted, beyond the second an error is raised.
_TRUSTED_RTOL, _REFUSED_RTOL = 1e-10, 1e-3
#: Instants at which the response is repeated.
_CHECKED_TIMES = 100
#: Most products in multiple precision (seconds), overhead of a step in products, most doublings of precision.
_MAX_PRODUCTS, _STEP_PRODUCTS, _MAX_DOUBLINGS = 10_000_000, 100, 4


@dataclass(frozen=True, eq=False)
class RationalMatrices:
    """The exact matrices of a `StateSpace` (flint `fmpq_mat`): A, B, C, and D with the higher ones."""

    A: Any
    B: Any
    C: Any
    feedthrough: tuple[Any, ...]


def refined_response(
    system: StateSpace, signals: Sequence[Signal], times: ArrayLike, rational: Callable[[], RationalMatrices]
) -> tuple[TimeResponse, float]:
    """Propagate a system as `propagate` does, and recompute outputs that rounding spoils.

    `rational` returns the exact matrices, where they are needed. The second value is the largest error of an
    output relative to its maximum, 0 where it is negligible; `NumericalError` where an output is lost to
    rounding.
    """
    t = np.asarray(times, dtype=float)
    response = propagate(system, signals, t)
    change = _rounding_sensitivity(response, system, signals, t)
    if change.max(initial=0.0) <= _TRUSTED_RTOL:
        return response, 0.0
    line = (
        None
        if any(isinstance(signal, Random) for signal in signals)
        else timeline(signals, t, min(0.0, float(t[0])))
    )
    size = len(system.A) + len(system.C) + (0 if line is None else len(line.G))
    if line is not None and len(line.nodes) * (_STEP_PRODUCTS + size**2) <= _MAX_PRODUCTS:
        outputs = _multiprecision_outputs(rational(), line)
        if outputs is not None:
            return response._replace(outputs=outputs), 0.0
    worst = int(change.argmax())
    if change[worst] > _REFUSED_RTOL:
        raise NumericalError(
            f"the time response of '{system.outputs[worst]}' is lost to rounding: it is the small difference "
            "of large states",
            remedy="Request fewer times, or bring the values nearer to each other.",
        )
    return response, float(change[worst])


def _rounding_sensitivity(
    response: TimeResponse, system: StateSpace, signals: Sequence[Signal], t: Array
) -> Array:
    """Return the change of each output, relative to its maximum, by one rounding of every coefficient."""
    some = slice(
        None, None, math.ceil(len(t) / _CHECKED_TIMES)
    )  # equidistant where the times are: one exponential
    rng = np.random.default_rng(0)

    def perturbed(matrix: Array) -> Array:
        return matrix * (1 + np.finfo(float).eps * rng.choice([-1.0, 1.0], matrix.shape))

    moved = replace(
        system,
        A=perturbed(system.A),
        B=perturbed(system.B),
        C=perturbed(system.C),
        D=perturbed(system.D),
        higher=tuple(perturbed(matrix) for matrix in system.higher),
    )
    try:
        again = propagate(moved, signals, t[some], start=min(0.0, float(t[0]))).outputs
    except NumericalError:  # the perturbed response overflows
        return np.zeros(len(system.C))
    difference = np.abs(again - response.outputs[some]).max(axis=0, initial=0.0)
    largest = np.abs(response.outputs).max(axis=0, initial=0.0)
    lost = np.where(difference > 0, np.inf, 0.0)
    return np.asarray(np.divide(difference, largest, out=lost, where=largest > 0))


def _multiprecision_outputs(exact: RationalMatrices, line: Timeline) -> Array | None:
    """Return the outputs once doubling the bits no longer changes them; None where it always does."""
    from flint import arb_mat

    sizes = [float(abs(entry).upper()) for entry in arb_mat(exact.A).entries()]
    bits = 128 + 4 * math.ceil(math.log2(1.0 + sum(sizes) * float(line.lengths.max(initial=0.0))))
    before = _propagated(exact, line, bits)
    for _ in range(_MAX_DOUBLINGS):
        bits *= 2
        after = _propagated(exact, line, bits)
        largest = np.abs(after).max(axis=0, initial=0.0)
        if np.all(np.abs(after - before) <= 4 * np.finfo(float).eps * largest):
            return after
        before = after
    return None


def _propagated(exact: RationalMatrices, line: Timeline, bits: int) -> Array:
    """Return the outputs at the requested times, propagated with a precision of `bits`."""
    from flint import arb, arb_mat, ctx

    with ctx.workprec(bits):
        B, C, H, G = (arb_mat(matrix) for matrix in (exact.B, exact.C, line.H.tolist(), line.G.tolist()))
        A, n, none = arb_mat(exact.A), B.nrows(), [arb(0)] * B.nrows()
        rows = [[*state_row, *driven] for state_row, driven in zip(A.tolist(), (B * H).tolist(), strict=True)]
        joint = arb_mat([*rows, *([*none, *row] for row in G.tolist())])
        tables = [(joint * arb(float(length))).exp().mid().tolist()[:n] for length in line.lengths]
        steps = [(arb_mat([row[:n] for row in E]), arb_mat([row[n:] for row in E])) for E in tables]
        direct = arb_mat(C.nrows(), G.nrows())
        for feedthrough in exact.feedthrough:
            direct += arb_mat(feedthrough) * H
            H = H * G
        jump, x = B * _column(line.jumps), arb_mat(C.ncols(), 1)
        outputs = np.zeros((len(line.wanted), C.nrows()))
        for k, sample in enumerate(line.sample_of()):
            w = _column(line.W[k])
            if k == line.jump_node:
                x += jump
            if sample >= 0:
                outputs[sample] = [float(y.mid()) for y in (C * x + direct * w).entries()]
            if k < len(line.which):
                free, driven = steps[line.which[k]]
                x = (free * x + driven * w).mid()
    return outputs


def _column(values: Array) -> Any:
    from flint import arb_mat

    return arb_mat(len(values), 1, values.tolist())
