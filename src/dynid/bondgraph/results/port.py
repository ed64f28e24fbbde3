"""The source-load decomposition at a port: both sides, the prototype there, its dynamics and performance."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np

from dynid.bondgraph.decomposition.dynamics import prototype_dynamics
from dynid.bondgraph.decomposition.equivalents import Decomposition
from dynid.bondgraph.decomposition.one_port_equivalent import OnePortEquivalent
from dynid.bondgraph.decomposition.performance import static_characteristics
from dynid.bondgraph.domains import quotient
from dynid.bondgraph.exact_engine import TransferFunction
from dynid.bondgraph.formulas.printers import LATEX, TEXT
from dynid.bondgraph.formulas.transfer import readable_registers
from dynid.bondgraph.plan import ReducedGraph
from dynid.bondgraph.reduction.network import STORED
from dynid.bondgraph.results.prototype import add_dynamics, add_ratio, add_traces, system_text
from dynid.bondgraph.results.roots import add_roots
from dynid.result import Result

if TYPE_CHECKING:
    from numpy.typing import NDArray


_GROUP = "bond_graph/port"


def add_port(result: Result, parts: Decomposition, initial: Mapping[str, float | Fraction]) -> None:
    """Add the decomposition at a port.

    Parameters
    ----------
    result, parts
        Where to add it, and what.
    initial
        The flow of an I or the effort of a C at t = 0, by name: what its equivalent source is scaled by.
    """
    prototype = parts.prototype
    result.annotate(_GROUP, bond=str(parts.port), junction=parts.meeting)
    wanted: dict[str, int] = {}
    for side in (parts.source, parts.load):
        group = f"{_GROUP}/{side.name}"
        result.annotate(group, nodes=", ".join(side.nodes), form=_form(side))
        for immittance, register, source, given in (
            ("Z_eq", side.impedance, "e_eq", side.effort),
            ("Y_eq", side.admittance, "f_eq", side.flow),
        ):
            if register is not None and given is not None:
                wanted[f"{group}/{immittance}"] = register
                wanted |= {f"{group}/{source}/{name}": drive for name, drive in given.items()}
    ratios, texts = parts.rational(wanted.values()), readable_registers(parts, wanted.values())
    for path, register in wanted.items():
        ratio, stored = TransferFunction.of(ratios[register]), path.partition(f"/{STORED}")[2]
        if stored:  # what the energy given at t = 0 makes of it
            ratio = ratio.times(Fraction(initial[stored]))
        add_ratio(result, path, ratio, None if stored else texts.get(register))
    result.add(f"{_GROUP}/prototype", prototype.letter)
    for hand, suffix in ((TEXT, ""), (LATEX, "_latex")):
        result.add(f"{_GROUP}/prototype_equation{suffix}", prototype.equation(hand))
    result.add(f"{_GROUP}/type", prototype.type)
    result.add(f"{_GROUP}/meaning", prototype.describe(parts.meeting))
    sides = {side.name: side.reduction for side in (parts.source, parts.load) if side.reduction is not None}
    if parts.driven is not None:
        sides["driven load"] = parts.driven
    labels = {r: label for reduction in sides.values() for r, label in reduction.labels.items()}
    for index, part in enumerate(("system_a", "system_b")):
        for hand, suffix in ((TEXT, ""), (LATEX, "_latex")):
            result.add(f"{_GROUP}/{part}{suffix}", system_text(parts, prototype, index, labels, hand))
    add_traces(result, _GROUP, parts, sides, "side")
    dynamics = prototype_dynamics(parts, prototype)
    add_dynamics(result, _GROUP, dynamics)
    _add_performance(result, parts)


def add_requested(result: Result, reduced: ReducedGraph) -> None:
    """Add the zeros and poles of every channel asked for, to lie beside the dynamics at the port."""
    channels = reduced.channels()
    ratios = reduced.rational(channels.values())
    for (port, source), register in channels.items():
        transfer = TransferFunction.of(ratios[register])
        add_roots(result, f"{_GROUP}/requested/{port}/{source}", "zeros", transfer.zeros)
        add_roots(result, f"{_GROUP}/requested/{port}/{source}", "poles", transfer.poles)


def add_port_response(result: Result, parts: Decomposition, omega: NDArray[np.float64]) -> None:
    """Add both sides, effort and flow where they meet, and what eqs 5 to 8 name, over frequency.

    Parameters
    ----------
    result, parts
        Where to add it, and of what.
    omega
        Angular frequencies, rad/s.
    """
    from dynid.bondgraph.frequency_response import on_axis

    group, zero = f"{_GROUP}/frequency_response", parts.program.zero
    units = _units(parts)
    result.add_axis(f"{group}/omega", omega, "rad/s")
    result.add_axis(f"{group}/input", list(parts.sources))
    for side in (parts.source, parts.load):
        for name, register in (("Z_eq", side.impedance), ("Y_eq", side.admittance)):
            if register is not None:
                result.add(
                    f"{group}/{side.name}_{name}",
                    on_axis(parts, [register], omega)[:, 0],
                    ("omega",),
                    units[name],
                )
        for name, given in (("e_eq", side.effort), ("f_eq", side.flow)):
            if given is not None:
                registers = [given.get(source, zero) for source in parts.sources]
                values = on_axis(parts, registers, omega)
                result.add(f"{group}/{side.name}_{name}", values, ("omega", "input"))
    for name, answers in (("effort", parts.effort), ("flow", parts.flow)):
        values = on_axis(parts, [answers[source] for source in parts.sources], omega)
        result.add(f"{group}/{name}", values, ("omega", "input"))
    named = on_axis(parts, [parts.prototype.response], omega)[:, 0]
    unit = units[{"b": "Y_eq", "d": "ratio"}.get(parts.prototype.letter, "Z_eq")]
    result.add(f"{group}/zero_dynamics_response", named, ("omega",), unit)


def _units(parts: Decomposition) -> dict[str, str]:
    """Return the units of effort, flow, immittances and ratios at the port; empty where none is known."""
    at = next((end for end in (parts.port.tail, parts.port.head) if parts.units.of(end, "e")), "")
    effort, flow = (parts.units.of(at, quantity) for quantity in "ef")
    return {
        "effort": effort,
        "flow": flow,
        "Z_eq": quotient(effort, flow) if at else "",
        "Y_eq": quotient(flow, effort) if at else "",
        "ratio": "",
    }


def _form(side: OnePortEquivalent) -> str:
    """Say in which of the two forms a side exists."""
    if side.ideal:
        lost, kept, other = (
            ("Y_eq and f_eq", "e", "flow") if side.ideal == "effort" else ("Z_eq and e_eq", "f", "effort")
        )
        return f"an ideal {side.ideal} source: {kept} = {kept}_eq whatever the {other}; it has no {lost}"
    return (
        "Norton, on a 0-junction: f = f_eq - Y_eq*e (eq 15); swapped, Thévenin, on a 1-junction: "
        "e = e_eq - Z_eq*f (eq 16); f is counted out of this side"
    )


def _add_performance(result: Result, parts: Decomposition) -> None:
    """Add the static characteristic for every input that has one, at an input of 1."""
    group, found, units = f"{_GROUP}/performance", static_characteristics(parts), _units(parts)
    missing = [name for name in parts.sources if name not in found]
    if missing:
        reason = "no static characteristic: a side has no finite line at s -> 0, or both lines are parallel"
        result.annotate(group, note=f"{', '.join(missing)}: {reason}")
    if not found:
        return
    result.add_axis(f"{group}/input", list(found))
    result.add_axis(f"{group}/end", np.arange(1, 3))
    for place, name in enumerate(("flow", "effort")):
        for side in ("source", "load"):
            ends = [[float(point[place]) for point in getattr(line, side)] for line in found.values()]
            result.add(f"{group}/{side}_{name}", ends, ("input", "end"), units[name])
        operating = [float(line.operating[place]) for line in found.values()]
        result.add(f"{group}/operating_{name}", operating, ("input",), units[name])
