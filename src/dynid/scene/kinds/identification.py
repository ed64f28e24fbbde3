"""Scenes of kind `identification`: estimates from records or frequency responses, and responses."""

from __future__ import annotations

import math
from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple, cast

from dynid.progress import report_progress
from dynid.result import Result
from dynid.scene.kinds.measurements import channel_of, experiments, frf_measurement, initial_motion, loads_of
from dynid.scene.kinds.scope import add_identification_scope
from dynid.scene.kinds.signals import angular_frequencies, record_of
from dynid.scene.kinds.structures import build_structure
from dynid.scene.load import Scene
from dynid.scene.schema.identification import EstimatorModel, IdentificationScene, ResponseModes
from dynid.structure.model import StructuralModel
from dynid.structure.response import Channel, Load, frequency_response, time_response
from dynid.structure.state_space import without_massless

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from dynid.identification.estimators.estimate import Estimator
    from dynid.identification.identify import Rebuild, SharedRecords
    from dynid.identification.measurement import Experiment
    from dynid.lti.generator import RecordTimes
    from dynid.scene.kinds.reduction import LocatedReductor
    from dynid.scene.run import PreparationStep
    from dynid.scene.schema.base import Dof
    from dynid.scene.schema.reduction import ReductionModel
    from dynid.scene.schema.signals import TimeGrid
    from dynid.scene.yaml.parser import Path as KeyPath
    from dynid.structure.reduction.mode_selection import Interest


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
    add_identification_scope(result, model, structure, made)
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
    """Input of an estimator: its model, the records, and the model that simulates records."""

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
    if model.reduction is None:
        structure = without_massless(structure, [dof for record in records for dof in record.dofs])
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
    common: SharedRecords | None = None,
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
    from dynid.identification.identify import identify_all

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


def preparation_steps(scene: Scene) -> Iterator[PreparationStep]:
    """Yield the steps of a run before any computation: build the structure, its records and reduction."""
    model = cast("IdentificationScene", scene.model)
    measurement = model.measurement
    yield lambda: build_structure(scene, model.structure, model.joints)
    if measurement is not None and measurement.frf is not None:
        yield lambda: frf_measurement(scene, measurement)
    elif measurement is not None:
        yield lambda: experiments(scene, model.excitation, measurement)
    if measurement is None or measurement.frf is None:  # else it reads the responses again
        yield lambda: reductor_of(scene)
    if model.analysis is not None and model.analysis.time is not None:
        yield lambda: time_question(scene)


def unread_files(scene: Scene) -> Iterator[KeyPath]:
    """Yield the keys whose files a run does not read: what several records share and none of them uses."""
    model = cast("IdentificationScene", scene.model)
    records = model.measurement.records if model.measurement else []
    if records and all(record.simulate or (record.file and record.file.path) for record in records):
        yield ("measurement", "file")
    if records and all(record.excitation is not None for record in records):
        yield ("measurement", "excitation")
    every = model.measurement.each if model.measurement else []
    time = model.analysis and model.analysis.time
    drives = time and not (time.input or model.initial)
    if not drives and all(record.excitation is not None for record in every):
        yield ("excitation",)


def _identified_by_records(scene: Scene, structure: StructuralModel) -> Result:
    """Identify from records of time, and say before what they can tell."""
    result = identified(scene, structure, setting(scene, structure))
    if cast("IdentificationScene", scene.model).identifiability:
        from dynid.identification.identifiability import identifiability

        result.merge(identifiability(*setting(scene, structure, expected_values(structure))))
    return result


def _identified_by_response(scene: Scene, structure: StructuralModel) -> Result:
    """Identify from frequency response functions, and say before what they can tell."""
    from dynid.identification.estimators.auto import FrfAuto
    from dynid.identification.estimators.maximum_likelihood import Huber, OutputError
    from dynid.identification.identify import identify_frf

    model = cast("IdentificationScene", scene.model)
    assert model.measurement is not None
    measurement = frf_measurement(scene, model.measurement)
    reduced, truth = models_of(scene, structure)
    rebuild = _rebuilder(scene, structure)
    chosen = model.estimator
    options: dict[str, Any] = chosen.options()
    method = OutputError(**options) if chosen.method == "output-error" else FrfAuto()
    estimator = Huber(method) if chosen.loss == "huber" else method
    result = identify_frf(reduced, measurement, estimator, truth=truth, rebuild=rebuild)
    if model.identifiability:
        from dynid.identification.identifiability import frf_identifiability

        reduced, truth = models_of(scene, structure, expected_values(structure))
        result.merge(frf_identifiability(reduced, measurement, truth))
    return result


#: Where the estimators are, so that only the one that is asked for is loaded.
_ESTIMATORS = {
    "auto": ("auto", "Auto"),
    "filter": ("filter_passes", "Filter"),
    "output-error": ("maximum_likelihood", "OutputError"),
    "invariant-imbedding": ("imbedding", "InvariantImbedding"),
}


