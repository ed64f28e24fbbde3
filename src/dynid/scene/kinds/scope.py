"""Geometry and scope of a structure in its result: sensors, loads, parts modelled and left out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from dynid.model_scope import ScopePart, add_model_scope, divided
from dynid.result import Result
from dynid.scene.kinds.measurements import channel_of, result_name
from dynid.scene.schema.base import ASPECTS
from dynid.structure.model import StructuralModel

if TYPE_CHECKING:
    from dynid.scene.schema.identification import IdentificationScene
    from dynid.scene.schema.measurement import ChannelModel
    from dynid.scene.schema.reduction import ReductionScene
    from dynid.structure.reduction.reduced_model import StructuralReduction


_NOT_REQUESTED = "not requested"
#: The results of a scene of kind `identification`, and their groups.
_RESULTS = {
    "parameters": "identification/parameters",
    "identifiability": "identification/identifiability",
    "modes": "structure/modes",
    "frequency_response": "structure/frequency_response",
    "time_response": "structure/time_response",
}
_SOLVERS = ("dense matrices", "sparse Lanczos")
#: The algorithms of each estimator.
_ENGINES = {
    "auto": ["filter", "maximum likelihood"],
    "filter": ["filter"],
    "sigma-point": ["filter"],
    "output-error": ["maximum likelihood"],
    "invariant-imbedding": ["invariant imbedding"],
}


def add_identification_scope(
    result: Result,
    model: IdentificationScene,
    structure: StructuralModel,
    reduction: StructuralReduction | None,
) -> None:
    """Add the model scope of an identification: coordinates, modes, states, parameters, engines, results."""
    n = structure.size
    r = n if reduction is None else reduction.model.size
    parts: list[ScopePart] = []
    if reduction is not None:
        method, modes = model.reduction_method, len(reduction.modes)
        parts += _of_reduction("", method, reduction.model.size, n, modes, reduction.rule)
    parts.append(ScopePart("states", 2 * r, 2 * (n - r), "the structure is reduced"))
    measured = model.measurement is not None
    unknown = [unknown_parameter.name for unknown_parameter in structure.unknowns]
    # The terms of joints that depend on parameters are not fixed.
    all_terms = (term for joint in structure.joints for term in joint.terms)
    terms = [term.name for term in all_terms if term.name in unknown or not term.product.terms]
    terms += [name for name in unknown if name not in terms]
    why = "known: fixed at their values"
    if measured or unknown:
        parts.append(divided("parameters", terms, unknown if measured else [], why if measured else _FIXED))
    parts.append(engines_part(result, model))
    if "structure/modes/omega" in result:
        count = len(result["structure/modes/omega"].data)
        why = "fewer are requested, or the others are massless"
        parts.append(ScopePart("modes shown", count, r - count, why))
    about = result.group_attrs.get("structure/frequency_response", {})
    if about.get("method") == "modal":
        count = int(about["modes"])
        why = "above the band of the response: residual vectors stand for them"
        parts.append(ScopePart("modes of the frequency response", count, r - count, why))
    groups = {path.rpartition("/")[0] for path in result}
    there = [name for name, group in _RESULTS.items() if any(path.startswith(group) for path in groups)]
    parts.append(divided("results", _RESULTS, there, _NOT_REQUESTED))
    add_model_scope(result, "identification", parts)


def engines_part(result: Result, model: IdentificationScene) -> ScopePart:
    """Return the engines that an identification used, and those that it did not."""
    used: list[str] = []
    if model.measurement is not None:
        estimator = str(result.group_attrs["identification"].get("estimator", "output-error"))
        # Frequency responses are fitted by maximum likelihood, whatever the estimator is called.
        used = _ENGINES["output-error" if model.measurement.frf or model.measurement.modes else estimator]
    why = "not used by the estimator" if used else "there is no record"
    engines_of_all = dict.fromkeys(engine for engines in _ENGINES.values() for engine in engines)
    return divided("engines", engines_of_all, used, why)


_FIXED = "nothing is identified: fixed at their values, true values or starts"


def add_reduction_scope(result: Result, model: ReductionScene, methods: Mapping[str, str]) -> None:
    """Add the model scope of a comparison of reductions: coordinates and modes of each, engines, results.

    `methods` are by their names in the result.
    """
    n = len(result["reduction/dof"].data)
    parts: list[ScopePart] = []
    for name, method in methods.items():
        group = f"reduction/{name}"
        rule = str(result.group_attrs[group]["rule"])
        coordinates, modes = (result[f"{group}/{array}"].data.size for array in ("coordinate", "modes"))
        parts += _of_reduction(f" of {name}", method, coordinates, n, modes, rule)
    other_methods = [name for name in ASPECTS["reduction"]["basis"] if name != "full"]
    parts.append(divided("methods", other_methods, methods.values(), _NOT_REQUESTED))
    full_solver = str(result.group_attrs.get("reduction", {}).get("solver", ""))
    solver = _SOLVERS[0 if full_solver.startswith(_SOLVERS[0]) else 1]
    parts.append(divided("engines", _SOLVERS, [solver], "the solver of the modes is chosen by size"))
    responses = ["frequency_response"] if model.frequency is not None else []
    others = ["modes", "frequency_response"]
    compared = ["modes"] if full_solver else []
    why = _NOT_REQUESTED if full_solver else f"{_NOT_REQUESTED} (compare: true)"
    parts.append(divided("results", others, [*compared, *responses], why))
    add_model_scope(result, "reduction", parts)


def _of_reduction(of: str, method: str, size: int, n: int, modes: int, rule: str) -> Sequence[ScopePart]:
    parts = [ScopePart(f"coordinates{of}", size, n - size, f"reduction method: {method}")]
    return [*parts, ScopePart(f"modes{of}", modes, n - modes, rule)] if rule else parts


#: Where a result has measured shapes.
_SHAPES = "identification/modes"


def add_geometry(
    result: Result,
    model: IdentificationScene | ReductionScene,
    structure: StructuralModel,
    reduced: StructuralModel | None = None,
) -> None:
    """Add the geometry of a structure whose nodes are known, and their motion in the modes of the result.

    The modes are those of the `reduced` structure; default: of the structure.
    """
    if structure.nodes is None:
        return
    from dynid.structure.geometry import add_motion, add_places, geometry

    sensors: list[ChannelModel] = []
    if model.kind == "reduction":
        sensors += model.outputs or ()
        loads = [*(model.inputs or ())]
    else:
        loads = [signal.dof for signal in model.excitation if signal.dof is not None]
        if model.measurement is not None:
            sensors += model.measurement.sensors
            records = model.measurement.each
            driving = (signal for record in records for signal in record.excitation or ())
            loads += [signal.dof for signal in driving if signal.dof is not None]
            loads += [record.reference.place for record in model.measurement.sensors if record.reference]
        if model.structure_analysis is not None:
            sensors += model.structure_analysis.outputs or ()
            loads += model.structure_analysis.inputs or ()
    ends = ((record, end) for record in sensors for end in record.ends)
    named = {(channel_of(record, structure).name, result_name(structure, end)): None for record, end in ends}
    acting = dict.fromkeys(result_name(structure, dof) for dof in loads)
    parts = [model.structure, *(getattr(model, "structures", None) or {}).values()]
    imported = any(signal is not None and signal.matrices is not None for signal in parts)
    result.merge(geometry(structure, named, acting, supports=not imported))
    if f"{_SHAPES}/sensor" in result:
        names = [str(name) for name in result[f"{_SHAPES}/sensor"].data]
        dofs = [int(name) if name.isdecimal() else name for name in names]
        add_places(result, structure, "shape_sensor", zip(names, dofs, strict=True))
    add_motion(result, structure if reduced is None else reduced)
