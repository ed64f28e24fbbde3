"""Records and frequency response functions of a scene's measurement."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from dynid.arithmetic.dependent import Real
from dynid.errors import FileError, UsageError
from dynid.lti.generator import RecordTimes
from dynid.scene.kinds.signals import (
    angular_frequencies,
    build_signals,
    layout_of,
    of_stated_kind,
    products,
    recorded_factor,
    written_at,
)
from dynid.scene.kinds.structures import number
from dynid.scene.schema.base import Dof
from dynid.scene.schema.quantities import Quantity
from dynid.scene.schema.signals import FileSignal, SignalPart
from dynid.structure.model import StructuralModel
from dynid.structure.ports import Channel, ChannelClock, Load
from dynid.suggestions import shortened
from dynid.units import angular_factor

if TYPE_CHECKING:
    from dynid.files.frequency_responses import MeasuredResponses
    from dynid.files.read_measured import MeasuredColumns
    from dynid.files.table import Heading
    from dynid.identification.records.frf_measurement import Frf, FrfMeasurement
    from dynid.identification.records.measurement import Experiment, Measurement
    from dynid.identification.records.noise import ColouredNoise
    from dynid.identification.records.preparation import Preparation
    from dynid.identification.systems.graph_system import IdentifiedGraph
    from dynid.lti.filters import Filter
    from dynid.scene.load import Scene
    from dynid.scene.schema.identification import IdentificationScene
    from dynid.scene.schema.measurement import (
        ChannelModel,
        ClockModel,
        FrfModel,
        FurtherFileModel,
        MeasuredChannelModel,
        MeasuredFileModel,
        MeasurementModel,
        RecordModel,
        ReferenceModel,
    )

    Tested = IdentifiedGraph | StructuralModel | None


def experiments(
    scene: Scene,
    excitation: Sequence[SignalPart],
    model_of_records: MeasurementModel,
    model: Tested = None,
    *,
    held_out: bool = False,
) -> list[Experiment]:
    """Return the records of a scene, or those that are held out, prepared, with the loads of each.

    `model` is the graph or structure, by whose labels DOFs are named in results; default: as in the scene.
    """
    from dynid.identification.records.measurement import Experiment
    from dynid.identification.records.preparation import BandPass, Decimate, Detrend, prepare

    measured = []
    written: Sequence[RecordModel] = model_of_records.held_out if held_out else model_of_records.records
    key = "held_out" if held_out else "records"
    for k, record in enumerate(model_of_records.each_held_out if held_out else model_of_records.each):
        record_path = f"measurement.{key}.{k}" if written else "measurement"
        measurement, starts = _measurement(scene, record, record_path, model)
        excited_itself = bool(written) and written[k].excitation is not None
        shared = f"{record_path}.excitation" if excited_itself else "measurement.excitation"
        where, parts = (
            ("excitation", excitation) if record.excitation is None else (shared, record.excitation)
        )
        lasting = replace(measurement.record, samples=record.samples or 0)
        loads = loads_of(scene, where, parts, lasting, model, starts)
        experiment = Experiment(loads, measurement)
        try:
            steps: list[Preparation] = []
            for step in record.prepare or []:
                if step.band_pass is not None:
                    low, high = (angular_factor(step.unit) * float(edge) for edge in step.band_pass)
                    order = {} if step.order is None else {"order": step.order}
                    steps.append(BandPass(low, high, **order))
                elif step.decimate is not None:
                    steps.append(Decimate(step.decimate))
                else:
                    steps.append(Detrend(1 if step.detrend == "linear" else 0))
            measured.append(prepare(experiment, steps))
        except UsageError as error:
            where = _path_of_key(scene, record_path, "prepare").rpartition(".")[0]
            names = [f"{where}.{name}" for name in error.names]
            raise UsageError(error.problem, remedy=error.remedy, names=names) from error
    return measured


def _measurement(
    scene: Scene, record: RecordModel, record_path: str, model: Tested
) -> tuple[Measurement, dict[Path, float | None]]:
    """Return channels and samples of a record, or the noise of a simulated one; first times of its files."""
    from dynid.identification.records.measurement import Measurement, Simulation
    from dynid.identification.records.noise import ColouredNoise
    from dynid.scene.schema.measurement import NoiseModel

    channel_models, step, samples = record.channels or (), number(record.step), record.samples or 0
    channels = tuple(
        _with_clock(channel_of(channel, model), channel.clock, record) for channel in channel_models
    )
    _check_different(channels, f"{record_path}.channels", model)
    at = _path_of_key(scene, record_path, "channels")
    headings: list[Heading | None] = [None] * len(channels)
    starts: dict[Path, float | None] = {}
    if record.file is not None:
        table = _samples(scene, record, _path_of_key(scene, record_path, "file"))
        headings = list(table.headings)
        starts = {scene.folder / (record.file.path or ""): table.start}
    channels = tuple(map(of_stated_kind, channels, channel_models, headings))
    columns = zip(channel_models, headings, channels, strict=True)
    factors = [recorded_factor(*column, f"{at}.{k}") for k, column in enumerate(columns)]
    channels = tuple(
        channel._replace(offset=factor * channel.offset) if factor != 1 else channel
        for channel, factor in zip(channels, factors, strict=True)
    )
    source: Simulation | NDArray[np.float64]
    read: dict[str, Any] = {}
    if record.simulate is not None:
        simulate = record.simulate
        source = Simulation(
            levels(simulate.noise_ratio) or 0.0,
            simulate.seed,
            number(simulate.settle),
            products(factors, levels(simulate.noise)),
            noise_colour=tuple(float(coefficient) for coefficient in simulate.noise_colour),
        )
        if not any(channel.output for channel in record.channels or ()):
            source = replace(source, **initial_motion(scene.model, model))  # type: ignore[arg-type]
    else:
        source = table.values * factors
        read = {"notes": (table.note,) if table.note else ()}
        if table.clock is not None:
            read = {"clock": table.clock.summary, "notes": (*read["notes"], *table.clock.warnings())}
    noise: float | list[float] | ColouredNoise | None
    if isinstance(record.noise, NoiseModel):
        order = record.noise.order
        noise = ColouredNoise(order if isinstance(order, int) else None, record.noise.correlated)
    else:
        noise = products(factors, levels(record.noise))
    longest = max([samples, *(channel.clock.samples for channel in channels if channel.clock)])
    if longest > samples:
        plain = ChannelClock(step, samples)
        channels = tuple(channel._replace(clock=channel.clock or plain) for channel in channels)
    return Measurement(step, longest, channels, source, noise, **read), starts


def _with_clock(channel: Any, clock: ClockModel | None, record: RecordModel) -> Any:
    """Return a channel of a record with its own clock, if it has one."""
    if clock is None:
        return channel
    step, samples = number(clock.step or record.step), clock.samples or record.samples or 0
    drift = 0.0 if clock.drift is None else clock.drift.real
    return channel._replace(clock=ChannelClock(step, samples, number(clock.start), drift))


def _samples(scene: Scene, record: RecordModel, where: str) -> MeasuredColumns:
    """Return the columns of a record's files, one for each channel; NaN after the last sample of each."""
    from dynid.files.read_measured import check_starts, read_columns

    assert record.file is not None
    samples, step = record.samples or 0, number(record.step)
    channels = record.channels or ()
    beside = {f"{where}.beside.{k}": file for k, file in enumerate(record.file.beside)}
    places: dict[str, MeasuredFileModel | FurtherFileModel] = {where: record.file, **beside}
    tables: list[MeasuredColumns] = []
    first: float | None = None
    lasting = samples
    for place, file in places.items():
        path, read = scene.folder / (file.path or ""), sum(table.values.shape[1] for table in tables)
        stated = channels[min(read, len(channels) - 1)].clock
        clock = _with_clock(Channel(0, ""), stated, record).clock
        rows, own = (samples, step) if clock is None else (clock.samples, clock.step)
        table = read_columns(
            path, file.columns, step=own, scene_key=place, layout=layout_of(file), rows=rows or None
        )
        if len(table.values) < rows:
            raise FileError(
                f"{path} has {len(table.values)} samples, but the scene asks for {rows}",
                remedy="Ask for no more samples than there are.",
                names=(f"{place}.path",),
            )
        _check_clocks(path, place, channels[read : read + table.values.shape[1]])
        if stated is None or stated.start is None:  # else the file has times of its own
            check_starts(path, table.start, first, own, place)
            first = table.start if first is None else first
        lasting = max(lasting, rows)
        tables.append(table._replace(values=table.values[:rows]))
    count = sum(table.values.shape[1] for table in tables)
    if count != len(channels):
        path = scene.folder / (record.file.path or "")
        has = f"{path} has {count}" if len(tables) == 1 else f"the files of the record have {count}"
        raise FileError(
            f"{has} columns of numbers, 'channels' has {len(channels)}",
            remedy="Name the columns: file: {path: …, columns: […]}.",
            names=(f"{where}.columns",),
        )
    if len(tables) == 1:
        return tables[0]
    filled = [np.full((lasting, table.values.shape[1]), np.nan) for table in tables]
    for values, table in zip(filled, tables, strict=True):
        values[: len(table.values)] = table.values
    notes = [table.note for table in tables if table.note]
    notes += [text for table in tables[1:] if table.clock is not None for text in table.clock.warnings()]
    return tables[0]._replace(
        values=np.hstack(filled),
        headings=[heading for table in tables for heading in table.headings],
        note="; ".join(notes),
    )


