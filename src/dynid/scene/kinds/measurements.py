"""Records and frequency response functions of a scene's measurement."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from dynid.errors import FileError, UsageError
from dynid.scene.kinds.signals import angular_frequencies, build_signals, layout_of
from dynid.scene.kinds.structures import number
from dynid.scene.schema.signals import FileSignal
from dynid.structure.response import Channel, Load

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np
    from numpy.typing import NDArray

    from dynid.arithmetic.dependent import Real
    from dynid.identification.frf_measurement import Frf, FrfMeasurement
    from dynid.identification.graph_system import GraphModel
    from dynid.identification.measurement import Experiment, Measurement
    from dynid.identification.noise import ColouredNoise
    from dynid.identification.preparation import Preparation
    from dynid.lti.generator import RecordTimes
    from dynid.scene.load import Scene
    from dynid.scene.schema.base import Dof
    from dynid.scene.schema.identification import IdentificationScene
    from dynid.scene.schema.measurement import (
        ChannelModel,
        FrfModel,
        MeasurementModel,
        RecordModel,
    )
    from dynid.scene.schema.quantities import Quantity
    from dynid.scene.schema.signals import SignalPart
    from dynid.tables.frequency_responses import MeasuredResponses


def experiments(
    scene: Scene,
    excitation: Sequence[SignalPart],
    given: MeasurementModel,
    graph: GraphModel | None = None,
) -> list[Experiment]:
    """Return the records of a scene, prepared, with the loads of each; `graph`: that of the scene, if any."""
    from dynid.identification.measurement import Experiment
    from dynid.identification.preparation import BandPass, Decimate, Detrend, prepare
    from dynid.scene.schema.reduction import in_radians

    found = []
    for k, record in enumerate(given.each):
        place = f"measurement.records.{k}" if given.records else "measurement"
        measurement = _measurement(scene, record, place, graph)
        own = bool(given.records) and given.records[k].excitation is not None
        shared = f"{place}.excitation" if own else "measurement.excitation"
        where, parts = (
            ("excitation", excitation) if record.excitation is None else (shared, record.excitation)
        )
        experiment = Experiment(loads_of(scene, where, parts, measurement.record, graph), measurement)
        try:
            steps: list[Preparation] = []
            for step in record.prepare or []:
                if step.band_pass is not None:
                    low, high = (in_radians(float(edge), step.unit or "rad/s") for edge in step.band_pass)
                    order = {} if step.order is None else {"order": step.order}
                    steps.append(BandPass(low, high, **order))
                elif step.decimate is not None:
                    steps.append(Decimate(step.decimate))
                else:
                    steps.append(Detrend(1 if step.detrend == "linear" else 0))
            found.append(prepare(experiment, steps))
        except UsageError as error:
            where = _own_or_shared(scene, place, "prepare").rpartition(".")[0]
            names = [f"{where}.{name}" for name in error.names]
            raise UsageError(error.problem, remedy=error.remedy, names=names) from error
    return found


def _measurement(scene: Scene, given: RecordModel, place: str, graph: GraphModel | None) -> Measurement:
    """Return the channels and the samples of a record, or the noise of a simulated one."""
    from dynid.identification.measurement import Measurement
    from dynid.identification.simulation import Simulation

    channels = tuple(channel_of(channel, graph) for channel in given.channels or ())
    step, samples = number(given.step), given.samples or 0
    source: Simulation | NDArray[np.float64]
    if given.simulate is not None:
        simulate = given.simulate
        source = Simulation(
            levels(simulate.noise_ratio) or 0.0,
            simulate.seed,
            number(simulate.settle),
            levels(simulate.noise),
            noise_colour=tuple(float(one) for one in simulate.noise_colour),
        )
        if graph is None:
            source = replace(source, **initial_motion(cast("IdentificationScene", scene.model)))  # type: ignore[arg-type]
    else:
        from dynid.tables.read import read_columns

        assert given.file is not None
        path, where = scene.folder / (given.file.path or ""), _own_or_shared(scene, place, "file")
        layout, columns = layout_of(given.file), given.file.columns
        table = read_columns(path, columns, step=step, place=where, layout=layout, rows=samples or None)
        if table.shape[1] != len(channels):
            raise FileError(
                f"{path} has {table.shape[1]} columns of numbers, 'channels' has {len(channels)}",
                remedy="Name the columns: file: {path: …, columns: […]}.",
                names=(f"{where}.columns",),
            )
        if len(table) < samples:
            raise FileError(
                f"{path} has {len(table)} samples, but the scene asks for {samples}",
                remedy="Ask for no more samples than there are.",
                names=(f"{where}.path",),
            )
        source = table[:samples]
    return Measurement(step, samples, channels, source, noise_of(given))


def initial_motion(model: IdentificationScene) -> dict[str, dict[Dof, float]]:
    """Return the displacements and velocities at t = 0, by DOF."""
    return {
        "displacement": {dof: number(motion.x) for dof, motion in model.initial.items()},
        "velocity": {dof: number(motion.v) for dof, motion in model.initial.items()},
    }


def channel_of(given: ChannelModel, graph: GraphModel | None = None) -> Any:
    """Return a sensor of a structure, or of a graph."""
    if graph is not None:
        assert given.output is not None
        return graph.channel(given.output, *instrument_of(given))
    assert given.quantity is not None
    dof, reference = given.ends[0], given.dofs[1] if given.dofs else None
    return Channel(dof, given.quantity, reference, given.frame == "absolute", *instrument_of(given))


def instrument_of(given: ChannelModel) -> tuple[Real, Real, Real]:
    """Return gain, offset and delay of a sensor."""
    gain, offset, delay = (getattr(given, key, None) for key in ("gain", "offset", "delay"))
    return (
        1.0 if gain is None else gain.real,
        0.0 if offset is None else offset.real,
        0.0 if delay is None else delay.real,
    )


def noise_of(given: RecordModel) -> float | list[float] | ColouredNoise | None:
    """Return the deviation of white noise, or coloured noise."""
    from dynid.identification.noise import ColouredNoise
    from dynid.scene.schema.measurement import NoiseModel

    if not isinstance(given.noise, NoiseModel):
        return levels(given.noise)
    order = given.noise.order
    return ColouredNoise(order if isinstance(order, int) else None, given.noise.correlated)


def levels(given: Quantity | list[Quantity] | None) -> float | list[float] | None:
    """Return one number, or one a channel."""
    if given is None:
        return None
    return [float(level) for level in given] if isinstance(given, list) else float(given)


def _own_or_shared(scene: Scene, place: str, key: str) -> str:
    """Return the dotted path of a key of a record: its own, or that of all records."""
    found: Any = scene.source.data
    for part in place.split("."):
        found = found[int(part) if isinstance(found, list) else part]
    return f"{place}.{key}" if key in found else f"measurement.{key}"


def loads_of(
    scene: Scene,
    where: str,
    parts: Sequence[SignalPart],
    record: RecordTimes,
    graph: GraphModel | None = None,
) -> list[Any]:
    """Return the loads at a place of a scene."""
    loads: list[Any] = []
    for part, signal in build_signals(scene, where, parts, record):
        if graph is None:
            loads.append(Load(part.dof, signal, part.base or part.motion, *actuator_of(part)))
        else:
            loads.append(graph.load(str(part.source), signal, *actuator_of(part)))
    return loads


def actuator_of(part: SignalPart) -> tuple[Real, Real]:
    """Return gain and delay with which a signal acts.

    A signal in a file was recorded: it is gain times what acts, delay later.
    """
    gain = 1.0 if part.gain is None else part.gain.real
    delay = 0.0 if part.delay is None else part.delay.real
    return (1.0 / gain, -delay) if isinstance(part, FileSignal) else (gain, delay)


_PLACE = "measurement.frf.file"


def frf_measurement(scene: Scene, given: MeasurementModel, graph: GraphModel | None = None) -> FrfMeasurement:
    """Return the frequency response functions of a scene; `graph`: that of the scene, if any.

    Raises
    ------
    FileError
        Where measured responses cannot be read.
    UsageError
        Where they are inconsistent.
    """
    from dynid.identification.frf_measurement import Frf, FrfMeasurement
    from dynid.identification.simulation import Simulation
    from dynid.scene.schema.measurement import NoiseModel

    assert given.frf is not None
    channels = tuple(
        Frf(channel_of(channel, graph), channel.reference.place)
        for channel in given.channels or ()
        if channel.reference
    )
    proportional = isinstance(given.noise, NoiseModel)
    noise = levels(given.noise.ratio if isinstance(given.noise, NoiseModel) else given.noise)
    simulate = given.frf.simulate
    if simulate is not None:
        added = levels(simulate.noise_ratio) or 0.0, simulate.seed, 0.0, levels(simulate.noise)
        source = Simulation(*added, noise_by_line=simulate.noise_by_line)
        omega = angular_frequencies(simulate.lines)
        return FrfMeasurement(omega, channels, source, noise, proportional=proportional)
    found = _read(scene, given.frf, channels)
    deviation, relative = found.deviation, False
    if found.coherence is not None:
        # Of the estimate H1 from n averages: J. S. Bendat, A. G. Piersol, Random Data, 4th ed. 2010, eq 9.57.
        averages = given.frf.file.averages if given.frf.file else None
        relative = averages is None
        spread = np.sqrt((1 - found.coherence) / found.coherence / (averages or 1))
        deviation = np.abs(found.values) * spread
    return FrfMeasurement(found.omega, channels, found.values, noise, deviation, relative, proportional)


def _read(scene: Scene, given: FrfModel, channels: tuple[Frf, ...]) -> MeasuredResponses:
    """Return the responses in the file of a scene: lines of the band in rad/s, one column a channel."""
    from dynid.tables.frequency_responses import ResponseLayout, read_responses

    file = given.file
    assert file is not None
    path = scene.folder / file.path
    layout = ResponseLayout(file.columns, file.frequency, file.deviation, file.coherence)
    found = read_responses(path, layout, _PLACE)
    for name, columns in found.columns.items():
        if columns.shape[1] != len(channels):
            key = name if name != "values" else "columns"
            raise FileError(
                f"{path} has {columns.shape[1]} frequency responses, 'channels' has {len(channels)}"
                if name == "values"
                else f"{path}: '{name}' names {columns.shape[1]} columns, 'channels' has {len(channels)}",
                remedy="Name one for each channel: frf: {file: {path: …, columns: […]}}.",
                names=(f"{_PLACE}.{key}", f"{_PLACE}.path"),
            )
    for place, (quantity, channel) in enumerate(zip(found.quantities, channels, strict=False), 1):
        if quantity and quantity != channel.channel.quantity:
            raise FileError(
                f"{path}: function {place} is {quantity} over force, but the channel {channel.name} is not",
                remedy=f"Write quantity: {quantity}.",
                names=("measurement.channels", f"{_PLACE}.path"),
            )
    unit = given.unit or ("Hz" if found.in_hertz else "rad/s")
    found = found._replace(omega=found.omega * (2 * math.pi if unit == "Hz" else 1.0))
    if given.band is None:
        return found
    factor = 2 * math.pi if given.unit == "Hz" else 1.0
    low, high = (factor * float(edge) for edge in given.band)
    here = (found.omega >= low) & (found.omega <= high)
    if not here.any():
        raise FileError(
            f"no line lies in the band; they go from {found.omega[0] / factor:.6g} to "
            f"{found.omega[-1] / factor:.6g} {given.unit or 'rad/s'}",
            names=("measurement.frf.band",),
        )
    return found.at(here)
