"""Result of a study as a table: samples in rows, inputs and outputs in columns; its failures; its export.

Arrays are read on access, one at a time, so that any number of samples fits in memory.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.checks.comparison import word
from dynid.checks.expectations import LabelledAxis, axis_of
from dynid.errors import DynidError, UsageError
from dynid.result import Result, Variable, covers
from dynid.scene.schema.raw import unit_of_frequencies
from dynid.scene.yaml.source import parse_source
from dynid.store.reader import in_unit
from dynid.store.tables import ColumnKind, ExportTable, TableColumn, kind_of, split
from dynid.suggestions import did_you_mean, did_you_mean_path
from dynid.units import RADIANS, FrequencyUnit

SAMPLES, RESULTS, STATISTICS = "study/samples", "study/results", "study/statistics"

_NUMBER = re.compile(r"[-+±]?\d[\d.]*(?:[eE][-+]?\d+)?j?")
_ENTRY = re.compile(r"(?P<path>[^\[]*)\[(?P<labels>.*)\]")


@dataclass(frozen=True)
class StudyColumn:
    """Output of a study, one number per sample; NaN where it is missing, magnitudes of complex numbers.

    The name is the path in the result, for an entry of an array with its labels: `path[label,…]`.
    """

    name: str
    units: str
    values: NDArray[np.float64]


def statuses(exit_codes: NDArray[np.int64]) -> NDArray[Any]:
    """Return the status of samples by their exit codes: pending (-1), done (0) or failed."""
    names: NDArray[Any] = np.array(["pending", "done", "failed"], dtype=object)[np.sign(exit_codes) + 1]
    return names


def lengths_of(path: str, variable: Variable) -> str | None:
    """Return the path of the lengths of a padded array; None for another one."""
    name = variable.attrs.get("lengths")
    return None if name is None else f"{path.rpartition('/')[0]}/{name}".strip("/")


class StudyTable:
    """Result of a study, in memory or stored, as a table.

    `stored`: frequencies are in rad/s, as in the file; else in the unit of the scene. Raises `UsageError` if
    the result is of another kind.
    """

    def __init__(self, result: Result, *, stored: bool = False) -> None:
        self._stored = stored
        if result.kind != "study" or "study/exit_code" not in result:
            raise UsageError(f"this is a result of kind {result.kind}, not of a study")
        self.result = result

    @cached_property
    def failed(self) -> NDArray[np.intp]:
        """The rows of the samples that failed."""
        return np.flatnonzero(self._exit_codes > 0)

    @cached_property
    def pending(self) -> NDArray[np.intp]:
        """The rows of the samples that have not been run."""
        return np.flatnonzero(self._exit_codes < 0)

    @cached_property
    def done(self) -> NDArray[np.bool_]:
        """Mask of the samples that have results."""
        return np.equal(self._exit_codes, 0)

    @cached_property
    def _exit_codes(self) -> NDArray[np.int64]:
        return self.result["study/exit_code"].data

    @cached_property
    def numbers(self) -> NDArray[np.int64]:
        """The number in the plan of the sample of each row."""
        return self.result["study/sample"].data

    @cached_property
    def inputs(self) -> dict[str, NDArray[Any]]:
        """Inputs of the study by their paths in the scene, in the order of the names."""
        names = sorted(_below(self.result, SAMPLES))
        return {name: self.result[f"{SAMPLES}/{name}"].data for name in names}

    @cached_property
    def varied(self) -> dict[str, NDArray[Any]]:
        """The inputs that the study varies; without those that its `derive` computes from them."""
        derived = self._scene.get("derive") or ()
        return {name: column for name, column in self.inputs.items() if name not in derived}

    @cached_property
    def paths(self) -> list[str]:
        """Paths of all outputs, including texts, in the order of the study's `collect`."""
        variables = {path: self.variable(path) for path in _below(self.result, RESULTS)}
        quantities = {
            path: variable for path, variable in variables.items() if variable.dims[:1] == ("sample",)
        }
        lengths = {lengths_of(path, variable) for path, variable in quantities.items()}
        collected = [str(path_or_group).strip("/") for path_or_group in self._scene.get("collect") or ()]
        return sorted(
            (path for path in quantities if path not in lengths),
            key=lambda path: next(
                (k for k, path_or_group in enumerate(collected) if covers(path_or_group, path)),
                len(collected),
            ),
        )

    @cached_property
    def _scene(self) -> dict[str, Any]:
        """Data of the study's scene; empty in a file that others wrote."""
        try:
            data = parse_source(str(self.result.attrs.get("scene", ""))).data
        except DynidError:
            return {}
        is_valid = isinstance(data, dict) and isinstance(data.get("derive") or {}, dict)
        return data if is_valid and isinstance(data.get("collect") or [], list) else {}

    @cached_property
    def _frequency_unit(self) -> FrequencyUnit:
        base = None if self._stored else self.result.get("study/scene")
        try:
            return RADIANS if base is None else unit_of_frequencies(parse_source(str(base.data)).data)
        except DynidError:  # of a file that others wrote
            return RADIANS

    def variable(self, path: str) -> Variable:
        """Return the output at a path; its first axis is the samples."""
        return in_unit(path, self.result[f"{RESULTS}/{path}"], self._frequency_unit)

    def is_number(self, path: str) -> bool:
        """Return whether the output at a path is numeric."""
        return self.variable(path).dtype.kind in "bifc"

    def size(self, path: str) -> int:
        """Return the number of entries of one sample at a path."""
        return math.prod(self.variable(path).shape[1:])

    def axes(self, path: str) -> list[LabelledAxis]:
        """Return the axes of one sample at a path."""
        variable = self.variable(path)
        axes = [
            axis_of(self.result, f"{RESULTS}/{path}", dim, length)
            for dim, length in zip(variable.dims[1:], variable.shape[1:], strict=True)
        ]
        unit = self._frequency_unit
        for index, axis in enumerate(axes):
            if axis.units == RADIANS.name and unit.factor != 1:
                # As a scene has them, without the last two digits, which converted units change.
                labels = np.array([float(f"{label * unit.factor:.14g}") for label in axis.labels])
                axes[index] = replace(axis, labels=labels, units=unit.name)
        return axes

    def columns(self, path: str) -> Iterator[StudyColumn]:
        """Yield the number at a path, or every entry of an array of numbers, as columns."""
        variable = self.variable(path)
        values = as_numbers(variable.data).reshape(variable.shape[0], -1)
        for number, (name, _) in enumerate(self.entries(path)):
            yield StudyColumn(name, variable.units, values[:, number])

    def entries(self, path: str) -> Iterator[tuple[str, tuple[int, ...]]]:
        """Yield name and index of each entry of one sample at a path."""
        axes = self.axes(path)
        labels = [[_label(label) for label in axis.labels] for axis in axes]
        for index in np.ndindex(*(len(axis.labels) for axis in axes)):
            chosen = ",".join(labels[axis][step] for axis, step in enumerate(index))
            yield f"{path}[{chosen}]" if axes else path, index

    def find(self, name: str) -> tuple[str, tuple[int, ...] | None]:
        """Return the path and the index of a named entry; index None for a whole array.

        Raises `UsageError` if there is no such number.
        """
        name = name.strip("/").removeprefix(f"{RESULTS}/")
        match = _ENTRY.fullmatch(name)
        path = match["path"] if match and name not in self.paths else name
        if path not in self.paths:
            hint = did_you_mean_path(path, self.paths)
            raise UsageError(f"the study has collected nothing at '{path}'{hint}")
        if not self.is_number(path):
            raise UsageError(f"'{path}' is a text, which has no worst")
        if path == name:
            return path, None if self.variable(path).dims[1:] else ()
        axes = self.axes(path)
        labels = match["labels"].split(",") if match else []
        if len(labels) != len(axes):
            dims = ", ".join(axis.dim for axis in axes) or "none"
            raise UsageError(f"'{name}' names {len(labels)} entries; the axes of {path} are: {dims}")
        return path, tuple(
            _place(axis, label.strip(), path) for axis, label in zip(axes, labels, strict=True)
        )


