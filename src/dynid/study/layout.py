"""What arrays the results of a study are, from the outcomes of all of its samples."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.result import Result, Variable
from dynid.scene.outcomes import Block, is_shared, row_of
from dynid.store import hollow
from dynid.study.analysis.table import RESULTS


class StudyArray:
    """What is known of one array of the results once all samples have been seen.

    Parameters
    ----------
    place
        The row of the first sample that has it, and its place there.
    variable
        What that has (without samples as an axis).
    """

    def __init__(self, path: str, place: tuple[int, int], variable: Variable) -> None:
        self.path = path
        self.place = place
        self.dims = variable.dims
        self.units = variable.units
        self.attrs = dict(variable.attrs)
        self.kinds: set[str] = set()
        self.shape = variable.data.shape
        self.ragged = False
        # The values of a coordinate that all samples share, as far as each of them reaches.
        self.shared: NDArray[Any] | None = variable.data if _is_coordinate(path, variable) else None

    def see(self, place: tuple[int, int], column: Variable) -> None:
        """Take note of the values of samples."""
        data, shape = column.data, column.data.shape[1:]
        self.kinds.add(data.dtype.kind)
        if place < self.place:
            self.place, self.units = place, column.units
        if shape != self.shape:
            self.ragged = True
            self.shape = tuple(max(pair) for pair in zip(self.shape, shape, strict=True))
        if self.attrs != column.attrs:
            self.attrs = {key: value for key, value in self.attrs.items() if column.attrs.get(key) == value}
        if self.shared is not None:
            self.shared = _common(self.shared, row_of(column, 0).data) if _is_one_row(data) else None

    @property
    def dtype(self) -> np.dtype[Any]:
        """The type that holds every value, and what stands for none."""
        if "O" in self.kinds:
            return np.dtype(object)
        return np.dtype(np.complex128 if "c" in self.kinds else np.float64)

    @property
    def blank(self) -> Any:
        """What stands where there is no value."""
        return "" if self.dtype.kind == "O" else complex(np.nan, np.nan) if self.dtype.kind == "c" else np.nan

    @property
    def lengths(self) -> str:
        """The path of the lengths, where samples differ in length."""
        return f"{self.path}_length"


class Layout:
    """The arrays of the results of a study, gathered from its outcomes in whatever order they come."""

    def __init__(self) -> None:
        self._arrays: dict[tuple[str, tuple[str, ...], bool], StudyArray] = {}
        self.expectations = 0

    def see(self, block: Block) -> None:
        """Take note of what samples have."""
        self.expectations = max(self.expectations, block.met.shape[1])
        for number, (path, column) in enumerate(block.values.items()):
            place, kind = (int(block.rows[0]), number), _kind(path, column)
            if kind not in self._arrays:
                self._arrays[kind] = StudyArray(path, place, row_of(column, 0))
            self._arrays[kind].see(place, column)

    @cached_property
    def arrays(self) -> list[StudyArray]:
        """All arrays, in the order of the samples, each under a name of its own."""
        taken: set[str] = set()
        found = sorted(self._arrays.values(), key=lambda array: array.place)
        for array in found:
            name, count = array.path, 1
            while name in taken:
                count += 1
                name = f"{array.path}_{count}"
            taken.add(name)
            array.path = name
        return found

    def array(self, path: str, column: Variable) -> StudyArray:
        """Return the array that values go to; other axes, or texts for numbers, make it another one."""
        return self._arrays[_kind(path, column)]

    def declare(self, result: Result, count: int) -> None:
        """Add all arrays to a result, those with a row for each sample without values."""
        for array in self.arrays:
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
        """How much memory one sample takes, about."""
        return 1 + sum(16 * int(np.prod(array.shape)) for array in self.arrays)


def _kind(path: str, column: Variable) -> tuple[str, tuple[str, ...], bool]:
    return path, column.dims, column.data.dtype.kind == "O"


def _is_one_row(data: NDArray[Any]) -> bool:
    same: Any = data == data[:1] if data.dtype.kind not in "fc" else (data == data[:1]) | (data != data)
    return is_shared(data) or bool(np.all(same))


def _is_coordinate(path: str, variable: Variable) -> bool:
    return variable.dims == (path.rpartition("/")[2],)


def _common(a: NDArray[Any], b: NDArray[Any]) -> NDArray[Any] | None:
    """Return the longer of two coordinates where it begins like the other; else None."""
    longer, count = (a if len(a) >= len(b) else b), min(len(a), len(b))
    same = a.dtype == b.dtype and np.array_equal(a[:count], b[:count], equal_nan=a.dtype.kind in "fc")
    return longer if same else None
