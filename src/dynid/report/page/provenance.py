"""The end of a page: what the file holds, the scene as it was run, and how the result came about."""

from __future__ import annotations

from dynid.report.answers.contents import array_rows
from dynid.report.page.html import Markup, join, tag
from dynid.report.page.tables import grid, scrolling
from dynid.result import Result

#: Most arrays that are listed, and most lines of a scene.
_ARRAYS, _LINES = 500, 3000
_FIRST = ("created", "dynid_version", "python", "packages", "seed", "folder")


def arrays(result: Result) -> Markup:
    """Return the list of all arrays, to be opened."""
    rows = array_rows(result)
    body = join(*(tag("tr", *(tag("td", text) for text in row)) for row in rows[:_ARRAYS]))
    more = f", of which the first {_ARRAYS} are listed" if len(rows) > _ARRAYS else ""
    table = grid(("path", "type", "axes", "units"), body, (False,) * 4)
    said = tag("span", f"({len(rows):,}{more})", class_="quiet")
    inside = scrolling(table, "Arrays of the file")
    return tag("details", tag("summary", "Arrays of the file ", said), inside, class_="table")


def scene(text: str) -> Markup:
    """Return the text of the scene with the numbers of its lines."""
    lines = text.splitlines()
    shown = lines[:_LINES]
    body = join(*(tag("span", f"{line}\n", class_="line") for line in shown))
    left = len(lines) - len(shown)
    more = tag("p", f"… {left:,} more lines in the file", class_="quiet") if left else Markup("")
    return join(scrolling(tag("pre", tag("code", body), class_="scene"), "Scene"), more)


def provenance(result: Result) -> Markup:
    """Return how the result came about: versions, time, seed."""
    known = {name: str(value) for name, value in result.attrs.items() if name not in ("scene", "status")}
    names = [name for name in _FIRST if name in known] + sorted(known.keys() - set(_FIRST))
    items = (join(tag("dt", name.replace("_", " ")), tag("dd", known[name])) for name in names)
    return tag("dl", *items)
