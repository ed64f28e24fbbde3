"""Columns of numbers out of users' files: CSV text, and HDF5."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dynid.errors import FileError
from dynid.scene.yaml.source import did_you_mean

if TYPE_CHECKING:
    from numpy.typing import NDArray

#: Where the columns of an HDF5 file are looked for when a scene names none.
_MEASURED = ("measured", "identification/measurement/measured")


def read_columns(path: Path, columns: Sequence[str | int] | None) -> NDArray[np.float64]:
    """Read columns of a file as an array (rows x columns); an empty field or `nan` is a missing sample.

    Parameters
    ----------
    path
        A `.csv` or `.txt` file with one row a line (commas, semicolons, tabs or spaces; lines that start
        with # are passed over; a first line of names is a header), or an HDF5 file.
    columns
        Names, or numbers from 1: columns of a table, datasets of an HDF5 file. Absent: all columns of a
        table but one called `time` or `t`; in an HDF5 file the dataset `measured`.

    Raises
    ------
    FileError
        Where the file cannot be read or a column is missing.
    """
    if not path.is_file():
        raise FileError(
            f"{path} is no file",
            remedy="Paths in a scene are relative to the scene's folder.",
            names=[str(path)],
        )
    if path.suffix.lower() in (".h5", ".hdf5"):
        return _read_hdf5(path, columns)
    return _read_text(path, columns)


def _read_text(path: Path, columns: Sequence[str | int] | None) -> NDArray[np.float64]:
    try:
        lines = [line.strip() for line in path.read_text(encoding="utf-8-sig").splitlines()]
    except (OSError, UnicodeDecodeError) as error:
        raise FileError(f"{path} cannot be read as text: {error}") from error
    rows = [(number, line) for number, line in enumerate(lines, 1) if line and not line.startswith("#")]
    if not rows:
        raise FileError(f"{path} holds no data")
    separator = next((mark for mark in ",;\t" if mark in rows[0][1]), None)
    first = [field.strip().strip('"') for field in rows[0][1].split(separator)]
    header = [] if all(_is_number(field) for field in first) else first
    numbers = [
        _numbers(path, number, line.split(separator), len(first)) for number, line in rows[bool(header) :]
    ]
    table = np.array(numbers).reshape(len(numbers), len(first))
    if columns is None:
        columns = [
            k for k in range(1, len(first) + 1) if not header or header[k - 1].lower() not in ("time", "t")
        ]
    return table[:, [_column(path, header, len(first), name) for name in columns]]


def _numbers(path: Path, number: int, fields: list[str], count: int) -> list[float]:
    if len(fields) != count:
        raise FileError(f"{path}:{number}: {len(fields)} fields where the first row has {count}")
    try:
        return [float(field) if field.strip() else float("nan") for field in fields]
    except ValueError as error:
        raise FileError(f"{path}:{number}: {error}") from None


def _is_number(field: str) -> bool:
    try:
        float(field or "nan")
    except ValueError:
        return False
    return True


def _column(path: Path, header: list[str], count: int, name: str | int) -> int:
    if isinstance(name, int):
        if not 1 <= name <= count:
            raise FileError(f"{path} has {count} columns, no column {name}")
        return name - 1
    if name not in header:
        raise FileError(f"{path} has no column '{name}'{did_you_mean(name, header)}")
    return header.index(name)


def _read_hdf5(path: Path, columns: Sequence[str | int] | None) -> NDArray[np.float64]:
    import h5py

    try:
        with h5py.File(path, "r") as file:
            if columns is None or all(isinstance(name, int) for name in columns):
                table = _dataset(path, file, next((name for name in _MEASURED if name in file), _MEASURED[0]))
                table = table.reshape(len(table), -1)
                wanted = range(1, table.shape[1] + 1) if columns is None else columns
                return table[:, [_column(path, [], table.shape[1], number) for number in wanted]]
            parts = [_dataset(path, file, str(name)) for name in columns]
    except (OSError, RuntimeError, ValueError) as error:
        raise FileError(f"{path} cannot be read as HDF5: {error}") from error
    if any(part.ndim != 1 or len(part) != len(parts[0]) for part in parts):
        raise FileError(f"{path}: the datasets {', '.join(map(str, columns))} are not columns of one length")
    return np.column_stack(parts)


def _dataset(path: Path, file: Any, name: str) -> NDArray[np.float64]:
    import h5py

    found = file.get(name)
    if not isinstance(found, h5py.Dataset) or found.dtype.kind not in "iuf" or found.ndim not in (1, 2):
        known = [key for key, value in file.items() if isinstance(value, h5py.Dataset)]
        raise FileError(f"{path} has no dataset of numbers '{name}'{did_you_mean(name, known)}")
    return np.asarray(found[()], dtype=float)
