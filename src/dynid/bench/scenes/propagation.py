"""Ways to propagate a time response: signals in closed form, or by samples and a hold, at several steps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.bench.alternative import Alternative
from dynid.bench.scenes.aspect import Aspect
from dynid.lti.polynomials import HOLDS
from dynid.lti.sampled import Sampled

#: Samples of a hold for every instant that is asked for, and the most in all.
_FINER, _MOST = (1, 2, 4), 1_000_000

Work = Callable[[list[Any]], Callable[[], Any]]


def propagation(work: Work, signals: Sequence[Any], times: NDArray[np.float64]) -> Aspect:
    """Return the ways to propagate a response.

    Parameters
    ----------
    work
        Given signals: what computes the response (times x outputs) to them.
    signals
        The signals of the scene. An impulse has no samples and stays as it is.
    times
        The instants, evenly from 0 on.
    """
    count = len(times)

    def held(hold: str) -> Callable[[int], Callable[[], Any]]:
        def prepare(samples: int) -> Callable[[], Any]:
            # One sample beyond the last instant: a zero hold ends before its last sample.
            finer = np.linspace(0.0, times[-1], samples)
            step = times[-1] / (samples - 1)
            return work([each if each.jump else Sampled(each.value(finer), step, hold) for each in signals])

        return prepare

    sizes = [k * (count - 1) + 1 for k in _FINER if k * count <= _MOST] or [count]
    exact = Alternative("exact", lambda _: work(list(signals)))
    points = [(exact, count), *((Alternative(hold, held(hold)), size) for hold in HOLDS for size in sizes)]
    return Aspect(
        title="what drives the time response between its samples",
        size="samples",
        points=points,
        chosen=frozenset({("exact", count)}),
        because="named signals are known in closed form, samples go on by their own hold: propagated exactly",
        error=_error,
        measure="RMS of the error over that of the exact response",
    )


def _error(found: Any, reference: Any) -> float:
    size = float(np.sqrt(np.mean(reference**2)))
    return float(np.sqrt(np.mean((found - reference) ** 2))) / (size if size > 0 else 1.0)
