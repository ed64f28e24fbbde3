"""Signals, frequencies and times of a scene as arrays and objects of the analyses."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from dynid.errors import FileError, UsageError
from dynid.scene.schema.base import FrequencyGrid
from dynid.scene.schema.signals import (
    ChirpSignal,
    FileSignal,
    MultisineSignal,
    RandomSignal,
    SignalPart,
    SineSignal,
    TablePlace,
    TimeGrid,
)

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from dynid.lti.generator import RecordTimes, Signal
    from dynid.scene.load import Scene
    from dynid.tables.table import TableLayout


def angular_frequencies(grid: FrequencyGrid) -> NDArray[np.float64]:
    """Return the grid in rad/s."""
    factor = 2 * np.pi if grid.unit == "Hz" else 1.0
    spaced = np.geomspace if grid.scale == "log" else np.linspace
    return np.asarray(spaced(float(grid.start), float(grid.stop), grid.points)) * factor


def record_of(grid: TimeGrid) -> RecordTimes:
    """Return the record of a time response: from t = 0 on, at the grid's step."""
    from dynid.lti.generator import RecordTimes

    return RecordTimes(float(grid.step), grid.samples)


def build_signals(
    scene: Scene, where: str, parts: Sequence[SignalPart], record: RecordTimes
) -> list[tuple[SignalPart, Signal]]:
    """Build signals, each beside the part of the scene that describes it.

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

    Raises
    ------
    FileError
        Where the file of a signal cannot be read, its times are not at the record's step, or it ends before
        the record does.
    UsageError
        Where a signal makes no sense for this record; it names the place.
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
        try:
            built.append((part, _build_signal(part, record, scene.folder, place)))
        except UsageError as error:
            raise UsageError(error.problem, remedy=error.remedy, names=(place,)) from error
    return built


def layout_of(part: TablePlace) -> TableLayout:
    """Return where in its file a table is."""
    from dynid.tables.table import TableLayout

    return TableLayout(part.variable, part.row, part.time, part.first)


def _build_signal(part: SignalPart, record: RecordTimes, folder: Path, place: str) -> Signal:
    from dynid.lti.signals import signal

    parameters = part.parameters()
    if isinstance(part, FileSignal):
        from dynid.tables.read import read_signal

        where = folder / part.path
        values = read_signal(where, part.column, step=record.step, place=place, layout=layout_of(part))
        if len(values) < record.samples:
            raise FileError(
                f"{folder / part.path} has {len(values)} samples, but the signal lasts {record.samples}",
                remedy="Give samples for the whole record, or end it earlier.",
                names=(f"{place}.path",),
            )
        parameters = {"values": values, "hold": part.hold}
    return signal(str(getattr(part, "kind")), parameters, record)  # noqa: B009 - every member has a kind


def highest_frequency(signals: Sequence[SignalPart], step: float) -> float:
    """Return the highest frequency that signals excite, rad/s; what has no end goes to Nyquist's.

    Parameters
    ----------
    signals
        The signals.
    step
        Sampling step, s.
    """
    nyquist = math.pi / step
    return min(nyquist, max((_highest(part) for part in signals), default=nyquist))


def _highest(part: SignalPart) -> float:
    given = part.parameters()
    if isinstance(part, ChirpSignal):
        return float(max(given["start"], given["stop"]))
    if isinstance(part, RandomSignal):
        return float(given["band"][1]) if part.band else math.inf
    if isinstance(part, SineSignal | MultisineSignal):
        return float(np.max(given["frequency"]))
    return math.inf
