"""From a scene's measurement to the records that joints are identified from."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

from dynid.errors import FileError, UsageError
from dynid.scene.kinds.grids import build_signals, layout_of
from dynid.scene.kinds.structures import number
from dynid.structure.response import Channel, Load

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np
    from numpy.typing import NDArray

    from dynid.identification.measurement import Experiment, Measurement
    from dynid.identification.preparation_steps import Preparation
    from dynid.lti.generator import Record
    from dynid.scene.load import Scene
    from dynid.scene.schema.common import Dof, SignalPart
    from dynid.scene.schema.identification import IdentificationScene
    from dynid.scene.schema.measurement import (
        ChannelModel,
        MeasuredFileModel,
        MeasurementModel,
        PrepareModel,
        RecordModel,
    )
    from dynid.scene.schema.quantities import Quantity


def experiments(scene: Scene, excitation: Sequence[SignalPart], given: MeasurementModel) -> list[Experiment]:
    """Return the records of a scene with the loads of each."""
    from dynid.identification.measurement import Experiment

    found = []
    for k, record in enumerate(given.each):
        place = f"measurement.records.{k}" if given.records else "measurement"
        measurement = _measurement(scene, record, place)
        own = bool(given.records) and given.records[k].excitation is not None
        shared = f"{place}.excitation" if own else "measurement.excitation"
        where, parts = (
            ("excitation", excitation) if record.excitation is None else (shared, record.excitation)
        )
        experiment = Experiment(loads_of(scene, where, parts, measurement.record), measurement)
        found.append(_prepared(scene, experiment, record.prepare or [], place))
    return found


def _prepared(scene: Scene, experiment: Experiment, given: Sequence[PrepareModel], place: str) -> Experiment:
    """Return a record prepared as the scene says; a step that makes no sense is placed in it."""
    from dynid.identification.preparation import prepare

    try:
        return prepare(experiment, [_preparation(step) for step in given])
    except UsageError as error:
        where = _own_or_shared(scene, place, "prepare").rpartition(".")[0]
        names = [f"{where}.{name}" for name in error.names]
        raise UsageError(error.problem, remedy=error.remedy, names=names) from error


def _preparation(given: PrepareModel) -> Preparation:
    from dynid.identification.preparation_steps import BandPass, Decimate, Detrend
    from dynid.scene.schema.reductions import in_radians

    if given.band_pass is not None:
        low, high = (in_radians(float(edge), given.unit or "rad/s") for edge in given.band_pass)
        return BandPass(low, high) if given.order is None else BandPass(low, high, given.order)
    if given.decimate is not None:
        return Decimate(given.decimate)
    return Detrend(1 if given.detrend == "linear" else 0)


def _measurement(scene: Scene, given: RecordModel, place: str) -> Measurement:
    from dynid.identification.measurement import Measurement, Simulation

    channels = tuple(channel_of(channel) for channel in given.channels or ())
    step, samples = number(given.step), given.samples or 0
    source: Simulation | NDArray[np.float64]
    if given.simulate is not None:
        simulate = given.simulate
        source = Simulation(
            levels(simulate.noise_ratio) or 0.0,
            simulate.seed,
            number(simulate.settle),
            levels(simulate.noise),
            **initial_motion(cast("IdentificationScene", scene.model)),
        )
    else:
        assert given.file is not None
        source = _measured(scene, given.file, (samples, len(channels)), step, place)
    return Measurement(step, samples, channels, source, levels(given.noise))


def initial_motion(model: IdentificationScene) -> dict[str, dict[Dof, float]]:
    """Return the displacements and velocities at t = 0, by DOF."""
    return {
        "displacement": {dof: number(motion.x) for dof, motion in model.initial.items()},
        "velocity": {dof: number(motion.v) for dof, motion in model.initial.items()},
    }


def channel_of(given: ChannelModel) -> Channel:
    """Return a sensor."""
    return Channel(
        given.ends[0], given.quantity, given.dofs[1] if given.dofs else None, given.frame == "absolute"
    )


def levels(given: Quantity | list[Quantity] | None) -> float | list[float] | None:
    """Return one number, or one a channel."""
    if given is None:
        return None
    return [float(level) for level in given] if isinstance(given, list) else float(given)


def _measured(
    scene: Scene, file: MeasuredFileModel, shape: tuple[int, int], step: float, place: str
) -> NDArray[np.float64]:
    """Read the samples of a record (samples x channels)."""
    from dynid.scene.kinds.tables import read_columns

    path, where = scene.folder / (file.path or ""), _own_or_shared(scene, place, "file")
    table = read_columns(path, file.columns, step=step, place=where, layout=layout_of(file))
    if table.shape[1] != shape[1]:
        raise FileError(
            f"{path} has {table.shape[1]} columns of numbers, 'channels' has {shape[1]}",
            remedy="Name the columns: file: {path: …, columns: […]}.",
            names=(f"{where}.columns",),
        )
    if len(table) < shape[0]:
        raise FileError(
            f"{path} has {len(table)} samples, but the scene asks for {shape[0]}",
            remedy="Ask for no more samples than there are.",
            names=(f"{where}.path",),
        )
    return table[: shape[0]]


def _own_or_shared(scene: Scene, place: str, key: str) -> str:
    """Return where a key of the record at a dotted place of a scene stands: there, or for all records."""
    found: Any = scene.source.data
    for part in place.split("."):
        found = found[int(part) if isinstance(found, list) else part]
    return f"{place}.{key}" if key in found else f"measurement.{key}"


def loads_of(scene: Scene, where: str, parts: Sequence[SignalPart], record: Record) -> list[Load]:
    """Return the loads that stand at a place of a scene."""
    return [
        Load(part.dof, signal, part.base or part.motion)
        for part, signal in build_signals(scene, where, parts, record)
    ]