def _check_clocks(path: Path, place: str, channels: Sequence[MeasuredChannelModel]) -> None:
    """Refuse columns of one file of which some have another clock."""
    clocks = [channel.clock and channel.clock.model_copy(update={"drift": None}) for channel in channels]
    if any(clock != clocks[0] for clock in clocks):
        raise FileError(
            f"{path}: its columns have different clocks",
            remedy="Name the file once for each clock: file: {path: …, columns: […], beside: [{path: …, "
            "columns: […]}]}.",
            names=(f"{place}.columns", f"{place}.path"),
        )


def initial_motion(model: IdentificationScene, structure: Tested = None) -> dict[str, dict[Dof, float]]:
    """Return the displacements and velocities at t = 0, by DOF."""
    motions = [(result_name(structure, dof), motion) for dof, motion in model.initial.items()]
    if len({_signed_label(structure, dof)[1] for dof, _ in motions}) < len(motions):
        said = "the initial motion of a DOF is given twice, by two of its names"
        raise UsageError(said, names=("initial",))
    return {
        "displacement": {dof: number(motion.x) for dof, motion in motions},
        "velocity": {dof: number(motion.v) for dof, motion in motions},
    }


def channel_of(channel_model: ChannelModel, model: Tested = None) -> Any:
    """Return a sensor of a structure, named by its DOFs' own labels where it is known; or of a graph."""
    if channel_model.output is not None:
        instrument = _instrument_of(channel_model)
        filters = _filters_of(channel_model)
        return cast("IdentifiedGraph", model).channel(channel_model.output, *instrument, filters)
    assert channel_model.quantity is not None
    dof, *others = (result_name(model, dof) for dof in channel_model.ends)
    reference = others[0] if others else None
    if reference is not None and _signed_label(model, reference) == _signed_label(model, dof):
        ends = " and ".join(map(str, channel_model.ends))
        said = f"a sensor between {ends} measures nothing: they are one DOF"
        raise UsageError(said, names=("measurement.channels",))
    absolute, kind = channel_model.frame == "absolute", kind_of(model, dof)
    instrument, filters = _instrument_of(channel_model), _filters_of(channel_model)
    return Channel(dof, channel_model.quantity, reference, absolute, *instrument, kind, filters)


