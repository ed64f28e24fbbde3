"""Results as tables for other tools: CSV and Parquet, written in batches, whole or not at all.

A table is a sequence of named columns with units. The arrays of a group that share their axes make one
table, with a row for each entry.
"""

from __future__ import annotations

import csv
import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from dynid.errors import FileError, UsageError
from dynid.file_access import replacing
from dynid.result import Result, Variable, coordinate_path
from dynid.suggestions import printable

ColumnKind = Literal["number", "integer", "truth", "text"]
_KINDS: dict[str, ColumnKind] = {"b": "truth", "i": "integer", "f": "number", "O": "text"}


@dataclass(frozen=True)
class TableColumn:
    """One column: integers and Booleans may come as floats, with NaN for missing values."""

    name: str
    kind: ColumnKind = "number"
    units: str = ""


@dataclass(frozen=True)
class ExportTable:
    """Named columns with units, whose rows come in batches; NaN and the empty text mark missing values."""

    name: str  # without slashes
    fields: tuple[TableColumn, ...]
    #: Returns its rows from the first one on, in batches: for every column an array of the same length.
    batches: Callable[[], Iterator[list[NDArray[Any]]]]
    attrs: Mapping[str, str] = field(default_factory=dict)


def kind_of(dtype: np.dtype[Any]) -> ColumnKind:
    """Return the kind of column of a type; complex numbers are two columns of numbers."""
    return _KINDS.get(dtype.kind, "number")


def _parts_of(name: str, dtype: np.dtype[Any], units: str) -> list[TableColumn]:
    """Return the columns of values of a type: one, two of complex numbers, those of structured arrays."""
    if dtype.names:
        return [
            column_name
            for column in dtype.names
            for column_name in _parts_of(f"{name}.{column}", dtype[column], units)
        ]
    if dtype.kind == "c":
        return [TableColumn(f"{name}.re", "number", units), TableColumn(f"{name}.im", "number", units)]
    return [TableColumn(name, kind_of(dtype), units)]


def split(values: NDArray[Any]) -> list[NDArray[Any]]:
    """Return the columns of values in the order of `_parts_of`, flattened."""
    flat = values.reshape(-1)
    if flat.dtype.names:
        return [array for column in flat.dtype.names for array in split(flat[column])]
    return [flat.real, flat.imag] if flat.dtype.kind == "c" else [flat]


_VALUES = 2**19  # rows in memory at a time
NamedArray = tuple[str, Variable]


def tables_of(result: Result) -> list[ExportTable]:
    """Return all arrays of a result, in memory or stored, as tables, by group and axes.

    Arrays without axes make one row. Others have a row for each entry, with the labels of its axes in the
    first columns (their coordinates, or numbers from 1). The name is the group's, with dots for slashes; of a
    group with several tables followed by the axes. Complex numbers are two columns, `.re` and `.im`.
    """
    groups: dict[str, dict[tuple[str, ...], list[NamedArray]]] = {}
    for path in sorted(result):
        group, _, name = path.rpartition("/")
        variable = result[path]
        groups.setdefault(group, {}).setdefault(variable.dims, []).append((name, variable))
    tables = []
    for group, shapes in groups.items():
        for dims, members in shapes.items():
            # Coordinates that are columns of other tables make none of their own.
            used = any(dims != longer and set(dims) <= set(longer) for longer in shapes)
            if not (used and all((name,) == dims for name, _ in members)):
                tables.append(_table(result, group, dims, members, len(shapes) > 1))
    return tables


