"""Scenes of kind `identification`: estimates from records or frequency responses, and responses."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from dynid.errors import DynidError, Fault, UsageError
from dynid.identification.records.measurement import Experiment
from dynid.model_scope import wants_scope
from dynid.progress import report_progress
from dynid.result import Result
from dynid.scene.kinds.measurements import (
    channel_of,
    experiments,
    frf_measurement,
    initial_motion,
    loads_of,
    measurements_of,
    result_name,
)
from dynid.scene.kinds.parameters import at_starts, estimator_of, further_of
from dynid.scene.kinds.parts import structure_of
from dynid.scene.kinds.scope import add_geometry, add_identification_scope
from dynid.scene.kinds.signals import angular_frequencies, highest_frequency, record_of
from dynid.scene.kinds.structures import add_doubts, idle_masses
from dynid.scene.load import Scene
from dynid.scene.schema.identification import CampbellModel, IdentificationScene, ResponseModes
from dynid.scene.schema.reduction import ReductionModel
from dynid.scene.yaml.parser import Path as KeyPath
from dynid.structure.model import StructuralModel
from dynid.structure.ports import Channel
from dynid.structure.response import frequency_response, time_response
from dynid.structure.state_space import without_massless
from dynid.units import angular_factor

if TYPE_CHECKING:
    from dynid.identification.problem import SharedRecords
    from dynid.identification.results.write_held_out import HeldOut
    from dynid.identification.systems.parametric_model import Model, Rebuild
    from dynid.scene.kinds.reduction import LocatedReductor
    from dynid.scene.run import PreparationStep
    from dynid.structure.reduction.mode_selection import Interest


def run(scene: Scene[IdentificationScene], sample: Result | None = None) -> Result:
    """Return the joints identified from a record, and the requested responses of the structure.

    Where the structure is reduced, both are done with the reduced model. Responses are those with the joints
    as identified; without a record, unknown joints have their true values where these are given, else their
    starts. Of the `sample` of a study that wants nothing but estimates only these are computed. Raises
    `NotIdentifiable` or `Diverged` where the record does not determine the unknowns, or the estimator
    diverges. Raises `FileError` where measured data cannot be read.
    """
    model = scene.model
    if model.graph is not None:
        from dynid.scene.kinds.identified_graphs import run_graph

        return run_graph(scene)
    structure = structure_of(scene)
    if sample is not None and estimates_alone(model, sample):
        return identified(scene, setting(scene, structure), into=sample)
    method = reductor_of(scene)
    result = Result("identification", scene.title)
    add_doubts(result, structure)
    values = {unknown.name: unknown.expected for unknown in structure.unknowns}
    if model.measurement is not None:
        result.merge(identified(scene, setting(scene, structure)))
        if model.identifiability:
            from dynid.identification.identifiability import identifiability

            expected = setting(scene, structure, expected_values(structure))
            result.merge(identifiability(*expected))
        names = result["identification/parameters/name"].data
        values = dict(zip(names, result["identification/parameters/estimate"].data.tolist(), strict=True))
    reduction = None if method is None else method.at(values).reduce(started(scene, structure))
    if reduction is not None and reduction.doubt:
        result.annotate("structure" if model.measurement is None else "identification", doubt=reduction.doubt)
    responding = structure if reduction is None else reduction.model
    if model.responses is not None:
        result.merge(steady_states(model, responding, values))
    if model.structure_analysis is not None:
        result.merge(responses(scene, model, responding, values))
        if structure.nonlinear:
            from dynid.identification.results.write_joints import beyond_range

            if beyond := beyond_range(result):
                result.annotate("structure/time_response", note=beyond)
    add_geometry(result, model, structure, None if reduction is None else reduction.model)
    add_identification_scope(result, model, structure, reduction)
    return result


def estimates_alone(model: IdentificationScene, sample: Result) -> bool:
    """Return True if a sample of a study wants nothing but estimates."""
    if model.graph is not None or model.identifiability or model.measurement is None:
        return False
    if model.structure_analysis or model.responses:
        return False
    return not (sample.wants_below("structure") or wants_scope(sample, "identification"))


def responding_structure(scene: Scene) -> tuple[StructuralModel, dict[str, float]]:
    """Return the structure of the responses, reduced where the scene has a reduction, and its unknowns.

    These are the true ones where all are given, else the starts.
    """
    structure = structure_of(scene)
    method, values = reductor_of(scene), expected_values(structure)
    if method is None:
        return structure, values
    return method.at(values).reduce(started(scene, structure)).model, values


def started(scene: Scene[IdentificationScene], structure: StructuralModel) -> StructuralModel:
    """Return a structure as an estimator reduces it: its basis is made at the starts, not at the truth."""
    model = scene.model
    at_start = at_starts(model)
    return structure if at_start is model else structure_of(replace(scene, model=at_start))


class Setting(NamedTuple):
    """Input of `identify`: model and measurements, the model that simulates these, and its rebuilt bases."""

    model: Model
    measurements: Sequence[Any]
    truth: Model
    rebuild: Rebuild | None = None


def setting(
    scene: Scene[IdentificationScene], structure: StructuralModel, values: Mapping[str, float] | None = None
) -> Setting:
    """Return the model and the measurements of an identification.

    `values` are those of the parameters for which a basis that follows the joints is made; default: its own.
    """
    model = scene.model
    assert model.measurement is not None
    measurements = measurements_of(scene, structure)
    structure = _with_sensors(model, structure)
    if not (model.is_reduced or model.measurement.frf is not None or model.measurement.modes_alone):
        measured = (measurement for measurement in measurements if isinstance(measurement, Experiment))
        structure = without_massless(structure, [dof for record in measured for dof in record.dofs])
    method = reductor_of(scene)
    if method is None:
        return Setting(structure, measurements, structure)
    truth, records = structure, model.measurement.each
    simulate = (records[0].frf.simulate if records[0].frf else records[0].simulate) if records else None
    if simulate is not None and simulate.model == "reduced":
        truth = method.at(structure.true_values()).reduce(structure).model
    full = _with_sensors(model, started(scene, structure)) if at_starts(model) is not model else structure
    reductor = method if values is None else method.at(values)
    rebuild: Rebuild | None = None
    if method.follows_joints:

        def rebuild(values: Mapping[str, float]) -> Any:
            return method.at(values).reduce(full).model

    return Setting(reductor.reduce(full).model, measurements, truth, rebuild)


def _with_sensors(model: IdentificationScene, structure: StructuralModel) -> StructuralModel:
    """Return a structure under test with the masses of its sensors."""
    sensors = model.measurement.sensors if model.measurement is not None else []
    masses = {sensor.dof: sensor.mass.real for sensor in sensors if sensor.mass and sensor.dof is not None}
    if not masses:
        return structure
    from dynid.structure.sensor_masses import with_sensor_masses

    return with_sensor_masses(structure, masses)


def expected_values(structure: StructuralModel) -> dict[str, float]:
    """Return the true values of the unknowns where all are given, else their starts."""
    unknowns = structure.unknowns
    if all(unknown.true is not None for unknown in unknowns):
        return structure.true_values()
    return {unknown.name: unknown.start for unknown in unknowns}


def identified(
    scene: Scene[IdentificationScene],
    prepared: Setting,
    *,
    common: SharedRecords | None = None,
    into: Result | None = None,
) -> Result:
    """Return an identification with the reduced model where there is one; its basis may follow the joints.

    `common` is the precomputed part that its records share with others; estimates are added to `into`.
    """
    from dynid.identification.identify import identify

    model = scene.model
    return identify(
        prepared.model,
        prepared.measurements,
        estimator_of(model),
        truth=prepared.truth,
        rebuild=prepared.rebuild,
        common=common,
        into=into,
        further=further_of(model),
        held_out=_held_out(scene, prepared),
    )


def _held_out(scene: Scene[IdentificationScene], prepared: Setting) -> Sequence[HeldOut]:
    """Return the records that are held out, with the samples from which they are predicted."""
    measurement = scene.model.measurement
    if measurement is None or not measurement.held_out:
        return ()
    from dynid.identification.results.write_held_out import HeldOut

    assert isinstance(prepared.truth, StructuralModel)
    records = experiments(scene, scene.model.excitation, measurement, prepared.truth, held_out=True)
    samples = [record.initial_samples for record in measurement.each_held_out]
    return [HeldOut(*pair) for pair in zip(records, samples, strict=True)]


def preparation_steps(scene: Scene[IdentificationScene]) -> Iterator[PreparationStep]:
    """Yield the steps of a run before any computation: build the structure, its records and reduction."""
    model = scene.model
    measurement = model.measurement
    if model.graph is not None:
        from dynid.scene.kinds.identified_graphs import graph_preparation_steps

        yield from graph_preparation_steps(scene)
        return
    yield lambda: structure_of(scene)
    if measurement is not None and (modes := measurement.modes) is not None:
        from dynid.scene.kinds.modes import modal_measurement

        yield lambda: modal_measurement(scene, modes)
    if measurement is not None and measurement.frf is not None:
        yield lambda: frf_measurement(scene, measurement)
    elif measurement is not None and not measurement.modes_alone:
        yield lambda: experiments(scene, model.excitation, measurement)
        yield lambda: experiments(scene, model.excitation, measurement, held_out=True)
    if measurement is None or measurement.frf is None:  # else it reads the responses again
        yield lambda: reductor_of(scene)
    if model.structure_analysis is not None and model.structure_analysis.time is not None:
        yield lambda: time_question(scene)


def doubts(scene: Scene[IdentificationScene]) -> Iterator[Fault]:
    """Yield what nothing in a scene uses, as warnings: blocks of a graph's analysis, unconnected masses."""
    if scene.model.graph_analysis is not None:
        from dynid.scene.kinds.bond_graph import doubts as of_graph

        yield from of_graph(scene)
    yield from idle_masses(scene)


