"""What an output depends on, and what is left out of its model because it does not."""

from __future__ import annotations

from dynid.bondgraph.graph import SOURCES, Port
from dynid.bondgraph.reduced import ReducedGraph


def dropped(reduced: ReducedGraph, port: Port) -> tuple[str, ...]:
    """Return the nodes that an output is independent of, in the order of the graph.

    These are nodes behind an ideal source or not connected, sources that are no inputs or do not reach the
    output, and elements whose value enters neither the output's transfer functions, nor the natural modes
    behind it, nor its prototype.

    Parameters
    ----------
    reduced
        The graph.
    port
        One of its outputs.
    """
    reduction, program = reduced.reductions[port], reduced.program
    prototype = reduction.prototype
    wanted = [*reduction.channels.values(), *reduction.pivots, prototype.part_a, prototype.part_b]
    kept = program.parameters(wanted)
    kept |= {source for source, register in reduction.channels.items() if not program.is_zero(register)}
    kept.add(port.node)
    fixing = reduced.structure.junctions[reduction.root].fixing
    if fixing is not None:
        kept.add(fixing)
    inside = set(reduction.modelled)
    return tuple(
        name
        for name, node in reduced.graph.nodes.items()
        if name not in kept and (name not in inside or node.value is not None or node.type in SOURCES)
    )
