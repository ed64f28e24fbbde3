"""The worst sample."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

Direction = Literal["max", "min", "abs"]


def worst(values: NDArray[np.float64], direction: Direction = "max") -> int | None:
    """Return the place of the worst value: the largest, the smallest, or the one farthest from 0.

    The first of several; None where all are NaN.
    """
    judged = {"max": values, "min": -values, "abs": np.abs(values)}[direction]
    known = ~np.isnan(judged)
    return int(np.argmax(np.where(known, judged, -np.inf))) if known.any() else None
