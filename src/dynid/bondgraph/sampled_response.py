"""Responses of graphs with sampled loops.

Frequency responses are fundamental: of a sine the part of the answer at its own frequency. Between input d
and output y, on s = jω with z = exp(s T), it is P_yd + P_yu H(s)/T U(z) P_md: what is measured is sampled,
the controllers answer by U with the loops closed, and the holds H = (1 - exp(-s T))/s exp(-s c) pass 1/T of
it at the frequency itself, the rest at |ω + 2πk/T| (aliases).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import ComplexArray
from dynid.bondgraph.graph import Port
from dynid.bondgraph.graph_response import frequency_response
from dynid.bondgraph.graph_state_space import state_space
from dynid.bondgraph.reduced_graph import Channel, ReducedGraph
from dynid.bondgraph.sampled_loops import SampledLoops, cut_graph
from dynid.lti.delay_system import DelaySystem
from dynid.lti.delayed_step import delayed_steps
from dynid.lti.sampled_system import SampledSystem
from dynid.lti.step_info import NO_STEADY_STATE, StepInfo

#: Points on a circle around a pole of the graph, over which the response is averaged, and the circle's radius
#: relative to the distance of the nearest pole of the closed loops: the error is the radius to that power.
_CIRCLE_POINTS, _CIRCLE_RADIUS = 32, 0.25
#: Size of a discrete pole below which it has decayed at once.
_FAST = 1e-3


def sampled_system(
    loops: SampledLoops,
    inputs: Sequence[str],
    outputs: Sequence[Port],
    initial: Sequence[str] = (),
    *,
    limited: bool = False,
) -> tuple[SampledSystem, ReducedGraph]:
    """Return a graph with sampled loops as a system with sampled controllers, and the graph without them.

    `initial`: storages with energy at t = 0, each with an input `initial:NAME` after those of the graph.
    `limited`: answers are within their limits, and the system is not linear.
    """
    cut = cut_graph(loops.opened, loops.loops, loops.continuous)
    shown, leaving = [*outputs, *cut.answered], [port for _, port in cut.delayed]
    rows, arriving = [*dict.fromkeys(shown), *leaving], [source for source, _ in cut.delayed]
    sources = list(dict.fromkeys([*inputs, *cut.held, *arriving]))
    reduced = ReducedGraph(cut.graph, sources, rows, traced=False)
    columns = [*inputs, *(f"initial:{name}" for name in initial), *cut.held, *arriving]
    lft = state_space(reduced, tuple(initial)).with_inputs(columns)
    plant = DelaySystem(lft, loops.delays).with_outputs([rows.index(port) for port in shown])
    controllers = loops.float_controllers(limited=limited)
    return SampledSystem(plant.lft, loops.delays, controllers), reduced


def sampled_steps(
    loops: SampledLoops, inputs: Sequence[str], outputs: Sequence[Port]
) -> dict[Channel, StepInfo]:
    """Return the characteristics of the step responses of all channels."""
    channels = [(port, source) for port in outputs for source in inputs]
    if not loops.verdict.stable:
        return dict.fromkeys(channels, StepInfo(f"undefined: {NO_STEADY_STATE.format(loops.verdict.text)}"))
    system, _ = sampled_system(loops, inputs, outputs)
    finals = sampled_response(loops, inputs, outputs)(np.zeros(1))[0].real
    largest = float(np.abs(loops.listed_poles).max(initial=0.0))
    slowest = math.log(max(largest, _FAST)) / float(loops.period)
    steps: dict[Channel, StepInfo] = {}
    for column, source in enumerate(inputs):
        infos = delayed_steps(system.with_inputs([source]), finals[:, column].tolist(), slowest)
        steps |= {(port, source): info for port, info in zip(outputs, infos, strict=True)}
    return steps


def sampled_response(
    loops: SampledLoops, inputs: Sequence[str], outputs: Sequence[Port]
) -> Callable[[NDArray[np.float64]], ComplexArray]:
    """Return the fundamental frequency response of a graph with sampled loops.

    Of angular frequencies in rad/s, it returns the response, shape (omega, output, input). Where the graph
    without its loops has a pole on the axis, the response is the mean of that on a circle around it (Cauchy).
    """
    cut = cut_graph(loops.opened, loops.loops, loops.continuous)
    arriving, leaving = [source for source, _ in cut.delayed], [port for _, port in cut.delayed]
    columns = list(dict.fromkeys([*inputs, *cut.held, *arriving]))
    rows = list(dict.fromkeys([*outputs, *cut.answered, *leaving]))
    reduced = ReducedGraph(cut.graph, columns, rows, traced=False)
    late_rows = [rows.index(port) for port in leaving]
    late_columns = [columns.index(name) for name in arriving]
    inner_delays = np.array([float(delay) for delay in loops.delays])
    shown, measured = ([rows.index(port) for port in ports] for ports in (outputs, cut.answered))
    driven, held = ([columns.index(name) for name in names] for names in (inputs, cut.held))
    answers = loops.answers()
    period, delays = float(loops.period), np.array([float(delay) for delay in loops.computations])

    def closed(s: ComplexArray, graph: ComplexArray) -> ComplexArray:
        """Return the response from that of the graph with its loops and delays cut."""
        if late_rows:
            late = graph[:, :, late_columns] * np.exp(-s[:, None, None] * inner_delays)
            back = np.eye(len(late_rows)) - late[:, late_rows]
            with np.errstate(invalid="ignore"):
                graph = graph + late @ np.linalg.solve(back, graph[:, late_rows])
        rate = np.where(s == 0, 1.0, s)
        hold = np.where(s == 0, 1.0, -np.expm1(-s * period) / (rate * period))
        holds = hold[:, None] * np.exp(-s[:, None] * delays)
        with np.errstate(invalid="ignore"):
            fed = graph[:, shown][:, :, held] * holds[:, None, :]
            back = fed @ answers(np.exp(s * period)) @ graph[:, measured][:, :, driven]
            return np.asarray(graph[:, shown][:, :, driven] + back)

    def evaluate(omega: NDArray[np.float64]) -> ComplexArray:
        response = closed(np.asarray(1j * omega), frequency_response(reduced, omega))
        for k in np.flatnonzero(~np.isfinite(response).all(axis=(1, 2))):
            response[k] = around(complex(0, omega[k]))
        return response

    def around(s: complex) -> ComplexArray:
        system = state_space(reduced)
        poles = loops.listed_poles
        apart = np.abs(np.log(poles[poles != 0] * np.exp(-s * period)) / period)
        radius = _CIRCLE_RADIUS * min(float(apart.min(initial=np.inf)), 1 / period)
        points = s + radius * np.exp(2j * np.pi * (np.arange(_CIRCLE_POINTS) + 0.5) / _CIRCLE_POINTS)
        states = np.linalg.solve(points[:, None, None] * np.eye(len(system.A)) - system.A, system.B + 0j)
        graph = np.asarray(system.C @ states + system.D, dtype=np.complex128)
        for order, matrix in enumerate(system.higher, 1):
            graph = graph + points[:, None, None] ** order * matrix
        return np.asarray(closed(points, graph).mean(axis=0))

    return evaluate
