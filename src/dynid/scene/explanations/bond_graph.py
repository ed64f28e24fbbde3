"""Explanations of bond graphs and syntheses: causality, engine, forms, and cost."""

from __future__ import annotations

import time
from typing import cast

from dynid.bondgraph.causality.report import join_nodes
from dynid.bondgraph.fields import field_warnings
from dynid.bondgraph.graph import STORAGES
from dynid.bondgraph.plan import ReducedGraph
from dynid.bondgraph.reduction.junctions import JunctionStructure
from dynid.bondgraph.reduction.solvability import hold
from dynid.bondgraph.request import NUMERIC, RESULTS, Analysis, EngineChoice, choose_engine, modelled_storages
from dynid.bondgraph.results.causality import add_causality
from dynid.bondgraph.synthesis.forms import kind_of, realisations
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
from dynid.scene.kinds.bond_graph import question, unused_grids
from dynid.scene.kinds.synthesis import wanted
from dynid.scene.load import Scene
from dynid.scene.schema.bond_graph import BondGraphScene
from dynid.scene.schema.synthesis import SynthesisScene


def explain(scene: Scene) -> Explanation:
    """Return the explanation of a scene of kind `bond-graph`: its graph is reduced, without numbers."""
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
        try:  # causality needs no unique solution
            undetermined = hold(JunctionStructure(graph), ())
        except NumericalError as unsolvable:
            return Explanation(result, facts, obstacle=unsolvable)
        facts += [Fact("warning", part.error.problem) for part in undetermined]
        return Explanation(result, facts)
    seconds = time.thread_time() - began
    unneeded = set.intersection(*(set(reduced.dropped(port)) for port in reduced.outputs))
    names = [name for name in reduced.graph.nodes if name in unneeded]
    if names:
        facts.append(Fact("left out", f"{join_nodes(names)}: no output depends on them"))
    else:
        facts = [facts[0]._replace(text=f"{facts[0].text}, all affect an output")]
    storages = sum(node.type in STORAGES for node in graph.nodes.values())
    order = f"{counted(causality.order, 'state')}, {counted(storages, 'storage element')}"
    facts.append(Fact("order", order))
    facts += [Fact("warning", sentence) for sentence in (*field_warnings(graph), *reduced.undetermined)]
    outputs, inputs = (
        join_nodes([str(name) for name in names]) for names in (reduced.outputs, reduced.inputs)
    )
    facts.append(Fact("channels", f"{outputs} from {inputs or 'no input'}"))
    choice = choose_engine(reduced, analysis) if analysis.results & {"transfer_function", *NUMERIC} else None
    if choice is not None:
        facts.append(Fact("engine", f"{choice.engine}: {choice.reason}"))
        if choice.engine != "exact":
            facts.append(Fact("", choice.limits))
    facts += _results(scene, analysis)
    if analysis.port is not None:
        facts.append(
            Fact("port", f"cut at {analysis.port}: equivalents of both sides, prototype, performance")
        )
    return Explanation(result, facts, _cost(reduced, analysis, choice, seconds))


def _results(scene: Scene, analysis: Analysis) -> list[Fact]:
    """Return the results that are computed, with the sizes of the grids that they need, and the others."""
    asked, others = (
        ", ".join(name for name in RESULTS if (name in analysis.results) == here).replace("_", " ")
        for here in (True, False)
    )
    model = cast("BondGraphScene", scene.model)
    unused = unused_grids(model, model.analysis)
    grids = []
    if analysis.omega is not None and "frequency" not in unused:
        grids.append(counted(len(analysis.omega), "frequency"))
    if analysis.times is not None and "time" not in unused:
        grids.append(counted(len(analysis.times), "sample"))
    facts = [Fact("computes", asked)]
    if grids:
        facts.append(Fact("", f"at {' and '.join(grids)}"))
    return [*facts, Fact("not requested", others)] if others else facts


def analysis_cost(reduced: ReducedGraph, analysis: Analysis, seconds: float) -> CostEstimate:
    """Return the cost of the results of a graph, which was reduced in so many seconds."""
    asked = analysis.results & {"transfer_function", *NUMERIC}
    return _cost(reduced, analysis, choose_engine(reduced, analysis) if asked else None, seconds)


