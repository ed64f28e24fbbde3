"""What a study says: what became of its samples, what they say, and what that depends on."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dynid.checks.comparison import word
from dynid.checks.expectations import expected_words
from dynid.numerals import counted, quantity
from dynid.report.answers.blocks import Block, Grid, Note, Part, facts
from dynid.report.answers.common import more
from dynid.report.scenes import plain_data
from dynid.result import Result
from dynid.study.analysis.failures import Failure, failures
from dynid.study.analysis.influence import Indices
from dynid.study.analysis.moments import statistics
from dynid.study.analysis.ranking import Influences
from dynid.study.analysis.table import Column, StudyTable
from dynid.study.analysis.worst import worst
from dynid.words import short_paths

#: The statistics of a number.
COLUMNS = ("mean", "std", "p05", "median", "p95", "max")
#: Entries of an array that are shown one by one; longer ones are named with their size.
_ENTRIES = 12
_ROWS = 40  # numbers in the table
_FACTORS = 4  # inputs shown of each
_LEVELS = 20  # different texts of which the most frequent are shown
_LEAST = 0.01  # part of a variance that is still said
_UNSAID = 0.0005  # error of such a part that is not
_RANKED = 24  # numbers whose inputs are ranked
_REASONS = 20


def method(result: Result) -> str:
    """Name the kind of result."""
    return f"study · {counted(result['study/sample'].shape[0], 'sample')}"


def parts(result: Result) -> Iterator[Part]:
    """Yield what a study says."""
    table = StudyTable(result)
    shown, hidden = shown_numbers(table)
    yield Part("Samples", tuple(_state(table)))
    yield from _statistics(table, shown, hidden)
    yield from _expectations(table)
    yield from _influences(table, shown)


def _state(table: StudyTable) -> Iterator[Block]:
    yield Note(state(table), "bad" if len(table.failed) or len(table.pending) else "good")
    if len(table.pending):
        yield Note("Interrupted: run the study again to go on.", "bad")
    yield Grid(
        ("varied", "range"), tuple((name, range_text(column)) for name, column in table.inputs.items())
    )
    found = failures(table)
    rows = tuple((f"{len(one.samples):,}", one.error, first_samples(one)) for one in found[:_REASONS])
    if rows:
        yield Grid(("samples", "failed with", "numbers"), rows, caption="Why samples failed")
        yield from more(len(found), _REASONS, "reason")


def state(table: StudyTable) -> str:
    """Say what became of the samples."""
    counts = {"done": int(table.done.sum()), "failed": len(table.failed), "pending": len(table.pending)}
    return " · ".join(f"{count:,} {what}" for what, count in counts.items() if count or what == "done")


def first_samples(failure: Failure) -> str:
    """List the first samples that failed in one way."""
    return ", ".join(map(str, failure.samples[:3])) + (", …" if len(failure.samples) > 3 else "")


def _statistics(table: StudyTable, shown: list[tuple[str, Column]], hidden: list[str]) -> Iterator[Part]:
    rows: list[tuple[str, ...]] = []
    items = []
    for path, column in shown:
        name, row = written(table, path, column), statistics_row(table, path, column)
        if len(row) == 1:
            items.append((name, row[0]))
        else:
            rows.append((f"{name} [{column.units}]" if column.units else name, *row))
    blocks: list[Block] = []
    if rows:
        blocks.append(Grid(("", *COLUMNS, "at sample"), tuple(rows)))
    items += list(text_shares(table))
    items += [(path, f"{table.size(path):,} numbers a sample") for path in hidden]
    if items:
        blocks.append(facts(*items))
    if blocks:
        yield Part("Statistics", tuple(blocks))


def _expectations(table: StudyTable) -> Iterator[Part]:
    rows = tuple(met_expectations(table))
    if rows:
        yield Part("Expectations of the scene", (Grid(("", "share of the samples that meet it"), rows),))


def met_expectations(table: StudyTable) -> Iterator[tuple[str, str]]:
    """Yield the words of each expectation of the scene, and which share of the samples meets it."""
    count = sum(path.startswith("study/expect/") for path in table.result)
    done = int(table.done.sum())
    for number, text in enumerate(_expected(table.result, count) if done else ()):
        met = int((table.result[f"study/expect/{number}"].data & table.done).sum())
        yield text, "all" if met == done else f"{100 * met / done:.4g} %"


def _influences(table: StudyTable, shown: list[tuple[str, Column]]) -> Iterator[Part]:
    rows, notes = ranked(table, shown, _RANKED)
    if rows:
        yield Part("Where the variance comes from", (facts(*rows), *map(Note, notes)))


def ranked(
    table: StudyTable, shown: list[tuple[str, Column]], most: int
) -> tuple[list[tuple[str, str]], list[str]]:
    """Return which inputs the variance of each number comes from, and what is to be known of that.

    Parameters
    ----------
    table, shown
        The study, and its numbers with their paths.
    most
        How many numbers are looked at.
    """
    influences = Influences(table)
    rows: list[tuple[str, str]] = []
    estimator, seen = "", np.empty(0)
    for path, column in shown:
        indices = influences.of(column.values) if len(rows) < most else None
        # The magnitudes of a conjugate pair are the same.
        if indices is None or np.array_equal(column.values, seen, equal_nan=True):
            continue
        estimator, seen = indices.estimator, column.values
        said = ", ".join(_influence_parts(influences, indices, column)) or "no input alone"
        rows.append((written(table, path, column), said))
    if not rows:
        return [], []
    notes = [f"{estimator}; ± is the standard error"]
    if influences.correlated is not None:
        first, second, value = influences.correlated
        notes.append(f"{first} and {second} go together (correlation {value:.2g}): their parts overlap")
    return rows, notes


def text_shares(table: StudyTable) -> Iterator[tuple[str, str]]:
    """Yield the path of each text, and how often each came."""
    for path in table.paths:
        if table.is_number(path) or table.size(path) != 1:
            continue
        words, counts = np.unique(table.variable(path).data[table.done].astype(str), return_counts=True)
        order = np.argsort(-counts, kind="stable")[:4]
        total = max(1, int(counts.sum()))
        if len(words) > _LEVELS:
            yield path, f"{len(words):,} different texts"
            continue
        shares = ", ".join(f"{short_text(words[k])} {100 * counts[k] / total:.4g} %" for k in order)
        yield path, f"{shares}{', …' if len(words) > 4 else ''}"


def range_text(column: np.ndarray) -> str:
    """Write what an input takes."""
    if column.dtype.kind in "if" and len(column):
        return f"{quantity(float(column.min()))} … {quantity(float(column.max()))}"
    levels = list(dict.fromkeys(map(str, column)))
    return ", ".join(levels[:4]) + (f", … ({len(levels)})" if len(levels) > 4 else "")


def shown_numbers(table: StudyTable) -> tuple[list[tuple[str, Column]], list[str]]:
    """Return the numbers that are shown one by one, with their paths, and the paths of the others."""
    shown: list[tuple[str, Column]] = []
    hidden = []
    for path in sorted(filter(table.is_number, table.paths)):
        size = table.size(path)
        if size <= _ENTRIES and len(shown) + size <= _ROWS:
            shown += [(path, column) for column in table.columns(path)]
        else:
            hidden.append(path)
    return shown, hidden


def written(table: StudyTable, path: str, column: Column) -> str:
    """Return a number's name, between bars where it is a magnitude."""
    if table.variable(path).dtype.kind != "c":
        return column.name
    group, _, last = column.name.partition("[")[0].rpartition("/")
    return f"{group}/|{last}{column.name[len(group) + 1 + len(last) :]}|".lstrip("/")


