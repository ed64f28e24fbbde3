"""State equations of graphs whose loops have delays, as a linear fractional form."""

from __future__ import annotations

from collections.abc import Sequence

from dynid.arithmetic.ldl import reference
from dynid.arithmetic.numbers import rounded as rounded_number
from dynid.bondgraph.controller_circuits import Loop, close_loops
from dynid.bondgraph.cut_loops import in_proportion
from dynid.bondgraph.graph import BondGraph, Port
from dynid.bondgraph.graph_state_space import state_space
from dynid.bondgraph.reduced_graph import ReducedGraph
from dynid.errors import NumericalError
from dynid.lti.delay_system import DelaySystem


def delay_system(
    opened: BondGraph,
    loops: Sequence[Loop],
    inputs: Sequence[str],
    outputs: Sequence[Port],
    initial: Sequence[str] = (),
) -> tuple[DelaySystem, ReducedGraph]:
    """Return a graph with feedback as a system with internal delays, and the graph with these loops cut.

    The answers of these loops are outputs z, the delayed answers inputs v. `initial`: storages with energy at
    t = 0, each with an input `initial:NAME` after those of the graph, as of `state_space`.
    """
    closed = close_loops(opened, loops, cut=True)
    ports = [closed.variables.get(port, port) for port in outputs]
    answers = [answer for _, answer in closed.delayed]
    columns = [*inputs, *(source for source, _ in closed.delayed)]
    reduced = ReducedGraph(closed.graph, columns, [*ports, *answers], traced=False)
    lft = state_space(reduced, tuple(initial))
    order = [*inputs, *(f"initial:{name}" for name in initial), *(source for source, _ in closed.delayed)]
    delays = in_proportion([rounded_number(reference(loop.delay)) for loop in loops if reference(loop.delay)])
    try:
        return DelaySystem(lft.with_inputs(order), tuple(delays)), reduced
    except NumericalError as error:  # an advanced loop
        error.names = tuple(loop.place for loop in loops if loop.place and reference(loop.delay))
        raise
