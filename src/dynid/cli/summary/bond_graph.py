"""The screen of a bond-graph result."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from textwrap import wrap
from typing import Any

import numpy as np

from dynid.cli.summary.causality import causality_lines, equation_lines
from dynid.cli.summary.channels import channel_lines
from dynid.cli.summary.port import port_lines
from dynid.cli.summary.responses import response_lines
from dynid.number_format import MOST_ROOTS, counted
from dynid.result import Result

#: Most steps, and prototypes, that are listed.
_MOST, _MOST_OUTPUTS = MOST_ROOTS, 6


def lines(result: Result) -> list[str]:
    """Return the screen, line by line."""
    need = result.group_attrs.get("bond_graph", {})
    said = [f"  {counted(int(need['nodes']), 'node')}, {counted(int(need['bonds']), 'bond')}"]
    said += _engine(need)
    said += _warnings(result)
    said += causality_lines(result)
    said += [*_reduction(result), ""]
    said += port_lines(result)
    said += channel_lines(result)
    said += equation_lines(result, "bond_graph/state_space")
    said += response_lines(result, "bond_graph")
    return said


def _engine(attributes: Mapping[str, Any]) -> Iterable[str]:
    """Say why an engine other than the exact one answered, what it cannot do, and how numbers are read."""
    engine, reason = (str(attributes.get(name, "")) for name in ("engine", "engine_reason"))
    if engine not in ("", "exact") or "decides" in reason:
        yield f"  {engine} engine: {reason}"
        if engine != "exact":
            yield from (f"    {line}" for line in wrap(str(attributes["engine_limits"]), 100))
    if attributes.get("reading") == "binary":
        yield "  every value is read as the double nearest to it (reading: binary)"


def _warnings(result: Result) -> Iterable[str]:
    """Yield what the graph leaves undetermined although no output depends on it."""
    for warning in result["bond_graph/warnings"].data if "bond_graph/warnings" in result else ():
        yield from wrap(f"warning: {warning}", 100, initial_indent="  ", subsequent_indent="    ")


def _reduction(result: Result) -> Iterable[str]:
    group = "bond_graph/reduction"
    if f"{group}/output" not in result:
        return
    letters = np.atleast_1d(result[f"{group}/prototype"].data)
    steps = result[f"{group}/steps"].data if f"{group}/steps" in result else None
    outputs = result[f"{group}/output"].data
    for place, output in enumerate(outputs[:_MOST_OUTPUTS]):
        reached = f"prototype {letters[place]}:  {result[f'{group}/prototype_equation'].data[place]}"
        own = [] if steps is None else [row for row in steps if row["output"] == output]
        count = len(own) - 1
        how = f"reduced in {counted(count, 'step')} to " if count > 0 else ""
        yield f"  {output}: {how}{reached}"
        for part in ("system_a", "system_b"):
            yield f"      {result[f'{group}/{part}'].data[place]}"
        for number, row in enumerate(own[:_MOST] if place == 0 else [], 1):
            first, *rest = wrap(f"{row['rule']}: {row['equation']}", 92, break_long_words=False)
            yield f"    {number:>2}. {first}"
            yield from (f"          {line}" for line in rest)
        if place == 0 and len(own) > _MOST:
            yield f"    … {counted(len(own) - _MOST, 'more step')} in the file"
    if len(outputs) > _MOST_OUTPUTS:
        yield f"  … {counted(len(outputs) - _MOST_OUTPUTS, 'more output')} in the file"
