"""Nodes of the content of a result: sections of definition lists, tables, statements and numbered lists.

Content states every fact once. Renderers (the screen in `dynid.cli.screen`, page and notebook in
`dynid.report.page.html`) know these nodes alone. Texts begin in lower case and have no full stop; pages
make sentences of them.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

#: Beginning of a number in a table, with its sign or symbol; a dash stands for none.
_NUMBER = re.compile(r"(?:[ζ×] )?[-+−±]?[\d∞–]|-$")
#: No limit to the entries that are shown.
ALL = 10**9


@dataclass(frozen=True)
class Block:
    """A node of a section; its reader is ``screen`` or ``page`` where only one of them shows it."""

    reader: str = field(default="", kw_only=True)


@dataclass(frozen=True)
class Statement(Block):
    """A sentence without full stop, with a tone (``good``, ``bad`` or none).

    Its head is a name before it, which is written as it is, with its colon if there is one.
    """

    text: str
    tone: str = ""
    head: str = ""

    @property
    def whole(self) -> str:
        """The sentence with its head."""
        return f"{self.head} {self.text}".lstrip()


@dataclass(frozen=True)
class Listing(Block):
    """Several entries, each a `noun`, of which screens show the first `brief`, and pages the first `most`."""

    noun: str = field(default="row", kw_only=True)
    brief: int = field(default=20, kw_only=True)
    most: int = field(default=60, kw_only=True)

    @property
    def count(self) -> int:
        """The number of entries."""
        return len(getattr(self, "items", ()))


@dataclass(frozen=True)
class DefinitionList(Listing):
    """Terms with their values; a term may have several lines."""

    items: tuple[tuple[str, tuple[str, ...]], ...]


@dataclass(frozen=True)
class NumberedList(Listing):
    """Formulas or sentences in order."""

    items: tuple[str, ...]


@dataclass(frozen=True)
class TextTable(Listing):
    """A table of texts: the first column has the headings of the rows, columns without a heading have texts.

    Marked rows are highlighted; screens show the first `brief_columns`.
    """

    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    marked: frozenset[int] = frozenset()
    caption: str = ""
    brief_columns: int = field(default=100, kw_only=True)

    @property
    def count(self) -> int:
        """The number of rows."""
        return len(self.rows)

    def filled(self) -> TextTable:
        """Return the table without the columns that are empty in every row."""
        used = [k for k in range(len(self.columns)) if not k or any(row[k] for row in self.rows)]
        rows = tuple(tuple(row[k] for k in used) for row in self.rows)
        return replace(self, columns=tuple(self.columns[k] for k in used), rows=rows)

    def numeric(self) -> list[bool]:
        """Return for each column True if it has numbers only; the first has headings."""
        columns = zip(*self.rows, strict=True) if self.rows else ((),) * len(self.columns)
        return [
            k > 0 and all(not cell or _NUMBER.match(cell) for cell in column)
            for k, column in enumerate(columns)
        ]


AnyBlock = TypeVar("AnyBlock", bound=Block)


@dataclass(frozen=True)
class ReportSection:
    """Nodes under a heading; a page shows sections of one title and place together.

    `place` of a page: `answer` for what was asked, which stands first; `details`; `derivation`; empty: none.
    `screen`: the heading there; empty: none; default: screens do not show the section. `detail`: ``trace``
    where screens show it with the derivations alone, ``brief`` where without these alone.
    """

    title: str
    blocks: tuple[Block, ...]
    place: str = "details"
    screen: str | None = None
    detail: str = ""


@dataclass(frozen=True)
class Content:
    """Content of a result: the kind of analysis with its method, and sections in the order of questions."""

    method: str
    sections: tuple[ReportSection, ...] = field(default=())


def definitions(*items: tuple[str, str | Iterable[str]], **options: Any) -> DefinitionList:
    """Return a definition list without the terms that have no value."""
    several = ((name, (value,) if isinstance(value, str) else tuple(value)) for name, value in items)
    return DefinitionList(tuple((name, lines) for name, lines in several if any(lines)), **options)


def on_screen(block: AnyBlock) -> AnyBlock:
    """Return a node that only screens show."""
    return replace(block, reader="screen")


def on_page(block: AnyBlock) -> AnyBlock:
    """Return a node that only pages show."""
    return replace(block, reader="page")


def joined(names: Iterable[Any], limit: int) -> str:
    """Return a list of names, cut off after so many."""
    listed = [str(name) for name in names]
    return ", ".join(listed[:limit]) + (f", … ({len(listed)} in all)" if len(listed) > limit else "")


class Formula(str):
    """A line that is an equation; screens leave out long ones, pages very long ones."""

    __slots__ = ()

    def shortened(self, longest: int) -> str:
        """Return it, or its left side where it is longer than so many characters."""
        left = self.partition("= ")[0]
        return str(self) if len(self) <= longest else f"{left}= … (in the file)"
