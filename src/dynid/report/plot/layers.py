"""What is drawn on axes: lines, bands, marks, bars, rules, cells and notes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dynid.report.metrics import text_width
from dynid.report.plot.thin import runs, thin
from dynid.report.style import SERIES, SMALL
from dynid.report.svg import path_of, plain

if TYPE_CHECKING:
    from dynid.report.plot.panel import Frame
    from dynid.report.svg import Svg

Extent = tuple[Sequence[ArrayLike], Sequence[ArrayLike]]


class _Gridded:
    """What lets the grid of the axes show."""

    @property
    def gridded(self) -> bool:
        """Let it show."""
        return True


class Key(NamedTuple):
    """How a layer is named in the legend: its text, how it is shown, and in which classes."""

    label: str
    shown: str
    cls: str


class Layer(Protocol):
    """Something on axes."""

    @property
    def gridded(self) -> bool:
        """Whether the grid of the axes may show through it."""

    def extent(self) -> Extent:
        """Return the values that the axes must hold."""

    def named(self) -> Iterable[Key]:
        """Yield what the legend says of it."""

    def draw(self, svg: Svg, frame: Frame) -> None:
        """Draw it."""


def hue(place: int, dash: bool | None = None) -> str:
    """Return the classes of the n-th series; after the last colour they begin again with dashes."""
    turn, place = divmod(place, len(SERIES))
    name = SERIES[place]
    return f"{name} dash" if (turn > 0 if dash is None else dash) else name


@dataclass(frozen=True)
class Line(_Gridded):
    """A line; broken where a value is not finite.

    Parameters
    ----------
    x, y
        Its points.
    label
        Its name in the legend; empty: not there.
    cls
        Its classes: `hue(0)`, `s2 fine`, `grid`.
    spans
        Whether the axes must hold it.
    """

    x: ArrayLike
    y: ArrayLike
    label: str = ""
    cls: str = "s1"
    spans: bool = True

    def extent(self) -> Extent:
        """Return its values."""
        return ([self.x], [self.y]) if self.spans else ([], [])

    def named(self) -> Iterable[Key]:
        """Name the line."""
        return [Key(self.label, "line", self.cls)] if self.label else []

    def draw(self, svg: Svg, frame: Frame) -> None:
        """Draw it."""
        x, y = frame.at_x(self.x), np.clip(frame.at_y(self.y), -1e4, 1e4)
        pieces = [path_of(_points(*thin(*run))) for run in runs(x, y)]
        if pieces:
            named = {"data_name": self.label} if self.label else {}
            svg.element("path", self.cls, d="".join(pieces), stroke_linejoin="round", **named)


@dataclass(frozen=True)
class Band(_Gridded):
    """What lies between two lines."""

    x: ArrayLike
    low: ArrayLike
    high: ArrayLike
    label: str = ""
    cls: str = "s1"

    def extent(self) -> Extent:
        """Return its values."""
        return [self.x], [self.low, self.high]

    def named(self) -> Iterable[Key]:
        """Name the band."""
        return [Key(self.label, "band", self.cls)] if self.label else []

    def draw(self, svg: Svg, frame: Frame) -> None:
        """Fill it."""
        x = frame.at_x(self.x)
        low, high = (np.clip(frame.at_y(side), -1e4, 1e4) for side in (self.low, self.high))
        known = np.isfinite(low) & np.isfinite(high)
        low, high = np.where(known, low, np.nan), np.where(known, high, np.nan)
        for (x_low, y_low), (x_high, y_high) in zip(runs(x, low), runs(x, high), strict=True):
            there, back = _points(*thin(x_low, y_low, 0.5)), _points(*thin(x_high, y_high, 0.5))
            svg.element("path", f"{self.cls} band", d=path_of([*there, *back[::-1]], closed=True))


@dataclass(frozen=True)
class Marks(_Gridded):
    """Points, each with a text that shows under the pointer.

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

    def named(self) -> Iterable[Key]:
        """Name the points."""
        return [Key(self.label, self.symbol, self.cls)] if self.label else []

    def draw(self, svg: Svg, frame: Frame) -> None:
        """Draw all of them: as one path, or one by one where each has a text."""
        x, y = np.atleast_1d(frame.at_x(self.x)), np.atleast_1d(frame.at_y(self.y))
        shown = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
        cls = mark_class(self.symbol, self.cls)
        if not (len(self.tips) or len(self.opacity)):
            seen = set(zip(np.round(x[shown], 1).tolist(), np.round(y[shown], 1).tolist(), strict=True))
            if seen:
                d = "".join(mark_path(self.symbol, a, b, self.size) for a, b in sorted(seen))
                named = {"data_name": self.label} if self.label else {}
                svg.element("path", cls, d=d, **named)
            return
        for place in shown.tolist():
            tip = f"<title>{plain(self.tips[place])}</title>" if len(self.tips) else ""
            faint = {"opacity": self.opacity[place]} if len(self.opacity) else {}
            d = mark_path(self.symbol, float(x[place]), float(y[place]), self.size)
            svg.element("path", cls, tip, d=d, **faint)


