"""What the results of a study depend on: tornadoes, and parts of the variance."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from dynid.report.diagrams.study.columns import Number, StudyNumbers
from dynid.report.figure import Cell, Figure, Picture, Table
from dynid.report.numbers import short
from dynid.report.plot import Axis, Bars, Panel, Rule, chart
from dynid.report.plot.layers import Layer, hue
from dynid.study.analysis.ranking import Influences
from dynid.study.analysis.tornado import Tornado, tornado

if TYPE_CHECKING:
    from dynid.result import Result

_PANELS, _BARS = 8, 12


def figures(result: Result) -> Iterator[Figure]:
    """Yield tornadoes, and Sobol indices where the samples tell them."""
    numbers = StudyNumbers(result)
    if len(numbers.inputs) < 2 or not numbers.outputs:
        return
    yield Figure("tornado", "Tornado: what moves the results", partial(_tornadoes, numbers))
    yield Figure("sobol", "Where the variance comes from", partial(_indices, numbers))


def _tornadoes(numbers: StudyNumbers) -> Picture:
    names = {number.path: number.name for number in numbers.inputs}
    found = [
        (number, whole)
        for number in numbers.outputs
        if (whole := tornado(numbers.table.inputs, number.values)) is not None and whole.bars
    ]
    panels, rows = [], list[tuple[Cell, ...]]()
    for number, whole in found:
        rows += [
            (number.label, bar.input, bar.low, bar.high, bar.at_low, bar.at_high, bar.slope)
            for bar in whole.bars
        ]
    for number, whole in found[:_PANELS]:
        panels.append(_tornado(number, whole, names))
    about = f"{found[0][1].remark[0].upper()}{found[0][1].remark[1:]}." if found else "Nothing varies enough."
    about = f"Results with one input at its low (orange) and at its high end (blue). {about}"
    svg = _in_pairs(
        "tornado", "Tornado: what moves the results", about, panels, "no number depends on an input"
    )
    columns = ("number", "input", "low", "high", "at low", "at high", "slope")
    return Picture(svg, about, Table(columns, tuple(rows)))


def _in_pairs(name: str, title: str, about: str, panels: Sequence[Panel], otherwise: str) -> str:
    """Draw panels two to a row; an empty one that says why where there are none."""
    shown = panels or [Panel(Axis("", low=0, high=1), Axis("", low=0, high=1), [], otherwise)]
    rows = [shown[k : k + 2] for k in range(0, len(shown), 2)]
    return chart(name, title, rows, about, width=900.0 if len(shown) > 1 else 560.0)


def _tornado(number: Number, whole: Tornado, names: dict[str, str]) -> Panel:
    bars = whole.bars[:_BARS][::-1]
    place = np.arange(len(bars), dtype=float)
    low, high = np.array([bar.at_low for bar in bars]), np.array([bar.at_high for bar in bars])
    middle = (low + high) / 2
    tips = [
        f"{bar.input} {short(bar.low)} … {short(bar.high)}: {short(bar.at_low)} … {short(bar.at_high)}"
        for bar in bars
    ]
    layers: list[Layer] = [
        Bars(place, middle, low, "at the input's low end", "s2", 0.6, True, tips),
        Bars(place, middle, high, "at its high end", "s1", 0.6, True, tips),
    ]
    labels = tuple(names.get(bar.input, bar.input) for bar in bars)
    return Panel(Axis(number.label), Axis("", names=labels), layers, height=max(70.0, 26.0 * len(bars)))


def _indices(numbers: StudyNumbers) -> Picture:
    influences = Influences(numbers.table)
    names = [_short(factor, numbers.inputs) for factor in influences.factors]
    panels, rows, said = list[Panel](), list[tuple[Cell, ...]](), ""
    for number in numbers.outputs:
        found = influences.of(number.values)
        if found is None:
            continue
        said = found.estimator
        total = found.total if found.total is not None else np.full(len(names), np.nan)
        rows += [
            (number.label, name, float(first), float(error), float(whole))
            for name, first, error, whole in zip(names, found.first, found.first_error, total, strict=True)
        ]
        if len(panels) < _PANELS:
            panels.append(_shares(number.label, names, found.first, found.first_error, total))
    about = f"Part of the variance that each input explains alone{_total(rows)}; {said or 'too few samples'}."
    svg = _in_pairs(
        "sobol", "Where the variance comes from", about, panels, "the samples are too few to tell"
    )
    return Picture(
        svg,
        about,
        Table(("number", "input", "first order", "its standard error", "total order"), tuple(rows)),
    )


def _total(rows: Sequence[tuple[Cell, ...]]) -> str:
    return (
        " (blue) and with others (orange)"
        if any(isinstance(r[4], float) and np.isfinite(r[4]) for r in rows)
        else ""
    )


def _short(factor: str, inputs: Sequence[Number]) -> str:
    names = {number.path: number.name for number in inputs}
    return ", ".join(names.get(part, part) for part in factor.split(", "))


def _shares(
    label: str, names: Sequence[str], first: np.ndarray, error: np.ndarray, total: np.ndarray
) -> Panel:
    order = np.argsort(np.where(np.isfinite(first), first, -1), kind="stable")[-_BARS:]
    place = np.arange(len(order), dtype=float)
    both = bool(np.isfinite(total).any())
    shift = 0.2 if both else 0.0
    zero = np.zeros(len(order))
    tips = [f"{names[k]}: {100 * first[k]:.3g} ± {100 * error[k]:.2g} %" for k in order]
    layers: list[Layer] = [
        Bars(place + shift, zero, 100 * first[order], "alone", hue(0), 0.35 if both else 0.55, True, tips),
        Rule(0.0, "", "hair", upright=True),
    ]
    if both:
        layers.append(
            Bars(place - shift, zero, 100 * total[order], "with others (total)", hue(1), 0.35, True)
        )
    labels = tuple(names[k] for k in order)
    return Panel(
        Axis("part of the variance (%)"),
        Axis("", names=labels),
        layers,
        label,
        height=max(70.0, 26.0 * len(order)),
    )
