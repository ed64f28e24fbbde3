"""Signals, frequencies and times of a scene for its analyses."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from dynid.errors import FileError, UsageError
from dynid.scene.kinds.recorded_units import amplitude_factor, recorded_factor
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

    from dynid.lti.generator import RecordTimes, Signal
    from dynid.scene.load import Scene
    from dynid.tables.table import TableLayout


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
                from dynid.tables.read import read_signal

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
    from dynid.tables.table import TableLayout

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
