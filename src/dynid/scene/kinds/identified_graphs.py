"""Identifications of bond graphs: estimates from records or frequency responses, and results of the graph."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from dynid.bondgraph.graph import BondGraph
from dynid.identification.systems.delayed_loops import DelayedAnswer, cut_graph
from dynid.identification.systems.graph_system import IdentifiedGraph
from dynid.model_scope import ScopePart, add_model_scope, divided, scope_parts
from dynid.result import Result
from dynid.scene.kinds.bond_graph import graph_analysis
from dynid.scene.kinds.graph_parts import BuiltGraph, build_graph
from dynid.scene.kinds.measurements import experiments, frf_measurement, measurements_of
from dynid.scene.kinds.parameters import all_parameters, at_starts, estimator_of, further_of
from dynid.scene.kinds.scope import engines_part
from dynid.scene.load import Scene
from dynid.scene.schema.identification import IdentificationScene

if TYPE_CHECKING:
    from dynid.scene.run import PreparationStep


#: Parts of the scope of an analysis whose names those of the identification have.
_ANALYSIS = {"engines": "engines of the analysis"}


def identified_graph(scene: Scene[IdentificationScene]) -> tuple[IdentifiedGraph, BuiltGraph]:
    """Return the graph of an identification with its unknown parameters, and with the analysis' outputs.

    Raises `UsageError` if a number of a parameter does not fit its scale, or a matrix is not that of a
    passive field.
    """
    model = scene.model
    assert model.graph is not None
    analysis = model.graph_analysis
    records = model.measurement.each if model.measurement else []
    channels = [channel for record in records for channel in record.channels or ()]
    measured = [channel.output for channel in channels if channel.output is not None]
    asked = list(dict.fromkeys([*measured, *(analysis.outputs if analysis else ())]))
    reading = analysis.reading if analysis else "decimal"
    built = build_graph(scene, model.graph, asked, reading, control=model.control)
    variables = dict(zip(asked, built.outputs, strict=True))
    stored = {str(name): energy.e if energy.f is None else energy.f for name, energy in model.initial.items()}
    initial = {name: float(quantity or 0) for name, quantity in stored.items()}
    cut, delayed = built.graph, tuple[DelayedAnswer, ...]()
    if built.opened is not None and any(loop.delayed for loop in built.loops):
        cut, delayed = cut_graph(built.opened, built.loops)
    graph = IdentifiedGraph(cut, all_parameters(model), initial, variables, delayed)
    outputs = tuple(variables[output] for output in (analysis.outputs if analysis else ()))
    return graph, built._replace(outputs=outputs)


def started_graph(scene: Scene[IdentificationScene]) -> tuple[IdentifiedGraph, BuiltGraph]:
    """Return the graph that an estimator has: bases of structures are made at the starts, not at the truth.

    Raises as `identified_graph`.
    """
    model = scene.model
    assert model.graph is not None
    at_start = at_starts(model)
    constant = at_start is model or all(node.reduction is None for node in model.graph.nodes.values())
    return identified_graph(scene if constant else replace(scene, model=at_start))


def run_graph(scene: Scene[IdentificationScene]) -> Result:
    """Return the parameters of a bond graph identified from a record, and the requested results.

    The results of `analysis` are those of the graph as identified; without a measurement at the true values
    where these are given, else the starts. Raises `NotIdentifiable` or `Diverged` where the record does not
    determine the unknowns, or the estimator diverges. Raises `FileError` where measured data cannot be read.
    """
    model = scene.model
    result, parts = Result("identification", scene.title), list[ScopePart]()
    graph, built = (identified_graph if model.measurement is None else started_graph)(scene)
    values: dict[str, float] = {unknown.name: unknown.expected for unknown in graph.unknowns}
    if model.measurement is not None:
        result.merge(_identified(scene, graph))
        names = result["identification/parameters/name"].data
        values = dict(zip(names, result["identification/parameters/estimate"].data.tolist(), strict=True))
    if model.graph_analysis is not None:
        from dynid.bondgraph.analysis import analyse

        estimated_graph = with_values(built.graph, values)
        opened = None if built.opened is None else with_values(built.opened, values)
        loops = tuple(loop.at(values) for loop in built.loops)
        estimated = built._replace(graph=estimated_graph, opened=opened, loops=loops)
        request = graph_analysis(scene, model.graph_analysis, estimated)
        analysed = analyse(estimated_graph, request, scene.title)
        parts = scope_parts(analysed, "bond_graph")
        result.merge(analysed.without("bond_graph/need/"))
    _add_scope(result, model, graph, built, parts)
    return result


def with_values(graph: BondGraph, values: Mapping[str, float]) -> BondGraph:
    """Return a graph whose values are those at values of the parameters, which are exact from here on."""
    from fractions import Fraction

    nodes = [
        node
        if node.dependent is None
        else replace(node, value=Fraction(node.dependent.at(values).value), formula=None, dependent=None)
        for node in graph.nodes.values()
    ]
    return BondGraph(nodes, graph.bonds)


def graph_preparation_steps(scene: Scene[IdentificationScene]) -> Iterator[PreparationStep]:
    """Yield the steps of a run before any computation: build the graph and its records."""
    model = scene.model
    measurement = model.measurement
    yield lambda: identified_graph(scene)
    if measurement is not None and measurement.frf is not None:
        yield lambda: frf_measurement(scene, measurement, identified_graph(scene)[0])
    elif measurement is not None:
        yield lambda: experiments(scene, model.excitation, measurement, identified_graph(scene)[0])
    if (analysis := model.graph_analysis) is not None:
        yield lambda: graph_analysis(scene, analysis, identified_graph(scene)[1])


def _identified(scene: Scene[IdentificationScene], graph: IdentifiedGraph) -> Result:
    """Identify the parameters of a graph from records, simulated ones of the graph at the true values."""
    from dynid.identification.identify import identify

    model = scene.model
    measurements = measurements_of(scene, identified_graph(scene)[0])
    result = identify(graph, measurements, estimator_of(model), further=further_of(model))
    if model.identifiability:
        from dynid.identification.identifiability import identifiability

        result.merge(identifiability(graph, measurements))
    return result


def _add_scope(
    result: Result,
    model: IdentificationScene,
    graph: IdentifiedGraph,
    built: BuiltGraph,
    analysis: Sequence[ScopePart],
) -> None:
    measured = model.measurement is not None
    valued = [name for name, node in graph.graph.nodes.items() if node.value is not None]
    free = [name for name in valued if graph.graph.nodes[name].dependent is not None]
    parts = [
        divided("values", valued, free if measured else [], "known: fixed at their values"),
        engines_part(result, model),
        *built.approximations,
        *(
            scope_part._replace(name=_ANALYSIS.get(scope_part.name, scope_part.name))
            for scope_part in analysis
        ),
    ]
    add_model_scope(result, "identification", parts)
