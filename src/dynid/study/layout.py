"""What arrays the results of a study are, from the outcomes of all of its samples."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.result import Result, Variable
from dynid.scene.batch import Outcome
from dynid.store import hollow
from dynid.study.analysis.table import RESULTS


class StudyArray:
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
        """Take note of the value of one sample."""
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
    """The arrays of the results of a study, gathered from its outcomes."""

    def __init__(self) -> None:
        self.arrays: dict[tuple[str, tuple[str, ...], bool], StudyArray] = {}
        self.expectations = 0
        self._paths: set[str] = set()

    def see(self, outcome: Outcome | None) -> None:
        """Take note of what an outcome has."""
        if outcome is None:
            return
        self.expectations = max(self.expectations, len(outcome.expectations))
        for path, variable in outcome.values.items():
            self.array(path, variable).see(variable)

    def array(self, path: str, variable: Variable) -> StudyArray:
        """Return the array that a value goes to; other axes, or a text for a number, make it another one."""
        kind = (path, variable.dims, variable.data.dtype.kind == "O")
        if kind not in self.arrays:
            name, count = path, 1
            while name in self._paths:
                count += 1
                name = f"{path}_{count}"
            self._paths.add(name)
            self.arrays[kind] = StudyArray(name, variable)
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
        """How much memory one sample takes, about."""
        return 1 + sum(16 * int(np.prod(array.shape)) for array in self.arrays.values())


def _is_coordinate(path: str, variable: Variable) -> bool:
    return variable.dims == (path.rpartition("/")[2],)


def _common(a: NDArray[Any], b: NDArray[Any]) -> NDArray[Any] | None:
    """Return the longer of two coordinates where it begins like the other; else None."""
    longer, count = (a if len(a) >= len(b) else b), min(len(a), len(b))
    same = a.dtype == b.dtype and np.array_equal(a[:count], b[:count], equal_nan=a.dtype.kind in "fc")
    return longer if same else None
