"""Screens of bond graphs: analyses, designs, syntheses."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from dynid.cli.summary.common import aligned, paragraph, response_lines, wrapped
from dynid.cli.summary.transfer_functions import channel_lines, derivation_lines, equation_lines
from dynid.number_format import MOST_ROOTS, counted, roots_text
from dynid.report.content.bond_graph import (
    POINT,
    PORT,
    margin_texts,
    nonlinear_facts,
    point_facts,
    point_slopes,
    port_items,
    system_text,
    undecided_margins,
)
from dynid.report.content.design import DESIGN, parameter_table, statements, target_table
from dynid.report.content.synthesis import elements, form_table, forms, kind_text, wanted
from dynid.report.content.transfer_functions import (
    approximate,
    delays_text,
    energy_lines,
    source_lines,
    sources_title,
)
from dynid.report.scenes import in_hertz
from dynid.result import Result

#: Most slopes that are listed.
_MOST = MOST_ROOTS
#: Most elements of a synthesised form that are listed.
_ELEMENTS = 40
#: Longest formula of a port, and width of its names.
_LONGEST, _WIDTH = 70, 16


def lines(result: Result) -> list[str]:
    """Return the screen, line by line: the answer, then what to know of it."""
    answer = [
        *_design(result),
        *channel_lines(result),
        *_port(result),
        *_energy(result),
        *_margins(result),
        *equation_lines(result, "bond_graph/state_space"),
        *response_lines(result, "bond_graph"),
        *(line for fact in nonlinear_facts(result) for line in paragraph(fact, "    ")),
    ]
    if not answer:  # the derivations are what is asked for
        answer = derivation_lines(result)
    if answer and answer[-1]:
        answer.append("")
    # What everything below is linearised at.
    return [*_operating_point(result), *_system(result), *answer, *_about(result)]


def _about(result: Result) -> Iterable[str]:
    """Yield the size of the graph, who computed with which limits, approximations and warnings."""
    about = result.group_attrs.get("bond_graph", {})
    yield f"  {counted(int(about['nodes']), 'node')}, {counted(int(about['bonds']), 'bond')}"
    engine, reason = (str(about.get(name, "")) for name in ("engine", "engine_reason"))
    if engine not in ("", "exact") or "decides" in reason:
        yield f"  {engine} engine: {reason}"
        if engine != "exact":
            yield from (f"    {line}" for line in wrapped(str(about["engine_limits"]), 100))
    if about.get("reading") == "binary":
        yield "  every value is read as the double nearest to it (reading: binary)"
    texts = [delays] if (delays := delays_text(result)) else []
    for name, head in (("approximations", ""), ("warnings", "warning: ")):
        if f"bond_graph/{name}" in result:
            texts += [f"{head}{text}" for text in result[f"bond_graph/{name}"].data]
    for text in texts:
        yield from wrapped(text, 100, initial_indent="  ", subsequent_indent="    ")


def _design(result: Result) -> Iterable[str]:
    """Yield designed values, targets and how they were found."""
    if f"{DESIGN}/value" not in result:
        return
    yield "  design"
    for headings, rows in (parameter_table(result), target_table(result)):
        shown = [k for k in range(len(headings)) if any(row[k] for row in rows)]
        yield from aligned([[row[k] for k in shown] for row in (headings, *rows)])
    for text, tone in statements(result):
        yield from paragraph(f"{'warning: ' if tone == 'bad' else ''}{text}", "    ")
    yield ""


def _system(result: Result) -> Iterable[str]:
    """Yield the verdict on the whole system, where it has loops or another one than a channel."""
    if text := system_text(result):
        yield from wrapped(text, 100, initial_indent="  whole system: ", subsequent_indent="    ")
        yield ""


def _operating_point(result: Result) -> Iterable[str]:
    """Yield the point at which laws are linearised, and their slopes."""
    if POINT not in result.group_attrs:
        return
    yield "  operating point"
    for name, text in point_facts(result):
        first, *rest = wrapped(text, 92 - _WIDTH)
        yield f"      {name:<{_WIDTH}}{first}"
        yield from (f"      {'':<{_WIDTH}}{line}" for line in rest)
    slopes = point_slopes(result)
    width = max((len(name) for name, _ in slopes[:_MOST]), default=0)
    yield from (f"      {name:<{width}} = {value}" for name, value in slopes[:_MOST])
    if len(slopes) > _MOST:
        yield f"      … {counted(len(slopes) - _MOST, 'more slope')} in the file"
    yield ""


def _energy(result: Result) -> Iterable[str]:
    """Yield where the modes have their energy, and what the sources give."""
    for title, rows in (
        ("modes", energy_lines(result)),
        (sources_title(result, "sources"), source_lines(result)),
    ):
        texts = [f"{name}: {text}" for name, text in rows]
        if texts:
            yield f"  {title}"
            for text in texts:
                yield from wrapped(text, 105, initial_indent="    ", subsequent_indent="      ")
            yield ""


def _margins(result: Result) -> Iterable[str]:
    """Yield the margins of each feedback loop, the others closed, and the poles of loops with delays."""
    group = "bond_graph/margins"
    if f"{group}/loop" not in result:
        return
    reasons = undecided_margins(result)
    for place, loop in enumerate(result[f"{group}/loop"].data):
        if reasons[place].startswith("left out"):
            yield from wrapped(reasons[place], 100, initial_indent="  other loops ", subsequent_indent="    ")
            break
        yield f"  loop {loop}"
        gains = [float(result[f"{group}/crossing_gain_{side}"].data[place]) for side in ("above", "below")]
        if not result[f"{group}/Mt"].data[place]:
            yield "    L = 0: nothing is fed back, so that it moves no pole"
        elif result[f"{group}/stable"].data[place]:
            margins = margin_texts(result, place)
            found = [f"{name} margin {margins[name]}" for name in ("gain", "phase", "delay")]
            if gains[1] > 0:
                found.insert(1, f"least gain {gains[1]:.4g} of this one")
            found.append(f"Ms {margins['Ms']}, Mt {margins['Mt']}")
            line = " · ".join(part.replace(" ", "\N{NO-BREAK SPACE}") for part in found)
            parts = wrapped(line, 110, initial_indent="    ", subsequent_indent="      ")
            yield from (part.replace("\N{NO-BREAK SPACE}", " ") for part in parts)
            if why := reasons[place]:
                yield from wrapped(why, 92, initial_indent="    undecided: ", subsequent_indent="      ")
        else:
            verdict = str(result[f"{group}/stability"].data[place])
            yield from wrapped(verdict, 92, initial_indent="    ", subsequent_indent="      ")
            changes = " and ".join(f"gain times {gain:.4g}" for gain in gains if 0 < gain < np.inf)
            crossings = f"; its roots cross the axis at {changes}" if changes else ""
            yield f"    margins not defined: the closed loop is not stable{crossings}"
    if f"{group}/poles" in result:
        poles = result[f"{group}/poles"]
        text = f"poles with delays: {roots_text(poles.data, hertz=in_hertz(result))}"
        yield from wrapped(text, 105, initial_indent="  ", subsequent_indent="    ")
        yield from wrapped(f"{poles.attrs['note']}", 92, initial_indent="    ", subsequent_indent="    ")
    yield ""


def _port(result: Result) -> Iterable[str]:
    """Yield both sides of a port as equivalent sources, the prototype, its dynamics and operating points."""
    items = dict(port_items(result, _LONGEST))
    if not items:
        return
    about = approximate(result, f"{PORT}/prototype")
    yield f"  port {result.group_attrs[PORT]['bond']}{about}: prototype {items.pop('prototype')[0]}"
    yield from (f"      {line}" for line in wrapped(items.pop("type")[0], 92))
    for name, lines in items.items():
        parts = wrapped(lines[0], 92 - _WIDTH) if name == "loop" else lines
        if name in ("source", "load", "loop"):  # one below the other
            rows = [(name if k == 0 else "", part) for k, part in enumerate(parts)]
        elif name == "at rest":
            rows = [(name, part) for part in parts]
        else:
            rows = [(name, "   ".join(parts))]
        for left, part in rows:
            first, *rest = wrapped(part, 104 - _WIDTH, break_long_words=False) or [""]
            yield f"      {left:<{_WIDTH}}{first}"
            yield from (f"      {'':<{_WIDTH}}{line}" for line in rest)
    yield ""


def synthesis_lines(result: Result) -> list[str]:
    """Return the screen of a synthesis, line by line."""
    (name, formula), zeros, poles = wanted(result)
    shown = [f"  {name} = {formula}", f"  {kind_text(result)}", f"  zeros  {zeros}", f"  poles  {poles}", ""]
    columns, rows = form_table(result)
    shown += [*aligned([columns, *rows], "  "), ""]
    for form in forms(result):
        every = [f"{name} = {value}" for name, _, value in elements(result, form)]
        listed = ", ".join(every[:_ELEMENTS]) + (
            f", … ({len(every)} in all)" if len(every) > _ELEMENTS else ""
        )
        shown += wrapped(f"{form}: {listed}", 104, initial_indent="  ", subsequent_indent="    ")
    return shown
