"""Moments and quantiles over samples, some of which may have failed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: Fraction of the ordered samples below each quantile.
QUANTILES = {"min": 0.0, "p05": 0.05, "median": 0.5, "p95": 0.95, "max": 1.0}
#: Names of the statistics, in the order of a table.
NAMES = ("mean", "std", *QUANTILES, "count")

Floats = NDArray[np.float64]


def statistics(values: Floats) -> dict[str, Floats | NDArray[np.int64]]:
    """Return moments and quantiles of each entry over the samples.

    Parameters
    ----------
    values
        Samples first, then any axes; NaN where a sample has no value.

    Returns
    -------
    dict
        By `NAMES`, each with the axes of one sample: mean, standard deviation (with n - 1), minimum, the
        quantiles 5 %, 50 % and 95 % (linear between neighbours), maximum, and how many values there are.
        NaN is what has no value: all but the count of no sample, the deviation of one, moments where
        values are infinite.
    """
    # Each entry's samples side by side and in order: neither sums nor quantiles depend on the layout.
    ordered = np.sort(np.ascontiguousarray(np.moveaxis(values, 0, -1)), axis=-1)  # NaN last
    count = ordered.shape[-1] - np.isnan(ordered).sum(axis=-1)
    mean, std = _moments(ordered, count)
    quantiles = {name: quantile(ordered, count, share) for name, share in QUANTILES.items()}
    return {"mean": mean, "std": std, **quantiles, "count": count.astype(np.int64)}


def quantile(ordered: Floats, count: NDArray[np.int64], share: float) -> Floats:
    """Return a quantile of ordered values (last axis), of which the first `count` count."""
    if not ordered.shape[-1]:
        return np.full(count.shape, np.nan)
    place = share * np.maximum(count - 1, 0)
    below = np.floor(place).astype(np.int64)
    above = np.minimum(below + 1, np.maximum(count - 1, 0))
    low, high = (np.take_along_axis(ordered, at[..., None], axis=-1)[..., 0] for at in (below, above))
    with np.errstate(invalid="ignore"):
        between = low + (place - below) * (high - low)
    return np.where((low == high) | (place == below), low, between)


def _moments(ordered: Floats, count: NDArray[np.int64]) -> tuple[Floats, Floats]:
    # About a value in the middle, so that what does not vary has no deviation at all.
    centre = quantile(ordered, count, 0.5)[..., None]
    known = ~np.isnan(ordered)
    with np.errstate(all="ignore"):
        shifted = ordered - np.where(np.isfinite(centre), centre, 0.0)
        offset = _sum(shifted, known) / count
        mean = np.where(np.isfinite(centre[..., 0]), centre[..., 0], 0.0) + offset
        spread = _sum(np.square(shifted - offset[..., None]), known)
        std = np.sqrt(spread / np.where(count > 1, count - 1, np.nan))
    return np.where(count > 0, mean, np.nan), std


def _sum(values: Floats, known: NDArray[np.bool_]) -> Floats:
    return np.asarray(np.sum(values, axis=-1, where=known))
