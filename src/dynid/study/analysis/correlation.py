"""Pairwise correlation of inputs and results."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def correlations(
    inputs: Sequence[Floats], results: Sequence[Floats], ranks: bool = False
) -> NDArray[np.float64]:
    """Return the correlation of each input with each result.

    Parameters
    ----------
    inputs, results
        Samples, NaN where there is none; a pair counts where both have a value.
    ranks
        Correlate the ranks (Spearman): what tells a monotone relation, however bent.

    Returns
    -------
    ndarray
        Inputs × results; NaN where one of them does not vary.
    """
    return np.array([[_correlation(x, y, ranks) for y in results] for x in inputs]).reshape(
        len(inputs), len(results)
    )


def _correlation(x: Floats, y: Floats, ranks: bool) -> float:
    known = np.isfinite(x) & np.isfinite(y)
    if known.sum() < 2:
        return float("nan")
    pair = [_ranks(values[known]) if ranks else values[known] for values in (x, y)]
    if any(values.min() == values.max() for values in pair):
        return float("nan")
    a, b = (values - values.mean() for values in pair)
    return float(np.clip((a / np.linalg.norm(a)) @ (b / np.linalg.norm(b)), -1, 1))


def _ranks(values: Floats) -> Floats:
    """Return ranks, the mean of them where values are the same."""
    _, place, counts = np.unique(values, return_inverse=True, return_counts=True)
    last = np.cumsum(counts)
    return (last - (counts - 1) / 2)[place]


def scatter(x: Floats, y: Floats, most: int = 5000) -> tuple[Floats, Floats]:
    """Return the pairs of a scatter diagram, evenly thinned out to `most` at most, in plan order."""
    known = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    if len(known) > most:
        known = known[np.linspace(0, len(known) - 1, most).astype(np.int64)]
    return x[known], y[known]
