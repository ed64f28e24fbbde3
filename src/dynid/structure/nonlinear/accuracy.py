"""The steps of a march: halved until the error of the motion is small."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from dynid.arrays import Array
from dynid.errors import NumericalError
from dynid.lti.time_response import Timeline
from dynid.structure.law import BoundLaw
from dynid.structure.nonlinear.march import march
from dynid.structure.nonlinear.tables import LinearRest, Motion, Refine, Regimes, Steps

# Change of a motion, relative to its largest, when its steps are halved: the error of the finer one is some
# hundred times smaller, by the order 8 of the steps.
_COARSE_TOL = 1e-7
# Estimated error of a motion, relative to its largest state, of laws without regimes. States are balanced by
# the fastest mode: velocities of slow ones on a stiff beam are some fifty times less accurate.
_ERROR_TOL = 2e-8
# Steps between two samples beyond which a motion is refused: chaotic ones never settle.
_MAX_PARTS = 64


class Accuracy(NamedTuple):
    """What was needed for a motion: parts of each interval, and its error.

    That is the largest change by halving the steps; of laws without regimes an estimate from a single motion.
    """

    parts: int
    error: float
    enough: int  # fewest parts of which the error was found to be small


def accurate_march(
    rest: LinearRest,
    laws: Sequence[BoundLaw],
    line: Timeline,
    x0: Array,
    z0: Array,
    *,
    added: Callable[[Array], Array] | None = None,
    impulse: Array | None = None,
    parts: int = 1,
) -> tuple[Motion, Accuracy]:
    """March with steps that are halved until the error of the motion is small.

    `line`: intervals between the times asked for; `added`: what is added to its loads at times; `impulse`:
    jump of the state at its jump node; `parts`: of each interval to begin with. The states are to be
    balanced: changes are relative to the largest one.

    Raises NumericalError if the steps would become too short.
    """
    coarse: Motion | None = None
    kept = Regimes(rest, laws)
    smooth = all(not law.guards(law.regime(0.0, 0.0, 0.0), 0.0, 0.0, 0.0) for law in laws)
    while parts <= _MAX_PARTS:
        steps = Steps.of(line, parts, added)
        at = None if impulse is None else (line.jump_node * parts, impulse)
        motion: Motion | None = None
        with suppress(Refine):
            motion = march(rest, laws, steps, x0, z0, impulse=at, kept=kept)
        if motion is None:
            coarse, parts = None, 2 * parts
            continue
        size = np.abs(motion.states).max(initial=0.0) or 1.0
        if smooth:
            error = motion.local_error / float(size)
            if error <= _ERROR_TOL:
                return motion, Accuracy(parts, error, parts)
        if coarse is not None:
            error = float(np.abs(motion.states - coarse.states).max(initial=0.0) / size)
            if error <= _COARSE_TOL:
                return motion, Accuracy(parts, error, parts // 2)
        coarse, parts = motion, 2 * parts
    raise NumericalError(
        f"the motion still changes with {_MAX_PARTS} steps between two samples",
        remedy="Shorten the time between samples, or soften contacts and sliders: the motion may be chaotic, "
        "or change between contacts faster than can be followed.",
    )
