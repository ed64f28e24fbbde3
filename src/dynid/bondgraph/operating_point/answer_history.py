"""Earlier answers of delayed controllers as polynomials (method of steps; Bellman & Cooke 1963, 3.3)."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Sequence

import numpy as np
from numpy.polynomial import chebyshev

from dynid.arrays import Array
from dynid.errors import NumericalError

#: Degree of the polynomials, and how many of their last coefficients estimate what is left out.
_DEGREE, _TAIL = 14, 3
#: Ratio of what is left out to that before a halving, above which it is the rounding of the integration.
_ROUNDING_RATIO = 0.6
#: Most intervals between instants at which jumps arrive, and the part of the time below which these are one.
_MAX_INTERVALS, _SAME_RTOL = 5000, 1e-13
#: Part of the way to the middle of an interval by which an instant belongs to it.
_INWARD = 1e-9


class History:
    """The courses of some answers from t = 0 on; before they are zero."""

    def __init__(self, count: int) -> None:
        self._count = count
        self._starts: list[float] = []
        self._courses: list[tuple[float, float, Array]] = []  # start, stop, coefficients by answer
        self._size = np.zeros(count)

    def add(self, start: float, stop: float, course: Callable[[float], Array], rtol: float) -> None:
        """Add the courses over an interval in which they are smooth, halved until polynomials follow them."""
        nodes = np.cos(np.pi * (np.arange(_DEGREE + 1) + 0.5) / (_DEGREE + 1))
        parts = [(start, stop, np.inf)]
        while parts:
            low, high, left_out = parts.pop()
            values = np.array([course(0.5 * (low + high) + 0.5 * (high - low) * node) for node in nodes])
            coefficients = chebyshev.chebfit(nodes, values, _DEGREE).reshape(_DEGREE + 1, self._count)
            self._size = np.maximum(self._size, np.abs(values).max(axis=0))
            tails = np.abs(coefficients[-_TAIL:]).max(axis=0)
            tail = float((tails / np.where(self._size > 0, self._size, 1.0)).max())
            if rtol < tail < _ROUNDING_RATIO * left_out:
                middle = 0.5 * (low + high)
                parts += [(middle, high, tail), (low, middle, tail)]
                continue
            self._starts.append(low)
            self._courses.append((low, high, coefficients))

    def at(self, index: int, t: float, inside: float) -> float:
        """Return an answer at a time; of a jump there the value on the side of a time `inside`."""
        position = bisect_right(self._starts, t + _INWARD * (inside - t)) - 1
        if position < 0:
            return 0.0
        low, high, coefficients = self._courses[position]
        return float(chebyshev.chebval((2 * t - low - high) / (high - low), coefficients[:, index]))


def delayed_borders(instants: Sequence[float], delays: Sequence[float], stop: float) -> list[float]:
    """Return instants, and those at which what happens there arrives, no further apart than a delay.

    Raises `NumericalError` where they are too many.
    """
    same, borders, front = _SAME_RTOL * stop, set(instants), set(instants)
    while front:
        front = {at + delay for at in front for delay in delays if at + delay < stop}
        front = {round(at / same) * same for at in front} - borders
        borders |= front
        if len(borders) > _MAX_INTERVALS:
            raise NumericalError(f"the delays lead to more than {_MAX_INTERVALS:,} instants of jumps")
    ordered = [at for at in sorted(borders) if at <= stop]
    kept = [ordered[0]]
    for at in ordered[1:]:
        if at - kept[-1] > 10 * same:
            pieces = int(np.ceil((at - kept[-1]) / min(delays) * (1 - _INWARD)))
            kept += np.linspace(kept[-1], at, pieces + 1)[1:].tolist()
    kept[-1] = stop
    return kept
