"""A matrix as cells on axes: how opaque a cell is says how large its value is."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dynid.report.metrics import text_width
from dynid.report.plot.layers import Extent, Key
from dynid.report.style import SMALL
from dynid.report.svg import plain

if TYPE_CHECKING:
    from dynid.report.plot.panel import Frame
    from dynid.report.svg import Svg

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
