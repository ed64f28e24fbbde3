"""What benchmarks say: a table each, what nothing beats marked."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import groupby

from dynid.numerals import memory_text, time_text
from dynid.report.answers.blocks import Block, Grid, Note, Part
from dynid.result import Result


def method(result: Result) -> str:  # noqa: ARG001
    """Name the kind of result."""
    return "median times; ● nothing is both faster and more accurate"


def parts(result: Result) -> Iterator[Part]:
    """Yield a part for each benchmark."""
    for group in dict.fromkeys("/".join(path.split("/")[:2]) for path in result if path.startswith("bench/")):
        yield Part(group.partition("/")[2], tuple(_benchmark(result, group)))


def _benchmark(result: Result, group: str) -> Iterator[Block]:
    about = result.group_attrs[group]
    names = list(dict.fromkeys(path.split("/")[2] for path in result if path.startswith(f"{group}/")))
    every = sorted((row for name in names for row in rows_of(result, group, name)), key=lambda row: row[0])
    rows: list[tuple[str, ...]] = []
    marked = set()
    for size, some in groupby(every, key=lambda row: row[0]):
        for _, name, time, memory, error, best in some:
            if best:
                marked.add(len(rows))
            figures = (time_text(time), memory_text(memory), f"{error:.1e}", "●" if best else "")
            rows.append((name, f"{size:,}", *figures))
    heads = ("", str(about["size"]), "time", "memory", "error", "")
    yield Grid(heads, tuple(rows), frozenset(marked), str(about["title"]))
    yield Note(f"Error: {about['measure']}. ● nothing is both faster and more accurate.")
    powers = [f"{name} {power:.2f}" for name in names if (power := growth(result, group, name)) is not None]
    if powers:
        yield Note(f"Time grows with {about['size']} to the power of: {', '.join(powers)}.")
    for word, said in (("failed", "failed"), ("missing", "missing"), ("chosen", "chosen by default")):
        if about.get(word):
            yield Note(f"{said}: {about[word]}", "bad" if word == "failed" else "")


def rows_of(result: Result, group: str, name: str) -> Iterator[tuple[int, str, float, float, float, bool]]:
    """Yield size, name, time, memory, error, and whether nothing beats it."""
    columns = [result[f"{group}/{name}/{c}"].data for c in ("size", "time", "memory", "error", "pareto")]
    for size, time, memory, error, best in zip(*columns, strict=True):
        yield int(size), name, float(time), float(memory), float(error), bool(best)


def growth(result: Result, group: str, name: str) -> float | None:
    """Return the exponent by which time grows between the two largest sizes; None where there is one only."""
    sizes, times = (result[f"{group}/{name}/{column}"].data for column in ("size", "time"))
    if len(sizes) < 2 or sizes[-1] <= sizes[-2]:
        return None
    return math.log(times[-1] / times[-2]) / math.log(sizes[-1] / sizes[-2])
