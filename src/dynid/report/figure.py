"""Figures of a result: a name, a title, and a picture that is drawn on demand; as SVG, PNG and PDF files."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from dynid.errors import UsageError
from dynid.report.svg import COLOURS, resolved

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
    derivation
        True if it shows how a result was derived, which a page folds.
    """

    name: str
    title: str
    draw: Callable[[], Picture] = field(repr=False)
    derivation: bool = field(default=False, repr=False)

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


#: Pixels of a PNG per inch; the unit of a figure is 1/96 inch.
_PPI = 192
_HEAD = re.compile(r'<svg\b[^>]*\bviewBox="([^"]*)"[^>]*>')
#: A page of the size of the figure, without a date, so that equal figures are equal bytes.
_PAGE = b"""#set document(date: none)
#set page(width: auto, height: auto, margin: 0pt, fill: white)
#image(bytes(sys.inputs.svg), format: "svg")
"""


def as_file(svg: str, form: str) -> bytes:
    """Return a figure as the content of a file.

    Parameters
    ----------
    svg
        The figure.
    form
        ``svg``, ``png`` or ``pdf``.

    Returns
    -------
    bytes
        In light colours on white. PNG and PDF use the fonts of the machine.

    Raises
    ------
    UsageError
        Where typst, which writes PNG and PDF, is not installed.
    """
    alone = standalone(svg)
    if form == "svg":
        return alone.encode()
    try:
        import typst
    except ImportError:
        problem = f"figures as {form.upper()} need the package typst"
        raise UsageError(problem, remedy="Install it with: pip install 'dynid[figures]'") from None
    inputs = {"svg": alone}
    if form == "pdf":
        return bytes(typst.compile(_PAGE, format="pdf", sys_inputs=inputs))
    return bytes(typst.compile(_PAGE, format="png", ppi=_PPI, sys_inputs=inputs))


def standalone(svg: str) -> str:
    """Return a figure as an SVG document with an XML declaration, on white, without CSS variables."""
    plain = resolved(svg).lstrip()
    head = _HEAD.match(plain)
    if head is None:
        raise ValueError("a figure starts with <svg …> and has a viewBox")
    x, y, width, height = head[1].split()
    paper = COLOURS["paper"][0]
    ground = f'<rect x="{x}" y="{y}" width="{width}" height="{height}" fill="{paper}"/>'
    end = head.end()
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{plain[:end]}{ground}{plain[end:]}'
