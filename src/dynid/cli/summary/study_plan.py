"""The plan of a study, before it is run."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dynid.number_format import counted
from dynid.suggestions import short_paths

if TYPE_CHECKING:
    from dynid.study.plan import Plan

_ROWS = 5


def lines(plan: Plan, numbers: Sequence[int], finished: int, target: str, foreign: int = 0) -> Iterator[str]:
    """Yield what a plan says: its size, what varies and how, what is gathered, the first samples.

    Parameters
    ----------
    plan
        The plan.
    numbers
        The samples that would be looked after: all, or those of a shard.
    finished
        How many of them are finished already.
    target
        The file that they would be written to.
    foreign
        How many finished samples of that file do not belong to the study.
    """
    yield f"{plan.study.title}: {counted(len(numbers), 'sample')} of {plan.attrs['base']} ({plan.base.kind})"
    yield f"  sampling  {plan.attrs['method']}" + (f", seed {plan.seed}" if _is_drawn(plan) else "")
    if len(numbers) < plan.size:
        yield f"  shard     of {plan.size} samples, one in {plan.size // len(numbers)} or so"
    yield f"  collects  {', '.join(plan.collect) or 'every number under properties and parameters'}"
    yield f"  {target}: {finished} finished, {len(numbers) - finished} to run"
    if foreign:
        verb = "does" if foreign == 1 else "do"
        yield f"  warning: {counted(foreign, 'finished sample')} of {target} {verb} not belong to this study,"
        yield "           and would be lost: write another file with -o, or discard them with --force"
    yield ""
    yield from _table([["", "values", "from", "to"], *(_column(plan, path) for path in plan.arrays)])
    yield ""
    yield from _table(
        [
            ["sample", *short_paths(list(plan.arrays))],
            *([str(number), *_row(plan, number)] for number in numbers[:_ROWS]),
        ]
    )
    if len(numbers) > _ROWS:
        yield "  …"


def _is_drawn(plan: Plan) -> bool:
    return plan.attrs["method"] not in ("grid", "list")


def _column(plan: Plan, path: str) -> list[str]:
    values: NDArray[Any] = plan.arrays[path]
    different = np.unique(values)
    name = path if path in plan.settings else f"{path} (not set in the scene)"
    return [name, str(len(different)), _shown(different[0]), _shown(different[-1])]


def _row(plan: Plan, number: int) -> list[str]:
    return [_shown(values[number]) for values in plan.arrays.values()]


def _shown(value: Any) -> str:
    if isinstance(value, np.bool_):
        return str(value).lower()
    return f"{value:.6g}" if isinstance(value, np.floating) else str(value)


def _table(rows: list[list[str]]) -> Iterator[str]:
    """Yield rows with their columns aligned: the first to the left, numbers to the right."""
    widths = [max(len(row[place]) for row in rows) for place in range(len(rows[0]))]
    for first, *others in rows:
        cells = [f"{cell:>{width}}" for cell, width in zip(others, widths[1:], strict=True)]
        yield "  ".join(["", f"{first:<{widths[0]}}", *cells]).rstrip()
