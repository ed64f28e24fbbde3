"""Time responses whose digits are checked, and found in more bits where doubles lose them.

An output may be a small difference of large states (values in SI units lie up to 24 orders of magnitude
apart), and no step size shows it. So a thinned response is repeated with every coefficient moved by one
rounding. What moves by that is known no better, and is found again from the coefficients as they are.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dynid.errors import NumericalError
from dynid.lti.generator import Signal
from dynid.lti.model import StateSpace
from dynid.lti.propagate import Response, response
from dynid.lti.signals import Random
from dynid.lti.timeline import Timeline, timeline

Array = NDArray[np.float64]

#: Part of its largest value that an output may move by, and from which on it is refused.
_TRUSTED, _REFUSED = 1e-10, 1e-3
#: Instants of the repetition.
_CHECKED = 100
#: Products that propagating in more bits may take (seconds), what a step costs beside its own, and doublings.
_MOST_PRODUCTS, _STEP, _DOUBLINGS = 10_000_000, 100, 4


@dataclass(frozen=True, eq=False)
class Rational:
    """What a `StateSpace` rounds: matrices over the rationals (flint `fmpq_mat`).

    Parameters
    ----------
    A, B, C
        As of `StateSpace`.
    feedthrough
        D and the higher feedthrough matrices.
    """

    A: Any
    B: Any
    C: Any
    feedthrough: tuple[Any, ...]


def settled_response(
    system: StateSpace, signals: Sequence[Signal], times: ArrayLike, rational: Callable[[], Rational]
) -> tuple[Response, float]:
    """Propagate a system as `response` does, and settle what rounding leaves open of its outputs.

    Parameters
    ----------
    system, signals, times
        As of `response`.
    rational
        Gives the exact matrices; only asked where they are needed.

    Returns
    -------
    Response
        The response.
    float
        The part of its largest value by which an output may be off; 0 where that is nothing to speak of.

    Raises
    ------
    NumericalError
        As of `response`, and where an output drowns in rounding.
    """
    t = np.asarray(times, dtype=float)
    found = response(system, signals, t)
    doubt = _doubt(found, system, signals, t)
    if doubt.max(initial=0.0) <= _TRUSTED:
        return found, 0.0
    line = (
        None
        if any(isinstance(signal, Random) for signal in signals)
        else timeline(signals, t, min(0.0, float(t[0])))
    )
    size = len(system.A) + len(system.C) + (0 if line is None else len(line.G))
    if line is not None and len(line.nodes) * (_STEP + size**2) <= _MOST_PRODUCTS:
        outputs = _settled(rational(), line)
        if outputs is not None:
            return found._replace(outputs=outputs), 0.0
    worst = int(doubt.argmax())
    if doubt[worst] > _REFUSED:
        raise NumericalError(
            f"the time response of '{system.outputs[worst]}' drowns in rounding: it is the small difference "
            "of large states",
            remedy="Ask for fewer instants, or bring the values nearer to each other.",
        )
    return found, float(doubt[worst])


def _doubt(found: Response, system: StateSpace, signals: Sequence[Signal], t: Array) -> Array:
    """Return by what part of its largest value each output moves with the last digits of all coefficients."""
    some = slice(None, None, math.ceil(len(t) / _CHECKED))  # evenly: one exponential where the times are even
    rng = np.random.default_rng(0)

    def nudged(matrix: Array) -> Array:
        return matrix * (1 + np.finfo(float).eps * rng.choice([-1.0, 1.0], matrix.shape))

    moved = replace(
        system,
        A=nudged(system.A),
        B=nudged(system.B),
        C=nudged(system.C),
        D=nudged(system.D),
        higher=tuple(nudged(matrix) for matrix in system.higher),
    )
    try:
        again = response(moved, signals, t[some], start=min(0.0, float(t[0]))).outputs
    except NumericalError:  # on the edge of what overflows
        return np.zeros(len(system.C))
    difference = np.abs(again - found.outputs[some]).max(axis=0, initial=0.0)
    largest = np.abs(found.outputs).max(axis=0, initial=0.0)
    lost = np.where(difference > 0, np.inf, 0.0)
    return np.asarray(np.divide(difference, largest, out=lost, where=largest > 0))


def _settled(exact: Rational, line: Timeline) -> Array | None:
    """Return the outputs as soon as twice as many bits do not change them any more; None: they always do."""
    from flint import arb_mat

    sizes = [float(abs(entry).upper()) for entry in arb_mat(exact.A).entries()]
    bits = 128 + 4 * math.ceil(math.log2(1.0 + sum(sizes) * float(line.lengths.max(initial=0.0))))
    before = _outputs(exact, line, bits)
    for _ in range(_DOUBLINGS):
        bits *= 2
        after = _outputs(exact, line, bits)
        largest = np.abs(after).max(axis=0, initial=0.0)
        if np.all(np.abs(after - before) <= 4 * np.finfo(float).eps * largest):
            return after
        before = after
    return None


def _outputs(exact: Rational, line: Timeline, bits: int) -> Array:
    """Propagate in so many bits."""
    from flint import arb_mat, ctx

    with ctx.workprec(bits):
        B, C, H, G = (arb_mat(part) for part in (exact.B, exact.C, line.H.tolist(), line.G.tolist()))
        steps = _steps(arb_mat(exact.A), B * H, G, line.lengths)
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


def _steps(A: Any, drive: Any, G: Any, lengths: Array) -> list[tuple[Any, Any]]:
    """Return what states and generator states make of the states in each length of time."""
    from flint import arb, arb_mat

    n, none = A.nrows(), [arb(0)] * A.nrows()
    rows = [[*own, *driven] for own, driven in zip(A.tolist(), drive.tolist(), strict=True)]
    joint = arb_mat([*rows, *([*none, *row] for row in G.tolist())])
    exponentials = [(joint * arb(float(length))).exp().mid().tolist()[:n] for length in lengths]
    return [(arb_mat([row[:n] for row in E]), arb_mat([row[n:] for row in E])) for E in exponentials]


def _column(values: Array) -> Any:
    from flint import arb_mat

    return arb_mat(len(values), 1, values.tolist())
