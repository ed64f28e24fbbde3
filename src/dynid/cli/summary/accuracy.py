"""Tables of the alternatives to each choice of a scene, with their cost and error."""

from __future__ import annotations

import math
from collections.abc import Iterable
from textwrap import wrap

from dynid.number_format import memory_text, time_text
from dynid.result import Result

_GROUP = "accuracy"


def accuracy_lines(result: Result) -> list[str]:
    """Return the tables, line by line; none where nothing was tried."""
    about = result.group_attrs.get(_GROUP)
    if about is None:
        return []
    aspects = [path.split("/")[1] for path in result if path.startswith(f"{_GROUP}/")]
    spent = f"median of {about['repeats']}, at most {about['budget']:g} s in all"
    said = [f"  what else could have been chosen: {spent}"]
    for aspect in dict.fromkeys(aspects):
        said += _table(result, f"{_GROUP}/{aspect}")
    return [*said, "", "  → the choice · ● nothing is both faster and more accurate"]


def _table(result: Result, group: str) -> Iterable[str]:
    about = result.group_attrs[group]
    names = [str(name) for name in result[f"{group}/alternative"].data]
    status = dict(zip(names, result[f"{group}/status"].data, strict=True))
    width = max(map(len, names))
    bounded = any(f"{group}/{name}/bound" in result for name in names)
    heading = f"{about['title']}: {about['because']}"
    yield ""
    yield from (f"  {line}" for line in wrap(heading, 100, subsequent_indent="  "))
    columns = f"{'':{width}}  {about['size']:>11}  {'time':>9}  {'memory':>8}  {'error':>8}"
    yield f"      {columns}{'  error/bound' if bounded else ''}"
    for name in names:
        yield from _rows(result, f"{group}/{name}", name, width)
        if status[name] != "done":
            yield from (
                f"      {line}"
                for line in wrap(f"{name:{width}}  {status[name]}", 96, subsequent_indent=" " * (width + 2))
            )
    reference = f", against {about['reference']}" if about["reference"] else ""
    yield f"      error: {about['measure']}{reference}"


def _rows(result: Result, group: str, name: str, width: int) -> Iterable[str]:
    if f"{group}/size" not in result:
        return
    size, time, memory, best, chosen = (
        result[f"{group}/{column}"].data for column in ("size", "time", "memory", "pareto", "chosen")
    )
    error, bound = (
        result[f"{group}/{column}"].data if f"{group}/{column}" in result else None
        for column in ("error", "bound")
    )
    for k, count in enumerate(size):
        figures = f"{time_text(float(time[k])):>9}  {memory_text(float(memory[k])):>8}"
        off = "-" if error is None else f"{error[k]:.1e}"
        ratio = "" if bound is None or error is None else f"  {_ratio(float(error[k]), float(bound[k])):>11}"
        mark = "→" if chosen[k] else " "
        line = f"    {mark} {name:{width}}  {count:>11,}  {figures}  {off:>8}{ratio}{' ●' if best[k] else ''}"
        yield line.rstrip()


def _ratio(error: float, bound: float) -> str:
    return "-" if not bound or math.isinf(bound) else f"{error / bound:.2g}"
