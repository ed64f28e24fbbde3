"""The file of a study, read back: each row as the outcome that it was made from."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.errors import FileError
from dynid.result import Result, Variable
from dynid.scene.batch import Outcome
from dynid.store import open_stored
from dynid.study.analysis.table import RESULTS, SAMPLES

_BLOCK_VALUES = 2**21
_BLOCK_ROWS = 4096


@contextmanager
def open_study(path: str | os.PathLike[str]) -> Iterator[StudyFile]:
    """Open the file of a study, also of one that was interrupted; its results stay there until asked for.

    Raises
    ------
    FileError
        When there is no such file, or it holds no study.
    """
    with open_stored(path, partial=True) as result:
        if result.kind != "study" or "study/key" not in result:
            raise FileError(f"{os.fspath(path)} is a result of kind {result.kind}, not of a study")
        yield StudyFile(result)


class StudyFile:
    """A study in an open file.

    Parameters
    ----------
    result
        Its arrays and attributes.
    """

    def __init__(self, result: Result) -> None:
        self.result = result
        self.status: list[str] = result["study/status"].data.tolist()
        self.keys = [bytes.fromhex(key) for key in result["study/key"].data]
        self.numbers: NDArray[np.int64] = result["study/sample"].data
        count = sum(path.startswith("study/expect/") for path in result)
        self._met = [result[f"study/expect/{number}"].data for number in range(count)]
        arrays = [path for path in result if path.startswith(f"{RESULTS}/")]
        lengths = {_lengths_of(path, result[path]) for path in arrays}
        self._arrays = [path for path in arrays if path not in lengths]
        self._shared = {
            path: _loaded(result[path]) for path in self._arrays if result[path].dims[:1] != ("sample",)
        }

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

    def outcomes(self) -> Iterator[Outcome | None]:
        """Yield the outcome of every row, None where it is pending; some rows are in memory at a time."""
        values = sum(int(np.prod(self.result[path].shape[1:])) for path in self._arrays)
        size = max(1, min(_BLOCK_ROWS, _BLOCK_VALUES // max(1, values)))
        for start in range(0, len(self), size):
            yield from self._block(start, min(start + size, len(self)))

    def _block(self, start: int, stop: int) -> Iterator[Outcome | None]:
        rows = {
            path: self.result[path].rows(start, stop) for path in self._arrays if path not in self._shared
        }
        lengths = {path: self._lengths(path, start, stop) for path in rows}
        errors = self.result["study/error"].rows(start, stop)
        codes = self.result["study/exit_code"].rows(start, stop)
        attrs = {path: _own_attrs(self.result[path]) for path in rows}
        for row, status in enumerate(self.status[start:stop]):
            if status != "done":
                failed = Outcome(error=str(errors[row]), exit_code=int(codes[row]))
                yield failed if status == "failed" else None
                continue
            values = {}
            for path in self._arrays:
                name = path.removeprefix(f"{RESULTS}/")
                if path in self._shared:
                    values[name] = self._shared[path]
                    continue
                variable, kept = self.result[path], lengths[path]
                data = np.asarray(rows[path][row], dtype=rows[path].dtype)
                if kept is not None:
                    data = data[tuple(slice(int(length)) for length in kept[row])]
                if "stored" in variable.attrs:
                    data = data.astype(str(variable.attrs["stored"]))
                values[name] = Variable(variable.dims[1:], data, variable.units, attrs[path])
            yield Outcome(values, expectations=tuple(bool(met[start + row]) for met in self._met))

    def _lengths(self, path: str, start: int, stop: int) -> NDArray[np.int64] | None:
        lengths = _lengths_of(path, self.result[path])
        return None if lengths is None else self.result[lengths].rows(start, stop)


def _lengths_of(path: str, variable: Variable) -> str | None:
    """Return the path of the lengths of an array that is padded."""
    name = variable.attrs.get("lengths")
    return None if name is None else f"{path.rpartition('/')[0]}/{name}"


def _own_attrs(variable: Variable) -> dict[str, Any]:
    return {key: value for key, value in variable.attrs.items() if key not in ("stored", "lengths")}


def _loaded(variable: Variable) -> Variable:
    return Variable(variable.dims, variable.data, variable.units, variable.attrs)