def unread_files(scene: Scene[IdentificationScene]) -> Iterator[KeyPath]:
    """Yield the keys whose files a run does not read: shared ones that no record uses."""
    model = scene.model
    records = model.measurement.records if model.measurement else []
    if records and all(record.simulate or (record.file and record.file.path) for record in records):
        yield ("measurement", "file")
    if records and all(record.excitation is not None for record in records):
        yield ("measurement", "excitation")
    model_records = model.measurement.each if model.measurement else []
    time = model.structure_analysis and model.structure_analysis.time
    drives = time and not (time.input or model.initial)
    if not drives and all(record.excitation is not None for record in model_records):
        yield ("excitation",)


def reductor_of(scene: Scene[IdentificationScene]) -> LocatedReductor | None:
    """Return the reduction of a scene, made for its sensors, loads and the band of its excitation."""
    model = scene.model
    if not model.is_reduced:
        return None
    from dynid.scene.kinds.reduction import build_reductor, reductor_by_parts

    method, interest, parts = reduction_of(scene), interest_of(scene), model.part_reductions
    first = reductor_by_parts(parts, interest) if any(parts.values()) else None
    return first if method is None else build_reductor(method, interest, "reduction", first)


def reduction_of(scene: Scene[IdentificationScene]) -> ReductionModel | None:
    """Return the reduction of a scene, with residual vectors where their choice is open.

    They are left out where the band of interest reaches half the sampling rate: there they gain nothing,
    and cost much.
    """
    model = scene.model
    if model.reduction is None:
        return None
    if model.measurement is not None and model.measurement.frf is None and model.measurement.each:
        step = min(float(record.step or math.inf) for record in model.measurement.each)
        if (interest_of(scene).band or math.inf) >= math.pi / step:
            return model.reduction
    from dynid.scene.kinds.reduction import with_residuals

    return with_residuals(model.reduction)


