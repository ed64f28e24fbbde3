"""A page of work–precision plots, each with its table: no script, no network, no other files."""

from __future__ import annotations

from html import escape
from string import Template

from dynid.report.diagrams.precision import figures
from dynid.report.figure import Cell, Figure, Table
from dynid.report.numbers import short
from dynid.result import Result

_PAGE = Template("""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>$title</title>
<meta name="viewport" content="width=device-width, initial-scale=1">
<style>
:root { color-scheme: light dark; }
body { font: 1rem/1.5 system-ui, sans-serif; max-width: 60rem; margin: 2rem auto; padding: 0 1rem; }
svg { max-width: 100%; height: auto; }
table { border-collapse: collapse; } th, td { padding: .15rem .8rem; text-align: right; }
th:first-child, td:first-child { text-align: left; } tr.best { font-weight: 600; }
</style></head><body><h1>$title</h1>$sections</body></html>
""")


def page(result: Result) -> str:
    """Return the page of a benchmark result."""
    drawn = list(figures(result))
    groups: dict[str, list[Figure]] = {}
    for figure in drawn:
        groups.setdefault(figure.name.rpartition("-")[0], []).append(figure)
    sections = "".join(_section(own) for own in groups.values())
    return _PAGE.substitute(title=escape(result.title), sections=sections)


def _section(drawn: list[Figure]) -> str:
    """Return what belongs to one benchmark: its plots, and the table that both have."""
    name = drawn[0].title.partition(":")[0]
    plots = "".join(f"{figure.svg}<p>{escape(figure.caption)}</p>" for figure in drawn)
    table = drawn[0].table
    return f"<section><h2>{escape(name)}</h2>{plots}{_table(table) if table else ''}</section>"


def _table(table: Table) -> str:
    head = "".join(f"<th>{escape(column)}</th>" for column in table.columns[:-1])
    rows = [f"<tr>{head}</tr>"]
    for *cells, best in table.rows:
        mark = ' class="best"' if best else ""
        rows.append(f"<tr{mark}>{''.join(f'<td>{escape(_written(cell))}</td>' for cell in cells)}</tr>")
    return f"<table>{''.join(rows)}</table>"


def _written(cell: Cell) -> str:
    return short(cell, 3) if isinstance(cell, float) else f"{cell:,}" if isinstance(cell, int) else str(cell)
