"""Layers of plots: curves, bands, markers, bars, reference lines and annotations; decimation of polylines."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dynid.arrays import Array
from dynid.report.figure import LegendEntry
from dynid.report.plot.axis import Scale
from dynid.report.svg import SERIES, SMALL, Point, Svg, path_of, plain, text_width

Extent = tuple[Sequence[ArrayLike], Sequence[ArrayLike]]


def series_class(number: int, dash: bool | None = None) -> str:
    """Return the classes of the n-th series; after the last colour they begin again with dashes."""
    turn, number = divmod(number, len(SERIES))
    name = SERIES[number]
    return f"{name} dash" if (turn > 0 if dash is None else dash) else name


def symbol_class(symbol: str, cls: str) -> str:
    """Return the classes of a symbol of a series."""
    return f"{cls} dot" if symbol in ("o", "square", "diamond", "up", "down") else f"{cls} fine"


def symbol_path(symbol: str, x: float, y: float, r: float) -> str:
    """Return the path data of a symbol."""
    a, b, c = f"{x:.6g}", f"{y:.6g}", f"{r:.3g}"
    if symbol in ("o", "ring"):
        return f"M{x - r:.6g} {b}a{c} {c} 0 1 0 {2 * r:.3g} 0a{c} {c} 0 1 0 {-2 * r:.3g} 0"
    if symbol == "x":
        return f"M{x - r:.6g} {y - r:.6g}l{2 * r:.3g} {2 * r:.3g}m0 {-2 * r:.3g}l{-2 * r:.3g} {2 * r:.3g}"
    if symbol == "+":
        return f"M{x - r:.6g} {b}h{2 * r:.3g}M{a} {y - r:.6g}v{2 * r:.3g}"
    if symbol in ("up", "down"):
        rise = -r if symbol == "up" else r
        return f"M{x - r:.6g} {y - 0.7 * rise:.6g}h{2 * r:.3g}l{-r:.3g} {1.7 * rise:.3g}z"
    if symbol == "square":
        return f"M{x - r:.6g} {y - r:.6g}h{2 * r:.3g}v{2 * r:.3g}h{-2 * r:.3g}z"
    return f"M{x - r:.6g} {b}l{c} {-r:.3g}l{c} {c}l{-r:.3g} {c}z"


def legend_key(entry: LegendEntry, x: float, y: float) -> tuple[str, str]:
    """Return classes and path data of the key of an entry of a legend, 20 px wide from x on, around y."""
    match entry.symbol:
        case "line":
            return entry.cls, path_of([(x, y), (x + 20, y)])
        case "band":
            corners = [(x, y - 5), (x + 20, y - 5), (x + 20, y + 5), (x, y + 5)]
            return f"{entry.cls} band", path_of(corners, closed=True)
    return symbol_class(entry.symbol, entry.cls), symbol_path(entry.symbol, x + 10, y, 4)


@dataclass(frozen=True)
class PlotArea:
    """The area of a subplot in which data are drawn, px, with its scales and the boxes of texts in it.

    Of dense samples each `column`, px wide, has the extremes.
    """

    left: float
    top: float
    width: float
    height: float
    x: Scale
    y: Scale
    column: float = 1.0
    texts: list[tuple[float, float, float, float]] = field(default_factory=list)

    def at_x(self, values: ArrayLike) -> NDArray[np.float64]:
        """Return the positions of values along x."""
        return self.left + self.width * self.x.share(values)

    def at_y(self, values: ArrayLike) -> NDArray[np.float64]:
        """Return the positions of values along y."""
        return self.top + self.height * (1 - self.y.share(values))


class Layer:
    """Data drawn on two axes, with at most one legend entry of its label and classes."""

    label: str = ""
    cls: str = ""
    symbol: str = "line"
    #: True if the grid of the axes is visible behind it.
    gridded: ClassVar[bool] = True

    def extent(self) -> Extent:
        """Return the values of x and of y that the axes must contain."""
        return [], []

    def legend(self) -> Iterable[LegendEntry]:
        """Return the entry of its label; none without a label."""
        return [LegendEntry(self.label, self.symbol, self.cls)] if self.label else []

    def draw(self, svg: Svg, area: PlotArea) -> None:
        """Draw it."""
        raise NotImplementedError


@dataclass(frozen=True)
class Curve(Layer):
    """A line through points, interrupted where a value is not finite.

    `cls` are its classes: `series_class(0)`, `s2 fine`, `grid`; the axes contain it if it `spans` them. A
    script reads its values under `name`, by default the label, else that of the y axis; `along` are the
    values of a parameter at the points of a locus, such as the frequency. Of a curve that is the `difference`
    of two others over the same x, records store these alone.
    """

    x: ArrayLike
    y: ArrayLike
    label: str = ""
    cls: str = "s1"
    spans: bool = True
    name: str = ""
    along: ArrayLike | None = None
    difference: tuple[Curve, Curve] | None = None

    def extent(self) -> Extent:
        """Return its values."""
        return ([self.x], [self.y]) if self.spans else ([], [])

    def draw(self, svg: Svg, area: PlotArea) -> None:
        """Draw it."""
        x, y = area.at_x(self.x), np.clip(area.at_y(self.y), -1e4, 1e4)
        pieces, places = list[str](), list[float]()
        if self.along is None:
            pieces = [path_of(_rounded(*decimated(a, b, column=area.column))) for a, b in runs(x, y)]
        else:
            values = np.asarray(self.along)
            for run_x, run_y, run_at in runs(x, y, values):
                kept = spread(run_x, run_y)
                pieces.append(path_of(_rounded(run_x[kept], run_y[kept])))
                places += run_at[kept].tolist()
        if pieces:
            # A curve that the axes need not contain is part of the grid; its values are not read.
            named = {"data_name": self.name or self.label} if self.spans else {}
            if places:
                named["data_along"] = " ".join(f"{value:.5g}" for value in places)
            svg.element("path", self.cls, d="".join(pieces), stroke_linejoin="round", **named)


@dataclass(frozen=True)
class BandLayer(Layer):
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
        finite = np.isfinite(low) & np.isfinite(high)
        low, high = np.where(finite, low, np.nan), np.where(finite, high, np.nan)
        for (x_low, y_low), (x_high, y_high) in zip(runs(x, low), runs(x, high), strict=True):
            there, back = (
                _rounded(*decimated(x_side, y_side, 0.5, area.column))
                for x_side, y_side in ((x_low, y_low), (x_high, y_high))
            )
            svg.element("path", f"{self.cls} band", d=path_of([*there, *back[::-1]], closed=True))


@dataclass(frozen=True)
class Markers(Layer):
    """Points, each with a text shown under the pointer, and an opacity, if any.

    Symbols: `o` (filled), `ring`, `x`, `+`, `square`, `diamond`, `up`, `down` (triangles) or `kite` (hollow),
    of a radius in px.
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
        for index in shown.tolist():
            tip = f"<title>{plain(self.tips[index])}</title>" if len(self.tips) else ""
            faint = {"opacity": self.opacity[index]} if len(self.opacity) else {}
            d = symbol_path(self.symbol, float(x[index]), float(y[index]), self.size)
            svg.element("path", cls, tip, d=d, **faint)


