"""Sampling designs recognised from the samples; tornado diagrams."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array

Columns = Mapping[str, NDArray[Any]]


def sortable(column: NDArray[Any]) -> NDArray[Any]:
    """Return a column in a type with an order; texts as strings."""
    return column.astype(str) if column.dtype.kind == "O" else column


@dataclass(frozen=True)
class SaltelliDesign:
    """Saltelli's design: samples A and B, and for each factor i, A with its column i from B.

    `factors` are the inputs that change together, for each of the d factors. A, B and the mixed samples
    follow each other as `blocks`; else as rows of d + 2: one sample of A, the mixed ones, and the one of B.
    """

    factors: tuple[tuple[str, ...], ...]
    blocks: bool

    def split(self, values: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
        """Return the values at A, at B (each of shape (rows,)) and at the mixed samples (factors, rows)."""
        rows = _rows(values, len(self.factors), self.blocks)
        return rows[:, 0], rows[:, -1], rows[:, 1:-1].T


def saltelli_design(inputs: Columns) -> SaltelliDesign | None:
    """Return Saltelli's design of the samples (by input); None if they have another design.

    Inputs that change together are one factor; an input that is a function of several factors is no factor.
    """
    count = len(next(iter(inputs.values()), ()))
    for factors in range(len(inputs), 0, -1):
        if count % (factors + 2) == 0 and count > factors + 2:
            for blocks in (True, False):
                names_of_factors = _saltelli_factors(inputs, factors, blocks)
                if names_of_factors is not None:
                    return SaltelliDesign(names_of_factors, blocks)
    return None


def _rows(column: NDArray[Any], factors: int, blocks: bool) -> NDArray[Any]:
    """Return the samples in rows: A, mixed, B."""
    if not blocks:
        return column.reshape(-1, factors + 2)
    return column.reshape(factors + 2, -1).T[:, [0, *range(2, factors + 2), 1]]


def _saltelli_factors(inputs: Columns, count: int, blocks: bool) -> tuple[tuple[str, ...], ...] | None:
    groups: list[list[str]] = [[] for _ in range(count)]
    for name, column in inputs.items():
        rows = _rows(column, count, blocks)
        a, b = rows[:, :1], rows[:, -1:]
        of_a, of_b = (rows[:, 1:-1] == a).all(axis=0), (rows[:, 1:-1] == b).all(axis=0)
        if of_b.sum() == 1 and not (of_a & of_b).any() and (of_a | of_b).all():
            groups[int(np.flatnonzero(of_b)[0])].append(name)
    grouped = [name for group in groups for name in group]
    others = [name for name in inputs if name not in grouped]
    if not all(groups):
        return None
    # The other inputs must be functions of the factors; in a part of a grid they are not.
    together = len(_levels(inputs, grouped)) if others else 0
    dependent = all(len(_levels(inputs, [*grouped, name])) == together for name in others)
    return tuple(map(tuple, groups)) if dependent else None


def _levels(inputs: Columns, names: list[str]) -> NDArray[np.intp]:
    """Return the different combinations of values of several inputs, as ranks."""
    ranks = [np.unique(sortable(inputs[name]), return_inverse=True)[1] for name in names]
    return np.unique(np.stack(ranks, axis=-1), axis=0)


@dataclass(frozen=True)
class _OneAtATime:
    """The samples at a centre, and for each input those that differ from it in this input only."""

    centre: NDArray[np.intp]
    varied: Mapping[str, NDArray[np.intp]]


def one_at_a_time(inputs: Columns) -> _OneAtATime | None:
    """Return a design whose samples differ from a centre in at most one input; None for other samples."""
    changed = {}
    for name, column in inputs.items():
        levels, counts = np.unique(sortable(column), return_counts=True)
        changed[name] = sortable(column) != levels[np.argmax(counts)]
    if not changed:
        return None
    differing = np.sum(list(changed.values()), axis=0)
    if differing.max(initial=0) != 1 or not (differing == 0).any():
        return None
    varied = {name: np.flatnonzero(where) for name, where in changed.items() if where.any()}
    return _OneAtATime(np.flatnonzero(differing == 0), varied)


#: Explained share of the variance above which a linear model is reliable.
TRUSTED = 0.9
#: Condition number of the inputs' correlations above which the inputs are not distinguishable.
_INSEPARABLE = 1e8
#: Share of the samples that are at one end of an input, and standard errors that exceed chance.
_END, _CHANCE = 0.2, 2.0
#: Relative differences that are round-off.
_RELATIVE_ROUND_OFF = 1e-12
#: Ratio of the ends of an input beyond which it may be spaced by its logarithm.
_DECADE = 10.0


def _is_even(values: Array) -> bool:
    steps = np.diff(values)
    return bool(np.ptp(steps) <= 1e-6 * np.abs(steps).max())


def is_logarithmic(column: Array) -> bool:
    """Return True if an input is spaced by its logarithm: on a grid, or around the median of its samples."""
    levels = np.unique(column)
    if len(levels) < 3 or not levels[0] > 0 or not np.isfinite(levels[-1]) or _is_even(levels):
        return False
    if _is_even(np.log(levels)):
        return True
    low, middle, high = levels[0], float(np.median(column)), levels[-1]
    off = abs((middle - low) / (high - low) - 0.5), abs(np.log(middle / low) / np.log(high / low) - 0.5)
    return bool(high > _DECADE * low and off[1] < off[0])


@dataclass(frozen=True)
class Bar:
    """Bar of one input.

    Of samples one at a time, `low` and `high` are the ends of the input with the results there; of others,
    the medians of its lowest and its highest fifth with the mean results. `slope` is the local sensitivity,
    at the mean of the input, or the geometric one where it is spaced by its logarithm. `error` is the
    standard error of the swing; 0 for samples one at a time, NaN where an end has one sample only.
    """

    input: str
    low: float
    high: float
    at_low: float
    at_high: float
    slope: float
    error: float = 0.0

    @property
    def swing(self) -> float:
        """Signed change of the result between the ends."""
        return self.at_high - self.at_low

    @property
    def exceeds_chance(self) -> bool:
        """True if the swing is not within two standard errors of zero."""
        return abs(self.swing) > (0.0 if np.isnan(self.error) else _CHANCE * self.error)


@dataclass(frozen=True)
class Tornado:
    """Bars of all varied numbers, the longest first, with their method and reliability in words.

    `r2` is the share of the variance that a linear model explains; NaN for samples one at a time.
    """

    bars: tuple[Bar, ...]
    method: str
    r2: float
    remark: str


def tornado(inputs: Mapping[str, NDArray[Any]], values: Array) -> Tornado | None:
    """Return the tornado of one result (NaN: missing) over the samples by input, of which texts are omitted.

    It is None if no number varies, or there are fewer samples than unknowns.

    Notes
    -----
    For samples that differ from a centre in one input each, slopes are those between the ends of the input.
    Of other samples, the ends are the lowest and the highest fifth in the input. The result there is the mean
    of these samples, less the linear effects of the other inputs (partial residuals), and within the range of
    all samples. Slopes and R² are those of a linear model, in the logarithm of inputs that are spaced by it.
    """
    defined = np.isfinite(values)
    numbers = {name: column for name, column in inputs.items() if column.dtype.kind in "bif"}
    design = one_at_a_time(inputs)
    if design is not None:
        bars = []
        for name, column in numbers.items():
            if name not in design.varied:
                continue
            places = np.concatenate([design.centre[:1], design.varied[name]])
            places = places[np.isfinite(values[places])]
            if len(places) < 2:
                continue
            first, last = places[np.argmin(column[places])], places[np.argmax(column[places])]
            low, high = float(column[first]), float(column[last])
            slope = (values[last] - values[first]) / (high - low)
            bars.append(Bar(name, low, high, float(values[first]), float(values[last]), float(slope)))
        if not bars:
            return None
        remark = "around one centre: exact there, without interactions of inputs"
        return Tornado(_by_swing(bars), "one at a time", float("nan"), remark)
    return _averaged(
        {name: column[defined].astype(float) for name, column in numbers.items()}, values[defined]
    )


def _averaged(inputs: Mapping[str, Array], y: Array) -> Tornado | None:
    varying = {name: x for name, x in inputs.items() if len(x) and x.min() < x.max() and np.isfinite(x).all()}
    n = len(y)
    if not varying or n < len(varying) + 2:
        return None
    logs = {name: is_logarithmic(x) for name, x in varying.items()}
    x = np.column_stack([np.log(x) if logs[name] else x for name, x in varying.items()])
    mean, scale = x.mean(axis=0), x.std(axis=0)
    standard = (x - mean) / scale
    centred = y - y.mean()
    correlations = standard.T @ standard / n
    if np.linalg.cond(correlations) > _INSEPARABLE:
        remark = "the inputs are collinear: the samples do not distinguish them"
        return Tornado((), "conditional means", float("nan"), remark)
    slopes = np.linalg.solve(correlations, standard.T @ centred / n)
    power = float(centred @ centred)
    left = centred - standard @ slopes
    r2 = 1 - float(left @ left) / power if power > 0 else float("nan")
    bars = []
    errors = left * np.sqrt(n / (n - len(slopes) - 1))
    for index, (name, column) in enumerate(varying.items()):
        main_effect = (
            y.mean() + slopes[index] * standard[:, index] + left
        )  # without the linear effects of the others
        slope = slopes[index] / scale[index] / (np.exp(mean[index]) if logs[name] else 1.0)
        bars.append(_bar(name, column, float(slope), main_effect, errors, (float(y.min()), float(y.max()))))
    of_log = " (in the logarithm of " + ", ".join(name for name in logs if logs[name]) + ")"
    remark = f"a linear model{of_log if any(logs.values()) else ''} explains {100 * r2:.3g} % of the variance"
    if np.isnan(r2):
        remark = "the result does not vary"
    elif not any(bar.exceeds_chance for bar in bars):
        remark = "no input moves the mean by more than two standard errors"
    elif r2 < TRUSTED:
        remark += ": means of samples hide curvature and interactions; see the Sobol indices, too"
    return Tornado(_by_swing(bars), "conditional means", r2, remark)


def _bar(
    name: str, column: Array, slope: float, values_alone: Array, errors: Array, within: tuple[float, float]
) -> Bar:
    """Return the bar between the samples with the lowest and those with the highest values of an input."""
    ordered, count = np.sort(column), max(1, round(_END * len(column)))
    low, high = ordered[count - 1], ordered[-count]
    if not low < high:  # most samples have the same value
        low, high = ordered[0], ordered[-1]
    ends = [column <= low, column >= high]
    error = float("nan")
    if all(end.sum() > 1 for end in ends):
        error = float(np.sqrt(sum(np.mean(errors[end] ** 2) / end.sum() for end in ends)))
    first, last = (float(np.median(column[end])) for end in ends)
    at_low, at_high = (float(np.clip(values_alone[end].mean(), *within)) for end in ends)
    return Bar(
        name, first, last, at_low, at_high, slope, max(error, _RELATIVE_ROUND_OFF * (within[1] - within[0]))
    )


def _by_swing(bars: list[Bar]) -> tuple[Bar, ...]:
    return tuple(sorted(bars, key=lambda bar: (-abs(bar.swing), bar.input)))