def split(name: str) -> tuple[str, str]:
    """Split a name into its group and itself; labels may have slashes too."""
    path, bracket, labels = name.partition("[")
    group, _, last = path.rpartition("/")
    return group, last + bracket + labels


def statistics_row(table: StudyTable, path: str, column: Column) -> list[str]:
    """Return the statistics of a number in the order of `COLUMNS`, and where it is worst; or a sentence."""
    known = column.values[~np.isnan(column.values)]
    if not len(known):
        return ["no sample has a value"]
    if table.variable(path).attrs.get("stored") == "bool":
        return [f"{100 * known.mean():.4g} % true"]
    if known.min() == known.max():
        return [f"{_with_units(word(known[0]), column.units)} in every sample"]
    found = statistics(column.values)
    place = worst(column.values)
    at = "" if place is None else str(table.numbers[place])
    return [*(quantity(float(found[name])) for name in COLUMNS), at]


def _with_units(text: str, units: str) -> str:
    return f"{text} {units}" if units else text


def short_text(text: str) -> str:
    """Return a text, cut where it is long."""
    return text if len(text) <= 40 else f"{text[:39]}…"


def _expected(result: Result, count: int) -> list[str]:
    """Return the words of the scene's expectations."""
    try:
        data = plain_data(str(result.value("study/scene")))
        return [f"{one['path']} {expected_words(one)}" for one in data["expect"]][:count]
    except (LookupError, TypeError):
        return [f"expectation {number + 1}" for number in range(count)]


def _influence_parts(influences: Influences, indices: Indices, column: Column) -> Iterator[str]:
    """Yield which inputs the variance of a number comes from, the largest part first."""
    names = short_paths(influences.factors)
    largest = indices.first if indices.total is None else np.maximum(indices.first, indices.total)
    for place in np.argsort(-largest, kind="stable")[:_FACTORS]:
        first, error = indices.first[place], indices.first_error[place]
        if not largest[place] > max(_LEAST, 2 * error if indices.total is None else 0):
            continue
        arrow = _arrow(influences.direction(int(place), column.values))
        more = "" if indices.total is None else f" (in all {_percent(indices.total[place])} %)"
        within = f" ± {float(f'{100 * error:.1g}'):g}" if error > _UNSAID else ""
        yield f"{names[place]}{arrow} {_percent(first)}{within} %{more}"


def _percent(share: float) -> str:
    return f"{100 * share + 0.0:.{1 if abs(share) < 0.1 else 0}f}"


def _arrow(direction: float) -> str:
    """Say which way a number goes with an input, where it goes one way."""
    return "" if not abs(direction) > 0.3 else " ↑" if direction > 0 else " ↓"
