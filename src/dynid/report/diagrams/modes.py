"""Figures of measured modes: frequencies and MAC of each mode before and after, and MAC of all pairs."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from dynid.report.content.modes import GROUP, has_modes, modal_table
from dynid.report.figure import Figure, FigureTable, Picture
from dynid.report.plot import Layer, Markers, PlotAxis, ReferenceLine, Subplot, chart, matrix_picture

if TYPE_CHECKING:
    from dynid.result import Result


#: Title, paths of frequency error and MAC, colour and mark.
_SERIES = (
    ("start", "frequency_error_start", "mac_start", "s3", "o"),
    ("estimate", "frequency_error", "mac", "s1", "o"),
    ("frequency left out", "left_out_error", "", "s2", "+"),
    ("frequencies alone", "trade_off/frequencies/frequency_error", "trade_off/frequencies/mac", "s4", "x"),
    ("shapes alone", "trade_off/shapes/frequency_error", "trade_off/shapes/mac", "s5", "x"),
)


def figures(result: Result) -> Iterator[Figure]:
    """Yield the figures of measured modes."""
    if not has_modes(result):
        return
    yield Figure("measured-modes", "Measured modes before and after", partial(_pairs, result))
    if f"{GROUP}/mac_table" in result:
        yield Figure("mac", "MAC of measured and computed modes", partial(_tables, result))


def _pairs(result: Result) -> Picture:
    """Draw the error of each frequency and the MAC of each pair, before and after."""
    names = tuple(str(mode) for mode in result[f"{GROUP}/mode"].data)
    place = np.arange(len(names), dtype=float)
    layers: list[Layer] = []
    shown: list[Layer] = []
    for title, error, criterion, colour, mark in _SERIES:
        for path, scale, into in ((error, 100.0, layers), (criterion, 1.0, shown)):
            if f"{GROUP}/{path}" in result:
                into.append(Markers(place, scale * result[f"{GROUP}/{path}"].data, title, colour, mark, 4))
    layers.append(ReferenceLine(0.0, "", "line dashed"))
    axis = PlotAxis("mode", names=names)
    rows = [[Subplot(axis, PlotAxis("frequency error (%)"), layers, height=150.0)]]
    if shown:
        rows.append([Subplot(axis, PlotAxis("MAC"), shown, height=120.0)])
    heads, cells = modal_table(result)
    title = "Measured modes before and after"
    about = (
        "Errors of the model's frequencies, and agreement of its shapes with the measured ones (1: the same)."
    )
    return Picture(chart("measured-modes", title, rows, about), about, FigureTable(heads, tuple(cells)))


def _tables(result: Result) -> Picture:
    """Draw the MAC of all pairs, before and after."""
    rows = [str(mode) for mode in result[f"{GROUP}/mode"].data]
    columns = [str(mode) for mode in result[f"{GROUP}/computed"].data]
    each = [
        (title, np.nan_to_num(result[f"{GROUP}/{name}"].data), rows, columns, ("measured", "model"))
        for name, title in (("mac_table_start", "start"), ("mac_table", "estimate"))
    ]
    title, about = "MAC of measured and computed modes", "1: the shapes agree; 0: they are orthogonal."
    return matrix_picture("mac", title, each, (0.0, 1.0), about)
