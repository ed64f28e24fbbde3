"""What is drawn on axes: lines, bands, marks, bars, rules and notes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dynid.report.metrics import text_width
from dynid.report.plot.symbols import mark_class, mark_path
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


def _points(x: NDArray[np.float64], y: NDArray[np.float64]) -> list[tuple[float, float]]:
    return list(zip(np.round(x, 1).tolist(), np.round(y, 1).tolist(), strict=True))
