"""Run a scene of kind `identification`."""

from __future__ import annotations

import math
from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple, cast

from dynid.result import Result
from dynid.scene.kinds.grids import angular_frequencies
from dynid.scene.kinds.identification_responses import responses
from dynid.scene.kinds.needs import tell_identification
from dynid.scene.kinds.records import experiments
from dynid.scene.kinds.structures import build_structure
from dynid.scene.load import Scene
from dynid.scene.schema.identification import EstimatorModel, IdentificationScene
from dynid.structure.model import StructuralModel

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from dynid.identification.estimate import Common, Rebuild
    from dynid.identification.estimators.estimation import Estimator
    from dynid.identification.measurement import Experiment
    from dynid.scene.batch import Outcome
    from dynid.scene.kinds.reductions import LocatedReductor
    from dynid.scene.schema.reductions import Reduction
    from dynid.structure.reduction.selection import Interest


def run(scene: Scene) -> Result:
    """Identify the joints of a structure from a record, and compute the responses asked for.

    Where the structure is reduced, both are done with the reduced model. Responses are those with the
    joints as identified; without a record, unknown joints have their true values where these are given,
    else their starts.

    Raises
    ------
    NotIdentifiable, Diverged
        Where the record cannot tell the unknowns, or the estimator runs away.
    FileError
        Where measured data cannot be read.
    """
    model = cast("IdentificationScene", scene.model)
    structure = build_structure(scene, model.structure, model.joints)
    method = reductor_of(scene)
    result = Result("identification", scene.title)
    values = {unknown.name: unknown.true or unknown.start for unknown in structure.unknowns}
    if model.measurement is not None:
        if model.measurement.frf is not None:
            result.merge(_identified_by_response(scene, structure))
        else:
            result.merge(_identified_by_records(scene, structure))
        names = result["identification/parameters/name"].data
        values = dict(zip(names, result["identification/parameters/estimate"].data.tolist(), strict=True))
    made = None if method is None else method.at(values).reduce(structure)
    if made is not None and made.doubt:
        result.annotate("structure" if model.measurement is None else "identification", doubt=made.doubt)
    if model.analysis is not None:
        result.merge(responses(scene, model, structure if made is None else made.model, values))
    tell_identification(result, model, structure, made)
    return result


def responding_structure(scene: Scene) -> tuple[StructuralModel, dict[str, float]]:
    """Return the structure that responds, reduced where the scene says so, and values of its unknowns.

    These are the true ones where all are given, else the starts.
    """
    model = cast("IdentificationScene", scene.model)
    structure = build_structure(scene, model.structure, model.joints)
    method, values = reductor_of(scene), expected_values(structure)
    return (structure if method is None else method.at(values).reduce(structure).model), values


class Setting(NamedTuple):
    """What an estimator works with: its model, the records, and the model of those that are simulated."""

    model: StructuralModel
    experiments: Sequence[Experiment]
    truth: StructuralModel


def setting(scene: Scene, structure: StructuralModel, values: Mapping[str, float] | None = None) -> Setting:
    """Return what a scene's identification works with.

    Parameters
    ----------
    scene
        The scene, with a measurement.
    structure
        Its structure.
    values
        Parameters by name that a basis which follows the joints is made for; absent: as it comes.
    """
    model = cast("IdentificationScene", scene.model)
    assert model.measurement is not None
    records = experiments(scene, model.excitation, model.measurement)
    reduced, truth = models_of(scene, structure, values)
    return Setting(reduced, records, truth)


def models_of(
    scene: Scene, structure: StructuralModel, values: Mapping[str, float] | None = None
) -> tuple[StructuralModel, StructuralModel]:
    """Return what an estimator works with, and what is simulated; `values` as of `setting`."""
    model = cast("IdentificationScene", scene.model)
    method = reductor_of(scene)
    if method is None:
        return structure, structure
    assert model.measurement is not None
    first, truth = model.measurement.each[0], structure
    simulate = first.frf.simulate if first.frf else first.simulate
    if simulate is not None and simulate.model == "reduced":
        truth = method.at(structure.true_values()).reduce(structure).model
    made = method if values is None else method.at(values)
    return made.reduce(structure).model, truth


def expected_values(structure: StructuralModel) -> dict[str, float]:
    """Return the true values of the unknowns where all are given, else their starts."""
    unknowns = structure.unknowns
    if all(unknown.true is not None for unknown in unknowns):
        return structure.true_values()
    return {unknown.name: unknown.start for unknown in unknowns}


def identified(
    scene: Scene,
    structure: StructuralModel,
    made: Setting,
    *,
    common: Common | None = None,
    into: Result | None = None,
) -> Result:
    """Identify with the reduced model where there is one; its basis may follow the joints.

    Parameters
    ----------
    scene, structure, made
        The scene, its structure, and what its identification works with.
    common
        What its records share with others, where it is made already.
    into
        What the result is added to; absent: a new one.
    """
    from dynid.identification.estimate import identify_all

    model = cast("IdentificationScene", scene.model)
    return identify_all(
        made.model,
        made.experiments,
        _estimator(model.estimator),
        truth=made.truth,
        rebuild=_rebuilder(scene, structure),
        common=common,
        into=into,
    )


