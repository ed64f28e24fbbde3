"""Content of studies: status of the samples, statistics of the results, sources of their variance."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator

import numpy as np

from dynid.checks.expectations import expected_words
from dynid.number_format import counted, headed, limit, quantity, unit_text
from dynid.report.content.blocks import (
    ALL,
    Block,
    ReportSection,
    Statement,
    TextTable,
    definitions,
    on_screen,
)
from dynid.report.scenes import plain_data
from dynid.result import Result
from dynid.study.analysis.influence import Influences
from dynid.study.analysis.sample_statistics import Direction, statistics, worst
from dynid.study.analysis.table import StudyColumn, StudyTable, failures
from dynid.suggestions import short_paths

#: The statistics of a number; the least and the largest value with their samples.
COLUMNS = ("mean", "min (sample)", "max (sample)", "std", "p05", "median", "p95")
#: Most entries of an array that are shown one by one; of longer arrays, only the size is shown.
_ENTRIES = 12
_FEW_STATEMENTS = 6  # lines of constants, verdicts and texts beside the answer
_NUMBERS = 40  # numbers in the table
_EXAMINED = 400  # numbers of which it is examined whether they vary
_FACTORS = 4  # inputs shown of each
_LEVELS = 20  # different texts, of which the most frequent are shown
_MIN_VARIANCE_SHARE = 0.01  # least part of a variance that is shown
_EXACT = 0.0005  # greatest error of such a part that is not shown
_RANKED = 24  # numbers whose inputs are ranked
_REASONS, _ERRORS = 20, 5  # reasons of failures on a page, on a screen


def method(result: Result) -> str:
    """Return the kind of result and the number of samples."""
    return f"study · {counted(result['study/sample'].shape[0], 'sample')}"


def sections(result: Result) -> Iterator[ReportSection]:
    """Yield the content of a study."""
    table = StudyTable(result)
    shown, hidden = shown_numbers(table)
    yield from _samples(table)
    yield from _statistics(table, shown, hidden)
    if met := tuple(_met_expectations(table)):
        always = sum(share == "all" for _, share in met)
        text, share = min(
            met,
            key=lambda expectation: math.inf if expectation[1] == "all" else float(expectation[1].split()[0]),
        )
        rarest = "" if always == len(met) else f"; least often: {text} ({share})"
        subject = f"every {_compared_samples(table).removesuffix('s')}"
        summary = Statement(f"{subject} meets {always} of {counted(len(met), 'expectation')}{rarest}")
        yield ReportSection("Expectations of the samples", (summary,), "answer")
        heads = ("expectations of the scene", f"share of the {_compared_samples(table)} that meet them")
        shares = TextTable(heads, met, brief=ALL, most=ALL)
        yield ReportSection("Expectations of the scene", (shares,), screen="")
    sources, notes = variance_sources(table, shown, _RANKED)
    if sources:
        blocks = (definitions(*sources, brief=_RANKED), *map(Statement, notes))
        yield ReportSection("Sources of the variance", blocks, screen="sources of the variance")


def _samples(table: StudyTable) -> Iterator[ReportSection]:
    """Yield the status of the samples, and their inputs."""
    counts = {"done": int(table.done.sum()), "failed": len(table.failed), "pending": len(table.pending)}
    text = " · ".join(f"{count:,} {what}" for what, count in counts.items() if count or what == "done")
    complete = not (counts["failed"] or counts["pending"])
    blocks: list[Block] = [Statement(text, "good" if complete else "bad")]
    if len(table.pending):
        blocks.append(Statement("interrupted: run the study again to resume it", "bad"))
    if reasons := failures(table):
        rows = tuple(
            (
                f"{len(reason.samples):,}",
                reason.error,
                ", ".join(map(str, reason.samples[:3])) + ", …" * (len(reason.samples) > 3),
            )
            for reason in reasons
        )
        heads = ("samples", "failed with", "numbers")
        caption = "reasons of failures"
        blocks.append(TextTable(heads, rows, caption=caption, noun="reason", brief=_ERRORS, most=_REASONS))
    yield ReportSection("Samples", tuple(blocks), "answer", screen="")
    if not table.paths and table.done.any():
        hint = Statement("nothing was collected; name the outputs in the study's 'collect'")
        yield ReportSection("Samples", (hint,), "", screen="")
    inputs = tuple((name, _range_text(column)) for name, column in table.inputs.items())
    yield ReportSection("Inputs", (TextTable(("input", "range"), inputs, brief=ALL, most=ALL),), screen="")


def _statistics(
    table: StudyTable, shown: list[tuple[str, StudyColumn]], hidden: list[str]
) -> Iterator[ReportSection]:
    """Yield the statistics of the numbers that vary, then constants, verdicts, texts, and long arrays."""
    rows, items, constants = list[tuple[str, ...]](), list[tuple[str, str]](), dict[str, list[str]]()
    names = [display_name(table, path, column) for path, column in shown]
    short = [re.sub(r"^bond_graph/\w+/", "", name) for name in names]
    if len(set(short)) < len(short):
        short = names
    for name, (path, column) in zip(short, shown, strict=True):
        if (constant := _constant_text(table, path, column)) is not None:
            group, last = _split_name(name)
            constants.setdefault(group, []).append(f"{last} {constant}")
        elif table.variable(path).attrs.get("stored") == "bool":
            items.append((name, f"{100 * np.nanmean(column.values):.4g} % true"))
        else:
            count = int(np.sum(~np.isnan(column.values)))
            lacking = "" if count >= int(table.done.sum()) else f" (n = {count:,})"
            rows.append((headed(name, column.units) + lacking, *_statistics_row(table, column)))
    for path, shares in _text_shares(table):
        name = re.sub(r"^bond_graph/\w+/", "", path)
        if shares.endswith(" 100 %"):
            group, last = _split_name(name)
            constants.setdefault(group, []).append(f"{last} {shares.removesuffix(' 100 %')}")
        else:
            items.append((name, shares))
    items += ((path, counted(table.size(path), "value") + " per sample") for path in hidden)
    few = (
        not rows or len(items) + sum(map(len, constants.values())) <= _FEW_STATEMENTS
    )  # else they push figures down
    for group, values in constants.items():
        where = f", {group}" if group else ""
        items.append((f"the same in every sample{where}", ", ".join(values)))
    numbers = [TextTable(("", *COLUMNS), tuple(rows), brief=ALL, most=ALL)] if rows else []
    samples = [on_screen(Statement("samples count from 0"))] if rows else []
    outputs: dict[str, dict[str, None]] = {}
    for path in filter(table.is_number, table.paths):
        if reason := str(table.variable(path).attrs.get("approximate", "")):
            outputs.setdefault(reason, {})[path.rpartition("/")[2]] = None
    approximate = (Statement(f"approximate, {why}: {', '.join(names)}") for why, names in outputs.items())
    others = [definitions(*items, noun="number", brief=_NUMBERS, most=ALL)] if items else []
    if blocks := (*numbers, *samples, *approximate, *(others if few else [])):
        yield ReportSection("Statistics", blocks, "answer", screen="")
    if not few:
        yield ReportSection("Constants, verdicts and texts", tuple(others), screen="")


def _compared_samples(table: StudyTable) -> str:
    """Return which samples the expectations are compared with: those that failed have no values."""
    return "completed samples" if len(table.failed) + len(table.pending) else "samples"


def _met_expectations(table: StudyTable) -> Iterator[tuple[str, str]]:
    """Yield each expectation of the scene, and the share of the completed samples that meet it."""
    result, done = table.result, int(table.done.sum())
    count = sum(path.startswith("study/expect/") for path in result)
    try:
        data = plain_data(str(result.value("study/scene")))
        texts = [f"{item['path']} {expected_words(item)}" for item in data["expect"]][:count]
    except (LookupError, TypeError):
        texts = [f"expectation {number + 1}" for number in range(count)]
    for number, text in enumerate(texts if done else ()):
        met = int((result[f"study/expect/{number}"].data & table.done).sum())
        yield text, "all" if met == done else f"{100 * met / done:.4g} %"


def variance_sources(
    table: StudyTable, shown: list[tuple[str, StudyColumn]], limit: int
) -> tuple[list[tuple[str, str]], list[str]]:
    """Return the inputs that contribute to the variance of numbers, and remarks on the estimates.

    At most so many numbers, `shown` with their paths, are analysed.
    """
    influences = Influences(table)
    rows: list[tuple[str, str]] = []
    estimator, seen = "", np.empty(0)
    factors = short_paths(influences.factors)
    for path, column in shown:
        indices = influences.of(column.values) if len(rows) < limit else None
        # The magnitudes of a conjugate pair are the same.
        if indices is None or np.array_equal(column.values, seen, equal_nan=True):
            continue
        estimator, seen = indices.estimator, column.values
        largest = indices.first if indices.total is None else np.maximum(indices.first, indices.total)
        parts = []
        for factor in np.argsort(-largest, kind="stable")[:_FACTORS]:
            first, error = indices.first[factor], indices.first_error[factor]
            if not largest[factor] > max(_MIN_VARIANCE_SHARE, 2 * error if indices.total is None else 0):
                continue
            direction = influences.direction(int(factor), column.values)
            arrow = "" if not abs(direction) > 0.3 else " ↑" if direction > 0 else " ↓"
            total = "" if indices.total is None else f" (in all {_percent(indices.total[factor])} %)"
            within = f" ± {float(f'{100 * error:.1g}'):g}" if error > _EXACT else ""
            parts.append(f"{factors[factor]}{arrow} {_percent(first)}{within} %{total}")
        rows.append((display_name(table, path, column), ", ".join(parts)))
    if not rows:
        return [], []
    if not any(inputs for _, inputs in rows):
        rows = [(f"each of {counted(len(rows), 'number')}", "")]
    rows = [(name, inputs or "no input alone") for name, inputs in rows]
    notes = [f"{estimator}; ± is the standard error"]
    if any("↑" in inputs or "↓" in inputs for _, inputs in rows):
        notes.append("↑ increases, ↓ decreases with the input")
    if len(factors) == 1 and influences.design is None:
        notes.append("lower bound: variation within the bins of an input is not counted")
    if influences.correlated is not None:
        first_input, second_input, value = influences.correlated
        notes.append(f"{first_input} and {second_input} are correlated ({value:.2g}): their parts overlap")
    return rows, notes


def _percent(share: float) -> str:
    return f"{100 * share + 0.0:.{1 if abs(share) < 0.1 else 0}f}"


def _text_shares(table: StudyTable) -> Iterator[tuple[str, str]]:
    """Yield the path of each text, and the frequencies of its values."""
    for path in table.paths:
        if table.is_number(path) or table.size(path) != 1:
            continue
        words, counts = np.unique(table.variable(path).data[table.done].astype(str), return_counts=True)
        order = np.argsort(-counts, kind="stable")[:4]
        total = max(1, int(counts.sum()))
        if len(words) > _LEVELS:
            yield path, f"{len(words):,} different texts"
            continue
        short = [text if len(text) <= 40 else f"{text[:39]}…" for text in words]
        shares = ", ".join(f"{short[k]} {100 * counts[k] / total:.4g} %" for k in order)
        yield path, f"{shares}{', …' if len(words) > 4 else ''}"


def _range_text(column: np.ndarray) -> str:
    """Return the range of an input as text."""
    if column.dtype.kind in "if" and len(column):
        return f"{limit(float(column.min()))} … {limit(float(column.max()))}"
    levels = list(dict.fromkeys(map(str, column)))
    return ", ".join(levels[:4]) + (f", … ({len(levels)})" if len(levels) > 4 else "")


def shown_numbers(table: StudyTable) -> tuple[list[tuple[str, StudyColumn]], list[str]]:
    """Return the numbers that are shown one by one with their paths, and the paths of all others.

    Both are in the order of the study's `collect`. Numbers that do not vary take no place of the table.
    """
    shown: list[tuple[str, StudyColumn]] = []
    hidden = []
    varying = 0
    for path in filter(table.is_number, table.paths):
        size = table.size(path)
        if size > _ENTRIES or len(shown) + size > _EXAMINED:
            hidden.append(path)
            continue
        columns = list(table.columns(path))
        more = sum(_constant_text(table, path, column) is None for column in columns)
        if more and varying + more > _NUMBERS:
            hidden.append(path)
            continue
        varying += more
        shown += [(path, column) for column in columns]
    return shown, hidden


def display_name(table: StudyTable, path: str, column: StudyColumn) -> str:
    """Return the name of a number: between bars if a magnitude, without the label of an only entry."""
    name = column.name.removesuffix("[1]") if table.size(path) == 1 else column.name
    if table.variable(path).dtype.kind != "c":
        return name
    group, _, last = name.partition("[")[0].rpartition("/")
    return f"{group}/|{last}{name[len(group) + 1 + len(last) :]}|".lstrip("/")


def _split_name(name: str) -> tuple[str, str]:
    """Return the group and the rest of a name; labels in brackets may have slashes too."""
    path, bracket, labels = name.partition("[")
    group, _, last = path.rpartition("/")
    return group, last + bracket + labels


def _constant_text(table: StudyTable, path: str, column: StudyColumn) -> str | None:
    """Return the value that a number has in every sample as text; None for one that varies."""
    values = column.values[~np.isnan(column.values)]
    if not len(values):
        return "without a value"
    if values.min() != values.max():
        return None
    if table.variable(path).attrs.get("stored") == "bool":
        return "true" if values[0] else "false"
    return f"{limit(float(values[0]))} {unit_text(column.units)}".rstrip()


def _statistics_row(table: StudyTable, column: StudyColumn) -> Iterator[str]:
    """Yield the statistics of a number that varies, in the order of `COLUMNS`."""
    values = statistics(column.values)
    extremes: dict[str, Direction] = {"min": "min", "max": "max"}
    for name in (heading.removesuffix(" (sample)") for heading in COLUMNS):
        at = worst(column.values, extremes[name]) if name in extremes else None
        yield quantity(float(values[name])) + ("" if at is None else f" ({table.numbers[at]})")
