"""Content on a design: designed values, targets wanted and reached, the minimum, other designs beside."""

from __future__ import annotations

import math
from collections.abc import Iterator

from dynid.number_format import counted, general, unit_text
from dynid.report.content.blocks import ReportSection, Statement, TextTable
from dynid.report.notation import texts
from dynid.report.scenes import frequency_unit
from dynid.result import Result

DESIGN = "bond_graph/design"
_MARGINS = frozenset({"phase_margin", "gain_margin", "Ms", "Mt"})
_ROOTS, _NAMES, _REACHED = (
    ("zero", "pole"),
    ("kind", "output", "input", "unit"),
    ("reached", "reached_damping"),
)


def _parameter_table(result: Result) -> TextTable:
    others = texts(result, f"{DESIGN}/compared/design")
    values = (
        result[f"{DESIGN}/compared/value"].data.T if others else [()] * len(result[f"{DESIGN}/name"].data)
    )
    parts = ("name", "start", "value", "min", "max", "bound", "influence")
    rows = []
    for compared, name, start, value, low, high, bound, used in zip(
        values, *(result[f"{DESIGN}/{column}"].data for column in parts), strict=True
    ):
        remark = "" if used else "no target depends on it"
        remark = f"at its {bound}" if bound else remark
        limits = [f"{edge:.6g}" if math.isfinite(edge) else "" for edge in (low, high)]
        cells = [general(number, 6) for number in (start, value, *compared)]
        rows.append((str(name), *cells, *limits, remark))
    heads = ("", "start", "designed", *others, "min", "max", "")
    return TextTable(heads, tuple(rows), caption="free parameters").filled()


def _target_table(result: Result) -> TextTable:
    group, unit = f"{DESIGN}/targets", frequency_unit(result)
    columns = (*_NAMES, "wanted", "wanted_damping", "damping_wanted", "start", "start_damping", *_REACHED)
    get = {column: result[f"{group}/{column}"].data for column in columns}
    others = texts(result, f"{DESIGN}/compared/design")
    rows = []
    for k, kind in enumerate(get["kind"]):
        channel = f"{get['output'][k]} / {get['input'][k]}"
        if kind in _ROOTS:
            damped = bool(get["damping_wanted"][k])
            cells = [f"{kind} of {channel}, {unit.name}{', ζ' if damped else ''}"]
            for column in ("wanted", "start", "reached"):
                cells.append(_root(get[column][k], get[f"{column}_damping"][k], unit.factor, damped))
            for row in range(len(others)):
                omega, damping = (result[f"{DESIGN}/compared/{column}"].data[row, k] for column in _REACHED)
                cells.append(_root(omega, damping, unit.factor, damped))
        elif kind in _MARGINS:
            name = str(result[f"{group}/target"].data[k]).rpartition(" of ")[0]
            cells = [name, *(general(get[p][k], 8) for p in ("wanted", "start", "reached"))]
            cells += [
                general(result[f"{DESIGN}/compared/reached"].data[row, k], 8) for row in range(len(others))
            ]
        else:
            words = {"peak": "peak", "h2": "H2 norm", "hinf": "H∞ norm"}
            word = words.get(str(kind), str(result[f"{group}/target"].data[k]))
            measured = unit_text(str(get["unit"][k]))
            measure = f", {measured}" if measured else ""
            cells = [
                f"{word} of {channel}{measure}" if str(kind) in words else word,
                "least",
                *(general(get[p][k], 6) for p in ("start", "reached")),
            ]
            cells += [
                general(result[f"{DESIGN}/compared/reached"].data[row, k], 6) for row in range(len(others))
            ]
        rows.append(tuple(cells))
    heads = ("", "wanted", "start", "designed", *others)
    return TextTable(heads, tuple(rows), caption="targets").filled()


def _root(omega: float, damping: float, factor: float, damped: bool) -> str:
    if math.isinf(omega):
        return "none"
    return f"{factor * omega:.6g}{f', {damping:.4g}' if damped else ''}"


def statements(result: Result) -> Iterator[Statement]:
    """Yield sentences on how the design was found."""
    about, counts = result.group_attrs[DESIGN], result[f"{DESIGN}/optima/count"].data
    starts = counted(int(about["starts"]), "start")
    if f"{DESIGN}/optimum" in result:
        if result.value(f"{DESIGN}/optimum"):
            equal = int(result.value(f"{DESIGN}/active_maxima"))
            maxima = f", {equal} equal maxima" if equal > 1 else ""
            residual = result.value(f"{DESIGN}/stationarity")
            yield Statement(f"a minimum{maxima}: the first-order conditions hold to {residual:.1g}", "good")
        for text in result[f"{DESIGN}/warnings"].data if f"{DESIGN}/warnings" in result else ():
            yield Statement(f"warning: {text}", "bad")
    else:
        yield Statement("every target is met", "good")
    ended = f"{int(about['ended'])} of {starts} ended in a solution"
    others = len(counts) - 1
    if others:
        local = result[f"{DESIGN}/optima/objective"].data[1:]
        minimised = f"{DESIGN}/optimum" in result
        words = ("local minimum", "local minima") if minimised else ("solution", "solutions")
        values = f" with {', '.join(general(value, 6) for value in local[:4])}" if minimised else ""
        yield Statement(f"{ended}, {counts[0]} in this one; {others} other {words[others > 1]}{values}")
    else:
        here = "all" if counts[0] == about["ended"] else str(counts[0])
        yield Statement(f"{ended}, {here} in this one" if int(about["ended"]) > 1 else ended)


def design_sections(result: Result) -> Iterator[ReportSection]:
    """Yield the section on the design."""
    if f"{DESIGN}/value" not in result:
        return
    blocks = (_parameter_table(result), _target_table(result), *statements(result))
    yield ReportSection("Design", blocks, "answer", screen="design")
