"""Aspects of scenes of kind `identification`: estimator, basis, holds, propagation, mode solver.

Alternatives of the identification are scenes themselves: the same scene with another estimator, reduction or
hold, without responses.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from dynid.bench.benchmark import Alternative
from dynid.bench.scenes.aspects import (
    METHODS,
    Aspect,
    described,
    name_of,
    propagation,
    response_of,
    sizes_around,
    solvers,
)
from dynid.defaults import BASIS_BAND, ESTIMATOR, FILTER_PASSES, HOLD, RESIDUALS
from dynid.identification.systems.parametric_model import Model
from dynid.lti.noise import HOLDS
from dynid.scene.kinds.bond_graph import graph_analysis
from dynid.scene.kinds.identification import (
    interest_of,
    reduction_of,
    reductor_of,
    responding_structure,
    time_question,
    which_modes,
)
from dynid.scene.kinds.identified_graphs import identified_graph
from dynid.scene.kinds.parts import structure_of
from dynid.scene.load import Scene, check_source
from dynid.scene.run import run_scene
from dynid.scene.schema.base import ASPECTS as NAMES
from dynid.scene.schema.identification import IdentificationScene
from dynid.structure.response import time_response

#: Passes of the filter that are tried.
_PASSES = (1, 2, 3, 4)
#: Keys of the scene that an alternative of the identification omits.
_OUTSIDE = ("accuracy", "analysis", "expect", "identifiability", "initial", "plan")


class _EstimatedParameters(NamedTuple):
    """Parameters: estimate, true value (NaN where unknown), standard error and Cramér–Rao bound (p each)."""

    estimate: NDArray[np.float64]
    true: NDArray[np.float64]
    deviation: NDArray[np.float64]
    bound: NDArray[np.float64]


def estimator(scene: Scene[IdentificationScene]) -> Aspect:
    """Return the estimators, and the one that the scene names."""
    requested = scene.model.estimator
    written = scene.source.data.get("estimator") or {}
    passes = {**dict.fromkeys(NAMES["identification"]["estimator"], 1), "output-error": 0}
    points = []

    def filtered(passes: int) -> Scene:
        return _changed(scene, {"estimator": {"method": "filter", "passes": passes}})

    for name in passes:
        options = written if name == requested.method else {"method": name}
        if name != "filter":
            points.append((_alternative(name, scene, {"estimator": options}), passes[name]))
            continue
        tried = sorted({*_PASSES, requested.passes or 1})
        points += [(Alternative(name, _identified, filtered), k) for k in tried]
    chosen = (
        requested.passes or FILTER_PASSES.value if requested.method == "filter" else passes[requested.method]
    )
    named = "as requested" if "method" in written else f"chosen by default: {ESTIMATOR}"
    return _of_parameters("estimator", "passes", points, (requested.method, chosen), named, _is_known(scene))


def basis(scene: Scene) -> Aspect:
    """Return reductions of the structure by all methods, and the full model."""
    structure = structure_of(scene)
    method, n = reductor_of(scene), structure.size
    without = {key: value for key, value in scene.source.data.items() if key != "reduction"}
    points = [(_alternative("full", scene, {}, without), n)]
    chosen, because = ("full", n), "no reduction is asked for"
    size = max(1, n // 2)
    tried = [size]
    if method is not None and (reduction := reduction_of(scene)) is not None:
        size = method.reduce(structure).model.size
        written, name = scene.source.data["reduction"], name_of(reduction)
        chosen, because = (name, size), f"as requested; chosen by default: {BASIS_BAND}; {RESIDUALS}"
        tried = sizes_around(size, n)
        points.append((_alternative(name, scene, {"reduction": written}), size))
    ends = len(
        dict.fromkeys([*(d for joint in structure.joints for d in joint.dofs), *interest_of(scene).dofs])
    )

    def reduced(size: int, name: str) -> Scene:
        return _changed(scene, {"reduction": described(name, size, ends)})

    points += [
        (Alternative(name, _identified, partial(reduced, name=name)), point)
        for name in METHODS
        for point in tried
        if (name, point) != chosen
    ]
    return _of_parameters("basis of the model", "coordinates", points, chosen, because, _is_known(scene))


def hold(scene: Scene) -> Aspect:
    """Return the holds between the samples of a force."""
    samples = sum(int(record.samples or 0) for record in cast("Any", scene.model).measurement.each)
    points = [(_alternative("as-written", scene, {}), samples)]
    points += [(_alternative(name, scene, _with_hold(scene, name)), samples) for name in HOLDS]
    because = f"as written; chosen by default: {HOLD}"
    return _of_parameters(
        "hold of sampled forces", "samples", points, ("as-written", samples), because, _is_known(scene)
    )


def _with_hold(scene: Scene, name: str) -> dict[str, Any]:
    """Return the parts of the scene with a hold for all sampled forces."""
    data = scene.source.data
    measurement = data["measurement"]
    shared = "simulate" in measurement

    def changed(signals: Any, *, simulated: bool) -> Any:
        kinds = ("random",) if simulated else ("random", "file")
        if isinstance(signals, dict):
            return {**signals, "hold": name} if signals.get("kind") in kinds else signals
        return [changed(signal, simulated=simulated) for signal in signals]

    records = [
        {**record, "excitation": changed(record["excitation"], simulated=shared or "simulate" in record)}
        if "excitation" in record
        else record
        for record in measurement.get("records", [])
    ]
    changes = {"measurement": {**measurement, **({"records": records} if records else {})}}
    if "excitation" in data:
        every = shared or any("simulate" in record for record in records)
        changes["excitation"] = changed(data["excitation"], simulated=every)
    return changes


def response(scene: Scene[IdentificationScene]) -> Aspect:
    """Return the ways to propagate the time response."""
    requested = scene.model.graph_analysis
    if requested is not None:
        built = identified_graph(scene)[1]
        return response_of(built.graph, graph_analysis(scene, requested, built))
    structure, values = responding_structure(scene)
    asked = time_question(scene, structure)
    loads = asked.pop("loads")

    def respond(signals: list[Any]) -> Any:
        driven = [load._replace(signal=signal) for load, signal in zip(loads, signals, strict=True)]
        result = time_response(structure, driven, values=values, **asked)
        return result["structure/time_response/response"].data

    return propagation(respond, [load.signal for load in loads], asked["times"])


def _modes_of(scene: Scene[IdentificationScene]) -> Aspect:
    """Return the solvers of the requested modes."""
    structure, values = responding_structure(scene)
    requested = scene.model.structure_analysis
    assert requested is not None
    assert requested.modes is not None
    return solvers(structure, *which_modes(requested.modes), values)


def _changed(scene: Scene, changes: Mapping[str, Any], data: Mapping[str, Any] | None = None) -> Scene:
    """Return the scene of an identification with parts changed; invalid combinations are rejected."""
    kept = {key: v for key, v in (data or scene.source.data).items() if key not in _OUTSIDE}
    return check_source(replace(scene.source, data={**kept, **changes}, overridden=True))


def _identified(scene: Scene) -> _EstimatedParameters:
    result, group = run_scene(scene), "identification/parameters"
    columns = ("estimate", "true", "standard_error", "cramer_rao")
    return _EstimatedParameters(*(result[f"{group}/{name}"].data for name in columns))


def _alternative(name: str, scene: Scene, *changes: Mapping[str, Any]) -> Alternative:
    """Return an identification with parts of the scene changed, as of `_changed`."""
    return Alternative(name, _identified, lambda _: _changed(scene, *changes))


def _is_known(scene: Scene[IdentificationScene]) -> bool:
    model: Model = structure_of(scene) if scene.model.graph is None else identified_graph(scene)[0]
    return all(unknown.true is not None for unknown in model.unknowns)


def _of_parameters(
    title: str,
    size: str,
    points: list[tuple[Alternative, int]],
    chosen: tuple[str, int],
    because: str,
    has_truth: bool,
) -> Aspect:
    """Return an aspect whose error is that of the parameters; its least_error are the Cramér–Rao bounds."""

    def error(estimates: _EstimatedParameters, reference: _EstimatedParameters) -> float:
        true = estimates.true if np.isfinite(estimates.true).all() else reference.estimate
        return float(np.sqrt(np.mean((estimates.estimate / true - 1) ** 2)))

    def least_error(estimates: _EstimatedParameters) -> float | None:
        if not np.isfinite(estimates.true).all():
            return None
        return float(np.sqrt(np.mean((estimates.bound / estimates.true) ** 2)))

    measure = "RMS relative error of the parameters, against their true values"
    if not has_truth:
        measure = "RMS relative distance of the parameters from those of the reference"
    return Aspect(
        title=title,
        size=size,
        points=points,
        chosen=frozenset({chosen}),
        because=because,
        error=error,
        measure=measure,
        least_error=least_error,
    )


ASPECTS = {
    "estimator": estimator,
    "basis": basis,
    "hold": hold,
    "propagation": response,
    "modes": _modes_of,
}
