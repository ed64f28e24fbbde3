"""Explanations of bond graphs and syntheses: causality, engine and forms."""

from __future__ import annotations

from dynid.bondgraph.analysis_request import NUMERIC, RESULTS, Analysis, choose_engine, needed_parts
from dynid.bondgraph.causality.report import join_nodes
from dynid.bondgraph.field_expansion import field_warnings
from dynid.bondgraph.graph import STORAGES
from dynid.bondgraph.reduced_graph import ReducedGraph
from dynid.bondgraph.reduction.junctions import JunctionStructure
from dynid.bondgraph.reduction.solvability import hold
from dynid.bondgraph.results.causality import add_causality
from dynid.bondgraph.synthesis.forms import kind_of, realisations
from dynid.errors import NumericalError
from dynid.number_format import counted
from dynid.progress import report_progress
from dynid.result import Result
from dynid.scene.explanation import Explanation, Fact
from dynid.scene.kinds.bond_graph import question, unused_grids, without_unasked
from dynid.scene.kinds.synthesis import driving_function
from dynid.scene.kinds.time_scales import graph_time_scales
from dynid.scene.load import Scene
from dynid.scene.schema.bond_graph import BondGraphScene
from dynid.scene.schema.synthesis import SynthesisScene


def explain(scene: Scene) -> Explanation:
    """Return the explanation of a scene of kind `bond-graph`: its graph is reduced, without numbers."""
    graph, analysis = question(scene)
    analysis = without_unasked(scene, graph, analysis)
    if analysis.reading == "binary":
        graph = graph.rounded()
    result = Result("bond-graph", scene.title)
    report_progress("assigning causality")
    prompt = analysis.undelayed if analysis.late else graph
    lines = dict.fromkeys(loop.line for loop in analysis.loops if loop.line)
    causality = add_causality(Result("bond-graph") if lines else result, prompt)
    nodes, bonds = analysis.size(graph)
    facts = [Fact("graph", f"{counted(nodes, 'node')}, {counted(bonds, 'bond')}")]
    report_progress("reducing the graph")
    try:
        reduced = ReducedGraph(graph, analysis.inputs, analysis.outputs, traced=False)
    except NumericalError as error:
        if analysis.results != {"causality"}:
            return Explanation(result, facts, obstacle=error)
        try:  # causality needs no unique solution
            undetermined = hold(JunctionStructure(graph), ())
        except NumericalError as unsolvable:
            return Explanation(result, facts, obstacle=unsolvable)
        facts += [Fact("warning", variable.error.problem) for variable in undetermined]
        return Explanation(result, facts)
    names = needed_parts(reduced, analysis)[0].left_out
    assert not isinstance(names, int)  # elements have names
    if names:
        facts.append(Fact("left out", f"{join_nodes(names)}: no output depends on them"))
    else:
        facts = [facts[0]._replace(text=f"{facts[0].text}, all affect an output")]
    storages = sum(node.type in STORAGES for node in prompt.nodes.values())
    order = f"{counted(causality.order, 'state')}, {counted(storages, 'storage element')}"
    if delays := sum(loop.delayed for loop in analysis.loops):
        order += f", {counted(delays, 'delay')}"
    if lines:
        order += f" (two of each line: {join_nodes([*lines])})"
    facts.append(Fact("order", order))
    facts += [Fact("warning", sentence) for sentence in (*field_warnings(graph), *reduced.undetermined)]
    if not analysis.late:  # the poles of approximants are none of the graph
        report_progress("comparing time scales")
        facts += graph_time_scales(reduced)
    outputs, inputs = (join_nodes([*map(str, names)]) for names in (reduced.outputs, reduced.inputs))
    facts.append(Fact("channels", f"{outputs} from {inputs or 'no input'}"))
    sampled = any(loop.sampling is not None for loop in analysis.loops)
    if analysis.results & {"transfer_function", *NUMERIC} and not sampled:
        choice = choose_engine(reduced, analysis)
        why = "with Padé approximants in what is a rational function" if analysis.late else choice.reason
        facts.append(Fact("engine", f"{choice.engine}: {why}"))
        if choice.engine != "exact":
            facts.append(Fact("", choice.limits))
    facts += _results(scene, analysis)
    if analysis.port is not None:
        text = f"cut at {analysis.port}: equivalents of both sides, prototype, performance"
        facts.append(Fact("port", text))
    return Explanation(result, facts)


def _results(scene: Scene[BondGraphScene], analysis: Analysis) -> list[Fact]:
    """Return the results that are computed, with the sizes of the grids that they need, and the others."""
    names = ([name for name in RESULTS if (name in analysis.results) == here] for here in (True, False))
    asked, others = (", ".join(group).replace("_", " ") for group in names)
    model = scene.model
    unused = unused_grids(model, model.analysis)
    grids = []
    if analysis.omega is not None and "frequency" not in unused:
        grids.append(counted(len(analysis.omega), "frequency"))
    if analysis.times is not None and "time" not in unused:
        grids.append(counted(len(analysis.times), "sample"))
    facts = [Fact("computes", asked)]
    if analysis.omitted is not None:
        facts.append(Fact("", analysis.omitted.why))
    if grids:
        facts.append(Fact("", f"at {' and '.join(grids)}"))
    return [*facts, Fact("not requested", others)] if others else facts


def explain_synthesis(scene: Scene[SynthesisScene]) -> Explanation:
    """Return the explanation of a scene of kind `synthesis`, whose forms are made: that takes no time."""
    model = scene.model
    function = driving_function(scene)
    what = "admittance" if function.admittance else "impedance"
    degree = max(function.numerator.degree(), function.denominator.degree())
    facts = [Fact("function", f"a positive real {what} of degree {degree}: {kind_of(*function.impedance)}")]
    circuits, missing = realisations(function, None if model.forms is None else tuple(model.forms))
    for index, circuit in enumerate(circuits):
        graph = circuit.graph
        size = f"{counted(len(graph.nodes), 'node')}, {counted(len(graph.bonds), 'bond')}"
        facts.append(Fact("forms" if index == 0 else "", f"{circuit.form}: {size}"))
    facts += [Fact("", f"no {form}: {why}") for form, why in missing.items()]
    return Explanation(Result("synthesis", scene.title), facts)