@dataclass(frozen=True)
class Bars(_Gridded):
    """Bars from a base to values.

    Parameters
    ----------
    at
        Where the bars are on the other axis.
    low, high
        Their ends.
    thick
        Their thickness, in values of the other axis.
    flat
        Whether they lie: their ends on x.
    """

    at: ArrayLike
    low: ArrayLike
    high: ArrayLike
    label: str = ""
    cls: str = "s1"
    thick: float = 0.7
    flat: bool = False
    tips: Sequence[str] = ()

    def extent(self) -> Extent:
        """Return its values."""
        at = np.asarray(self.at, dtype=float)
        ends, places = [self.low, self.high], [at - self.thick / 2, at + self.thick / 2]
        return (ends, places) if self.flat else (places, ends)

    def named(self) -> Iterable[Key]:
        """Name the bars."""
        return [Key(self.label, "square", self.cls)] if self.label else []

    def draw(self, svg: Svg, frame: Frame) -> None:
        """Draw all of them."""
        at = np.atleast_1d(np.asarray(self.at, dtype=float))
        along, across = (frame.at_x, frame.at_y) if self.flat else (frame.at_y, frame.at_x)
        a, b = across(at - self.thick / 2), across(at + self.thick / 2)
        low = along(np.broadcast_to(np.asarray(self.low, dtype=float), at.shape))
        high = along(np.broadcast_to(np.asarray(self.high, dtype=float), at.shape))
        for place in np.flatnonzero(np.isfinite(low) & np.isfinite(high)).tolist():
            tip = f"<title>{plain(self.tips[place])}</title>" if len(self.tips) else ""
            start, size = min(low[place], high[place]), abs(high[place] - low[place])
            side, thick = min(a[place], b[place]), abs(b[place] - a[place])
            box = (start, side, size, thick) if self.flat else (side, start, thick, size)
            svg.element(
                "rect",
                f"{self.cls} dot",
                tip,
                **dict(zip(("x", "y", "width", "height"), map(float, box), strict=True)),
            )


@dataclass(frozen=True)
class Rule(_Gridded):
    """A straight line across the panel at one value of y, or of x where it is upright."""

    value: float
    label: str = ""
    cls: str = "line dashed"
    upright: bool = False
    spans: bool = True

    def extent(self) -> Extent:
        """Return its value."""
        own = [[self.value]] if self.spans else []
        return (own, []) if self.upright else ([], own)

    def named(self) -> Iterable[Key]:
        """Name it."""
        return [Key(self.label, "line", self.cls)] if self.label else []

    def draw(self, svg: Svg, frame: Frame) -> None:
        """Draw it."""
        if self.upright:
            x = float(frame.at_x(self.value))
            svg.line((x, frame.top), (x, frame.top + frame.height), cls=self.cls)
        else:
            y = float(frame.at_y(self.value))
            svg.line((frame.left, y), (frame.left + frame.width, y), cls=self.cls)


#: The most opaque that a cell with a text in it is, and one without.
WRITTEN, BLANK = 0.55, 0.95
_SHADES = 10


