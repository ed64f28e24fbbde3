"""Explanation of an identification: model, record, identifiability and estimator."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from dynid.arrays import guarded
from dynid.defaults import ESTIMATOR, FILTER_PASSES, HUBER
from dynid.errors import NumericalError, UsageError
from dynid.identification.identifiability import ExpectedRecords
from dynid.identification.likelihood.likelihood import Likelihood
from dynid.number_format import counted
from dynid.progress import report_progress
from dynid.result import Result
from dynid.scene.explanation import Explanation, Fact, node_facts
from dynid.scene.kinds.identification import expected_values, interest_of, reductor_of
from dynid.scene.kinds.identified_graphs import identified_graph
from dynid.scene.kinds.parts import structure_of
from dynid.scene.kinds.planning import prospect
from dynid.scene.kinds.signals import angular_frequencies, record_of
from dynid.scene.kinds.time_scales import graph_time_scales, structure_time_scales
from dynid.scene.load import Scene
from dynid.scene.schema.identification import EstimatorModel, IdentificationScene, ResponseModel
from dynid.scene.schema.raw import unit_of_frequencies
from dynid.structure.model import StructuralModel

if TYPE_CHECKING:
    from dynid.structure.reduction.reduced_model import StructuralReduction

#: Most states of a graph that are named.
_STATES = 12


def explain(scene: Scene[IdentificationScene]) -> Explanation:
    """Return the explanation of a scene of kind `identification`, whose record is predicted once."""
    model = scene.model
    if model.graph is not None:
        return _explain_graph(scene)
    structure = structure_of(scene)
    result = Result("identification", scene.title)
    facts: list[Fact] = []
    try:
        method, reduction = reductor_of(scene), None
        if method is not None:
            report_progress("making the basis")
            reduction = method.at(expected_values(structure)).reduce(structure)
        facts += _of_model(structure, reduction, model.reduction_method)
        facts += [*node_facts(structure), *structure_time_scales(structure, expected_values(structure))]
        if model.measurement is not None:
            _add_record(scene, result, facts, [unknown.name for unknown in structure.unknowns])
        if model.structure_analysis is not None:
            facts.append(Fact("responses", _responses(model.structure_analysis)))
        if model.responses is not None:
            asked = model.responses.harmonic_balance
            span = f"{float(asked.start):g} … {float(asked.stop):g} {asked.unit}"
            facts.append(Fact("steady states", f"harmonic balance, {span}, force at {asked.dof}"))
    except (NumericalError, UsageError) as error:
        return Explanation(result, facts, obstacle=error)
    return Explanation(result, facts)


def _explain_graph(scene: Scene[IdentificationScene]) -> Explanation:
    model = scene.model
    result = Result("identification", scene.title)
    facts: list[Fact] = []
    try:
        graph, built = identified_graph(scene)
        nodes = graph.graph.nodes.values()
        valued = [node for node in nodes if node.value is not None]
        size = f"{counted(len(graph.graph.nodes), 'node')}, {counted(len(graph.graph.bonds), 'bond')}"
        free = sum(node.dependent is not None for node in valued)
        unknowns = counted(len(graph.unknowns), "unknown")
        dependence = f"{free} of {counted(len(valued), 'value')} depend on {unknowns}"
        facts.append(Fact("graph", f"{size}; {dependence}"))
        facts += [Fact("", approximation.why) for approximation in built.approximations]
        if model.measurement is not None:
            likelihood = _add_record(scene, result, facts, [unknown.name for unknown in graph.unknowns])
            if model.measurement.frf is None:
                states = likelihood.records[0].model.states
                shown = [state.name for state in likelihood.records[0].system_model.states]
                more = ", …" if len(shown) > _STATES else ""
                order = f"{counted(states, 'state')}: {', '.join(shown[:_STATES])}{more}"
                facts.insert(1, Fact("model", order))
        if model.graph_analysis is not None:
            from dynid.bondgraph.reduced_graph import ReducedGraph
            from dynid.scene.kinds.bond_graph import graph_analysis

            analysis = graph_analysis(scene, model.graph_analysis, built)
            facts.append(Fact("analysis", ", ".join(sorted(analysis.results)).replace("_", " ")))
            facts += graph_time_scales(ReducedGraph(built.graph, analysis.inputs, analysis.outputs))
    except (NumericalError, UsageError) as error:
        return Explanation(result, facts, obstacle=error)
    return Explanation(result, facts)


def _add_record(
    scene: Scene[IdentificationScene], result: Result, facts: list[Fact], names: list[str]
) -> Any:
    """Add identifiability, and what is said of record and estimator; return the likelihood."""
    from dynid.identification.problem import identifiable_origin

    model = scene.model
    assert model.measurement is not None
    with guarded("what the record can tell", names=names):
        expected = _expected(scene, result)
        likelihood = expected.likelihood
        redundancy = expected.redundancy
    facts += _of_record(scene, likelihood)
    said = (
        "warning: nothing in the record could contradict the model, whatever is wrong with it: "
        "no estimate will be called converged; add channels or excitation frequencies, or fix a "
        "parameter"
    )
    if redundancy > 0:
        numbers = "number" if redundancy == 1 else "numbers"
        said = f"{redundancy} {numbers} beyond the unknowns can contradict the model"
    facts.append(Fact("redundancy", said))
    facts += _of_damping(expected, names)
    by_likelihood = model.measurement.frf is not None or model.measurement.modes is not None
    facts += _of_estimator(model.estimator, frf=by_likelihood)
    identifiable_origin(likelihood)  # checked by a run before it begins
    return likelihood


def _of_damping(expected: ExpectedRecords, names: list[str]) -> Iterator[Fact]:
    """Yield which joints' dampers and loss factors the data will hardly distinguish."""
    if not any(".eta" in name for name in names):
        return
    from dynid.identification.diagnosis.damping_kinds import alike_damping

    information = expected.information()
    bounds = information.bounds()  # of the coordinates: of logarithms the relative ones
    none = np.zeros((len(bounds), len(bounds)))
    correlation = information.correlation() if np.isfinite(bounds).all() else none
    yield from (
        Fact("damping", f"warning: {text}")
        for text in alike_damping(expected.likelihood, correlation, bounds)
    )


