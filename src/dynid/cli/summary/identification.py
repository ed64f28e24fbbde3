"""The screen of an identification."""

from __future__ import annotations

import math
from collections.abc import Iterable
from io import StringIO

from dynid.cli.summary.identifiability import identifiability_lines
from dynid.cli.summary.responses import response_lines
from dynid.number_format import counted
from dynid.report.content.identifiability import calibration_sentences as calibration
from dynid.report.content.identification import (
    parameter_table,
    preparation,
    record_summary,
    verdict_sentences,
)
from dynid.report.scenes import frequency_unit
from dynid.result import Result

#: The most modes and massless DOFs on the screen.
_MOST_MODES, _SHOWN = 20, 8


def lines(result: Result) -> list[str]:
    """Return the screen, line by line."""
    said: list[str] = []
    if "identification/parameters/name" in result:
        said += [
            f"  {record_summary(result)}",
            *(f"  {line}" for line in preparation(result)),
            "",
            *_table(result),
            "",
            *(f"  {sentence}" for sentence in verdict_sentences(result)),
            *(f"  {sentence}" for sentence in calibration(result)),
            "",
        ]
    said += identifiability_lines(result)
    if "structure/modes/omega" in result:
        said += [*_modes(result), ""]
    said += response_lines(result, "structure")
    return said[:-1] if not said[-1] else said


def _modes(result: Result) -> Iterable[str]:
    """Yield the modes, one a line, and what has none."""
    group = "structure/modes"
    get = {name: result[f"{group}/{name}"].data for name in ("omega", "damping", "name")}
    count, size = len(get["omega"]), len(result[f"{group}/dof"].data)
    without = list(result[f"{group}/massless"].data) if f"{group}/massless" in result else []
    rigid = int(result.value(f"{group}/rigid"))
    said = f"  {counted(count, 'mode')} of {counted(size, 'DOF')}; {_none_or(rigid, 'rigid-body mode')}"
    yield f"{said}, {_none_or(len(without), 'massless DOF')}"
    if len(without):
        shown = ", ".join(without[:_SHOWN])
        yield f"    massless: {shown}{f' … {without[-1]}' if len(without) > _SHOWN else ''}"
    yield f"    {'mode':>4}  {'rad/s':>10}  {'Hz':>10}  {'damping':>9}"
    for k in range(min(count, _MOST_MODES)):
        omega, damping, name = (get[part][k] for part in ("omega", "damping", "name"))
        line = (
            f"    {k + 1:>4}  {omega:>10.5g}  {omega / (2 * math.pi):>10.5g}  {100 * damping:>7.3g} %  {name}"
        )
        yield line.rstrip()
    if count > _MOST_MODES:
        unit = frequency_unit(result)
        yield f"    … up to {unit.factor * get['omega'][-1]:.5g} {unit.name}"


def _none_or(count: int, what: str) -> str:
    return counted(count, what) if count else f"no {what}s"


def _table(result: Result) -> list[str]:
    """Return the parameters as aligned lines."""
    from rich.console import Console
    from rich.table import Table

    columns, rows = parameter_table(result)
    table = Table(box=None, padding=(0, 2), show_edge=False, header_style="")
    for heading in columns:
        table.add_column(heading, justify="right" if heading else "left")
    for name, *cells in rows:
        table.add_row(name.replace("[", r"\["), *cells)
    out = StringIO()
    Console(file=out, width=140, color_system=None).print(table)
    return [f"  {line}".rstrip() for line in out.getvalue().splitlines()]