def _table(
    result: Result, group: str, dims: tuple[str, ...], members: Sequence[NamedArray], several: bool
) -> ExportTable:
    shape = members[0][1].shape
    columns = [(name, variable) for name, variable in members if variable.shape == shape and (name,) != dims]
    axes = [_axis(result, group, dim, length) for dim, length in zip(dims, shape, strict=True)]
    fields = [TableColumn(dim, kind_of(axis.dtype), axis.units) for dim, axis in zip(dims, axes, strict=True)]
    for name, variable in columns:
        fields += _parts_of(name, variable.dtype, variable.units)
    names = unique([field.name for field in fields])
    fields = [replace(field, name=name) for field, name in zip(fields, names, strict=True)]
    name = (group.replace("/", ".") or "root") + (
        f"-{'-'.join(names[: len(dims)])}" if several and dims else ""
    )
    labels = [axis.data for axis in axes]

    def batches() -> Iterator[list[NDArray[Any]]]:
        if not shape:
            yield [array for _, variable in columns for array in split(variable.data)]
            return
        below = math.prod(shape[1:])
        step = max(1, _VALUES // max(1, below))
        for start in range(0, shape[0], step):
            stop = min(start + step, shape[0])
            entries = np.indices((stop - start, *shape[1:])).reshape(len(shape), -1)  # the last axis fastest
            yield [
                *(axis[at] for axis, at in zip((labels[0][start:stop], *labels[1:]), entries, strict=True)),
                *(array for _, variable in columns for array in split(variable.rows(start, stop))),
            ]

    return ExportTable(
        name, tuple(fields), batches, {"group": group, "kind": result.kind, "title": result.title}
    )


def _axis(result: Result, group: str, dim: str, length: int) -> Variable:
    """Return the coordinate of a dimension in its group or the nearest one above, else numbers from 1."""
    axis = result.get(coordinate_path(result, f"{group}/", dim) or "")
    if axis is None or axis.shape != (length,) or axis.dtype.names or axis.dtype.kind == "c":
        return Variable((dim,), np.arange(1, length + 1))
    return axis


def unique(names: Sequence[str]) -> list[str]:
    """Return the names with numbers appended to repeated ones (both axes of a matrix may be the same)."""
    seen: dict[str, int] = {}
    names_used = []
    for name in names:
        seen[name] = seen.get(name, 0) + 1
        names_used.append(name if seen[name] == 1 else f"{name}_{seen[name]}")
    return names_used


#: First characters of texts that spreadsheets evaluate as formulas.
_FORMULA = ("=", "+", "-", "@")


def write_csv(table: ExportTable, path: str | os.PathLike[str]) -> None:
    """Write a table as CSV: UTF-8, commas, one header row with units in brackets, missing values empty.

    Numbers are written with all digits, so that they read back the same. Control characters in texts are
    written as escapes. A text that a spreadsheet would evaluate as a formula (it begins with =, +, - or @ and
    is no number) is preceded by an apostrophe. Raises `FileError` when the file cannot be written; an
    existing one is untouched then.
    """
    with replacing(path) as temporary, Path(temporary).open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(
            [
                _harmless(f"{field.name} [{field.units}]" if field.units else field.name)
                for field in table.fields
            ]
        )
        for columns in table.batches():
            texts = [_words(field, column) for field, column in zip(table.fields, columns, strict=True)]
            writer.writerows(zip(*texts, strict=True))


def write_parquet(table: ExportTable, path: str | os.PathLike[str]) -> None:
    """Write a table as Parquet: missing values are null, units are metadata of the fields.

    Raises `UsageError` where pyarrow is not installed, `FileError` when the file cannot be written; an
    existing one is untouched then.
    """
    try:
        import pyarrow as pa  # type: ignore[import-untyped, unused-ignore]
        from pyarrow import parquet  # type: ignore[import-untyped, unused-ignore]
    except ImportError:
        raise UsageError(
            "Parquet files need pyarrow", remedy="Run: pip install 'dynid[formats]', or export with --csv."
        ) from None

    types = {"number": pa.float64(), "integer": pa.int64(), "truth": pa.bool_(), "text": pa.string()}
    schema = pa.schema(
        [
            pa.field(field.name, types[field.kind], metadata={"units": field.units} if field.units else None)
            for field in table.fields
        ],
        metadata=dict(table.attrs),
    )
    with replacing(path) as temporary:
        try:
            with parquet.ParquetWriter(temporary, schema) as writer:
                for columns in table.batches():
                    arrays = [
                        pa.array(_masked(field, column), types[field.kind], mask=_missing(column))
                        for field, column in zip(table.fields, columns, strict=True)
                    ]
                    writer.write_batch(pa.record_batch(arrays, schema=schema))
        except pa.ArrowException as error:
            raise FileError(
                f"{os.fspath(path)} cannot be written: {error}", names=[os.fspath(path)]
            ) from error


def _harmless(text: str) -> str:
    """Return a text without control characters that a spreadsheet does not evaluate."""
    text = printable(text)
    if not text.lstrip().startswith(_FORMULA):
        return text
    try:
        float(text)
    except ValueError:
        return f"'{text}"
    return text


def _missing(column: NDArray[Any]) -> NDArray[np.bool_]:
    if column.dtype.kind == "f":
        return np.asarray(np.isnan(column))
    return np.zeros(len(column), dtype=bool)


def _masked(field: TableColumn, column: NDArray[Any]) -> NDArray[Any]:
    """Return a column in the type of its kind; missing values are arbitrary."""
    types: dict[ColumnKind, Any] = {"number": float, "integer": np.int64, "truth": bool, "text": object}
    if column.dtype.kind == "f" and field.kind != "number":
        column = np.where(np.isnan(column), 0, column)
    return column.astype(types[field.kind], copy=False)


def _words(field: TableColumn, column: NDArray[Any]) -> list[Any]:
    """Return the values of a column as a CSV file has them."""
    values: list[Any] = _masked(field, column).tolist()
    if field.kind == "truth":
        values = ["true" if value else "false" for value in values]
    if field.kind == "text":
        values = [_harmless(str(value)) for value in values]
    missing = _missing(column)
    if missing.any():
        for row in np.flatnonzero(missing):
            values[row] = ""
    return values