@dataclass(frozen=True)
class Bars(Layer):
    """Bars between values, `thick` in values of the other axis; horizontal ones are `flat`."""

    at: ArrayLike
    low: ArrayLike
    high: ArrayLike
    label: str = ""
    cls: str = "s1"
    thick: ArrayLike = 0.7
    flat: bool = False
    tips: Sequence[str] = ()
    symbol = "square"

    def extent(self) -> Extent:
        """Return their ends and borders."""
        at, half = np.asarray(self.at, dtype=float), np.asarray(self.thick, dtype=float) / 2
        ends, places = [self.low, self.high], [at - half, at + half]
        return (ends, places) if self.flat else (places, ends)

    def draw(self, svg: Svg, area: PlotArea) -> None:
        """Draw them."""
        at, half = np.atleast_1d(np.asarray(self.at, dtype=float)), np.asarray(self.thick, dtype=float) / 2
        along, across = (area.at_x, area.at_y) if self.flat else (area.at_y, area.at_x)
        a, b = across(at - half), across(at + half)
        low = along(np.broadcast_to(np.asarray(self.low, dtype=float), at.shape))
        high = along(np.broadcast_to(np.asarray(self.high, dtype=float), at.shape))
        for index in np.flatnonzero(np.isfinite(low) & np.isfinite(high)).tolist():
            tip = f"<title>{plain(self.tips[index])}</title>" if len(self.tips) else ""
            start, size = min(low[index], high[index]), abs(high[index] - low[index])
            side, thick = min(a[index], b[index]), abs(b[index] - a[index])
            box = (start, side, size, thick) if self.flat else (side, start, thick, size)
            x, y, width, height = map(float, box)
            svg.element("rect", f"{self.cls} dot", tip, x=x, y=y, width=width, height=height)


@dataclass(frozen=True)
class ReferenceLine(Layer):
    """A straight line across the subplot at one value of y, or of x if it is upright."""

    value: float
    label: str = ""
    cls: str = "line dashed"
    upright: bool = False

    def extent(self) -> Extent:
        """Return its value."""
        return ([[self.value]], []) if self.upright else ([], [[self.value]])

    def draw(self, svg: Svg, area: PlotArea) -> None:
        """Draw it."""
        if self.upright:
            x = float(area.at_x(self.value))
            svg.line((x, area.top), (x, area.top + area.height), cls=self.cls)
        else:
            y = float(area.at_y(self.value))
            svg.line((area.left, y), (area.left + area.width, y), cls=self.cls)


