"""Columns of numbers out of users' files: CSV text, and HDF5."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from dynid.errors import FileError
from dynid.scene.kinds.times import printed_resolution, step_disagreement
from dynid.words import did_you_mean

if TYPE_CHECKING:
    from numpy.typing import NDArray

#: Where the columns of an HDF5 file are looked for when a scene names none.
_MEASURED = ("measured", "identification/measurement/measured")
_TIME = ("time", "t")
_MISSING = ("", "nan", "na", "n/a")
_DECIMAL = r"[-+]?(\d+[.,]\d*|\d*[.,]\d+)([eE][-+]?\d+)?"
_ACCEPTED = "A missing sample is an empty field, nan, NA or n/a; decimals take a point."


@dataclass(frozen=True)
class _File:
    """A file and the dotted place in the scene that names it, where faults are reported."""

    path: Path
    place: str

    def refuse(
        self,
        problem: str,
        remedy: str = "",
        *,
        line: int | None = None,
        key: str = "path",
        colon: bool = False,
    ) -> NoReturn:
        where = f"{self.path}:{line}:" if line is not None else f"{self.path}{':' * colon}"
        names = [f"{self.place}.{key}"] if self.place else []
        raise FileError(f"{where} {problem}", remedy=remedy, names=names)


@dataclass(frozen=True)
class _Table:
    """Rows of numbers, the names of their columns (none: no header), and their times where they have any."""

    file: _File
    names: list[str]
    values: NDArray[np.float64]
    lines: list[int] | None = None
    times: NDArray[np.float64] | None = None
    resolution: NDArray[np.float64] | None = None

    @property
    def data(self) -> list[int]:
        """The columns that are not the time, from 0."""
        return [k for k in range(self.values.shape[1]) if k != _time_column(self.names)]

    def refuse_row(self, row: int, problem: str, remedy: str = "") -> NoReturn:
        if self.lines is None:
            self.file.refuse(f"row {row + 1}: {problem}", remedy, colon=True)
        self.file.refuse(problem, remedy, line=self.lines[row])

    def find(self, name: str | int, key: str) -> int:
        """Return the place of a column that is named, or numbered from 1."""
        count = self.values.shape[1]
        if isinstance(name, int):
            if not 1 <= name <= count:
                columns = f"{count} columns" if count != 1 else "one column"
                self.file.refuse(f"has {columns}, no column {name}", key=key)
            return name - 1
        if self.names.count(name) > 1:
            self.file.refuse(f"has {self.names.count(name)} columns '{name}'", "Give its number.", key=key)
        if name not in self.names:
            hint = did_you_mean(name, self.names)
            known = (
                "" if hint else f"; it has {', '.join(self.names)}" if self.names else "; it has no header"
            )
            self.file.refuse(f"has no column '{name}'{hint or known}", key=key)
        return self.names.index(name)

    def checked(self, columns: Iterable[int], step: float | None) -> NDArray[np.float64]:
        """Return columns without infinite values, at the step that they are taken to have."""
        chosen = self.values[:, list(columns)]
        infinite = np.argwhere(np.isinf(chosen))
        if len(infinite):
            self.refuse_row(int(infinite[0, 0]), "the value is infinite", "Leave a saturated sample empty.")
        if self.times is not None and self.resolution is not None and step is not None:
            if np.isinf(self.times).any():
                self.refuse_row(int(np.argmax(np.isinf(self.times))), "the time is infinite")
            wrong = step_disagreement(self.times, step, self.resolution)
            if wrong is not None:
                remedy = "The rows of a record lie one 'step' apart; a missing sample keeps its row."
                if wrong.row is not None:
                    self.refuse_row(wrong.row, wrong.problem, remedy)
                self.file.refuse(wrong.problem, "Correct the step, or the file.", colon=True)
        return chosen


def read_columns(
    path: Path, columns: Sequence[str | int] | None, *, step: float | None = None, place: str = ""
) -> NDArray[np.float64]:
    """Read columns of a file as an array (rows x columns) with NaN for missing samples.

    Parameters
    ----------
    path
        A `.csv` or `.txt` file with one row a line (semicolons, tabs, commas or spaces; lines that start
        with # are passed over; a first line of names is a header), or an HDF5 file. A missing sample is an
        empty field, `nan`, `NA` or `n/a`. In a file of one column an empty line is a missing sample too; in
        one of several columns it is refused. Empty lines at the end are dropped.
    columns
        Names, or numbers from 1: columns of a table, datasets of an HDF5 file. Absent: all columns of a
        table but one called `time` or `t`; in an HDF5 file the dataset `measured`.
    step
        The step that the rows are taken to have, s; compared with the column `time` or `t` of a table, in
        an HDF5 file with the dataset of that name beside the data.
    place
        The dotted place of the file in the scene, for errors.

    Raises
    ------
    FileError
        Where the file cannot be read, a column is missing, a value is infinite, or the times are not those
        of the step.
    """
    file = _existing(path, place)
    if _is_hdf5(path):
        table = _read_datasets(file, columns)
        if columns is None or not _are_numbers(columns):
            return table.checked(table.data, step)
    else:
        table = _read_text(file)
    wanted = table.data if columns is None else [table.find(name, "columns") for name in columns]
    return table.checked(wanted, step)


def read_signal(
    path: Path, column: str | int | None, *, step: float | None = None, place: str = ""
) -> NDArray[np.float64]:
    """Read one column without missing samples; by default the only one that is not the time.

    Parameters
    ----------
    path, step, place
        As of `read_columns`.
    column
        Its name, or its number from 1. Absent: the only column but `time` or `t`, the only dataset of an
        HDF5 file but these.

    Raises
    ------
    FileError
        As `read_columns`; also where a sample is missing, or several columns could be meant.
    """
    file = _existing(path, place)
    if _is_hdf5(path):
        table = _read_datasets(file, None if column is None else [column], single=True)
        found = table.find(column, "column") if isinstance(column, int) else 0
    else:
        table = _read_text(file)
        found = _only(table) if column is None else table.find(column, "column")
    values = table.checked([found], step)[:, 0]
    if np.isnan(values).any():
        row = int(np.argmax(np.isnan(values)))
        table.refuse_row(row, "a sample of the signal is missing", "A signal is known at every step.")
    return values


def _only(table: _Table) -> int:
    if len(table.data) != 1:
        named = ": " + ", ".join(table.names[k] for k in table.data) if table.names and table.data else ""
        table.file.refuse(
            f"has {len(table.data) or 'no'} columns beside the time{named}",
            "Say which one drives: column: NAME, or its number.",
            key="column",
        )
    return table.data[0]


def _existing(path: Path, place: str) -> _File:
    file = _File(path, place)
    if not path.is_file():
        file.refuse("is no file", "Paths in a scene are relative to the scene's folder.")
    return file


def _is_hdf5(path: Path) -> bool:
    return path.suffix.lower() in (".h5", ".hdf5")


def _time_column(names: Sequence[str]) -> int | None:
    """Return the column of the time, by its name; a unit may stand behind it in brackets.

    Beside `t`, `T` is another quantity.
    """
    bare = [re.sub(r"[\[(].*", "", name).strip() for name in names]
    spelt = [k for k, name in enumerate(bare) if name in _TIME]
    return next(iter([*spelt, *(k for k, name in enumerate(bare) if name.lower() in _TIME)]), None)


# --- text ------------------------------------------------------------------------------------------


def _read_text(file: _File) -> _Table:
    rows = _lines(file)
    separator = next((mark for mark in ";\t," if mark in rows[0][1]), None)
    first = [field.strip() for field in _split(rows[0][1], separator)]
    leading = next((field for field in first if field), "")
    # No sample is taken for a name: names may be whole numbers (`time,1,2`), but the first starts with none.
    has_header = (
        not _is_number(leading)
        and not re.match(r"[-+.,]*\d", leading)
        and not any(re.fullmatch(_DECIMAL, field) for field in first)
    )
    body = rows[has_header:]
    if not body:
        file.refuse("holds names but no data")
    if not has_header and len(first) == 1 and rows[0][0] > 1:
        _refuse_leading_gap(file, rows[0][0])
    fields = [_row(file, number, line, separator, len(first)) for number, line in body]
    lines = [number for number, _ in body]
    values = np.array(
        [_numbers(file, number, row) for number, row in zip(lines, fields, strict=True)], dtype=float
    ).reshape(len(fields), len(first))
    names = first if has_header else []
    timed = _time_column(names)
    if timed is None:
        return _Table(file, names, values, lines)
    times = values[:, timed]
    written = [row[timed] if np.isfinite(t) else "nan" for row, t in zip(fields, times, strict=True)]
    return _Table(file, names, values, lines, times, printed_resolution(written))


def _lines(file: _File) -> list[tuple[int, str]]:
    """Return the lines from the first row to the last that is not empty, with their numbers."""
    try:
        text = file.path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        file.refuse("is not a text in UTF-8", "Tables are text in UTF-8, or HDF5 (.h5).")
    except OSError as error:
        file.refuse(f"cannot be read: {error.strerror}")
    rows = [
        (number, line) for number, line in enumerate(text.split("\n"), 1) if not line.lstrip().startswith("#")
    ]
    filled = [k for k, (_, line) in enumerate(rows) if line.strip(" \t")]
    if not filled:
        file.refuse("holds no data")
    return rows[filled[0] : filled[-1] + 1]


def _refuse_leading_gap(file: _File, first: int) -> None:
    """Refuse empty lines before a lone column without a header: samples may be missing there, or not."""
    with file.path.open(encoding="utf-8-sig") as lines:
        for number, line in zip(range(1, first), lines, strict=False):
            if not line.strip():
                file.refuse(
                    "an empty line before the first sample",
                    "Drop it, or write nan for a sample.",
                    line=number,
                )


def _split(line: str, separator: str | None) -> list[str]:
    if separator is not None and '"' in line:
        return [
            field.strip() for field in next(csv.reader([line], delimiter=separator, skipinitialspace=True))
        ]
    fields = line.split(separator)
    return [field.strip().strip('"') for field in fields] if '"' in line else fields


def _row(file: _File, number: int, line: str, separator: str | None, count: int) -> list[str]:
    if not line.strip(" \t" if separator != "\t" else " "):
        if count > 1:
            file.refuse(
                "an empty line among the rows", "Drop it; a missing sample keeps its row.", line=number
            )
        return [""]
    fields = _split(line, separator)
    if len(fields) != count:
        more = "A number has no comma in it; decimals take a point." if separator == "," else ""
        file.refuse(
            f"{len(fields)} field{'s' * (len(fields) != 1)} where the first row has {count}",
            more,
            line=number,
        )
    return fields


def _numbers(file: _File, number: int, fields: list[str]) -> list[float]:
    try:
        return [_number(field) for field in fields]
    except ValueError:
        wrong = next(field.strip() for field in fields if not _is_number(field))
        file.refuse(f"'{wrong[:40]}' is not a number", _ACCEPTED, line=number)


def _is_number(field: str) -> bool:
    try:
        _number(field)
    except ValueError:
        return False
    return True


def _number(field: str) -> float:
    try:
        number = float(field)
    except ValueError:
        if field.strip().lower() in _MISSING:
            return float("nan")
        raise
    if "_" in field:  # digits in groups are Python's
        raise ValueError(field)
    return number


# --- HDF5 ------------------------------------------------------------------------------------------


def _read_datasets(file: _File, columns: Sequence[str | int] | None, single: bool = False) -> _Table:
    """Read datasets as one table: those that are named, else the columns of the measured ones."""
    import h5py

    try:
        with h5py.File(file.path, "r") as store:
            named = columns is not None and not _are_numbers(columns)
            if columns is not None and named:
                names = [str(name) for name in columns]
            elif single and columns is None:
                names = [_only_dataset(file, store)]
            else:
                names = [next((name for name in _MEASURED if name in store), _MEASURED[0])]
            key = "column" if single else "columns"
            parts = [_dataset(file, store, name, key) for name in names]
            if any(len(part) != len(parts[0]) for part in parts) or (
                len(parts) > 1 and any(part.ndim != 1 for part in parts)
            ):
                file.refuse(f"has no columns of one length in {', '.join(names)}", key=key)
            if single and (named or columns is None) and parts[0][:1].size > 1:
                file.refuse(f"has {parts[0].shape[1]} columns in '{names[0]}'", "Give a number.", key=key)
            values = np.column_stack(parts)
            return _Table(file, [], values, None, *_times(store, names, len(values)))
    except (OSError, RuntimeError, ValueError) as error:
        file.refuse(f"cannot be read as HDF5: {error}")


def _are_numbers(columns: Sequence[str | int]) -> bool:
    return all(isinstance(name, int) for name in columns)


def _only_dataset(file: _File, store: Any) -> str:
    known = [name for name in _numeric(store) if name not in _TIME]
    if len(known) != 1:
        named = f": {', '.join(known)}" if known else ""
        file.refuse(
            f"has {len(known) or 'no'} datasets of numbers beside the time{named}",
            "Say which one drives: column: NAME.",
            key="column",
        )
    return known[0]


def _numeric(group: Any) -> list[str]:
    import h5py

    return [
        name
        for name, value in group.items()
        if isinstance(value, h5py.Dataset) and value.dtype.kind in "iuf" and value.ndim in (1, 2)
    ]


def _times(
    store: Any, names: Sequence[str], rows: int
) -> tuple[NDArray[np.float64] | None, NDArray[np.float64] | None]:
    """Return the times beside the data, and what they are rounded by."""
    group = store[names[0]].parent
    for name in _TIME:
        if name in _numeric(group) and group[name].shape == (rows,):
            stored = group[name][()]
            times = np.asarray(stored, dtype=float)
            coarse = float(np.finfo(stored.dtype).eps) if stored.dtype.kind == "f" else 0.0
            return times, np.abs(np.nan_to_num(times, posinf=0, neginf=0)) * coarse
    return None, None


def _dataset(file: _File, store: Any, name: str, key: str) -> NDArray[np.float64]:
    import h5py

    found = store.get(name)
    if not isinstance(found, h5py.Dataset) or found.dtype.kind not in "iuf" or found.ndim not in (1, 2):
        known = _numeric(store)
        hint = did_you_mean(name, known) or (f"; it has {', '.join(known)}" if known else "")
        file.refuse(f"has no dataset of numbers '{name}'{hint}", key=key)
    return np.asarray(found[()], dtype=float)
