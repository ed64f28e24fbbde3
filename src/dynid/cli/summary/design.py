"""Screen of a design."""

from __future__ import annotations

from collections.abc import Iterable

from dynid.cli.summary.common import aligned
from dynid.report.content.design import DESIGN, parameter_table, statements, target_table
from dynid.result import Result


def design_lines(result: Result) -> Iterable[str]:
    """Yield designed values, targets and how they were found."""
    if f"{DESIGN}/value" not in result:
        return
    yield "  design"
    for headings, rows in (parameter_table(result), target_table(result)):
        shown = [k for k in range(len(headings)) if any(row[k] for row in rows)]
        yield from aligned([[row[k] for k in shown] for row in (headings, *rows)])
    for text, tone in statements(result):
        yield f"    {'warning: ' if tone == 'bad' else ''}{text}"
    yield ""
