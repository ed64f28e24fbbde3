"""The screen of a bond-graph result."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from textwrap import wrap
from typing import Any

import numpy as np

from dynid.cli.summary.causality import causality_lines, equation_lines
from dynid.cli.summary.numbers import MOST_ROOTS, root_text, roots_text
from dynid.cli.summary.port import port_lines
from dynid.cli.summary.responses import response_lines
from dynid.cli.summary.sensitivities import sensitivity_lines
from dynid.result import Result

#: Most steps that are listed.
_MOST = MOST_ROOTS


def method(result: Result) -> str:
    """Name the kind of analysis and its engine."""
    engine = result.group_attrs.get("bond_graph", {}).get("engine")
    return f"bond graph · {engine} engine" if engine else "bond graph"


def lines(result: Result) -> list[str]:
    """Return the screen, line by line."""
    need = result.group_attrs.get("bond_graph", {})
    said = [f"  {need.get('nodes')} nodes, {need.get('bonds')} bonds"]
    if need.get("dropped"):
        said.append(f"  not modelled, because no output depends on it: {need['dropped']}")
    said += _engine(need)
    said += causality_lines(result)
    said += [*_reduction(result), ""]
    said += port_lines(result)
    for channel in _channels(result):
        said += [*_channel(result, *channel), ""]
    said += equation_lines(result, "bond_graph/state_space")
    said += response_lines(result, "bond_graph")
    return said


def _engine(attributes: Mapping[str, Any]) -> Iterable[str]:
    """Say why an engine other than the exact one answered, what it cannot do, and how numbers are read."""
    if attributes.get("engine", "exact") != "exact" or "decides" in str(attributes["engine_reason"]):
        yield f"  {attributes['engine']} engine: {attributes['engine_reason']}"
        if attributes["engine"] != "exact":
            yield from (f"    {line}" for line in wrap(str(attributes["engine_limits"]), 100))
    if attributes.get("reading") == "binary":
        yield "  every value is read as the double nearest to it (reading: binary)"


def _reduction(result: Result) -> Iterable[str]:
    group = "bond_graph/reduction"
    if f"{group}/output" not in result:
        return
    letters = np.atleast_1d(result[f"{group}/prototype"].data)
    steps = result[f"{group}/steps"].data if f"{group}/steps" in result else None
    for place, output in enumerate(result[f"{group}/output"].data):
        reached = f"prototype {letters[place]}:  {result[f'{group}/prototype_equation'].data[place]}"
        own = [] if steps is None else [row for row in steps if row["output"] == output]
        count = len(own) - 1
        how = f"reduced in {count} step{'' if count == 1 else 's'} to " if count > 0 else ""
        yield f"  {output}: {how}{reached}"
        for part in ("system_a", "system_b"):
            yield f"      {result[f'{group}/{part}'].data[place]}"
        for number, row in enumerate(own[:_MOST] if place == 0 else [], 1):
            yield f"    {number:>2}. {row['rule']}: {row['equation']}"
        if place == 0 and len(own) > _MOST:
            yield f"    … {len(own) - _MOST} more steps in the file"


def _channels(result: Result) -> list[tuple[str, str]]:
    """List (output, input) of every channel with exact results."""
    prefixes = ("bond_graph/transfer_function/", "bond_graph/properties/", "bond_graph/sensitivities/")
    found = [path.split("/")[2:4] for path in result if path.startswith(prefixes)]
    return list(dict.fromkeys((output, source) for output, source in found))


def _channel(result: Result, output: str, source: str) -> Iterable[str]:
    transfer = f"bond_graph/transfer_function/{output}/{source}"
    properties = f"bond_graph/properties/{output}/{source}"
    yield f"  {output} / {source}"
    yield from _formula(result, transfer)
    for name, verdict in (("zeros", "zero_stability"), ("poles", "stability")):
        roots = result.get(f"{transfer}/{name}")
        if roots is not None or f"{properties}/{verdict}" in result:
            yield f"    {name}   {roots_text(roots.data) if roots is not None else ''}".rstrip()
            yield from _wrapped(result, f"{properties}/{verdict}")
    if f"{transfer}/poles" in result:
        yield from _modes(result[f"{transfer}/poles"].data)
    yield from _numbers(result, properties)
    yield from sensitivity_lines(result, f"bond_graph/sensitivities/{output}/{source}")


def _formula(result: Result, group: str) -> Iterable[str]:
    """Write a short transfer function in numbers, and in symbols where they were kept."""
    written = [*_in_numbers(result, group)]
    formula = str(result.group_attrs.get(group, {}).get("symbolic", ""))
    if formula and written != ["0"]:
        written.append(formula if len(formula) < 160 else "(its formula is in the file)")
    for place, text in enumerate(written):
        yield f"    {'T(s)' if place == 0 else '    '} = {text}"
    if f"{group}/program" in result:
        program = str(result.value(f"{group}/program")).splitlines()
        yield f"    nested, in {len(program)} assignment{'' if len(program) == 1 else 's'}:"
        yield from (f"      {line}" for line in program[:_MOST])
        if len(program) > _MOST:
            yield f"      … {len(program) - _MOST} more in the file"
    for part in ("numerator", "denominator"):
        if f"{group}/symbolic_{part}" in result:
            terms = result[f"{group}/symbolic_{part}"].attrs["terms"]
            yield f"    expanded {part} of {terms:,} term{'' if terms == 1 else 's'} in the file"


def _in_numbers(result: Result, group: str) -> Iterable[str]:
    if f"{group}/gain" in result:
        gain = result.value(f"{group}/gain")
        yield f"{gain:.6g} ∏(s − zeros) / ∏(s − poles)" if gain else "0"
    if f"{group}/numerator" not in result:
        return
    numerator, denominator = result[f"{group}/numerator"].data, result[f"{group}/denominator"].data
    if not numerator.any():
        yield "0"
    elif len(numerator) + len(denominator) <= 12:
        yield f"({_polynomial(numerator)}) / ({_polynomial(denominator)})"


def _numbers(result: Result, group: str) -> Iterable[str]:
    if f"{group}/order" in result:
        names = ("order", "relative_degree", "dc_gain", "high_frequency_gain")
        order, relative, dc, high = (result.value(f"{group}/{name}") for name in names)
        yield f"    order {order} · relative degree {relative} · T(0) = {dc:.6g} · T(∞) = {high:.6g}"
    hidden = result.get(f"{group}/hidden_modes")
    if hidden is not None and len(hidden.data):
        yield f"    hidden modes (natural modes that this channel does not show)  {roots_text(hidden.data)}"
        yield from _causes(result, group, hidden.data)


def _causes(result: Result, group: str, modes: np.ndarray[Any, Any]) -> Iterable[str]:
    """Say of each hidden mode why it is one and what holds its energy, where that was asked for."""
    if f"{group}/hidden_mode_cause" not in result:
        return
    causes, elements = (result[f"{group}/hidden_mode_{part}"].data for part in ("cause", "elements"))
    upper = [place for place, root in enumerate(modes) if root.imag >= 0]
    for place in upper[:_MOST]:
        held = f"; its energy is in {elements[place]}" if elements[place] else ""
        yield from (
            f"            {line}" for line in wrap(f"{root_text(modes[place])}: {causes[place]}{held}", 92)
        )


def _wrapped(result: Result, path: str) -> Iterable[str]:
    """Write a verdict in words below what it is about."""
    text = str(result[path].data) if path in result else ""
    yield from (f"            {line}" for line in wrap(text, 92))


def _modes(poles: np.ndarray[Any, Any]) -> Iterable[str]:
    pairs = [pole for pole in poles if pole.imag > 0]
    if 0 < len(pairs) <= 4:
        shown = (f"ω_n = {abs(p):.4g} rad/s, ζ = {-p.real / abs(p) or 0.0:.4g}" for p in pairs)
        yield f"            {' · '.join(shown)}"


def _polynomial(coefficients: np.ndarray[Any, Any]) -> str:
    degree = len(coefficients) - 1
    terms: list[str] = []
    for place, value in enumerate(coefficients):
        if value == 0 and degree > 0:
            continue
        power = degree - place
        variable = {0: "", 1: "s"}.get(power, f"s^{power}")
        number = "" if abs(value) == 1 and power else f"{abs(value):.4g}"
        sign = (" - " if value < 0 else " + ") if terms else ("-" if value < 0 else "")
        terms.append(f"{sign}{' '.join(part for part in (number, variable) if part)}")
    return "".join(terms)
