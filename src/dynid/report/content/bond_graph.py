"""Content of bond graphs: transfer functions, the port, the reduction, causality, equations of state."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from dynid.number_format import MOST_ROOTS, counted, general, limit, roots_text, unit_text
from dynid.report.content.blocks import (
    Block,
    DefinitionList,
    Formula,
    NumberedList,
    ReportSection,
    Statement,
    TextTable,
    definitions,
    joined,
    on_page,
    on_screen,
)
from dynid.report.content.design import design_sections
from dynid.report.content.responses import response_sections
from dynid.report.content.transfer_functions import (
    approximate,
    channel_sections,
    energy_sections,
)
from dynid.report.notation import texts
from dynid.report.scenes import frequency_unit, in_hertz, time_courses
from dynid.result import Result

PORT, POINT = "bond_graph/port", "bond_graph/operating_point"
#: Most steps, responses, states, remarks and bonds that are listed.
_STEPS, _OUTPUTS, _STATES, _REMARKS, _BONDS = 60, 12, 12, 12, 24
_REDUCTION, _CAUSALITY = "bond_graph/reduction", "bond_graph/causality"
#: Longest formula that is shown.
_FORMULA_LENGTH = 400
#: Most variables and slopes of an operating point.
_POINTS, _FEW = 40, 3
#: Margins of a loop, with their units, and where the frequency of each is.
_MARGINS = {
    "gain": ("", "phase_crossover"),
    "phase": ("°", "gain_crossover"),
    "delay": (" s", ""),
    "Ms": ("", ""),
    "Mt": ("", ""),
}


def method(result: Result) -> str:
    """Return the kind of analysis and its engine."""
    engine = result.group_attrs.get("bond_graph", {}).get("engine")
    return f"bond graph · {engine} engine" if engine else "bond graph"


def sections(result: Result) -> Iterator[ReportSection]:
    """Yield the content of a bond graph."""
    warnings = texts(result, "bond_graph/warnings")
    delays = str(result.group_attrs.get("bond_graph", {}).get("delays", ""))  # what is approximate with them
    if verdict := system_text(result):
        statement = Statement(f"whole system: {verdict}", "" if verdict.startswith("stable") else "bad")
        yield ReportSection("Whole system", (statement,), "answer", screen="")
    if warnings:
        yield ReportSection("Warnings", tuple(Statement(text, "bad") for text in warnings), "answer")
    yield from _operating_point(result)
    if delays:
        yield ReportSection("Delays", (Statement(delays),), "answer")
    answers = [
        *design_sections(result),
        *channel_sections(result),
        *_loops(result),
        *_port(result),
        *energy_sections(result),
        *_state_equations(result),
        *response_sections(result, "bond_graph"),
    ]
    if facts := tuple(_nonlinear_facts(result)):
        answers.append(ReportSection("Range of the linear response", facts, screen=""))
    yield from answers
    for section in (*causality_sections(result), *_reduction(result)):
        # Where nothing else is requested, the derivations are the answer.
        yield section if answers else replace(section, detail="")
    yield from _graph(result, [delays] if delays else [], warnings)


def _state_equations(result: Result) -> Iterator[ReportSection]:
    """Yield the state equations; on screens if they are few."""
    group = "bond_graph/state_space"
    names = ("definitions", "equations", "output_equations")
    lines = [line for name in names for line in texts(result, f"{group}/{name}")]
    if lines:
        title = f"tate equations{approximate(result, f'{group}/A')}"
        brief = _STATES if len(lines) <= _STATES else 0
        equations = replace(_formulas(lines), noun="line", brief=brief, most=_STEPS)
        yield ReportSection(f"S{title}", (equations,), "derivation", screen=f"s{title}")


def _graph(result: Result, remarks: list[str], warnings: list[str]) -> Iterator[ReportSection]:
    """Yield the size of the graph, the engine with its limits, approximations, and warnings on screens."""
    about = result.group_attrs.get("bond_graph", {})
    engine, reason = (str(about.get(name, "")) for name in ("engine", "engine_reason"))
    blocks: list[Block] = []
    if "nodes" in about:
        size = f"{counted(int(about['nodes']), 'node')}, {counted(int(about['bonds']), 'bond')}"
        in_time = "delays" in about or "bond_graph/sampled/pole" in result
        if "bond_graph/margins/loop" in result and not in_time:
            size += ", controllers and their delays included"
        blocks = [on_page(definitions(("size", size), ("engine", reason))), on_screen(Statement(size))]
    if engine not in ("", "exact") or "decides" in reason:
        blocks.append(on_screen(Statement(f"{engine} engine: {reason}")))
    if engine not in ("", "exact"):
        blocks.append(Statement(str(about.get("engine_limits", ""))))
    blocks += (on_screen(Statement(text)) for text in remarks)
    blocks += map(Statement, texts(result, "bond_graph/approximations"))
    if about.get("reading") == "binary":
        blocks.append(Statement("every value is read as the double nearest to it (reading: binary)"))
    blocks += (on_screen(Statement(f"warning: {text}", "bad")) for text in warnings)
    yield ReportSection("Graph", tuple(blocks), screen="")


def system_text(result: Result) -> str:
    """Return the verdict on the whole system; '' where it adds nothing to those of the channels."""
    if "bond_graph/system/stability" not in result:
        return ""
    kind, reason = (str(result.value(f"bond_graph/system/{name}")) for name in ("stability", "reason"))
    if "bond_graph/margins/loop" not in result and "bond_graph/margins/pole" not in result:
        paths = [path for path in result if path.startswith("bond_graph/properties/")]
        kinds = {str(result.value(path)) for path in paths if path.endswith("/stability")}
        if kinds and all(text.startswith(kind) for text in kinds):
            return ""
    return f"{kind}: {reason}" if reason else kind


def _point_facts(result: Result) -> Iterator[tuple[str, str]]:
    """Yield what was found of the operating point, its constant inputs, residual and condition."""
    about = result.group_attrs[POINT]
    state = str(about["status"])
    if f"{POINT}/stability" in result:
        kinds = [str(kind) for kind in result[f"{POINT}/stability"].data]
        number = int(result.value(f"{POINT}/chosen"))
        state += (
            f", {kinds[number - 1]}"
            if len(kinds) == 1
            else f" ({', '.join(kinds)}); number {number} is analysed"
        )
    yield "point", state
    names, values = (result[f"{POINT}/{name}"].data for name in ("input", "input_value"))
    if len(names):
        yield "inputs", ", ".join(f"{n} = {v:.6g}" for n, v in zip(names, values, strict=True))
    residual, condition = (float(result.value(f"{POINT}/{name}")) for name in ("residual", "condition"))
    yield "accuracy", f"residual {residual:.1g} of the terms, condition {condition:.2g}"
    if flat := about.get("flat"):
        yield "zero slopes", f"{flat}: no effort or flow of its own in the linearisation"
    yield "note", str(about["note"])


def _nonlinear_facts(result: Result) -> Iterator[Statement]:
    """Yield how far the nonlinear response is from the linear one, or why there is none."""
    group = "bond_graph/time_response"
    about = result.group_attrs.get(group, {})
    if "nonlinear" in about:
        yield Statement(f"nonlinear response {about['nonlinear']}")
    if f"{group}/nonlinear_deviation" not in result:
        return
    shares = result[f"{group}/nonlinear_deviation"].data.ravel()
    names = [name for name, _ in time_courses(result, group)]
    for name, share in list(zip(names, shares, strict=True))[:_OUTPUTS]:
        off = f"the nonlinear response is off the linear one by {100 * share:.3g} % of its maximum"
        yield Statement(off, head=f"{name}:")
    if len(names) > _OUTPUTS:
        yield Statement(f"… {counted(len(names) - _OUTPUTS, 'more response')} in the file")
    how = "exact from sample to sample"
    if "nonlinear_tolerance" in about:
        how = f"integrated with relative tolerance {float(about['nonlinear_tolerance']):.0e}"
    yield Statement(f"{how}; estimated error {float(about['nonlinear_error']):.1g} of the maximum")


def _of_point(result: Result, name: str, value: str, unit: str) -> list[tuple[str, str]]:
    """Return names and values of the operating point as text; without the values that are unknown."""
    if f"{POINT}/{name}" not in result:
        return []
    names, values = result[f"{POINT}/{name}"].data, result[f"{POINT}/{value}"].data
    units = result[f"{POINT}/{unit}"].data if f"{POINT}/{unit}" in result else [""] * len(names)
    return [
        (str(name), f"{limit(size)} {unit_text(unit)}".rstrip())
        for name, size, unit in zip(names, values, units, strict=True)
        if size == size
    ]


def _operating_point(result: Result) -> Iterator[ReportSection]:
    if POINT not in result.group_attrs:
        return
    point, *others = _point_facts(result)
    slopes = TextTable(
        ("slope", "value"),
        tuple(_of_point(result, "slope", "slope_value", "slope_unit")),
        noun="slope",
        brief=MOST_ROOTS,
    )
    variables = tuple(_of_point(result, "variable", "value", "unit"))
    values = TextTable(("variable", "value"), variables, noun="variable", most=_POINTS)
    facts = definitions(*others)
    few = replace(slopes, most=_FEW, reader="page")
    brief = (definitions(point), few, on_screen(facts), on_screen(slopes))
    yield ReportSection("Operating point", _with_rows(brief), "answer", screen="operating point")
    full = (facts, replace(slopes, most=_POINTS), values)
    yield ReportSection("Operating point in full", _with_rows(full))


def _with_rows(blocks: tuple[Block, ...]) -> tuple[Block, ...]:
    """Return the nodes without tables that have no rows."""
    return tuple(block for block in blocks if not isinstance(block, TextTable) or block.rows)


def _margin_texts(result: Result, loop: int) -> dict[str, str]:
    """Return the margins of the loop at a place; those of gain and phase with their crossover frequencies.

    None of them is defined where the closed loop is not stable: its S and T are of no steady response.
    """
    unit, margins = frequency_unit(result), {}
    stable = bool(result["bond_graph/margins/stable"].data[loop])
    for name, (sign, crossover) in _MARGINS.items():
        size, where = float(result[f"bond_graph/margins/{name}"].data[loop]), ""
        if np.isnan(size) or not stable:
            margins[name] = "undecided" if stable else "not defined"
            continue
        if crossover:
            at = float(result[f"bond_graph/margins/{crossover}"].data[loop]) * unit.factor
            where = f" at {at:.4g} {unit.name}" if np.isfinite(at) else " at high frequencies"
        margins[name] = f"{size:.4g}{sign}{where}" if np.isfinite(size) else "∞"
    return margins


def _loops(result: Result) -> Iterator[ReportSection]:
    """Yield gains of states, margins of loops, each with the others closed, and poles in z or with delays."""
    group = "bond_graph/margins"
    if "bond_graph/state_feedback/gain" in result:
        yield _state_gains(result)
    if f"{group}/loop" in result:
        yield _margin_table(result)
    if "bond_graph/sampled/poles" in result:
        yield from _sampling(result)
    if f"{group}/poles" in result:
        poles = result[f"{group}/poles"]
        text = roots_text(poles.data, hertz=in_hertz(result))
        items = definitions(("poles", text), ("", str(poles.attrs["note"])))
        yield ReportSection("Poles with delays", (items,), screen="poles with delays")


def _state_gains(result: Result) -> ReportSection:
    """Return the gains of states by driven source, and the poles of the closed loop."""
    group = "bond_graph/state_feedback"
    names = ("state", "source", "gain", "poles")
    states, sources, gains, poles = (result[f"{group}/{name}"].data for name in names)
    rows = tuple((str(state), *map(general, row)) for state, row in zip(states, gains.T, strict=True))
    least = result.group_attrs[group]["method"] == "lqr"
    what = "of least quadratic cost (LQR)" if least else "that place the poles"
    caption = f"gains {what}; a source gives its reference less gains times states"
    table = TextTable(("", *map(str, sources)), rows, noun="state", caption=caption)
    items = definitions(("poles", roots_text(poles, hertz=in_hertz(result))))
    return ReportSection("State feedback", (table, items), "answer", screen="state feedback")


def _margin_table(result: Result) -> ReportSection:
    """Return the margins of the feedback loops."""
    group = "bond_graph/margins"
    names, stabilities, stable = (result[f"{group}/{name}"].data for name in ("loop", "stability", "stable"))
    reasons = texts(result, f"{group}/undecided") or [""] * len(names)
    rows = tuple(
        (str(loop), *_margin_texts(result, k).values(), str(stabilities[k]).partition(":")[0])
        for k, loop in enumerate(names)
        if not reasons[k].startswith("left out")
    )
    heads = ("", "gain margin", "phase margin", "delay margin", "Ms", "Mt", "closed loop")
    blocks: list[Block] = [TextTable(heads, rows, noun="loop")]
    if not stable.all():
        blocks.append(Statement("margins, Ms and Mt are not defined where the closed loop is not stable"))
    for k, loop in enumerate(names[: len(rows)]):
        blocks += (Statement(text, head=f"{loop}:") for text in _loop_remarks(result, k))
    blocks += (Statement(f"undecided: {reason}") for reason in dict.fromkeys(filter(None, reasons)))
    return ReportSection("Feedback loops", tuple(blocks), "answer", screen="feedback loops")


def _sampling(result: Result) -> Iterator[ReportSection]:
    """Yield the sample time and the largest stable one, and the discrete poles."""
    about, limit = result.group_attrs["bond_graph/sampled"], "bond_graph/system/largest_sample_time"
    poles = roots_text(result["bond_graph/sampled/poles"].data).removesuffix(" rad/s")
    periods = about.get("periods", f"{float(about['sample']):g}")
    items = definitions(
        ("sample time", f"{periods} s; computation {about['computation']} s"),
        *([("largest", f"{float(result.value(limit)):.4g} s")] if limit in result else []),
        ("poles in z", poles),
        ("", str(about["note"])),
    )
    yield ReportSection("Sampled loops", (items,), "answer", screen="sampled loops")


def _loop_remarks(result: Result, k: int) -> Iterator[str]:
    """Yield what the margins of a loop do not say: gains at which roots cross the axis, its verdict."""
    group = "bond_graph/margins"
    above, below = (float(result[f"{group}/crossing_gain_{side}"].data[k]) for side in ("above", "below"))
    if not result[f"{group}/Mt"].data[k]:
        yield "L = 0: nothing is fed back, so that it moves no pole"
    elif result[f"{group}/stable"].data[k]:
        if below > 0:
            yield f"least gain {below:.4g} of this one"
    else:
        yield str(result[f"{group}/stability"].data[k])
        changes = " and ".join(f"gain times {gain:.4g}" for gain in (above, below) if 0 < gain < np.inf)
        if changes:
            yield f"its roots cross the axis at {changes}"


def _formulas(lines: list[str]) -> NumberedList:
    return NumberedList(
        tuple(line if len(line) < _FORMULA_LENGTH else f"{line[:_FORMULA_LENGTH]}…" for line in lines)
    )


def _reduction(result: Result) -> Iterator[ReportSection]:
    """Yield the prototype of each output, and the steps of the reduction to the first."""
    if f"{_REDUCTION}/output" not in result:
        return
    outputs, letters, equations, *systems = (
        np.atleast_1d(result[f"{_REDUCTION}/{name}"].data)
        for name in ("output", "prototype", "prototype_equation", "system_a", "system_b")
    )
    steps: Iterable[Any] = result[f"{_REDUCTION}/steps"].data if f"{_REDUCTION}/steps" in result else []
    items = []
    for k, name in enumerate(outputs):
        count = sum(row["output"] == name for row in steps) - 1  # the last row is the prototype itself
        reduced = f"reduced in {counted(count, 'step')} to " if count > 0 else ""
        parts = (Formula(system[k]) for system in systems)
        items.append((str(name), (f"{reduced}prototype {letters[k]}:  {equations[k]}", *parts)))
    blocks: list[Block] = [DefinitionList(tuple(items), noun="output", brief=6, most=12)]
    if rows := [row for row in steps if row["output"] == outputs[0]]:
        formulas = _formulas([f"{row['rule']}: {row['equation']}" for row in rows])
        blocks.append(replace(formulas, noun="step", brief=MOST_ROOTS, most=_STEPS))
    yield ReportSection("Reduction", tuple(blocks), "derivation", screen="reduction", detail="trace")


def causality_sections(result: Result) -> Iterator[ReportSection]:
    """Yield the states, conflicts, derivative causality, loops, causal strokes and zero dynamics."""
    if f"{_CAUSALITY}/bonds" not in result:
        return
    states = result[f"{_CAUSALITY}/states"].data["name"]
    text = f"{len(states)}: {joined(states, _STATES)}" if len(states) else "none"
    items: list[tuple[str, tuple[str, ...]]] = []
    remarks = []
    for table, title in (("conflicts", "conflict"), ("dependent_storages", "derivative"), ("loops", "loop")):
        meanings = [str(meaning) for meaning in result[f"{_CAUSALITY}/{table}"].data["meaning"]]
        tone = "bad" if table == "conflicts" else ""
        remarks += [Statement(f"{title}: {meaning}", tone) for meaning in meanings[:_REMARKS]]
        if len(meanings) > _REMARKS:
            remarks.append(Statement(f"… {counted(len(meanings) - _REMARKS, f'more {title}')} in the file"))
    if note := result.group_attrs.get(_CAUSALITY, {}).get("note"):
        remarks.append(Statement(str(note)))
    prefix = f"{_CAUSALITY}/zero_dynamics/"
    for path in result:
        if path.startswith(prefix) and path.endswith("/meaning"):
            name = path.removeprefix(prefix).removesuffix("/meaning").replace("/", " / ")
            items.append((f"zeros of {name}", tuple(_zero_dynamics(result, path.removesuffix("/meaning")))))
    # Causal strokes: |-> with the stroke at the tail, ->| at the head.
    strokes = [
        f"{bond['tail']} {'|->' if bond['stroke'] == 'tail' else '->|'} {bond['head']}"
        for bond in result[f"{_CAUSALITY}/bonds"].data
    ]
    bonds = definitions(("bonds (bar: causal stroke)", joined(strokes, _BONDS)))
    zeros = DefinitionList(tuple(items), noun="channel", brief=6, most=_REMARKS)
    blocks = (definitions(("states", text)), *remarks, on_screen(bonds), *((zeros,) if items else ()))
    yield ReportSection("Causality", blocks, "derivation", screen="causality", detail="trace")


def _zero_dynamics(result: Result, group: str) -> Iterator[str]:
    """Yield the zero dynamics of a channel, its numbers of zeros and its relative degrees."""
    yield str(result.value(f"{group}/meaning"))
    counts = {
        kind: f"{counted(result.value(f'{group}/zeros_{kind}'), 'zero')}, relative degree "
        f"{result.value(f'{group}/relative_degree_{kind}')}"
        for kind in ("structural", "exact")
        if f"{group}/zeros_{kind}" in result
    }
    if len(counts) == 2 and len(set(counts.values())) == 1:
        yield counts["exact"]
    elif counts:
        yield " · ".join(f"{kind}: {count}" for kind, count in counts.items())
    if note := result.group_attrs.get(group, {}).get("note"):
        yield str(note)


def _port(result: Result) -> Iterator[ReportSection]:
    """Yield both sides of a port as equivalent sources, the prototype, its dynamics and operating points."""
    items = list(_port_items(result))
    if not items:
        return
    title = f"ort {result.group_attrs[PORT]['bond']}{approximate(result, f'{PORT}/prototype')}"
    answer = [item for item in items if item[0] in ("prototype", "source", "load", "natural modes")]
    others = [item for item in items if item not in answer]
    blocks = (definitions(*answer), on_screen(definitions(*others)))
    yield ReportSection(f"P{title}", blocks, "answer", screen=f"p{title}")
    yield ReportSection(f"P{title} in full", (definitions(*items),))


def _port_items(result: Result) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield prototype, both sides as equivalent sources, dynamics and operating points of the port."""
    if f"{PORT}/prototype" not in result:
        return
    letter, equation = (result.value(f"{PORT}/{name}") for name in ("prototype", "prototype_equation"))
    yield "prototype", (f"{letter}:  {equation}",)
    yield "type", (str(result.value(f"{PORT}/type")),)
    for side in ("source", "load"):
        yield side, tuple(_side(result, side))
    # The dynamics, the response they refer to, and the natural modes.
    hertz = in_hertz(result)
    for name in ("zero dynamics", "pole dynamics"):
        group = f"{PORT}/{name.replace(' ', '_')}"
        others = [
            f"{what}: at {roots_text(result[path].data, hertz=hertz)}"
            for what, key in (("missed", "missed_roots"), ("not of it", "foreign_roots"))
            if (path := f"{group}/{key}") in result and len(result[path].data)
        ]
        roots = roots_text(result[f"{group}/roots"].data, hertz=hertz)
        yield name, (f"{result.value(f'{group}/equation')}:  {roots}", *others)
    response = f"{PORT}/zero_dynamics/response"
    if f"{response}/exact" in result:
        exact = Formula(f"= {result.value(f'{response}/exact')}")
        zeros = f"zeros {roots_text(result[f'{response}/zeros'].data, hertz=hertz)}"
        yield str(result.value(f"{PORT}/zero_dynamics/response_name")), (exact, zeros)
    if f"{PORT}/natural_modes" in result:
        modes, power = (result[f"{PORT}/{name}"].data for name in ("natural_modes", "net_power"))
        net = (f"net power over the port {power.max():.1g} (eq 9)",) if len(power) else ()
        yield "natural modes", (roots_text(modes, hertz=hertz), *net)
    if f"{PORT}/shared_junctions" in result and (shared := str(result.value(f"{PORT}/shared_junctions"))):
        text = (
            f"A and B are not independent, both contain {shared}: eqs 10 to 12 count this part twice, "
            "and the natural modes are the roots of the determinant of the whole"
        )
        yield "loop", (text,)
    yield "at rest", tuple(_operating_points(result))