def _below(result: Result, group: str) -> list[str]:
    return [path.removeprefix(f"{group}/") for path in result if path.startswith(f"{group}/")]


def as_numbers(data: NDArray[Any]) -> NDArray[np.float64]:
    """Return values as float64, complex ones by their magnitude."""
    return np.abs(data) if data.dtype.kind == "c" else data.astype(np.float64, copy=False)


def _label(label: Any) -> str:
    return str(label) if isinstance(label, str) else word(label)


def _place(axis: LabelledAxis, label: str, path: str) -> int:
    names = [_label(name) for name in axis.labels]
    if label in names:
        return names.index(label)
    index = None
    if axis.labels.dtype.kind in "if":
        try:
            index = axis.find(float(label))
        except ValueError:
            index = None
    if index is None:
        raise UsageError(f"{path} has no {axis.dim} {label}{did_you_mean(label, names)}")
    return index


@dataclass(frozen=True)
class _Failure:
    """Samples that failed with the same error, apart from numbers in it; the message is of the first one."""

    error: str
    exit_code: int
    samples: NDArray[np.int64]


def failures(table: StudyTable) -> list[_Failure]:
    """Return the failed samples grouped by error, the most frequent first."""
    if not len(table.failed):
        return []
    errors = table.result["study/error"].data[table.failed]
    codes = table.result["study/exit_code"].data[table.failed]
    groups: dict[str, list[int]] = {}
    for row, error in enumerate(errors):
        groups.setdefault(_NUMBER.sub("#", str(error)), []).append(row)
    failed = [
        _Failure(str(errors[rows[0]]), int(codes[rows[0]]), table.numbers[table.failed[rows]])
        for rows in groups.values()
    ]
    return sorted(failed, key=lambda failure: -len(failure.samples))


