"""Screens of a study: its plan before a run; status, statistics and sensitivities after it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from dynid.cli.summary.common import aligned, paragraph
from dynid.number_format import counted
from dynid.report.content.study import (
    COLUMNS,
    approximate_texts,
    compared_samples,
    constant_text,
    display_name,
    first_samples,
    having_it,
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
from dynid.study.analysis.table import StudyColumn, StudyTable, failures
from dynid.suggestions import short_paths

if TYPE_CHECKING:
    from dynid.study.plan import Plan

#: Most outputs whose inputs are ranked, errors of samples, and samples of a plan.
_RANKED, _ERRORS, _SAMPLES = 40, 5, 5


def lines(result: Result) -> list[str]:
    """Return the screen of a study's result, line by line."""
    table = StudyTable(result)
    width = max((len(name) for name in table.inputs), default=0)
    status = [f"  {status_text(table)}"]
    status += (f"    {name:<{width}}  {range_text(column)}" for name, column in table.inputs.items())
    if len(table.pending):
        status.append("  interrupted: run the study again to resume it")
    found = failures(table)
    failed = ["  failed"] if found else []
    for failure in found[:_ERRORS]:
        which = "sample" if len(failure.samples) == 1 else "samples"
        failed.append(f"    {len(failure.samples):>7,}  {failure.error}  ({which} {first_samples(failure)})")
    if len(found) > _ERRORS:
        failed.append(f"    … and {counted(len(found) - _ERRORS, 'other reason')}")
    met = [f"    {share:>8}  {text}" for text, share in met_expectations(table)]
    if met:
        shares = f"the share of the {compared_samples(table)} that meet them"
        met.insert(0, f"  expectations of the scene, and {shares}")
    shown, hidden = shown_numbers(table)
    sources, notes = variance_sources(table, shown, _RANKED)
    influences = list(_grouped([(*split_name(name), inputs) for name, inputs in sources]))
    if sources:
        influences.insert(0, "  sources of the variance")
        influences += [f"    ({notes[0]})", *(f"    {note}" for note in notes[1:])]
    blocks = [
        status,
        failed,
        list(_statistics(table, shown, hidden)),
        met,
        influences,
    ]
    return [line for block in blocks if block for line in (*block, "")][:-1]


def _statistics(table: StudyTable, shown: list[tuple[str, StudyColumn]], hidden: list[str]) -> Iterator[str]:
    """Yield the statistics of the outputs: a row for each that varies, by group, then what is constant."""
    if not table.paths and table.done.any():
        yield "  nothing was collected; name the outputs in the study's 'collect'"
    rows: list[tuple[str, list[str]]] = []
    sentences, constants = list[str](), dict[str, list[str]]()
    for path, column in shown:
        name = display_name(table, path, column)
        group, last = split_name(name)
        row = statistics_row(table, path, column)
        if (constant := constant_text(table, path, column)) is not None:
            constants.setdefault(group, []).append(f"{last} {constant}")
        elif len(row) == 1:
            sentences.append(f"{name}: {row[0]}")
        else:
            rows.append((group, [last + having_it(table, column), column.units, *row]))
    if rows:
        yield from _under_groups(rows)
        yield "    (samples count from 0)"
    for text in approximate_texts(table):
        yield from paragraph(text)
    for path, shares in text_shares(table):
        group, last = split_name(path)
        if shares.endswith(" 100 %"):
            constants.setdefault(group, []).append(f"{last} {shares.removesuffix(' 100 %')}")
        else:
            sentences.append(f"{path}: {shares}")
    for text in sentences:
        yield from paragraph(text)
    for group, names in constants.items():
        where = f", {group}" if group else ""
        yield from paragraph(f"the same in every sample{where}: {', '.join(names)}")
    for path in hidden:
        yield f"  {path}: {counted(table.size(path), 'value')} per sample"


def _under_groups(rows: Sequence[tuple[str, list[str]]]) -> Iterator[str]:
    """Yield the table of statistics, with a heading for each group in every block of its columns."""
    place = -1  # that of the headings
    for line in aligned([["", "", *COLUMNS], *(row for _, row in rows)], left=(0, 1)):
        if not line:
            place = -2
        elif place >= 0 and (place == 0 or rows[place][0] != rows[place - 1][0]):
            yield f"  {rows[place][0]}".rstrip()
        yield line
        place += 1


def _grouped(rows: Sequence[tuple[str, str, str]]) -> Iterator[str]:
    """Yield rows of group, name and text as lines, with a heading for each group."""
    width = max((len(name) for _, name, _ in rows), default=0)
    before = None
    for group, name, text in rows:
        if group != before:
            yield f"  {group}" if group else ""
            before = group
        yield f"    {name:<{width}}  {text}"


def plan_lines(
    plan: Plan, numbers: Sequence[int], finished: int, target: str, foreign: int = 0, explaining: str = ""
) -> Iterator[str]:
    """Yield the screen of a plan: its size, sampling, outputs, varied inputs and first samples.

    Parameters
    ----------
    plan
        The plan.
    numbers
        The samples to run: all, or those of a shard.
    finished
        The number of finished samples among them.
    target
        The file to write.
    foreign
        The number of finished samples of that file that do not belong to the study.
    explaining
        The command that estimates the time, which needs samples to be run.
    """
    method = plan.attrs["method"]
    yield f"{plan.study.title}: {counted(len(numbers), 'sample')} of {plan.attrs['base']} ({plan.base.kind})"
    yield f"  sampling  {method}" + (f", seed {plan.seed}" if method not in ("grid", "list") else "")
    if len(numbers) < plan.size:
        yield f"  shard     of {plan.size} samples, one in {plan.size // len(numbers)} or so"
    yield f"  collects  {', '.join(plan.collect) or 'every number under properties and parameters'}"
    yield f"  {target}: {finished} finished, {len(numbers) - finished} to run"
    if explaining and finished < len(numbers):
        yield f"  time      estimated from a few samples by: {explaining}"
    if foreign:
        verb = "does" if foreign == 1 else "do"
        yield f"  warning: {counted(foreign, 'finished sample')} of {target} {verb} not belong to this study,"
        yield "           and would be lost: write another file with -o, or discard them with --force"
    yield ""
    rows = [["", "values", "from", "to"]]
    for path, values in plan.arrays.items():
        different = np.unique(values)
        name = path if path in plan.settings else f"{path} (not set in the scene)"
        rows.append([name, str(len(different)), _value_text(different[0]), _value_text(different[-1])])
    yield from aligned(rows, "  ")
    yield ""
    samples = [
        [str(number), *(_value_text(values[number]) for values in plan.arrays.values())]
        for number in numbers[:_SAMPLES]
    ]
    yield from aligned([["sample", *short_paths(list(plan.arrays))], *samples], "  ")
    if len(numbers) > _SAMPLES:
        yield "  …"


def _value_text(value: Any) -> str:
    if isinstance(value, np.bool_):
        return str(value).lower()
    return f"{value:.6g}" if isinstance(value, np.floating) else str(value)
