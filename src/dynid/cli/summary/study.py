"""The screen of a study: what became of its samples, what they say, and what that depends on."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dynid.checks.comparison import word
from dynid.checks.expectations import expected_words
from dynid.numerals import counted, quantity
from dynid.result import Result
from dynid.study.analysis.failures import failures
from dynid.study.analysis.influence import Indices
from dynid.study.analysis.moments import statistics
from dynid.study.analysis.ranking import Influences
from dynid.study.analysis.table import Column, StudyTable
from dynid.study.analysis.worst import worst

#: Entries of an array that are shown one by one; longer ones are named with their size.
_ENTRIES = 12
_ROWS = 40  # numbers in the table
_RANKED = 12  # numbers whose inputs are ranked
_FACTORS = 4  # inputs shown of each
_REASONS = 5
_LEVELS = 20  # different texts of which the most frequent are shown
_COLUMNS = ("mean", "std", "p05", "median", "p95", "max")
_LEAST = 0.01  # part of a variance that is still said
_UNSAID = 0.0005  # error of such a part that is not


def method(result: Result) -> str:
    """Name the kind of result."""
    return f"study · {counted(result['study/sample'].shape[0], 'sample')}"


def lines(result: Result) -> list[str]:
    """Return the screen, line by line."""
    table = StudyTable(result)
    shown, hidden = _shown(table)
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
        yield f"    {name:<{width}}  {_range(column)}"
    if len(table.pending):
        yield "  interrupted: run the study again to go on"


def _range(column: np.ndarray) -> str:
    if column.dtype.kind in "if" and len(column):
        return f"{quantity(float(column.min()))} … {quantity(float(column.max()))}"
    levels = list(dict.fromkeys(map(str, column)))
    return ", ".join(levels[:4]) + (f", … ({len(levels)})" if len(levels) > 4 else "")


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


def _shown(table: StudyTable) -> tuple[list[tuple[str, Column]], list[str]]:
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


def _statistics(table: StudyTable, shown: list[tuple[str, Column]], hidden: list[str]) -> Iterator[str]:
    """Yield one row a number, those of a group together."""
    rows = [(*_split(_written(table, path, column)), _row(table, path, column)) for path, column in shown]
    if rows:
        width = max(len(name) for _, name, _ in rows)
        cells = [[*_COLUMNS, "at sample"], *(row for _, _, row in rows if len(row) > 1)]
        widths = [max(len(row[place]) for row in cells) for place in range(len(_COLUMNS) + 1)]
        yield "    " + " " * width + "  " + _joined(cells[0], widths)
        group = None
        for own, name, row in rows:
            if own != group:
                yield f"  {own}" if own else ""
                group = own
            yield f"    {name:<{width}}  {_joined(row, widths)}"
    for path in hidden:
        yield f"  {path}: {table.size(path):,} numbers a sample"


def _written(table: StudyTable, path: str, column: Column) -> str:
    """Return a number's name, between bars where it is a magnitude."""
    if table.variable(path).dtype.kind != "c":
        return column.name
    group, _, last = column.name.partition("[")[0].rpartition("/")
    return f"{group}/|{last}{column.name[len(group) + 1 + len(last) :]}|".lstrip("/")


def _split(name: str) -> tuple[str, str]:
    """Split a name into its group and itself; labels may have slashes too."""
    path, bracket, labels = name.partition("[")
    group, _, last = path.rpartition("/")
    return group, last + bracket + labels


def _joined(row: list[str], widths: list[int]) -> str:
    if len(row) == 1:
        return row[0]
    return "  ".join(f"{cell:>{width}}" for cell, width in zip(row, widths, strict=True))


def _row(table: StudyTable, path: str, column: Column) -> list[str]:
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
    return [*(quantity(float(found[name])) for name in _COLUMNS), at]


def _with_units(text: str, units: str) -> str:
    return f"{text} {units}" if units else text


def _texts(table: StudyTable) -> Iterator[str]:
    """Say how often each text came."""
    for path in table.paths:
        if table.is_number(path) or table.size(path) != 1:
            continue
        words, counts = np.unique(table.variable(path).data[table.done].astype(str), return_counts=True)
        order = np.argsort(-counts, kind="stable")[:4]
        total = max(1, int(counts.sum()))
        if len(words) > _LEVELS:
            yield f"  {path}: {len(words):,} different texts"
            continue
        shares = ", ".join(f"{_short(words[k])} {100 * counts[k] / total:.4g} %" for k in order)
        yield f"  {path}: {shares}{', …' if len(words) > 4 else ''}"


def _short(text: str) -> str:
    return text if len(text) <= 40 else f"{text[:39]}…"


def _expectations(table: StudyTable) -> Iterator[str]:
    """Say which share of the samples meets each expectation of the scene."""
    count = sum(path.startswith("study/expect/") for path in table.result)
    wanted = _expected(table.result, count)
    done = int(table.done.sum())
    if count and done:
        yield "  expectations of the scene, and the share of the samples that meet them"
    for number in range(count if done else 0):
        met = int((table.result[f"study/expect/{number}"].data & table.done).sum())
        share = "all" if met == done else f"{100 * met / done:.4g} %"
        yield f"    {share:>8}  {wanted[number]}"


def _expected(result: Result, count: int) -> list[str]:
    """Return the words of the scene's expectations."""
    from dynid.errors import SceneError
    from dynid.scene.yaml.source import parse_source

    try:
        data = parse_source(str(result.value("study/scene"))).data
        return [f"{one['path']} {expected_words(one)}" for one in data["expect"]][:count]
    except (SceneError, LookupError, TypeError):
        return [f"expectation {number + 1}" for number in range(count)]


def _influences(table: StudyTable, shown: list[tuple[str, Column]]) -> Iterator[str]:
    """Say for each number which inputs its variance comes from."""
    influences = Influences(table)
    found: list[tuple[str, str, list[str]]] = []
    estimator, seen = "", np.empty(0)
    for path, column in shown:
        indices = influences.of(column.values) if len(found) < _RANKED else None
        if indices is None or np.array_equal(column.values, seen, equal_nan=True):
            continue  # the magnitudes of a conjugate pair are the same
        estimator, seen = indices.estimator, column.values
        found.append((*_split(_written(table, path, column)), list(_parts(influences, indices, column))))
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


def _parts(influences: Influences, indices: Indices, column: Column) -> Iterator[str]:
    names = _short_names(influences.factors)
    largest = indices.first if indices.total is None else np.maximum(indices.first, indices.total)
    for place in np.argsort(-largest, kind="stable")[:_FACTORS]:
        first, error = indices.first[place], indices.first_error[place]
        if not largest[place] > max(_LEAST, 2 * error if indices.total is None else 0):
            continue
        arrow = _arrow(influences.direction(int(place), column.values))
        more = "" if indices.total is None else f" (in all {_percent(indices.total[place])} %)"
        within = f" ± {100 * error:.1g}" if error > _UNSAID else ""
        yield f"{names[place]}{arrow} {_percent(first)}{within} %{more}"


def _percent(share: float) -> str:
    return f"{100 * share + 0.0:.{1 if abs(share) < 0.1 else 0}f}"


def _short_names(names: list[str]) -> list[str]:
    """Return the last parts of dotted paths where they tell them apart."""
    short = [name.rpartition(".")[2] if "," not in name else name for name in names]
    return short if len(set(short)) == len(names) else names


def _arrow(direction: float) -> str:
    """Say which way a number goes with an input, where it goes one way."""
    return "" if not abs(direction) > 0.3 else " ↑" if direction > 0 else " ↓"
