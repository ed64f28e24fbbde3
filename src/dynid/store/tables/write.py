"""Tables into files."""

from __future__ import annotations

import csv
import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.atomic import replacing
from dynid.errors import FileError, UsageError
from dynid.store.tables.table import Field, Kind, Table


def write_csv(table: Table, path: str | os.PathLike[str]) -> None:
    """Write a table as CSV: UTF-8, commas, one header row with units in brackets, what is missing empty.

    Numbers are written with as many digits as tell them apart, so that they read back the same.

    Raises
    ------
    FileError
        When the file cannot be written; an existing one is untouched then.
    """
    with replacing(path) as part, Path(part).open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([_heading(field) for field in table.fields])
        for columns in table.batches():
            texts = [_words(field, column) for field, column in zip(table.fields, columns, strict=True)]
            writer.writerows(zip(*texts, strict=True))


def write_parquet(table: Table, path: str | os.PathLike[str]) -> None:
    """Write a table as Parquet: what is missing is null, units are metadata of the fields.

    Raises
    ------
    UsageError
        Where pyarrow is not installed.
    FileError
        When the file cannot be written; an existing one is untouched then.
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
    with replacing(path) as part:
        try:
            with parquet.ParquetWriter(part, schema) as writer:
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


def _heading(field: Field) -> str:
    return f"{field.name} [{field.units}]" if field.units else field.name


def _missing(column: NDArray[Any]) -> NDArray[np.bool_]:
    if column.dtype.kind == "f":
        return np.asarray(np.isnan(column))
    return np.zeros(len(column), dtype=bool)


def _masked(field: Field, column: NDArray[Any]) -> NDArray[Any]:
    """Return a column in the type of its kind; what is missing is anything."""
    types: dict[Kind, Any] = {"number": float, "integer": np.int64, "truth": bool, "text": object}
    if column.dtype.kind == "f" and field.kind != "number":
        column = np.where(np.isnan(column), 0, column)
    return column.astype(types[field.kind], copy=False)


def _words(field: Field, column: NDArray[Any]) -> list[Any]:
    """Return what a CSV file says of a column's values."""
    values: list[Any] = _masked(field, column).tolist()
    if field.kind == "truth":
        values = ["true" if value else "false" for value in values]
    missing = _missing(column)
    if missing.any():
        for place in np.flatnonzero(missing):
            values[place] = ""
    return values
