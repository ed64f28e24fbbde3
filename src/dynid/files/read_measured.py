"""Measured data of files: columns of numbers, signals, frequency responses and modes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from dynid.files.formats import Content, reader_of
from dynid.files.frequency_responses import MeasuredResponses, ResponseLayout
from dynid.files.modal_tables import ModalTable
from dynid.files.stamps import Clock
from dynid.files.table import ColumnRequest, DataFile, DataTable, Heading, TableLayout

if TYPE_CHECKING:
    from numpy.typing import NDArray

_PLAIN = TableLayout()
#: Largest difference of the starts of files of one record, in steps.
_ONE_START_TOL = 1e-3


class MeasuredColumns(NamedTuple):
    """Columns of a file: `values` (rows x columns), NaN where a sample is missing, and their `headings`.

    `clock` is that of their times, if they have any, and `start` the first of these; `note` says what of the
    file was skipped.
    """

    values: NDArray[np.float64]
    headings: list[Heading]
    clock: Clock | None = None
    note: str = ""
    start: float | None = None


def read_columns(
    path: Path,
    columns: Sequence[str | int] | None,
    *,
    step: float | None = None,
    scene_key: str = "",
    layout: TableLayout = _PLAIN,
    rows: int | None = None,
) -> MeasuredColumns:
    """Read columns of a file, in the units in which they stand there.

    The file is a `.csv`, `.txt` or `.dat` file with one row a line (semicolons, tabs, bars, commas or spaces;
    where commas do not separate, they may be decimal; lines that start with # are passed over; a first line
    of names is a header, in which a unit may stand, `acc 12+Z [g]`, or in a line below; lines above the names
    are skipped where it is certain which line has the names; times may be dates and times of day), an HDF5
    file (`.h5`, `.hdf5`), a MATLAB file (`.mat`) or a Universal File of data sets 58 (`.uff`, `.unv`). In
    text a missing sample is an empty field, `nan`, `NA` or `n/a`; in a file of one column an empty line is a
    missing sample too; in one of several columns it is refused. Empty lines at the end are dropped.

    Columns are names, with or without the unit, or numbers from 1: columns of a table, datasets of an HDF5
    file, variables of a MATLAB file, functions of a Universal File; by default all columns of a table but
    that of the times, in an HDF5 file the dataset `measured`. The `step` (s) is compared with the times of a
    table, in an HDF5 file with the dataset `time` or `t` beside the data. `scene_key` is the dotted place of
    the file in the scene, for errors; no more than `rows` are read of a longer dataset of an HDF5 file.
    """
    table = _table(path, scene_key, ColumnRequest(columns, layout, rows=rows))
    if columns is None or table.selected:
        chosen = table.data
    else:
        chosen = [table.find(name, "columns") for name in columns]
    values, clock = table.checked(chosen, step, resample=layout.resample)
    return MeasuredColumns(values, [table.heading(k) for k in chosen], clock, table.note, _start(table))


def _start(table: DataTable) -> float | None:
    """Return the first time of a table; None without times."""
    first = [] if table.times is None else table.times[:1].tolist()
    return first[0] if first and not np.isnan(first[0]) else None


def check_starts(path: Path, start: float | None, other: float | None, step: float, scene_key: str) -> None:
    """Refuse a file whose first time is not that of another, where both have times."""
    if start is not None and other is not None and abs(start - other) > _ONE_START_TOL * step:
        DataFile(path, scene_key).refuse(
            f"starts at {start:.9g} s, the others of the record at {other:.9g} s",
            "Leave out the rows before the later start: first: ROW.",
        )


def read_signal(
    path: Path,
    column: str | int | None,
    *,
    step: float | None = None,
    scene_key: str = "",
    layout: TableLayout = _PLAIN,
) -> tuple[NDArray[np.float64], Heading, float | None]:
    """Read one column without missing samples, its heading, and the first time; default: the only column.

    That is the only column but that of the times, the only dataset of an HDF5 file but `time` or `t`. Other
    parameters are those of `read_columns`.
    """
    columns = None if column is None else [column]
    table = _table(path, scene_key, ColumnRequest(columns, layout, single=True))
    if column is not None and not table.selected:
        index = table.find(column, "column")
    elif table.selected or len(table.data) == 1:
        index = table.data[0]
    else:
        named = ": " + ", ".join(table.names[k] for k in table.data) if table.names and table.data else ""
        table.file.refuse(
            f"has {len(table.data) or 'no'} columns beside the time{named}",
            "Name the one that drives: column: NAME, or its number.",
            key="column",
        )
    samples, clock = table.checked([index], step, resample=layout.resample)
    values = samples[:, 0]
    if np.isnan(values).any():
        row, remedy = int(np.argmax(np.isnan(values))), "A signal is known at every step."
        if clock is not None and clock.rows is not None and clock.dropped:
            row, remedy = int(np.searchsorted(clock.rows, row)), f"{remedy} resample: true interpolates it."
        table.refuse_row(row, "a sample of the signal is missing", remedy)
    return values, table.heading(index), _start(table)


def _table(path: Path, scene_key: str, request: ColumnRequest) -> DataTable:
    table: DataTable = _reader(path, "columns", scene_key)(DataFile(path, scene_key), request)
    return table if request.layout.first is None else table.since(request.layout.first)


def _reader(path: Path, content: Content, scene_key: str) -> Any:
    return reader_of(path, content, names=[f"{scene_key}.path"] if scene_key else ())


def read_responses(path: Path, layout: ResponseLayout, scene_key: str) -> MeasuredResponses:
    """Return measured frequency response functions.

    The file is a text file with one line a row, an HDF5 or MATLAB file, or a Universal File of data sets 58.
    Complex numbers are columns of such (in text ``1.5-2e-3j``), or pairs of columns.
    """
    file = DataFile(path, scene_key)
    measured: MeasuredResponses = _reader(path, "responses", scene_key)(file, layout)
    omega = measured.omega
    if not np.isfinite(omega).all() or np.any(omega < 0) or np.any(np.diff(omega) <= 0):
        file.refuse("has frequencies that are missing, negative, or do not increase", key="frequency")
    if np.isinf(measured.values).any():
        line = int(np.argwhere(np.isinf(measured.values))[0, 0])
        file.refuse(f"line {line + 1}: the response is infinite", "Leave a line out, or write nan.")
    if any(len(column) != len(omega) for column in measured.columns.values()):
        file.refuse("has columns of different lengths", key="columns")
    return measured


def read_modes(path: Path, names: Mapping[str, str], scene_key: str) -> ModalTable:
    """Return the modes in a text file, a MATLAB file or a Universal File.

    `names` are those of quantities in the file, where they differ from `QUANTITIES`, ``shape_std``, ``tests``
    (of each value of a shape, or of each mode: the scatter is that of a single test, and the mean of n tests
    scatters by a root of n less), ``frequency_tests`` and ``dofs``.
    """
    file = DataFile(path, scene_key)
    modes: ModalTable = _reader(path, "modes", scene_key)(file, names)
    bad = ~(np.isfinite(modes.frequency) & (modes.frequency >= 0))
    if bad.any():
        number = int(np.argmax(bad)) + 1
        file.refuse(f"mode {number} has no frequency", "Leave it out, or give it one.", colon=True)
    if modes.damping is not None:
        bad = ~(np.isnan(modes.damping) | ((modes.damping >= 0) & (modes.damping < 1)))
        if bad.any():
            number = int(np.argmax(bad))
            problem = f"mode {number + 1} has the damping ratio {modes.damping[number]:g}"
            file.refuse(problem, "A ratio is from 0 to 1; per cent are named: damping [%].", colon=True)
    for what, values in (("positive amplitude", modes.amplitude), ("number of its mode", modes.mode)):
        if values is None:
            continue
        good = np.isfinite(values) & (values > 0)
        if values is modes.mode:
            good &= values == np.floor(values)
        if not good.all():
            row = int(np.argmin(good)) + 1
            file.refuse(f"point {row} has no {what}", "Leave it out, or give it one.", colon=True)
    for name in ("frequency_std", "damping_std", "shape_std"):
        values = getattr(modes, name)
        if values is not None and np.any(np.nan_to_num(values) < 0):
            file.refuse(f"'{name}' is negative somewhere", colon=True)
    return modes
