"""Matrices as cells: how opaque a cell is says how large its value is, and its colour the sign."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dynid.report.figure import Cell, Picture, Table
from dynid.report.metrics import text_width
from dynid.report.numbers import short
from dynid.report.plot import Axis, Cells, Panel, chart
from dynid.report.style import SMALL

#: A matrix: its title, values, the names of rows and columns, and what rows and columns are.
Matrix = tuple[str, NDArray[np.float64], Sequence[str], Sequence[str], tuple[str, str]]
#: The most rows and columns that are drawn.
MOST = 40
_ROW = 3


def matrix_picture(
    name: str, title: str, matrices: Sequence[Matrix], ends: tuple[float, float], about: str
) -> Picture:
    """Draw matrices side by side.

    Parameters
    ----------
    name, title, about
        The figure's name and title, and what is said under it.
    matrices
        What to draw.
    ends
        The least and the largest value there can be.
    """
    rows: list[tuple[Cell, ...]] = []
    for heading, values, names, others, _ in matrices:
        rows += [
            (*((heading,) if len(matrices) > 1 else ()), a, b, float(values[i, j]))
            for i, a in enumerate(names[:MOST])
            for j, b in enumerate(others[:MOST])
        ]
    panels = [_panel(matrix, ends) for matrix in matrices]
    grid = [panels[start : start + _ROW] for start in range(0, len(panels), _ROW)]
    widest = max(text_width(str(text), SMALL) + 14 for m in matrices for text in m[3][:MOST])
    own = max(len(m[3][:MOST]) for m in matrices) * max(44.0, min(widest, 110.0)) + 160
    width = float(np.clip(own * min(len(panels), _ROW), 340, 900))
    svg = chart(name, title, grid, about, width=width)
    head = (("which",) if len(matrices) > 1 else ()) + ("row", "column", "value")
    cut = any(max(m[1].shape) > MOST for m in matrices)
    note = f"The first {MOST} rows and columns." if cut else ""
    return Picture(svg, f"{about} {note}".strip(), Table(head, tuple(rows[:2000]), note))


def _panel(matrix: Matrix, ends: tuple[float, float]) -> Panel:
    """Return a matrix as cells; the first row at the top, though axes go up."""
    heading, values, names, others, (row_label, column_label) = matrix
    shown, down, across = values[:MOST, :MOST][::-1], names[:MOST][::-1], others[:MOST]
    texts = [[_written(float(value)) if np.isfinite(value) else "" for value in row] for row in shown]
    tips = [
        [f"{a}, {b}: {short(float(value))}" for b, value in zip(across, row, strict=True)]
        for a, row in zip(down, shown, strict=True)
    ]
    return Panel(
        Axis(column_label, names=tuple(across)),
        Axis(row_label, names=tuple(down)),
        [Cells(shown, *ends, texts, tips)],
        heading,
        height=float(np.clip(26 * len(down), 60, 640)),
    )


def _written(value: float) -> str:
    text = f"{value:.2f}"
    return (text if float(text) else "0").replace("-", "−")
