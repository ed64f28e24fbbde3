"""Signals, frequencies and times of a scene for its analyses, and factors from its units to SI."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from dynid.errors import FileError, UsageError
from dynid.scene.schema.base import FrequencyGrid
from dynid.scene.schema.signals import (
    AmplitudePart,
    ChirpSignal,
    FileSignal,
    ImpulseSignal,
    MultisineSignal,
    RandomSignal,
    SignalPart,
    SineSignal,
    TablePlace,
    TimeGrid,
)
from dynid.units import angular_factor

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from dynid.files.table import Heading, TableLayout
    from dynid.lti.generator import RecordTimes, Signal
    from dynid.scene.load import Scene
    from dynid.scene.schema.measurement import MeasuredChannelModel


def angular_frequencies(grid: FrequencyGrid) -> NDArray[np.float64]:
    """Return the grid in rad/s."""
    factor = angular_factor(grid.unit)
    spaced = np.geomspace if grid.scale == "log" else np.linspace
    return np.asarray(spaced(float(grid.start), float(grid.stop), grid.points)) * factor


def record_of(grid: TimeGrid) -> RecordTimes:
    """Return the record of a time response: from t = 0 on, at the grid's step."""
    from dynid.lti.generator import RecordTimes

    return RecordTimes(float(grid.step), grid.samples)


def build_signals(
    scene: Scene,
    where: str,
    parts: Sequence[SignalPart],
    record: RecordTimes,
    load_of: Callable[[SignalPart], Any],
    starts: Mapping[Path, float | None] | None = None,
) -> list[tuple[SignalPart, Signal]]:
    """Return signals, each with the part of the scene that describes it.

    Parameters
    ----------
    scene
        The scene, whose folder files are relative to.
    where
        The dotted path of the signals in the scene.
    parts
        The signals there.
    record
        The record that they belong to.
    load_of
        Returns the load that a signal is, with its SI unit.
    starts
        The first times of files of the record, s; those of signals in the same files must agree.

    Raises
    ------
    FileError
        Where the file of a signal cannot be read, its times are not at the record's step, or it ends before
        the record does.
    UsageError
        Where a signal does not suit this record, or its unit what it drives; it names the place.
    """
    built = []
    single = isinstance(written_at(scene, where), dict)
    for index, signal_model in enumerate(parts):
        signal_path = where if single else f"{where}.{index}"
        held = isinstance(signal_model, RandomSignal) and signal_model.hold is not None
        if held and where.startswith("analysis"):
            raise UsageError(
                "the 'hold' of a random signal is for an estimator, which knows its samples only",
                remedy="Leave it out: a response is computed for the continuous signal.",
                names=(f"{signal_path}.hold",),
            )
        factor = 1.0
        if isinstance(signal_model, AmplitudePart) and signal_model.amplitude_unit is not None:
            impulse = isinstance(signal_model, ImpulseSignal)
            unit, load = signal_model.amplitude_unit, load_of(signal_model)
            factor = _amplitude_factor(unit, load, signal_path, impulse=impulse)
        try:
            parameters = signal_model.parameters()
            if factor != 1:
                amplitude, several = parameters["amplitude"], isinstance(signal_model, MultisineSignal)
                scaled = tuple(factor * value for value in amplitude) if several else factor * amplitude
                parameters["amplitude"] = scaled
            if isinstance(signal_model, FileSignal):
                from dynid.files.read_measured import check_starts, read_signal

                path, layout = scene.folder / signal_model.path, layout_of(signal_model)
                values, heading, start = read_signal(
                    path, signal_model.column, step=record.step, scene_key=signal_path, layout=layout
                )
                check_starts(path, start, (starts or {}).get(path), record.step, signal_path)
                factor = recorded_factor(signal_model, heading, load_of(signal_model), signal_path)
                values = factor * (values - float(signal_model.offset or 0))
                if len(values) < record.samples:
                    raise FileError(
                        f"{path} has {len(values)} samples, but the signal lasts {record.samples}",
                        remedy="Give samples for the whole record, or end it earlier.",
                        names=(f"{signal_path}.path",),
                    )
                parameters = {"values": values, "hold": signal_model.hold}
            from dynid.lti.signals import signal

            kind = str(getattr(signal_model, "kind"))  # noqa: B009 - every member has a kind
            built.append((signal_model, signal(kind, parameters, record)))
        except UsageError as error:
            names = [name for name in error.names if name.startswith(signal_path)]
            raise UsageError(error.problem, remedy=error.remedy, names=(*names, signal_path)) from error
    return built


def written_at(scene: Scene, dotted: str) -> Any:
    """Return what a scene has at a dotted path; None where it ends before."""
    written = scene.source.data
    for key in dotted.split("."):
        if isinstance(written, list):
            written = written[int(key)]
        else:
            written = written.get(key) if isinstance(written, dict) else None
    return written


def layout_of(table: TablePlace) -> TableLayout:
    """Return the place of a table in its file."""
    from dynid.files.table import TableLayout

    return TableLayout(
        table.variable, table.row, table.time, table.first, table.resample, table.group, table.sheet
    )


