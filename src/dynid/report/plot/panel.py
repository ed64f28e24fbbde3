"""A panel: two axes with what is drawn between them, and where it stands in a figure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dynid.report.metrics import text_width
from dynid.report.numbers import raised
from dynid.report.plot.axis import Axis, Scale, Ticks
from dynid.report.style import SIZE, SMALL

if TYPE_CHECKING:
    from dynid.report.plot.layers import Layer
    from dynid.report.svg import Svg

#: Space for an axis's ticks and their label, px.
BELOW, LABEL, GAP = 18.0, 18.0, 7.0
#: How far the label of an axis may reach beyond its ends, px, both sides together.
_BESIDE = 24.0


@dataclass(frozen=True)
class Frame:
    """Where a panel's data are drawn, px, and on which scales."""

    left: float
    top: float
    width: float
    height: float
    x: Scale
    y: Scale

    def at_x(self, values: ArrayLike) -> NDArray[np.float64]:
        """Return the places of values along x."""
        return self.left + self.width * self.x.share(values)

    def at_y(self, values: ArrayLike) -> NDArray[np.float64]:
        """Return the places of values along y."""
        return self.top + self.height * (1 - self.y.share(values))


@dataclass(frozen=True)
class Panel:
    """Two axes and what is drawn between them.

    Parameters
    ----------
    x, y
        The axes.
    layers
        What is drawn, the first undermost.
    title
        What stands over it.
    height
        Of the data's frame, px; absent: the chart's.
    square
        Whether equal differences are equally long on both axes.
    weight
        Share of a row's width, relative to its other panels.
    """

    x: Axis
    y: Axis
    layers: Sequence[Layer] = field(default=())
    title: str = ""
    height: float | None = None
    square: bool = False
    weight: float = 1.0

    @property
    def scales(self) -> tuple[Scale, Scale]:
        """The scales that hold all of its layers."""
        across = (values for layer in self.layers for values in layer.extent()[0])
        up = (values for layer in self.layers for values in layer.extent()[1])
        return self.x.scale(across), self.y.scale(up)

    def margin(self, height: float) -> float:
        """Return the width that the upright axis takes, px."""
        ticks = self.y.ticks(self.scales[1], height, upright=True)
        return ticks.width + GAP + (LABEL if self.y.label else 0.0) + 4

    def frame(self, left: float, top: float, width: float, height: float) -> Frame:
        """Return where its data are drawn, in a place of this size."""
        x, y = self.scales
        if self.square:
            x, y = _equal(x, y, width / height)
        return Frame(left, top, width, height, x, y)

    def draw(self, svg: Svg, frame: Frame, *, margin: float, labelled: bool = True) -> None:
        """Draw it in a frame with a margin to its left; unlabelled where the panel below has the same x."""
        across = self.x.ticks(frame.x, frame.width, upright=False)
        up = self.y.ticks(frame.y, frame.height, upright=True)
        box = " ".join(f"{value:.6g}" for value in (frame.left, frame.top, frame.width, frame.height))
        svg.open(
            "plot",
            data_box=box,
            data_x=str(frame.x),
            data_y=str(frame.y),
            data_x_label=self.x.label,
            data_y_label=self.y.label,
        )
        self._grid(svg, frame, across, up)
        clip = svg.id()
        svg.open("", clip_path=f"url(#{clip})")
        svg.raw(f'<clipPath id="{clip}">')
        svg.rect(frame.left - 1, frame.top - 1, frame.width + 2, frame.height + 2, "")
        svg.raw("</clipPath>")
        for layer in self.layers:
            layer.draw(svg, frame)
        svg.close()
        svg.rect(frame.left, frame.top, frame.width, frame.height, "frame")
        self._numbers(svg, frame, across if labelled else Ticks((), ()), up)
        x_label, y_label = _with_power(self.x.label, across), _with_power(self.y.label, up)
        self._labels(svg, frame, x_label if labelled else "", y_label, frame.left - margin + LABEL - 4)
        svg.close()

    def _labels(self, svg: Svg, frame: Frame, below: str, beside: str, x: float) -> None:
        """Write the label of the x axis below, that of the y axis upright at x, and the title above."""
        middle, y = frame.left + frame.width / 2, frame.top + frame.height / 2
        if below:
            text, cls = fitted_label(below, frame.width + _BESIDE)
            svg.text(middle, frame.top + frame.height + BELOW + SMALL + 5, text, cls)
        if beside:
            text, cls = fitted_label(beside, frame.height + 6)
            svg.text(x, y, text, cls, transform=f"rotate(-90 {x:.6g} {y:.6g})")
        if self.title:
            svg.text(middle, frame.top - 7, self.title, "strong")

    def _grid(self, svg: Svg, frame: Frame, across: Ticks, up: Ticks) -> None:
        if any(not layer.gridded for layer in self.layers):
            return
        right, bottom = frame.left + frame.width, frame.top + frame.height
        pieces = [
            f"M{x:.6g} {frame.top:.6g}V{bottom:.6g}"
            for ticks in ((*across.values, *across.minor),)
            for x in np.round(frame.at_x(ticks), 1)
            if not self.x.names
        ]
        pieces += [
            f"M{frame.left:.6g} {y:.6g}H{right:.6g}"
            for ticks in ((*up.values, *up.minor),)
            for y in np.round(frame.at_y(ticks), 1)
            if not self.y.names
        ]
        if pieces:
            svg.element("path", "grid", d="".join(pieces))

    def _numbers(self, svg: Svg, frame: Frame, across: Ticks, up: Ticks) -> None:
        bottom = frame.top + frame.height
        for x, text in zip(np.round(frame.at_x(across.values), 1), across.labels, strict=True):
            svg.text(float(x), bottom + SMALL + 4, text, "small tick")
        for y, text in zip(np.round(frame.at_y(up.values), 1), up.labels, strict=True):
            svg.text(frame.left - GAP, float(y) + 0.35 * SMALL, text, "small tick", anchor="end")


