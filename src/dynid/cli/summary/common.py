"""Parts of several screens: frequency and time responses, tables."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from io import StringIO
from textwrap import wrap

from dynid.number_format import counted, span_text
from dynid.report.content import time_span
from dynid.report.scenes import frequency_span, peak_responses
from dynid.result import Result

#: Most channels and outputs that are listed.
_MOST = 12


def response_lines(result: Result, group: str) -> Iterable[str]:
    """Yield the peaks of the frequency responses and the ranges of the time responses of a group."""
    frequency, transient = f"{group}/frequency_response", f"{group}/time_response"
    if f"{frequency}/omega" in result:
        low, high, unit = frequency_span(result, frequency)
        count = counted(len(result[f"{frequency}/omega"].data), "frequency")
        yield f"  frequency response at {count}, {span_text(low, high)} {unit}"
        top = peak_responses(result, frequency)
        outputs, inputs = (result[f"{frequency}/{axis}"].data for axis in ("output", "input"))
        channels = [(k, m) for k in range(len(outputs)) for m in range(len(inputs))]
        for k, m in channels[:_MOST]:
            ratio, size = f"|{outputs[k]} / {inputs[m]}|", f"{top.magnitude[k, m]:.4g}".replace("inf", "∞")
            if top.magnitude[k, m]:
                yield f"    max {ratio} = {size} at {top.at[k, m]:.4g} {unit}"
            else:
                yield f"    {ratio} = 0 at all frequencies"
        if len(channels) > _MOST:
            yield f"    … {counted(len(channels) - _MOST, 'more channel')} in the file"
    if f"{transient}/time" in result:
        response = result[f"{transient}/response"].data
        yield f"  time response {time_span(result, transient)}"
        note = result.group_attrs.get(transient, {}).get("note")
        if note:
            yield from (f"    {line}" for line in wrap(f"Note: {note}.", 96))
        outputs = result[f"{transient}/output"].data
        for output, column in zip(outputs[:_MOST], response.T, strict=False):
            yield f"    {output}: min {column.min():.4g}, max {column.max():.4g}, final {column[-1]:.4g}"
        if len(outputs) > _MOST:
            yield f"    … {counted(len(outputs) - _MOST, 'more output')} in the file"


def aligned(rows: Sequence[Sequence[str]], indent: str = "    ") -> Iterable[str]:
    """Yield the rows of a table as lines, the first column to the left, the others to the right."""
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    for first, *others in rows:
        cells = [cell.rjust(width) for cell, width in zip(others, widths[1:], strict=True)]
        yield f"{indent}{'  '.join([first.ljust(widths[0]), *cells])}".rstrip()


def rich_table(columns: Sequence[str], rows: Iterable[Sequence[str]], padding: int, width: int) -> list[str]:
    """Return a table as lines of at most a width; columns with a heading are aligned to the right.

    Parameters
    ----------
    columns
        The headings.
    rows
        The cells.
    padding
        Blanks on both sides of a cell.
    width
        The width of the table, in characters.
    """
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, padding=(0, padding), show_edge=False, header_style="")
    for heading in columns:
        table.add_column(heading, justify="right" if heading else "left")
    for row in rows:
        table.add_row(*map(Text, row))
    out = StringIO()
    Console(file=out, width=width, color_system=None).print(table)
    return [f"  {line}".rstrip() for line in out.getvalue().splitlines()]
