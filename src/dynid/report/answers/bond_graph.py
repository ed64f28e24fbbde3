"""What is said of a bond graph: its transfer functions first, then how they came about."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dynid.numerals import counted
from dynid.report.answers.blocks import Block, Facts, Note, Part, Steps, facts
from dynid.report.answers.channels import channel_parts
from dynid.report.answers.common import listed, more
from dynid.report.answers.port import PORT, port_items
from dynid.result import Result

#: Most steps, prototypes, states and remarks that are listed.
_STEPS, _OUTPUTS, _STATES, _REMARKS = 60, 12, 12, 12
_REDUCTION, _CAUSALITY = "bond_graph/reduction", "bond_graph/causality"
#: Longest formula that is shown.
_LONGEST = 400


def method(result: Result) -> str:
    """Name the kind of analysis and its engine."""
    engine = result.group_attrs.get("bond_graph", {}).get("engine")
    return f"bond graph · {engine} engine" if engine else "bond graph"


def parts(result: Result) -> Iterator[Part]:
    """Yield what is said of a bond graph."""
    yield from channel_parts(result)
    yield from _port(result)
    if f"{_REDUCTION}/output" in result:
        yield Part("Reduction", tuple(_reduction(result)))
    if f"{_CAUSALITY}/bonds" in result:
        yield Part("Causality", tuple(_causality(result)))
    yield from _equations(result)
    yield Part("Graph", tuple(_graph(result)))


def _graph(result: Result) -> Iterator[Block]:
    about = result.group_attrs.get("bond_graph", {})
    if "nodes" in about:
        size = f"{counted(int(about['nodes']), 'node')}, {counted(int(about['bonds']), 'bond')}"
        yield facts(("size", size), ("engine", str(about.get("engine_reason", ""))))
    if about.get("engine", "exact") != "exact":
        yield Note(str(about.get("engine_limits", "")))
    if about.get("reading") == "binary":
        yield Note("Every value is read as the double nearest to it (reading: binary).")


def _reduction(result: Result) -> Iterator[Block]:
    get = {
        name: np.atleast_1d(result[f"{_REDUCTION}/{name}"].data)
        for name in ("output", "prototype", "prototype_equation", "system_a", "system_b")
    }
    items = []
    for place, output in enumerate(get["output"][:_OUTPUTS]):
        lines = [f"prototype {get['prototype'][place]}:  {get['prototype_equation'][place]}"]
        lines += [str(get[part][place]) for part in ("system_a", "system_b")]
        items.append((str(output), tuple(line for line in lines if len(line) < _LONGEST)))
    yield Facts(tuple(items))
    yield from more(len(get["output"]), _OUTPUTS, "output")
    if f"{_REDUCTION}/steps" in result:
        steps = result[f"{_REDUCTION}/steps"].data
        own = [row for row in steps if row["output"] == get["output"][0]]
        shown = (f"{row['rule']}: {row['equation']}" for row in own[:_STEPS])
        yield Steps(tuple(line if len(line) < _LONGEST else f"{line[:_LONGEST]}…" for line in shown))
        yield from more(len(own), _STEPS, "step")


def _port(result: Result) -> Iterator[Part]:
    items = list(port_items(result, _LONGEST))
    if items:
        yield Part(f"Port {result.group_attrs[PORT]['bond']}", (facts(*items),))


def _causality(result: Result) -> Iterator[Block]:
    states = result[f"{_CAUSALITY}/states"].data["name"]
    yield facts(("states", f"{len(states)}: {listed(states, _STATES)}" if len(states) else "none"))
    for table, title in (("conflicts", "conflict"), ("dependent_storages", "dependent"), ("loops", "loop")):
        meanings = [str(text) for text in result[f"{_CAUSALITY}/{table}"].data["meaning"]]
        tone = "bad" if table == "conflicts" else ""
        yield from (Note(f"{title}: {meaning}", tone) for meaning in meanings[:_REMARKS])
        yield from more(len(meanings), _REMARKS, title)
    prefix = f"{_CAUSALITY}/zero_dynamics/"
    channels = [path for path in result if path.startswith(prefix) and path.endswith("/meaning")]
    rows = [
        (path.removeprefix(prefix).removesuffix("/meaning"), str(result.value(path))) for path in channels
    ]
    if rows:
        yield facts(*((f"zeros of {name.replace('/', ' / ')}", said) for name, said in rows[:_REMARKS]))


def _equations(result: Result) -> Iterator[Part]:
    group = "bond_graph/state_space"
    names = (name for name in ("definitions", "equations", "output_equations") if f"{group}/{name}" in result)
    lines = [str(line) for name in names for line in result[f"{group}/{name}"].data]
    if lines:
        shown = tuple(line if len(line) < _LONGEST else f"{line[:_LONGEST]}…" for line in lines[:_STEPS])
        yield Part("State equations", (Steps(shown), *more(len(lines), _STEPS, "line")))
