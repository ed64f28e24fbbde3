"""Screens of benchmarks: a table for each, the Pareto-optimal alternatives marked."""

from __future__ import annotations

import math
from collections.abc import Iterable
from itertools import groupby

from dynid.cli.summary.common import wrapped
from dynid.number_format import memory_text, time_text
from dynid.report.content.bench import benchmark_rows, machine_text, remarks
from dynid.result import Result


def lines(result: Result) -> list[str]:
    """Return the screen of a benchmark result, line by line."""
    screen: list[str] = []
    for group in dict.fromkeys("/".join(path.split("/")[:2]) for path in result):
        about = result.group_attrs[group]
        screen.append(f"  {group.partition('/')[2]}: {about['title']}")
        names = list(dict.fromkeys(path.split("/")[2] for path in result if path.startswith(f"{group}/")))
        rows = [row for name in names for row in benchmark_rows(result, group, name)]
        width = max(map(len, names))
        screen.append(f"    {about['size']:>9}    {'':{width}}  {'time':>10}  {'memory':>9}  {'error':>8}")
        for size, some in groupby(sorted(rows, key=lambda row: row.size), key=lambda row: row.size):
            for place, row in enumerate(some):
                shown, chosen = f"{size:,}" if place == 0 else "", "›" if row.default else " "
                figures = f"{time_text(row.time):>10}  {memory_text(row.memory):>9}  {row.error:>8.1e}"
                best = " ●" if row.best else ""
                screen.append(f"    {shown:>9}  {chosen} {row.name:{width}}  {figures}{best}")
        for name, text in remarks(result, group):
            screen += wrapped(f"{name}: {text}", 110, initial_indent=" " * 4, subsequent_indent=" " * 6)
        screen.append("")
    about = result.group_attrs.get("bench", {})  # absent in files of earlier versions
    if about.get("skipped"):
        screen += wrapped(f"skipped: {about['skipped']}", 110, initial_indent="  ", subsequent_indent="    ")
    seconds = float(about.get("seconds", 0))
    where = "".join(f" on {one}" for one in machine_text(result))
    text = f"measured in {time_text(seconds)}{where}"
    measured = wrapped(text, 110, initial_indent="  ", subsequent_indent="    ")
    return [*screen, *measured] if seconds else screen[:-1]


def accuracy_lines(result: Result) -> list[str]:
    """Return the tables of the alternatives to each choice of a scene, line by line; none if not computed."""
    summary = result.group_attrs.get("accuracy")
    if summary is None:
        return []
    effort = f"median of {summary['repeats']}, at most {summary['budget']:g} s in all"
    screen = [f"  alternatives to the choices made: {effort}"]
    for aspect in dict.fromkeys(path.split("/")[1] for path in result if path.startswith("accuracy/")):
        group = f"accuracy/{aspect}"
        about = result.group_attrs[group]
        names = [str(name) for name in result[f"{group}/alternative"].data]
        width = max(map(len, names))
        bounded = any(f"{group}/{name}/bound" in result for name in names)
        heading = f"{about['title']}: {about['because']}"
        size_width = max(11, len(str(about["size"])))
        columns = f"{'':{width}}  {about['size']:>{size_width}}  {'time':>9}  {'memory':>8}  {'error':>8}"
        screen += ["", *(f"  {line}" for line in wrapped(heading, 100, subsequent_indent="  "))]
        screen.append(f"      {columns}{'  error/bound' if bounded else ''}")
        for name, status in zip(names, result[f"{group}/status"].data, strict=True):
            if f"{group}/{name}/size" in result:
                screen += _accuracy_rows(result, f"{group}/{name}", f"{name:{width}}", size_width)
            if status != "done":
                parts = wrapped(f"{name:{width}}  {status}", 96, subsequent_indent=" " * (width + 2))
                screen += (f"      {line}" for line in parts)
        reference = f", against {about['reference']}" if about["reference"] else ""
        screen.append(f"      error: {about['measure']}{reference}")
    return [*screen, "", "  → the choice · ● Pareto-optimal: nothing is both faster and more accurate"]


def _accuracy_rows(result: Result, group: str, name: str, width: int) -> Iterable[str]:
    """Yield the measurements of one alternative, one line per size."""
    size, time, memory, best, chosen = (
        result[f"{group}/{column}"].data for column in ("size", "time", "memory", "pareto", "chosen")
    )
    error, bound = (
        result[f"{group}/{column}"].data if f"{group}/{column}" in result else None
        for column in ("error", "bound")
    )
    for k, count in enumerate(size):
        figures = f"{time_text(float(time[k])):>9}  {memory_text(float(memory[k])):>8}"
        off, ratio = "-" if error is None or math.isnan(error[k]) else f"{error[k]:.1e}", ""
        if error is not None and bound is not None:
            finite = bound[k] and math.isfinite(bound[k]) and math.isfinite(error[k])
            ratio = f"  {f'{error[k] / bound[k]:.2g}' if finite else '-':>11}"
        mark = "→" if chosen[k] else " "
        row = f"    {mark} {name}  {count:>{width},}  {figures}  {off:>8}{ratio}{' ●' if best[k] else ''}"
        yield row.rstrip()
