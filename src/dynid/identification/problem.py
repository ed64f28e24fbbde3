"""An identification problem: measurements, the model that is to explain them, and their likelihood.

Records of time and sets of frequency responses stand alone or with measured modes; all share the parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, NamedTuple, Self, TypeAlias, cast

import numpy as np

from dynid.arrays import Array, guarded
from dynid.errors import DynidError, UsageError
from dynid.identification.information import Information
from dynid.identification.likelihood.frf_record import FrfLikelihood, FrfRecord
from dynid.identification.likelihood.likelihood import Likelihood
from dynid.identification.likelihood.record_likelihood import RecordLikelihood
from dynid.identification.likelihood.time_record import TimeLikelihood, TimeRecord
from dynid.identification.records.frf_measurement import FrfMeasurement
from dynid.identification.records.measurement import Experiment, RecordData, Simulation, sampled_loads
from dynid.identification.records.modal_measurement import Backbone, ModalMeasurement
from dynid.identification.systems.frf_system import check_cost, frf_data
from dynid.identification.systems.instruments import Instruments, with_spreads
from dynid.identification.systems.parametric_model import (
    Model,
    ParametricModel,
    Rebuild,
    parametric_model,
    unknowns_of,
)
from dynid.identification.systems.record_values import data, simulated
from dynid.identification.systems.structure_system import StructureSystem
from dynid.parameters import named, rates, starts, values
from dynid.structure.matrices import Label
from dynid.structure.model import StructuralModel

if TYPE_CHECKING:
    from dynid.identification.likelihood.modal_record import ModalRecord

# How far from the starts parameters are looked for that hide there, in units: by a factor of 1.3 to 1.6.
_START_OFFSET = 0.25

Measured: TypeAlias = Experiment | FrfMeasurement | ModalMeasurement
"""A record of time with its loads, a set of frequency responses, or a modal survey."""


@dataclass(frozen=True, eq=False)
class SharedRecords:
    """Noise-free records, models and likelihood shared by identifications that differ in noise alone."""

    # Of each record the values without noise (times x channels); None of one that is not simulated.
    clean: Sequence[Array | None]
    models: Sequence[ParametricModel] = ()  # the model of each record; none where models differ
    # The records without their noise, and their origin; None where models differ.
    ideal: Likelihood | None = None
    origin: Origin | None = None

    @classmethod
    def of(
        cls, model: Model, experiments: Sequence[Experiment], truth: Model, *, same: bool
    ) -> SharedRecords:
        """Simulate the records without noise; `same`: build also the models, which are the same in all.

        Raises DynidError as of `identify`.
        """
        with guarded("what the records share"):
            clean = [
                simulated(truth, *experiment).outputs
                if isinstance(experiment.measurement.source, Simulation)
                else None
                for experiment in experiments
            ]
            if not same or any(values is None for values in clean):
                return cls(clean)
            models = [_model_of_record(model, experiment) for experiment in experiments]
            records_built = zip(models, experiments, clean, strict=True)
            records = tuple(
                _record_class(built).of(
                    built, data(truth, *experiment, values).without_noise(), experiment, len(models)
                )
                for built, experiment, values in records_built
            )
            ideal = TimeLikelihood(records)
            return cls(clean, models, ideal, identifiable_origin(ideal))


@dataclass(frozen=True, eq=False)
class Problem:
    """Measurements and the model that is to explain them."""

    model: Model  # the model that the estimator begins with
    measurements: tuple[Measured, ...]  # the measurements, a modal survey last
    likelihood: Likelihood  # their likelihood with that model
    truth: Model  # the model that simulated measurements are made with
    # Returns the model for parameters by name: a reduced one whose basis follows them; None where it stays.
    rebuild: Rebuild | None
    full: Model  # the model as it was given; sparse where a modal survey needs that
    modes: int = 0  # number of modes of the model that are computed for a modal survey
    shared_origin: Origin | None = None  # the origin, if others share it; it is of `likelihood.noiseless`

    @classmethod
    def of(
        cls,
        model: Model,
        measurements: Measured | Sequence[Measured],
        *,
        truth: Model | None = None,
        rebuild: Rebuild | None = None,
        common: SharedRecords | None = None,
    ) -> Self:
        """Return the problem; parameters and errors as of `identify`."""
        unknowns_of(model)
        measured = _in_order(measurements)
        if isinstance(model, StructuralModel) and model.nonlinear:
            _check_laws(measured)
        full, modes = model, 0
        if isinstance(survey := measured[-1], ModalMeasurement):
            assert isinstance(model, StructuralModel)
            if survey.backbone is not None:
                measured = *measured[:-1], _with_modes(model, survey, survey.backbone)
            else:
                full, model, modes, rebuild = _for_survey(model, survey, rebuild, alone=len(measured) == 1)
        truth = truth or full
        clean = [None] * len(measured) if common is None else common.clean
        values = [_values(truth, *pair) for pair in zip(measured, clean, strict=True)]
        model = _with_spreads(model, measured, values)
        if isinstance(model, StructuralModel) and model.nonlinear:
            model = _with_law_spreads(model, measured, values)
        problem = cls(model, measured, Likelihood(()), truth, rebuild, full, modes)
        # Spreads of offsets and delays are those of each record: models that have others are not shared.
        if common is not None and common.models and common.models[0].unknowns == model.unknowns:
            shared = zip(common.models, values, problem.experiments, strict=True)
            records = tuple(_record_class(record[0]).of(*record, len(values)) for record in shared)
            likelihood = TimeLikelihood(records, noiseless=common.ideal)
            return replace(problem, likelihood=likelihood, shared_origin=common.origin)
        return replace(problem, likelihood=problem.likelihood_of(model, values))

    @property
    def origin(self) -> Origin:
        """The origin of the estimation."""
        ideal = self.likelihood.ideal
        if self.shared_origin is not None and ideal is self.likelihood.noiseless:
            return self.shared_origin
        return identifiable_origin(ideal)

    @property
    def survey(self) -> ModalRecord | None:
        """The modal survey with the model that the estimator begins with; None where there is none."""
        last = self.likelihood.records[-1]
        return cast("ModalRecord", last) if last.modal else None

    @property
    def experiments(self) -> list[Experiment]:
        """The records of time."""
        return [measurement for measurement in self.measurements if isinstance(measurement, Experiment)]

    @property
    def dofs(self) -> list[Label]:
        """DOFs of loads and sensors of records and frequency responses."""
        dofs: list[Label] = []
        for measurement in self.measurements:
            if isinstance(measurement, Experiment):
                dofs += measurement.dofs
            elif isinstance(measurement, FrfMeasurement):
                dofs += [dof for frf in measurement.channels for dof in (frf.channel.dof, frf.force)]
        return list(dict.fromkeys(dofs))

    def likelihood_of(self, model: Model, values: Sequence[RecordData]) -> Likelihood:
        """Return the likelihood of values of the measurements with another model; a survey has its own.

        Raises UsageError if there is more to solve than can be.
        """
        pairs = zip(self.measurements, values, strict=True)
        records = tuple(self.record(model, measurement, record) for measurement, record in pairs)
        if all(isinstance(record, TimeRecord) for record in records):
            return TimeLikelihood(cast("tuple[TimeRecord, ...]", records))
        if all(isinstance(record, FrfRecord) for record in records):
            return FrfLikelihood(cast("tuple[FrfRecord, ...]", records))
        return Likelihood(records)

    def record(self, model: Model, measurement: Measured, values: RecordData) -> RecordLikelihood:
        """Return the likelihood of values of one measurement with a model."""
        sharing = len(self.measurements)
        if isinstance(measurement, Experiment):
            built = _model_of_record(model, measurement)
            return _record_class(built).of(built, values, measurement, sharing)
        if isinstance(measurement, FrfMeasurement):
            return FrfRecord.of(model, measurement, values, sharing)
        from dynid.identification.likelihood.modal_record import ModalRecord  # of modal surveys alone

        assert isinstance(model, StructuralModel)
        return ModalRecord.of(model, measurement, self.modes, sharing)

    def weighted(self) -> Self:
        """Return the problem in which a proportional noise is one in proportion to the measured responses."""
        records = [
            record.first_weighted() if isinstance(record, FrfRecord) else record
            for record in self.likelihood.records
        ]
        measurements = tuple(
            record.measurement if isinstance(record, FrfRecord) else measurement
            for record, measurement in zip(records, self.measurements, strict=True)
        )
        return replace(
            self, measurements=measurements, likelihood=replace(self.likelihood, records=tuple(records))
        )


def _check_laws(measured: Sequence[Measured]) -> None:
    """Refuse measurements that are linear by nature."""
    if not all(
        isinstance(measurement, Experiment)
        or (isinstance(measurement, FrfMeasurement) and all(frf.amplitude for frf in measurement.channels))
        or (isinstance(measurement, ModalMeasurement) and measurement.backbone is not None)
        for measurement in measured
    ):
        raise UsageError(
            "frequency responses and modes are linear: they cannot identify nonlinear laws of joints",
            remedy="State the 'amplitude' of the force in each 'reference' of a stepped sine, or of each "
            "mode of a backbone; identify from records of time; or leave out the 'laws': k and c are then "
            "those at the amplitude of the test.",
            names=("measurement.frf", "measurement.modes", "measurement"),
        )


def _in_order(measurements: Measured | Sequence[Measured]) -> tuple[Measured, ...]:
    """Return measurements with a modal survey last."""
    if isinstance(measurements, Experiment | FrfMeasurement | ModalMeasurement):
        measurements = (measurements,)
    if not measurements:
        raise UsageError("there is no record to identify from", names=("measurement",))
    kinds = [type(measurement) for measurement in measurements]
    if kinds.count(FrfMeasurement) > 1 or kinds.count(ModalMeasurement) > 1:
        raise UsageError("frequency responses, and modes, are one measurement each", names=("measurement",))
    if FrfMeasurement in kinds and Experiment in kinds:
        raise UsageError(
            "modes are identified with records of time or with frequency responses, not with both",
            remedy="Leave one of them out.",
            names=("measurement.frf",),
        )
    return tuple(sorted(measurements, key=lambda single: isinstance(single, ModalMeasurement)))


def _for_survey(
    model: StructuralModel, survey: ModalMeasurement, rebuild: Rebuild | None, *, alone: bool
) -> tuple[StructuralModel, StructuralModel, int, Rebuild | None]:
    """Return a structure stored for a modal survey, the model, how many modes of it, and its rebuilding."""
    from dynid.identification.likelihood.paired_modes import is_large, modal_model, modes_needed

    full, start = model, named(model.unknowns, starts(model.unknowns))
    if alone and is_large(model) and not model.is_sparse and model.basis is None:
        full = model = model.stored_sparse()
    count = modes_needed(model, survey, start)
    if alone and rebuild is None and is_large(model):
        rebuild = partial(modal_model, full, survey, count=count)
        model = rebuild(start)
    return full, model, count, rebuild


def _with_modes(model: StructuralModel, survey: ModalMeasurement, backbone: Backbone) -> ModalMeasurement:
    """Return a backbone whose points have their modes: without a number the nearest at rest, at the starts.

    Raises UsageError if the joints have no laws.
    """
    if not model.nonlinear:
        raise UsageError(
            "modes are measured at amplitudes, but no joint has a law: they would all be equal",
            remedy="State the 'laws' of a joint, or leave the amplitudes out.",
            names=("measurement.modes.amplitude_of", "measurement.modes"),
        )
    from dynid.structure.nonlinear.harmonic_balance import condensed

    check_cost(model, survey.modes)
    at_rest = condensed(model, named(model.unknowns, starts(model.unknowns)), float(np.mean(survey.omega)))
    omega = np.sqrt(np.maximum(at_rest.eigenvalues, 0.0))
    nearest = np.abs(omega - survey.omega[:, None]).argmin(axis=1)
    mode = np.where(np.isnan(backbone.mode), nearest, backbone.mode)
    return replace(survey, backbone=backbone._replace(mode=mode))


def _values(truth: Model, measurement: Measured, clean: Array | None) -> RecordData:
    """Return the values of a measurement, simulated where they are to be; those of modes are its own."""
    if isinstance(measurement, Experiment):
        return data(truth, *measurement, clean)
    if isinstance(measurement, FrfMeasurement):
        return frf_data(truth, measurement)
    return RecordData(np.zeros((0, 0)))


def _with_spreads(model: Model, measurements: Sequence[Measured], values: Sequence[RecordData]) -> Model:
    """Return the model whose offsets and delays have the spread that these records allow."""
    unknowns = {unknown.name: unknown for unknown in model.unknowns}
    if all(unknown.logarithmic for unknown in unknowns.values()):
        return model
    for experiment, record in zip(measurements, values, strict=True):
        if isinstance(experiment, Experiment):
            channels, step = experiment.measurement.channels, experiment.measurement.step
            instruments = Instruments.of(tuple(unknowns), experiment.loads, channels)
            spread = with_spreads(tuple(unknowns.values()), instruments, step, record.rms)
            unknowns = {unknown.name: unknown for unknown in spread}
    return model.with_parameters([unknowns.get(parameter.name, parameter) for parameter in model.parameters])


def _with_law_spreads(
    model: StructuralModel, measurements: Sequence[Measured], values: Sequence[RecordData]
) -> StructuralModel:
    """Return the model whose parameters of laws that start at 0 have the spread of their effect.

    An offset may be as large as the deflection at the starts, another one change the response by its size.
    """
    names = {
        unknown.name
        for unknown in model.law_unknowns
        if not unknown.logarithmic and unknown.start == 0 and unknown.prior is None
    }
    if not names or not isinstance(measurements[0], Experiment):
        return model
    from dynid.identification.likelihood.nonlinear_record import NonlinearRecord
    from dynid.structure.model_laws import with_spreads

    record = NonlinearRecord.of(_model_of_record(model, measurements[0]), values[0], measurements[0], 1)
    fit = record.fit(starts(model.unknowns), record.data.values)
    effect = record.predicted(fit).by_parameter / record.data.rms[:, None]
    sizes = np.sqrt(np.mean(effect**2, axis=(0, 1)))
    spreads = {
        unknown.name: 1 / float(size)
        for unknown, size in zip(model.unknowns, sizes, strict=True)
        if unknown.name in names and size > 0
    }
    peaks = iter(np.abs(record.joint_motion(fit)[0]).max(axis=0).tolist())
    for joint in model.joints:
        peak = next(peaks) if joint.laws else 0.0
        spreads |= {name: peak for name, _ in joint.law_parameters[-1] if name in names and peak > 0}
    return model.joined(with_spreads(model.joints, spreads))


def _model_of_record(model: Model, experiment: Experiment) -> ParametricModel:
    """Return the model of a record, with its loads as an estimator knows them."""
    record = experiment.measurement.record
    loads = sampled_loads(experiment.loads, record)
    built = parametric_model(model, loads, experiment.measurement.channels, record.times)
    if built.system.delayed:
        from dynid.identification.systems.delayed_loops import check_rest

        check_rest(built.signals, record, experiment.measurement.prepared)
    return built


def _record_class(model: ParametricModel) -> type[TimeRecord]:
    """Return the class of the likelihood of a record with this model."""
    if not (isinstance(model.system, StructureSystem) and model.system.model.nonlinear):
        return TimeRecord
    from dynid.identification.likelihood.nonlinear_record import NonlinearRecord  # of joints with laws alone

    return NonlinearRecord


class Origin(NamedTuple):
    """The origin of an estimation: coordinates (p), and the parameters that the records do not determine."""

    eta: Array
    undetermined: tuple[str, ...]


def identifiable_origin(likelihood: Likelihood) -> Origin:
    """Return the starts, or coordinates nearby where these alone hide a parameter from the records.

    So do equal starts of interchangeable parameters, which are a stationary point between two optima.

    Raises NotIdentifiable if the records determine no parameter.
    """
    eta, unknowns = starts(likelihood.unknowns), likelihood.unknowns
    if any(record.origin_is_free for record in likelihood.records):
        return Origin(eta, ())
    rms = [record.data.rms for record in likelihood.records]

    def information_at(point: Array, likelihood: Likelihood = likelihood) -> Information:
        at_point = likelihood.information(likelihood.fit(point), rms)
        return replace(at_point, values=values(unknowns, point), rates=rates(unknowns, point))

    first = likelihood.shortened(eta)  # the whole records determine what their first parts do
    if first is not likelihood and not information_at(eta, first).dependent():
        return Origin(eta, ())
    information = information_at(eta)
    lost = information.dependent()
    if not lost:
        return Origin(eta, ())
    sides = np.where(np.arange(len(eta)) % 2, -1.0, 1.0) * (1 + np.arange(len(eta)) / (1 + len(eta)))
    for side in (sides, -sides[::-1]):
        nearby = likelihood.priors.clipped(eta + _START_OFFSET * side * likelihood.priors.units)
        try:
            with guarded("the prediction"):
                nearby_information = information_at(nearby)
        except DynidError:
            continue
        if len(fewer := nearby_information.dependent()) < len(lost):
            eta, information, lost = nearby, nearby_information, fewer
            if not lost:
                break
    if not np.isfinite(information.bounds()).any():
        information.check()
    return Origin(eta, tuple(unknowns[k].name for k in lost))
