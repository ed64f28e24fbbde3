"""Parallel coordinates: an axis a number, a line a sample."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dynid.report.metrics import text_width
from dynid.report.numbers import raised
from dynid.report.plot.axis import Axis, Scale, shortened
from dynid.report.style import SMALL, TITLE
from dynid.report.svg import Svg, path_of

_PAD, _HEIGHT, _APART = 16.0, 280.0, 110.0
#: Colours of lines, from the lowest values on the last axis to the highest.
_HUES = ("s1", "s6", "s3", "s5", "s2")


def parallel(
    name: str, title: str, labels: Sequence[str], values: NDArray[np.float64], description: str = ""
) -> str:
    """Draw samples as lines across upright axes.

    Parameters
    ----------
    name, title, description
        The figure's name, what it shows, and the same in more words.
    labels
        One an axis.
    values
        Samples × axes, all finite. The last column gives the colours.

    Returns
    -------
    str
        An SVG document.
    """
    svg = Svg(name, title, description)
    svg.text(_PAD, _PAD + TITLE, title, "title", anchor="start")
    shown = [shortened(label, 30) for label in labels]
    widest = max(text_width(label, SMALL, bold=True) for label in shown)
    apart = max(_APART, widest + 12)
    left = _PAD + widest / 2 + 10
    top = _PAD + TITLE + 44
    scales = [Axis("").scale([column]) for column in values.T]
    across = left + apart * np.arange(len(labels), dtype=float)
    places = np.column_stack(
        [top + _HEIGHT * (1 - scale.share(column)) for scale, column in zip(scales, values.T, strict=True)]
    )
    _samples(svg, across, places, np.argsort(values[:, -1], kind="stable"))
    for x, label, scale in zip(across.tolist(), shown, scales, strict=True):
        _axis(svg, x, top, label, scale)
    width = float(across[-1]) + widest / 2 + 10 + _PAD
    return svg.render(max(width, 2 * _PAD + text_width(title, TITLE, bold=True)), top + _HEIGHT + 26)


def _samples(
    svg: Svg, across: NDArray[np.float64], places: NDArray[np.float64], order: NDArray[np.intp]
) -> None:
    """Draw the lines (samples × axes) in colours by their order, one path a colour."""
    share = np.empty(len(order))
    share[order] = np.arange(len(order)) / max(len(order) - 1, 1)
    faint = f"{float(np.clip(12 / np.sqrt(len(order) + 1), 0.18, 0.9)):.2f}"
    for shade, hue in enumerate(_HUES):
        own = np.flatnonzero(np.minimum((share * len(_HUES)).astype(int), len(_HUES) - 1) == shade)
        if own.size:
            lines = (zip(across.tolist(), np.round(places[k], 1).tolist(), strict=True) for k in own)
            svg.element("path", f"{hue} fine", d="".join(map(path_of, lines)), stroke_opacity=faint)


def _axis(svg: Svg, x: float, top: float, label: str, scale: Scale) -> None:
    svg.line((x, top), (x, top + _HEIGHT), cls="line")
    svg.text(x, top - 12, label, "small strong")
    ticks = Axis("").ticks(scale, _HEIGHT, upright=True)
    for value, text in zip(ticks.values, ticks.labels, strict=True):
        y = round(float(top + _HEIGHT * (1 - scale.share(value))), 1)
        svg.line((x - 4, y), (x, y), cls="line")
        svg.text(x - 6, y + 0.35 * SMALL, text, "small tick halo", anchor="end")
    if ticks.power:
        svg.text(x, top + _HEIGHT + 16, f"× 10{raised(ticks.power)}", "small muted")