def _side(result: Result, side: str) -> Iterator[str]:
    """Yield the nodes of a side, its equivalent source, and its form if it is an ideal source."""
    group = f"{PORT}/{side}"
    attrs = result.group_attrs[group]
    yield str(attrs["nodes"])
    exact = [
        path[len(group) + 1 : -len("/exact")]
        for path in result
        if path.startswith(f"{group}/") and path.endswith("/exact")
    ]
    form = "Z_eq" if "Z_eq" in exact else "Y_eq"
    letter = "e" if form == "Z_eq" else "f"
    for name in [form, *(name for name in exact if name.startswith(f"{letter}_eq/"))]:
        if name in exact:
            formula = str(result.group_attrs.get(f"{group}/{name}", {}).get("symbolic", ""))
            formula = formula or str(result.value(f"{group}/{name}/exact"))
            variable, _, source = name.partition("/")
            driven = f" of {source}" if source else ""
            yield Formula(f"{variable}{driven} = {formula}")
    if str(attrs["form"]).startswith("an ideal"):
        yield str(attrs["form"])


def _operating_points(result: Result) -> Iterator[str]:
    """Yield effort and flow at the port in the steady state, for every input, or why there are none."""
    group = f"{PORT}/performance"
    if f"{group}/input" in result:
        for index, name in enumerate(result[f"{group}/input"].data):
            values = []
            for letter, key in (("e", "effort"), ("f", "flow")):
                variable = result[f"{group}/operating_{key}"]
                values.append(f"{letter} = {variable.data[index]:.4g} {unit_text(variable.units)}".rstrip())
            yield f"{name} = 1 gives {', '.join(values)}"
    if note := result.group_attrs.get(group, {}).get("note"):
        yield str(note)
