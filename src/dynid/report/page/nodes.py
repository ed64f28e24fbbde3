"""Nodes of content as HTML, for pages and notebooks."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from dynid.number_format import counted, sentence
from dynid.report.content.blocks import (
    ALL,
    Block,
    DefinitionList,
    Formula,
    Listing,
    NumberedList,
    ReportSection,
    Statement,
    TextTable,
)
from dynid.report.page.html import Markup, formula, grid, join, scrolling, table_entry, tag, with_code

#: A text of more characters in a cell has room for several words a line.
_LONG_TEXT = 24
#: Longest formula, characters.
_MAX_PAGE_FORMULA = 400


def page_sections(sections: Iterable[ReportSection], place: str) -> list[ReportSection]:
    """Return the sections of a place with what pages show; those of one title are one."""
    merged: dict[str, ReportSection] = {}
    for section in sections:
        blocks = tuple(block for block in section.blocks if block.reader != "screen")
        if section.place == place and blocks:
            before = merged[section.title].blocks if section.title in merged else ()
            merged[section.title] = replace(section, blocks=(*before, *blocks))
    return list(merged.values())


def node(block: Block, title: str, unfolded: int | None = None, most: int = ALL) -> Markup:
    """Return a node as HTML; in tables, columns of numbers are aligned to the right.

    `title` is that of its section; of longer tables so many rows stand `unfolded` above all rows, which are
    folded; `most` limits the entries of nodes without a lower limit.
    """
    if isinstance(block, Listing):
        most = min(most, block.most)
    match block:
        case Statement():
            return tag("p", _statement(block), class_=f"note {block.tone}".strip())
        case TextTable():
            shown = _table(block, title, unfolded, most)
        case DefinitionList():
            items = (
                join(tag("dt", term), *(tag("dd", formula(line)) for line in map(_shortened, lines)))
                for term, lines in block.items[:most]
            )
            shown = tag("dl", *items)
        case NumberedList():
            shown = tag("ol", *(tag("li", formula(item)) for item in block.items[:most]))
        case _:
            raise TypeError(f"{type(block).__name__} is no node that pages show")
    if block.count <= most:
        return shown
    more = f"… {counted(block.count - most, f'more {block.noun}')} in the file"
    return join(shown, tag("p", more, class_="note"))


def _statement(block: Statement) -> Markup:
    if block.text.startswith("…"):
        return with_code(block.text)
    said = sentence(block.text)
    return with_code(f"{block.head} {block.text[0]}{said[1:]}" if block.head else said)


def _shortened(line: str) -> str:
    return line.shortened(_MAX_PAGE_FORMULA) if isinstance(line, Formula) else line


def _table(block: TextTable, title: str, unfolded: int | None, most: int) -> Markup:
    table = block.filled()
    numeric, lines = table.numeric(), []
    for k, row in enumerate(table.rows[:most]):
        cells = []
        for value, right in zip(row[1:], numeric[1:], strict=True):
            cls = "n" if right else "long" if len(value) > _LONG_TEXT else None
            cells.append(tag("td", table_entry(value), class_=cls))
        head = tag("th", row[0], scope="row") if row[0] else tag("td")
        lines.append(tag("tr", head, *cells, class_="marked" if k in table.marked else None))
    label = f"{table.caption[0].upper()}{table.caption[1:]}" if table.caption else title
    caption = tag("p", label, class_="quiet") if table.caption else Markup("")
    if unfolded is None or len(lines) <= unfolded + 2:
        return join(caption, scrolling(grid(table.columns, join(*lines), numeric), label))
    first, every_row = (grid(table.columns, join(*some), numeric) for some in (lines[:unfolded], lines))
    summary = tag("summary", f"All {len(lines):,} rows")
    folded = tag("details", summary, scrolling(every_row, f"{label}, all rows"), class_="rows")
    return join(caption, scrolling(first, f"{label}, first rows"), folded)