def interest_of(scene: Scene[IdentificationScene]) -> Interest:
    """Return the DOFs of sensors and loads, and the band of the excitation or the lines (rad/s)."""
    model = scene.model
    from dynid.structure.reduction.mode_selection import Interest

    dofs = [signal.dof for signal in model.excitation]
    band = None
    if model.measurement is not None and model.measurement.frf is not None:
        graph = None
        if model.graph is not None:
            from dynid.scene.kinds.identified_graphs import identified_graph

            graph = identified_graph(scene)[0]
        dofs += [dof for channel in model.measurement.sensors for dof in channel.all_dofs]
        band = float(frf_measurement(scene, model.measurement, graph).omega[-1])
    elif model.measurement is not None and model.measurement.modes_alone:
        from dynid.scene.kinds.modes import modal_measurement

        assert model.measurement.modes is not None
        modal = modal_measurement(scene, model.measurement.modes)
        dofs += modal.dofs
        if model.measurement.modes.amplitude_of is not None:
            dofs += model.measurement.modes.amplitude_of.ends
        band = float(modal.omega.max())
    elif model.measurement is not None:
        records = model.measurement.each
        signals = [*model.excitation, *(signal for record in records for signal in record.excitation or ())]
        dofs += [signal.dof for signal in signals]
        dofs += [dof for channel in model.measurement.sensors for dof in channel.ends]
        band = highest_frequency(signals, min(float(record.step or math.inf) for record in records))
    if model.structure_analysis is not None:
        dofs += [
            *(model.structure_analysis.inputs or ()),
            *(dof for output in model.structure_analysis.outputs or () for dof in output.ends),
            *(
                signal.dof
                for signal in (model.structure_analysis.time.input if model.structure_analysis.time else ())
            ),
        ]
        if band is None and model.structure_analysis.frequency is not None:
            band = float(angular_frequencies(model.structure_analysis.frequency)[-1])
    if model.responses is not None:
        asked = model.responses.harmonic_balance
        dofs += [asked.dof, asked.output]
        if band is None:
            band = angular_factor(asked.unit) * max(float(asked.start), float(asked.stop))
    return Interest(tuple(dict.fromkeys(dof for dof in dofs if dof is not None)), band)


