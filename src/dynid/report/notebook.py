"""Results in notebooks: the screen as HTML, and figures on axes of matplotlib instead of SVG."""

from __future__ import annotations

import re
from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from dynid.errors import UsageError
from dynid.report.plot.chart import Subplot, declared
from dynid.report.plot.heatmap import Heatmap
from dynid.report.plot.layers import Annotation, Band, Bars, Curve, Layer, Markers, ReferenceLine
from dynid.report.registry import figures
from dynid.suggestions import did_you_mean, shortened

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from dynid.report.content.blocks import Block
    from dynid.result import Result

#: Most rows of a table that are shown.
_ROWS = 12
#: Markers of matplotlib by the symbols of figures; hollow ones are not filled.
_SYMBOLS = {"o": "o", "ring": "o", "x": "x", "+": "+", "square": "s", "diamond": "D", "kite": "D"}
_HOLLOW = ("ring", "kite")


def html(result: Result) -> str:
    """Return a result as HTML for a notebook: title, method, and each section of its report, folded."""
    from dynid.report.content import content

    found = content(result)
    parts = [f"<p><strong>{escape(result.title or result.kind)}</strong><br>{escape(found.method)}</p>"]
    for place, section in enumerate(found.sections):
        blocks = "".join(_block(block) for block in section.blocks)
        state = " open" if place == 0 else ""
        parts.append(f"<details{state}><summary>{escape(section.title)}</summary>{blocks}</details>")
    return f"<div>{''.join(parts)}</div>"


def _block(block: Block) -> str:
    from dynid.report.content.blocks import DefinitionList, Statement, TextTable

    if isinstance(block, Statement):
        return f"<p>{escape(block.text)}</p>"
    if isinstance(block, DefinitionList):
        rows: Sequence[Sequence[str]] = [(term, "\n".join(lines)) for term, lines in block.items]
        return _table((), rows)
    if isinstance(block, TextTable):
        return _table(block.columns, block.rows)
    items = [f"<li><code>{escape(item)}</code></li>" for item in block.items[:_ROWS]]
    return f"<ol>{''.join(items)}</ol>{_more(len(block.items))}"


def _table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    head = "".join(f"<th>{escape(name)}</th>" for name in columns)
    body = "".join(f"<tr>{''.join(f'<td>{_cell(cell)}</td>' for cell in row)}</tr>" for row in rows[:_ROWS])
    return f"<table>{f'<tr>{head}</tr>' if head else ''}{body}</table>{_more(len(rows))}"


def _cell(text: str) -> str:
    return escape(text).replace("\n", "<br>")


def _more(count: int) -> str:
    return f"<p>… {count - _ROWS} more in the result</p>" if count > _ROWS else ""


def axes(result: Result, name: str) -> Any:
    """Draw a figure of a result by matplotlib, in the style of its rcParams.

    Parameters
    ----------
    result
        The result.
    name
        The name of the figure, as ``dynid plot --list`` prints it.

    Returns
    -------
    matplotlib.axes.Axes or numpy.ndarray of them
        The axes; of a figure with several subplots an array (rows x columns).

    Raises
    ------
    UsageError
        If there is no such figure, or it is a drawing without axes.
    """
    import matplotlib.pyplot as plt

    every = {figure.name: figure for figure in figures(result)}
    if name not in every:
        close = did_you_mean(name, every)
        raise UsageError(f"the result has no figure '{name}'{close}", remedy=f"It has {shortened([*every])}.")
    charts: list[Sequence[Sequence[Subplot]]] = []
    token = declared.set(charts)
    try:
        every[name].draw()
    finally:
        declared.reset(token)
    if len(charts) != 1:
        raise UsageError(
            f"the figure '{name}' is a drawing without axes", remedy="Write it to a file: dynid plot."
        )
    (rows,) = charts
    width = max(map(len, rows))
    figure, grid = plt.subplots(len(rows), width, squeeze=False, layout="constrained")
    figure.suptitle(every[name].title)
    for row, places in zip(rows, grid, strict=True):
        for plot, place in zip(row, places, strict=False):
            _draw(plot, place)
        for empty in places[len(row) :]:
            empty.set_axis_off()
    return grid[0, 0] if grid.size == 1 else grid


def _draw(plot: Subplot, ax: Axes) -> None:
    """Draw a subplot: its layers, scales, labels and legend."""
    for layer in plot.layers:
        _draw_layer(layer, ax)
    ax.set(xlabel=plot.x.label, ylabel=plot.y.label, title=plot.title)
    for axis, scale, ticks in (
        (plot.x, ax.set_xscale, ax.set_xticks),
        (plot.y, ax.set_yscale, ax.set_yticks),
    ):
        if axis.names:
            ticks(range(len(axis.names)), axis.names)
        else:
            scale("log" if axis.log else "linear")
    if plot.square:  # the view is widened in one direction
        x, y = plot.scales
        ax.update_datalim([(x.low, y.low), (x.high, y.high)])
        ax.autoscale_view()
        ax.set_aspect("equal", adjustable="datalim")
    else:
        ax.set(xlim=(plot.x.low, plot.x.high), ylim=(plot.y.low, plot.y.high))
    if ax.get_legend_handles_labels()[1]:
        ax.legend()


def _draw_layer(layer: Layer, ax: Axes) -> None:
    from matplotlib.lines import Line2D

    cls = getattr(layer, "cls", "")
    style: dict[str, Any] = {"color": _colour(cls), "label": getattr(layer, "label", "") or None}
    line = "--" if "dash" in cls else "-"
    match layer:
        case Curve() if not layer.spans:  # part of the grid, which the axes need not contain
            ax.add_artist(Line2D(np.asarray(layer.x), np.asarray(layer.y), color="lightgray", linewidth=0.6))
        case Curve():
            ax.plot(np.asarray(layer.x), np.asarray(layer.y), linestyle=line, **style)
        case Band():
            ax.fill_between(
                np.asarray(layer.x), np.asarray(layer.low), np.asarray(layer.high), alpha=0.25, **style
            )
        case Markers():
            face: dict[str, Any] = {"markerfacecolor": "none"} if layer.symbol in _HOLLOW else {}
            x, y = np.atleast_1d(layer.x), np.atleast_1d(layer.y)
            ax.plot(
                x,
                y,
                linestyle="none",
                marker=_SYMBOLS[layer.symbol],
                markersize=2 * layer.size,
                **style,
                **face,
            )
        case Bars():
            low, length = np.asarray(layer.low), np.asarray(layer.high) - np.asarray(layer.low)
            if layer.flat:
                ax.barh(layer.at, length, height=layer.thick, left=low, **style)
            else:
                ax.bar(layer.at, length, width=layer.thick, bottom=low, **style)
        case ReferenceLine():
            (ax.axvline if layer.upright else ax.axhline)(layer.value, linestyle=line, **style)
        case Annotation():
            side = {"start": "left", "middle": "center", "end": "right"}[layer.anchor]
            ax.text(layer.x, layer.y, layer.text, horizontalalignment=side, color="gray", clip_on=True)
        case Heatmap():
            columns, rows = layer.borders
            signs = {"cmap": "RdBu_r", "vmin": -layer.high} if layer.low < 0 else {"vmin": layer.low}
            ax.pcolormesh(columns, rows, np.ma.masked_invalid(layer.values), vmax=layer.high, **signs)


def _colour(cls: str) -> str:
    """Return the colour of a class: that of a series in matplotlib's cycle, else gray."""
    series = re.search(r"\bs(\d)\b", cls)
    return f"C{int(series[1]) - 1}" if series else "gray"