def highest_frequency(signals: Sequence[SignalPart], step: float) -> float:
    """Return the highest frequency that signals excite (rad/s), at most the Nyquist frequency.

    `step` is the sampling step, s.
    """
    highest = []
    for signal in signals:
        parameters = signal.parameters()
        if isinstance(signal, ChirpSignal):
            highest.append(float(max(parameters["start"], parameters["stop"])))
        elif isinstance(signal, RandomSignal) and signal.band:
            highest.append(float(parameters["band"][1]))
        elif isinstance(signal, SineSignal | MultisineSignal):
            highest.append(float(np.max(parameters["frequency"])))
        else:
            highest.append(math.inf)
    return min(math.pi / step, max(highest, default=math.inf))


class DrivenSource(NamedTuple):
    """A source of a graph that a signal drives, and its SI unit; empty where its domain is unknown."""

    name: str
    unit: str


def _units_of(measured: Any) -> tuple[str, ...]:
    """Return the SI units that a channel, load or frequency response function may have; none: any.

    A DOF whose label has no direction may be a translation or a rotation; the domain of a graph's variable
    may be unknown.
    """
    from dynid.structure.ports import Channel, Load
    from dynid.units import as_factor

    force = getattr(measured, "force", None)
    if force is not None:
        above, below = _units_of(measured.channel), _units_of(measured.load)
        return tuple(f"{as_factor(a)}/{as_factor(b)}" for a in above for b in below)
    if isinstance(measured, Channel | Load):
        return measured.units
    return (measured.unit,) if measured.unit else ()


def recorded_factor(
    sensor: MeasuredChannelModel | FileSignal, heading: Heading | None, measured: Any, path: str
) -> float:
    """Return the factor by which recorded values are multiplied to be SI.

    Without a `heading` the record is simulated; `path` is the dotted path of the sensor, for errors. Raises
    `UsageError` where the unit does not fit what is measured, or scene and heading contradict each other.
    """
    from dynid.units import readings, si_factor

    expected, stated = _units_of(measured), "" if heading is None else heading.unit
    if not (sensor.unit or stated or sensor.sensitivity or (heading and heading.doubt)):
        return 1.0
    sensitivity = sensor.sensitivity
    if heading is not None and heading.doubt and not (sensor.unit or sensitivity):
        raise UsageError(
            f"the unit of the column '{heading.name}' is in doubt: {heading.doubt}",
            remedy="State the 'unit' of the channel.",
            names=(path,),
        )
    unit = sensor.unit or stated or (sensitivity.recorded if sensitivity else "")
    key = f"{path}.{'unit' if sensor.unit else 'sensitivity' if sensitivity else ''}".rstrip(".")
    try:
        over = sensitivity.unit if sensitivity else ""
        factor = si_factor(unit, expected, over=over, what=_named(measured))
        units = [*product(readings(sensor.unit), readings(stated))] if sensor.unit and stated else []
        same = (a.dimension == b.dimension and abs(a.factor / b.factor - 1) < 1e-9 for a, b in units)
        if heading is not None and units and not any(same):
            raise UsageError(
                f"'unit' is {sensor.unit}, but the file has '{heading.name}' in {stated}",
                remedy="Leave 'unit' out, or correct the heading.",
            )
    except UsageError as error:
        source = f"the column '{heading.name}' [{stated}]: " if heading and not sensor.unit and stated else ""
        raise UsageError(f"{source}{error.problem}", remedy=error.remedy, names=(key, path)) from error
    return factor / float(sensitivity.value) if sensitivity else factor


def of_stated_kind(measured: Any, sensor: MeasuredChannelModel | FileSignal, heading: Heading | None) -> Any:
    """Return a channel, its DOF of the kind that its unit says where its label says none."""
    from dynid.structure.ports import Channel
    from dynid.units import si_factor

    sensitivity = sensor.sensitivity
    unit = sensor.unit or (heading.unit if heading else "") or (sensitivity.recorded if sensitivity else "")
    if not unit or not isinstance(measured, Channel) or len(measured.units) == 1:
        return measured
    for kind, fitting in zip(("translation", "rotation"), measured.units, strict=True):
        with suppress(UsageError):
            si_factor(unit, [fitting], over=sensitivity.unit if sensitivity else "")
            return measured._replace(kind=kind)
    return measured


def _amplitude_factor(unit: str, measured: Any, path: str, *, impulse: bool) -> float:
    """Return the factor by which an amplitude is multiplied to be SI; that of an impulse is an area."""
    from dynid.units import as_factor, si_factor

    expected = [f"{as_factor(name)}.s" if impulse else name for name in _units_of(measured)]
    try:
        what = f"the area of {_named(measured)}" if impulse else _named(measured)
        return si_factor(unit, expected, what=what)
    except UsageError as error:
        names = (f"{path}.amplitude_unit", path)
        raise UsageError(error.problem, remedy=error.remedy, names=names) from error


def _named(measured: Any) -> str:
    from dynid.structure.ports import Channel, Load

    if getattr(measured, "force", None) is not None:
        return f"the frequency response {measured.name}"
    if isinstance(measured, Channel | Load):
        quantity = measured.quantity if isinstance(measured, Channel) else measured.motion or "force"
        return f"{'an' if quantity[0] == 'a' else 'a'} {quantity}"
    return str(measured.name)


def products(factors: Sequence[float], levels: float | Sequence[float] | None) -> Any:
    """Return numbers, one or one a channel, each times its channel's factor."""
    if levels is None or all(factor == 1 for factor in factors):
        return levels
    levels_of_channels = [levels] * len(factors) if isinstance(levels, int | float) else levels
    return [abs(factor) * level for factor, level in zip(factors, levels_of_channels, strict=True)]
