"""The answer of a result as HTML: facts as definition lists, grids as tables."""

from __future__ import annotations

import re
from collections.abc import Iterable

from dynid.report.answers.blocks import Block, Facts, Grid, Note, Part, Steps
from dynid.report.page.html import Markup, formula, join, tag
from dynid.report.page.tables import grid, scrolling

_NUMBER = re.compile(r"(?:[ζ×] )?[-+−±]?[\d∞–]|-$")


def part(content: Part, level: str = "h3") -> Markup:
    """Return a part with its heading."""
    return tag(
        "section", tag(level, content.title), *(_block(block, content.title) for block in content.blocks)
    )


def _block(block: Block, title: str) -> Markup:
    if isinstance(block, Facts):
        return tag("dl", *(join(tag("dt", name), *map(_line, lines)) for name, lines in block.items))
    if isinstance(block, Note):
        return tag("p", block.text, class_=f"note {block.tone}".strip())
    if isinstance(block, Steps):
        return tag("ol", *(tag("li", formula(item)) for item in block.items))
    return _grid(block, title)


def _line(line: str) -> Markup:
    return tag("dd", formula(line))


def _grid(block: Grid, title: str) -> Markup:
    columns = zip(*block.rows, strict=True) if block.rows else ((),) * len(block.columns)
    numeric = [place > 0 and _numeric(column) for place, column in enumerate(columns)]
    rows = (
        tag(
            "tr",
            tag("th", row[0], scope="row") if row[0] else tag("td"),
            *(
                tag("td", formula(value), class_="n" if right else None)
                for value, right in zip(row[1:], numeric[1:], strict=True)
            ),
            class_="marked" if place in block.marked else None,
        )
        for place, row in enumerate(block.rows)
    )
    table = grid(block.columns, join(*rows), numeric)
    caption = tag("p", block.caption, class_="quiet") if block.caption else Markup("")
    return join(caption, scrolling(table, block.caption or title))


def _numeric(column: Iterable[str]) -> bool:
    """Tell numbers, with or without units and errors, from words."""
    return all(not value or _NUMBER.match(value) for value in column)