def _estimator(given: EstimatorModel) -> Estimator:
    """Return the estimator that a scene names."""
    module, name = _ESTIMATORS[given.method]
    kind = getattr(import_module(f"dynid.identification.estimators.{module}"), name)
    estimator: Estimator = kind(**given.options())
    if given.loss == "huber":
        from dynid.identification.estimators.maximum_likelihood import Huber

        return Huber(estimator)
    return estimator


def reductor_of(scene: Scene) -> LocatedReductor | None:
    """Return the reduction of a scene, made for its sensors, loads and the band of its excitation."""
    part = reduction_of(scene)
    if part is None:
        return None
    from dynid.scene.kinds.reduction import build_reductor

    return build_reductor(part, interest_of(scene), "reduction")


def reduction_of(scene: Scene) -> ReductionModel | None:
    """Return the reduction as a scene describes it, with residual vectors where it leaves that open.

    An excitation without a highest frequency leaves them out: there they gain nothing, and cost much.
    """
    model = cast("IdentificationScene", scene.model)
    if model.reduction is None or not _is_limited(scene):
        return model.reduction
    from dynid.scene.kinds.reduction import with_residuals

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
    from dynid.scene.kinds.signals import highest_frequency
    from dynid.structure.reduction.mode_selection import Interest

    dofs = [part.dof for part in model.excitation]
    band = None
    if model.measurement is not None and model.measurement.frf is not None:
        dofs += [dof for channel in model.measurement.sensors for dof in channel.all_dofs]

        band = float(frf_measurement(scene, model.measurement).omega[-1])
    elif model.measurement is not None:
        records = model.measurement.each
        signals = [*model.excitation, *(part for record in records for part in record.excitation or ())]
        dofs += [part.dof for part in signals]
        dofs += [dof for channel in model.measurement.sensors for dof in channel.ends]
        band = highest_frequency(signals, min(float(record.step or math.inf) for record in records))
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


#: What is said of a time response where the scene has an excitation that does not drive it.
_FREE = (
    "the free response to the initial motion; the excitation is the record's, and a response that it drives "
    "names it under time: input"
)


def _response_loads(
    scene: Scene, model: IdentificationScene, grid: TimeGrid, record: RecordTimes
) -> list[Load]:
    """Return what drives a time response: its own input; nothing, with an initial motion; the excitation."""
    if grid.input or model.initial:
        return loads_of(scene, "analysis.time.input", grid.input, record)
    return loads_of(scene, "excitation", model.excitation, record)


def responses(
    scene: Scene, model: IdentificationScene, structure: StructuralModel, values: Mapping[str, float]
) -> Result:
    """Compute the responses, by default at the sensors to the forces that excite the record.

    With an initial motion and no input of its own the time response is the free one.
    """
    wanted = model.analysis
    assert wanted is not None
    result = Result("identification", scene.title)
    if wanted.modes is not None:
        from dynid.structure.modal_analysis import modal_analysis

        report_progress("modes")
        result.merge(modal_analysis(structure, *which_modes(wanted.modes), values))
    if wanted.frequency is not None:
        driven = [part.dof for part in model.excitation if part.dof is not None and part.motion is None]
        driven += _forced(model)
        inputs = list(dict.fromkeys(wanted.inputs or driven))
        omega = angular_frequencies(wanted.frequency)
        report_progress("frequency response")
        result.merge(frequency_response(structure, inputs, _outputs(model), omega, values))
    if wanted.time is not None:
        report_progress("time response")
        result.merge(time_response(structure, values=values, **time_question(scene)))
        if model.initial and model.excitation and not wanted.time.input:
            result.annotate("structure/time_response", note=_FREE)
    return result


def time_question(scene: Scene) -> dict[str, Any]:
    """Return the loads, outputs, times and first motion of the time response that a scene asks for."""
    model = cast("IdentificationScene", scene.model)
    wanted = model.analysis
    assert wanted is not None
    assert wanted.time is not None
    record = record_of(wanted.time)
    return {
        "loads": _response_loads(scene, model, wanted.time, record),
        "outputs": _outputs(model),
        "times": record.times,
        **initial_motion(model),
    }


def which_modes(asked: ResponseModes) -> tuple[int | None, float | None]:
    """Return how many modes are asked for, and below what frequency, rad/s."""
    factor = 2 * math.pi if asked.unit == "Hz" else 1.0
    return asked.count, None if asked.below is None else factor * float(asked.below)


def _outputs(model: IdentificationScene) -> list[Channel]:
    """Return what responses show: what is named, else what the sensors measure."""
    sensors = model.measurement.sensors if model.measurement else []
    shown = [channel_of(item) for item in (model.analysis and model.analysis.outputs) or sensors]
    return list(dict.fromkeys(shown))


def _forced(model: IdentificationScene) -> list[Dof]:
    """Return the DOFs at which frequency response functions were measured with a force."""
    sensors = model.measurement.sensors if model.measurement else []
    return [channel.reference.dof for channel in sensors if channel.reference]
