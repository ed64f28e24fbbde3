"""The screen of an identification."""

from __future__ import annotations

from collections.abc import Iterable
from io import StringIO

import numpy as np

from dynid.cli.summary.numbers import quantity
from dynid.cli.summary.responses import response_lines
from dynid.result import Result

#: Half width of a 95 % interval in standard errors.
_WIDE = 1.959963984540054


def method(result: Result) -> str:
    """Name the kind of analysis, and how often the filter went over the record."""
    if "identification/diagnostics/passes" not in result:
        return "structure"
    passes = result.value("identification/diagnostics/passes")
    return f"identification · {passes} filter pass{'es' if passes > 1 else ''}"


def lines(result: Result) -> list[str]:
    """Return the screen, line by line."""
    said: list[str] = []
    if "identification/parameters/name" in result:
        said += [_record(result), "", *_table(result), "", *_verdict(result), ""]
    said += response_lines(result, "structure")
    return said[:-1] if not said[-1] else said


def _record(result: Result) -> str:
    measured = result["identification/measurement/measured"].data
    channels = ", ".join(result["identification/measurement/channel"].data)
    missing = int(np.isnan(measured).sum())
    gaps = f", {missing} missing" if missing else ""
    states = len(result["identification/history/component"].data)
    unknowns = len(result["identification/parameters/name"].data)
    return (
        f"  {states} physical states, {unknowns} unknown parameters; "
        f"{len(measured)} samples of {channels}{gaps}"
    )


def _table(result: Result) -> list[str]:
    """Return the parameters: start, estimate with its error, interval, and truth and bound where known."""
    from rich.console import Console
    from rich.table import Table

    get = {
        name.rpartition("/")[2]: v.data
        for name, v in result.items()
        if name.startswith("identification/parameters/")
    }
    known = bool(np.isfinite(get["true"]).any())
    table = Table(box=None, padding=(0, 2), show_edge=False, header_style="")
    for heading in ("", "start", "estimate", "95 % interval", *(("true", "error") if known else ()), "bound"):
        table.add_column(heading, justify="right" if heading else "left")
    for k, name in enumerate(get["name"]):
        estimate, error = get["estimate"][k], get["standard_error"][k]
        low, high = estimate - _WIDE * error, estimate + _WIDE * error
        truth = (quantity(get["true"][k]), f"{get['error_percent'][k]:.2g} %") if known else ()
        row = (
            f"{name} [{get['unit'][k]}]".replace("[", r"\["),
            quantity(get["start"][k]),
            f"{quantity(estimate, error)} ± {error:.2g}",
            f"{quantity(low, error)} … {quantity(high, error)}",
            *truth,
            f"{100 * get['cramer_rao'][k] / estimate:.2g} %",
        )
        table.add_row(*row)
    out = StringIO()
    Console(file=out, width=140, color_system=None).print(table)
    return [f"  {line}".rstrip() for line in out.getvalue().splitlines()]


def _verdict(result: Result) -> Iterable[str]:
    group = "identification/diagnostics"
    converged = (
        "converged" if result.value(f"{group}/converged") else "NOT converged: the residuals are not noise"
    )
    p = result.value(f"{group}/whiteness_p")
    ratio = 100 * result[f"{group}/residual_ratio"].data
    left = f"residual {', '.join(f'{value:.2g} %' for value in ratio)} of the signal"
    condition = result.value(f"{group}/condition")
    yield f"  {converged} · {left} · white with p = {p:.2g} · condition {condition:.2g}"
    relative = (
        result["identification/parameters/standard_error"].data
        / result["identification/parameters/estimate"].data
    )
    names = result["identification/parameters/name"].data
    yield f"  least certain: {names[int(np.argmax(relative))]} (standard error {100 * relative.max():.2g} %)"
