"""Measured mode shapes beside those of the model, at the sensors, over the geometry of the structure."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from dynid.report.content.modes import GROUP
from dynid.report.drawing.space import GROUP as SPACE
from dynid.report.drawing.space import Space
from dynid.report.figure import CellValue, Figure, FigureTable, Picture
from dynid.report.notation import short
from dynid.report.svg import TITLE, Svg, path_of

if TYPE_CHECKING:
    from dynid.result import Result

_MODES, _ROW, _LINES = 9, 3, 700
_WIDTH, _PAD, _SPAN, _APART = 250.0, 16.0, 34.0, 60.0


def figures(result: Result) -> Iterator[Figure]:
    """Yield the measured shapes, where the places of their sensors are known."""
    if f"{SPACE}/shape_sensor" in result and f"{GROUP}/shape_measured" in result:
        yield Figure("measured-shapes", "Measured shapes", partial(_picture, result))


def _picture(result: Result) -> Picture:
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
        row, column = divmod(mode, _ROW)
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
    columns = min(count, _ROW)
    size = 2 * (_PAD + _SPAN) + columns * (_WIDTH + _APART) - _APART
    drawn = svg.render(size, _PAD + TITLE + 22 + -(-count // _ROW) * tall)
    return Picture(drawn, about, FigureTable(("sensor", *heads), tuple(table)))
