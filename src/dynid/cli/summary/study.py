"""The screen of a study: what became of its samples, what they say, and what that depends on."""

from __future__ import annotations

from collections.abc import Iterator

from dynid.number_format import counted
from dynid.report.content.study import (
    COLUMNS,
    display_name,
    first_samples,
    met_expectations,
    range_text,
    shown_numbers,
    split_name,
    statistics_row,
    status_text,
    text_shares,
    variance_sources,
)
from dynid.result import Result
from dynid.study.analysis.failures import failures
from dynid.study.analysis.table import Column, StudyTable

_RANKED = 12  # numbers whose inputs are ranked
_REASONS = 5


def lines(result: Result) -> list[str]:
    """Return the screen, line by line."""
    table = StudyTable(result)
    shown, hidden = shown_numbers(table)
    blocks = [
        _state(table),
        _failures(table),
        _statistics(table, shown, hidden),
        _texts(table),
        _expectations(table),
        _influences(table, shown),
    ]
    return [line for block in blocks if (found := list(block)) for line in (*found, "")][:-1]


def _state(table: StudyTable) -> Iterator[str]:
    yield f"  {status_text(table)}"
    width = max((len(name) for name in table.inputs), default=0)
    for name, column in table.inputs.items():
        yield f"    {name:<{width}}  {range_text(column)}"
    if len(table.pending):
        yield "  interrupted: run the study again to go on"


def _failures(table: StudyTable) -> Iterator[str]:
    found = failures(table)
    if found:
        yield "  failed"
    for failure in found[:_REASONS]:
        which = "sample" if len(failure.samples) == 1 else "samples"
        yield f"    {len(failure.samples):>7,}  {failure.error}  ({which} {first_samples(failure)})"
    if len(found) > _REASONS:
        yield f"    … and {counted(len(found) - _REASONS, 'other reason')}"


def _statistics(table: StudyTable, shown: list[tuple[str, Column]], hidden: list[str]) -> Iterator[str]:
    """Yield one row a number, those of a group together."""
    if not table.paths and table.done.any():
        yield "  nothing was collected; name in the study's 'collect' what to gather"
    rows = [
        (*split_name(display_name(table, path, column)), statistics_row(table, path, column))
        for path, column in shown
    ]
    if rows:
        width = max(len(name) for _, name, _ in rows)
        cells = [[*COLUMNS, "at sample"], *(row for _, _, row in rows if len(row) > 1)]
        widths = [max(len(row[place]) for row in cells) for place in range(len(COLUMNS) + 1)]
        yield "    " + " " * width + "  " + _joined(cells[0], widths)
        group = None
        for own, name, row in rows:
            if own != group:
                yield f"  {own}" if own else ""
                group = own
            yield f"    {name:<{width}}  {_joined(row, widths)}"
    for path in hidden:
        yield f"  {path}: {table.size(path):,} numbers a sample"


def _joined(row: list[str], widths: list[int]) -> str:
    if len(row) == 1:
        return row[0]
    return "  ".join(f"{cell:>{width}}" for cell, width in zip(row, widths, strict=True))


def _texts(table: StudyTable) -> Iterator[str]:
    yield from (f"  {path}: {shares}" for path, shares in text_shares(table))


def _expectations(table: StudyTable) -> Iterator[str]:
    """Say which share of the samples meets each expectation of the scene."""
    rows = list(met_expectations(table))
    if rows:
        yield "  expectations of the scene, and the share of the samples that meet them"
    yield from (f"    {share:>8}  {text}" for text, share in rows)


def _influences(table: StudyTable, shown: list[tuple[str, Column]]) -> Iterator[str]:
    """Say for each number which inputs its variance comes from."""
    rows, notes = variance_sources(table, shown, _RANKED)
    if not rows:
        return
    yield "  where the variance comes from"
    names = [split_name(name) for name, _ in rows]
    width = max(len(name) for _, name in names)
    group = None
    for (own, name), (_, said) in zip(names, rows, strict=True):
        if own != group:
            yield f"  {own}" if own else ""
            group = own
        yield f"    {name:<{width}}  {said}"
    yield f"    ({notes[0]})"
    yield from (f"    {note}" for note in notes[1:])
