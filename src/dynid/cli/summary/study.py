"""The screen of a study: what became of its samples, what they say, and what that depends on."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dynid.numerals import counted
from dynid.report.answers.study import (
    COLUMNS,
    different,
    expected,
    influence_parts,
    range_text,
    shown_numbers,
    split,
    statistics_row,
    text_shares,
    written,
)
from dynid.result import Result
from dynid.study.analysis.failures import failures
from dynid.study.analysis.ranking import Influences
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
    parts = {"done": int(table.done.sum()), "failed": len(table.failed), "pending": len(table.pending)}
    yield "  " + " · ".join(f"{count:,} {what}" for what, count in parts.items() if count or what == "done")
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
        first = ", ".join(map(str, failure.samples[:3])) + (", …" if len(failure.samples) > 3 else "")
        which = "sample" if len(failure.samples) == 1 else "samples"
        yield f"    {len(failure.samples):>7,}  {failure.error}  ({which} {first})"
    if len(found) > _REASONS:
        yield f"    … and {counted(len(found) - _REASONS, 'other reason')}"


def _statistics(table: StudyTable, shown: list[tuple[str, Column]], hidden: list[str]) -> Iterator[str]:
    """Yield one row a number, those of a group together."""
    if not table.paths and table.done.any():
        yield "  nothing was collected; name in the study's 'collect' what to gather"
    rows = [
        (*split(written(table, path, column)), statistics_row(table, path, column)) for path, column in shown
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
    count = sum(path.startswith("study/expect/") for path in table.result)
    wanted = expected(table.result, count)
    done = int(table.done.sum())
    if count and done:
        yield "  expectations of the scene, and the share of the samples that meet them"
    for number in range(count if done else 0):
        met = int((table.result[f"study/expect/{number}"].data & table.done).sum())
        share = "all" if met == done else f"{100 * met / done:.4g} %"
        yield f"    {share:>8}  {wanted[number]}"


def _influences(table: StudyTable, shown: list[tuple[str, Column]]) -> Iterator[str]:
    """Say for each number which inputs its variance comes from."""
    influences = Influences(table)
    found: list[tuple[str, str, list[str]]] = []
    estimator, seen = "", np.empty(0)
    for path, column in shown:
        indices = influences.of(column.values) if len(found) < _RANKED else None
        if indices is None or not different(column, seen):
            continue
        estimator, seen = indices.estimator, column.values
        found.append(
            (*split(written(table, path, column)), list(influence_parts(influences, indices, column)))
        )
    if not found:
        return
    yield "  where the variance comes from"
    width = max(len(name) for _, name, _ in found)
    group = None
    for own, name, parts in found:
        if own != group:
            yield f"  {own}" if own else ""
            group = own
        yield f"    {name:<{width}}  {', '.join(parts) or 'no input alone'}"
    yield f"    ({estimator}; ± is the standard error)"
    if influences.correlated is not None:
        first, second, value = influences.correlated
        yield f"    {first} and {second} go together (correlation {value:.2g}): their parts overlap"
