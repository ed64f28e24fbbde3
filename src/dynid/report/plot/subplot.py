"""Subplots: two axes with layers of curves, bands, markers, bars, reference lines and annotations."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dynid.report.labels import raised
from dynid.report.plot.axis import PlotAxis, Scale, Ticks
from dynid.report.plot.decimation import decimated, runs
from dynid.report.style import SERIES, SIZE, SMALL, text_width
from dynid.report.svg import Point, Svg, path_of, plain

#: Space for the ticks of an axis and for its label, px.
BELOW, LABEL, GAP = 18.0, 18.0, 7.0
#: Length by which the label of an axis may exceed it, px, both ends together.
_BESIDE = 24.0

Extent = tuple[Sequence[ArrayLike], Sequence[ArrayLike]]


def series_class(place: int, dash: bool | None = None) -> str:
    """Return the classes of the n-th series; after the last colour they begin again with dashes."""
    turn, place = divmod(place, len(SERIES))
    name = SERIES[place]
    return f"{name} dash" if (turn > 0 if dash is None else dash) else name


def symbol_class(symbol: str, cls: str) -> str:
    """Return the classes of a symbol of a series."""
    return f"{cls} dot" if symbol in ("o", "square", "diamond") else f"{cls} fine"


def symbol_path(symbol: str, x: float, y: float, r: float) -> str:
    """Return the path data of a symbol."""
    a, b, c = f"{x:.6g}", f"{y:.6g}", f"{r:.3g}"
    if symbol in ("o", "ring"):
        return f"M{x - r:.6g} {b}a{c} {c} 0 1 0 {2 * r:.3g} 0a{c} {c} 0 1 0 {-2 * r:.3g} 0"
    if symbol == "x":
        return f"M{x - r:.6g} {y - r:.6g}l{2 * r:.3g} {2 * r:.3g}m0 {-2 * r:.3g}l{-2 * r:.3g} {2 * r:.3g}"
    if symbol == "+":
        return f"M{x - r:.6g} {b}h{2 * r:.3g}M{a} {y - r:.6g}v{2 * r:.3g}"
    if symbol == "square":
        return f"M{x - r:.6g} {y - r:.6g}h{2 * r:.3g}v{2 * r:.3g}h{-2 * r:.3g}z"
    return f"M{x - r:.6g} {b}l{c} {-r:.3g}l{c} {c}l{-r:.3g} {c}z"


class LegendEntry(NamedTuple):
    """An entry of the legend: its label, its symbol (`line`, `band` or that of markers) and its classes."""

    label: str
    symbol: str
    cls: str


@dataclass(frozen=True)
class PlotArea:
    """The area of a subplot in which data are drawn, px, with its scales."""

    left: float
    top: float
    width: float
    height: float
    x: Scale
    y: Scale

    def at_x(self, values: ArrayLike) -> NDArray[np.float64]:
        """Return the positions of values along x."""
        return self.left + self.width * self.x.share(values)

    def at_y(self, values: ArrayLike) -> NDArray[np.float64]:
        """Return the positions of values along y."""
        return self.top + self.height * (1 - self.y.share(values))


class Layer(Protocol):
    """Data drawn on two axes."""

    @property
    def gridded(self) -> bool:
        """True if the grid of the axes is visible behind it."""

    def extent(self) -> Extent:
        """Return the values of x and of y that the axes must contain."""

    def legend(self) -> Iterable[LegendEntry]:
        """Return its entries in the legend."""

    def draw(self, svg: Svg, area: PlotArea) -> None:
        """Draw it."""


class _GriddedLayer:
    """Base of layers on a visible grid, with at most one legend entry of their label and classes."""

    label: str = ""
    cls: str = ""
    symbol: str = "line"

    @property
    def gridded(self) -> bool:
        """True: the grid is visible."""
        return True

    def legend(self) -> Iterable[LegendEntry]:
        """Return the entry of its label; none without a label."""
        return [LegendEntry(self.label, self.symbol, self.cls)] if self.label else []


@dataclass(frozen=True)
class Curve(_GriddedLayer):
    """A line through points, interrupted where a value is not finite.

    Parameters
    ----------
    x, y
        Its points.
    label
        Its label in the legend; empty: no entry.
    cls
        Its classes: `series_class(0)`, `s2 fine`, `grid`.
    spans
        True if the axes must contain it.
    name
        Its name where a script reads its values; absent: the label, and without one the label of the y axis.
    """

    x: ArrayLike
    y: ArrayLike
    label: str = ""
    cls: str = "s1"
    spans: bool = True
    name: str = ""

    def extent(self) -> Extent:
        """Return its values."""
        return ([self.x], [self.y]) if self.spans else ([], [])

    def draw(self, svg: Svg, area: PlotArea) -> None:
        """Draw it."""
        x, y = area.at_x(self.x), np.clip(area.at_y(self.y), -1e4, 1e4)
        pieces = [path_of(_rounded(*decimated(*run))) for run in runs(x, y)]
        if pieces:
            # A curve that the axes need not contain is part of the grid; its values are not read.
            named = {"data_name": self.name or self.label} if self.spans else {}
            svg.element("path", self.cls, d="".join(pieces), stroke_linejoin="round", **named)


@dataclass(frozen=True)
class Band(_GriddedLayer):
    """The area between two curves."""

    x: ArrayLike
    low: ArrayLike
    high: ArrayLike
    label: str = ""
    cls: str = "s1"
    symbol = "band"

    def extent(self) -> Extent:
        """Return its values."""
        return [self.x], [self.low, self.high]

    def draw(self, svg: Svg, area: PlotArea) -> None:
        """Fill it."""
        x = area.at_x(self.x)
        low, high = (np.clip(area.at_y(side), -1e4, 1e4) for side in (self.low, self.high))
        known = np.isfinite(low) & np.isfinite(high)
        low, high = np.where(known, low, np.nan), np.where(known, high, np.nan)
        for (x_low, y_low), (x_high, y_high) in zip(runs(x, low), runs(x, high), strict=True):
            there, back = _rounded(*decimated(x_low, y_low, 0.5)), _rounded(*decimated(x_high, y_high, 0.5))
            svg.element("path", f"{self.cls} band", d=path_of([*there, *back[::-1]], closed=True))


@dataclass(frozen=True)
class Markers(_GriddedLayer):
    """Points, each with a text shown under the pointer.

    Parameters
    ----------
    symbol
        `o` (filled), `ring`, `x`, `+`, `square`, `diamond` or `kite` (hollow).
    size
        Its radius, px.
    tips
        One text a point, or none.
    opacity
        One value a point, or none.
    """

    x: ArrayLike
    y: ArrayLike
    label: str = ""
    cls: str = "s1"
    symbol: str = "o"
    size: float = 3.0
    tips: Sequence[str] = ()
    opacity: Sequence[float] = field(default=())

    def extent(self) -> Extent:
        """Return its values."""
        return [self.x], [self.y]

    def draw(self, svg: Svg, area: PlotArea) -> None:
        """Draw them as one path, or one by one where each has a text or an opacity."""
        x, y = np.atleast_1d(area.at_x(self.x)), np.atleast_1d(area.at_y(self.y))
        shown = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
        cls = symbol_class(self.symbol, self.cls)
        if not (len(self.tips) or len(self.opacity)):
            seen = set(zip(np.round(x[shown], 1).tolist(), np.round(y[shown], 1).tolist(), strict=True))
            if seen:
                d = "".join(symbol_path(self.symbol, a, b, self.size) for a, b in sorted(seen))
                svg.element("path", cls, d=d)
            return
        for place in shown.tolist():
            tip = f"<title>{plain(self.tips[place])}</title>" if len(self.tips) else ""
            faint = {"opacity": self.opacity[place]} if len(self.opacity) else {}
            d = symbol_path(self.symbol, float(x[place]), float(y[place]), self.size)
            svg.element("path", cls, tip, d=d, **faint)


@dataclass(frozen=True)
class Bars(_GriddedLayer):
    """Bars from a base to values.

    Parameters
    ----------
    at
        Their positions on the other axis.
    low, high
        Their ends.
    thick
        Their thickness, in values of the other axis.
    flat
        True for horizontal bars, whose ends are on x.
    """

    at: ArrayLike
    low: ArrayLike
    high: ArrayLike
    label: str = ""
    cls: str = "s1"
    thick: float = 0.7
    flat: bool = False
    tips: Sequence[str] = ()
    symbol = "square"

    def extent(self) -> Extent:
        """Return their ends and borders."""
        at = np.asarray(self.at, dtype=float)
        ends, places = [self.low, self.high], [at - self.thick / 2, at + self.thick / 2]
        return (ends, places) if self.flat else (places, ends)

    def draw(self, svg: Svg, area: PlotArea) -> None:
        """Draw them."""
        at = np.atleast_1d(np.asarray(self.at, dtype=float))
        along, across = (area.at_x, area.at_y) if self.flat else (area.at_y, area.at_x)
        a, b = across(at - self.thick / 2), across(at + self.thick / 2)
        low = along(np.broadcast_to(np.asarray(self.low, dtype=float), at.shape))
        high = along(np.broadcast_to(np.asarray(self.high, dtype=float), at.shape))
        for place in np.flatnonzero(np.isfinite(low) & np.isfinite(high)).tolist():
            tip = f"<title>{plain(self.tips[place])}</title>" if len(self.tips) else ""
            start, size = min(low[place], high[place]), abs(high[place] - low[place])
            side, thick = min(a[place], b[place]), abs(b[place] - a[place])
            box = (start, side, size, thick) if self.flat else (side, start, thick, size)
            x, y, width, height = map(float, box)
            svg.element("rect", f"{self.cls} dot", tip, x=x, y=y, width=width, height=height)


@dataclass(frozen=True)
class ReferenceLine(_GriddedLayer):
    """A straight line across the subplot at one value of y, or of x if it is upright."""

    value: float
    label: str = ""
    cls: str = "line dashed"
    upright: bool = False
    spans: bool = True

    def extent(self) -> Extent:
        """Return its value."""
        own = [[self.value]] if self.spans else []
        return (own, []) if self.upright else ([], own)

    def draw(self, svg: Svg, area: PlotArea) -> None:
        """Draw it."""
        if self.upright:
            x = float(area.at_x(self.value))
            svg.line((x, area.top), (x, area.top + area.height), cls=self.cls)
        else:
            y = float(area.at_y(self.value))
            svg.line((area.left, y), (area.left + area.width, y), cls=self.cls)


@dataclass(frozen=True)
class Annotation(_GriddedLayer):
    """A text at a point, which the axes need not contain."""

    x: float
    y: float
    text: str
    cls: str = "small muted"
    anchor: str = "start"
    shift: tuple[float, float] = (0.0, 0.0)

    def extent(self) -> Extent:
        """Return no values."""
        return [], []

    def draw(self, svg: Svg, area: PlotArea) -> None:
        """Write it, if it fits into the area."""
        x, y = float(area.at_x(self.x)) + self.shift[0], float(area.at_y(self.y)) + self.shift[1]
        width = text_width(self.text, SMALL)
        left = x - width * {"start": 0.0, "middle": 0.5, "end": 1.0}[self.anchor]
        inside = area.left <= left and left + width <= area.left + area.width
        if inside and area.top + SMALL <= y <= area.top + area.height - 2:
            svg.text(x, y, self.text, self.cls, anchor=self.anchor)


def _rounded(x: NDArray[np.float64], y: NDArray[np.float64]) -> list[Point]:
    return list(zip(np.round(x, 1).tolist(), np.round(y, 1).tolist(), strict=True))


@dataclass(frozen=True)
class Subplot:
    """Two axes and the layers between them.

    Parameters
    ----------
    x, y
        The axes.
    layers
        The layers, the lowest first.
    title
        The text above it.
    height
        Height of the plot area, px; absent: that of the chart.
    square
        True if equal differences have equal lengths on both axes.
    weight
        Share of a row's width, relative to its other subplots.
    """

    x: PlotAxis
    y: PlotAxis
    layers: Sequence[Layer] = field(default=())
    title: str = ""
    height: float | None = None
    square: bool = False
    weight: float = 1.0

    @property
    def scales(self) -> tuple[Scale, Scale]:
        """The scales that contain all layers."""
        across = (values for layer in self.layers for values in layer.extent()[0])
        up = (values for layer in self.layers for values in layer.extent()[1])
        return self.x.scale(across), self.y.scale(up)

    def margin(self, height: float) -> float:
        """Return the width of the upright axis with its label, px."""
        ticks = self.y.ticks(self.scales[1], height, upright=True)
        return ticks.width + GAP + (LABEL if self.y.label else 0.0) + 4

    def area(self, left: float, top: float, width: float, height: float) -> PlotArea:
        """Return the area of its data at a place and of a size."""
        x, y = self.scales
        if self.square:  # widen one of the scales
            across, up, aspect = x.high - x.low, y.high - y.low, width / height
            scale, span = (x, up * aspect) if across < up * aspect else (y, across / aspect)
            middle = (scale.low + scale.high) / 2
            widened = replace(scale, low=middle - span / 2, high=middle + span / 2)
            x, y = (widened, y) if scale is x else (x, widened)
        return PlotArea(left, top, width, height, x, y)

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
        )
        if all(layer.gridded for layer in self.layers):
            self._draw_grid(svg, area, across, up)
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
        below, beside = _with_power(self.x.label, across), _with_power(self.y.label, up)
        if below and labelled:
            text, cls = fitted_label(below, area.width + _BESIDE)
            svg.text(area.left + area.width / 2, bottom + BELOW + SMALL + 5, text, cls)
        if beside:
            text, cls = fitted_label(beside, area.height + 6)
            x, y = area.left - margin + LABEL - 4, area.top + area.height / 2
            svg.text(x, y, text, cls, transform=f"rotate(-90 {x:.6g} {y:.6g})")
        if self.title:
            svg.text(area.left + area.width / 2, area.top - 7, self.title, "strong")
        svg.close()

    def _draw_grid(self, svg: Svg, area: PlotArea, across: Ticks, up: Ticks) -> None:
        right, bottom = area.left + area.width, area.top + area.height
        pieces = []
        if not self.x.names:
            for x in np.round(area.at_x((*across.values, *across.minor)), 1):
                pieces.append(f"M{x:.6g} {area.top:.6g}V{bottom:.6g}")
        if not self.y.names:
            for y in np.round(area.at_y((*up.values, *up.minor)), 1):
                pieces.append(f"M{area.left:.6g} {y:.6g}H{right:.6g}")
        if pieces:
            svg.element("path", "grid", d="".join(pieces))


def _with_power(label: str, ticks: Ticks) -> str:
    """Return the label of an axis with the power of ten of its ticks before the units.

    An axis without a label belongs to a grid of subplots, whose edge has both.
    """
    if not (ticks.power and label):
        return label
    power = f"10{raised(ticks.power)}"
    head, bracket, unit = label.rpartition(" (")
    return f"{head} ({power} {unit}" if bracket and unit.endswith(")") else f"{label} ({power})"


def fitted_label(text: str, space: float) -> tuple[str, str]:
    """Return the label of an axis and its classes: small, then shortened in its middle, where space is short.

    Labels mostly differ at their ends: a name first, an entry and the units last.
    """
    if text_width(text, SIZE) <= space:
        return text, "label"
    kept = len(text)
    shown = text
    while kept > 2 and text_width(shown, SMALL) > space:
        kept -= 1
        shown = f"{text[: kept // 3]}…{text[len(text) - (kept - kept // 3) :]}"
    return shown, "label small"


def fitted(text: str, space: float) -> str:
    """Return a text, cut off with an ellipsis where it is wider than its space, px."""
    if text_width(text, SIZE) <= space:
        return text
    while len(text) > 1 and text_width(f"{text}…", SIZE) > space:
        text = text[:-1]
    return f"{text}…"
