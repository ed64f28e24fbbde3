"""Influence of the inputs of a study on its results: tornado diagrams and Sobol indices."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np

from dynid.number_format import general
from dynid.report.diagrams.study_samples import StudyNumbers
from dynid.report.figure import CellValue, Figure, FigureTable
from dynid.report.notation import labelled, short
from dynid.report.plot import Bars, Chart, Curve, Layer, PlotAxis, Subplot, in_rows, series_class
from dynid.result import Result
from dynid.study.analysis.design import tornado
from dynid.study.analysis.influence import Influences

_PANELS, _BARS = 8, 12


def figures(result: Result) -> Iterator[Figure]:
    """Yield tornado diagrams, and Sobol indices where the samples suffice."""
    numbers = StudyNumbers(result)
    if sum(number.path in numbers.table.varied for number in numbers.inputs) < 2 or not numbers.outputs:
        return
    yield Figure("tornado", "Tornado: influence of each input", partial(_tornadoes, numbers))
    yield Figure("sobol", "Sobol indices: sources of the variance", partial(_indices, numbers))


def _in_pairs(subplots: Sequence[Subplot], about: str, table: FigureTable, otherwise: str) -> Chart:
    """Return subplots two to a row, or an empty one with the reason where there are none."""
    empty = PlotAxis("", low=0, high=1)
    shown = subplots or [Subplot(empty, empty, [], otherwise)]
    return Chart(in_rows(shown), about, table, 900.0 if len(shown) > 1 else 560.0)


def _tornadoes(numbers: StudyNumbers) -> Chart:
    names = {number.path: number.name for number in numbers.inputs}
    subplots, rows, left, reasons = list[Subplot](), list[tuple[CellValue, ...]](), 0, dict[str, str]()
    fitted = False
    for number in numbers.outputs:
        swings = tornado(numbers.table.varied, number.values)
        if swings is None or not any(bar.exceeds_chance for bar in swings.bars):
            reasons[number.name] = "too few samples" if swings is None else swings.remark
            continue
        rows += [
            (number.label, bar.input, bar.low, bar.high, bar.at_low, bar.at_high, bar.slope, swings.r2)
            for bar in swings.bars
        ]
        if len(subplots) == _PANELS:
            left += 1
            continue
        bars = swings.bars[:_BARS][::-1]
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
        own_fit = bool(np.isfinite(swings.r2))
        fitted = fitted or own_fit
        across = PlotAxis(labelled("mean" if own_fit else "result", number.units))
        heading = number.name + (f"\nR² {swings.r2:.2f}" if own_fit else "")
        subplots.append(Subplot(across, upright, layers, heading, height=height))
    about = "Results with one input at its low (orange) and at its high end (blue), around one centre."
    if fitted:
        about = (
            "Means of the samples in the lowest (orange) and the highest fifth (blue) of each input. R²: the "
            "share of the variance that a linear model explains, in the logarithm of inputs spaced by it."
        )
    about = about if subplots else ""
    about += f" The first {_PANELS} of {_PANELS + left} results." if left else ""
    for reason in dict.fromkeys(reasons.values()):
        inputs = ", ".join(input_name for input_name in reasons if reasons[input_name] == reason)
        about += f" No bars for {inputs}: {reason}."
    columns = ("number", "input", "low", "high", "at low", "at high", "slope", "R²")
    table = FigureTable(columns, tuple(rows))
    return _in_pairs(subplots, about.strip(), table, "no result depends on an input")


def _indices(numbers: StudyNumbers) -> Chart:
    influences = Influences(numbers.table)
    short_names = {number.path: number.name for number in numbers.inputs}
    names = [
        ", ".join(short_names.get(input_name, input_name) for input_name in factor.split(", "))
        for factor in influences.factors
    ]
    subplots, rows, estimator = list[Subplot](), list[tuple[CellValue, ...]](), ""
    with_total = negative = False
    for number in numbers.outputs:
        indices = influences.of(number.values)
        if indices is None:
            continue
        estimator = indices.estimator
        first, error = indices.first, indices.first_error
        none = np.full(len(names), np.nan)
        total, total_error = (
            array if array is not None else none for array in (indices.total, indices.total_error)
        )
        both = bool(np.isfinite(total).any())
        with_total = with_total or both
        rows += [
            (number.label, factor_name, *map(float, parts))
            for factor_name, *parts in zip(names, first, error, total, total_error, strict=True)
        ]
        negative = negative or bool((first < 0).any() or (total < 0).any())
        if len(subplots) == _PANELS:
            continue
        order = np.argsort(np.where(np.isfinite(first), first, -1), kind="stable")[-_BARS:]
        place, zero = np.arange(len(order), dtype=float), np.zeros(len(order))
        shift, thick = (0.2, 0.35) if both else (0.0, 0.55)
        layers = list[Layer]()
        for input_name, spread, label, off in (
            (first, error, "alone", shift),
            (total, total_error, "with interactions (total)", -shift),
        )[: 1 + both]:
            percent, half = 100 * input_name[order], 100 * spread[order]
            tips = [
                f"{names[k]}: {general(100 * input_name[k], 3)} ± {general(100 * spread[k], 2)} %"
                for k in order
            ]
            cls = series_class(off < 0)
            layers.append(Bars(place + off, zero, np.clip(percent, 0, 100), label, cls, thick, True, tips))
            # Horizontal lines between the ends of the standard errors, with gaps between them.
            gap, at = np.full(len(order), np.nan), place + off
            ends = [np.clip(percent - half, 0, 100), np.clip(percent + half, 0, 100), gap]
            x, y = np.column_stack(ends).ravel(), np.column_stack([at, at, gap]).ravel()
            layers.append(Curve(x, y, "± standard error", "line", spans=False))
        upright = PlotAxis("", names=tuple(names[k] for k in order))
        height = max(70.0, 26.0 * len(order))
        across = PlotAxis("part of the variance (%)", low=0, high=100)
        subplots.append(Subplot(across, upright, layers, number.name, height=height))
    totals = " (blue) and with interactions (orange)" if with_total else ""
    about = f"Part of the variance that each input explains alone{totals}; {estimator or 'too few samples'}."
    about += " Negative estimates are drawn as 0; the table has them." if negative else ""
    columns = (
        "number",
        "input",
        "first order",
        "its standard error",
        "total order",
        "standard error of the total",
    )
    return _in_pairs(subplots, about, FigureTable(columns, tuple(rows)), "too few samples")
