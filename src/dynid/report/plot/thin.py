"""Lines with no more points than a picture can show."""

from __future__ import annotations

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
    lengths = stops - starts
    owner = np.repeat(np.arange(len(starts)), lengths)
    lowest, highest = np.minimum.reduceat(y, starts), np.maximum.reduceat(y, starts)
    kept = [starts, stops - 1]
    for extreme in (lowest, highest):
        hits = np.flatnonzero(y == extreme[owner])
        kept.append(hits[np.unique(owner[hits], return_index=True)[1]])
    return np.unique(np.concatenate(kept))


def straightened(x: Floats, y: Floats, near: float = NEAR) -> NDArray[np.intp]:
    """Return which points of a line to keep: without those on the line between their neighbours.

    Points where y turns, and the ends, are always kept; no other is further than `near` from the line.
    """
    count = len(x)
    if count < 3:
        return np.arange(count)
    # From a point that is kept, the directions that pass all later ones closely enough are a cone.
    kept, at = [0], 0
    xs, ys = x.tolist(), y.tolist()
    low, high = -np.inf, np.inf
    for place in range(1, count - 1):
        dx, dy = xs[place] - xs[at], ys[place] - ys[at]
        turns = (ys[place] - ys[place - 1]) * (ys[place + 1] - ys[place]) <= 0 and ys[place] != ys[at]
        if dx > 0:
            low, high = max(low, (dy - near) / dx), min(high, (dy + near) / dx)
        ahead = xs[place + 1] - xs[at]
        slope = (ys[place + 1] - ys[at]) / ahead if ahead > 0 else np.inf
        if turns or dx <= 0 or not low <= slope <= high:
            kept.append(place)
            at, low, high = place, -np.inf, np.inf
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
    kept = np.unique(np.concatenate([np.unique(place, return_index=True)[1], [len(x) - 1]]))
    return x[kept], y[kept]
