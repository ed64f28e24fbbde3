"""Charts: subplots in rows and columns under one legend, and parallel coordinates."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.report.labels import raised
from dynid.report.plot.axis import PlotAxis, shortened
from dynid.report.plot.subplot import BELOW, LABEL, LegendEntry, Subplot, fitted, symbol_class, symbol_path
from dynid.report.style import SIZE, SMALL, TITLE, text_width
from dynid.report.svg import Svg, path_of

#: Width of a figure and height of a plot area, px.
WIDTH, HEIGHT = 760.0, 250.0
_PAD, _BETWEEN, _KEY, _ROW = 12.0, 16.0, 26.0, 20.0

_PARALLEL_PAD, _PARALLEL_HEIGHT, _APART = 16.0, 280.0, 110.0
#: Colours of samples in parallel coordinates, from the lowest values on the last axis to the highest.
_HUES = ("s1", "s6", "s3", "s5", "s2")


class _ColumnPlace(NamedTuple):
    """Place of the plot areas of a column: left edge, width, and the margin to the left, px."""

    left: float
    width: float
    margin: float


def chart(
    name: str,
    title: str,
    rows: Sequence[Sequence[Subplot]],
    description: str = "",
    *,
    width: float = WIDTH,
    height: float = HEIGHT,
    shared: bool = False,
    legend: Iterable[LegendEntry] | None = None,
) -> str:
    """Draw subplots.

    Parameters
    ----------
    name, title, description
        The figure's name, its title, and a description for screen readers.
    rows
        The subplots, row by row, aligned in columns.
    width, height
        Of the whole figure and of a plot area, px.
    shared
        True if the subplots of a column share one x axis, whose ticks are labelled at the lowest only.
    legend
        The legend; absent: the entries of the layers.

    Returns
    -------
    str
        An SVG document.
    """
    svg = Svg(name, title, description)
    y = _PAD + TITLE
    svg.text(_PAD, y, fitted(title, (width - 2 * _PAD) * SIZE / TITLE / 1.12), "title", anchor="start")
    if legend is None:
        legend = (entry for row in rows for plot in row for layer in plot.layers for entry in layer.legend())
    y = _draw_legend(svg, list(dict.fromkeys(legend)), y + 8, width)
    # The width is shared by columns, each with the widest margin among its subplots.
    in_columns = [[row[place] for row in rows if place < len(row)] for place in range(max(map(len, rows)))]
    margins = [max(plot.margin(plot.height or height) for plot in column) for column in in_columns]
    weights = [max(plot.weight for plot in column) for column in in_columns]
    free = width - 2 * _PAD - sum(margins) - _BETWEEN * (len(in_columns) - 1)
    columns, x = list[_ColumnPlace](), _PAD
    for margin, weight in zip(margins, weights, strict=True):
        x += margin
        columns.append(_ColumnPlace(x, free * weight / sum(weights), margin))
        x += columns[-1].width + _BETWEEN
    for number, row in enumerate(rows):
        y += (20 if any(plot.title for plot in row) else 10) + (8 if number and not shared else 0)
        above = len(rows[number + 1]) if shared and number + 1 < len(rows) else 0
        beneath = 0.0
        for place, (plot, column) in enumerate(zip(row, columns, strict=False)):
            labelled = place >= above
            area = plot.area(column.left, y, column.width, plot.height or height)
            plot.draw(svg, area, margin=column.margin, labelled=labelled)
            beneath = max(beneath, (BELOW + (LABEL if plot.x.label else 0.0)) if labelled else 0.0)
        y += max(plot.height or height for plot in row) + beneath
    return svg.render(width, y + _PAD)


def _draw_legend(svg: Svg, entries: Sequence[LegendEntry], y: float, width: float) -> float:
    """Draw the legend in rows; return its lower end."""
    if not entries:
        return y
    x, y = _PAD, y + _ROW - 2
    svg.open("legend")
    for entry in entries:
        label = fitted(entry.label, width - 2 * _PAD - _KEY)
        needed = _KEY + text_width(label) + 18
        if x > _PAD and x + needed > width:
            x, y = _PAD, y + _ROW
        if entry.symbol == "line":
            svg.line((x, y - 4), (x + 20, y - 4), cls=entry.cls)
        elif entry.symbol == "band":
            svg.rect(x, y - 4 - 5, 20, 10, f"{entry.cls} band")
        else:
            cls = symbol_class(entry.symbol, entry.cls)
            svg.element("path", cls, d=symbol_path(entry.symbol, x + 10, y - 4, 4))
        svg.text(x + _KEY, y, label, anchor="start")
        x += needed
    svg.close()
    return y + 4


def parallel_coordinates(
    name: str, title: str, labels: Sequence[str], values: NDArray[np.float64], description: str = ""
) -> str:
    """Draw samples as lines across upright axes.

    Parameters
    ----------
    name, title, description
        The figure's name, its title, and a description for screen readers.
    labels
        One an axis.
    values
        Samples × axes, all finite. The last column determines the colours.

    Returns
    -------
    str
        An SVG document.
    """
    svg = Svg(name, title, description)
    svg.text(_PARALLEL_PAD, _PARALLEL_PAD + TITLE, title, "title", anchor="start")
    shown = [shortened(label, 30) for label in labels]
    widest = max(text_width(label, SMALL, bold=True) for label in shown)
    apart = max(_APART, widest + 12)
    left = _PARALLEL_PAD + widest / 2 + 10
    top = _PARALLEL_PAD + TITLE + 44
    scales = [PlotAxis("").scale([column]) for column in values.T]
    across = (left + apart * np.arange(len(labels), dtype=float)).tolist()
    heights = [
        top + _PARALLEL_HEIGHT * (1 - scale.share(column))
        for scale, column in zip(scales, values.T, strict=True)
    ]
    places = np.column_stack(heights)
    order = np.argsort(values[:, -1], kind="stable")
    share = np.empty(len(order))
    share[order] = np.arange(len(order)) / max(len(order) - 1, 1)
    faint = f"{float(np.clip(12 / np.sqrt(len(order) + 1), 0.18, 0.9)):.2f}"
    for shade, hue in enumerate(_HUES):  # one path a colour
        own = np.flatnonzero(np.minimum((share * len(_HUES)).astype(int), len(_HUES) - 1) == shade)
        if own.size:
            lines = (zip(across, np.round(places[k], 1).tolist(), strict=True) for k in own)
            svg.element("path", f"{hue} fine", d="".join(map(path_of, lines)), stroke_opacity=faint)
    bottom = top + _PARALLEL_HEIGHT
    for x, label, scale in zip(across, shown, scales, strict=True):
        svg.line((x, top), (x, bottom), cls="line")
        svg.text(x, top - 12, label, "small strong")
        ticks = PlotAxis("").ticks(scale, _PARALLEL_HEIGHT, upright=True)
        for value, text in zip(ticks.values, ticks.labels, strict=True):
            y = round(float(top + _PARALLEL_HEIGHT * (1 - scale.share(value))), 1)
            svg.line((x - 4, y), (x, y), cls="line")
            svg.text(x - 6, y + 0.35 * SMALL, text, "small tick halo", anchor="end")
        if ticks.power:
            svg.text(x, bottom + 16, f"× 10{raised(ticks.power)}", "small muted")
    width = across[-1] + widest / 2 + 10 + _PARALLEL_PAD
    return svg.render(max(width, 2 * _PARALLEL_PAD + text_width(title, TITLE, bold=True)), bottom + 26)