def kind_of(model: Tested, dof: Dof | None) -> str:
    """Return the kind of a DOF where the structure is known, that of the ground; else nothing."""
    return "" if dof is None or not isinstance(model, StructuralModel) else model.kind(dof)


def result_name(model: Tested, dof: Dof) -> Dof:
    """Return the name of a DOF in results."""
    return model.dof_names.display_name(dof) if isinstance(model, StructuralModel) else dof


def _signed_label(model: Tested, dof: Dof) -> tuple[float, Dof]:
    """Return the sign of a DOF's name and its own label, the same by each of its names."""
    return model.dof_names.find_signed(dof) if isinstance(model, StructuralModel) else (1.0, dof)


def _with_labels(sensor: Any, model: Tested) -> Any:
    """Return a channel or response function with the own labels of its DOFs."""
    if isinstance(sensor, Channel):
        reference = None if sensor.reference is None else _signed_label(model, sensor.reference)
        return sensor._replace(dof=_signed_label(model, sensor.dof), reference=reference)  # type: ignore[arg-type]
    channel = getattr(sensor, "channel", None)
    if isinstance(channel, Channel):
        force = _signed_label(model, sensor.force)
        return sensor._replace(channel=_with_labels(channel, model), force=force)
    return sensor


def _check_different(channels: Sequence[Any], path: str, model: Tested) -> None:
    """Refuse a channel that stands twice, by two names of its DOF."""
    plain = [_with_labels(channel, model) for channel in channels]
    twice = next((channel for at, channel in enumerate(channels) if plain[at] in plain[:at]), None)
    if twice is not None:
        raise UsageError(f"the channel {twice.name} is listed twice", names=(path, "measurement"))


