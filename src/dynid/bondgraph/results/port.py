"""The source-load decomposition at a port: both sides, the prototype there, its dynamics and performance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np

from dynid.bondgraph.decomposition.equivalents import Decomposition, OnePortEquivalent
from dynid.bondgraph.decomposition.prototype_dynamics import prototype_dynamics
from dynid.bondgraph.exact_engine import TransferFunction, exact_channels
from dynid.bondgraph.formula_printers import LATEX, TEXT
from dynid.bondgraph.formulas.transfer import readable_registers
from dynid.bondgraph.graph import unit_quotient
from dynid.bondgraph.reduced_graph import ReducedGraph
from dynid.bondgraph.reduction.network import STORED
from dynid.bondgraph.results.channels import add_roots
from dynid.bondgraph.results.prototype_results import add_dynamics, add_ratio, add_traces, system_text
from dynid.lti.positive_real import fraction
from dynid.result import Result

if TYPE_CHECKING:
    from numpy.typing import NDArray


_GROUP = "bond_graph/port"


def add_port(result: Result, parts: Decomposition, initial: Mapping[str, float | Fraction]) -> None:
    """Add the decomposition at a port.

    `initial`: the flow of an I or the effort of a C at t = 0, by name: what its equivalent source is scaled
    by.
    """
    prototype = parts.prototype
    result.annotate(_GROUP, bond=str(parts.port), junction=parts.meeting)
    registers: dict[str, int] = {}
    for side in (parts.source, parts.load):
        group = f"{_GROUP}/{side.name}"
        form = (
            "Norton, on a 0-junction: f = f_eq - Y_eq*e (eq 15); swapped, Thévenin, on a 1-junction: "
            "e = e_eq - Z_eq*f (eq 16); f is counted out of this side"
        )
        if side.ideal == "effort":
            form = "an ideal effort source: e = e_eq whatever the flow; it has no Y_eq and f_eq"
        elif side.ideal == "flow":
            form = "an ideal flow source: f = f_eq whatever the effort; it has no Z_eq and e_eq"
        result.annotate(group, nodes=", ".join(side.nodes), form=form)
        for immittance, register, source, drives in (
            ("Z_eq", side.impedance, "e_eq", side.effort),
            ("Y_eq", side.admittance, "f_eq", side.flow),
        ):
            if register is not None and drives is not None:
                registers[f"{group}/{immittance}"] = register
                registers |= {f"{group}/{source}/{name}": drive for name, drive in drives.items()}
    ratios, texts = parts.rational(registers.values()), readable_registers(parts, registers.values())
    for path, register in registers.items():
        ratio, stored = TransferFunction.over_field(ratios[register]), path.partition(f"/{STORED}")[2]
        if stored:  # what the energy given at t = 0 makes of it
            ratio = ratio.times(Fraction(initial[stored]))
        add_ratio(result, path, ratio, None if stored else texts.get(register))
    result.add(f"{_GROUP}/prototype", prototype.letter)
    for hand, suffix in ((TEXT, ""), (LATEX, "_latex")):
        result.add(f"{_GROUP}/prototype_equation{suffix}", prototype.equation(hand))
    result.add(f"{_GROUP}/type", prototype.type)
    result.add(f"{_GROUP}/meaning", prototype.describe(parts.meeting))
    reductions = parts.reductions
    labels = {r: label for reduction in reductions.values() for r, label in reduction.labels.items()}
    for index, system in enumerate(("system_a", "system_b")):
        for hand, suffix in ((TEXT, ""), (LATEX, "_latex")):
            result.add(f"{_GROUP}/{system}{suffix}", system_text(parts, prototype, index, labels, hand))
    add_traces(result, _GROUP, parts, reductions, "side")
    dynamics = prototype_dynamics(parts, prototype)
    add_dynamics(result, _GROUP, dynamics)
    _add_performance(result, parts)


def add_requested(result: Result, reduced: ReducedGraph) -> None:
    """Add the zeros and poles of every requested channel, to compare with the dynamics at the port."""
    for (port, source), transfer in exact_channels(reduced).items():
        add_roots(result, f"{_GROUP}/requested/{port}/{source}", "zeros", transfer.zeros)
        add_roots(result, f"{_GROUP}/requested/{port}/{source}", "poles", transfer.poles)


def add_port_response(result: Result, parts: Decomposition, omega: NDArray[np.float64]) -> None:
    """Add over frequency: both sides, effort and flow at the port, and the responses of eqs 5 to 8."""
    from dynid.bondgraph.graph_response import on_axis

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
        for name, drives in (("e_eq", side.effort), ("f_eq", side.flow)):
            if drives is not None:
                registers = [drives.get(source, zero) for source in parts.sources]
                values = on_axis(parts, registers, omega)
                result.add(f"{group}/{side.name}_{name}", values, ("omega", "input"))
    for name, answers in (("effort", parts.effort), ("flow", parts.flow)):
        values = on_axis(parts, [answers[source] for source in parts.sources], omega)
        result.add(f"{group}/{name}", values, ("omega", "input"))
    _add_power(result, parts)
    named = on_axis(parts, [parts.prototype.response], omega)[:, 0]
    unit = units[{"b": "Y_eq", "d": "ratio"}.get(parts.prototype.letter, "Z_eq")]
    result.add(f"{group}/zero_dynamics_response", named, ("omega",), unit)


#: A source whose impedance has a smaller real part, relative, has none beside rounding.
_LOSSLESS_RTOL = 1e-12


def _add_power(result: Result, parts: Decomposition) -> None:
    """Add the power into the load for inputs of amplitude 1, and the most that the source could give.

    That is |e_eq|²/(8 Re Z_eq), to a matched load; any power where the source has no resistive part.
    """
    group = f"{_GROUP}/frequency_response"
    tail, head = parts.port
    domains = {parts.units.domains.get(end, "thermal") for end in (tail, head)}
    watt = "" if "thermal" in domains else "W"
    effort, flow = (result[f"{group}/{name}"].data for name in ("effort", "flow"))
    with np.errstate(invalid="ignore"):
        power = effort * flow.conj() / 2
    power[np.isnan(power)] = np.inf  # at an undamped pole
    result.add(f"{group}/active_power", power.real, ("omega", "input"), watt)
    result.add(f"{group}/reactive_power", power.imag, ("omega", "input"), watt)
    available = np.full(power.shape, np.inf)
    if f"{group}/source_Z_eq" in result:
        impedance, source_effort = (result[f"{group}/source_{name}"].data for name in ("Z_eq", "e_eq"))
        lossy = impedance.real > _LOSSLESS_RTOL * np.abs(impedance)
        available[lossy] = np.abs(source_effort[lossy]) ** 2 / (8 * impedance.real[lossy, None])
        available[source_effort == 0] = 0.0
    result.add(f"{group}/available_power", available, ("omega", "input"), watt)


def _units(parts: Decomposition) -> dict[str, str]:
    """Return the units of effort, flow, immittances and ratios at the port; empty where none is known."""
    at = next((end for end in (parts.port.tail, parts.port.head) if parts.units.of(end, "e")), "")
    effort, flow = (parts.units.of(at, quantity) for quantity in "ef")
    return {
        "effort": effort,
        "flow": flow,
        "Z_eq": unit_quotient(effort, flow) if at else "",
        "Y_eq": unit_quotient(flow, effort) if at else "",
        "ratio": "",
    }


# --- static characteristic -------------------------------------------------------------------------

# At s -> 0 either side is a straight line, a e + b f = c for a unit value of an input. It is taken from the
# exact equivalents, so that an infinite impedance is a vertical line and no division by zero.

FlowEffort = tuple[Fraction, Fraction]


@dataclass(frozen=True)
class _StaticLine:
    """The points (f, e) with effort * e + flow * f = right."""

    effort: Fraction
    flow: Fraction
    right: Fraction

    def meets(self, line: _StaticLine) -> FlowEffort | None:
        """Return the point (f, e) that two lines share, None where they are parallel."""
        determinant = self.effort * line.flow - self.flow * line.effort
        if determinant == 0:
            return None
        effort = (self.right * line.flow - self.flow * line.right) / determinant
        flow = (self.effort * line.right - self.right * line.effort) / determinant
        return flow, effort

    def ends(self, box: tuple[FlowEffort, FlowEffort]) -> tuple[FlowEffort, FlowEffort]:
        """Return the points where the line enters and leaves a box, given by two corners."""
        (left, low), (right, high) = box
        sides = [_StaticLine(Fraction(0), Fraction(1), left), _StaticLine(Fraction(0), Fraction(1), right)]
        sides += [_StaticLine(Fraction(1), Fraction(0), low), _StaticLine(Fraction(1), Fraction(0), high)]
        crossings = [point for side in sides if (point := self.meets(side)) is not None]
        inside = sorted(point for point in crossings if left <= point[0] <= right and low <= point[1] <= high)
        return inside[0], inside[-1]


@dataclass(frozen=True)
class _StaticCharacteristic:
    """The static characteristic for one input of value 1."""

    #: source, load: The ends (f, e) of both lines, within a box that shows their intercepts and the operating
    #: point.
    source: tuple[FlowEffort, FlowEffort]
    load: tuple[FlowEffort, FlowEffort]
    operating: FlowEffort  # the operating point (f, e)


def static_characteristics(parts: Decomposition) -> dict[str, _StaticCharacteristic]:
    """Return the static characteristic for every input that has one.

    It has none where a side has no finite line at s -> 0 (an input that is integrated without end), or where
    the lines are parallel (a motion that nothing stops).
    """
    characteristics = {}
    for name in parts.sources:
        source, load = _line(parts, parts.source, name, 1), _line(parts, parts.load, name, -1)
        operating = source.meets(load) if source is not None and load is not None else None
        if source is None or load is None or operating is None:
            continue
        box = _box(source, load, operating)
        characteristics[name] = _StaticCharacteristic(source.ends(box), load.ends(box), operating)
    return characteristics


def _line(parts: Decomposition, side: OnePortEquivalent, name: str, outward: int) -> _StaticLine | None:
    """Return e + Z_eq f = e_eq, or Y_eq e + f = f_eq, at s -> 0, f counted into the load."""
    drives = side.flow if side.impedance is None else side.effort
    immittance = side.admittance if side.impedance is None else side.impedance
    assert drives is not None
    assert immittance is not None
    registers = [immittance, drives.get(name, parts.program.zero)]
    ratios = parts.rational(registers)
    immittance_ratio, drive = (TransferFunction.over_field(ratios[register]) for register in registers)
    below = immittance_ratio.denominator
    common = below * drive.denominator // below.gcd(drive.denominator)
    multiples = (
        immittance_ratio.numerator * (common // immittance_ratio.denominator),
        drive.numerator * (common // drive.denominator),
    )
    # at s = 0, without a common power of s
    rows = [[fraction(c) for c in polynomial.coeffs()] for polynomial in (common, *multiples)]
    lowest = min(next(k for k, c in enumerate(row) if c) for row in rows if row)
    at_common, at_immittance, right = (Fraction(row[lowest] if lowest < len(row) else 0) for row in rows)
    if at_common == at_immittance == 0:
        return None
    effort, flow = (at_immittance, at_common) if side.impedance is None else (at_common, at_immittance)
    return _StaticLine(effort, outward * flow, right)


def _box(source: _StaticLine, load: _StaticLine, operating: FlowEffort) -> tuple[FlowEffort, FlowEffort]:
    """Return a box around the origin, the operating point and the intercepts of both lines."""
    zero = Fraction(0)
    axes = _StaticLine(Fraction(1), zero, zero), _StaticLine(zero, Fraction(1), zero)
    points = [operating, (zero, zero)]
    points += [point for line in (source, load) for axis in axes if (point := line.meets(axis)) is not None]
    corners = []
    for axis in (0, 1):
        low, high = min(point[axis] for point in points), max(point[axis] for point in points)
        margin = (high - low) / 10 or Fraction(1)
        corners.append((low - margin, high + margin))
    (left, right), (low, high) = corners
    return (left, low), (right, high)


def _add_performance(result: Result, parts: Decomposition) -> None:
    """Add the static characteristic for every input that has one, at an input of 1."""
    group, characteristics, units = f"{_GROUP}/performance", static_characteristics(parts), _units(parts)
    missing = [name for name in parts.sources if name not in characteristics]
    if missing:
        reason = "no static characteristic: a side has no finite line at s -> 0, or both lines are parallel"
        result.annotate(group, note=f"{', '.join(missing)}: {reason}")
    if not characteristics:
        return
    result.add_axis(f"{group}/input", list(characteristics))
    result.add_axis(f"{group}/end", np.arange(1, 3))
    for axis, name in enumerate(("flow", "effort")):
        for side in ("source", "load"):
            lines = [getattr(line, side) for line in characteristics.values()]
            ends = [[float(point[axis]) for point in line] for line in lines]
            result.add(f"{group}/{side}_{name}", ends, ("input", "end"), units[name])
        operating = [float(line.operating[axis]) for line in characteristics.values()]
        result.add(f"{group}/operating_{name}", operating, ("input",), units[name])
