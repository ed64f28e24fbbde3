"""Lines with no more points than a picture can show."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: How far, px, a point may be off the line between its neighbours to be left out.
NEAR = 0.08


def runs(x: Floats, y: Floats) -> Iterator[tuple[Floats, Floats]]:
    """Yield the stretches of a line between values that are not finite."""
    known = np.isfinite(x) & np.isfinite(y)
    edges = np.flatnonzero(np.diff(known.astype(np.int8), prepend=0, append=0))
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        yield x[start:stop], y[start:stop]


def by_column(x: Floats, y: Floats) -> NDArray[np.intp]:
    """Return which points of a line to keep: of each pixel column the first, lowest, highest and last.

    Parameters
    ----------
    x, y
        Places in px, x not decreasing.

    Notes
    -----
    What is drawn is the same to the pixel (M4, Jugel et al. 2014).
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
    """Return where each value of an ascending array first stands."""
    return np.flatnonzero(np.diff(ascending, prepend=ascending[:1] - 1))


def straightened(x: Floats, y: Floats, near: float = NEAR) -> NDArray[np.intp]:
    """Return which points of a line to keep: without those on the line between their neighbours.

    Points where y turns, and the ends, are always kept; no other is further than `near` from the line.
    """
    count = len(x)
    if count < 3:
        return np.arange(count)
    # From a point that is kept, the directions that pass all later ones closely enough are a cone.
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


def thin(x: Floats, y: Floats, near: float = NEAR) -> tuple[Floats, Floats]:
    """Return a line, px, with the points that show; one that goes to and fro keeps its turns."""
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