#: Most columns of the table.
MOST_COLUMNS = 16_384
_EXPORTED = 2**20  # values in memory at a time
_STORED: dict[str, ColumnKind] = {"bool": "truth", "int64": "integer"}


def flat_table(table: StudyTable, name: str) -> ExportTable:
    """Return a study as a named table with a row per sample.

    Columns: number and status of the sample, inputs (by path in the scene), outputs (by path in the result;
    every entry of an array with its labels: `path[label,…]`; complex numbers as `.re` and `.im`), the
    expectations of the scene that are met, and the error of a failed sample, whose outputs are missing.
    Raises `UsageError` if it would have more than `MOST_COLUMNS` columns.
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
        step = max(1, _EXPORTED // len(fields))
        for start in range(0, len(table.numbers), step):
            yield _exported_rows(table, start, start + step, count)

    return ExportTable(name, tuple(fields), batches, {"kind": "study", "title": table.result.title})


def _exported_rows(table: StudyTable, start: int, stop: int, expectations: int) -> list[NDArray[Any]]:
    result = table.result
    code = result["study/exit_code"].rows(start, stop)
    columns = [table.numbers[start:stop], statuses(code)]
    columns += [result[f"{SAMPLES}/{path}"].rows(start, stop) for path in table.inputs]
    for path in table.paths:
        values = table.variable(path).rows(start, stop).reshape(len(code), -1)
        columns += [column for entry in values.T for column in split(entry)]
    for number in range(expectations):
        met = result[f"study/expect/{number}"].rows(start, stop)
        columns.append(np.where(code == 0, met, np.nan))
    columns.append(result["study/error"].rows(start, stop))
    return columns
