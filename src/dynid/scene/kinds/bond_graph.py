"""Run a scene of kind `bond-graph`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from fractions import Fraction
from functools import partial
from typing import TYPE_CHECKING, Any, cast

from dynid.arithmetic.dependent import Dual
from dynid.bondgraph.analysis_request import (
    USUAL,
    Analysis,
    FormulaRequest,
    SensitivityParameter,
    available_results,
)
from dynid.bondgraph.graph import FIELDS, SOURCES, STORAGES, BondGraph, GraphUnits
from dynid.defaults import TRACED_LOOPS, TRACED_PARTS, UNASKED_RESULTS, Limit
from dynid.errors import Fault, NumericalError, Singular, UsageError
from dynid.model_scope import ScopePart, wants_scope
from dynid.result import Result
from dynid.scene.kinds.graph_parts import BuiltGraph, build_graph, has_law, with_gains
from dynid.scene.kinds.parameters import quantities
from dynid.scene.kinds.signals import DrivenSource, angular_frequencies, build_signals, record_of
from dynid.scene.load import Scene
from dynid.scene.schema.base import DefinedParameter
from dynid.scene.schema.bond_graph import AnalysisModel, BondGraphScene, GraphModel
from dynid.scene.schema.quantities import Quantity
from dynid.scene.schema.signals import SignalPart, StepSignal
from dynid.scene.yaml.parser import Path as KeyPath
from dynid.suggestions import shortened

if TYPE_CHECKING:
    from dynid.lti.generator import Signal
    from dynid.scene.run import PreparationStep
    from dynid.scene.schema.control import ControlModel
    from dynid.scene.schema.identification import IdentificationScene


#: Groups under `bond_graph/` that hold the arrays of the results of an analysis.
_GROUPS: Mapping[str, tuple[str, ...]] = {
    "causality": ("causality",),
    "reduction": ("reduction",),
    "prototype": ("reduction",),
    "transfer_function": ("transfer_function", "zero_input"),
    # The engine is chosen by whether roots are asked for.
    **dict.fromkeys(("zeros", "poles"), ("transfer_function", "properties", "margins", "system")),
    "properties": ("properties", "margins", "system", "root_locus"),
    "hidden_modes": ("properties",),
    "step_info": ("properties",),
    "bandwidth": ("properties",),
    "sensitivities": ("sensitivities", "sensitivity_functions"),
    "state_space": ("state_space",),
    "frequency_response": ("frequency_response", "port"),
    "time_response": ("time_response", "operating_point"),
    "energy": ("energy",),
    "source_performance": ("source_performance",),
}


def run(scene: Scene[BondGraphScene], sample: Result | None = None) -> Result:
    """Return the requested results of a bond graph; those of a design are of the designed graph.

    Of the `sample` of a study only what it wants is computed. Raises `Singular` where the graph has no unique
    solution. Raises `Unreachable` where the targets of a design cannot be reached.
    """
    from dynid.bondgraph.analysis import analyse

    if scene.model.design is None:
        graph, analysis = question(scene)
        if sample is None:
            analysis = without_unasked(scene, graph, analysis)
        elif not wants_scope(sample, "bond_graph"):
            analysis = replace(
                analysis,
                results=frozenset(
                    name
                    for name in analysis.results
                    if any(sample.wants_below(f"bond_graph/{group}") for group in _GROUPS[name])
                ),
            )
        return analyse(graph, analysis, scene.title)
    from dynid.bondgraph.design.solve import solve
    from dynid.bondgraph.results.design_results import add_design
    from dynid.scene.kinds.design import design_of, designed_scene

    designed = solve(design_of(scene))
    graph, analysis = question(designed_scene(scene, designed.values))
    result = analyse(graph, analysis, scene.title)
    add_design(result, designed, analysis.omega)
    return result


def without_unasked(scene: Scene[BondGraphScene], graph: BondGraph, analysis: Analysis) -> Analysis:
    """Return the analysis of a large graph without default results that cost far more than what is asked.

    Those beside responses grow faster than these with the graph, and the formulas of a reduction with its
    loops. Results that an expectation names are kept.
    """
    model = scene.model
    if model.analysis.results is not None:
        return analysis
    storages = sum(node.type in STORAGES for node in graph.nodes.values())
    loops = len(graph.bonds) - len(graph.nodes) + 1
    limit: Limit[int] | None = None
    unasked: frozenset[str] = frozenset()
    responses = analysis.results & {"frequency_response", "time_response"}
    if storages > UNASKED_RESULTS.value and model.control is None and responses:
        limit, unasked = UNASKED_RESULTS, USUAL
    elif loops > TRACED_LOOPS.value:
        limit, unasked = TRACED_LOOPS, frozenset({"reduction"})
    expected = {
        name
        for name in unasked
        for group in _GROUPS[name]
        if any(f"{expectation.path}/".startswith(f"bond_graph/{group}/") for expectation in model.expect)
    }
    left_out = sorted(unasked & analysis.results - expected)
    if not left_out:
        return analysis
    why = f"{limit}; list them in 'analysis.results'"
    omitted = ScopePart("default results", sorted(USUAL & analysis.results - {*left_out}), left_out, why)
    return replace(analysis, results=analysis.results - {*left_out}, omitted=omitted)


def check_valid(scene: Scene[BondGraphScene]) -> None:
    """Check the design of a valid scene, if it has one; raises `SceneError` with its faults."""
    if scene.model.design is not None:
        from dynid.scene.kinds.design import check_design

        check_design(scene)


#: Random starts of the search for equilibria that a check makes, as many as are the default; a run makes all.
_CHECKED_STARTS = 16


def preparation_steps(scene: Scene) -> Iterator[PreparationStep]:
    """Yield the steps of a run before any computation: build the graph, test its sources, cut its port."""
    checked = with_few_starts(scene)
    for step in _preparation_steps(checked):
        yield step if checked is scene else partial(_unless_undecided, step)


def _preparation_steps(scene: Scene[BondGraphScene]) -> Iterator[PreparationStep]:
    model = scene.model
    yield lambda: question(scene)
    yield lambda: _check_sources(scene)
    if model.design is not None:
        from dynid.scene.kinds.design import design_of

        yield lambda: design_of(scene)
    if (port := model.analysis.port) is not None:
        from dynid.bondgraph.decomposition.graph_bisection import GraphBisection

        yield lambda: GraphBisection.at(built_graph(scene).graph, port)


def with_few_starts(scene: Scene[BondGraphScene]) -> Scene:
    """Return a scene whose search for equilibria has a bounded number of starts, for a check."""
    model = scene.model
    point = model.operating_point
    if point is None or point.search.starts <= _CHECKED_STARTS:
        return scene
    search = point.search.model_copy(update={"starts": _CHECKED_STARTS})
    point = point.model_copy(update={"search": search})
    return replace(scene, model=model.model_copy(update={"operating_point": point}))


def _unless_undecided(step: PreparationStep) -> None:
    """Take a step; an equilibrium that the few starts of a check miss is left to the run."""
    try:
        step()
    except NumericalError as error:
        if not any(name.startswith("operating_point") for name in error.names):
            raise


def _check_sources(scene: Scene[BondGraphScene]) -> None:
    """Raise where sources contradict each other, so that the graph has no solution."""
    from dynid.bondgraph.reduction.junctions import JunctionStructure
    from dynid.bondgraph.reduction.solvability import hold

    built, analysis = built_graph(scene), scene.model.analysis
    graph = built.graph
    if built.opened is not None:  # a loop may be algebraic, without a solution
        from dynid.bondgraph.cut_loops import CutLoops

        cut = None
        with suppress(Singular):  # what is wrong without loops is reported below
            cut = CutLoops(built.opened, built.loops)
        if cut is not None:
            cut.check()
    outputs = () if analysis.asked() == {"causality"} else built.outputs  # causality needs no output's value
    hold(JunctionStructure(graph.rounded() if analysis.reading == "binary" else graph), outputs)


#: The results that are computed at the frequencies, and at the instants, of an analysis.
_AT_FREQUENCIES = frozenset({"frequency_response", "source_performance", "energy"})
_AT_INSTANTS = frozenset({"time_response"})


def unused_grids(model: BondGraphScene | IdentificationScene, analysis: AnalysisModel) -> list[str]:
    """Return the blocks of an analysis of a graph, frequency and time, with which nothing is computed."""
    asked, graph = analysis.asked(), cast("GraphModel", model.graph)
    banded = any(node.structure is not None for node in graph.nodes.values())  # reduced for the band
    derived = getattr(model, "derived", None) or ()
    needs_frequencies = getattr(model, "design", None) is not None or "frequency_response" in derived
    margins = model.control is not None and "properties" in asked
    used = {
        "frequency": bool(asked & _AT_FREQUENCIES) or banded or margins or needs_frequencies,
        "time": bool(asked & _AT_INSTANTS),
    }
    return [name for name, by in used.items() if getattr(analysis, name) is not None and not by]


def doubts(scene: Scene) -> Iterator[Fault]:
    """Yield negative values, and unused blocks of an analysis."""
    model = scene.model
    negative = {
        name: (node.type, float(node.value))
        for name, node in model.graph.nodes.items()
        if node.type in FIELDS and node.value is not None and not node.value.variable and node.value.value < 0
    }
    if negative:
        shown = shortened([f"{kind} '{name}' ({value:g})" for name, (kind, value) in negative.items()], 3)
        has = "has a negative value" if len(negative) == 1 else "have negative values"
        yield scene.source.fault(
            ("graph", "nodes", next(iter(negative)), "value"),
            f"not passive: {shown} {has} and can give energy without end",
        )
    for name in unused_grids(model, model.analysis):
        message = (
            f"nothing is computed with the block '{name}': 'results' does not list '{name}_response'; "
            f"add it, or leave the block out"
        )
        yield scene.source.fault(("analysis", name), message, key=True)
    results = model.analysis.results or ()
    if model.control is not None and model.control.delays and "hidden_modes" in results:
        message = (
            "hidden modes are not listed of a graph with delays in loops; its poles ('poles') and verdict "
            "('stable') include them"
        )
        yield scene.source.fault(("analysis", "results", results.index("hidden_modes")), message)


def unread_files(scene: Scene[BondGraphScene]) -> Iterator[KeyPath]:
    """Yield the keys whose files a run does not read: the signals of a response that is not computed."""
    if "time_response" not in scene.model.analysis.asked():
        yield ("analysis", "time")


def question(scene: Scene[BondGraphScene]) -> tuple[BondGraph, Analysis]:
    """Return the graph of a scene, and the request of its analysis."""
    model = scene.model
    linearised = model.operating_point is not None or any(map(has_law, model.graph.nodes.values()))
    if "sensitivities" not in model.analysis.asked() or linearised:  # those are by slopes
        built = built_graph(scene)
        return built.graph, graph_analysis(scene, model.analysis, built)
    from dynid.arithmetic.dependent import independent_parameters

    duals = independent_parameters(
        {
            name: entry.reference.value if isinstance(entry, DefinedParameter) else entry
            for name, entry in model.parameters.items()
        }
    )
    values = {name: dual.value for name, dual in duals.items()}
    built = built_graph(scene, with_gains(model.control, values) if model.control else None)
    variables = _parameters(model, built.graph, duals)
    nodes = [replace(node, dependent=None) for node in built.graph.nodes.values()]
    graph = BondGraph(nodes, built.graph.bonds)
    return graph, graph_analysis(scene, model.analysis, built._replace(graph=graph), variables)


def graph_analysis(
    scene: Scene,
    requested: AnalysisModel,
    built: BuiltGraph,
    variables: tuple[SensitivityParameter, ...] | None = None,
) -> Analysis:
    """Return the request of an analysis of a graph.

    Sensitivities are by `variables`; default: the values of the nodes.
    """
    model, graph = scene.model, built.graph
    flat = built.linearisation.flat if built.linearisation is not None else ()
    for name in model.initial:
        if name in flat:
            raise UsageError(
                f"the law of '{name}' has the slope zero at the operating point: it stores nothing there",
                remedy="Leave its stored energy out, or choose another operating point.",
                names=(f"initial.{name}", name),
            )
    graph_sources = (name for name, node in graph.nodes.items() if node.type in SOURCES)
    inputs = tuple(requested.inputs or graph_sources)
    asked, parts_count = requested.asked(), sum(bool(node.part) for node in graph.nodes.values())
    if requested.results is None and parts_count > TRACED_PARTS.value:
        asked -= {"reduction"}  # formulas of that many nodes are long, and nobody reads them
    sampled = model.control is not None and model.control.sampled
    multirate = model.control is not None and model.control.multirate
    lines = any(loop.line for loop in built.loops)
    asked &= available_results(sampled=sampled, lines=lines, multirate=multirate)
    signals: list[tuple[str, Signal]] = []
    apart = False
    if "time_response" in asked:
        assert requested.time is not None
        # Without any signal: the free response where there is stored energy, else those to a unit step of
        # each source; several are apart, as of sources in different units a sum has no meaning.
        apart = not (requested.time.input or model.initial) and len(inputs) > 1
        parts = list(requested.time.input) or ([] if model.initial else [StepSignal(kind="step")])
        units = GraphUnits(graph)

        def sources(signal_model: SignalPart) -> Sequence[str]:
            return inputs if signal_model.source is None else [signal_model.source]

        def driven(signal_model: SignalPart) -> DrivenSource:
            units_of_sources = {units.of_input(name) for name in sources(signal_model)}
            unit = units_of_sources.pop() if len(units_of_sources) == 1 else ""
            return DrivenSource(signal_model.source or "the input", unit)

        record = record_of(requested.time)
        for signal_model, signal in build_signals(scene, "analysis.time.input", parts, record, driven):
            signals += [(name, signal) for name in sources(signal_model)]
    if variables is None and "sensitivities" in asked:
        variables = tuple(
            SensitivityParameter(name, node.value, {name: Fraction(1)})
            for name, node in graph.nodes.items()
            if node.part != "control" and node.value is not None
        )
    return Analysis(
        inputs=inputs,
        outputs=built.outputs,
        results=asked,
        omega=angular_frequencies(requested.frequency) if requested.frequency else None,
        times=record_of(requested.time).times if requested.time else None,
        signals=tuple(signals),
        apart=apart,
        initial={name: (energy.f or energy.e or Quantity(0)).exact for name, energy in model.initial.items()},
        port=requested.port,
        parameters=variables,
        engine=requested.engine,
        reading=requested.reading,
        formulas=FormulaRequest(requested.symbolic.form, requested.symbolic.terms)
        if requested.symbolic
        else None,
        approximations=built.approximations,
        opened=built.opened,
        loops=built.loops,
        linearisation=built.linearisation,
        law_outputs=built.law_outputs,
        law_loops=built.law_loops,
        feedback=built.feedback,
    )


def built_graph(scene: Scene[BondGraphScene], control: ControlModel | None = None) -> BuiltGraph:
    """Build the graph of a scene, with exact values, its fields and structures expanded.

    `control` is its feedback where it is not taken as written.
    """
    model, analysis = scene.model, scene.model.analysis
    band = float(angular_frequencies(analysis.frequency)[-1]) if analysis.frequency else None
    feedback = control or model.control
    point = model.operating_point
    return build_graph(scene, model.graph, analysis.outputs, analysis.reading, band, feedback, point)


def _parameters(
    model: BondGraphScene, graph: BondGraph, known: dict[str, Dual]
) -> tuple[SensitivityParameter, ...]:
    """Return the variables of the sensitivities: parameters, and values written as numbers."""
    from dynid.arithmetic.dependent import differentiate
    from dynid.arithmetic.numbers import to_fraction

    rates: dict[str, dict[str, Fraction]] = {name: {} for name, dual in known.items() if name in dual.slopes}
    numbers = []
    for name, node in model.graph.nodes.items():
        inside = set().union(*map(named_in, (node.matrix, node.structure, node.joints)))
        if inside:
            raise UsageError(
                f"sensitivities are by single values, but '{name}' depends on {', '.join(sorted(inside))}",
                remedy="Write its numbers without parameters, or leave the result 'sensitivities' out.",
                names=(name,),
            )
        if node.value is None:
            continue
        if node.value.expression is None or not node.value.expression.names:
            numbers.append(SensitivityParameter(name, node.value.exact, {name: Fraction(1)}))
            continue
        for parameter, slope in differentiate(node.value.expression, known).slopes.items():
            rates[parameter][name] = to_fraction(slope)
    written: dict[str, dict[str, Fraction]] = {}
    values: dict[str, Fraction] = {}
    for name, made in graph.nodes.items():
        if made.dependent is None:
            continue
        values |= {one: to_fraction(value) for one, value in made.dependent.references.items()}
        for parameter, slope in made.dependent.dual({}).slopes.items():
            if parameter not in known:
                written.setdefault(parameter, {})[name] = to_fraction(slope)
                continue
            for independent, rate in known[parameter].slopes.items():
                own = rates[independent]
                own[name] = own.get(name, Fraction(0)) + to_fraction(slope) * to_fraction(rate)
    numbers += [SensitivityParameter(name, values[name], found) for name, found in written.items()]
    named = [SensitivityParameter(name, to_fraction(known[name].value), by) for name, by in rates.items()]
    return (*named, *numbers)


def named_in(section: Any) -> set[str]:
    """Return the names in the quantities of a part of a scene at any depth."""
    expressions = (quantity.expression for _, quantity in quantities(section))
    return {name for expression in expressions if expression is not None for name in expression.names}
