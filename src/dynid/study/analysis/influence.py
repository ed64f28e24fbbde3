"""Shares of a result's variance by input: Sobol indices, with their standard errors.

Two ways: from Saltelli's design, first and total order; from any samples with independent inputs, first
order only. Both are ratios of means, whose errors are those of the ratios' linearisation (the delta
method), so that 100,000 samples cost no resampling.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.study.analysis.design import sortable

Floats = NDArray[np.float64]

_MOST_BINS = 50
_FEWEST_A_BIN = 10


@dataclass(frozen=True)
class Indices:
    """Sobol indices of one result.

    Parameters
    ----------
    first
        Which part of the variance each input explains alone, shape (inputs,).
    first_error
        Its standard error.
    total, total_error
        Which part is left as long as only this input is unknown: alone and together with others. None where
        the samples do not tell.
    estimator
        How they were found, in words.
    samples
        How many samples they rest on.
    """

    first: Floats
    first_error: Floats
    total: Floats | None
    total_error: Floats | None
    estimator: str
    samples: int


def from_design(a: Floats, b: Floats, mixed: Floats) -> Indices | None:
    """Return the indices from Saltelli's design.

    Parameters
    ----------
    a, b
        The result at the two independent sets of samples A and B, shape (n,).
    mixed
        The result at A with one input's column of B, shape (inputs, n).

    Returns
    -------
    Indices or None
        None where fewer than two rows are complete, or the result does not vary.

    Notes
    -----
    First order: Saltelli et al. 2010, Computer Physics Communications 181, Table 2 (b); total order: Jansen
    1999 (f there); of centred values. A row with a sample that failed is left out whole.
    """
    complete = np.isfinite(a) & np.isfinite(b) & np.isfinite(mixed).all(axis=0)
    a, b, mixed = a[complete], b[complete], mixed[:, complete]
    n = a.size
    if n < 2:
        return None
    # A shift of every value changes no index, but the rounding and the error of each.
    mean = (a.mean() + b.mean()) / 2
    a, b, mixed = a - mean, b - mean, mixed - mean
    power = (a * a + b * b) / 2
    variance = power.mean()
    if not _varies(variance, mean):
        return None
    first, first_error = _ratio(b * (mixed - a), power, variance)
    total, total_error = _ratio((a - mixed) ** 2 / 2, power, variance)
    words = f"Saltelli's design, {n} rows (Saltelli 2010, Jansen 1999)"
    return Indices(first, first_error, total, total_error, words, n * (len(mixed) + 2))


def from_samples(inputs: Sequence[NDArray[np.intp]], values: Floats) -> Indices | None:
    """Return the first-order indices from any samples whose inputs are independent of each other.

    Parameters
    ----------
    inputs
        For each input the samples' `classes`.
    values
        The result, NaN where there is none.

    Returns
    -------
    Indices or None
        None where there are too few samples, or the result does not vary.

    Notes
    -----
    The correlation ratio: the part of the variance that is left within an input's classes is what it does
    not explain. With the correction for the number of classes (Kelley 1935), an input without influence has
    0 on average.
    """
    known = np.isfinite(values)
    y = values[known]
    n = y.size
    if n < 2 * _FEWEST_A_BIN:
        return None
    y = y - y.mean()
    variance = float(y @ y) / n
    if not _varies(variance, float(values[known].mean())):
        return None
    found = [_correlation_ratio(own[known], y, variance) for own in inputs]
    first, error = (np.array(part, dtype=float) for part in zip(*found, strict=True))
    words = f"correlation ratio of {n} samples, first order only"
    return Indices(first, error, None, None, words, n)


def classes(x: NDArray[Any]) -> NDArray[np.intp]:
    """Return the class of each sample: its level where there are few, else one of equally full ranges.

    Parameters
    ----------
    x
        An input's numbers or texts, shape (samples,).
    """
    levels, found = np.unique(sortable(x), return_inverse=True)
    most = int(np.clip(len(x) // _FEWEST_A_BIN, 2, _MOST_BINS))
    if len(levels) <= min(_MOST_BINS, len(x) // 2) or levels.dtype.kind == "U":
        return np.asarray(found)
    ordered = np.sort(x)
    edges = np.unique(ordered[len(x) * np.arange(1, most) // most])
    return np.searchsorted(edges, x, side="right")


def _varies(variance: float, mean: float) -> bool:
    """Tell a variance from the rounding of values that are all the same."""
    return bool(variance > (4 * np.finfo(float).eps * abs(mean)) ** 2)


def _ratio(part: Floats, power: Floats, variance: float) -> tuple[Floats, Floats]:
    """Return mean(part) / mean(power) for each row, and its standard error."""
    share = part.mean(axis=-1) / variance
    slope = (part - share[:, None] * power) / variance
    return share, slope.std(axis=-1, ddof=1) / np.sqrt(part.shape[-1])


def _correlation_ratio(own: NDArray[np.intp], y: Floats, variance: float) -> tuple[float, float]:
    counts = np.bincount(own)
    used = int((counts > 0).sum())
    n = len(y)
    if used < 2 or used >= n:
        return (0.0, 0.0) if used < 2 else (np.nan, np.nan)
    means = np.bincount(own, weights=y) / np.maximum(counts, 1)
    left = np.square(y - means[own])
    unexplained = left.mean() / variance
    error = float(np.std(left - unexplained * y * y) / variance / np.sqrt(n))
    return 1 - unexplained * (n - 1) / (n - used), error
