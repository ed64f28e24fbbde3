"""Content of bond graphs: transfer functions, the port, the reduction, causality, equations of state."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dynid.number_format import counted, limit, roots_text, unit_text
from dynid.report.content.blocks import (
    Block,
    DefinitionList,
    NumberedList,
    ReportSection,
    Statement,
    TextTable,
    definitions,
    joined,
    more,
)
from dynid.report.content.design import design_sections
from dynid.report.content.transfer_functions import (
    approximate,
    channel_sections,
    energy_lines,
    source_lines,
    sources_title,
)
from dynid.report.scenes import frequency_unit, in_hertz, time_courses
from dynid.result import Result

PORT, POINT = "bond_graph/port", "bond_graph/operating_point"
#: Most steps, prototypes, states and remarks that are listed.
_STEPS, _OUTPUTS, _STATES, _REMARKS = 60, 12, 12, 12
_REDUCTION, _CAUSALITY = "bond_graph/reduction", "bond_graph/causality"
#: Longest formula that is shown.
_LONGEST = 400
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
    if "bond_graph/warnings" in result:
        warnings = map(str, result["bond_graph/warnings"].data)
        yield ReportSection(
            "Warnings",
            tuple(Statement(f"{text[0].upper()}{text[1:]}.", "bad") for text in warnings),
            "answer",
        )
    yield from _operating_point(result)
    yield from _system(result)
    yield from design_sections(result)
    yield from channel_sections(result)
    yield from _loops(result)
    for title, rows in (
        ("Energy of the modes", energy_lines(result)),
        (sources_title(result, "Sources"), source_lines(result)),
    ):
        if named := [(name, (text,)) for name, text in rows]:
            yield ReportSection(title, (definitions(*named),))
    if items := list(port_items(result, _LONGEST)):
        answer = [item for item in items if item[0] in ("prototype", "source", "load", "natural modes")]
        title = f"Port {result.group_attrs[PORT]['bond']}{approximate(result, f'{PORT}/prototype')}"
        yield ReportSection(title, (definitions(*answer),), "answer")
        yield ReportSection(f"{title} in full", (definitions(*items),))
    if f"{_REDUCTION}/output" in result:
        yield ReportSection("Reduction", tuple(_reduction(result)), "derivation")
    if f"{_CAUSALITY}/bonds" in result:
        yield ReportSection("Causality", tuple(_causality(result)), "derivation")
    group = "bond_graph/state_space"
    names = (name for name in ("definitions", "equations", "output_equations") if f"{group}/{name}" in result)
    lines = [str(line) for name in names for line in result[f"{group}/{name}"].data]
    if lines:
        blocks: tuple[Block, ...] = (_formulas(lines[:_STEPS]), *more(len(lines), _STEPS, "line"))
        yield ReportSection(f"State equations{approximate(result, f'{group}/A')}", blocks, "derivation")
    about, graph = result.group_attrs.get("bond_graph", {}), list[Block]()
    if "nodes" in about:
        size = f"{counted(int(about['nodes']), 'node')}, {counted(int(about['bonds']), 'bond')}"
        graph.append(definitions(("size", size), ("engine", str(about.get("engine_reason", "")))))
    if about.get("engine", "exact") != "exact":
        graph.append(Statement(str(about.get("engine_limits", ""))))
    if "bond_graph/approximations" in result:
        graph += (Statement(f"{text}.") for text in result["bond_graph/approximations"].data)
    if about.get("reading") == "binary":
        graph.append(Statement("Every value is read as the double nearest to it (reading: binary)."))
    yield ReportSection("Graph", tuple(graph))


def _system(result: Result) -> Iterator[ReportSection]:
    """Yield the verdict on the whole system."""
    if verdict := system_text(result):
        tone = "" if verdict.startswith("stable") else "bad"
        statement = Statement(f"{verdict[0].upper()}{verdict[1:]}.", tone)
        yield ReportSection("Whole system", (statement,), "answer")


def system_text(result: Result) -> str:
    """Return the verdict on the whole system; '' where it adds nothing to those of the channels."""
    if "bond_graph/system/stability" not in result:
        return ""
    kind, reason = (str(result.value(f"bond_graph/system/{name}")) for name in ("stability", "reason"))
    if "bond_graph/margins/loop" not in result:
        paths = [path for path in result if path.startswith("bond_graph/properties/")]
        kinds = {str(result.value(path)) for path in paths if path.endswith("/stability")}
        if kinds and all(text.startswith(kind) for text in kinds):
            return ""
    return f"{kind}: {reason}" if reason else kind


def point_facts(result: Result) -> Iterator[tuple[str, str]]:
    """Yield what was found of the operating point, its constant inputs, residual and condition."""
    about = result.group_attrs[POINT]
    found = str(about["status"])
    if f"{POINT}/stability" in result:
        kinds = [str(kind) for kind in result[f"{POINT}/stability"].data]
        number = int(result.value(f"{POINT}/chosen"))
        found += (
            f", {kinds[number - 1]}"
            if len(kinds) == 1
            else f" ({', '.join(kinds)}); number {number} is analysed"
        )
    yield "point", found
    names, values = (result[f"{POINT}/{name}"].data for name in ("input", "input_value"))
    if len(names):
        yield "inputs", ", ".join(f"{n} = {v:.6g}" for n, v in zip(names, values, strict=True))
    residual, condition = (float(result.value(f"{POINT}/{name}")) for name in ("residual", "condition"))
    yield "accuracy", f"residual {residual:.1g} of the terms, condition {condition:.2g}"
    if flat := about.get("flat"):
        yield "zero slopes", f"{flat}: no effort or flow of its own in the linearisation"
    yield "note", str(about["note"])


def nonlinear_facts(result: Result) -> Iterator[str]:
    """Yield how far the nonlinear response is from the linear one, or why there is none."""
    group = "bond_graph/time_response"
    about = result.group_attrs.get(group, {})
    if "nonlinear" in about:
        yield f"nonlinear response {about['nonlinear']}"
    if f"{group}/nonlinear_deviation" not in result:
        return
    shares = result[f"{group}/nonlinear_deviation"].data.ravel()
    names = [name for name, _ in time_courses(result, group)]
    for name, share in list(zip(names, shares, strict=True))[:_OUTPUTS]:
        yield f"{name}: the nonlinear response is off the linear one by {100 * share:.3g} % of its maximum"
    yield from (
        block.text for block in more(len(names), _OUTPUTS, "response") if isinstance(block, Statement)
    )
    tolerance, error = (float(about[f"nonlinear_{name}"]) for name in ("tolerance", "error"))
    yield f"integrated with relative tolerance {tolerance:.0e}; estimated error {error:.1g} of the maximum"


def point_slopes(result: Result) -> list[tuple[str, str]]:
    """Return the slopes of the laws as text."""
    return _of_point(result, "slope", "slope_value", "slope_unit")


def point_values(result: Result) -> list[tuple[str, str]]:
    """Return the variables at the operating point as text."""
    return _of_point(result, "variable", "value", "unit")


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
    """Yield the operating point, and how far linear results hold."""
    if POINT not in result.group_attrs:
        return
    found, *others = point_facts(result)
    yield ReportSection("Operating point", (definitions(found), *_point_tables(result, _FEW)), "answer")
    full = (definitions(*others), *_point_tables(result, _POINTS))
    yield ReportSection("Operating point in full", full)
    if facts := list(nonlinear_facts(result)):
        yield ReportSection("Range of the linear response", tuple(Statement(f"{fact}.") for fact in facts))


def _point_tables(result: Result, most: int) -> Iterator[Block]:
    """Yield the slopes of the laws and the variables at the operating point, at most so many of each."""
    for heads, rows in (
        (("slope", "value"), point_slopes(result)),
        (("variable", "value"), point_values(result)),
    ):
        if rows and (most > _FEW or heads[0] == "slope"):
            yield TextTable(heads, tuple(rows[:most]))
            yield from more(len(rows), most, heads[0])


def margin_texts(result: Result, place: int) -> dict[str, str]:
    """Return the margins of the loop at a place; those of gain and phase with their crossover frequencies.

    None of them is defined where the closed loop is not stable: its S and T are of no steady response.
    """
    unit, texts = frequency_unit(result), {}
    stable = bool(result["bond_graph/margins/stable"].data[place])
    for name, (sign, crossover) in _MARGINS.items():
        size, where = float(result[f"bond_graph/margins/{name}"].data[place]), ""
        if np.isnan(size) or not stable:
            texts[name] = "undecided" if stable else "not defined"
            continue
        if crossover:
            at = float(result[f"bond_graph/margins/{crossover}"].data[place]) * unit.factor
            where = f" at {at:.4g} {unit.name}" if np.isfinite(at) else " at high frequencies"
        texts[name] = f"{size:.4g}{sign}{where}" if np.isfinite(size) else "∞"
    return texts


def undecided_margins(result: Result) -> list[str]:
    """Return by loop why margins are undecided; '' where none is."""
    group = "bond_graph/margins"
    count = len(result[f"{group}/loop"].data)
    return (
        [str(text) for text in result[f"{group}/undecided"].data]
        if f"{group}/undecided" in result
        else [""] * count
    )


def _loops(result: Result) -> Iterator[ReportSection]:
    """Yield the margins of the feedback loops, each with the others closed, and the poles with delays."""
    group = "bond_graph/margins"
    if f"{group}/loop" not in result:
        return
    names, stabilities, stable = (result[f"{group}/{name}"].data for name in ("loop", "stability", "stable"))
    rows = [
        (str(loop), *margin_texts(result, place).values(), str(stabilities[place]).partition(":")[0])
        for place, loop in enumerate(names)
    ]
    blocks: list[Block] = [
        TextTable(("", "gain margin", "phase margin", "delay margin", "Ms", "Mt", "closed loop"), tuple(rows))
    ]
    if not stable.all():
        blocks.append(Statement("Margins, Ms and Mt are not defined where the closed loop is not stable."))
    reasons = dict.fromkeys(text for text in undecided_margins(result) if text)
    blocks += (Statement(f"Undecided: {reason}.") for reason in reasons)
    yield ReportSection("Feedback loops", tuple(blocks), "answer")
    if f"{group}/poles" in result:
        poles = result[f"{group}/poles"]
        text = roots_text(poles.data, hertz=in_hertz(result))
        yield ReportSection(
            "Poles with delays", (definitions(("poles", text), ("", str(poles.attrs["note"]))),)
        )


def _formulas(lines: list[str]) -> NumberedList:
    return NumberedList(tuple(line if len(line) < _LONGEST else f"{line[:_LONGEST]}…" for line in lines))


def _reduction(result: Result) -> Iterator[Block]:
    output, letters, equations, *systems = (
        np.atleast_1d(result[f"{_REDUCTION}/{name}"].data)
        for name in ("output", "prototype", "prototype_equation", "system_a", "system_b")
    )
    items = []
    for place, name in enumerate(output[:_OUTPUTS]):
        lines = [f"prototype {letters[place]}:  {equations[place]}", *(str(part[place]) for part in systems)]
        items.append((str(name), tuple(line for line in lines if len(line) < _LONGEST)))
    yield DefinitionList(tuple(items))
    yield from more(len(output), _OUTPUTS, "output")
    if f"{_REDUCTION}/steps" in result:
        rows = [row for row in result[f"{_REDUCTION}/steps"].data if row["output"] == output[0]]
        yield _formulas([f"{row['rule']}: {row['equation']}" for row in rows[:_STEPS]])
        yield from more(len(rows), _STEPS, "step")


def _causality(result: Result) -> Iterator[Block]:
    states = result[f"{_CAUSALITY}/states"].data["name"]
    yield definitions(("states", f"{len(states)}: {joined(states, _STATES)}" if len(states) else "none"))
    for table, title in (
        ("conflicts", "conflict"),
        ("dependent_storages", "derivative"),
        ("loops", "loop"),
    ):
        meanings = [str(text) for text in result[f"{_CAUSALITY}/{table}"].data["meaning"]]
        tone = "bad" if table == "conflicts" else ""
        yield from (Statement(f"{title}: {meaning}", tone) for meaning in meanings[:_REMARKS])
        yield from more(len(meanings), _REMARKS, title)
    prefix = f"{_CAUSALITY}/zero_dynamics/"
    channels = [path for path in result if path.startswith(prefix) and path.endswith("/meaning")]
    rows = []
    for path in channels[:_REMARKS]:
        name = path.removeprefix(prefix).removesuffix("/meaning").replace("/", " / ")
        rows.append((f"zeros of {name}", str(result.value(path))))
    if rows:
        yield definitions(*rows)


def port_items(result: Result, longest: int) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield prototype, both sides as equivalent sources, dynamics and operating points of the port.

    Parameters
    ----------
    result
        Of a bond graph; nothing is yielded without a port.
    longest
        Length of the longest formula that is shown.

    Yields
    ------
    tuple
        A term and its lines.
    """
    if f"{PORT}/prototype" not in result:
        return
    letter, equation = (result.value(f"{PORT}/{name}") for name in ("prototype", "prototype_equation"))
    yield "prototype", (f"{letter}:  {equation}",)
    yield "type", (str(result.value(f"{PORT}/type")),)
    for side in ("source", "load"):
        yield side, tuple(_side(result, side, longest))
    # The dynamics, the response they refer to, and the natural modes.
    hertz = in_hertz(result)
    for name in ("zero dynamics", "pole dynamics"):
        group = f"{PORT}/{name.replace(' ', '_')}"
        others = [
            f"{what}: at {roots_text(result[path].data, hertz=hertz)}"
            for what, key in (("missed", "missed_roots"), ("not of it", "foreign_roots"))
            if (path := f"{group}/{key}") in result and len(result[path].data)
        ]
        found = roots_text(result[f"{group}/roots"].data, hertz=hertz)
        yield name, (f"{result.value(f'{group}/equation')}:  {found}", *others)
    response = f"{PORT}/zero_dynamics/response"
    if f"{response}/exact" in result:
        exact = str(result.value(f"{response}/exact"))
        exact = exact if len(exact) <= longest else "(in the file)"
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


def _side(result: Result, side: str, longest: int) -> Iterator[str]:
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
            yield f"{variable}{driven} = {formula if len(formula) <= longest else '(in the file)'}"
    if str(attrs["form"]).startswith("an ideal"):
        yield str(attrs["form"])


def _operating_points(result: Result) -> Iterator[str]:
    """Yield effort and flow at the port in the steady state, for every input, or why there are none."""
    group = f"{PORT}/performance"
    if f"{group}/input" in result:
        for place, name in enumerate(result[f"{group}/input"].data):
            values = []
            for letter, key in (("e", "effort"), ("f", "flow")):
                variable = result[f"{group}/operating_{key}"]
                values.append(f"{letter} = {variable.data[place]:.4g} {unit_text(variable.units)}".rstrip())
            yield f"{name} = 1 gives {', '.join(values)}"
    if note := result.group_attrs.get(group, {}).get("note"):
        yield str(note)
