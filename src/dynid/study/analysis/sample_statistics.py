"""Statistics of the samples of a study: moments, quantiles and the worst sample.

`study/statistics/<path>/<name>` in the file of a study holds them. They are computed from the file when all
samples are in it, one array at a time, and depend on the samples only, not on how the study was run.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array
from dynid.result import Result, coordinate_path
from dynid.study.analysis.table import RESULTS, STATISTICS, StudyTable, as_numbers

#: Fraction of the ordered samples below each quantile.
QUANTILES = {"min": 0.0, "p05": 0.05, "median": 0.5, "p95": 0.95, "max": 1.0}
#: Names of the statistics, in the order of a table.
NAMES = ("mean", "std", *QUANTILES, "count")

Direction = Literal["max", "min", "abs"]

_BLOCK_VALUES = 2**20  # values at a time, of which some eight arrays are in memory


def statistics(values: Array) -> dict[str, Array | NDArray[np.int64]]:
    """Return moments and quantiles of each entry over the samples, the first axis, by `NAMES`.

    NaN is a sample without a value. Standard deviations are with n - 1, quantiles linearly interpolated. NaN
    is undefined: all but the count of no sample, the deviation of one, moments of infinite values.
    """
    # Ordered and contiguous, so that sums do not depend on the memory layout.
    ordered = np.sort(np.ascontiguousarray(np.moveaxis(values, 0, -1)), axis=-1)  # NaN last
    count = ordered.shape[-1] - np.isnan(ordered).sum(axis=-1)
    # Moments about the median, so that equal values have no deviation at all.
    centre = quantile(ordered, count, 0.5)
    centre = np.where(np.isfinite(centre), centre, 0.0)
    defined = ~np.isnan(ordered)
    with np.errstate(all="ignore"):
        shifted = ordered - centre[..., None]
        offset = _sum(shifted, defined) / count
        shifted -= offset[..., None]
        spread = _sum(np.square(shifted, out=shifted), defined)
        std = np.sqrt(spread / np.where(count > 1, count - 1, np.nan))
    mean = np.where(count > 0, centre + offset, np.nan)
    quantiles = {name: quantile(ordered, count, share) for name, share in QUANTILES.items()}
    return {"mean": mean, "std": std, **quantiles, "count": count.astype(np.int64)}


def quantile(ordered: Array, count: NDArray[np.int64], share: float) -> Array:
    """Return a quantile of the first `count` of ordered values along the last axis."""
    if not ordered.shape[-1]:
        return np.full(count.shape, np.nan)
    position = share * np.maximum(count - 1, 0)
    below = np.floor(position).astype(np.int64)
    above = np.minimum(below + 1, np.maximum(count - 1, 0))
    low, high = (np.take_along_axis(ordered, at[..., None], axis=-1)[..., 0] for at in (below, above))
    with np.errstate(invalid="ignore"):
        between = low + (position - below) * (high - low)
    return np.where((low == high) | (position == below), low, between)


def _sum(values: Array, defined: NDArray[np.bool_]) -> Array:
    return np.asarray(np.sum(values, axis=-1, where=defined))


def worst(values: Array, direction: Direction = "max") -> int | None:
    """Return the index of the worst value: the largest, the smallest, or the largest magnitude.

    The first of equal ones; None if all are NaN.
    """
    judged = _judged(values, direction)
    return int(np.argmax(judged)) if not np.isnan(values).all() else None


def worst_entries(values: Array, direction: Direction = "max") -> Array:
    """Return the worst value of each row; NaN for a row without values."""
    if not values.shape[1]:
        return np.full(len(values), np.nan)
    places = np.argmax(_judged(values, direction), axis=1)
    return np.take_along_axis(values, places[:, None], axis=1)[:, 0]


def _judged(values: Array, direction: Direction) -> Array:
    """Return values whose largest is the worst; missing ones are -inf."""
    judged = {"max": values, "min": -values, "abs": np.abs(values)}[direction]
    defined = ~np.isnan(judged)
    return np.where(defined, np.maximum(judged, -np.finfo(float).max), -np.inf)


def declare(result: Result) -> None:
    """Add the arrays of all statistics to a study whose results are declared; `computed` gives their values.

    Statistics of complex numbers are those of the magnitude; they have the attribute `of`.
    """
    table = StudyTable(result, stored=True)
    for path in filter(table.is_number, table.paths):
        variable = table.variable(path)
        dims, shape = variable.dims[1:], variable.shape[1:]
        for dim in dict.fromkeys(dims):  # the coordinates, so that the group is complete in itself
            coordinate = None if dim in NAMES else coordinate_path(result, f"{RESULTS}/{path}", dim)
            if coordinate is not None:
                result.put(f"{STATISTICS}/{path}/{dim}", result[coordinate])
        attrs = {"of": "magnitude"} if variable.dtype.kind == "c" else {}
        for name in NAMES:
            values = np.zeros(shape, np.int64 if name == "count" else np.float64)
            units = "" if name == "count" else variable.units
            result.add(f"{STATISTICS}/{path}/{name}", values, dims, units, **attrs)


def computed(result: Result) -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield path and values of all statistics of a study, from as many values at a time as memory allows."""
    table = StudyTable(result, stored=True)
    for path in filter(table.is_number, table.paths):
        variable = table.variable(path)
        samples, *entries = variable.shape
        if not entries or not math.prod(entries):
            parts = [statistics(as_numbers(variable.data))]
        else:
            step = max(1, _BLOCK_VALUES // max(1, samples * math.prod(entries[1:])))
            parts = [
                statistics(as_numbers(variable.entries(start, start + step)))
                for start in range(0, entries[0], step)
            ]
        for name in NAMES:
            values = parts[0][name] if len(parts) == 1 else np.concatenate([block[name] for block in parts])
            yield f"{STATISTICS}/{path}/{name}", values
