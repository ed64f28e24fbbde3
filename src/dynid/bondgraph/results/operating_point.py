"""The operating point of a graph with laws: its variables, all equilibria found, the slopes of the laws."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dynid.bondgraph.graph import ONE_PORTS, GraphUnits, Port, unit_quotient
from dynid.bondgraph.operating_point.equilibrium import OperatingPoint
from dynid.bondgraph.operating_point.linearisation import Linearisation
from dynid.bondgraph.request import Analysis
from dynid.errors import NumericalError
from dynid.result import Result

GROUP = "bond_graph/operating_point"
_TIME = "bond_graph/time_response"
_NUMERICAL = (
    "linear results are exact for the slopes as rounded to doubles; what rests on exact equality of slopes, "
    "as roots that cancel, is numerical"
)
_STABILITY = {1: "stable", 0: "neutral", -1: "unstable"}


def add_operating_point(result: Result, linear: Linearisation) -> None:
    """Add the operating point.

    Parameters
    ----------
    result
        Where to add it.
    linear
        The linearisation at it.
    """
    point, equations = linear.point, linear.point.equations
    units = GraphUnits(equations.model.graph)
    ports = list(_variables(point))
    columns = [equations.column(port) for port in ports]
    known = [_determined(point, column) for column in columns]
    result.add_axis(f"{GROUP}/variable", [str(port) for port in ports])
    result.add(f"{GROUP}/value", _kept(point.solution.z[columns], known), ("variable",))
    own = [units.of_output(port) for port in ports]
    if any(own):
        result.add(f"{GROUP}/unit", own, ("variable",))
    sources = [name for name, node in equations.model.graph.nodes.items() if node.type in ("Se", "Sf")]
    result.add_axis(f"{GROUP}/input", sources)
    given = [
        point.solution.z[equations.column(_of_source(equations.model.graph.nodes[name].type, name))]
        for name in sources
    ]
    result.add(f"{GROUP}/input_value", np.array(given, dtype=float), ("input",))
    result.add(f"{GROUP}/residual", point.solution.residual)
    result.add(f"{GROUP}/condition", point.solution.condition)
    if point.equilibria:
        result.add(f"{GROUP}/chosen", point.number)
        result.add_axis(f"{GROUP}/equilibrium", np.arange(1, len(point.equilibria) + 1))
        table = np.array([one.z[columns] for one in point.equilibria])
        result.add(f"{GROUP}/equilibria", table, ("equilibrium", "variable"))
        result.add(f"{GROUP}/stability", [_STABILITY[one] for one in point.stable], ("equilibrium",))
    _add_slopes(result, linear, units)
    about = (
        f"{len(point.equilibria)} {'equilibrium' if len(point.equilibria) == 1 else 'equilibria'} found"
        if point.equilibria
        else "given"
    )
    result.annotate(GROUP, status=about, note=_NUMERICAL)
    if linear.flat:
        result.annotate(GROUP, flat=", ".join(linear.flat))


def _variables(point: OperatingPoint) -> Iterator[Port]:
    """Yield efforts and flows of all elements, states, and what else laws depend on."""
    equations = point.equations
    seen = dict.fromkeys(
        Port(name, quantity)
        for name, node in equations.model.graph.nodes.items()
        if node.type in ONE_PORTS
        for quantity in ("e", "f")
    )
    seen |= dict.fromkeys(equations.states)
    yield from dict.fromkeys([*seen, *(port for law in equations.model.laws.values() for port in law.ports)])


def _determined(point: OperatingPoint, column: int) -> bool:
    return bool(point.equilibria) or column not in point.solution.free


def _kept(values: np.ndarray, known: list[bool]) -> np.ndarray:
    """Return values; those that a given point leaves open are NaN."""
    return np.where(known, values, np.nan)


def _of_source(kind: str, name: str) -> Port:
    return Port(name, "e" if kind == "Se" else "f")


def _add_slopes(result: Result, linear: Linearisation, units: GraphUnits) -> None:
    """Add the derivatives of what laws give by every variable."""
    equations = linear.point.equations
    rows = [(one, column, slope) for one in linear.slopes for column, slope in one.slopes.items()]
    if not rows:
        return
    outs = [equations.port(one.row.out) for one, _, _ in rows]
    bys = [
        dict(zip(one.row.arguments, equations.model.laws[one.row.node].ports, strict=True)).get(
            column, equations.port(column)
        )
        for one, column, _ in rows
    ]
    result.add_axis(f"{GROUP}/slope", [f"d {out} / d {by}" for out, by in zip(outs, bys, strict=True)])
    result.add(f"{GROUP}/slope_value", np.array([one.row.sign * slope for one, _, slope in rows]), ("slope",))
    pairs = [(units.of_output(out), units.of_output(by)) for out, by in zip(outs, bys, strict=True)]
    found = [unit_quotient(above, below) if above and below else "" for above, below in pairs]
    if any(found):
        result.add(f"{GROUP}/slope_unit", found, ("slope",))


def add_nonlinear_response(result: Result, analysis: Analysis) -> None:
    """Add the nonlinear response beside the linear one, and how far they differ.

    Both are deviations from the operating point. `nonlinear_deviation` is their largest difference, beside
    the largest value of the linear response.

    Parameters
    ----------
    result
        With the linear response.
    analysis
        What was asked for.
    """
    from dynid.bondgraph.operating_point.response import TOLERANCE, nonlinear_response

    assert analysis.linearisation is not None
    assert analysis.times is not None
    if analysis.loops:
        result.annotate(_TIME, nonlinear="left out: loops are closed around the linearisation")
        return
    point = analysis.linearisation.point
    try:
        found = nonlinear_response(
            point, analysis.law_outputs, analysis.times, analysis.signals, analysis.initial
        )
    except NumericalError as error:
        result.annotate(_TIME, nonlinear=f"left out: {error.problem}")
        return
    linear = result[f"{_TIME}/response"]
    size = np.abs(linear.data).max(axis=0)
    size[size == 0] = np.abs(found.outputs).max(axis=0)[size == 0]
    size[size == 0] = 1.0
    deviation = np.abs(found.outputs - linear.data).max(axis=0) / size
    result.add(f"{_TIME}/nonlinear", found.outputs, ("time", "output"), linear.units)
    values = [
        point.value(port) if port.quantity in "ef" else _at_rest(point, port) for port in analysis.law_outputs
    ]
    result.add(f"{_TIME}/operating_value", np.array(values), ("output",), linear.units)
    result.add(f"{_TIME}/nonlinear_deviation", deviation, ("output",))
    result.annotate(_TIME, nonlinear_tolerance=TOLERANCE, nonlinear_error=found.error)


def _at_rest(point: OperatingPoint, port: Port) -> float:
    """Return the value of an integral; zero where it counts from t = 0."""
    return point.value(port) if Port(port.node, port.quantity) in point.equations.states else 0.0