def _of_model(
    structure: StructuralModel, reduction: StructuralReduction | None, method: str
) -> Iterator[Fact]:
    n = structure.size
    r = n if reduction is None else reduction.model.size
    parameters = f"{len(structure.unknowns)} unknown"
    if structure.parameters:
        parameters = counted(len(structure.unknowns), "unknown parameter")
    else:
        count = sum(len(joint.terms) + sum(map(len, joint.law_parameters)) for joint in structure.joints)
        parameters += f" of {count} joint parameters"
    if reduction is None:
        yield Fact("model", f"{n:,} DOFs: {2 * n:,} physical states; {parameters}")
        return
    yield Fact("model", f"{n:,} DOFs reduced by {method} to {r}: {2 * r} states; {parameters}")
    basis = [counted(len(reduction.masters), "master")] if reduction.masters else []
    if reduction.modes:
        rule = f" ({reduction.rule})" if reduction.rule else ""
        basis.append(counted(len(reduction.modes), "mode") + rule)
    if reduction.condition is not None:
        basis.append(f"condition of {reduction.inverted} {reduction.condition:.2g}")
    yield Fact("basis", "; ".join(basis))


def _expected(scene: Scene[IdentificationScene], result: Result) -> ExpectedRecords:
    """Return the predicted records, and add the identifiability of the parameters to a result."""
    from dynid.identification.identifiability import (
        add_expected_slopes,
        expected_records,
        identifiability_result,
        with_true_noise,
    )
    from dynid.identification.problem import Problem

    model = scene.model
    assert model.measurement is not None
    report_progress("what the record can tell")
    small, measurements, truth, rebuild = prospect(scene)
    problem = Problem.of(small, measurements, truth=truth, rebuild=rebuild)
    expected = with_true_noise(expected_records(problem.likelihood))
    result.merge(identifiability_result(problem.model, expected))
    if model.measurement.modes is None:
        add_expected_slopes(result, expected)
        if model.measurement.frf is not None:
            result.add_axis("identification/measurement/omega", measurements[0].omega, "rad/s")
    return expected


