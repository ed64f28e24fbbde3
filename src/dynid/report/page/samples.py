"""Samples of a study on a page: columns as packed numbers, which a script sorts, filters and counts."""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.report.content.study import display_name, shown_numbers
from dynid.report.page.html import Markup, join, json_data, shown_rows, tag, visible
from dynid.result import Result
from dynid.study.analysis.table import StudyTable
from dynid.suggestions import distinct_ends, short_paths

#: Most samples on a page, and most bytes of their columns as text.
_SAMPLES, _BYTES = 50_000, 1_100_000
#: Most different texts of a column, and most characters of each.
_LEVELS, _LETTERS = 2000, 200
#: The range in which a float32 has seven digits, and the largest integer up to which it is exact.
_SMALL, _LARGE, _WHOLE = 1e-37, 3e38, 2**24


def samples(result: Result) -> Markup:
    """Return the samples of a study with their inputs and results."""
    table = StudyTable(result)
    count = len(table.numbers)
    rows = np.array(shown_rows(count, 1, _SAMPLES), dtype=np.intp)
    kept, left, size = [], [], 0
    columns = list(_columns(table))
    inputs, others = (
        [name for name, _, role, _ in columns if (role == "input") is is_input] for is_input in (True, False)
    )
    heads = dict(zip([*inputs, *others], [*short_paths(inputs), *distinct_ends(others)], strict=True))
    for name, units, role, values in columns:
        said = {"name": visible(name), "short": visible(heads[name]), "units": visible(units), "role": role}
        column = {**said, **_packed(values[rows])}
        size += len(column["data"]) + len(json.dumps(column.get("levels", ""), ensure_ascii=False).encode())
        if size > _BYTES and role == "result":
            size -= len(column["data"])
            left.append(name)
        else:
            kept.append(column)
    cuts = [] if len(rows) == count else [f"{len(rows):,} of {count:,} samples, evenly spaced"]
    if left:
        names = f"{', '.join(left[:6])}{', …' if left[6:] else ''}"
        cuts.append(f"without {len(left):,} of the results: {names}")
    note = tag("p", f"This table has {'; '.join(cuts)}. The file has all.", class_="note") if cuts else ""
    return join(
        note,
        tag(
            "noscript",
            tag("p", "Sorting and filtering samples needs scripts; the statistics above do not."),
        ),
        tag("div", id="sample-table", class_="samples no-script"),
        json_data({"rows": len(rows), "columns": kept}, id="samples-data"),
    )


def _columns(table: StudyTable) -> Iterator[tuple[str, str, str, NDArray[Any]]]:
    """Yield name, units, role and values of every column: number, status, inputs, results, error."""
    yield "sample", "", "number", table.numbers
    if not table.done.all():
        yield "status", "", "text", table.result["study/status"].data
    for name, values in table.inputs.items():
        yield name, "", "input", values
    for path, column in shown_numbers(table)[0]:
        yield display_name(table, path, column), column.units, "result", column.values
    for path in table.paths:
        if not table.is_number(path) and table.size(path) == 1:
            yield path, "", "result", table.variable(path).data.reshape(len(table.numbers))
    if len(table.failed):
        yield "error", "", "text", table.result["study/error"].data


def _packed(values: NDArray[Any]) -> dict[str, Any]:
    """Return a column as base64: numbers as float32 if that has seven digits, texts as indices of levels."""
    if values.dtype.kind in "bifu":
        numbers = values.astype(np.float64)
        sizes = np.abs(numbers[np.isfinite(numbers) & (numbers != 0)])
        kind = "<f4"
        if sizes.size:
            integral = bool(np.all(sizes == np.floor(sizes)))
            fits = sizes.max() < _LARGE and sizes.min() > _SMALL and not (integral and sizes.max() > _WHOLE)
            kind = "<f4" if fits else "<f8"
        return {"type": kind, "data": b64encode(numbers.astype(kind).tobytes()).decode()}
    texts = [visible(str(value)) for value in values]
    texts = [text if len(text) <= _LETTERS else f"{text[: _LETTERS - 1]}…" for text in texts]
    levels = sorted(set(texts))
    if len(levels) > _LEVELS:
        levels = [*levels[:_LEVELS], "…"]
    places = {level: index for index, level in enumerate(levels)}
    indices = np.array([places.get(text, len(levels) - 1) for text in texts], dtype="<u2")
    return {
        "type": "<u2",
        "levels": levels,
        "data": b64encode(indices.tobytes()).decode(),
    }