def _with_power(label: str, ticks: Ticks) -> str:
    """Return an axis's label, with the power of ten of its numbers before the units.

    An axis without a label is one of a grid, which says both at its edge.
    """
    if not (ticks.power and label):
        return label
    power = f"10{raised(ticks.power)}"
    head, bracket, unit = label.rpartition(" (")
    return f"{head} ({power} {unit}" if bracket and unit.endswith(")") else f"{label} ({power})"


def _equal(x: Scale, y: Scale, aspect: float) -> tuple[Scale, Scale]:
    """Widen one of two scales until equal differences are equally long."""
    across, up = x.high - x.low, y.high - y.low
    if across < up * aspect:
        return _widened(x, up * aspect), y
    return x, _widened(y, across / aspect)


def _widened(scale: Scale, span: float) -> Scale:
    middle = (scale.low + scale.high) / 2
    return replace(scale, low=middle - span / 2, high=middle + span / 2)


def fitted_label(text: str, room: float) -> tuple[str, str]:
    """Return the label of an axis and its classes: small, then cut in its middle, where room is short.

    What tells labels apart mostly stands at their ends: a name first, an entry and the units last.
    """
    if text_width(text, SIZE) <= room:
        return text, "label"
    kept = len(text)
    shown = text
    while kept > 2 and text_width(shown, SMALL) > room:
        kept -= 1
        shown = f"{text[: kept // 3]}…{text[len(text) - (kept - kept // 3) :]}"
    return shown, "label small"


def fitted(text: str, room: float) -> str:
    """Return a text, cut with an ellipsis where it is wider than its room, px."""
    if text_width(text, SIZE) <= room:
        return text
    while len(text) > 1 and text_width(f"{text}…", SIZE) > room:
        text = text[:-1]
    return f"{text}…"
