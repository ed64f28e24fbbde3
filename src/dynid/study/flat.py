"""Export of a study as one table with a row per sample."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.errors import UsageError
from dynid.store.tables import ColumnKind, ExportTable, TableColumn, kind_of, split
from dynid.study.analysis.table import SAMPLES, StudyTable

#: Most columns of the table.
MOST_COLUMNS = 16_384
_VALUES = 2**20  # values in memory at a time
_STATUS = np.array(["pending", "done", "failed"], dtype=object)
_STORED: dict[str, ColumnKind] = {"bool": "truth", "int64": "integer"}


def flat_table(table: StudyTable, name: str) -> ExportTable:
    """Return a study as a table with a row per sample.

    Parameters
    ----------
    table
        The study.
    name
        The table's name.

    Returns
    -------
    ExportTable
        Columns: number and status of the sample, inputs (by path in the scene), outputs (by path in the
        result; every entry of an array with its labels: `path[label,…]`; complex numbers as `.re` and
        `.im`), the expectations of the scene that are met, and the error of a failed sample, whose outputs
        are missing.

    Raises
    ------
    UsageError
        If the table would have more than `MOST_COLUMNS` columns.
    """
    fields = [TableColumn("sample", "integer"), TableColumn("status", "text")]
    fields += [TableColumn(path, kind_of(column.dtype)) for path, column in table.inputs.items()]
    for path in table.paths:
        variable = table.variable(path)
        parts = [".re", ".im"] if variable.dtype.kind == "c" else [""]
        kind = _STORED.get(str(variable.attrs.get("stored")), kind_of(variable.dtype))
        fields += [
            TableColumn(f"{entry}{part}", kind, variable.units)
            for entry, _ in table.entries(path)
            for part in parts
        ]
    count = sum(path.startswith("study/expect/") for path in table.result)
    fields += [TableColumn(f"expect[{number + 1}]", "truth") for number in range(count)]
    fields.append(TableColumn("error", "text"))
    if len(fields) > MOST_COLUMNS:
        problem = f"the table of samples would have {len(fields):,} columns"
        raise UsageError(problem, remedy="Export with --long: one table per group, one row per entry.")

    def batches() -> Iterator[list[NDArray[Any]]]:
        step = max(1, _VALUES // len(fields))
        for start in range(0, len(table.numbers), step):
            yield _rows(table, start, start + step, count)

    return ExportTable(name, tuple(fields), batches, {"kind": "study", "title": table.result.title})


def _rows(table: StudyTable, start: int, stop: int, expectations: int) -> list[NDArray[Any]]:
    result = table.result
    code = result["study/exit_code"].rows(start, stop)
    columns = [table.numbers[start:stop], _STATUS[np.sign(code) + 1]]
    columns += [result[f"{SAMPLES}/{path}"].rows(start, stop) for path in table.inputs]
    for path in table.paths:
        values = table.variable(path).rows(start, stop).reshape(len(code), -1)
        columns += [part for entry in values.T for part in split(entry)]
    for number in range(expectations):
        met = result[f"study/expect/{number}"].rows(start, stop)
        columns.append(np.where(code == 0, met, np.nan))
    columns.append(result["study/error"].rows(start, stop))
    return columns
