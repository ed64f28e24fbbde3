"""Figures of measured modes: frequencies, MAC before and after, and shapes at the sensors."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from dynid.report.content.modes import GROUP, has_modes, modal_table
from dynid.report.drawing.space import GROUP as SPACE
from dynid.report.drawing.space import Space
from dynid.report.figure import CellValue, Figure, FigureTable, Picture
from dynid.report.notation import short
from dynid.report.plot import Layer, Markers, PlotAxis, ReferenceLine, Subplot, chart, matrix_picture
from dynid.report.svg import TITLE, Svg, path_of

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


_MODES, _BESIDE, _LINES = 9, 3, 700
_WIDTH, _PAD, _SPAN, _APART = 250.0, 16.0, 34.0, 60.0


def measured_shapes(result: Result) -> Iterator[Figure]:
    """Yield the measured shapes, where the places of their sensors are known."""
    if f"{SPACE}/shape_sensor" in result and f"{GROUP}/shape_measured" in result:
        yield Figure("measured-shapes", "Measured shapes", partial(_shapes, result))


def _shapes(result: Result) -> Picture:
    space = Space(result)
    names = [str(name) for name in result[f"{SPACE}/shape_sensor"].data]
    rows = [[str(name) for name in result[f"{GROUP}/sensor"].data].index(name) for name in names]
    both = [result[f"{GROUP}/{name}"].data[rows] for name in ("shape_measured", "shape")]
    # A complex shape has any phase: that of the largest real part, one for both.
    turn = np.exp(-0.5j * np.angle(np.nansum(both[0] ** 2, axis=0)))
    measured, model = (np.real(turn * one) for one in both)
    count = min(measured.shape[1], _MODES)
    places = space.flat(space.array("shape_sensor_position", 3))
    ways = space.flat(space.array("shape_sensor_direction", 3))
    lines = [rest for rest, _ in space.polylines(most=_LINES)]
    points = np.concatenate([*lines, places])
    low, high = points.min(axis=0), points.max(axis=0)
    width, height = (high - low).tolist()
    scale = _WIDTH / (max(width, height) or 1.0)
    tall = scale * height + 2 * _SPAN + 40
    svg = Svg("measured-shapes", "Measured shapes")
    svg.text(_PAD, _PAD + TITLE, "Measured shapes", "title", anchor="start")
    unit = result[f"{GROUP}/frequency_measured"].units
    for mode in range(count):
        row, column = divmod(mode, _BESIDE)
        x = _PAD + _SPAN + column * (_WIDTH + _APART)
        y = _PAD + TITLE + 22 + row * tall
        frequency = short(float(result[f"{GROUP}/frequency_measured"].data[mode]))
        heading = f"measured {mode + 1}: {frequency} {unit}"
        if f"{GROUP}/mac" in result:
            heading += f", MAC {short(float(result[f'{GROUP}/mac'].data[mode]), 3)}"
        svg.text(x + _WIDTH / 2, y + 6, heading, "small strong")
        origin = np.array([x + (_WIDTH - scale * width) / 2, y + 20 + _SPAN])

        def placed(flat: np.ndarray, origin: np.ndarray = origin) -> np.ndarray:
            return np.asarray(origin + scale * (flat - [low[0], high[1]]) * [1, -1])

        svg.element("path", "hair", d="".join(path_of(map(tuple, placed(rest).tolist())) for rest in lines))
        for shape, cls, mark in ((model, "s1", "s1"), (measured, "s2", "s2 dot")):
            largest = float(np.nanmax(np.abs(measured[:, mode]), initial=0.0)) or 1.0
            for place, way, value in zip(places, ways, shape[:, mode].tolist(), strict=True):
                if np.isnan(value):
                    continue
                start = placed(place)
                end = start + _SPAN * value / largest * way * [1, -1]
                svg.line(
                    tuple(start.tolist()), tuple(end.tolist()), cls=cls if shape is model else f"{cls} fine"
                )
                svg.circle(float(end[0]), float(end[1]), 5.0 if shape is model else 2.6, mark)
    cut = f" The first {count} of {measured.shape[1]} modes." if count < measured.shape[1] else ""
    about = "Displacements at the sensors: dots are measured, rings those of the model." + cut
    table: list[tuple[CellValue, ...]] = [
        (name, *(float(one[row, mode]) for mode in range(count) for one in (measured, model)))
        for row, name in enumerate(names[:200])
    ]
    heads = [f"{what} {mode + 1}" for mode in range(count) for what in ("measured", "model")]
    columns = min(count, _BESIDE)
    size = 2 * (_PAD + _SPAN) + columns * (_WIDTH + _APART) - _APART
    drawn = svg.render(size, _PAD + TITLE + 22 + -(-count // _BESIDE) * tall)
    return Picture(drawn, about, FigureTable(("sensor", *heads), tuple(table)))
