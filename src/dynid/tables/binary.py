"""MATLAB and HDF5 files of measured data: their arrays as tables."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.errors import DynidError
from dynid.hdf5 import Refused, check_stored, inside, open_hdf5
from dynid.structure.matrices import Array
from dynid.structure.readers.matlab import arrays, complex_matrix, names
from dynid.suggestions import did_you_mean
from dynid.tables.table import TIME, DataFile, DataTable, TableLayout, are_numbers


def read_matlab(file: DataFile, columns: Sequence[str | int] | None, layout: TableLayout) -> DataTable:
    """Return named vectors as one table, or the columns of one variable.

    Of a cell array a row is a table, its cells the columns.
    """
    named = columns is not None and not are_numbers(columns)
    if columns is not None and named:
        layout.only(file, "time")
        wanted = [str(name) for name in columns]
        parts = [_vector(file, name, _cells(file, name, "columns", None)[0]) for name in wanted]
        if isinstance(layout.time, str):
            wanted.append(layout.time)
            parts.append(_vector(file, layout.time, _cells(file, layout.time, "time", None)[0]))
    else:
        known = names(file.path) if layout.variable is None else [layout.variable]
        if len(known) != 1:
            listed = f": {', '.join(known[:20])}" if known else ""
            file.refuse(f"has {len(known) or 'no'} variables{listed}", "Name it: variable: NAME.")
        variable = known[0]
        wanted, parts = [], _cells(file, variable, "variable", layout.row)
        if len(parts) > 1:
            numbers = {number for number in (*(columns or ()), layout.time) if isinstance(number, int)}
            used = numbers if columns else set()
            rows = max((parts[k - 1].size for k in used if 1 <= k <= len(parts)), default=0)
            parts = [
                _vector(file, variable, cell) if not used or k in used else np.full(rows, np.nan)
                for k, cell in enumerate(parts, 1)
            ]
        elif min(parts[0].shape) == 1:
            parts = [parts[0].reshape(-1, 1)]
    if any(len(part) != len(parts[0]) for part in parts):
        lengths = ", ".join(str(len(part)) for part in parts)
        file.refuse(f"has columns of different lengths: {lengths}", key="columns" if named else "variable")
    table = DataTable(file, wanted, np.column_stack(parts))
    return table if layout.time is None else table.timed_by(table.find(layout.time, "time"))


def complex_columns(file: DataFile, wanted: Sequence[str], key: str) -> NDArray[Any]:
    """Return the first variable of these names as columns of real or complex numbers."""
    known = names(file.path)
    name = next((name for name in wanted if name in known), wanted[0])
    if name not in known:
        hint = did_you_mean(name, known) or (f"; it has {', '.join(known[:20])}" if known else "")
        file.refuse(f"has no variable '{name}'{hint}", key=key)
    values = complex_matrix(file.path, name)
    return values.reshape(-1, 1) if min(values.shape) == 1 else values


def whole_numbers(file: DataFile, name: str, key: str) -> list[int]:
    """Return a variable of whole numbers, such as those of DOFs."""
    values = complex_columns(file, [name], key).ravel()
    if len(broken := values[values != np.round(values.real)]):
        file.refuse(
            f"has {broken[0]:g} in '{name}', no whole number",
            "Number the DOFs, or name them in the scene: modes: {sensors: [12:z, …]}.",
            key=key,
        )
    return [int(value) for value in values.real]


def _cells(file: DataFile, name: str, key: str, row: int | None) -> list[Array]:
    """Return the arrays of a variable: one, or those of a row of cells."""
    known = names(file.path)
    if name not in known:
        hint = did_you_mean(name, known) or (f"; it has {', '.join(known[:20])}" if known else "")
        file.refuse(f"has no variable '{name}'{hint}", key=key)
    shape, found = arrays(file.path, name)
    if shape is None:
        if row is not None:
            file.refuse(f"holds a matrix in '{name}', no rows of cells", key="row")
        return found
    if row is None and shape[0] > 1:
        file.refuse(f"has {shape[0]} rows of cells in '{name}'", "Give it: row: NUMBER.", key=key)
    if row is not None and row > shape[0]:
        file.refuse(f"has {shape[0]} rows of cells in '{name}', no row {row}", key="row")
    return found[(row or 1) - 1 :: shape[0]]


def _vector(file: DataFile, name: str, values: Array) -> Array:
    if values.size != max(values.shape):
        file.refuse(f"has {values.shape[0]} x {values.shape[1]} numbers in '{name}', not a column of them")
    return np.asarray(values.ravel())


#: The datasets of the columns where a scene names none.
_MEASURED = ("measured", "identification/measurement/measured")


def read_datasets(
    file: DataFile,
    columns: Sequence[str | int] | None,
    single: bool = False,
    time: str | None = None,
    rows: int | None = None,
) -> DataTable:
    """Return datasets as one table: the named ones, else the columns of the measured ones.

    `time` is the dataset of the times; absent: `time` or `t` beside the first one. At most `rows` rows are
    read.
    """
    with _opened(file) as store:
        named = columns is not None and not are_numbers(columns)
        if columns is not None and named:
            names = [str(name) for name in columns]
        elif single and columns is None:
            names = [name for name in _numeric(store) if name not in TIME]
            if len(names) != 1:
                beside = f": {', '.join(names)}" if names else ""
                file.refuse(
                    f"has {len(names) or 'no'} datasets of numbers beside the time{beside}",
                    "Name the one that drives: column: NAME.",
                    key="column",
                )
        else:
            names = [next((name for name in _MEASURED if inside(store, name) is not None), _MEASURED[0])]
        key = "column" if single else "columns"
        lengths = {len(_found(file, store, name, key, "iuf")) for name in names}
        parts = [np.asarray(_numbers(file, store, name, key, rows=rows), dtype=float) for name in names]
        if (
            len(lengths) > 1
            or any(len(part) != len(parts[0]) for part in parts)
            or (len(parts) > 1 and any(part.ndim != 1 for part in parts))
        ):
            file.refuse(f"has no columns of one length in {', '.join(names)}", key=key)
        if single and (named or columns is None) and parts[0][:1].size > 1:
            file.refuse(f"has {parts[0].shape[1]} columns in '{names[0]}'", "Give a number.", key=key)
        values = np.column_stack(parts)
        times = _times(file, store, names, lengths.pop(), time, rows)
        return DataTable(file, [], values, None, *times)


@contextmanager
def _opened(file: DataFile) -> Iterator[Any]:
    """Open a file; errors of reading it name the file."""
    try:
        with open_hdf5(file.path) as store:
            yield store
    except Refused as error:
        file.refuse(str(error), colon=True)
    except DynidError:
        raise
    except Exception as error:  # a damaged file makes h5py raise nearly anything
        file.refuse(f"cannot be read as HDF5: {' '.join(str(error).split())}")


def _numeric(group: Any, kinds: str = "iuf") -> list[str]:
    return [name for name in group if _is_table(_unless_elsewhere(group, name), kinds)]


def _unless_elsewhere(group: Any, name: str) -> Any:
    """Return a member of a group, None where it is in another file."""
    try:
        return inside(group, name)
    except Refused:
        return None


def _is_table(item: Any, kinds: str) -> bool:
    import h5py

    return isinstance(item, h5py.Dataset) and item.dtype.kind in kinds and item.ndim in (1, 2)


def _times(
    file: DataFile, store: Any, names: Sequence[str], length: int, time: str | None, rows: int | None
) -> tuple[NDArray[np.float64] | None, NDArray[np.float64] | None]:
    """Return the times beside the data, and their rounding."""
    if time is not None and _found(file, store, time, "time", "iuf").shape != (length,):
        file.refuse(f"has {length} rows of data, but another number of times in '{time}'", key="time")
    folder = names[0].rpartition("/")[0]
    for name in [f"{folder}/{known}".lstrip("/") for known in TIME] if time is None else [time]:
        beside = _unless_elsewhere(store, name)
        if _is_table(beside, "iuf") and beside.shape == (length,):
            check_stored(beside)
            stored = beside[:rows]
            times = np.asarray(stored, dtype=float)
            coarse = float(np.finfo(stored.dtype).eps) if stored.dtype.kind == "f" else 0.0
            return times, np.abs(np.nan_to_num(times, posinf=0, neginf=0)) * coarse
    return None, None


def present(file: DataFile, names: Sequence[str]) -> list[str]:
    """Return those of these names that a file has."""
    with _opened(file) as store:
        return [name for name in names if inside(store, name) is not None]


def complex_datasets(file: DataFile, name: str, key: str) -> NDArray[Any]:
    """Return a dataset of real or complex numbers as columns."""
    with _opened(file) as store:
        found = _numbers(file, store, name, key, "iufc")
    return found.reshape(len(found), -1)


def _numbers(
    file: DataFile, store: Any, name: str, key: str, kinds: str = "iuf", rows: int | None = None
) -> NDArray[Any]:
    """Return the first rows of a dataset of one or two axes, of numbers of these NumPy kinds; absent: all."""
    found = _found(file, store, name, key, kinds)
    check_stored(found)
    return np.asarray(found[:rows])


def _found(file: DataFile, store: Any, name: str, key: str, kinds: str) -> Any:
    """Return a dataset of one or two axes, of numbers of these NumPy kinds, unread."""
    found = inside(store, name)
    if not _is_table(found, kinds):
        known = _numeric(store, kinds)
        hint = did_you_mean(name, known) or (f"; it has {', '.join(known)}" if known else "")
        file.refuse(f"has no dataset of numbers '{name}'{hint}", key=key)
    return found