@dataclass(frozen=True)
class Cells:
    """A matrix as cells, the first row at the top; how opaque a cell is says how large its value is.

    Parameters
    ----------
    values
        Rows × columns; what is not finite stays empty.
    low, high
        The values that are fully clear and fully opaque; below zero another colour, where `low` is below.
    texts
        What is written in the cells, rows × columns, or nothing.
    tips
        What shows under the pointer.
    edges
        Where columns and rows end on the axes; absent: at whole numbers ± ½.
    """

    values: NDArray[np.float64]
    low: float
    high: float
    texts: Sequence[Sequence[str]] = ()
    tips: Sequence[Sequence[str]] = ()
    edges: tuple[ArrayLike, ArrayLike] | None = None

    def _edges(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        if self.edges is not None:
            return np.asarray(self.edges[0], dtype=float), np.asarray(self.edges[1], dtype=float)
        rows, columns = self.values.shape
        return np.arange(columns + 1) - 0.5, np.arange(rows + 1) - 0.5

    def extent(self) -> Extent:
        """Return the outermost edges."""
        x, y = self._edges()
        return [x], [y]

    def named(self) -> Iterable[Key]:
        """Say nothing: cells have a bar of colours instead."""
        return []

    def opacity(self, value: float) -> float:
        """Return how opaque a value is."""
        signed = self.low < 0
        top = max(abs(self.low), abs(self.high)) if signed else self.high - self.low
        share = abs(value) / top if signed else (value - self.low) / top if top > 0 else 1.0
        most = WRITTEN if self.texts else BLANK
        return most * float(np.clip(share, 0, 1))

    def draw(self, svg: Svg, frame: Frame) -> None:
        """Draw all of them."""
        x, y = self._edges()
        across, up = np.round(frame.at_x(x), 1), np.round(frame.at_y(y), 1)
        if len(self.texts) or len(self.tips):
            self._one_by_one(svg, across, up)
        else:
            self._by_shade(svg, across, up)

    def _one_by_one(self, svg: Svg, across: NDArray[np.float64], up: NDArray[np.float64]) -> None:
        room = float(np.abs(np.diff(across)).min()) - 4
        written = float(np.abs(np.diff(up)).min()) >= SMALL
        for row, column in np.argwhere(np.isfinite(self.values)).tolist():
            value = float(self.values[row, column])
            left, right = sorted((float(across[column]), float(across[column + 1])))
            top, bottom = sorted((float(up[row]), float(up[row + 1])))
            tip = f"<title>{plain(self.tips[row][column])}</title>" if len(self.tips) else ""
            box = {"x": left, "y": top, "width": right - left, "height": bottom - top}
            svg.element("rect", self._hue(value), tip, **box, fill_opacity=f"{self.opacity(value):.3f}")
            text = self.texts[row][column] if len(self.texts) else ""
            if text and written and text_width(text, SMALL) <= room:
                svg.text((left + right) / 2, (top + bottom) / 2 + 0.35 * SMALL, text, "small")

    def _by_shade(self, svg: Svg, across: NDArray[np.float64], up: NDArray[np.float64]) -> None:
        """Draw cells of about the same value as one path."""
        shades: dict[tuple[str, float], list[str]] = {}
        for row, column in np.argwhere(np.isfinite(self.values)).tolist():
            value = float(self.values[row, column])
            wide, tall = across[column + 1] - across[column], up[row + 1] - up[row]
            shade = self._hue(value), math.ceil(_SHADES * self.opacity(value)) / _SHADES
            cell = f"M{across[column]:.6g} {up[row]:.6g}h{wide:.3g}v{tall:.3g}h{-wide:.3g}z"
            shades.setdefault(shade, []).append(cell)
        for (cls, opacity), cells in sorted(shades.items()):
            svg.element("path", cls, d="".join(cells), fill_opacity=f"{opacity:.3f}")

    def _hue(self, value: float) -> str:
        return "s2 dot" if value < 0 and self.low < 0 else "s1 dot"

    @property
    def gridded(self) -> bool:
        """Hide it: opaqueness means something."""
        return False


@dataclass(frozen=True)
class Note(_Gridded):
    """A text at a place; the axes need not hold it."""

    x: float
    y: float
    text: str
    cls: str = "small muted"
    anchor: str = "start"
    shift: tuple[float, float] = (0.0, 0.0)

    def extent(self) -> Extent:
        """Return nothing."""
        return [], []

    def named(self) -> Iterable[Key]:
        """Say nothing."""
        return []

    def draw(self, svg: Svg, frame: Frame) -> None:
        """Write it, where it has room within the frame."""
        x, y = float(frame.at_x(self.x)) + self.shift[0], float(frame.at_y(self.y)) + self.shift[1]
        width = text_width(self.text, SMALL)
        left = x - width * {"start": 0.0, "middle": 0.5, "end": 1.0}[self.anchor]
        inside = frame.left <= left and left + width <= frame.left + frame.width
        if inside and frame.top + SMALL <= y <= frame.top + frame.height - 2:
            svg.text(x, y, self.text, self.cls, anchor=self.anchor)


def mark_class(symbol: str, cls: str) -> str:
    """Return the classes of a symbol of a series."""
    return f"{cls} dot" if symbol in ("o", "square", "diamond") else f"{cls} fine"


def mark_path(symbol: str, x: float, y: float, r: float) -> str:
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


def _points(x: NDArray[np.float64], y: NDArray[np.float64]) -> list[tuple[float, float]]:
    return list(zip(np.round(x, 1).tolist(), np.round(y, 1).tolist(), strict=True))
