"""The screen of benchmarks: a table each, what nothing beats marked."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import groupby
from textwrap import wrap

from dynid.number_format import memory_text, time_text
from dynid.report.content.bench import benchmark_rows, remarks
from dynid.result import Result


def lines(result: Result) -> list[str]:
    """Return the screen, line by line."""
    said: list[str] = []
    for group in dict.fromkeys("/".join(path.split("/")[:2]) for path in result):
        said += [*_table(result, group), ""]
    about = result.group_attrs.get("bench", {})  # files of versions before know none
    seconds = float(about.get("seconds", 0))
    return [*said, f"  measured in {time_text(seconds)}"] if seconds else said[:-1]


def _table(result: Result, group: str) -> Iterable[str]:
    about = result.group_attrs[group]
    yield f"  {group.partition('/')[2]}: {about['title']}"
    names = list(dict.fromkeys(path.split("/")[2] for path in result if path.startswith(f"{group}/")))
    rows = [row for name in names for row in benchmark_rows(result, group, name)]
    width = max(map(len, names))
    yield f"    {about['size']:>9}    {'':{width}}  {'time':>10}  {'memory':>9}  {'error':>8}"
    for size, some in groupby(sorted(rows, key=lambda row: row.size), key=lambda row: row.size):
        for place, row in enumerate(some):
            shown, chosen = f"{size:,}" if place == 0 else "", "›" if row.default else " "
            figures = f"{time_text(row.time):>10}  {memory_text(row.memory):>9}  {row.error:>8.1e}"
            yield f"    {shown:>9}  {chosen} {row.name:{width}}  {figures}{' ●' if row.best else ''}"
    for said, text in remarks(result, group):
        yield from wrap(f"{said}: {text}", 110, initial_indent=" " * 4, subsequent_indent=" " * 6)