def batched(
    template: Scene, overrides: Sequence[Mapping[str, Any]], collect: tuple[str, ...], of: int
) -> list[Outcome] | None:
    """Run samples of a scene together; see `dynid.scene.kinds.identification_samples`."""
    from dynid.scene.kinds.identification_samples import batched as run_together

    return run_together(template, overrides, collect, of)


def _identified_by_records(scene: Scene, structure: StructuralModel) -> Result:
    """Identify from records of time, and say before what they can tell."""
    result = identified(scene, structure, setting(scene, structure))
    if cast("IdentificationScene", scene.model).identifiability:
        from dynid.identification.identifiability import identifiability

        result.merge(identifiability(*setting(scene, structure, expected_values(structure))))
    return result


def _identified_by_response(scene: Scene, structure: StructuralModel) -> Result:
    """Identify from frequency response functions, and say before what they can tell."""
    from dynid.identification.estimators.output_error import OutputError
    from dynid.identification.frf.estimator import FrfAuto
    from dynid.identification.frf.identifiability import frf_identifiability
    from dynid.identification.frf.identify import identify_frf
    from dynid.scene.kinds.frf import frf_measurement

    model = cast("IdentificationScene", scene.model)
    assert model.measurement is not None
    measurement = frf_measurement(scene, model.measurement)
    reduced, truth = models_of(scene, structure)
    rebuild = _rebuilder(scene, structure)
    chosen = model.estimator
    options: dict[str, Any] = chosen.options()
    estimator = OutputError(**options) if chosen.method == "output-error" else FrfAuto()
    result = identify_frf(reduced, measurement, estimator, truth=truth, rebuild=rebuild)
    if model.identifiability:
        reduced, truth = models_of(scene, structure, expected_values(structure))
        result.merge(frf_identifiability(reduced, measurement, truth))
    return result


#: Where the estimators are, so that only the one that is asked for is loaded.
_ESTIMATORS = {
    "auto": ("auto", "Auto"),
    "filter": ("passes", "Filter"),
    "output-error": ("output_error", "OutputError"),
    "invariant-imbedding": ("imbedding", "InvariantImbedding"),
}


def _estimator(given: EstimatorModel) -> Estimator:
    """Return the estimator that a scene names."""
    module, name = _ESTIMATORS[given.method]
    kind = getattr(import_module(f"dynid.identification.estimators.{module}"), name)
    estimator: Estimator = kind(**given.options())
    return estimator


def reductor_of(scene: Scene) -> LocatedReductor | None:
    """Return the reduction of a scene, made for its sensors, loads and the band of its excitation."""
    part = reduction_of(scene)
    if part is None:
        return None
    from dynid.scene.kinds.reductions import build_reductor

    return build_reductor(part, interest_of(scene), "reduction")


def reduction_of(scene: Scene) -> Reduction | None:
    """Return the reduction as a scene describes it, with residual vectors where it leaves that open.

    An excitation without a highest frequency leaves them out: there they gain nothing, and cost much.
    """
    model = cast("IdentificationScene", scene.model)
    if model.reduction is None or not _is_limited(scene):
        return model.reduction
    from dynid.scene.kinds.reductions import with_residuals

    return with_residuals(model.reduction)


def _is_limited(scene: Scene) -> bool:
    """Tell whether the band of interest ends below half the sampling rate."""
    measurement = cast("IdentificationScene", scene.model).measurement
    if measurement is None or measurement.frf is not None:
        return True
    step = min(float(record.step or math.inf) for record in measurement.each)
    return (interest_of(scene).band or math.inf) < math.pi / step


def interest_of(scene: Scene) -> Interest:
    """Return what a reduced model is for: sensors, loads, and the band of the excitation or the lines."""
    model = cast("IdentificationScene", scene.model)
    from dynid.scene.kinds.reductions import band_of
    from dynid.structure.reduction.selection import Interest

    dofs = [part.dof for part in model.excitation]
    band = None
    if model.measurement is not None and model.measurement.frf is not None:
        dofs += [dof for channel in model.measurement.sensors for dof in channel.all_dofs]
        from dynid.scene.kinds.frf import frf_measurement

        band = float(frf_measurement(scene, model.measurement).omega[-1])
    elif model.measurement is not None:
        records = model.measurement.each
        signals = [*model.excitation, *(part for record in records for part in record.excitation or ())]
        dofs += [part.dof for part in signals]
        dofs += [dof for channel in model.measurement.sensors for dof in channel.ends]
        band = band_of(signals, min(float(record.step or math.inf) for record in records))
    if model.analysis is not None:
        dofs += [
            *(model.analysis.inputs or ()),
            *(dof for output in model.analysis.outputs or () for dof in output.ends),
            *(part.dof for part in (model.analysis.time.input if model.analysis.time else ())),
        ]
        if band is None and model.analysis.frequency is not None:
            band = float(angular_frequencies(model.analysis.frequency)[-1])
    return Interest(tuple(dict.fromkeys(dof for dof in dofs if dof is not None)), band)


def _rebuilder(scene: Scene, full: StructuralModel) -> Rebuild | None:
    """Return what makes a basis anew that follows the joints, where there is one."""
    method = reductor_of(scene)
    if method is None or not method.follows_joints:
        return None
    return lambda values: method.at(values).reduce(full).model
