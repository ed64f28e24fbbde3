"""The screen of what a record can tell, before it is worked on."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from textwrap import wrap

from dynid.report.content.identifiability import GROUP, bound_table, collinear_groups, modal_shifts
from dynid.report.content.identifiability import calibration_sentences as calibration
from dynid.result import Result

#: The most modes on the screen.
_MOST_MODES = 8


def table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> Iterable[str]:
    """Yield aligned lines, the first column to the left."""
    cells = [list(headings), *[list(row) for row in rows]]
    widths = [max(len(row[k]) for row in cells) for k in range(len(headings))]
    for row in cells:
        right = "  ".join(cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=True))
        yield f"    {row[0]:<{widths[0]}}  {right}".rstrip()


def identifiability_lines(result: Result) -> list[str]:
    """Return bounds, collinear parameters, and what the parameters do to the modes."""
    if f"{GROUP}/relative_bound" not in result:
        return []
    told = [*_bounds(result), *(f"    {line}" for line in collinear_groups(result))]
    # Where there are estimates, their own slopes stand beside them.
    if "identification/parameters/name" not in result:
        told += [f"    {sentence}" for sentence in calibration(result)]
    return [*told, "", *_modes(result), ""]


def _bounds(result: Result) -> Iterable[str]:
    found = bound_table(result)
    place, noise = found.where
    what = "record" if found.of_time else "frequency responses"
    state = ", initial state unknown" if found.of_time else ""
    said = f"  what the {what} can tell (Cramér–Rao bound at the {place}{state}{noise})"
    yield from wrap(said, 110, subsequent_indent="    ")
    yield from table(("", "value", "bound", *(["state known"] if found.of_time else [])), found.rows)


def _modes(result: Result) -> Iterable[str]:
    """Yield what one per cent of each parameter does to frequency and damping of each mode."""
    columns, rows = modal_shifts(result)
    yield "  what 1 % of a stiffness does to a mode's frequency, and 1 % of a damping to its damping ratio"
    yield from table(columns, rows[:_MOST_MODES])
    if len(rows) > _MOST_MODES:
        yield f"    … up to {rows[-1][1]} {columns[1]}"
