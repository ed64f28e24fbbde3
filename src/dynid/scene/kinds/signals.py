"""Signals, frequencies and times of a scene for its analyses, and factors from its units to SI."""

from __future__ import annotations

import math
from contextlib import suppress
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

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
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from dynid.files.table import Heading, TableLayout
    from dynid.lti.generator import RecordTimes, Signal
    from dynid.scene.load import Scene
    from dynid.scene.schema.base import SensitivityModel


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

    Raises
    ------
    FileError
        Where the file of a signal cannot be read, its times are not at the record's step, or it ends before
        the record does.
    UsageError
        Where a signal does not suit this record, or its unit what it drives; it names the place.
    """
    built = []
    found = scene.source.data
    for key in where.split("."):
        if isinstance(found, list):
            found = found[int(key)]
        else:
            found = found.get(key) if isinstance(found, dict) else None
    single = isinstance(found, dict)
    for index, part in enumerate(parts):
        place = where if single else f"{where}.{index}"
        if where.startswith("analysis") and isinstance(part, RandomSignal) and part.hold is not None:
            raise UsageError(
                "the 'hold' of a random signal is for an estimator, which knows its samples only",
                remedy="Leave it out: a response is computed for the continuous signal.",
                names=(f"{place}.hold",),
            )
        factor = 1.0
        if isinstance(part, AmplitudePart) and part.amplitude_unit is not None:
            impulse = isinstance(part, ImpulseSignal)
            factor = amplitude_factor(part.amplitude_unit, load_of(part), place, impulse=impulse)
        try:
            parameters = part.parameters()
            if factor != 1:
                given = parameters["amplitude"]
                scaled = tuple(factor * one for one in given) if isinstance(given, tuple) else factor * given
                parameters["amplitude"] = scaled
            if isinstance(part, FileSignal):
                from dynid.files.read_measured import read_signal

                path, layout = scene.folder / part.path, layout_of(part)
                values, heading = read_signal(path, part.column, step=record.step, place=place, layout=layout)
                factor = recorded_factor(part, heading, load_of(part), place)
                values = factor * (values - float(part.offset or 0))
                if len(values) < record.samples:
                    raise FileError(
                        f"{path} has {len(values)} samples, but the signal lasts {record.samples}",
                        remedy="Give samples for the whole record, or end it earlier.",
                        names=(f"{place}.path",),
                    )
                parameters = {"values": values, "hold": part.hold}
            from dynid.lti.signals import signal

            kind = str(getattr(part, "kind"))  # noqa: B009 - every member has a kind
            built.append((part, signal(kind, parameters, record)))
        except UsageError as error:
            names = [name for name in error.names if name.startswith(place)]
            raise UsageError(error.problem, remedy=error.remedy, names=(*names, place)) from error
    return built


def layout_of(part: TablePlace) -> TableLayout:
    """Return the place of a table in its file."""
    from dynid.files.table import TableLayout

    return TableLayout(part.variable, part.row, part.time, part.first, part.resample)


def highest_frequency(signals: Sequence[SignalPart], step: float) -> float:
    """Return the highest frequency that signals excite (rad/s), at most the Nyquist frequency.

    Parameters
    ----------
    signals
        The signals.
    step
        Sampling step, s.
    """
    highest = []
    for part in signals:
        given = part.parameters()
        if isinstance(part, ChirpSignal):
            highest.append(float(max(given["start"], given["stop"])))
        elif isinstance(part, RandomSignal) and part.band:
            highest.append(float(given["band"][1]))
        elif isinstance(part, SineSignal | MultisineSignal):
            highest.append(float(np.max(given["frequency"])))
        else:
            highest.append(math.inf)
    return min(math.pi / step, max(highest, default=math.inf))


class Sensor(Protocol):
    """The unit and sensitivity of a recorded column, as far as the scene has them."""

    @property
    def unit(self) -> str | None:
        """The unit of the recorded values."""

    @property
    def sensitivity(self) -> SensitivityModel | None:
        """The sensitivity of the sensor."""


class DrivenSource(NamedTuple):
    """A source of a graph that a signal drives, and its SI unit; empty where its domain is unknown."""

    name: str
    unit: str


def units_of(measured: Any) -> tuple[str, ...]:
    """Return the SI units that a channel, load or frequency response function may have; none: any.

    A DOF whose label has no direction may be a translation or a rotation; the domain of a graph's variable
    may be unknown.
    """
    from dynid.structure.ports import Channel, Load
    from dynid.units import as_factor

    force = getattr(measured, "force", None)
    if force is not None:
        above, below = units_of(measured.channel), units_of(measured.load)
        return tuple(f"{as_factor(a)}/{as_factor(b)}" for a in above for b in below)
    if isinstance(measured, Channel | Load):
        return measured.units
    return (measured.unit,) if measured.unit else ()


def recorded_factor(given: Sensor, heading: Heading | None, measured: Any, place: str) -> float:
    """Return the factor by which recorded values are multiplied to be SI.

    Parameters
    ----------
    given
        The channel or the signal in a file.
    heading
        The heading of its column; absent: the record is simulated.
    measured
        The channel, load or function that it records.
    place
        Its dotted path in the scene, for errors.

    Raises
    ------
    UsageError
        Where the unit does not fit what is measured, or scene and heading contradict each other.
    """
    from dynid.units import si_factor

    expected, stated = units_of(measured), "" if heading is None else heading.unit
    if not (given.unit or stated or given.sensitivity or (heading and heading.doubt)):
        return 1.0
    sensitivity = given.sensitivity
    if heading is not None and heading.doubt and not (given.unit or sensitivity):
        raise UsageError(
            f"the unit of the column '{heading.name}' is in doubt: {heading.doubt}",
            remedy="State the 'unit' of the channel.",
            names=(place,),
        )
    unit = given.unit or stated or (sensitivity.recorded if sensitivity else "")
    key = f"{place}.{'unit' if given.unit else 'sensitivity' if sensitivity else ''}".rstrip(".")
    try:
        factor = si_factor(
            unit, expected, over=sensitivity.unit if sensitivity else "", what=_named(measured)
        )
        if heading is not None and given.unit and stated and not _same(given.unit, stated):
            raise UsageError(
                f"'unit' is {given.unit}, but the file has '{heading.name}' in {stated}",
                remedy="Leave 'unit' out, or correct the heading.",
            )
    except UsageError as error:
        source = f"the column '{heading.name}' [{stated}]: " if heading and not given.unit and stated else ""
        raise UsageError(f"{source}{error.problem}", remedy=error.remedy, names=(key, place)) from error
    return factor / float(sensitivity.value) if sensitivity else factor


def of_stated_kind(measured: Any, given: Sensor, heading: Heading | None) -> Any:
    """Return a channel, its DOF of the kind that its unit says where its label says none."""
    from dynid.structure.ports import Channel
    from dynid.units import si_factor

    sensitivity = given.sensitivity
    unit = given.unit or (heading.unit if heading else "") or (sensitivity.recorded if sensitivity else "")
    if not unit or not isinstance(measured, Channel) or len(measured.units) == 1:
        return measured
    for kind, fitting in zip(("translation", "rotation"), measured.units, strict=True):
        with suppress(UsageError):
            si_factor(unit, [fitting], over=sensitivity.unit if sensitivity else "")
            return measured._replace(kind=kind)
    return measured


def amplitude_factor(unit: str, measured: Any, place: str, *, impulse: bool) -> float:
    """Return the factor by which an amplitude is multiplied to be SI; that of an impulse is an area.

    Raises
    ------
    UsageError
        Where the unit does not fit.
    """
    from dynid.units import as_factor, si_factor

    expected = [f"{as_factor(one)}.s" if impulse else one for one in units_of(measured)]
    try:
        return si_factor(
            unit, expected, what=f"the area of {_named(measured)}" if impulse else _named(measured)
        )
    except UsageError as error:
        raise UsageError(
            error.problem, remedy=error.remedy, names=(f"{place}.amplitude_unit", place)
        ) from error


def _same(one: str, other: str) -> bool:
    """Return True if two units are the same: of one dimension, with one factor."""
    from dynid.units import readings

    pairs = ((a, b) for a in readings(one) for b in readings(other))
    return any(a.dimension == b.dimension and abs(a.factor / b.factor - 1) < 1e-9 for a, b in pairs)


def _named(measured: Any) -> str:
    """Return what is measured, in words."""
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
    each = [levels] * len(factors) if isinstance(levels, int | float) else levels
    return [abs(factor) * level for factor, level in zip(factors, each, strict=True)]
