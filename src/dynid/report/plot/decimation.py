"""Decimation of polylines to the points that a picture can show."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: Greatest distance from the line between its neighbours, px, at which a point is dropped.
NEAR = 0.08


def runs(x: Floats, y: Floats) -> Iterator[tuple[Floats, Floats]]:
    """Yield the runs of finite points of a line."""
    known = np.isfinite(x) & np.isfinite(y)
    edges = np.flatnonzero(np.diff(known.astype(np.int8), prepend=0, append=0))
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        yield x[start:stop], y[start:stop]


def by_column(x: Floats, y: Floats) -> NDArray[np.intp]:
    """Return the indices of the first, lowest, highest and last point of each pixel column.

    Parameters
    ----------
    x, y
        Positions in px, x not decreasing.

    Notes
    -----
    The picture stays the same to the pixel (M4, Jugel et al. 2014).
    """
    columns = np.floor(x).astype(np.int64)
    starts = np.flatnonzero(np.diff(columns, prepend=columns[0] - 1))
    if 4 * len(starts) >= len(x):
        return np.arange(len(x))
    stops = np.append(starts[1:], len(x))
    owner = np.repeat(np.arange(len(starts)), stops - starts)
    kept = np.zeros(len(x), dtype=bool)
    kept[starts] = kept[stops - 1] = True
    for extreme in (np.minimum, np.maximum):
        hits = np.flatnonzero(y == extreme.reduceat(y, starts)[owner])
        kept[hits[_firsts(owner[hits])]] = True
    return np.flatnonzero(kept)


def _firsts(ascending: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return the index of the first occurrence of each value of an ascending array."""
    return np.flatnonzero(np.diff(ascending, prepend=ascending[:1] - 1))


def straightened(x: Floats, y: Floats, near: float = NEAR) -> NDArray[np.intp]:
    """Return the indices of the points that remain when those on straight stretches are dropped.

    Extremes of y and the ends always remain; no dropped point is further than `near` from the line.
    """
    count = len(x)
    if count < 3:
        return np.arange(count)
    # The directions from a point that remains within `near` of all later points form a cone.
    kept, xs, ys = [0], x.tolist(), y.tolist()
    at_x, at_y, before = xs[0], ys[0], ys[0]
    low, high = -math.inf, math.inf
    for place in range(1, count - 1):
        here, after = ys[place], ys[place + 1]
        dx, dy, ahead = xs[place] - at_x, here - at_y, xs[place + 1] - at_x
        if dx > 0:
            low = max(low, (dy - near) / dx)
            high = min(high, (dy + near) / dx)
        turns = dy != 0 and (here - before) * (after - here) <= 0
        slope = (after - at_y) / ahead if ahead > 0 else math.inf
        if turns or dx <= 0 or not low <= slope <= high:
            kept.append(place)
            at_x, at_y, low, high = xs[place], here, -math.inf, math.inf
        before = here
    return np.array([*kept, count - 1])


def decimated(x: Floats, y: Floats, near: float = NEAR) -> tuple[Floats, Floats]:
    """Return the decimated points of a line, px; one that goes back in x keeps a point every 0.5 px."""
    if len(x) > 2 and np.all(np.diff(x) >= 0):
        kept = by_column(x, y)
        x, y = x[kept], y[kept]
        kept = straightened(x, y, near)
        return x[kept], y[kept]
    moved = np.hypot(np.diff(x), np.diff(y))
    place = np.floor(np.concatenate([[0.0], np.cumsum(moved)]) / 0.5).astype(np.int64)
    kept = _firsts(place)
    if kept[-1] != len(x) - 1:
        kept = np.append(kept, len(x) - 1)
    return x[kept], y[kept]
