"""Tornado diagram: change of a result between the low and the high end of each input."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.study.analysis.design import OneAtATime, one_at_a_time
from dynid.study.analysis.sample_statistics import QUANTILES, quantile

Floats = NDArray[np.float64]

#: Explained share of the variance above which a linear model is reliable.
TRUSTED = 0.9
#: Condition number of the inputs' correlations above which the inputs are not distinguishable.
_INSEPARABLE = 1e8


@dataclass(frozen=True)
class Bar:
    """Bar of one input.

    Parameters
    ----------
    input
        The input's path in the scene.
    low, high
        The ends of the input.
    at_low, at_high
        The result at these ends.
    slope
        The local sensitivity d result / d input.
    """

    input: str
    low: float
    high: float
    at_low: float
    at_high: float
    slope: float

    @property
    def swing(self) -> float:
        """Signed change of the result between the ends."""
        return self.at_high - self.at_low


@dataclass(frozen=True)
class Tornado:
    """Bars of all inputs, the longest first, with their method and reliability.

    Parameters
    ----------
    bars
        One for each input that is a number and varies.
    method
        `one at a time` or `regression`.
    r2
        Share of the variance that the regression explains; NaN for samples one at a time.
    remark
        The reliability, in words.
    """

    bars: tuple[Bar, ...]
    method: str
    r2: float
    remark: str


def tornado(inputs: Mapping[str, NDArray[Any]], values: Floats) -> Tornado | None:
    """Return the tornado of one result.

    Parameters
    ----------
    inputs
        The samples, by input; texts are omitted.
    values
        The result; NaN for a missing one.

    Returns
    -------
    Tornado or None
        None if no number varies, or there are fewer samples than unknowns.

    Notes
    -----
    For samples that differ from a centre in one input each, slopes are those between the ends of the input.
    Other samples are fitted by a linear model; the ends are the 5 % and 95 % quantiles of the input.
    """
    known = np.isfinite(values)
    numbers = {name: column for name, column in inputs.items() if column.dtype.kind in "bif"}
    design = one_at_a_time(inputs)
    if design is not None:
        return _around(design, numbers, values)
    return _fitted({name: column[known].astype(float) for name, column in numbers.items()}, values[known])


def _around(design: OneAtATime, inputs: Mapping[str, NDArray[Any]], values: Floats) -> Tornado | None:
    bars = []
    for name, column in inputs.items():
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


def _fitted(inputs: Mapping[str, Floats], y: Floats) -> Tornado | None:
    varying = {name: x for name, x in inputs.items() if len(x) and x.min() < x.max() and np.isfinite(x).all()}
    n = len(y)
    if not varying or n < len(varying) + 2:
        return None
    x = np.column_stack(list(varying.values()))
    mean, scale = x.mean(axis=0), x.std(axis=0)
    standard = (x - mean) / scale
    centred = y - y.mean()
    correlations = standard.T @ standard / n
    if np.linalg.cond(correlations) > _INSEPARABLE:
        remark = "the inputs are collinear: the samples do not distinguish them"
        return Tornado((), "regression", float("nan"), remark)
    slopes = np.linalg.solve(correlations, standard.T @ centred / n)
    power = float(centred @ centred)
    left = centred - standard @ slopes
    r2 = 1 - float(left @ left) / power if power > 0 else float("nan")
    bars = []
    for (name, column), slope in zip(varying.items(), slopes / scale, strict=True):
        ordered, count = np.sort(column), np.array(n)
        low, high = (float(quantile(ordered, count, QUANTILES[end])) for end in ("p05", "p95"))
        at = [float(y.mean() + slope * (end - column.mean())) for end in (low, high)]
        bars.append(Bar(name, low, high, at[0], at[1], float(slope)))
    remark = f"a linear model explains {100 * r2:.3g} % of the variance"
    if np.isnan(r2):
        remark = "the result does not vary"
    elif r2 < TRUSTED:
        remark += ": only order and direction of the longest bars are reliable; prefer the Sobol indices"
    return Tornado(_by_swing(bars), "regression", r2, remark)


def _by_swing(bars: list[Bar]) -> tuple[Bar, ...]:
    return tuple(sorted(bars, key=lambda bar: (-abs(bar.swing), bar.input)))
