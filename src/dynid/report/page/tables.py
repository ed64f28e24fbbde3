"""Tables of numbers under figures: short ones whole, long ones thinned out, the full count said."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from dynid.report.figure import Cell, Table
from dynid.report.page.html import Markup, tag, text

#: Most rows, and most cells, of a table on a page.
ROWS, CELLS = 200, 3000


def thinned(count: int, columns: int, most: int = ROWS) -> list[int]:
    """Return which of so many rows are shown: all, or some at equal distances, first and last included."""
    most = max(2, most if columns <= 1 else min(most, CELLS // columns))
    if count <= most:
        return list(range(count))
    return sorted({round(place * (count - 1) / (most - 1)) for place in range(most)})


def number(value: complex) -> str:
    """Write a number so that it can be read back to seven digits."""
    if isinstance(value, complex):
        return f"{value.real:.7g}{value.imag:+.7g}j"
    return f"{value:.7g}"


def cell(value: Cell) -> str:
    """Write an entry of a table."""
    if isinstance(value, str):
        return value
    if isinstance(value, bool):
        return "yes" if value else "no"
    return str(value) if isinstance(value, int) else number(value)


def figure_table(table: Table, title: str) -> Markup:
    """Return a table that opens on demand."""
    shown = thinned(len(table.rows), len(table.columns))
    total = len(table.rows)
    count = f"{total:,} rows" if total != 1 else "1 row"
    if len(shown) < total:
        count = f"{len(shown):,} of {total:,} rows, evenly spaced; the file has all"
    rows = [table.rows[place] for place in shown]
    numeric = [all(not isinstance(row[k], str) for row in rows) for k in range(len(table.columns))]
    opening = ['<td class="n">' if right else "<td>" for right in numeric]
    body = Markup("".join(f"<tr>{_cells(opening, row)}</tr>" for row in rows))
    inside = grid(table.columns, body, numeric)
    summary = tag("summary", "Table ", tag("span", f"({count})", class_="quiet"))
    return tag("details", summary, scrolling(inside, f"Table: {title}"), class_="table")


def _cells(opening: Iterable[str], row: Iterable[Cell]) -> str:
    return "".join(
        f"{start}{text(value) if isinstance(value, str) else cell(value)}</td>"
        for start, value in zip(opening, row, strict=True)
    )


def grid(columns: Sequence[str], body: Markup, numeric: Sequence[bool]) -> Markup:
    """Return a table with its headings."""
    heads = (
        tag("th", name, scope="col", class_="n" if right else None) if name else tag("td")
        for name, right in zip(columns, numeric, strict=True)
    )
    return tag("table", tag("thead", tag("tr", *heads)), tag("tbody", body))


def scrolling(content: Markup, label: str) -> Markup:
    """Return content that is moved sideways where it is too wide, by keys too."""
    return tag("div", content, class_="scroll", tabindex="0", role="region", aria_label=label)