#: The note on a time response that the excitation of the scene does not drive.
_FREE = (
    "the free response to the initial motion; the excitation is the record's, and a response that it drives "
    "names it under time: input"
)


def responses(
    scene: Scene, model: IdentificationScene, structure: StructuralModel, values: Mapping[str, float]
) -> Result:
    """Compute the responses, by default at the sensors to the forces that excite the record.

    With an initial motion and no input of its own the time response is the free one.
    """
    requested = model.structure_analysis
    assert requested is not None
    result = Result("identification", scene.title)
    if requested.modes is not None:
        from dynid.structure.modal_analysis import modal_analysis

        report_progress("modes")
        result.merge(modal_analysis(structure, *which_modes(requested.modes), values))
    if requested.campbell is not None:
        report_progress("Campbell diagram")
        _add_campbell(result, requested.campbell, structure, values)
    if requested.frequency is not None:
        forces = (signal for signal in model.excitation if signal.motion is None)
        driven = [force.dof for force in forces if force.dof is not None]
        sensors = model.measurement.sensors if model.measurement else []
        driven += [channel.reference.place for channel in sensors if channel.reference]
        inputs = list(dict.fromkeys(result_name(structure, dof) for dof in requested.inputs or driven))
        omega = angular_frequencies(requested.frequency)
        report_progress("frequency response")
        result.merge(frequency_response(structure, inputs, _outputs(model, structure), omega, values))
    if requested.time is not None:
        report_progress("time response")
        result.merge(time_response(structure, values=values, **time_question(scene, structure)))
        if model.initial and model.excitation and not requested.time.input:
            result.annotate("structure/time_response", note=_FREE)
    return result


def steady_states(
    model: IdentificationScene, structure: StructuralModel, values: Mapping[str, float]
) -> Result:
    """Compute the steady states that a scene requests."""
    from dynid.structure.nonlinear.steady_states import harmonic_balance

    assert model.responses is not None
    asked = model.responses.harmonic_balance
    factor = angular_factor(asked.unit)
    report_progress("harmonic balance")
    try:
        return harmonic_balance(
            structure,
            asked.dof,
            float(asked.amplitude),
            factor * float(asked.start),
            factor * float(asked.stop),
            values,
            output=asked.output,
            harmonics=asked.harmonics,
            points=asked.points,
            max_step=asked.max_step,
            stability=asked.stability,
            backbone=asked.backbone,
        )
    except DynidError as error:
        error.names = (*error.names, "responses.harmonic_balance")
        raise


def _add_campbell(
    result: Result, asked: CampbellModel, structure: StructuralModel, values: Mapping[str, float]
) -> None:
    """Add the Campbell diagram of a rotor."""
    from dynid.structure.rotors import add_campbell

    if structure.rotor is None:
        raise UsageError(
            "a Campbell diagram is of a rotor, whose gyroscopic moments grow with its speed",
            remedy="Give the 'matrices' of the structure a 'gyroscopic' one and a 'speed'.",
            names=("analysis.campbell",),
        )
    factor = angular_factor(asked.unit)
    ends = factor * float(asked.start or 0), factor * float(asked.stop)
    add_campbell(result, structure, np.linspace(*ends, asked.points), values, asked.modes)


def time_question(
    scene: Scene[IdentificationScene], structure: StructuralModel | None = None
) -> dict[str, Any]:
    """Return the loads, outputs, times and initial motion of the time response of a scene.

    Without an input of its own it is driven by the excitation, or by nothing with an initial motion.
    """
    model = scene.model
    requested = model.structure_analysis
    assert requested is not None
    assert requested.time is not None
    record, signals, where = record_of(requested.time), requested.time.input, "analysis.time.input"
    if not (signals or model.initial):
        signals, where = model.excitation, "excitation"
    loads = loads_of(scene, where, signals, record, structure)
    motion = initial_motion(model, structure)
    return {"loads": loads, "outputs": _outputs(model, structure), "times": record.times, **motion}


def which_modes(asked: ResponseModes) -> tuple[int | None, float | None]:
    """Return the requested number of modes, and the highest frequency (rad/s)."""
    factor = angular_factor(asked.unit)
    return asked.count, None if asked.below is None else factor * float(asked.below)


def _outputs(model: IdentificationScene, structure: StructuralModel | None) -> list[Channel]:
    sensors = model.measurement.sensors if model.measurement else []
    outputs = (model.structure_analysis and model.structure_analysis.outputs) or sensors
    return list(dict.fromkeys(channel_of(item, structure) for item in outputs))
