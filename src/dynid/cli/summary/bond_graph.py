"""Screen of a bond-graph result."""

from __future__ import annotations

from collections.abc import Iterable
from textwrap import wrap

import numpy as np

from dynid.cli.summary.common import response_lines
from dynid.cli.summary.derivations import equation_lines
from dynid.cli.summary.design import design_lines
from dynid.cli.summary.transfer_functions import channel_lines
from dynid.number_format import MOST_ROOTS, counted, roots_text
from dynid.report.content.bond_graph import (
    POINT,
    PORT,
    nonlinear_facts,
    point_facts,
    point_slopes,
    port_items,
)
from dynid.report.content.transfer_functions import energy_lines, source_lines
from dynid.report.scenes import in_hertz
from dynid.result import Result

#: Most slopes that are listed.
_MOST = MOST_ROOTS
#: Longest formula of a port, and width of its names.
_LONGEST, _WIDTH = 70, 16


def lines(result: Result) -> list[str]:
    """Return the screen, line by line."""
    about = result.group_attrs.get("bond_graph", {})
    screen = [f"  {counted(int(about['nodes']), 'node')}, {counted(int(about['bonds']), 'bond')}"]
    engine, reason = (str(about.get(name, "")) for name in ("engine", "engine_reason"))
    if engine not in ("", "exact") or "decides" in reason:
        screen.append(f"  {engine} engine: {reason}")
        if engine != "exact":
            screen += (f"    {line}" for line in wrap(str(about["engine_limits"]), 100))
    if about.get("reading") == "binary":
        screen.append("  every value is read as the double nearest to it (reading: binary)")
    if about.get("delays"):
        screen += wrap(str(about["delays"]), 100, initial_indent="  ", subsequent_indent="    ")
    for text in result["bond_graph/approximations"].data if "bond_graph/approximations" in result else ():
        screen += wrap(str(text), 100, initial_indent="  ", subsequent_indent="    ")
    for warning in result["bond_graph/warnings"].data if "bond_graph/warnings" in result else ():
        screen += wrap(f"warning: {warning}", 100, initial_indent="  ", subsequent_indent="    ")
    screen += _operating_point(result)
    screen += ["", *design_lines(result)]
    screen += _port(result)
    screen += channel_lines(result)
    screen += _energy(result)
    screen += _margins(result)
    screen += equation_lines(result, "bond_graph/state_space")
    screen += response_lines(result, "bond_graph")
    screen += (f"    {fact}" for fact in nonlinear_facts(result))
    return screen


def _operating_point(result: Result) -> Iterable[str]:
    """Yield the point at which laws are linearised, and their slopes."""
    if POINT not in result.group_attrs:
        return
    yield "  operating point"
    for name, text in point_facts(result):
        first, *rest = wrap(text, 92 - _WIDTH)
        yield f"      {name:<{_WIDTH}}{first}"
        yield from (f"      {'':<{_WIDTH}}{line}" for line in rest)
    slopes = point_slopes(result)
    width = max((len(name) for name, _ in slopes[:_MOST]), default=0)
    yield from (f"      {name:<{width}} = {value}" for name, value in slopes[:_MOST])
    if len(slopes) > _MOST:
        yield f"      … {counted(len(slopes) - _MOST, 'more slope')} in the file"


def _energy(result: Result) -> Iterable[str]:
    """Yield where the modes have their energy, and what the sources give."""
    for title, rows in (("modes", energy_lines(result)), ("sources", source_lines(result))):
        texts = [f"{name}: {text}" for name, text in rows]
        if texts:
            yield f"  {title}"
            for text in texts:
                yield from wrap(text, 105, initial_indent="    ", subsequent_indent="      ")
            yield ""


_MARGINS = ("gain", "gain_reduction", "phase", "delay", "Ms", "Mt")


def _margins(result: Result) -> Iterable[str]:
    """Yield the margins of each feedback loop, the others closed, and the poles of loops with delays."""
    group = "bond_graph/margins"
    if f"{group}/loop" not in result:
        return
    for place, loop in enumerate(result[f"{group}/loop"].data):
        at = {name: float(result[f"{group}/{name}"].data[place]) for name in _MARGINS}
        yield f"  loop {loop}"
        stable = bool(result[f"{group}/stable"].data[place])
        found = [f"gain margin {at['gain']:.4g}" if np.isfinite(at["gain"]) else "any larger gain"]
        if at["gain_reduction"] > 0:
            found.append(f"least gain {at['gain_reduction']:.4g} of this one")
        if np.isfinite(at["phase"]):
            found.append(f"phase margin {at['phase']:.4g}°")
        if np.isfinite(at["delay"]):
            found.append(f"delay margin {at['delay']:.4g} s")
        if not stable:
            verdict = str(result[f"{group}/stability"].data[place])
            yield from wrap(verdict, 92, initial_indent="    ", subsequent_indent="      ")
            changes = [f"gain times {at[name]:.4g}" for name in _MARGINS[:2] if 0 < at[name] < np.inf]
            found = [f"its roots cross the axis at {' and '.join(changes)}"] if changes else []
        else:
            found.append(f"Ms {at['Ms']:.4g}, Mt {at['Mt']:.4g}")
        if found:
            yield f"    {' · '.join(found)}"
    if f"{group}/poles" in result:
        poles = result[f"{group}/poles"]
        text = f"poles with delays: {roots_text(poles.data, hertz=in_hertz(result))}"
        yield from wrap(text, 105, initial_indent="  ", subsequent_indent="    ")
        yield from wrap(f"{poles.attrs['note']}", 92, initial_indent="    ", subsequent_indent="    ")
    yield ""


def _port(result: Result) -> Iterable[str]:
    """Yield both sides of a port as equivalent sources, the prototype, its dynamics and operating points."""
    items = dict(port_items(result, _LONGEST))
    if not items:
        return
    yield f"  port {result.group_attrs[PORT]['bond']}: prototype {items.pop('prototype')[0]}"
    yield from (f"      {line}" for line in wrap(items.pop("type")[0], 92))
    for name, lines in items.items():
        parts = wrap(lines[0], 92 - _WIDTH) if name == "loop" else lines
        if name in ("source", "load", "loop"):  # one below the other
            rows = [(name if k == 0 else "", part) for k, part in enumerate(parts)]
        elif name == "at rest":
            rows = [(name, part) for part in parts]
        else:
            rows = [(name, "   ".join(parts))]
        yield from (f"      {left:<{_WIDTH}}{part}" for left, part in rows)
    yield ""
