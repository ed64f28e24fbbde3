"""Influence of the inputs of a study on its results: tornado diagrams and Sobol indices."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from dynid.report.diagrams.study_samples import StudyNumbers
from dynid.report.figure import CellValue, Figure, FigureTable, Picture
from dynid.report.notation import short
from dynid.report.plot import Bars, Layer, PlotAxis, ReferenceLine, Subplot, chart, series_class
from dynid.study.analysis.design import tornado
from dynid.study.analysis.influence import Influences

if TYPE_CHECKING:
    from dynid.result import Result

_PANELS, _BARS = 8, 12


def figures(result: Result) -> Iterator[Figure]:
    """Yield tornado diagrams, and Sobol indices where the samples suffice."""
    numbers = StudyNumbers(result)
    if len(numbers.inputs) < 2 or not numbers.outputs:
        return
    for name, title, draw in (
        ("tornado", "Tornado: influence of each input", _tornadoes),
        ("sobol", "Sobol indices: sources of the variance", _indices),
    ):
        yield Figure(name, title, partial(draw, numbers, name, title))


def _in_pairs(name: str, title: str, about: str, subplots: Sequence[Subplot], otherwise: str) -> str:
    """Draw subplots two to a row, or an empty one with the reason where there are none."""
    empty = PlotAxis("", low=0, high=1)
    shown = subplots or [Subplot(empty, empty, [], otherwise)]
    rows = [shown[k : k + 2] for k in range(0, len(shown), 2)]
    return chart(name, title, rows, about, width=900.0 if len(shown) > 1 else 560.0)


def _tornadoes(numbers: StudyNumbers, name: str, title: str) -> Picture:
    names = {number.path: number.name for number in numbers.inputs}
    subplots, rows, remark = list[Subplot](), list[tuple[CellValue, ...]](), ""
    for number in numbers.outputs:
        found = tornado(numbers.table.inputs, number.values)
        if found is None or not found.bars:
            continue
        remark = remark or f"{found.remark[0].upper()}{found.remark[1:]}."
        rows += [
            (number.label, bar.input, bar.low, bar.high, bar.at_low, bar.at_high, bar.slope)
            for bar in found.bars
        ]
        if len(subplots) == _PANELS:
            continue
        bars = found.bars[:_BARS][::-1]
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
        upright = PlotAxis("", names=tuple(names.get(bar.input, bar.input) for bar in bars))
        height = max(70.0, 26.0 * len(bars))
        subplots.append(Subplot(PlotAxis(number.label), upright, layers, height=height))
    about = "Results with one input at its low (orange) and at its high end (blue). "
    about += remark or "No result varies enough."
    svg = _in_pairs(name, title, about, subplots, "no result depends on an input")
    columns = ("number", "input", "low", "high", "at low", "at high", "slope")
    return Picture(svg, about, FigureTable(columns, tuple(rows)))


def _indices(numbers: StudyNumbers, name: str, title: str) -> Picture:
    influences = Influences(numbers.table)
    short_names = {number.path: number.name for number in numbers.inputs}
    names = [
        ", ".join(short_names.get(part, part) for part in factor.split(", ")) for factor in influences.factors
    ]
    subplots, rows, estimator = list[Subplot](), list[tuple[CellValue, ...]](), ""
    with_total = False
    for number in numbers.outputs:
        found = influences.of(number.values)
        if found is None:
            continue
        estimator = found.estimator
        first, error = found.first, found.first_error
        total = found.total if found.total is not None else np.full(len(names), np.nan)
        both = bool(np.isfinite(total).any())
        with_total = with_total or both
        rows += [
            (number.label, own, float(alone), float(spread), float(whole))
            for own, alone, spread, whole in zip(names, first, error, total, strict=True)
        ]
        if len(subplots) == _PANELS:
            continue
        order = np.argsort(np.where(np.isfinite(first), first, -1), kind="stable")[-_BARS:]
        place, zero = np.arange(len(order), dtype=float), np.zeros(len(order))
        shift, thick = (0.2, 0.35) if both else (0.0, 0.55)
        tips = [f"{names[k]}: {100 * first[k]:.3g} ± {100 * error[k]:.2g} %" for k in order]
        alone = Bars(place + shift, zero, 100 * first[order], "alone", series_class(0), thick, True, tips)
        layers: list[Layer] = [alone, ReferenceLine(0.0, "", "hair", upright=True)]
        if both:
            values = 100 * total[order]
            label = "with interactions (total)"
            layers.append(Bars(place - shift, zero, values, label, series_class(1), 0.35, True))
        upright = PlotAxis("", names=tuple(names[k] for k in order))
        height = max(70.0, 26.0 * len(order))
        across = PlotAxis("part of the variance (%)")
        subplots.append(Subplot(across, upright, layers, number.label, height=height))
    totals = " (blue) and with interactions (orange)" if with_total else ""
    about = f"Part of the variance that each input explains alone{totals}; {estimator or 'too few samples'}."
    svg = _in_pairs(name, title, about, subplots, "too few samples")
    columns = ("number", "input", "first order", "its standard error", "total order")
    return Picture(svg, about, FigureTable(columns, tuple(rows)))
