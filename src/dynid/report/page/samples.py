"""The samples of a study on a page: columns as packed numbers, which a script sorts, filters and counts."""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.report.answers.study import shown_numbers, written
from dynid.report.page.html import Markup, join, printable, tag
from dynid.report.page.tables import thinned
from dynid.result import Result
from dynid.study.analysis.table import StudyTable

#: Most samples on a page, and most bytes of their columns as text.
_SAMPLES, _BYTES = 50_000, 1_100_000
#: Most different texts of a column, and most letters of each.
_LEVELS, _LETTERS = 2000, 200
#: The range in which a float32 has seven digits, and up to where it holds every whole number.
_SMALL, _LARGE, _WHOLE = 1e-37, 3e38, 2**24

Columns = dict[str, Any]


def samples(result: Result) -> Markup:
    """Return the samples of a study: what varied and what was gathered, one by one."""
    table = StudyTable(result)
    count = len(table.numbers)
    rows = np.array(thinned(count, 1, _SAMPLES), dtype=np.intp)
    kept, left, size = [], [], 0
    for name, units, role, values in _columns(table):
        column = {"name": printable(name), "units": units, "role": role, **_packed(values[rows])}
        size += len(column["data"]) + len(json.dumps(column.get("levels", ""), ensure_ascii=False).encode())
        if size > _BYTES and role == "result":
            size -= len(column["data"])
            left.append(name)
        else:
            kept.append(column)
    said = [] if len(rows) == count else [f"{len(rows):,} of {count:,} samples, evenly spaced"]
    if left:
        said.append(
            f"without {len(left):,} of the numbers gathered: {', '.join(left[:6])}{', …' if left[6:] else ''}"
        )
    note = tag("p", f"Shown are {'; '.join(said)}. The file has all.", class_="note") if said else ""
    data = json.dumps({"rows": len(rows), "columns": kept}, ensure_ascii=False, separators=(",", ":"))
    return join(
        note,
        tag(
            "noscript",
            tag("p", "Sorting and filtering single samples needs scripts; their statistics stand above."),
        ),
        tag("div", id="sample-table", class_="samples no-script"),
        tag("script", _inert(data), type="application/json", id="samples-data"),
    )


def _inert(data: str) -> Markup:
    """Return JSON that cannot end the element it stands in."""
    safe = data.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")
    return Markup(safe.replace("\u2028", "\\u2028").replace("\u2029", "\\u2029"))


def _columns(table: StudyTable) -> Iterator[tuple[str, str, str, NDArray[Any]]]:
    """Yield name, units, role and values: what a sample is, what varied, what was gathered."""
    yield "sample", "", "number", table.numbers
    if not table.done.all():
        yield "status", "", "text", table.result["study/status"].data
    for name, values in table.inputs.items():
        yield name, "", "input", values
    for path, column in shown_numbers(table)[0]:
        yield written(table, path, column), column.units, "result", column.values
    for path in table.paths:
        if not table.is_number(path) and table.size(path) == 1:
            yield path, "", "result", table.variable(path).data.reshape(len(table.numbers))
    if len(table.failed):
        yield "error", "", "text", table.result["study/error"].data


def _packed(values: NDArray[Any]) -> Columns:
    """Return a column as base64: numbers as float32 where that holds seven digits, texts as their places."""
    if values.dtype.kind in "bifu":
        numbers = values.astype(np.float64)
        return {"type": (kind := _type(numbers)), "data": _base64(numbers.astype(kind))}
    texts = [_cut(str(value)) for value in values]
    levels = sorted(set(texts))
    if len(levels) > _LEVELS:
        levels = [*levels[:_LEVELS], "…"]
    places = {level: place for place, level in enumerate(levels)}
    return {
        "type": "<u2",
        "levels": levels,
        "data": _base64(np.array([places.get(text, len(levels) - 1) for text in texts], dtype="<u2")),
    }


def _cut(value: str) -> str:
    value = printable(value)
    return value if len(value) <= _LETTERS else f"{value[: _LETTERS - 1]}…"


def _type(numbers: NDArray[np.float64]) -> str:
    sizes = np.abs(numbers[np.isfinite(numbers) & (numbers != 0)])
    if not sizes.size:
        return "<f4"
    whole = bool(np.all(sizes == np.floor(sizes)))
    fits = sizes.max() < _LARGE and sizes.min() > _SMALL and not (whole and sizes.max() > _WHOLE)
    return "<f4" if fits else "<f8"


def _base64(values: NDArray[Any]) -> str:
    return b64encode(values.tobytes()).decode()
