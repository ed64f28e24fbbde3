"""From a scene's words to the arrays and signals of the analyses."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dynid.scene.common import FileSignal, FrequencyGrid, SignalPart, TimeGrid

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from dynid.lti.generator import Record, Signal


def angular_frequencies(grid: FrequencyGrid) -> NDArray[np.float64]:
    """Return the grid in rad/s."""
    factor = 2 * np.pi if grid.unit == "Hz" else 1.0
    spaced = np.geomspace if grid.scale == "log" else np.linspace
    return np.asarray(spaced(float(grid.start), float(grid.stop), grid.points)) * factor


def record_of(grid: TimeGrid) -> Record:
    """Return the record of a time response: from t = 0 on, at the grid's step."""
    from dynid.lti.generator import Record

    return Record(float(grid.step), grid.samples)


def build_signal(part: SignalPart, record: Record, folder: Path) -> Signal:
    """Build a signal; samples in a file are read now.

    Raises
    ------
    FileError
        Where the file of a signal cannot be read, or is too short for the record.
    """
    from dynid.lti.signals import signal

    parameters = part.parameters()
    if isinstance(part, FileSignal):
        from dynid.scene.tables import read_columns

        values = read_columns(folder / part.path, [part.column])[:, 0]
        parameters = {"values": values}
    return signal(str(getattr(part, "kind")), parameters, record)  # noqa: B009 - every member has a kind
