"""The analysis of a bond graph: the requested results, returned as one `Result`.

Only the requested results are computed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dynid.arithmetic.ldl import reference
from dynid.bondgraph.analysis_request import ENGINES, RESULTS, Analysis, needed_parts
from dynid.bondgraph.field_expansion import field_warnings
from dynid.bondgraph.graph import Bond, BondGraph
from dynid.bondgraph.reduced_graph import ReducedGraph
from dynid.bondgraph.reduction.junctions import JunctionStructure
from dynid.bondgraph.reduction.solvability import hold
from dynid.bondgraph.results.channels import add_channels, note_measuring_integrals
from dynid.bondgraph.results.prototype_results import add_reductions
from dynid.bondgraph.results.response_results import (
    add_frequency_response,
    add_state_space,
    add_time_response,
    add_zero_input,
)
from dynid.errors import Singular
from dynid.model_scope import ScopePart, add_model_scope, divided, listed_names
from dynid.progress import report_progress
from dynid.result import Result

if TYPE_CHECKING:
    from dynid.bondgraph.cut_loops import CutLoops
    from dynid.bondgraph.sampled_loops import SampledLoops
    from dynid.lti.delay_system import DelaySystem


def analyse(graph: BondGraph, analysis: Analysis, title: str = "") -> Result:
    """Run an analysis of a bond graph.

    Arrays under `bond_graph/`, as far as they were asked for. Raises `Singular` where the graph has no
    solution, or an output is undetermined; it names the nodes. What causality says of an undetermined graph
    is returned, with a warning, where nothing else is asked for.
    """
    if analysis.reading == "binary":
        graph = graph.rounded()
    result = Result("bond-graph", title)
    nodes, bonds = analysis.size(graph)
    result.annotate(
        "bond_graph",
        nodes=nodes,
        bonds=bonds,
        inputs=listed_names(analysis.inputs),
        outputs=listed_names([str(port) for port in analysis.outputs]),
    )
    if analysis.approximations:
        texts = [approximation.why for approximation in analysis.approximations]
        result.add_axis("bond_graph/approximations", np.array(texts, dtype=object))
    warnings = [*field_warnings(graph), *_sampling_warnings(analysis)]
    if analysis.linearisation is not None:
        from dynid.bondgraph.results.operating_point import add_operating_point

        add_operating_point(result, analysis.linearisation)
        warnings = [*analysis.linearisation.point.warnings, *warnings]
    causality = None
    if "causality" in analysis.results:
        from dynid.bondgraph.results.causality import add_causality

        causality = add_causality(result, analysis.undelayed if analysis.late else graph)
    try:
        report_progress("reducing the graph")
        traced = bool(analysis.results & {"reduction", "prototype"}) and not analysis.late
        reduced = ReducedGraph(graph, analysis.inputs, analysis.outputs, traced=traced)
    except Singular:
        _cut_loops(analysis)  # says so where a loop is the cause
        if analysis.results != {"causality"}:
            raise
        open_parts = hold(JunctionStructure(graph), ())  # raises where the graph has no solution
        warnings += [undetermined.error.problem for undetermined in open_parts]
        result.add_axis("bond_graph/warnings", np.array(warnings, dtype=object))
        _add_graph_scope(result, None, None, analysis)
        return result
    warnings += reduced.undetermined
    if warnings:
        result.add_axis("bond_graph/warnings", np.array(warnings, dtype=object))
    if causality is not None and not analysis.in_time:
        from dynid.bondgraph.results.causality import add_zero_dynamics

        add_zero_dynamics(result, reduced, causality)
    _add_dynamics(result, reduced, analysis)
    if analysis.results & {"reduction", "prototype"}:
        add_reductions(result, reduced, analysis)
    if analysis.port is not None:
        _add_port(result, reduced, analysis, analysis.port)
    modelled = _add_responses(result, reduced, analysis)
    _add_graph_scope(result, reduced, modelled, analysis)
    if analysis.late and analysis.sampled_loops is None:
        from dynid.bondgraph.results.margin_results import with_delays

        return with_delays(result, analysis)
    return result


def _cut_loops(analysis: Analysis) -> CutLoops | None:
    """Return the loops of a graph, cut open; None without loops, or without a solution when all are cut."""
    if analysis.opened is None or analysis.sampled_loops is not None:
        return None
    from dynid.bondgraph.cut_loops import CutLoops

    try:
        cut = CutLoops(analysis.opened_as_read, analysis.loops)
    except Singular:
        return None
    cut.check()
    return cut


def _sampling_warnings(analysis: Analysis) -> list[str]:
    """Return what the samples of its loops hardly show."""
    if analysis.sampled_loops is None:
        return []
    from dynid.bondgraph.results.sampled_results import sampling_warnings

    return sampling_warnings(analysis.sampled_loops)


def _add_dynamics(result: Result, reduced: ReducedGraph, analysis: Analysis) -> None:
    """Add the channels, their sensitivities to the parameters, and the zero-input response."""
    asked = analysis.results
    if analysis.sampled_loops is not None:
        _add_sampled_dynamics(result, reduced, analysis.sampled_loops, analysis)
        return
    if analysis.feedback is not None:
        from dynid.bondgraph.state_feedback import add_feedback

        add_feedback(result, analysis.feedback, reduced.graph)
    cut = _cut_loops(analysis) if "properties" in asked else None
    if asked & {"transfer_function", "zeros", "poles", "properties", "hidden_modes"}:
        add_channels(result, reduced, analysis)
    if analysis.opened is not None and asked & {"properties", "hidden_modes"}:
        note_measuring_integrals(result, reduced, analysis)
    if cut is not None:
        from dynid.bondgraph.results.margin_results import add_margins

        report_progress("margins")
        add_margins(result, cut, analysis.omega)
    elif analysis.opened is not None and "properties" in asked:
        from dynid.bondgraph.results.channels import add_system, closed_verdict

        add_system(result, closed_verdict(reduced, delayed=analysis.late))
    _add_engineering(result, reduced, analysis)
    if "sensitivities" in asked:
        report_progress("sensitivities")
        from dynid.bondgraph.results.sensitivities import add_sensitivities

        add_sensitivities(result, reduced, analysis)
    if "transfer_function" in asked and analysis.initial:
        add_zero_input(result, reduced, analysis.initial)


def _add_sampled_dynamics(
    result: Result, reduced: ReducedGraph, loops: SampledLoops, analysis: Analysis
) -> None:
    """Add the verdict and margins of sampled loops, and the characteristics of step responses."""
    if "properties" in analysis.results:
        from dynid.bondgraph.results.sampled_results import add_sampled

        report_progress("margins")
        add_sampled(result, loops, analysis.omega)
    if "step_info" in analysis.results:
        from dynid.bondgraph.results.characteristics import add_characteristics
        from dynid.bondgraph.sampled_response import sampled_steps

        report_progress("step responses")
        steps = sampled_steps(loops, reduced.inputs, reduced.outputs)
        add_characteristics(result, reduced, frozenset({"step_info"}), steps)


def _add_engineering(result: Result, reduced: ReducedGraph, analysis: Analysis) -> None:
    """Add the characteristics of channels, the energy of modes and elements, and what sources give."""
    asked, graph = analysis.results, reduced.graph
    if asked & {"step_info", "bandwidth"}:
        from dynid.bondgraph.results.characteristics import add_characteristics

        steps = bandwidths = None
        if analysis.late:
            from dynid.bondgraph.results.delayed_channels import channel_bandwidths, channel_steps

            opened = analysis.opened_as_read
            if "step_info" in asked:
                steps = channel_steps(reduced, analysis, opened)
            if "bandwidth" in asked:
                bandwidths = channel_bandwidths(reduced, analysis, opened)
        add_characteristics(result, reduced, asked, steps, bandwidths)
    if asked & {"energy", "source_performance"}:
        from dynid.bondgraph.results.energy import add_energy, add_source_performance

        report_progress("energy")
        if "energy" in asked:
            add_energy(result, graph, analysis)
        if "source_performance" in asked and analysis.omega is not None:
            add_source_performance(result, graph, analysis.inputs, analysis.omega)


def _add_responses(result: Result, reduced: ReducedGraph, analysis: Analysis) -> ReducedGraph:
    """Add the state equations, and responses over frequency and time; return the graph of the states."""
    asked, late = analysis.results, analysis.late
    delayed: DelaySystem | None = None
    modelled = reduced
    outputs, stored = reduced.outputs, tuple(analysis.initial)
    if analysis.sampled_loops is not None and "time_response" in asked:
        from dynid.bondgraph.sampled_response import sampled_system

        delayed, modelled = sampled_system(analysis.sampled_loops, reduced.inputs, outputs, stored)
    elif late and asked & {"state_space", "time_response"}:
        from dynid.bondgraph.delayed_states import delay_system

        opened = analysis.opened_as_read
        delayed, modelled = delay_system(opened, analysis.loops, reduced.inputs, outputs, stored)
    if "state_space" in asked:
        report_progress("state equations")
        add_state_space(result, modelled, delayed.delays if delayed else ())
    if "frequency_response" in asked and analysis.omega is not None:
        report_progress("frequency response")
        evaluate = None
        if analysis.sampled_loops is not None:
            from dynid.bondgraph.sampled_response import sampled_response

            evaluate = sampled_response(analysis.sampled_loops, reduced.inputs, reduced.outputs)
        elif late:
            from dynid.bondgraph.delayed_response import delayed_response

            evaluate = delayed_response(
                analysis.opened_as_read, analysis.loops, reduced.inputs, reduced.outputs
            )
        add_frequency_response(result, reduced, analysis.omega, evaluate)
        if late:
            assert evaluate is not None
            from dynid.bondgraph.results.margin_results import add_phase

            delays = sum(float(reference(loop.delay)) for loop in analysis.loops)
            add_phase(result, "bond_graph/frequency_response", "response", evaluate, delays)
    if "time_response" in asked and analysis.times is not None:
        report_progress("time response")
        add_time_response(
            *(result, reduced, analysis.times, analysis.signals, analysis.initial),
            apart=analysis.apart,
            delayed=delayed,
            storages=len(modelled.storages),
        )
        if analysis.nonlinear:
            from dynid.bondgraph.results.operating_point import add_nonlinear_response

            report_progress("nonlinear time response")
            add_nonlinear_response(result, analysis)
    return modelled


def _add_port(result: Result, reduced: ReducedGraph, analysis: Analysis, port: Bond) -> None:
    from dynid.bondgraph.decomposition.equivalents import Decomposition
    from dynid.bondgraph.results.port import add_port, add_port_response, add_requested

    parts = Decomposition(reduced.graph, port, analysis.inputs, tuple(analysis.initial))
    add_port(result, parts, analysis.initial)
    add_requested(result, reduced)
    if "frequency_response" in analysis.results and analysis.omega is not None:
        add_port_response(result, parts, analysis.omega)


# --- scope of the model ----------------------------------------------------------------------------


def _add_graph_scope(
    result: Result, reduced: ReducedGraph | None, modelled: ReducedGraph | None, analysis: Analysis
) -> None:
    """Add the scope of the model: elements, storages, states, engines and results, used and left out."""
    parts = [*analysis.approximations]
    if reduced is not None and modelled is not None:
        parts += needed_parts(reduced, analysis)
        about = result.group_attrs.get("bond_graph/time_response", {})
        if "bond_graph/state_space/state" in result or ("states" in about and not analysis.late):
            states = str(about.get("states", "")).split(", ")
            if "bond_graph/state_space/state" in result:
                states = result["bond_graph/state_space/state"].data.tolist()
            states = [name for name in states if name]
            unneeded = set(modelled.storages).intersection(*map(modelled.dropped, modelled.outputs))
            dependent = max(0, len(modelled.storages) - len(unneeded) - len(states))
            reason = "storage elements in derivative causality"
            parts.append(ScopePart("states", states, dependent, reason))
    about = result.group_attrs["bond_graph"]
    used = {str(about["engine"])} if "engine" in about else set()
    if any(path.endswith("_error_bound") or "/sensitivities/" in path for path in result):
        used.add("exact")  # certified roots
    formulas = any("symbolic" in attributes for attributes in result.group_attrs.values())
    if formulas or any(path.endswith(("/program", "/symbolic_denominator")) for path in result):
        used.add("symbolic")
    why = "no result needs one"
    if "engine" in about:
        why = f"the {about['engine']} engine is used: {about['engine_reason']}"
    parts.append(divided("engines", ENGINES, used, why))
    listed: list[str] = [*RESULTS]
    if analysis.omitted is not None:
        parts.append(analysis.omitted)
        assert not isinstance(analysis.omitted.left_out, int)  # results have names
        listed = [name for name in RESULTS if name not in analysis.omitted.left_out]
    parts.append(divided("results", listed, analysis.results, "not requested"))
    add_model_scope(result, "bond_graph", parts)
