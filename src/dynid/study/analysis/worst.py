"""The worst sample."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Direction = Literal["max", "min", "abs"]


def worst(values: Floats, direction: Direction = "max") -> int | None:
    """Return the place of the worst value: the largest, the smallest, or the one farthest from 0.

    The first of several; None where all are NaN.
    """
    judged = _judged(values, direction)
    return int(np.argmax(judged)) if not np.isnan(values).all() else None


def worst_entries(values: Floats, direction: Direction = "max") -> Floats:
    """Return the worst value of each row; NaN where a row has none."""
    if not values.shape[1]:
        return np.full(len(values), np.nan)
    places = np.argmax(_judged(values, direction), axis=1)
    return np.take_along_axis(values, places[:, None], axis=1)[:, 0]


def _judged(values: Floats, direction: Direction) -> Floats:
    """Return values of which the largest is the worst; what is missing is never it."""
    judged = {"max": values, "min": -values, "abs": np.abs(values)}[direction]
    known = ~np.isnan(judged)
    return np.where(known, np.maximum(judged, -np.finfo(float).max), -np.inf)