def _instrument_of(channel: ChannelModel) -> tuple[Real, Real, Real]:
    usual = {"gain": 1.0, "offset": 0.0, "delay": 0.0}
    stated = {key: getattr(channel, key, None) for key in usual}
    gain, offset, delay = (
        usual[key] if quantity is None else quantity.real for key, quantity in stated.items()
    )
    return gain, offset, delay


def _filters_of(channel: ChannelModel) -> tuple[Filter, ...]:
    """Return the stated filters of a channel, in the order in which they act."""
    stated = {kind: getattr(channel, kind, None) for kind in ("integrator", "high_pass", "low_pass")}
    if not any(stated.values()):
        return ()
    from dynid.lti.filters import Filter  # of filters alone

    return tuple(
        Filter(
            kind,  # type: ignore[arg-type]
            0.0 if item.frequency is None else angular_factor(item.unit) * item.frequency.real,
            item.order,
            getattr(item, "type", "butterworth"),
        )
        for kind, item in stated.items()
        if item is not None
    )


def levels(quantities: Quantity | list[Quantity] | None) -> float | list[float] | None:
    """Return one number, or one a channel."""
    if quantities is None:
        return None
    return [float(level) for level in quantities] if isinstance(quantities, list) else float(quantities)


def _path_of_key(scene: Scene, path: str, key: str) -> str:
    """Return the dotted path of a key of a record: its own, or that of all records."""
    return f"{path}.{key}" if key in written_at(scene, path) else f"measurement.{key}"


def loads_of(
    scene: Scene,
    where: str,
    parts: Sequence[SignalPart],
    record: RecordTimes,
    model: Tested = None,
    starts: Mapping[Path, float | None] | None = None,
) -> list[Any]:
    """Return the loads at a place of a scene; `starts` as of `build_signals`."""

    def acting(signal_model: SignalPart, signal: Any) -> Any:
        driven = _actuator_of(signal_model)
        if signal_model.source is not None:
            return cast("IdentifiedGraph", model).load(signal_model.source, signal, *driven)
        dof = None if signal_model.dof is None else result_name(model, signal_model.dof)
        return Load(dof, signal, signal_model.base or signal_model.motion, *driven, kind_of(model, dof))

    built = build_signals(
        scene, where, parts, record, lambda signal_model: acting(signal_model, None), starts
    )
    return [acting(signal_model, signal) for signal_model, signal in built]


def _actuator_of(signal: SignalPart) -> tuple[Real, Real]:
    """Return gain and delay with which a signal acts; in a file stands gain times what acts, delay later."""
    gain = 1.0 if signal.gain is None else signal.gain.real
    delay = 0.0 if signal.delay is None else signal.delay.real
    return (1.0 / gain, -delay) if isinstance(signal, FileSignal) else (gain, delay)


