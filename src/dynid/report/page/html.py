"""HTML elements, tables and nodes of content; every text is escaped unless it is markup already."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from html import escape
from typing import Any

from dynid.number_format import counted, general, sentence, unbroken
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
from dynid.report.figure import CellValue, FigureTable, evenly_spaced


class Markup(str):
    """A text that is HTML."""

    __slots__ = ()


#: An entry of a table without a value.
_NO_VALUE = "—"
#: Such entries as screens write them.
_NO_VALUES = ("-", "–")
#: Most rows, and most cells, of a table on a page.
ROWS, CELLS = 200, 3000
#: Characters that are illegal in HTML, or that change the direction of writing.
_UNFIT = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\ud800-\udfff\ufffe\uffff\u202a-\u202e\u2066-\u2069]")
_VOID = frozenset({"meta", "br", "input", "link"})


def text(value: str) -> Markup:
    """Return a text as HTML; control characters are shown by their number."""
    if isinstance(value, Markup):
        return value
    return Markup(escape(visible(value)))


def visible(value: str) -> str:
    """Return a text with control characters shown by their number, and with unified line ends."""
    if value.isprintable():
        return value
    return _UNFIT.sub(lambda match: "\n" if match[0] == "\r" else f"⟨U+{ord(match[0]):04X}⟩", value)


def join(*parts: str) -> Markup:
    """Return the concatenation of texts and markup."""
    return Markup("".join(map(text, parts)))


def tag(name: str, *content: str, **attrs: str | bool | None) -> Markup:
    """Return an element of texts, which are escaped, and markup.

    Attributes: `class_` stands for class, `aria_label` for aria-label; True has no value, None or False omits
    it.
    """
    attributes = "".join(
        f" {key.rstrip('_').replace('_', '-')}" + ("" if value is True else f'="{text(value)}"')
        for key, value in attrs.items()
        if value is not None and value is not False
    )
    if name in _VOID:
        return Markup(f"<{name}{attributes}>")
    return Markup(f"<{name}{attributes}>{join(*content)}</{name}>")


def json_data(data: Any, **attrs: str) -> Markup:
    """Return data for a script; they cannot end its element."""
    text = json.dumps(data, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    for character in "&<>\u2028\u2029":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return tag("script", Markup(text), type="application/json", **attrs)


_POWER = re.compile(r"(?:\*\*|\^)(-?\d+(?:\.\d+)?|\([^()]*\))")


_EXPONENT = re.compile(r"(?<=[\d)])e([+-]\d{2,3})(?=j\b|\b(?!\.\d))")
_CODE = re.compile(r"`([^`\n]+)`")
_MINUS = re.compile(r"(?<![\w.)\]-])-(?=\d|∞)")


def formula(value: str) -> Markup:
    """Return a formula in Python's notation with minus signs, superscript powers and dots for products."""
    value = _EXPONENT.sub(lambda match: f"·10^{int(match[1])}", _MINUS.sub("−", unbroken(value)))
    safe = _POWER.sub(lambda match: f"<sup>{match[1].strip('()').replace('-', '−')}</sup>", text(value))
    return _with_code(safe.replace("*", "\N{DOT OPERATOR}"))


def _table_entry(value: str) -> Markup:
    """Return an entry of a table of content; a dash where it has no value."""
    return Markup(_NO_VALUE) if value in _NO_VALUES else formula(value)


def with_code(value: str) -> Markup:
    """Return a text; what stands between backticks is set as code."""
    return _with_code(text(value))


def _with_code(safe: str) -> Markup:
    return Markup(_CODE.sub(r"<code>\1</code>", safe))


def shown_rows(count: int, columns: int, limit: int = ROWS) -> list[int]:
    """Return the indices of the rows of a table that are shown: all, or evenly spaced ones."""
    return evenly_spaced(count, max(2, limit if columns <= 1 else min(limit, CELLS // columns)))


def cell_text(value: CellValue) -> str:
    """Return an entry of a table as text, numbers to seven digits; a dash for a number that is unknown."""
    if isinstance(value, str):
        return value
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return str(value)
    if value != value:
        return _NO_VALUE
    if isinstance(value, complex):
        return f"{value.real:.7g}{value.imag:+.7g}j".replace("inf", "∞")
    return general(value, 7)


def figure_table(table: FigureTable, title: str) -> Markup:
    """Return the table of a figure, folded; long tables are thinned out, with the full number of rows."""
    total = len(table.rows)
    shown = shown_rows(total, len(table.columns))
    count = f"{total:,} rows" if total != 1 else "1 row"
    if len(shown) < total:
        count = f"{len(shown):,} of {total:,} rows, evenly spaced; the file has all"
    rows = [table.rows[index] for index in shown]
    numeric = [all(not isinstance(row[k], str) for row in rows) for k in range(len(table.columns))]
    opening = ['<td class="n">' if right else "<td>" for right in numeric]
    lines = []
    for row in rows:
        cells = (f"{start}{text(cell_text(value))}</td>" for start, value in zip(opening, row, strict=True))
        lines.append(f"<tr>{''.join(cells)}</tr>")
    inside = grid(table.columns, Markup("".join(lines)), numeric)
    summary = tag("summary", "Table ", tag("span", f"({count})", class_="quiet"))
    return tag("details", summary, scrolling(inside, f"Table: {title}"), class_="table")


def grid(columns: Sequence[str], body: Markup, numeric: Sequence[bool]) -> Markup:
    """Return a table with its headings."""
    heads = (
        tag("th", name, scope="col", class_="n" if right else None) if name else tag("td")
        for name, right in zip(columns, numeric, strict=True)
    )
    return tag("table", tag("thead", tag("tr", *heads)), tag("tbody", body))


def scrolling(content: Markup, label: str) -> Markup:
    """Return content in a region that scrolls sideways, by keys too."""
    return tag("div", content, class_="scroll", tabindex="0", role="region", aria_label=label)


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
            cells.append(tag("td", _table_entry(value), class_=cls))
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
