"""Charts: subplots in rows and columns under one legend.

A subplot has two axes and the layers between them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from dynid.report.figure import FigureTable, LegendEntry, Picture
from dynid.report.notation import raised
from dynid.report.plot.axis import PlotAxis, Scale, Ticks
from dynid.report.plot.layers import Layer, PlotArea, legend_key
from dynid.report.plot.record import plot_layers, thinning
from dynid.report.svg import BOLD_WIDTH, SIZE, SMALL, TITLE, Svg, text_width

#: Space for the ticks of an axis and for its label, px.
BELOW, LABEL, GAP = 18.0, 18.0, 7.0
#: Lengths by which the labels below and beside an axis may exceed it, px, both ends together.
_BESIDE, _OVER = 24.0, 6.0
#: Width of a figure and height of a plot area, px.
WIDTH, HEIGHT = 760.0, 250.0
_PAD, _BETWEEN, _KEY, _ROW, _TITLE_LINE = 12.0, 16.0, 26.0, 20.0, 15.0
#: Symbols that replace names of axes where space is short.
_SYMBOLS = {"real part": "Re", "imaginary part": "Im"}
#: Width of a chart on a page; least width and mean height of a subplot there, and of a square one, px.
NARROW, _LEAST, _LOWEST, _SQUARE = 420.0, 190.0, 64.0, 120.0
#: Width of a record on a page; mean height of its subplots; width of a column of its samples, px.
RECORD, _RECORD_LOWEST, _COLUMN = 960.0, 110.0, 3.0


@dataclass
class PageSpace:
    """Space of a chart on a page, as narrow as the screen of a phone, where it has no title.

    A chart of the width `NARROW` is at most `tallest` px high: it omits rows, and counts their subplots.
    Records may have so many `values` on the page, less those that it has already.
    """

    tallest: float = math.inf
    omitted: int = 0
    values: int = 800_000


#: The space on a page, where charts are drawn for one; None: they are not for a page.
embedded: ContextVar[PageSpace | None] = ContextVar("embedded", default=None)


@dataclass(frozen=True)
class Subplot:
    """Two axes and the layers between them, the lowest first.

    The title above it has one or two lines; `height` (px) is by default that of the chart; `square` gives
    equal differences equal lengths on both axes; `weight` is its share of a row's width. `parameter` is the
    quantity, with its unit, that its curves are over (`along` of each), or that |y| is in other units,
    `per_y` of them each: a cursor on an x axis of this label marks it here, too.
    """

    x: PlotAxis
    y: PlotAxis
    layers: Sequence[Layer] = field(default=())
    title: str = ""
    height: float | None = None
    square: bool = False
    weight: float = 1.0
    parameter: str = ""
    per_y: float = 0.0

    @cached_property
    def scales(self) -> tuple[Scale, Scale]:
        """The scales that contain all layers."""
        across = (values for layer in self.layers for values in layer.extent()[0])
        up = (values for layer in self.layers for values in layer.extent()[1])
        return self.x.scale(across), self.y.scale(up)

    def margin(self, height: float) -> float:
        """Return the width of the upright axis with its label, px."""
        ticks = self.y.ticks(self.scales[1], height, upright=True)
        return ticks.width + GAP + (LABEL if self.headings(height)[1] else 0.0) + 4

    def headings(self, height: float, *, power: bool = True) -> tuple[str, str]:
        """Return the text above it and the label beside it, at a height of the plot area, px.

        A label that is longer than its axis is above, but for its units. `power`: with that of its ticks.
        """
        ticks = self.y.ticks(self.scales[1], height, upright=True) if power else Ticks((), ())
        heading = _with_power(self.y.label, ticks)
        if self.title or text_width(heading, SMALL) <= height + _OVER:
            return self.title, heading
        name, units = in_parts(self.y.label)
        return name, " ".join(filter(None, (f"10{raised(ticks.power)}" if ticks.power else "", units)))

    def area(self, left: float, top: float, width: float, height: float, column: float = 1.0) -> PlotArea:
        """Return the area of its data at a place and of a size."""
        x, y = self.scales
        if self.square:  # widen one of the scales
            across, up, aspect = x.high - x.low, y.high - y.low, width / height
            scale, span = (x, up * aspect) if across < up * aspect else (y, across / aspect)
            middle = (scale.low + scale.high) / 2
            widened = replace(scale, low=middle - span / 2, high=middle + span / 2)
            x, y = (widened, y) if scale is x else (x, widened)
        return PlotArea(left, top, width, height, x, y, column)

    def data(self, height: float, scale: Scale) -> dict[str, Any]:
        """Return its upright axis for a script that draws records."""
        title, label = self.headings(height, power=False)
        return {
            "title": title,
            "label": label,
            "height": height,
            "y": self.y.label,
            "log": self.y.log,
            "step": self.y.step,
            "low": scale.low,
            "high": scale.high,
            "fixed": None not in (self.y.low, self.y.high),
        }

    def draw(self, svg: Svg, area: PlotArea, *, margin: float, labelled: bool = True) -> None:
        """Draw it into an area with a margin to its left; unlabelled if the subplot below has the same x."""
        across = self.x.ticks(area.x, area.width, upright=False)
        up = self.y.ticks(area.y, area.height, upright=True)
        box = " ".join(f"{value:.6g}" for value in (area.left, area.top, area.width, area.height))
        svg.open(
            "plot",
            data_box=box,
            data_x=str(area.x),
            data_y=str(area.y),
            data_x_label=self.x.label,
            data_y_label=self.y.label,
            **({"data_parameter": self.parameter} if self.parameter else {}),
            **({"data_per_y": f"{self.per_y:.6g}"} if self.per_y else {}),
        )
        if all(layer.gridded for layer in self.layers):
            right, bottom = area.left + area.width, area.top + area.height
            pieces = []
            if not self.x.names:
                at = np.round(area.at_x((*across.values, *across.minor)), 1)
                pieces += [f"M{x:.6g} {area.top:.6g}V{bottom:.6g}" for x in at]
            if not self.y.names:
                at = np.round(area.at_y((*up.values, *up.minor)), 1)
                pieces += [f"M{area.left:.6g} {y:.6g}H{right:.6g}" for y in at]
            if pieces:
                svg.element("path", "grid", d="".join(pieces))
        clip = svg.id()
        svg.open("", clip_path=f"url(#{clip})")
        svg.raw(f'<clipPath id="{clip}">')
        svg.rect(area.left - 1, area.top - 1, area.width + 2, area.height + 2, "")
        svg.raw("</clipPath>")
        for layer in self.layers:
            layer.draw(svg, area)
        svg.close()
        svg.rect(area.left, area.top, area.width, area.height, "frame")
        bottom = area.top + area.height
        if labelled:
            for x, text in zip(np.round(area.at_x(across.values), 1), across.labels, strict=True):
                svg.text(float(x), bottom + SMALL + 4, text, "small tick")
        for y, text in zip(np.round(area.at_y(up.values), 1), up.labels, strict=True):
            svg.text(area.left - GAP, float(y) + 0.35 * SMALL, text, "small tick", anchor="end")
        title, heading = self.headings(area.height)
        below = _with_power(self.x.label, across)
        if below and labelled:
            text, cls = fitted_label(below, area.width + _BESIDE)
            svg.text(area.left + area.width / 2, bottom + BELOW + SMALL + 5, text, cls)
        if heading:
            text, cls = (
                fitted_label(heading, area.height + _OVER)
                if title == self.title
                else (heading, "label small")
            )
            x, y = area.left - margin + LABEL - 4, area.top + area.height / 2
            svg.text(x, y, text, cls, transform=f"rotate(-90 {x:.6g} {y:.6g})")
        _draw_title(svg, area, title)
        svg.close()


def _draw_title(svg: Svg, area: PlotArea, title: str) -> None:
    """Write the title of a plot above it, its first line strong."""
    x, space = area.left + area.width / 2, area.width + _BETWEEN
    first, *others = title.splitlines() or [""]
    for line, line_text in enumerate(reversed(others)):
        svg.text(x, area.top - 7 - line * _TITLE_LINE, _fitted(line_text, space / BOLD_WIDTH), "small")
    if first:
        text, cls = _fitted_title(first, space)
        svg.text(x, area.top - 7 - len(others) * _TITLE_LINE, text, cls)


class _ColumnPlace(NamedTuple):
    """Place of the plot areas of a column: left edge, width, and the margin to the left, px."""

    left: float
    width: float
    margin: float


def in_rows(subplots: Sequence[Subplot], beside: int = 2) -> list[Sequence[Subplot]]:
    """Return subplots in rows, so many beside each other."""
    return [subplots[start : start + beside] for start in range(0, len(subplots), beside)]


@dataclass(frozen=True)
class Chart:
    """A figure of subplots under one legend, with its caption and its table.

    Rows of subplots are aligned in columns; `width` is that of the whole figure, `height` that of a plot
    area, px. Where x is `shared`, only the lowest subplot of a column labels it, and pages have a record:
    subplots below each other, as wide as the page. By default the legend has all layers' entries.
    """

    rows: Sequence[Sequence[Subplot]]
    caption: str = ""
    table: FigureTable | None = None
    width: float = WIDTH
    height: float = HEIGHT
    shared: bool = False
    legend: Sequence[LegendEntry] | None = None

    def picture(self, name: str, title: str) -> Picture:
        """Draw it under a title, of which a page has its own, in the space that a page has for it."""
        width, height, shared, entries = self.width, self.height, self.shared, self.legend
        if entries is None:
            layers = (layer for row in self.rows for plot in row for layer in plot.layers)
            entries = [entry for layer in layers for entry in layer.legend()]
        entries, groups = list(dict.fromkeys(entries)), [self.rows]
        page = embedded.get()
        if page is not None and shared:
            return self._record(name, title, entries, page)
        if page is None:
            svg, y = Svg(name, title, self.caption), _PAD + TITLE
            space = (width - 2 * _PAD) * SIZE / TITLE / BOLD_WIDTH
            svg.text(_PAD, y, _fitted(title, space), "title", anchor="start")
        else:
            groups, width = _narrowed(self.rows, width)
            before, y = page.omitted, -4.0
            lines = _draw_legend(Svg("", ""), entries, y + 8, width)
            space = min(1.0, width / NARROW) * page.tallest - lines - _PAD
            groups = _fitting(groups, page, space, height, shared=False)
            svg = Svg(f"{name}-first" if page.omitted > before else name, title, self.caption)
        y = _draw_legend(svg, entries, y + 8, width)
        for group in groups:
            y = _draw_rows(svg, group, y, width, height, shared)
        return Picture(svg.render(width, y + _PAD), self.caption, self.table)

    def _record(self, name: str, title: str, entries: Sequence[LegendEntry], page: PageSpace) -> Picture:
        """Draw it as a record: the legend is beside the picture, a script has the samples."""
        before = page.omitted
        single = [[plot] for row in self.rows for plot in row]
        (rows,) = _fitting([single], page, page.tallest - 2 * _ROW, self.height, shared=True)
        plots = [row[0] for row in rows]
        heights = [plot.height or self.height for plot in plots]
        svg = Svg(f"{name}-first" if page.omitted > before else name, title, self.caption)
        y = _draw_rows(svg, rows, 0.0, RECORD, self.height, shared=True, column=_COLUMN)
        across, scales = plots[-1].x, [plot.scales for plot in plots]
        every, values = thinning((layer for plot in plots for layer in plot.layers), page.values)
        page.values -= values
        logs = [(plot.x.log, plot.y.log) for plot in plots]
        layers = plot_layers([plot.layers for plot in plots], every, logs)
        data = {
            "samples": every,
            "x": {
                "label": across.label,
                "log": across.log,
                "low": min(x.low for x, _ in scales),
                "high": max(x.high for x, _ in scales),
            },
            "plots": [
                plot.data(height, y) | {"layers": of_plot}
                for plot, height, (_, y), of_plot in zip(plots, heights, scales, layers, strict=True)
            ],
        }
        return Picture(svg.render(RECORD, y + 4), self.caption, self.table, data, entries)


def _fitting(
    groups: Sequence[Sequence[Sequence[Subplot]]],
    page: PageSpace,
    space: float,
    height: float,
    *,
    shared: bool,
) -> list[Sequence[Sequence[Subplot]]]:
    """Return the rows that fit into a height, px, scaled down to it; grids of unlabelled axes stay whole.

    Records have one axis, which is `shared`, and higher plot areas.
    """
    lowest = _RECORD_LOWEST if shared else _LOWEST
    if math.isinf(space):
        return list(groups)
    rows_of_groups = [(group_index, row) for group_index, group in enumerate(groups) for row in group]
    unlabelled = any(not (plot.x.label or plot.x.names) for _, row in rows_of_groups for plot in row)
    while True:
        sizes = sum(max(plot.height or height for plot in row) for _, row in rows_of_groups)
        around = sum(_around(row, lowest, shared) for _, row in rows_of_groups)
        around += (BELOW + LABEL) * len({group_index for group_index, _ in rows_of_groups}) if shared else 0.0
        min_height = sum(_SQUARE if any(plot.square for plot in row) else lowest for _, row in rows_of_groups)
        if unlabelled or len(rows_of_groups) == 1 or space - around >= min_height:
            break
        page.omitted += len(rows_of_groups.pop()[1])
    scale = min(1.0, max(space - around, min_height) / sizes)
    return [
        [
            [replace(plot, height=scale * (plot.height or height)) for plot in row]
            for row_group, row in rows_of_groups
            if row_group == k
        ]
        for k in sorted({group_index for group_index, _ in rows_of_groups})
    ]


def _around(row: Sequence[Subplot], height: float, shared: bool) -> float:
    """Return the height of the texts above and below a row of plot areas of a height, px."""
    titles = max(len(plot.headings(height)[0].splitlines()) for plot in row)
    return _above(titles) + (0.0 if shared else BELOW + LABEL + 8)


def _above(titles: int) -> float:
    """Return the height of the lines above a row, px."""
    return 9 + _TITLE_LINE * titles if titles else 10


def _narrowed(
    rows: Sequence[Sequence[Subplot]], width: float
) -> tuple[list[Sequence[Sequence[Subplot]]], float]:
    """Return the rows in groups of fewer columns, one below the other, and the width of each.

    A grid of subplots whose inner axes have no labels stays whole.
    """
    count = max(map(len, rows))
    if any(not (plot.x.label or plot.x.names) for row in rows for plot in row):
        return [rows], width
    if any(plot.x.names for row in rows for plot in row):
        named = max(
            sum(text_width(name, SMALL) + 12 for name in plot.x.names) for row in rows for plot in row
        )
        width, limit = min(width, max(NARROW, named + 110)), 1
    else:
        few_squares = sum(map(len, rows)) <= 2 and any(plot.square for row in rows for plot in row)
        width, limit = min(width, NARROW), 1 if few_squares else int(NARROW / _LEAST)
    if count <= limit:
        return [rows], width
    return [[row[k : k + limit] for row in rows for k in range(0, len(row), limit)]], width


def _draw_rows(
    svg: Svg,
    rows: Sequence[Sequence[Subplot]],
    y: float,
    width: float,
    height: float,
    shared: bool,
    column: float = 1.0,
) -> float:
    """Draw rows of subplots aligned in columns; return their lower end.

    The width is shared by columns, each with the widest margin among its subplots.
    """
    in_columns = [[row[index] for row in rows if index < len(row)] for index in range(max(map(len, rows)))]
    margins = [max(plot.margin(plot.height or height) for plot in column) for column in in_columns]
    weights = [max(plot.weight for plot in column) for column in in_columns]
    free = width - 2 * _PAD - sum(margins) - _BETWEEN * (len(in_columns) - 1)
    columns, x = list[_ColumnPlace](), _PAD
    for margin, weight in zip(margins, weights, strict=True):
        x += margin
        columns.append(_ColumnPlace(x, free * weight / sum(weights), margin))
        x += columns[-1].width + _BETWEEN
    for number, row in enumerate(rows):
        titles = max(len(plot.headings(plot.height or height)[0].splitlines()) for plot in row)
        y += _above(titles) + (8 if number and not shared else 0)
        above = len(rows[number + 1]) if shared and number + 1 < len(rows) else 0
        beneath = 0.0
        for index, (plot, at) in enumerate(zip(row, columns, strict=False)):
            labelled = index >= above
            area = plot.area(at.left, y, at.width, plot.height or height, column)
            plot.draw(svg, area, margin=at.margin, labelled=labelled)
            beneath = max(beneath, (BELOW + (LABEL if plot.x.label else 0.0)) if labelled else 0.0)
        y += max(plot.height or height for plot in row) + beneath
    return y


def _draw_legend(svg: Svg, entries: Sequence[LegendEntry], y: float, width: float) -> float:
    """Draw the legend in rows; return its lower end."""
    if not entries:
        return y
    x, y = _PAD, y + _ROW - 2
    svg.open("legend")
    for entry in entries:
        label = _fitted(entry.label, width - 2 * _PAD - _KEY)
        needed = _KEY + text_width(label) + 18
        if x > _PAD and x + needed > width:
            x, y = _PAD, y + _ROW
        cls, key = legend_key(entry, x, y - 4)
        svg.element("path", cls, d=key)
        svg.text(x + _KEY, y, label, anchor="start")
        x += needed
    svg.close()
    return y + 4


def _with_power(label: str, ticks: Ticks) -> str:
    """Return the label of an axis with the power of ten of its ticks before the units.

    An axis without a label belongs to a grid of subplots, whose edge has both.
    """
    if not (ticks.power and label):
        return label
    power = f"10{raised(ticks.power)}"
    name, units = in_parts(label)
    return f"{name} ({power} {units})" if units else f"{label} ({power})"


def in_parts(label: str) -> tuple[str, str]:
    """Return the name and the units of a label: `time (s)`."""
    name, bracket, units = label.rpartition(" (")
    return (name, units.removesuffix(")")) if bracket and units.endswith(")") else (label, "")


def fitted_label(text: str, space: float) -> tuple[str, str]:
    """Return the label of an axis and its classes: small, then with a shorter name, where space is short.

    The shorter name is the symbol, if there is one. Other names mostly differ at their ends, so that they
    lose their middle. Units stay whole.
    """
    if text_width(text, SIZE) <= space:
        return text, "label"
    name, units = in_parts(text)
    if name in _SYMBOLS and text_width(text, SMALL) > space:
        return fitted_label(f"{_SYMBOLS[name]} ({units})" if units else _SYMBOLS[name], space)
    return _shortened(name, f" ({units})" if units else "", space), "label small"


def _fitted_title(text: str, space: float) -> tuple[str, str]:
    """Return the title of a plot and its classes: small, then without its middle, where space is short."""
    if text_width(text, SIZE, bold=True) <= space:
        return text, "strong"
    return _shortened(text, "", space / BOLD_WIDTH), "small strong"


def _shortened(name: str, end: str, space: float) -> str:
    """Return a small name with what follows it, without its middle where it is wider than a space, px."""
    kept, shown = len(name), f"{name}{end}"
    while kept > 2 and text_width(shown, SMALL) > space:
        kept -= 1
        shown = f"{name[: kept // 3]}…{name[len(name) - (kept - kept // 3) :]}{end}"
    return shown


def _fitted(text: str, space: float) -> str:
    """Return a text, cut off with an ellipsis where it is wider than its space, px."""
    if text_width(text, SIZE) <= space:
        return text
    while len(text) > 1 and text_width(f"{text}…", SIZE) > space:
        text = text[:-1]
    return f"{text}…"
