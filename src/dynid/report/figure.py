"""Figures of a result: a name, a title, and a picture with caption and table that is drawn on demand."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

CellValue = str | bool | int | float | complex

#: Most rows of a table; the file of the result has all of them.
MOST_ROWS = 200


@dataclass(frozen=True)
class FigureTable:
    """The numbers of a figure as a table.

    Parameters
    ----------
    columns
        Headings, with units where there are any: `omega, rad/s`.
    rows
        One entry a column.
    note
        A remark on the table: the rows that it omits.
    """

    columns: tuple[str, ...]
    rows: tuple[tuple[CellValue, ...], ...]
    note: str = ""


@dataclass(frozen=True)
class Picture:
    """A figure that is drawn.

    Parameters
    ----------
    svg
        An SVG document, which may also be part of a page.
    caption
        A sentence or two.
    table
        Its contents in numbers or words; None where there is nothing to list.
    """

    svg: str
    caption: str = ""
    table: FigureTable | None = None


@dataclass(frozen=True)
class Figure:
    """A figure of a result.

    Parameters
    ----------
    name
        Unique within a result, and a valid file name: letters, digits, `-`, `_` and `.`.
    title
        Its content in a few words.
    draw
        Function that draws it.
    """

    name: str
    title: str
    draw: Callable[[], Picture]

    @cached_property
    def picture(self) -> Picture:
        """The picture, drawn once."""
        return self.draw()

    @property
    def svg(self) -> str:
        """The picture as SVG."""
        return self.picture.svg

    @property
    def caption(self) -> str:
        """The caption."""
        return self.picture.caption

    @property
    def table(self) -> FigureTable | None:
        """The table."""
        return self.picture.table


def evenly_spaced(count: int, most: int) -> list[int]:
    """Return the indices of at most so many of `count` rows, evenly spaced, first and last included."""
    if count <= most:
        return list(range(count))
    return sorted({round(place * (count - 1) / (most - 1)) for place in range(most)})


def table_of(columns: Mapping[str, ArrayLike], most: int = MOST_ROWS) -> FigureTable:
    """Return columns of equal length as a table of at most `most` rows, with unrounded values."""
    arrays = [np.asarray(values) for values in columns.values()]
    count = len(arrays[0]) if arrays else 0
    shown = evenly_spaced(count, most)
    cells = ((list(map(str, v)) if v.dtype.kind == "O" else v.tolist()) for v in (a[shown] for a in arrays))
    note = f"{len(shown)} of {count:,} rows, evenly spaced; the file has all" if len(shown) < count else ""
    return FigureTable(tuple(columns), tuple(zip(*cells, strict=True)), note)
