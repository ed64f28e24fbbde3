"""Parallel coordinates: samples as lines across upright axes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dynid.report.notation import raised
from dynid.report.plot.axis import PlotAxis, shortened
from dynid.report.plot.chart import embedded, in_parts
from dynid.report.svg import SMALL, TITLE, Svg, path_of, text_width

#: Space around, height of the axes, least distance between them, and lines above them, px.
_PAD, _HEIGHT, _APART, _LINE = 16.0, 280.0, 110.0, 14.0
#: Most characters of a name.
_LETTERS = 20
#: Colours of samples, from the lowest values on the last axis to the highest.
_HUES = ("s1", "s6", "s3", "s5", "s2")


def parallel_coordinates(
    figure: str,
    title: str,
    axes: Sequence[PlotAxis],
    values: NDArray[np.float64],
    description: str = "",
) -> str:
    """Draw samples (× axes, all finite) as lines across upright axes; the last column gives the colours."""
    svg = Svg(figure, title, description)
    top = _PAD + 2 * _LINE
    if embedded.get() is None:  # a page has the title above the figure
        svg.text(_PAD, _PAD + TITLE, title, "title", anchor="start")
        top += TITLE + _LINE
    heads = []  # of every axis its name and its units, one below the other
    for axis in axes:
        name, units = in_parts(axis.label)
        heads.append([shortened(name, _LETTERS), *([f"({units})"] if units else [])])
    widest = max(text_width(line, SMALL, bold=True) for head in heads for line in head)
    apart = max(_APART, widest + 12)
    left = _PAD + widest / 2 + 10
    scales = [axis.scale([column]) for axis, column in zip(axes, values.T, strict=True)]
    across = (left + apart * np.arange(len(axes), dtype=float)).tolist()
    heights = [
        top + _HEIGHT * (1 - scale.share(column)) for scale, column in zip(scales, values.T, strict=True)
    ]
    _draw_lines(svg, across, np.column_stack(heights), values[:, -1])
    bottom = top + _HEIGHT
    for x, axis, head, scale in zip(across, axes, heads, scales, strict=True):
        svg.line((x, top), (x, bottom), cls="line")
        for line, text in enumerate(head):
            svg.text(x, top - 12 - _LINE * (len(head) - 1 - line), text, "small" if line else "small strong")
        ticks = axis.ticks(scale, _HEIGHT, upright=True)
        for value, text in zip(ticks.values, ticks.labels, strict=True):
            y = round(float(top + _HEIGHT * (1 - scale.share(value))), 1)
            width = text_width(text, SMALL)
            svg.line((x - 4, y), (x, y), cls="line")
            svg.rect(x - 8 - width, y - 0.6 * SMALL, width + 3, 1.2 * SMALL, "paper", fill_opacity="0.85")
            svg.text(x - 6, y + 0.35 * SMALL, text, "small tick halo", anchor="end")
        if ticks.power:
            svg.text(x, bottom + 16, f"× 10{raised(ticks.power)}", "small muted")
    width = across[-1] + widest / 2 + 10 + _PAD
    return svg.render(max(width, 2 * _PAD + text_width(title, TITLE, bold=True)), bottom + 26)


def _draw_lines(
    svg: Svg, across: list[float], places: NDArray[np.float64], last: NDArray[np.float64]
) -> None:
    """Draw the samples, coloured by the ranks of their last values."""
    order = np.argsort(last, kind="stable")
    share = np.empty(len(order))
    share[order] = np.arange(len(order)) / max(len(order) - 1, 1)
    faint = f"{float(np.clip(12 / np.sqrt(len(order) + 1), 0.18, 0.9)):.2f}"
    for shade, hue in enumerate(_HUES):  # one path a colour
        own = np.flatnonzero(np.minimum((share * len(_HUES)).astype(int), len(_HUES) - 1) == shade)
        if own.size:
            lines = (zip(across, np.round(places[k], 1).tolist(), strict=True) for k in own)
            svg.element("path", f"{hue} fine", d="".join(map(path_of, lines)), stroke_opacity=faint)
