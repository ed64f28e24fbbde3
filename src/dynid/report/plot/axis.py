"""Axes: their ranges, ticks and labels."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from dynid.arrays import Array
from dynid.report.notation import raised, short
from dynid.report.svg import SMALL, text_width

#: Least distance between two labels, and height of a line, px.
_APART = 10.0
_LINE = 16.0
#: Relative differences that are round-off.
_ROUNDING = 1e-12
#: Magnitudes from which, and below which, ticks are written with a common power of ten.
_LARGE, _LITTLE = 5, -2
#: Powers of ten by which the last two ticks of a short axis may be finer than its range.
_FINER = 3
#: Distances of ticks of angles, °.
_ANGLES = (15.0, 30.0, 45.0, 90.0, 180.0)


@dataclass(frozen=True)
class PlotAxis:
    """An axis of a plot, labelled by its quantity with units: `time (s)`.

    `low` and `high` are its ends, by default those of the data with a margin; `names` are labels at 0, 1, 2,
    … instead of numbers; `step` is the least distance of ticks: 45 for angles, 1 for counts.
    """

    label: str
    log: bool = False
    low: float | None = None
    high: float | None = None
    names: tuple[str, ...] = ()
    step: float = 0.0

    def scale(self, values: Iterable[ArrayLike]) -> Scale:
        """Return the scale that contains all values, of a logarithmic axis all positive ones."""
        if self.names:
            return Scale(-0.5, len(self.names) - 0.5)
        low, high = math.inf, -math.inf
        for some in values:
            data = np.asarray(some, dtype=float)
            data = data[np.isfinite(data) & ((data > 0) | (not self.log))]
            if data.size:
                low, high = min(low, float(data.min())), max(high, float(data.max()))
        if not low <= high:
            low, high = (1.0, 10.0) if self.log else (0.0, 1.0)
        low, high = self.low if self.low is not None else low, self.high if self.high is not None else high
        if not low < high or (not self.log and high - low <= _ROUNDING * max(abs(low), abs(high))):
            around = abs(low) * 0.1 or 1.0
            return Scale(low / 2, low * 2, True) if self.log else Scale(low - around, low + around)
        if self.log:
            margin = (high / low) ** 0.03
            lower, upper = low / margin, high * margin
        else:
            margin = 0.04 * (high - low)
            lower, upper = low - margin, high + margin
        low, high = lower if self.low is None else low, upper if self.high is None else high
        return Scale(low, high, self.log)

    def ticks(self, scale: Scale, length: float, *, upright: bool) -> Ticks:
        """Return as many ticks at round values as fit on a length, px, two at least where two labels fit.

        The labels of upright axes are stacked.
        """
        if self.names:
            ticks = Ticks((), ())
            for step in range(1, len(self.names) + 1):  # every n-th name where not all fit
                places = range(0, len(self.names), step)
                labels = tuple(shortened(self.names[index]) for index in places)
                ticks = Ticks(tuple(map(float, places)), labels)
                if ticks.fit(scale, length, upright):
                    break
            return ticks
        limit = max(2, int(length / (24.0 if upright else 60.0)))
        ticks = Ticks((), ())
        for count in range(limit, 0, -1):
            ticks = _logarithmic(scale, count) if scale.log else _linear(scale, count, self.step)
            if len(ticks.values) <= limit and ticks.fit(scale, length, upright):
                break
        if len(ticks.values) > 1:
            return ticks
        return next((few for few in _ends(scale, self.step) if few.fit(scale, length, upright)), ticks)


@dataclass(frozen=True)
class Scale:
    """The range of an axis: maps values to shares of its length."""

    low: float
    high: float
    log: bool = False

    def share(self, values: ArrayLike) -> Array:
        """Return the positions of values between the ends, 0 … 1; NaN where a logarithm is undefined."""
        data = np.asarray(values, dtype=float)
        if not self.log:
            return (data - self.low) / (self.high - self.low)
        with np.errstate(divide="ignore", invalid="ignore"):
            logs = np.where(data > 0, np.log(np.where(data > 0, data, 1.0)), np.nan)
        return (logs - math.log(self.low)) / (math.log(self.high) - math.log(self.low))

    def __str__(self) -> str:
        return f"{'log' if self.log else 'lin'} {self.low:.12g} {self.high:.12g}"


@dataclass(frozen=True)
class Ticks:
    """Ticks with a label each, times a power of ten; `minor` have a grid line but no label."""

    values: tuple[float, ...]
    labels: tuple[str, ...]
    minor: tuple[float, ...] = ()
    power: int = 0

    def fit(self, scale: Scale, length: float, upright: bool) -> bool:
        """Return True if no two labels are too close to each other."""
        places = scale.share(self.values) * length
        if upright:
            return bool(np.all(np.abs(np.diff(places)) >= _LINE))
        halves = [text_width(label, SMALL) / 2 for label in self.labels]
        return all(
            b - a >= left_half + right_half + _APART
            for a, b, left_half, right_half in zip(places, places[1:], halves, halves[1:], strict=False)
        )

    @property
    def width(self) -> float:
        """Width of the widest label, px."""
        return max((text_width(label, SMALL) for label in self.labels), default=0.0)


def shortened(name: str, limit: int = 28) -> str:
    """Return a name that is too long for a label without its middle."""
    return name if len(name) <= limit else f"{name[: limit // 2 - 1]}…{name[-(limit // 2) :]}"


def _linear(scale: Scale, count: int, min_step: float) -> Ticks:
    """Return ticks at multiples of a round step, labelled with a common power of ten."""
    span = scale.high - scale.low
    raw = max(span / count, min_step or 0.0)
    if min_step >= 15 and raw > min_step:  # angles
        step = next((s for s in _ANGLES if s >= raw), 360.0 * math.ceil(raw / 360))
    else:
        unit = 10.0 ** math.floor(math.log10(raw))
        step = next(unit * factor for factor in (1, 2, 2.5, 5, 10) if unit * factor >= raw * (1 - 1e-9))
        if min_step:
            step = max(round(step / min_step), 1) * min_step
    values = _multiples(scale, step)
    return Ticks(values, *_labels(values, step)) if values else Ticks((), ())


def _multiples(scale: Scale, step: float) -> tuple[float, ...]:
    """Return the multiples of a step within a scale."""
    first, last = math.ceil(scale.low / step - 1e-9), math.floor(scale.high / step + 1e-9)
    return tuple(k * step for k in range(first, min(last, first + 1000) + 1))


def _labels(values: tuple[float, ...], step: float) -> tuple[tuple[str, ...], tuple[float, ...], int]:
    """Return the labels of multiples of a step, no minor ticks, and the power of ten of the labels."""
    largest = max(map(abs, values)) or step
    magnitude = math.floor(math.log10(largest) + 1e-12)
    power = 3 * (magnitude // 3) if magnitude >= _LARGE or magnitude < _LITTLE else 0
    unit = 10.0**power
    digits = max(0, -math.floor(math.log10(step / unit) + 1e-9))
    digits += abs(round(step / unit, digits) - step / unit) > 1e-6 * step / unit  # 2.5
    texts = [f"{value / unit:,.{min(digits, 12)}f}" for value in values]
    thin = "\N{NARROW NO-BREAK SPACE}" if largest / unit >= 1e4 else ""
    labels = [
        text.replace(",", thin).replace("-", "−" if float(text.replace(",", "")) else "") for text in texts
    ]
    return tuple(labels), (), power


def _ends(scale: Scale, min_step: float) -> Iterator[Ticks]:
    """Yield ticks near both ends of a scale, at rounder values first."""
    if scale.log:
        around = range(math.floor(math.log10(scale.low)), math.ceil(math.log10(scale.high)) + 1)
        for last in (1, 9):
            candidates = sorted(k * 10.0**p for p in around for k in range(1, last + 1))
            inside = tuple(value for value in candidates if scale.low <= value <= scale.high)
            if len(inside) > 1:
                ends = (inside[0], inside[-1])
                decades = tuple(10.0**p for p in around if inside[0] < 10.0**p < inside[-1])
                for kept in ((inside[0], *decades, inside[-1]), ends):
                    yield Ticks(kept, tuple(short(value, 1) for value in kept), inside[1:-1])
    unit = 10.0 ** math.ceil(math.log10(scale.high - scale.low))
    steps = [unit * factor / 10**power for power in range(_FINER) for factor in (1, 0.5, 0.25, 0.2)]
    if min_step >= 15:  # angles
        steps = list(_ANGLES[::-1])
    elif min_step:
        steps = [max(round(step / min_step), 1) * min_step for step in steps]
    for step in steps:
        inside = _multiples(scale, step)
        if len(inside) > 1:
            ends = (inside[0], inside[-1])
            yield Ticks(ends, *_labels(ends, step))


def _logarithmic(scale: Scale, count: int) -> Ticks:
    """Return ticks at powers of ten, or within decades where there are few of them."""
    low, high = math.log10(scale.low), math.log10(scale.high)
    first, last = math.ceil(low - 1e-9), math.floor(high + 1e-9)
    decades = last - first + 1
    if decades < 2 or high - low < 2.2:  # ticks at 1, 2, 5 of each decade, or those of a linear axis
        around = range(math.floor(low), math.ceil(high) + 1)
        for factors in ((1, 2, 3, 4, 5, 6, 8), (1, 2, 5), (1, 3), (1,)):
            values = tuple(
                k * 10.0**p for p in around for k in factors if scale.low <= k * 10.0**p <= scale.high
            )
            if 2 <= len(values) <= count:
                between = (k * 10.0**p for p in around for k in range(1, 10))
                minor = [value for value in between if scale.low <= value <= scale.high]
                return Ticks(values, tuple(short(value, 2) for value in values), tuple(minor))
        return _linear(replace(scale, log=False), count, 0.0)
    step = max(1, math.ceil(decades / count))
    powers = range(first + (-first) % step, last + 1, step)
    plain = first >= -3 and last <= 4
    labels = tuple(
        f"{10.0**power:.{max(0, -power)}f}".replace("10000", "10\N{NARROW NO-BREAK SPACE}000")
        if plain
        else f"10{raised(power)}"
        for power in powers
    )
    minor = []
    if step > 1:
        minor = [10.0**power for power in range(first, last + 1) if power not in powers]
    elif decades <= 5:
        minor = [k * 10.0**p for p in range(first - 1, last + 1) for k in range(2, 10)]
    inside = tuple(value for value in minor if scale.low <= value <= scale.high)
    return Ticks(tuple(10.0**power for power in powers), labels, inside)
