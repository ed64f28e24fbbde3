"""The scope of a model: the nodes that an output depends on, and those that are left out."""

from __future__ import annotations

from dynid.bondgraph.graph import SOURCES, Port
from dynid.bondgraph.plan import ReducedGraph
from dynid.bondgraph.request import ENGINES, RESULTS, Analysis
from dynid.model_scope import ScopePart, add_model_scope, divided
from dynid.result import Result


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


def add_graph_scope(result: Result, reduced: ReducedGraph | None, analysis: Analysis) -> None:
    """Add what was modelled of a graph and what was left out: elements, storages, states, engines, results.

    Parameters
    ----------
    result
        The result so far.
    reduced
        The graph, reduced; None where it was not.
    analysis
        What was asked.
    """
    parts = [] if reduced is None else _of_graph(result, reduced)
    about = result.group_attrs["bond_graph"]
    why = str(about.get("engine_reason", "no result needs one"))
    parts.append(divided("engines", ENGINES, _engines(result), why))
    parts.append(divided("results", RESULTS, analysis.results, "not asked for"))
    add_model_scope(result, "bond_graph", parts)


def _of_graph(result: Result, reduced: ReducedGraph) -> list[ScopePart]:
    ports = [set(dropped(reduced, port)) for port in reduced.outputs]
    nodes = list(reduced.graph.nodes)
    kept = [name for name in nodes if not all(name in left_out for left_out in ports)]
    parts = [divided("elements", nodes, kept, "no output depends on them")]
    inside = [name for name in reduced.storages if name in kept]
    parts.append(divided("storages", reduced.storages, inside, "no output depends on them"))
    states = _states(result)
    if states is not None:
        dependent = max(0, len(inside) - len(states))
        parts.append(
            ScopePart("states", states, dependent, "storages that follow from others or from a source")
        )
    return parts


def _states(result: Result) -> list[str] | None:
    """Return the names of the states, where state equations were written."""
    if "bond_graph/state_space/state" in result:
        return [str(name) for name in result["bond_graph/state_space/state"].data]
    about = result.group_attrs.get("bond_graph/time_response")
    return None if about is None else [name for name in str(about["states"]).split(", ") if name]


def _engines(result: Result) -> set[str]:
    """Return the engines that results came from: certified roots are exact, formulas symbolic."""
    about = result.group_attrs["bond_graph"]
    used = {str(about["engine"])} if "engine" in about else set()
    if any(path.endswith("_error_bound") or "/sensitivities/" in path for path in result):
        used.add("exact")
    formulas = any("symbolic" in attributes for attributes in result.group_attrs.values())
    if formulas or any(path.endswith(("/program", "/symbolic_denominator")) for path in result):
        used.add("symbolic")
    return used