def _of_record(scene: Scene[IdentificationScene], likelihood: Likelihood) -> Iterator[Fact]:
    """Yield the size of the record, and its sampling rate beside the excited band."""
    model = scene.model
    assert model.measurement is not None
    band, unit = interest_of(scene).band, unit_of_frequencies(scene.source.data)
    assert band is not None  # a record has its excitation, or that of a white one
    records = likelihood.records
    count = sum(int(np.count_nonzero(~np.isnan(record.data.values))) for record in records)
    channels = records[0].data.values.shape[1]
    several = f" in {len(records)} records" if len(records) > 1 else ""
    if model.measurement.modes is not None:
        more = " with others" if len(records) > 1 else ""
        yield Fact("record", f"measured modes: {count:,} values{more}")
        return
    if model.measurement.frf is not None:
        yield Fact("record", f"frequency responses up to {unit.text(band)}: {count:,} real values")
        return
    step = min(float(record.step or math.inf) for record in model.measurement.each)
    times = [len(record.data.values) for record in records]
    lengths = f"{times[0]:,}" if len(set(times)) == 1 else f"{min(times):,} to {max(times):,}"
    samples = f"{lengths} samples of {counted(channels, 'channel')}"
    yield Fact("record", f"{samples} every {step:.4g} s{several}: {count:,} values")
    nyquist = math.pi / step
    if not (model.excitation or any(record.excitation for record in model.measurement.each)):
        yield Fact("sampling", f"no excitation is given; half the sampling rate is {unit.text(nyquist)}")
    elif band >= nyquist:
        said = f"the excitation may reach half the sampling rate, {unit.text(nyquist)}, and beyond"
        yield Fact("sampling", f"{said}: between samples it is as its hold says")
    else:
        dense = f"{band * step:.2g}, {2 * math.pi / (band * step):.3g} samples a period"
        yield Fact("sampling", f"excited up to {unit.text(band)}: ω x step is {dense}")


def _of_estimator(estimator: EstimatorModel, *, frf: bool) -> Iterator[Fact]:
    passes = estimator.passes or FILTER_PASSES.value
    many = f"{passes} pass{'es' if passes > 1 else ''} over the record"
    said = {
        "auto": f"{ESTIMATOR.sentence.format(value=ESTIMATOR.value)}; more passes and other starts only "
        "where the residuals ask for them",
        "filter": f"filter: {many}",
        "sigma-point": f"sigma-point: {many}; of several the first is linearised",
        "output-error": "output-error: maximum likelihood from the starts, at most "
        f"{estimator.iterations or 50} steps",
        "invariant-imbedding": "invariant-imbedding: one integration of eqs 19 and 20 over the record",
    }
    loss = ""
    if estimator.loss == "huber":
        loss = f"; {HUBER.sentence.format(value=HUBER.value)}"
    if frf:
        yield Fact("estimator", f"{estimator.method}: maximum likelihood of the responses{loss}")
        return
    yield Fact("estimator", f"{said[estimator.method]}{loss}")


def _responses(analysis: ResponseModel) -> str:
    requested = []
    if analysis.modes is not None:
        requested.append("modes")
    if analysis.frequency is not None:
        lines = len(angular_frequencies(analysis.frequency))
        requested.append(f"frequency response at {counted(lines, 'frequency')}")
    if analysis.time is not None:
        requested.append(f"time response at {counted(len(record_of(analysis.time).times), 'sample')}")
    return ", ".join(requested)