def _cost(
    reduced: ReducedGraph, analysis: Analysis, choice: EngineChoice | None, seconds: float
) -> CostEstimate:
    """Return the cost of the results; rates are those of the machine of `speed`."""
    storages, outputs = modelled_storages(reduced), len(reduced.outputs)
    channels, operations = len(reduced.channels()), len(reduced.program)
    frequencies = 0 if analysis.omega is None else len(analysis.omega)
    instants = 0 if analysis.times is None else len(analysis.times)
    parts = {"reducing the graph": seconds}
    if choice is not None:
        # Roots grow with the cube of the degree, polynomials with its square.
        n, times = float(storages), (channels + outputs) / 2
        roots, structure = bool(analysis.results & NUMERIC), reduced.structure
        loops = len(structure.couplings) - len(structure.junctions) + 1
        if choice.engine == "symbolic":
            work = 1e-3 * n
        elif choice.engine == "float":
            work = times * (6e-4 * n + 3.5e-8 * n**3)
        else:
            if loops > MANY_LOOPS.value:  # coefficients are longer there: so much that the limits differ
                n *= EXACT_ROOTS.value / EXACT_ROOTS_ON_LOOPS.value
            work = times * (3e-4 * n + (5e-8 * n**3 if roots else 1e-6 * n**2))
        parts["zeros, poles and polynomials" if roots else "polynomials"] = work / speed()
    response = operations * (8e-6 + 3e-8 * frequencies)
    if operations > COMPILED_RESPONSES.value:  # compiled, in doubled precision
        response = 0.4 + 1e-8 * operations * frequencies
    rates = {
        "sensitivities": channels * 1.2e-4 * storages**2.65,
        "reduction": outputs * 3e-4 * storages,
        "prototype": outputs * 3e-4 * storages,
        "state_space": 6e-4 * storages,
        "frequency_response": response,
        "time_response": 3e-3 + 3.5e-5 * storages**2 + instants * (1e-6 + 1e-9 * storages**2),
        "causality": 1e-3 * storages,
    }
    parts |= {name.replace("_", " "): rates[name] / speed() for name in rates if name in analysis.results}
    values = 60.0 * frequencies + 2.0 * instants * (outputs + 1)
    if analysis.results & {"time_response", "state_space"}:
        values += 8.0 * storages**2
    megabytes = peak_megabytes() + 8e-6 * values
    values = float(frequencies * (1 + 2 * channels))
    values += instants * (1 + outputs + max(1, len(reduced.inputs)))
    values += channels * 12 * storages
    if "state_space" in analysis.results:
        values += storages**2
    return CostEstimate(parts, megabytes, file_kilobytes(20 + 25 * channels, values))


def explain_synthesis(scene: Scene) -> Explanation:
    """Return the explanation of a scene of kind `synthesis`, whose forms are made: that takes no time."""
    model = cast("SynthesisScene", scene.model)
    began = time.thread_time()
    function = wanted(scene)
    what = "admittance" if function.admittance else "impedance"
    degree = max(function.numerator.degree(), function.denominator.degree())
    facts = [Fact("function", f"a positive real {what} of degree {degree}: {kind_of(*function.impedance)}")]
    found, missing = realisations(function, None if model.forms is None else tuple(model.forms))
    for place, one in enumerate(found):
        text = f"{one.form}: {counted(len(one.graph.nodes), 'node')}, {counted(len(one.graph.bonds), 'bond')}"
        facts.append(Fact("forms" if place == 0 else "", text))
    facts += [Fact("", f"no {form}: {why}") for form, why in missing.items()]
    parts = {"synthesis": time.thread_time() - began}
    values = sum(3 * len(one.graph.nodes) for one in found)
    kilobytes = file_kilobytes(8 + 14 * len(found), values)
    return Explanation(
        Result("synthesis", scene.title), facts, CostEstimate(parts, peak_megabytes(), kilobytes)
    )
