"""The screen of benchmarks: a table each, what nothing beats marked."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import groupby

from dynid.numerals import memory_text, time_text
from dynid.report.answers.bench import growth, rows_of
from dynid.result import Result


def lines(result: Result) -> list[str]:
    """Return the screen, line by line."""
    said: list[str] = []
    for group in dict.fromkeys("/".join(path.split("/")[:2]) for path in result):
        said += [*_table(result, group), ""]
    return said[:-1]


def _table(result: Result, group: str) -> Iterable[str]:
    about = result.group_attrs[group]
    yield f"  {group.partition('/')[2]}: {about['title']}"
    names = list(dict.fromkeys(path.split("/")[2] for path in result if path.startswith(f"{group}/")))
    rows = [row for name in names for row in rows_of(result, group, name)]
    width = max(map(len, names))
    yield f"    {about['size']:>9}  {'':{width}}  {'time':>10}  {'memory':>9}  {'error':>8}"
    for size, some in groupby(sorted(rows, key=lambda row: row[0]), key=lambda row: row[0]):
        for place, (_, name, time, memory, error, best) in enumerate(some):
            shown = f"{size:,}" if place == 0 else ""
            mark = " ●" if best else ""
            figures = f"{time_text(time):>10}  {memory_text(memory):>9}  {error:>8.1e}"
            yield f"    {shown:>9}  {name:{width}}  {figures}{mark}"
    yield f"    error: {about['measure']}"
    powers = [f"{name} {power:.2f}" for name in names if (power := growth(result, group, name)) is not None]
    if powers:
        yield f"    time grows with {about['size']} to the power of: {', '.join(powers)}"
    for word, said in (("failed", "failed"), ("missing", "missing"), ("chosen", "chosen by default")):
        if about.get(word):
            yield f"    {said}: {about[word]}"
