"""Content of the report of a result: sections of definitions, tables, statements and formulas.

Every kind of result has a module with the sections of its own; those of several kinds are here: responses,
expectations, model scope, undecided verdicts, alternatives.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.number_format import counted, general, memory_text, span_text, time_text
from dynid.report.content.blocks import Content, ReportSection, Statement, TextTable, more
from dynid.report.scenes import frequency_span, peak_responses, plain_data, time_courses
from dynid.result import Result
from dynid.scene.kind import KINDS, resolve

#: Most channels and outputs that are listed.
_MOST = 30
#: Part of the largest value of a response below which a value is round-off.
_ROUND_OFF = 1e-12
#: Arrays of warnings.
_OF_GRAPH = ("bond_graph/warnings", "bond_graph/design/warnings")
_OF_IDENTIFICATION = "identification/diagnostics/warnings"
#: Content of results that are of no kind of scene.
_OTHERS = {
    "plan": "dynid.report.content.plan",
    "bench": "dynid.report.content.bench",
}


def _module(result: Result) -> Any:
    """Return the module with the content of results of a kind; None for an unknown kind."""
    kind = KINDS.get(result.kind)
    return kind.load("content") if kind else resolve(_OTHERS.get(result.kind, ""))


def content(result: Result) -> Content:
    """Return the content of the report of a result; of an unknown kind, its name only."""
    module = _module(result)
    if module is None:
        return Content(result.kind)
    sections: list[ReportSection] = [
        *module.sections(result),
        *responses(result),
        *doubtful(result),
        *expectations(result),
        *need(result),
        *accuracy(result),
    ]
    return Content(str(module.method(result)), tuple(sections))


def method(result: Result) -> str:
    """Return the kind of analysis and its method; of an unknown kind, its name."""
    module = _module(result)
    return result.kind if module is None else str(module.method(result))


def doubts(result: Result) -> list[str]:
    """Return the warnings of verdicts that round-off leaves undecided, each once."""
    texts = (str(attrs["doubt"]) for attrs in result.group_attrs.values() if "doubt" in attrs)
    return list(dict.fromkeys(f"warning: {sentence}" for sentence in texts))


def warnings(result: Result) -> list[str]:
    """Return what users must know of a result: warnings of its graph, nodes and identification."""
    from dynid.report.content.identification import cautions

    of_graph = [str(text) for path in _OF_GRAPH if path in result for text in result[path].data]
    of_nodes = result.group_attrs.get("structure/nodes", {}).get("doubt")
    return [*of_graph, *([] if of_nodes is None else [str(of_nodes)]), *cautions(result)]


def without_warnings(result: Result) -> Result:
    """Return a result for a screen beside which its `warnings` are printed."""
    shown = result
    for path in (*_OF_GRAPH, _OF_IDENTIFICATION):
        shown = shown.without(path)
    shown.group_attrs.get("structure/nodes", {}).pop("doubt", None)
    return shown


def doubtful(result: Result) -> Iterator[ReportSection]:
    """Yield the verdicts that round-off leaves undecided."""
    if found := doubts(result):
        statements = tuple(Statement(text[0].upper() + text[1:], "bad") for text in found)
        yield ReportSection("Undecided verdicts", statements, "answer")


def responses(result: Result) -> Iterator[ReportSection]:
    """Yield the peaks of frequency responses and the ranges of time responses."""
    for base in ("bond_graph", "structure"):
        group = f"{base}/frequency_response"
        if f"{group}/omega" in result:
            top = peak_responses(result, group)
            outputs, inputs = (result[f"{group}/{axis}"].data for axis in ("output", "input"))
            channels = [(k, m) for k in range(len(outputs)) for m in range(len(inputs))]
            rows = []
            for k, m in channels[:_MOST]:
                size = general(top.magnitude[k, m])
                rows.append((f"{outputs[k]} / {inputs[m]}", size, f"{general(top.at[k, m])}{top.note[k, m]}"))
            low, high, unit = frequency_span(result, group)
            count = counted(len(result[f"{group}/omega"].data), "frequency")
            heads = ("", "peak magnitude", f"frequency ({unit})")
            table = TextTable(heads, tuple(rows), caption=f"{count}, {span_text(low, high)} {unit}")
            yield ReportSection("Frequency response", (table, *more(len(channels), _MOST, "channel")))
        group = f"{base}/time_response"
        if f"{group}/time" in result:
            courses, outputs = time_courses(result, group), result[f"{group}/output"].data
            ranges = tuple((name, *extremes(course)) for name, course in courses[:_MOST])
            note = result.group_attrs.get(group, {}).get("note")
            yield ReportSection(
                "Time response",
                (
                    TextTable(("", "min", "max", "final"), ranges, caption=time_span(result, group)),
                    *([Statement(f"{note}.")] if note else []),
                    *more(len(courses), _MOST, "output" if len(courses) == len(outputs) else "response"),
                ),
            )


def extremes(column: NDArray[np.float64]) -> tuple[str, str, str]:
    """Return the smallest, the largest and the last value of a response; what is round-off of it as 0."""
    round_off = _ROUND_OFF * float(np.abs(column).max())
    low, high, final = (
        general(0.0 if abs(value) <= round_off < math.inf else value)
        for value in (column.min(), column.max(), column[-1])
    )
    return low, high, final


def time_span(result: Result, group: str) -> str:
    """Return the inputs, the duration and the number of samples of a time response."""
    time, sources, inputs = (result[f"{group}/{name}"].data for name in ("time", "source", "input"))
    driven = ", ".join(str(name) for name, column in zip(sources, inputs.T, strict=True) if column.any())
    alone = ", each alone" if result[f"{group}/response"].data.ndim == 3 else ""
    to = f"to {driven}{alone}, " if driven else ""
    return f"{to}{time[0]:.4g} … {time[-1]:.4g} s, {counted(len(time), 'sample')}"


def expectations(result: Result) -> Iterator[ReportSection]:
    """Yield the expectations of the scene, checked again; nothing where its scene cannot be read."""
    text = str(result.attrs.get("scene", ""))
    if "expect" not in text or result.attrs.get("status") == "interrupted" or result.kind == "plan":
        return  # a plan has nothing of what its scene expects of a run
    items = plain_data(text).get("expect")
    expected = [i for i in (items if isinstance(items, list) else []) if isinstance(i, dict) and "path" in i]
    if not expected:
        return
    from dynid.checks import check_expectations

    outcomes = check_expectations(result, expected)
    met = sum(outcome.passed for outcome in outcomes)
    tone = "good" if met == len(outcomes) else "bad"
    summary = Statement(f"{met} of {counted(len(outcomes), 'expectation')} met", tone)
    rows = tuple(
        (one.path, one.expected, one.found, "met" if one.passed else f"not met: {one.message}")
        for one in outcomes
    )
    failed = frozenset(place for place, one in enumerate(outcomes) if not one.passed)
    table = TextTable(("array", "expected", "found", ""), rows, failed)
    yield ReportSection("Expectations", (summary, *([table] if failed else [])), "answer")
    if not failed:
        yield ReportSection("Expectations in full", (table,))


def part_name(result: Result, part: str) -> str:
    """Return the name of a part of the model in words."""
    names = {"storages": "storage elements"}
    if result.kind == "identification":
        names["engines"] = "estimation methods"
    return names.get(part, part)


def need(result: Result) -> Iterator[ReportSection]:
    """Yield the parts of the scene that the model includes and omits, with the reasons."""
    group = next((path.rpartition("/")[0] for path in result if path.endswith("/need/part")), None)
    if group is None:
        return
    columns = ("part", "kept", "left_out", "left_out_names", "why")
    rows = tuple(
        (
            part_name(result, str(part)),
            f"{int(kept):,}",
            f"{int(left):,}",
            str(names) if len(str(names)) < 200 else "",
            str(why),
        )
        for part, kept, left, names, why in zip(
            *(result[f"{group}/{column}"].data for column in columns), strict=True
        )
    )
    yield ReportSection("Model scope", (TextTable(("", "included", "omitted", "", "reason"), rows),))


def accuracy(result: Result) -> Iterator[ReportSection]:
    """Yield the alternatives of every choice of method, with their times and errors."""
    about = result.group_attrs.get("accuracy")
    if about is None:
        return

    def entry(path: str, k: int) -> float:
        return float(result[path].data[k]) if path in result else math.nan

    def number(value: float, form: str) -> str:
        return format(value, form) if math.isfinite(value) else "-"

    aspects = dict.fromkeys(path.split("/")[1] for path in result if path.startswith("accuracy/"))
    for aspect in aspects:
        attrs = result.group_attrs[f"accuracy/{aspect}"]
        reference = f", against {attrs['reference']}" if attrs.get("reference") else ""
        rows, marked, group = list[tuple[str, ...]](), set[int](), f"accuracy/{aspect}"
        names = [str(name) for name in result[f"{group}/alternative"].data]
        for name, status in zip(names, result[f"{group}/status"].data, strict=True):
            own = f"{group}/{name}"
            for k in range(len(result[f"{own}/size"].data) if f"{own}/size" in result else 0):
                size, time, memory, error, bound = (
                    entry(f"{own}/{key}", k) for key in ("size", "time", "memory", "error", "bound")
                )
                if entry(f"{own}/chosen", k):
                    marked.add(len(rows))
                cost = (f"{int(size):,}", time_text(time), memory_text(memory))
                errors = (number(error, ".1e"), number(error / bound if bound > 0 else math.nan, ".2g"))
                rows.append((name, *cost, *errors, "Pareto-optimal" if entry(f"{own}/pareto", k) else ""))
            if status != "done":
                rows.append((name, "", "", "", "", "", str(status)))
        heads = ("", str(attrs["size"]), "time", "memory", "error", "error/bound", "")
        yield ReportSection(
            f"Alternatives: {aspect.replace('_', ' ')}",
            (
                Statement(f"{attrs['title']}: {attrs['because']}"),
                TextTable(heads, tuple(rows), frozenset(marked)),
                Statement(f"Error: {attrs['measure']}{reference}. Median of {about['repeats']}."),
            ),
        )


def array_rows(result: Result) -> list[tuple[str, str, str, str]]:
    """Return path, type, axes and units of every array, sorted by path."""
    rows = []
    for path, variable in sorted(result.items()):
        axes = " x ".join(f"{dim} {size}" for dim, size in zip(variable.dims, variable.shape, strict=True))
        dtype = variable.dtype
        kind = "table" if dtype.names else "text" if dtype.kind == "O" else dtype.name
        rows.append((path, kind, axes, variable.units))
    return rows
