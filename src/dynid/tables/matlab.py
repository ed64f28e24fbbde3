"""Tables in MATLAB files: a matrix, named vectors, or a row of a cell array of vectors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.structure.matrices import Array
from dynid.structure.readers.matlab import arrays, complex_matrix, names
from dynid.suggestions import did_you_mean
from dynid.tables.table import DataFile, DataTable, TableLayout, are_numbers


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
