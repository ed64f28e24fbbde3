"""Reduced models against the full model: frequency responses (Yang, Fig. 7), natural frequencies, MAC."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np

from dynid.report.diagrams.responses import frequencies
from dynid.report.figure import CellValue, Figure, FigureTable, table_of
from dynid.report.notation import labelled, short, texts
from dynid.report.plot import (
    Chart,
    Curve,
    Layer,
    Markers,
    Matrix,
    PlotAxis,
    Subplot,
    in_rows,
    matrix_chart,
    series_class,
)
from dynid.report.scenes import frequency_unit
from dynid.result import Result

#: Most responses that are drawn.
RESPONSES = 6
# Errors of frequencies are drawn from here on: smaller ones are round-off, which would take half the axis.
_LEAST_ERROR = 1e-6
_SYMBOLS = ("o", "square", "diamond", "ring", "x", "+")


def figures(result: Result) -> Iterator[Figure]:
    """Yield the comparison of all methods with the full model."""
    methods = texts(result, "reduction/method")
    if "reduction/frf/full" in result:
        title = "Frequency responses before and after reduction"
        yield Figure("reduction-frf", title, partial(_responses, result, methods))
    compared = [method for method in methods if f"reduction/{method}/frequency_error" in result]
    if compared:
        title = "Frequencies of the reduced models"
        yield Figure("reduction-frequencies", title, partial(_frequencies, result, compared))
    matrices: list[Matrix] = []
    for method in methods:
        if (mac := result.get(f"reduction/{method}/mac")) is not None:
            rows, columns = (texts(result, f"reduction/{method}/{axis}") for axis in ("mode", "full_mode"))
            matrices.append((method, mac.data, rows, columns, ("reduced mode", "full mode")))
    if matrices:
        about = "1: the modes of the reduced and of the full model have the same shape; 0: orthogonal shapes."
        draw = partial(matrix_chart, matrices, (0.0, 1.0), about)
        yield Figure("mac", "Modal assurance criterion", draw)


def _responses(result: Result, methods: Sequence[str]) -> Chart:
    group = "reduction/frf"
    at = frequencies(result, f"{group}/omega")
    outputs, inputs = texts(result, f"{group}/output"), texts(result, f"{group}/input")
    full = result[f"{group}/full"]
    units = texts(result, f"{group}/unit") or [full.units] * len(outputs)
    shown = [method for method in methods if f"{group}/{method}" in result]
    subplots, columns = [], dict(at.columns)
    for row, output in enumerate(outputs):
        for column, source in enumerate(inputs):
            pair = f"{output} / {source}"
            curves = {"full": full.data[:, row, column]}
            curves |= {method: result[f"{group}/{method}"].data[:, row, column] for method in shown}
            classes = ["bond", *(series_class(index, True) for index in range(len(shown)))]
            layers: list[Layer] = [
                Curve(at.shown, np.abs(values), name, cls)
                for cls, (name, values) in zip(classes, curves.items(), strict=True)
            ]
            upright = PlotAxis(labelled(pair, units[row]), log=True)
            subplots.append(Subplot(at.axis, upright, layers, height=230.0))
            columns |= {f"|{pair}|, {name}": np.abs(values) for name, values in curves.items()}
    left = f" The first {RESPONSES} of {len(subplots)} responses." if len(subplots) > RESPONSES else ""
    about = f"Deviations from the full model: errors of reduced modes, or modes that a method omits.{left}"
    return Chart(in_rows(subplots[:RESPONSES], 1), about, table_of(columns), shared=True)


def _frequencies(result: Result, methods: Sequence[str]) -> Chart:
    layers: list[Layer] = []
    rows: list[tuple[CellValue, ...]] = []
    unit = frequency_unit(result)
    for index, method in enumerate(methods):
        get = {
            name: result[f"reduction/{method}/{name}"].data
            for name in ("mode", "frequencies", "reference", "frequency_error")
        }
        get |= {name: unit.factor * get[name] for name in ("frequencies", "reference")}
        modes, error = get["mode"], np.abs(get["frequency_error"])
        percent = 100 * np.maximum(error, _LEAST_ERROR)
        tips = [f"{method}, mode {m}: {short(100 * e, 2)} %" for m, e in zip(modes, error, strict=True)]
        layers += [
            Curve(modes, percent, "", series_class(index, True) + " fine", name=method),
            Markers(modes, percent, method, series_class(index), _SYMBOLS[index % 6], 4, tips),
        ]
        rows += [(method, *map(float, row)) for row in zip(*get.values(), strict=True)]
    about = "Relative error of the natural frequencies; errors below 10⁻⁴ % are drawn there."
    plot = Subplot(PlotAxis("mode", step=1), PlotAxis("frequency error (%)", log=True), layers)
    heading, full = f"frequency ({unit.name})", f"of the full model ({unit.name})"
    columns = ("method", "mode", heading, full, "relative error")
    return Chart([[plot]], about, FigureTable(columns, tuple(rows)))
