"""A graph with laws whose loops are closed, for time responses that are not linear.

Controllers act on deviations from the operating point: a setpoint of each holds what it measures there, and a
reference of each driven source what the source gives there. An answer within limits is the flow of a resistor
whose law has the effort zero.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np

from dynid.arithmetic.expression import parse
from dynid.arithmetic.ldl import reference as value_of
from dynid.arrays import Array
from dynid.bondgraph.controller_circuits import Loop, close_loops
from dynid.bondgraph.graph import ONE_PORTS, Port
from dynid.bondgraph.operating_point.element_laws import Law, LawGraph
from dynid.bondgraph.operating_point.equilibrium import OperatingPoint
from dynid.bondgraph.reduction.junctions import unique
from dynid.errors import NumericalError

#: Rate of an integral at the operating point, relative to the largest variable, above which it moves.
_MOVING_RTOL = 1e-9
_WITHIN = parse("y - min(max(a, low), high)")


@dataclass(frozen=True, eq=False)
class RestingGraph:
    """A graph with laws and its variables at rest, from where a response starts."""

    model: LawGraph
    inputs: Mapping[str, Fraction | float]  # constant values of sources; others are zero
    values: Mapping[Port, float]  # of variables at rest; others follow from them
    outputs: tuple[Port, ...]
    delayed: tuple[tuple[str, Port, float], ...] = ()  # sources of delayed answers, the answers, delays in s
    integrals: tuple[Port, ...] = ()  # states of no storage whose values at the start determine the point
    bonds: Array | None = None  # of a graph without loops: efforts and flows at rest, by its bonds

    @property
    def closed(self) -> bool:
        """True if it has loops."""
        return self.bonds is None


def resting_graph(
    model: LawGraph, point: OperatingPoint | None, loops: Sequence[Loop], outputs: Sequence[Port]
) -> RestingGraph:
    """Return a graph at its operating point, with its loops closed; without a point all is zero."""
    graph, inputs = model.graph, dict(point.request.inputs if point is not None else {})
    values = {} if point is None else _values(point)
    integrals: tuple[Port, ...] = ()
    if point is not None:
        integrals = tuple(port for port in point.request.start if port.quantity in "qp")
    if not loops:
        assert point is not None
        shared = point.solution.z[: 2 * len(graph.bonds)]
        return RestingGraph(model, inputs, values, tuple(outputs), (), integrals, shared)
    names = {*graph.nodes, *(name for loop in loops for name in (loop.reference, loop.setpoint))}
    rests: dict[str, Fraction | float] = {}
    closed_loops = []
    for loop in loops:
        reference, setpoint = loop.reference, loop.setpoint
        if loop.source in inputs:
            reference = reference or unique(f"{loop.source}.rest", names)
            rests[reference] = inputs.pop(loop.source)
        if value := _at_rest(point, loop.measured, model):
            setpoint = setpoint or unique(f"{loop.source}.target", names)
            rests[setpoint] = value
        names |= {reference, setpoint}
        closed_loops.append(replace(loop, reference=reference, setpoint=setpoint))
    closed = close_loops(graph, closed_loops, cut=True, lawful=model.laws)
    delays = [float(value_of(loop.delay)) for loop in closed_loops if loop.delayed]
    delayed = tuple((*pair, delay) for pair, delay in zip(closed.delayed, delays, strict=True))
    laws = dict(model.laws)
    for node, answer, limits in closed.limited:
        bounds = {"low": limits.low, "high": limits.high}
        laws[node] = Law("e", _WITHIN, bounds, {"y": Port(node, "f"), "a": answer})
    moved = closed.variables
    laws = {
        name: replace(law, variables={key: moved.get(port, port) for key, port in law.variables.items()})
        for name, law in laws.items()
    }
    values = {moved.get(port, port): value for port, value in values.items()}
    ports = tuple(moved.get(port, port) for port in outputs)
    return RestingGraph(LawGraph(closed.graph, laws), inputs | rests, values, ports, delayed, integrals)


def _at_rest(point: OperatingPoint | None, port: Port, model: LawGraph) -> float:
    """Return what a controller measures at a point; integrals of its own begin at zero."""
    if point is None:
        return 0.0
    if port.quantity in "ef" or (model.graph.is_state(port) and port.node not in model.laws):
        return point.value(port)
    rate = Port(port.node, "f" if port.quantity == "q" else "e")
    if abs(point.value(rate)) > _MOVING_RTOL * float(np.abs(point.solution.z).max()):
        raise NumericalError(f"a controller measures '{port}', which moves at the operating point")
    return 0.0


def _values(point: OperatingPoint) -> dict[Port, float]:
    """Return efforts and flows of all elements and states at a point, but those of integrals of its own."""
    graph = point.equations.model.graph
    elements = [name for name, node in graph.nodes.items() if node.type in ONE_PORTS]
    ports = [*(Port(name, quantity) for name in elements for quantity in "ef"), *point.equations.states]  # type: ignore[arg-type]
    return {port: point.value(port) for port in ports}
