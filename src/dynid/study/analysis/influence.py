"""Influence of the inputs on a result: Sobol indices with standard errors, and correlations.

Sobol indices come from Saltelli's design (first and total order), or from any samples with independent
inputs (first order only). Both are ratios of means; their standard errors are those of the linearized ratios
(the delta method), without resampling.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array
from dynid.study.analysis.design import SaltelliDesign, saltelli_design, sortable
from dynid.study.analysis.table import StudyTable

_MAX_BINS = 50
_MIN_BIN_SAMPLES = 10


@dataclass(frozen=True)
class Indices:
    """Sobol indices of one result with standard errors (one per input), and the samples used.

    `first` is the share of the variance that each input explains alone, `total` alone and by interactions;
    None if it cannot be estimated from the samples.
    """

    first: Array
    first_error: Array
    total: Array | None
    total_error: Array | None
    estimator: str
    samples: int


def from_design(a: Array, b: Array, mixed: Array) -> Indices | None:
    """Return the indices from Saltelli's design.

    `a` and `b` (n) are the result at the two independent sets of samples A and B, `mixed` (inputs x n) at A
    with one input's column of B. None if fewer than two rows are complete, or the result does not vary.

    Notes
    -----
    First order: Saltelli et al. 2010, Computer Physics Communications 181, Table 2 (b); total order: Jansen
    1999 (f there); of centred values. Rows with a failed sample are omitted.
    """
    complete = np.isfinite(a) & np.isfinite(b) & np.isfinite(mixed).all(axis=0)
    a, b, mixed = a[complete], b[complete], mixed[:, complete]
    n = a.size
    if n < 2:
        return None
    # Centring changes no index, but reduces round-off and standard errors.
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


def from_samples(inputs: Sequence[NDArray[np.intp]], values: Array) -> Indices | None:
    """Return the first-order indices from any samples whose inputs are independent of each other.

    `inputs` are the samples' `classes`, `values` the result, NaN where there is none. None if there are too
    few samples, or the result does not vary.

    Notes
    -----
    The correlation ratio: an input does not explain the variance within its classes. With the correction for
    the number of classes (Kelley 1935), an input without influence has 0 on average.
    """
    defined = np.isfinite(values)
    y = values[defined]
    n = y.size
    if n < 2 * _MIN_BIN_SAMPLES:
        return None
    y = y - y.mean()
    variance = float(y @ y) / n
    if not _varies(variance, float(values[defined].mean())):
        return None
    first, error = np.full((2, len(inputs)), np.nan)
    for index, classes in enumerate(classes_of[defined] for classes_of in inputs):
        counts = np.bincount(classes)
        used = int((counts > 0).sum())
        if used < 2:
            first[index] = error[index] = 0
        elif used < n:
            means = np.bincount(classes, weights=y) / np.maximum(counts, 1)
            left = np.square(y - means[classes])
            unexplained = left.mean() / variance
            first[index] = 1 - unexplained * (n - 1) / (n - used)
            error[index] = np.std(left - unexplained * y * y) / variance / np.sqrt(n)
    words = f"correlation ratio of {n} samples, first order only"
    return Indices(first, error, None, None, words, n)


def classes(x: NDArray[Any]) -> NDArray[np.intp]:
    """Return the class of each sample: its level if there are few, else one of equally populated ranges."""
    levels, members = np.unique(sortable(x), return_inverse=True)
    bins = int(np.clip(len(x) // _MIN_BIN_SAMPLES, 2, _MAX_BINS))
    if len(levels) <= min(_MAX_BINS, len(x) // 2) or levels.dtype.kind == "U":
        return np.asarray(members)
    ordered = np.sort(x)
    edges = np.unique(ordered[len(x) * np.arange(1, bins) // bins])
    return np.searchsorted(edges, x, side="right")


def _varies(variance: float, mean: float) -> bool:
    return bool(variance > (4 * np.finfo(float).eps * abs(mean)) ** 2)


def _ratio(explained: Array, power: Array, variance: float) -> tuple[Array, Array]:
    """Return mean(part) / mean(power) for each row, and its standard error."""
    share = explained.mean(axis=-1) / variance
    slope = (explained - share[:, None] * power) / variance
    return share, slope.std(axis=-1, ddof=1) / np.sqrt(explained.shape[-1])


def correlations(
    inputs: Sequence[Array], results: Sequence[Array], ranks: bool = False
) -> NDArray[np.float64]:
    """Return the correlation of each input with each result (inputs x results); NaN if one does not vary.

    Pairs with a missing value (NaN) are omitted. `ranks`: of the ranks (Spearman), for monotone relations.
    """
    coefficients = np.full((len(inputs), len(results)), np.nan)
    for index in np.ndindex(coefficients.shape):
        x, y = inputs[index[0]], results[index[1]]
        defined = np.isfinite(x) & np.isfinite(y)
        if defined.sum() < 2:
            continue
        pair = [x[defined], y[defined]]
        if ranks:  # equal values have their mean rank
            for k, values in enumerate(pair):
                _, level, counts = np.unique(values, return_inverse=True, return_counts=True)
                pair[k] = (np.cumsum(counts) - (counts - 1) / 2)[level]
        if all(values.min() < values.max() for values in pair):
            a, b = (values - values.mean() for values in pair)
            coefficients[index] = np.clip((a / np.linalg.norm(a)) @ (b / np.linalg.norm(b)), -1, 1)
    return coefficients


def scatter(x: Array, y: Array, max_points: int = 5000) -> tuple[Array, Array]:
    """Return at most `max_points` pairs for a scatter diagram, evenly selected in the order of the plan."""
    defined = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    if len(defined) > max_points:
        defined = defined[np.linspace(0, len(defined) - 1, max_points).astype(np.int64)]
    return x[defined], y[defined]


#: Correlation of two inputs above which their shares of a variance overlap noticeably.
OVERLAPPING = 0.2


class Influences:
    """Sobol indices of the outputs of a study.

    For Saltelli's design, indices are of first and total order, and inputs that change together are one
    factor; else they are of first order, for every input. Derived columns are no inputs: their share is that
    of what they are computed from.
    """

    def __init__(self, table: StudyTable) -> None:
        self.inputs = {
            name: column
            for name, column in table.varied.items()
            if len(column) and (column != column[0]).any()
        }

    @cached_property
    def design(self) -> SaltelliDesign | None:
        """Saltelli's design of the samples; None for other samples."""
        return saltelli_design(self.inputs)

    @cached_property
    def factors(self) -> list[str]:
        """Names of the factors."""
        return (
            list(self.inputs) if self.design is None else [", ".join(group) for group in self.design.factors]
        )

    def of(self, values: NDArray[np.float64]) -> Indices | None:
        """Return the indices of one output; None if it does not vary, or the samples are too few."""
        if not self.inputs:
            return None
        if self.design is not None:
            return from_design(*self.design.split(values))
        return from_samples(self._classes, values)

    def direction(self, factor: int, values: NDArray[np.float64]) -> float:
        """Return the rank correlation of a factor with an output; NaN for texts and for several inputs."""
        x = self.inputs.get(self.factors[factor])
        if x is None or x.dtype.kind not in "bif":
            return float("nan")
        return float(correlations([x.astype(float)], [values], ranks=True)[0, 0])

    @cached_property
    def correlated(self) -> tuple[str, str, float] | None:
        """The two most correlated inputs, if their shares of a variance overlap; else None."""
        numbers = {name: x.astype(float) for name, x in self.inputs.items() if x.dtype.kind in "bif"}
        names = list(numbers)
        if self.design is not None or len(names) < 2:
            return None
        coefficients = np.corrcoef(list(numbers.values()))
        np.fill_diagonal(coefficients, 0)
        first, second = np.unravel_index(np.argmax(np.abs(coefficients)), coefficients.shape)
        value = float(coefficients[first, second])
        # Five standard errors: of independent samples, one of two million exceeds them.
        chance = 5 / np.sqrt(len(numbers[names[0]]))
        return (names[first], names[second], value) if abs(value) > max(OVERLAPPING, chance) else None

    @cached_property
    def _classes(self) -> list[NDArray[np.intp]]:
        return [classes(column) for column in self.inputs.values()]
