"""The HDF5 file of a study: sample-first arrays, from outcomes that are never in memory all at once.

`study/sample` numbers the samples; `study/samples/<path>` is what was varied; `study/results/<path>` what
was gathered, where failed and pending samples are NaN (or an empty text); `study/status`, `study/error`,
`study/exit_code`, `study/key` and `study/expect/<n>` tell of each sample; `study/statistics/<path>` sums the
results up. Nothing under `study/` tells of a clock, a host or a duration.

Numbers and truth values are float64, so that what is missing can be NaN; the attribute `stored` keeps
their own type. Arrays that differ in length from sample to sample are padded; the attribute `lengths`
names the array of their lengths.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.errors import FileError
from dynid.result import Result, Scalar, Variable
from dynid.scene.batch import Outcome
from dynid.store import hollow, read_result, write_blocks
from dynid.study.analysis.table import RESULTS, SAMPLES
from dynid.study.statistics import computed, declare

_BLOCK_BYTES = 32 * 2**20
_BLOCK_ROWS = 4096


@dataclass(frozen=True)
class Heading:
    """What the file of a study says beside the outcomes.

    Parameters
    ----------
    title
        The study's title.
    text
        Its YAML text.
    base
        The YAML text of the scene it varies.
    seed
        The seed of its sampling.
    numbers
        The number of each row's sample in the plan, from 0: all of them, or those of a shard.
    columns
        What was varied, by path: a number, text or other plain value for each row.
    keys
        The key of each row's sample (rows x bytes).
    attrs
        Further attributes of the group `study`.
    """

    title: str
    text: str
    base: str
    seed: int
    numbers: NDArray[np.int64]
    columns: Mapping[str, Sequence[Any]]
    keys: NDArray[np.uint8]
    attrs: Mapping[str, Scalar] = field(default_factory=dict)


def write_study(
    path: str | os.PathLike[str], heading: Heading, rows: Iterable[Outcome | None], complete: bool = True
) -> None:
    """Write the file of a study, whole or not at all.

    Parameters
    ----------
    path
        The file; an existing one is replaced.
    heading
        What it says beside the outcomes.
    rows
        The outcome of each row, None where it is pending. It is gone through twice.
    complete
        Whether this is the end of the study.

    Raises
    ------
    FileError
        When it cannot be written. An existing file is untouched then.
    """
    layout = _Layout()
    for outcome in rows:
        layout.see(outcome)
    count = len(heading.numbers)
    result = Result("study", heading.title, {"scene": heading.text, "seed": heading.seed})
    result.add_axis("study/sample", heading.numbers)
    result.add("study/scene", np.array(heading.base, dtype=object))
    result.annotate("study", **heading.attrs)
    for name, column in heading.columns.items():
        result.add(f"{SAMPLES}/{name}", as_column(column), ("sample",))
    for name in ("status", "error", "key"):
        result.add(f"study/{name}", hollow((count,), object), ("sample",))
    result.add("study/exit_code", hollow((count,), np.int64), ("sample",))
    for number in range(layout.expectations):
        result.add(f"study/expect/{number}", hollow((count,), np.bool_), ("sample",))
    layout.declare(result, count)
    declare(result)
    write_blocks(result, path, _blocks(heading, layout, rows), complete, computed)


def as_column(values: Sequence[Any]) -> NDArray[Any]:
    """Return values of one path as an array: of numbers, else of texts (lists and mappings as JSON)."""
    if isinstance(values, np.ndarray):
        return values
    if all(type(value) in (int, float) for value in values):
        return np.array(values, dtype=None if any(type(value) is int for value in values) else float)
    if all(isinstance(value, bool) for value in values):
        return np.array(values, dtype=bool)
    texts = np.empty(len(values), dtype=object)
    texts[:] = [value if isinstance(value, str) else json.dumps(value) for value in values]
    return texts


class _Array:
    """What is known of one array of the results once all samples have been seen."""

    def __init__(self, path: str, variable: Variable) -> None:
        self.path = path
        self.dims = variable.dims
        self.units = variable.units
        self.attrs = dict(variable.attrs)
        self.kinds: set[str] = set()
        self.shape = variable.data.shape
        self.ragged = False
        # The values of a coordinate that all samples share, as far as each of them reaches.
        self.shared: NDArray[Any] | None = variable.data if _is_coordinate(path, variable) else None

    def see(self, variable: Variable) -> None:
        data = variable.data
        self.kinds.add(data.dtype.kind)
        if data.shape != self.shape:
            self.ragged = True
            self.shape = tuple(max(pair) for pair in zip(self.shape, data.shape, strict=True))
        if self.attrs != variable.attrs:
            self.attrs = {key: value for key, value in self.attrs.items() if variable.attrs.get(key) == value}
        if self.shared is not None:
            self.shared = _common(self.shared, data)

    @property
    def dtype(self) -> np.dtype[Any]:
        if "O" in self.kinds:
            return np.dtype(object)
        return np.dtype(np.complex128 if "c" in self.kinds else np.float64)

    @property
    def blank(self) -> Any:
        """What stands where there is no value."""
        return "" if self.dtype.kind == "O" else complex(np.nan, np.nan) if self.dtype.kind == "c" else np.nan

    @property
    def lengths(self) -> str:
        return f"{self.path}_length"


class _Layout:
    """The arrays of the results of a study, gathered from its outcomes."""

    def __init__(self) -> None:
        self.arrays: dict[tuple[str, tuple[str, ...], bool], _Array] = {}
        self.expectations = 0
        self._paths: set[str] = set()

    def see(self, outcome: Outcome | None) -> None:
        """Take note of what an outcome has."""
        if outcome is None:
            return
        self.expectations = max(self.expectations, len(outcome.expectations))
        for path, variable in outcome.values.items():
            self.array(path, variable).see(variable)

    def array(self, path: str, variable: Variable) -> _Array:
        """Return the array that a value goes to; other axes, or a text for a number, make it another one."""
        kind = (path, variable.dims, variable.data.dtype.kind == "O")
        if kind not in self.arrays:
            name, count = path, 1
            while name in self._paths:
                count += 1
                name = f"{path}_{count}"
            self._paths.add(name)
            self.arrays[kind] = _Array(name, variable)
        return self.arrays[kind]

    def declare(self, result: Result, count: int) -> None:
        """Add all arrays to a result, those with a row for each sample without values."""
        for array in self.arrays.values():
            place, attrs = f"{RESULTS}/{array.path}", dict(array.attrs)
            if array.shared is not None:
                result.add(place, array.shared, array.dims, array.units, **attrs)
                continue
            if len(array.kinds) == 1 and array.kinds <= {"b", "i"}:
                attrs["stored"] = "bool" if "b" in array.kinds else "int64"
            if array.ragged:
                attrs["lengths"] = array.lengths.rpartition("/")[2]
                axis = f"{attrs['lengths']}_axis"
                result.add(
                    f"{RESULTS}/{array.lengths}",
                    hollow((count, len(array.shape)), np.int64),
                    ("sample", axis),
                )
            data = hollow((count, *array.shape), array.dtype)
            result.add(place, data, ("sample", *array.dims), array.units, **attrs)

    @property
    def row_bytes(self) -> int:
        return 1 + sum(16 * int(np.prod(array.shape)) for array in self.arrays.values())


def _blocks(
    heading: Heading, layout: _Layout, rows: Iterable[Outcome | None]
) -> Iterator[tuple[str, int, NDArray[Any]]]:
    """Yield the rows of all arrays, as many at a time as memory shall hold."""
    size = max(1, min(_BLOCK_ROWS, _BLOCK_BYTES // layout.row_bytes))
    waiting: list[Outcome | None] = []
    first = 0
    for outcome in rows:
        waiting.append(outcome)
        if len(waiting) == size:
            yield from _block(heading, layout, waiting, first)
            first, waiting = first + size, []
    if waiting:
        yield from _block(heading, layout, waiting, first)


def _block(
    heading: Heading, layout: _Layout, outcomes: Sequence[Outcome | None], first: int
) -> Iterator[tuple[str, int, NDArray[Any]]]:
    status = ["pending" if one is None else "failed" if one.error else "done" for one in outcomes]
    yield "study/status", first, np.array(status, dtype=object)
    errors = ["" if one is None else one.error for one in outcomes]
    yield "study/error", first, np.array(errors, dtype=object)
    keys = [key.tobytes().hex() for key in heading.keys[first : first + len(outcomes)]]
    yield "study/key", first, np.array(keys, dtype=object)
    yield "study/exit_code", first, np.array([-1 if one is None else one.exit_code for one in outcomes])
    for number in range(layout.expectations):
        met = [one is not None and one.expectations[number : number + 1] == (True,) for one in outcomes]
        yield f"study/expect/{number}", first, np.array(met)
    yield from _values(layout, outcomes, first)


def _values(
    layout: _Layout, outcomes: Sequence[Outcome | None], first: int
) -> Iterator[tuple[str, int, NDArray[Any]]]:
    arrays = [array for array in layout.arrays.values() if array.shared is None]
    data = {
        array.path: np.full((len(outcomes), *array.shape), array.blank, dtype=array.dtype) for array in arrays
    }
    lengths = {
        array.path: np.zeros((len(outcomes), len(array.shape)), dtype=np.int64)
        for array in arrays
        if array.ragged
    }
    for row, outcome in enumerate(outcomes):
        for path, variable in (outcome.values if outcome is not None else {}).items():
            array = layout.array(path, variable)
            if array.path in data:
                data[array.path][(slice(row, row + 1), *map(slice, variable.data.shape))] = variable.data
            if array.path in lengths:
                lengths[array.path][row] = variable.data.shape
    for path, values in data.items():
        yield f"{RESULTS}/{path}", first, values
        if path in lengths:
            yield f"{RESULTS}/{path}_length", first, lengths[path]


def _is_coordinate(path: str, variable: Variable) -> bool:
    return variable.dims == (path.rpartition("/")[2],)


def _common(a: NDArray[Any], b: NDArray[Any]) -> NDArray[Any] | None:
    """Return the longer of two coordinates where it begins like the other; else None."""
    longer, count = (a if len(a) >= len(b) else b), min(len(a), len(b))
    same = a.dtype == b.dtype and np.array_equal(a[:count], b[:count], equal_nan=a.dtype.kind in "fc")
    return longer if same else None


class StudyFile:
    """A study read back: its result, and each row as the outcome it was made from.

    Parameters
    ----------
    result
        Its arrays and attributes.
    """

    def __init__(self, result: Result) -> None:
        self.result = result
        self.status: list[str] = list(result["study/status"].data)
        self.keys: list[str] = list(result["study/key"].data)
        self.numbers: NDArray[np.int64] = result["study/sample"].data
        expectations = [path for path in result if path.startswith("study/expect/")]
        self._met = [result[f"study/expect/{number}"].data for number in range(len(expectations))]
        self._arrays = {path for path in result if path.startswith(f"{RESULTS}/")}
        for path in list(self._arrays):
            lengths = result[path].attrs.get("lengths")
            if lengths is not None:
                self._arrays.discard(f"{path.rpartition('/')[0]}/{lengths}")

    def __len__(self) -> int:
        return len(self.status)

    def columns(self) -> dict[str, NDArray[Any]]:
        """Return what was varied, by path."""
        head = f"{SAMPLES}/"
        return {
            path.removeprefix(head): variable.data
            for path, variable in self.result.items()
            if path.startswith(head)
        }

    def outcome(self, row: int) -> Outcome | None:
        """Return the outcome of a row; None where it is pending."""
        status = self.status[row]
        if status == "pending":
            return None
        if status == "failed":
            code = int(self.result["study/exit_code"].data[row])
            return Outcome(error=str(self.result["study/error"].data[row]), exit_code=code)
        values = {path.removeprefix(f"{RESULTS}/"): self._value(path, row) for path in sorted(self._arrays)}
        return Outcome(values, expectations=tuple(bool(met[row]) for met in self._met))

    def _value(self, path: str, row: int) -> Variable:
        variable = self.result[path]
        if variable.dims[:1] != ("sample",):
            return variable
        attrs = {key: value for key, value in variable.attrs.items() if key not in ("stored", "lengths")}
        data = np.asarray(variable.data[row], dtype=variable.data.dtype)
        if "lengths" in variable.attrs:
            lengths = self.result[f"{path.rpartition('/')[0]}/{variable.attrs['lengths']}"].data[row]
            data = data[tuple(slice(int(length)) for length in lengths)]
        data = data.astype(str(variable.attrs.get("stored", data.dtype)) if data.dtype != object else object)
        return Variable(variable.dims[1:], data, variable.units, attrs)


def read_study(path: str | os.PathLike[str]) -> StudyFile:
    """Read the file of a study, also of one that was interrupted.

    Raises
    ------
    FileError
        When there is no such file, or it holds no study.
    """
    result = read_result(path, partial=True)
    if result.kind != "study" or "study/key" not in result:
        raise FileError(f"{os.fspath(path)} is a result of kind {result.kind}, not of a study")
    return StudyFile(result)
