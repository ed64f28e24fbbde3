"""A bond graph explained: what is left out, causality, the engine, and what the answers cost."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import NamedTuple

from dynid.bondgraph.causality.report import join_nodes
from dynid.bondgraph.graph import STORAGES, BondGraph
from dynid.bondgraph.plan import ReducedGraph
from dynid.bondgraph.reduction.junctions import JunctionStructure
from dynid.bondgraph.reduction.solvability import hold
from dynid.bondgraph.request import NUMERIC, RESULTS, Analysis, EngineChoice, choose_engine, modelled_storages
from dynid.bondgraph.results.causality import add_causality
from dynid.defaults import COMPILED_RESPONSES, EXACT_ROOTS, EXACT_ROOTS_ON_LOOPS, MANY_LOOPS
from dynid.errors import NumericalError
from dynid.number_format import counted
from dynid.progress import report_progress
from dynid.result import Result
from dynid.scene.explanations.explanation import (
    CostEstimate,
    Explanation,
    Fact,
    file_kilobytes,
    peak_megabytes,
    speed,
)
from dynid.scene.kinds.bond_graph import question
from dynid.scene.load import Scene


def explain(scene: Scene) -> Explanation:
    """Explain a scene of kind `bond-graph`: its graph is reduced, which takes no numbers; nothing is run."""
    graph, analysis = question(scene)
    if analysis.reading == "binary":
        graph = graph.rounded()
    result = Result("bond-graph", scene.title)
    report_progress("assigning causality")
    causality = add_causality(result, graph)
    facts = [Fact("graph", f"{counted(len(graph.nodes), 'node')}, {counted(len(graph.bonds), 'bond')}")]
    report_progress("reducing the graph")
    began = time.thread_time()
    try:
        reduced = ReducedGraph(graph, analysis.inputs, analysis.outputs)
    except NumericalError as error:
        if analysis.results != {"causality"}:
            return Explanation(result, facts, obstacle=error)
        return _with_causality_alone(result, facts, graph)
    seconds = time.thread_time() - began
    facts = [*_modelled(facts[0], reduced), _order(graph, causality.order)]
    facts += [Fact("warning", sentence) for sentence in reduced.undetermined]
    outputs, inputs = (
        join_nodes([str(name) for name in names]) for names in (reduced.outputs, reduced.inputs)
    )
    facts.append(Fact("channels", f"{outputs} from {inputs or 'no input'}"))
    choice = choose_engine(reduced, analysis) if analysis.results & {"transfer_function", *NUMERIC} else None
    if choice is not None:
        facts.append(Fact("engine", f"{choice.engine}: {choice.reason}"))
        if choice.engine != "exact":
            facts.append(Fact("", choice.limits))
    facts += _computed(analysis)
    if analysis.port is not None:
        facts.append(
            Fact("port", f"cut at {analysis.port}: equivalents of both sides, prototype, performance")
        )
    return Explanation(result, facts, _cost(reduced, analysis, choice, seconds))


def _with_causality_alone(result: Result, facts: list[Fact], graph: BondGraph) -> Explanation:
    """Explain a graph without a unique solution of which nothing but causality is asked for."""
    try:
        open_parts = hold(JunctionStructure(graph), ())
    except NumericalError as error:
        return Explanation(result, facts, obstacle=error)
    return Explanation(result, [*facts, *(Fact("warning", each.error.problem) for each in open_parts)])


def _modelled(graph: Fact, reduced: ReducedGraph) -> list[Fact]:
    """Say what no output depends on."""
    left = set.intersection(*(set(reduced.dropped(port)) for port in reduced.outputs))
    names = [name for name in reduced.graph.nodes if name in left]
    if not names:
        return [graph._replace(text=f"{graph.text}, all of them needed")]
    return [graph, Fact("left out", f"{join_nodes(names)}: no output depends on them")]


def _order(graph: BondGraph, order: int) -> Fact:
    storages = sum(node.type in STORAGES for node in graph.nodes.values())
    return Fact("order", f"{counted(order, 'state')} of {counted(storages, 'energy storage')}")


def _computed(analysis: Analysis) -> list[Fact]:
    asked = [name for name in RESULTS if name in analysis.results]
    others = [name for name in RESULTS if name not in analysis.results]
    facts = [Fact("computes", ", ".join(asked).replace("_", " "))]
    grids = []
    if analysis.omega is not None:
        grids.append(counted(len(analysis.omega), "frequency"))
    if analysis.times is not None:
        grids.append(counted(len(analysis.times), "instant"))
    if grids:
        facts.append(Fact("", f"at {' and '.join(grids)}"))
    if others:
        facts.append(Fact("not asked", ", ".join(others).replace("_", " ")))
    return facts


class _Size(NamedTuple):
    """Sizes that the cost depends on: storages, channels, outputs, operations, frequencies, instants."""

    storages: int
    channels: int
    outputs: int
    operations: int
    frequencies: int
    instants: int
    engine: str
    roots: bool
    loops: int


def _engine_seconds(size: _Size) -> float:
    """Roots grow with the cube of the degree, polynomials with its square."""
    n = float(size.storages)
    times = (size.channels + size.outputs) / 2
    if size.engine == "symbolic":
        return 1e-3 * n
    if size.engine == "float":
        return times * (6e-4 * n + 3.5e-8 * n**3)
    if size.loops > MANY_LOOPS.value:  # coefficients are longer there: so much that the limits differ
        n *= EXACT_ROOTS.value / EXACT_ROOTS_ON_LOOPS.value
    return times * (3e-4 * n + (5e-8 * n**3 if size.roots else 1e-6 * n**2))


def _response_seconds(size: _Size) -> float:
    if size.operations > COMPILED_RESPONSES.value:  # compiled, in doubled precision
        return 0.4 + 1e-8 * size.operations * size.frequencies
    return size.operations * (8e-6 + 3e-8 * size.frequencies)


def _time_seconds(size: _Size) -> float:
    n = size.storages
    return 3e-3 + 3.5e-5 * n**2 + size.instants * (1e-6 + 1e-9 * n**2)


#: Seconds of what can be asked for, on the machine of the rates.
_RATES: dict[str, Callable[[_Size], float]] = {
    "sensitivities": lambda size: size.channels * 1.2e-4 * size.storages**2.65,
    "reduction": lambda size: size.outputs * 3e-4 * size.storages,
    "prototype": lambda size: size.outputs * 3e-4 * size.storages,
    "state_space": lambda size: 6e-4 * size.storages,
    "frequency_response": _response_seconds,
    "time_response": _time_seconds,
    "causality": lambda size: 1e-3 * size.storages,
}


def _cost(
    reduced: ReducedGraph, analysis: Analysis, choice: EngineChoice | None, seconds: float
) -> CostEstimate:
    structure = reduced.structure
    size = _Size(
        storages=modelled_storages(reduced),
        channels=len(reduced.channels()),
        outputs=len(reduced.outputs),
        operations=len(reduced.program.ops),
        frequencies=0 if analysis.omega is None else len(analysis.omega),
        instants=0 if analysis.times is None else len(analysis.times),
        engine=choice.engine if choice else "",
        roots=bool(analysis.results & NUMERIC),
        loops=len(structure.couplings) - len(structure.junctions) + 1,
    )
    parts = {"reducing the graph": seconds}
    if choice is not None:
        parts["zeros, poles and polynomials" if size.roots else "polynomials"] = (
            _engine_seconds(size) / speed()
        )
    for name, rate in _RATES.items():
        if name in analysis.results:
            parts[name.replace("_", " ")] = rate(size) / speed()
    values = 60.0 * size.frequencies + 2.0 * size.instants * (size.outputs + 1)
    if analysis.results & {"time_response", "state_space"}:
        values += 8.0 * size.storages**2
    return CostEstimate(
        parts, peak_megabytes() + 8e-6 * values, _kilobytes(size, analysis, len(reduced.inputs))
    )


def _kilobytes(size: _Size, analysis: Analysis, inputs: int) -> float:
    values = float(size.frequencies * (1 + 2 * size.channels))
    values += size.instants * (1 + size.outputs + max(1, inputs))
    values += size.channels * 12 * size.storages
    if "state_space" in analysis.results:
        values += size.storages**2
    return file_kilobytes(20 + 25 * size.channels, values)
