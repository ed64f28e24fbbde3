"""Building blocks of the content of a report: sections of definition lists, tables, statements and lists."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

from dynid.number_format import counted


@dataclass(frozen=True)
class DefinitionList:
    """Terms with their values; a term may have several lines."""

    items: tuple[tuple[str, tuple[str, ...]], ...]


@dataclass(frozen=True)
class TextTable:
    """A table of texts whose first column has the headings of the rows.

    Parameters
    ----------
    columns
        Headings.
    rows
        One text a column.
    marked
        Indices of highlighted rows.
    caption
        Its caption.
    """

    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    marked: frozenset[int] = frozenset()
    caption: str = ""


@dataclass(frozen=True)
class Statement:
    """A sentence; its tone is `good`, `bad` or empty."""

    text: str
    tone: str = ""


@dataclass(frozen=True)
class NumberedList:
    """Formulas or sentences in order."""

    items: tuple[str, ...]


Block = DefinitionList | TextTable | Statement | NumberedList


@dataclass(frozen=True)
class ReportSection:
    """Blocks under a heading.

    Parameters
    ----------
    title
        The heading.
    blocks
        Its content.
    place
        `answer` for what was asked, which a page shows first; `details`; `derivation`.
    """

    title: str
    blocks: tuple[Block, ...]
    place: str = "details"


@dataclass(frozen=True)
class Content:
    """Content of the report of a result.

    Parameters
    ----------
    method
        The kind of analysis and its method.
    sections
        In the order of a reader's questions.
    """

    method: str
    sections: tuple[ReportSection, ...] = field(default=())


def definitions(*items: tuple[str, str | Iterable[str]]) -> DefinitionList:
    """Return a definition list without the terms that have no value."""
    each = ((name, (value,) if isinstance(value, str) else tuple(value)) for name, value in items)
    return DefinitionList(tuple((name, lines) for name, lines in each if any(lines)))


def more(count: int, shown: int, what: str) -> Iterator[Statement]:
    """Yield a statement of the number of items that are not shown, if there are any."""
    if count > shown:
        yield Statement(f"… {counted(count - shown, f'more {what}')} in the file")


def joined(names: Iterable[Any], most: int) -> str:
    """Return a list of names, cut off after so many."""
    every = [str(name) for name in names]
    return ", ".join(every[:most]) + (f", … ({len(every)} in all)" if len(every) > most else "")