def _referred(model: Tested, reference: ReferenceModel) -> tuple[Dof] | tuple[Dof, str]:
    """Return the DOF, by its name in results, and its kind, or the source of a frequency response."""
    if reference.source is not None:
        return (reference.place,)
    dof = result_name(model, reference.place)
    return dof, kind_of(model, dof)


_PLACE = "measurement.frf.file"


def frf_measurement(scene: Scene, measurement: MeasurementModel, model: Tested = None) -> FrfMeasurement:
    """Return the frequency response functions of a scene; `model`: its graph or structure, if known.

    Raises `FileError` where measured responses cannot be read. Raises `UsageError` where they are
    inconsistent.
    """
    from dynid.identification.records.frf_measurement import Frf, FrfMeasurement
    from dynid.identification.records.measurement import Simulation
    from dynid.scene.schema.measurement import NoiseModel

    assert measurement.frf is not None
    channels = tuple(
        Frf(channel_of(channel, model), *_referred(model, channel.reference))._replace(
            amplitude=None if channel.reference.amplitude is None else float(channel.reference.amplitude),
            sweep=channel.reference.sweep or "up",
        )
        for channel in measurement.channels or ()
        if channel.reference
    )
    _check_different(channels, "measurement.channels", model)
    stated = measurement.noise
    proportional = isinstance(stated, NoiseModel)
    noise = levels(stated.ratio if isinstance(stated, NoiseModel) else stated)
    simulate = measurement.frf.simulate
    responses = None if simulate is not None else _read(scene, measurement.frf, channels)
    headings: Sequence[Heading | None] = responses.headings if responses is not None else ()
    columns = zip(measurement.channels or (), headings or [None] * len(channels), channels, strict=True)
    factors = [
        recorded_factor(channel, heading, function, f"measurement.channels.{k}")
        for k, (channel, heading, function) in enumerate(columns)
    ]
    coherence = measurement.frf.file is not None and measurement.frf.file.coherence is not None
    if not proportional and not coherence:  # else it is a ratio
        noise = products(factors, noise)
    if simulate is not None:
        added = products(factors, levels(simulate.noise))
        source = Simulation(
            *(levels(simulate.noise_ratio) or 0.0, simulate.seed, 0.0, added),
            noise_by_line=simulate.noise_by_line,
        )
        omega = angular_frequencies(simulate.lines)
        return FrfMeasurement(omega, channels, source, noise, proportional=proportional)
    assert responses is not None
    responses = responses._replace(values=responses.values * factors)
    deviation = None if responses.deviation is None else responses.deviation * np.abs(factors)
    relative = False
    if responses.coherence is not None:
        # Of the estimate H1 from n averages: J. S. Bendat, A. G. Piersol, Random Data, 4th ed. 2010, eq 9.57.
        averages = measurement.frf.file.averages if measurement.frf.file else None
        relative = averages is None
        spread = np.sqrt((1 - responses.coherence) / responses.coherence / (averages or 1))
        deviation = np.abs(responses.values) * spread
    notes = (responses.note,) if responses.note else ()
    return FrfMeasurement(
        *(responses.omega, channels, responses.values, noise, deviation, relative, proportional, notes),
        coherence=responses.coherence,
    )


