"""Panels in rows and columns as one figure, under one legend."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from dynid.report.metrics import text_width
from dynid.report.plot.layers import Key
from dynid.report.plot.panel import BELOW, LABEL, Frame, Panel, fitted
from dynid.report.plot.symbols import mark_class, mark_path
from dynid.report.style import SIZE, TITLE
from dynid.report.svg import Svg

#: The width of a figure, px; that of a frame in a chart of one column; the height of a frame.
WIDTH, HEIGHT = 760.0, 250.0
_PAD, _BETWEEN, _KEY, _ROW = 12.0, 16.0, 26.0, 20.0


def chart(
    name: str,
    title: str,
    rows: Sequence[Sequence[Panel]],
    description: str = "",
    *,
    width: float = WIDTH,
    height: float = HEIGHT,
    shared: bool = False,
    keys: Iterable[Key] | None = None,
) -> str:
    """Draw panels.

    Parameters
    ----------
    name, title, description
        The figure's name, what it shows, and the same in more words for those who cannot see it.
    rows
        The panels, row by row; columns stand under each other.
    width, height
        Of the whole figure and of a frame, px.
    shared
        Whether the panels of a column have one x axis, whose numbers stand under the lowest.
    keys
        The legend; absent: what the layers say.

    Returns
    -------
    str
        An SVG document.
    """
    svg = Svg(name, title, description)
    y = _PAD + TITLE
    svg.text(_PAD, y, fitted(title, (width - 2 * _PAD) * SIZE / TITLE / 1.12), "title", anchor="start")
    if keys is None:
        keys = (key for row in rows for panel in row for layer in panel.layers for key in layer.named())
    y = _legend(svg, list(dict.fromkeys(keys)), y + 8, width)
    columns = _columns(rows, width, height)
    for number, row in enumerate(rows):
        y += (20 if any(panel.title for panel in row) else 10) + (8 if number and not shared else 0)
        above = len(rows[number + 1]) if shared and number + 1 < len(rows) else 0
        y += _row(svg, row, columns, y, height, above)
    return svg.render(width, y + _PAD)


class _Column(NamedTuple):
    """Where the frames of a column stand: left edge, width, and the margin to the left, px."""

    left: float
    width: float
    margin: float


def _columns(rows: Sequence[Sequence[Panel]], width: float, height: float) -> list[_Column]:
    """Share the width among columns, each with the widest margin that one of its panels needs."""
    panels = [[row[place] for row in rows if place < len(row)] for place in range(max(map(len, rows)))]
    margins = [max(panel.margin(panel.height or height) for panel in column) for column in panels]
    weights = [max(panel.weight for panel in column) for column in panels]
    free = width - 2 * _PAD - sum(margins) - _BETWEEN * (len(panels) - 1)
    columns, x = [], _PAD
    for margin, weight in zip(margins, weights, strict=True):
        x += margin
        columns.append(_Column(x, free * weight / sum(weights), margin))
        x += columns[-1].width + _BETWEEN
    return columns


def _row(
    svg: Svg, row: Sequence[Panel], columns: Sequence[_Column], y: float, height: float, above: int
) -> float:
    """Draw a row of panels, the first of which stand above others with the same x axis; return its height."""
    beneath = 0.0
    for place, (panel, column) in enumerate(zip(row, columns, strict=False)):
        labelled = place >= above
        frame: Frame = panel.frame(column.left, y, column.width, panel.height or height)
        panel.draw(svg, frame, margin=column.margin, labelled=labelled)
        beneath = max(beneath, (BELOW + (LABEL if panel.x.label else 0.0)) if labelled else 0.0)
    return max(panel.height or height for panel in row) + beneath


def _legend(svg: Svg, keys: Sequence[Key], y: float, width: float) -> float:
    """Draw the legend in rows; return where it ends."""
    if not keys:
        return y
    x, y = _PAD, y + _ROW - 2
    svg.open("legend")
    for key in keys:
        label = fitted(key.label, width - 2 * _PAD - _KEY)
        needed = _KEY + text_width(label) + 18
        if x > _PAD and x + needed > width:
            x, y = _PAD, y + _ROW
        _symbol(svg, key, x, y - 4)
        svg.text(x + _KEY, y, label, anchor="start")
        x += needed
    svg.close()
    return y + 4


def _symbol(svg: Svg, key: Key, x: float, y: float) -> None:
    if key.shown == "line":
        svg.line((x, y), (x + 20, y), cls=key.cls)
    elif key.shown == "band":
        svg.rect(x, y - 5, 20, 10, f"{key.cls} band")
    else:
        svg.element("path", mark_class(key.shown, key.cls), d=mark_path(key.shown, x + 10, y, 4))
