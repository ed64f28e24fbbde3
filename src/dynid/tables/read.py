"""Columns of numbers read from text, HDF5, MATLAB and Universal File Format 58."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dynid.file_access import obstacle
from dynid.tables.binary import read_datasets, read_matlab
from dynid.tables.stamps import Clock
from dynid.tables.table import DataFile, DataTable, Heading, TableLayout, are_numbers
from dynid.tables.text import read_text
from dynid.tables.universal_file import read_uff

if TYPE_CHECKING:
    from numpy.typing import NDArray

_PLAIN = TableLayout()


class MeasuredColumns(NamedTuple):
    """Columns of a file: `values` (rows x columns), NaN where a sample is missing, and their `headings`.

    `clock` is that of their times, if they have any; `note` says what of the file was skipped.
    """

    values: NDArray[np.float64]
    headings: list[Heading]
    clock: Clock | None = None
    note: str = ""


def read_columns(
    path: Path,
    columns: Sequence[str | int] | None,
    *,
    step: float | None = None,
    place: str = "",
    layout: TableLayout = _PLAIN,
    rows: int | None = None,
) -> MeasuredColumns:
    """Read columns of a file, in the units in which they stand there.

    Parameters
    ----------
    path
        A `.csv`, `.txt` or `.dat` file with one row a line (semicolons, tabs, bars, commas or spaces; where
        commas do not separate, they may be decimal; lines that start with # are passed over; a first line of
        names is a header, in which a unit may stand, `acc 12+Z [g]`, or in a line below; lines above the
        names are skipped where it is certain which line has the names; times may be dates and times of day),
        an HDF5 file (`.h5`, `.hdf5`), a MATLAB file (`.mat`) or a Universal File of data sets 58 (`.uff`,
        `.unv`). In text a missing sample is an empty field, `nan`, `NA` or `n/a`; in a file of one column an
        empty line is a missing sample too; in one of several columns it is refused. Empty lines at the end
        are dropped.
    columns
        Names, with or without the unit, or numbers from 1: columns of a table, datasets of an HDF5 file,
        variables of a MATLAB file, functions of a Universal File. Absent: all columns of a table but that of
        the times; in an HDF5 file the dataset `measured`.
    step
        The step that the rows are taken to have, s; compared with the times of a table, in an HDF5 file with
        the dataset `time` or `t` beside the data.
    place
        The dotted place of the file in the scene, for errors.
    layout
        Where in the file the table is.
    rows
        How many rows are needed; of a longer dataset of an HDF5 file no more are read.

    Raises
    ------
    FileError
        Where the file cannot be read, a column is missing, a value is infinite, or the times are not those
        of the step.
    """
    file = existing(path, place)
    table = _table(file, columns, layout, rows=rows)
    if columns is None or (file_format(path) in ("hdf5", "matlab") and not are_numbers(columns)):
        chosen = table.data
    else:
        chosen = [table.find(name, "columns") for name in columns]
    values, clock = table.checked(chosen, step, resample=layout.resample)
    return MeasuredColumns(values, [table.heading(k) for k in chosen], clock, table.note)


def read_signal(
    path: Path,
    column: str | int | None,
    *,
    step: float | None = None,
    place: str = "",
    layout: TableLayout = _PLAIN,
) -> tuple[NDArray[np.float64], Heading]:
    """Read one column without missing samples, and its heading; by default the only one that is not the time.

    Parameters
    ----------
    path, step, place, layout
        As of `read_columns`.
    column
        Its name, with or without the unit, or its number from 1. Absent: the only column but that of the
        times, the only dataset of an HDF5 file but `time` or `t`.

    Raises
    ------
    FileError
        As `read_columns`; also where a sample is missing, or several columns could be meant.
    """
    file = existing(path, place)
    table = _table(file, None if column is None else [column], layout, single=True)
    if isinstance(column, str) and file_format(path) in ("hdf5", "matlab"):
        found = table.data[0]
    elif column is not None:
        found = table.find(column, "column")
    elif len(table.data) == 1:
        found = table.data[0]
    else:
        named = ": " + ", ".join(table.names[k] for k in table.data) if table.names and table.data else ""
        table.file.refuse(
            f"has {len(table.data) or 'no'} columns beside the time{named}",
            "Name the one that drives: column: NAME, or its number.",
            key="column",
        )
    samples, clock = table.checked([found], step, resample=layout.resample)
    values = samples[:, 0]
    if np.isnan(values).any():
        row, remedy = int(np.argmax(np.isnan(values))), "A signal is known at every step."
        if clock is not None and clock.rows is not None and clock.dropped:
            row, remedy = int(np.searchsorted(clock.rows, row)), f"{remedy} resample: true interpolates it."
        table.refuse_row(row, "a sample of the signal is missing", remedy)
    return values, table.heading(found)


def _table(
    file: DataFile,
    columns: Sequence[str | int] | None,
    layout: TableLayout,
    *,
    single: bool = False,
    rows: int | None = None,
) -> DataTable:
    """Read the table of a file, by its format."""
    match file_format(file.path):
        case "hdf5":
            layout.only(file, "time")
            if isinstance(layout.time, int):
                file.refuse("has datasets, no numbered columns of times", "Give its name.", key="time")
            last = None if rows is None else rows + (layout.first or 1) - 1
            table = read_datasets(file, columns, single, layout.time, last)
        case "matlab":
            table = read_matlab(file, columns, layout)
        case "uff":
            layout.only(file)
            table = read_uff(file)
        case _:
            layout.only(file, "time")
            table = read_text(file, layout.time)
    return table if layout.first is None else table.since(layout.first)


def existing(path: Path, place: str) -> DataFile:
    """Return a file that exists."""
    file, found = DataFile(path, place), obstacle(path)
    if found is not None:
        file.refuse(*found)
    return file


def file_format(path: Path) -> str:
    """Return the format of a file, by its ending."""
    formats = {".h5": "hdf5", ".hdf5": "hdf5", ".mat": "matlab", ".uff": "uff", ".unv": "uff"}
    return formats.get(path.suffix.lower(), "text")