def _read(scene: Scene, frf: FrfModel, channels: tuple[Frf, ...]) -> MeasuredResponses:
    """Return the responses in the file of a scene: lines of the band in rad/s, one column a channel."""
    from dynid.files.frequency_responses import ResponseLayout
    from dynid.files.read_measured import read_responses

    file = frf.file
    assert file is not None
    path = scene.folder / file.path
    layout = ResponseLayout(file.columns, file.frequency, file.deviation, file.coherence)
    responses = read_responses(path, layout, _PLACE)
    for name, columns in responses.columns.items():
        if columns.shape[1] != len(channels):
            key = name if name != "values" else "columns"
            raise FileError(
                f"{path} has {columns.shape[1]} frequency responses, 'channels' has {len(channels)}"
                if name == "values"
                else f"{path}: '{name}' names {columns.shape[1]} columns, 'channels' has {len(channels)}",
                remedy="Name one for each channel: frf: {file: {path: …, columns: […]}}.",
                names=(f"{_PLACE}.{key}", f"{_PLACE}.path"),
            )
    for column, (quantity, channel) in enumerate(zip(responses.quantities, channels, strict=False), 1):
        if quantity and quantity != channel.channel.quantity:
            raise FileError(
                f"{path}: function {column} is {quantity} over force, but the channel {channel.name} is not",
                remedy=f"Write quantity: {quantity}.",
                names=("measurement.channels", f"{_PLACE}.path"),
            )
    responses = responses._replace(omega=responses.omega * _in_radians(responses, frf))
    if frf.band is None:
        _check_coherence(path, responses, frf, np.ones(len(responses.omega), dtype=bool))
        return responses
    factor = angular_factor(frf.unit)
    low, high = (factor * float(edge) for edge in frf.band)
    here = (responses.omega >= low) & (responses.omega <= high)
    if not here.any():
        raise FileError(
            f"no line lies in the band; they go from {responses.omega[0] / factor:.6g} to "
            f"{responses.omega[-1] / factor:.6g} {frf.unit or 'rad/s'}",
            names=("measurement.frf.band",),
        )
    note = _check_coherence(path, responses, frf, here)
    return responses.at(here)._replace(note=note)


def _check_coherence(path: Path, responses: MeasuredResponses, frf: FrfModel, used: NDArray[np.bool_]) -> str:
    """Return a warning of impossible coherences at lines that are not used; others raise `FileError`."""
    if responses.coherence is None:
        return ""
    wrong = (responses.coherence <= 0) | (responses.coherence > 1)
    at = np.flatnonzero(wrong.any(axis=1))
    unit = frf.unit or ("Hz" if responses.in_hertz else "rad/s")
    factor = angular_factor(unit)
    shown = [
        f"{responses.coherence[line][wrong[line]][0]:.6g} at {responses.omega[line] / factor:.6g} {unit}"
        for line in (at[used[at]] if used[at].any() else at)
    ]
    listed = f"a coherence that is not above 0 and at most 1: {shortened(shown, 6)}"
    if used[at].any():
        raise FileError(
            f"{path} has {listed}",
            remedy="Leave these lines out (band), or name the right columns.",
            names=(f"{_PLACE}.coherence", f"{_PLACE}.path"),
        )
    return f"outside the band {path.name} has {listed}; these lines are not used" if shown else ""


def _in_radians(responses: MeasuredResponses, frf: FrfModel) -> float:
    """Return the factor that converts the lines of a file into rad/s: by its heading, the scene, or rad/s."""
    from dynid.units import unit_fits

    name, stated, _ = responses.of_lines
    if not stated:
        return angular_factor("Hz" if frf.unit is None and responses.in_hertz else frf.unit)
    if frf.unit is not None and not unit_fits(stated, [frf.unit]):
        raise FileError(
            f"'unit' is {frf.unit}, but the file has '{name}' in {stated}",
            remedy="Leave 'unit' out, or correct the heading.",
            names=("measurement.frf.unit", "measurement.frf"),
        )
    return angular_factor(stated)


def measurements_of(scene: Scene[IdentificationScene], model: StructuralModel | IdentifiedGraph) -> list[Any]:
    """Return the records of time or the frequency responses of a scene, and its modal survey."""
    identification = scene.model
    measurement_model, measurements = identification.measurement, list[Any]()
    assert measurement_model is not None
    if measurement_model.frf is not None:
        measurements.append(frf_measurement(scene, measurement_model, model))
    elif not measurement_model.modes_alone:
        measurements += experiments(scene, identification.excitation, measurement_model, model)
    if measurement_model.modes is not None:
        from dynid.scene.kinds.modes import modal_measurement

        of = measurement_model.modes.amplitude_of
        place = None if of is None else channel_of(of, model)
        measurements.append(modal_measurement(scene, measurement_model.modes, place))
    return measurements
