"""Heat maps: matrices as cells, with magnitudes as opacity and signs as colour."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dynid.report.figure import CellValue, FigureTable
from dynid.report.notation import short
from dynid.report.plot.axis import PlotAxis
from dynid.report.plot.chart import Chart, Subplot, in_rows
from dynid.report.plot.layers import Extent, Layer, PlotArea
from dynid.report.svg import SMALL, Svg, plain, text_width

#: Greatest opacity of a cell with a text in it, and of one without.
WRITTEN, BLANK = 0.55, 0.95
_SHADES = 10

#: A matrix: its title, values, the labels of rows and columns, and the labels of both axes.
Matrix = tuple[str, NDArray[np.float64], Sequence[str], Sequence[str], tuple[str, str]]
#: Most rows and columns of a matrix that are drawn; most matrices in a row.
MOST, _ROW = 40, 3
#: Columns beyond which cells have short texts.
_MANY = 10


@dataclass(frozen=True)
class Heatmap(Layer):
    """A matrix as cells, the first row at the top; the opacity of a cell is the magnitude of its value.

    `low` is transparent and `high` opaque; if `low` is negative, negative values have another colour. Cells
    that are not finite stay empty. `edges` are those of columns and rows, by default at whole numbers ± ½.
    """

    values: NDArray[np.float64]
    low: float
    high: float
    texts: Sequence[Sequence[str]] = ()
    tips: Sequence[Sequence[str]] = ()
    edges: tuple[ArrayLike, ArrayLike] | None = None
    gridded = False  # a grid behind it would change the opacity

    @property
    def borders(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The edges of its columns and rows."""
        if self.edges is not None:
            return np.asarray(self.edges[0], dtype=float), np.asarray(self.edges[1], dtype=float)
        rows, columns = self.values.shape
        return np.arange(columns + 1) - 0.5, np.arange(rows + 1) - 0.5

    def extent(self) -> Extent:
        """Return the edges."""
        x, y = self.borders
        return [x], [y]

    def opacity(self, value: float) -> float:
        """Return the opacity of a value."""
        signed = self.low < 0
        top = max(abs(self.low), abs(self.high)) if signed else self.high - self.low
        share = abs(value) / top if signed else (value - self.low) / top if top > 0 else 1.0
        max_opacity = WRITTEN if self.texts else BLANK
        return max_opacity * float(np.clip(share, 0, 1))

    def draw(self, svg: Svg, area: PlotArea) -> None:
        """Draw the cells one by one where they have texts, else cells of about the same value as one path."""
        x, y = self.borders
        across, up = np.round(area.at_x(x), 1), np.round(area.at_y(y), 1)
        one_by_one = bool(len(self.texts) or len(self.tips))
        space = float(np.abs(np.diff(across)).min()) - 4
        written = float(np.abs(np.diff(up)).min()) >= SMALL
        shades: dict[tuple[str, float], list[str]] = {}
        for row, column in np.argwhere(np.isfinite(self.values)).tolist():
            value = float(self.values[row, column])
            cls = "s2 dot" if value < 0 and self.low < 0 else "s1 dot"
            if not one_by_one:
                wide, tall = across[column + 1] - across[column], up[row + 1] - up[row]
                shade = cls, math.ceil(_SHADES * self.opacity(value)) / _SHADES
                cell = f"M{across[column]:.6g} {up[row]:.6g}h{wide:.3g}v{tall:.3g}h{-wide:.3g}z"
                shades.setdefault(shade, []).append(cell)
                continue
            left, right = sorted((float(across[column]), float(across[column + 1])))
            top, bottom = sorted((float(up[row]), float(up[row + 1])))
            tip = f"<title>{plain(self.tips[row][column])}</title>" if len(self.tips) else ""
            box = {"x": left, "y": top, "width": right - left, "height": bottom - top}
            svg.element("rect", cls, tip, **box, fill_opacity=f"{self.opacity(value):.3f}")
            text = self.texts[row][column] if len(self.texts) else ""
            if text and written and text_width(text, SMALL) <= space:
                svg.text((left + right) / 2, (top + bottom) / 2 + 0.35 * SMALL, text, "small")
        for (cls, opacity), cells in sorted(shades.items()):
            svg.element("path", cls, d="".join(cells), fill_opacity=f"{opacity:.3f}")


def _cell_text(text: str, many: bool) -> str:
    """Return a number in a cell as it is written: 0.87, or .87 without zeros among many."""
    if text and float(text) == 0:
        return "" if many else "0"
    text = text.replace("-", "−")
    return text.removesuffix(".00").replace("0.", ".") if many else text


def matrix_chart(matrices: Sequence[Matrix], ends: tuple[float, float], about: str) -> Chart:
    """Return matrices side by side, with their caption; `ends` are the least and the largest value."""
    several = len(matrices) > 1
    rows: list[tuple[CellValue, ...]] = []
    subplots = []
    for heading, values, names, others, (row_label, column_label) in matrices:
        # Axes go up, the first row is at the top.
        shown, down, across = values[:MOST, :MOST][::-1], names[:MOST][::-1], others[:MOST]
        rows += [
            (*((heading,) if several else ()), a, b, float(values[i, j]))
            for i, a in enumerate(names[:MOST])
            for j, b in enumerate(across)
        ]
        texts = [[f"{value:.2f}" if np.isfinite(value) else "" for value in row] for row in shown]
        many = len(across) > _MANY  # texts that fit into small cells, and no zeros
        texts = [[_cell_text(text, many) for text in row] for row in texts]
        tips = [
            [f"{a}, {b}: {short(float(value))}" for b, value in zip(across, row, strict=True)]
            for a, row in zip(down, shown, strict=True)
        ]
        x, y = PlotAxis(column_label, names=tuple(across)), PlotAxis(row_label, names=tuple(down))
        height = float(np.clip(26 * len(down), 60, 640))
        subplots.append(Subplot(x, y, [Heatmap(shown, *ends, texts, tips)], heading, height=height))
    widest = max(text_width(str(text), SMALL) + 14 for m in matrices for text in m[3][:MOST])
    full_width = max(len(m[3][:MOST]) for m in matrices) * max(44.0, min(widest, 110.0)) + 160
    width = float(np.clip(full_width * min(len(subplots), _ROW), 340, 900))
    head = (("matrix",) if several else ()) + ("row", "column", "value")
    cut = any(max(m[1].shape) > MOST for m in matrices)
    note = f"The first {MOST} rows and columns." if cut else ""
    table = FigureTable(head, tuple(rows[:2000]), note)
    return Chart(in_rows(subplots, _ROW), f"{about} {note}".strip(), table, width)