@dataclass(frozen=True)
class Annotation(Layer):
    """A text at a point, which the axes need not contain; it is omitted where it would be on another one."""

    x: float
    y: float
    text: str
    cls: str = "small muted"
    anchor: str = "start"
    shift: tuple[float, float] = (0.0, 0.0)

    def draw(self, svg: Svg, area: PlotArea) -> None:
        """Write it, if it fits into the area."""
        x, y = float(area.at_x(self.x)) + self.shift[0], float(area.at_y(self.y)) + self.shift[1]
        width = text_width(self.text, SMALL)
        left = x - width * {"start": 0.0, "middle": 0.5, "end": 1.0}[self.anchor]
        inside = area.left <= left and left + width <= area.left + area.width
        box = (left, y - SMALL, left + width, y + 2)
        free = not any(
            box[0] < b[2] and b[0] < box[2] and box[1] < b[3] and b[1] < box[3] for b in area.texts
        )
        if inside and free and area.top + SMALL <= y <= area.top + area.height - 2:
            area.texts.append(box)
            svg.text(x, y, self.text, self.cls, anchor=self.anchor)


def _rounded(x: NDArray[np.float64], y: NDArray[np.float64]) -> list[Point]:
    return list(zip(np.round(x, 1).tolist(), np.round(y, 1).tolist(), strict=True))


#: Greatest distance from the line between its neighbours, px, at which a point is dropped.
NEAR = 0.08


def runs(x: Array, y: Array, *also: Array) -> Iterator[tuple[Array, ...]]:
    """Yield the runs of finite points of a line, with other values at the points."""
    finite = np.isfinite(x) & np.isfinite(y)
    edges = np.flatnonzero(np.diff(finite.astype(np.int8), prepend=0, append=0))
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        yield x[start:stop], y[start:stop], *(values[start:stop] for values in also)


def by_column(x: Array, y: Array, *, ends: bool = True) -> NDArray[np.intp]:
    """Return the indices of the first, lowest, highest and last point of each pixel column.

    Positions are in px, x not decreasing. The picture stays the same to the pixel (M4, Jugel et al. 2014);
    without the `ends` of columns it has the extremes.
    """
    columns = np.floor(x).astype(np.int64)
    starts = np.flatnonzero(np.diff(columns, prepend=columns[0] - 1))
    if (4 if ends else 2) * len(starts) >= len(x):
        return np.arange(len(x))
    stops = np.append(starts[1:], len(x))
    owner = np.repeat(np.arange(len(starts)), stops - starts)
    kept = np.zeros(len(x), dtype=bool)
    kept[starts] = kept[stops - 1] = ends
    kept[[0, -1]] = True
    for extreme in (np.minimum, np.maximum):
        hits = np.flatnonzero(y == extreme.reduceat(y, starts)[owner])
        kept[hits[_firsts(owner[hits])]] = True
    return np.flatnonzero(kept)


def _firsts(ascending: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return the index of the first occurrence of each value of an ascending array."""
    return np.flatnonzero(np.diff(ascending, prepend=ascending[:1] - 1))


def straightened(x: Array, y: Array, near: float = NEAR) -> NDArray[np.intp]:
    """Return the indices of the points that remain when those on straight stretches are dropped.

    Extremes of y and the ends always remain; no dropped point is further than `near` from the line.
    """
    count = len(x)
    if count < 3:
        return np.arange(count)
    # The directions from a point that remains within `near` of all later points form a cone.
    kept, xs, ys = [0], x.tolist(), y.tolist()
    at_x, at_y, before = xs[0], ys[0], ys[0]
    low, high = -math.inf, math.inf
    ahead = zip(xs[1:], ys[1:], xs[2:], ys[2:], strict=False)
    for index, (here_x, here, after_x, after) in enumerate(ahead, 1):
        dx, dy = here_x - at_x, here - at_y
        if dx > 0:
            low_slope, high_slope = (dy - near) / dx, (dy + near) / dx
            low = low_slope if low_slope > low else low
            high = high_slope if high_slope < high else high
        turns = (here - before) * (after - here) <= 0 and dy != 0
        if turns or dx <= 0 or after_x <= at_x or not low <= (after - at_y) / (after_x - at_x) <= high:
            kept.append(index)
            at_x, at_y, low, high = here_x, here, -math.inf, math.inf
        before = here
    return np.array([*kept, count - 1])


def decimated(x: Array, y: Array, near: float = NEAR, column: float = 1.0) -> tuple[Array, Array]:
    """Return the decimated points of a line, px; one that goes back in x keeps a point every 0.5 px."""
    if len(x) > 2 and np.all(np.diff(x) >= 0):
        kept = by_column(x / column, y, ends=column == 1)
        x, y = x[kept], y[kept]
        kept = straightened(x, y, near)
        return x[kept], y[kept]
    kept = spread(x, y)
    return x[kept], y[kept]


def spread(x: Array, y: Array) -> NDArray[np.intp]:
    """Return the indices of points of a line every 0.5 px along it, and of its end."""
    moved = np.hypot(np.diff(x), np.diff(y))
    cell = np.floor(np.concatenate([[0.0], np.cumsum(moved)]) / 0.5).astype(np.int64)
    kept = _firsts(cell)
    return kept if kept[-1] == len(x) - 1 else np.append(kept, len(x) - 1)
