"""The screen of a comparison of reductions."""

from __future__ import annotations

from io import StringIO

from dynid.report.content.reduction import method_table, remarks, seconds_text
from dynid.result import Result


def lines(result: Result) -> list[str]:
    """Return the screen, line by line."""
    size = len(result["reduction/dof"].data)
    took = seconds_text(result.group_attrs.get("reduction", {}).get("seconds"))
    effort = f"; its modes took {took}" if took else ""
    return [f"  {size} DOFs{effort}", "", *_table(result), "", *(f"  {note}" for note in remarks(result))]


def _table(result: Result) -> list[str]:
    """Return the methods as aligned lines."""
    from rich.console import Console
    from rich.table import Table

    columns, rows = method_table(result)
    table = Table(box=None, padding=(0, 1), show_edge=False, header_style="")
    for heading in columns:
        table.add_column(heading, justify="right" if heading else "left")
    for row in rows:
        table.add_row(*row)
    out = StringIO()
    Console(file=out, width=200, color_system=None).print(table)
    return [f"  {line}".rstrip() for line in out.getvalue().splitlines()]
