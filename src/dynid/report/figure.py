"""What a figure is: a name, a title, and a picture with its caption and table, drawn when asked for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

Cell = str | bool | int | float | complex


@dataclass(frozen=True)
class Table:
    """The numbers under a figure.

    Parameters
    ----------
    columns
        Headings, with units where there are any: `omega, rad/s`.
    rows
        One entry a column.
    note
        What is to be said of it: which rows it leaves out.
    """

    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    note: str = ""


@dataclass(frozen=True)
class Picture:
    """A drawn figure.

    Parameters
    ----------
    svg
        An SVG document of its own, which may also stand within a page.
    caption
        A sentence or two.
    table
        What it shows, in numbers or words; none where there is nothing to list.
    """

    svg: str
    caption: str = ""
    table: Table | None = None


@dataclass(frozen=True)
class Figure:
    """A figure that a result has.

    Parameters
    ----------
    name
        Unique within a result, fit for a file's name: letters, digits, `-`, `_` and `.`.
    title
        What it shows, in a few words.
    draw
        Draws it.
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
        """The picture itself."""
        return self.picture.svg

    @property
    def caption(self) -> str:
        """What is said under it."""
        return self.picture.caption

    @property
    def table(self) -> Table | None:
        """The table under it."""
        return self.picture.table
