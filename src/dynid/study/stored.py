"""Reader of the file of a study, with outcomes equal to those that were written."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.errors import FileError
from dynid.result import Result, Variable
from dynid.scene.outcomes import SampleBlock
from dynid.store import open_stored
from dynid.study.analysis.table import RESULTS, SAMPLES, lengths_of
from dynid.study.keys import Keys

_BLOCK_VALUES = 2**21
_BLOCK_ROWS = 4096


@contextmanager
def open_study(path: str | os.PathLike[str]) -> Iterator[StudyFile]:
    """Open the file of a study, which may be interrupted; its results are read on access.

    Raises `FileError` if there is no such file, or it holds no study.
    """
    with open_stored(path, partial=True) as result:
        if result.kind != "study" or "study/key" not in result:
            raise FileError(f"{os.fspath(path)} is a result of kind {result.kind}, not of a study")
        try:
            yield StudyFile(result)
        except (LookupError, ValueError, TypeError, AttributeError) as error:
            problem = f"{os.fspath(path)} does not hold what the file of a study holds"
            remedy = "Write another file with -o, and run the study again."
            raise FileError(problem, remedy=remedy, names=[os.fspath(path)]) from error


class StudyFile:
    """Study in an open file."""

    def __init__(self, result: Result) -> None:
        self.result = result
        self.exit_codes: NDArray[np.int64] = result["study/exit_code"].data
        self.numbers: NDArray[np.int64] = result["study/sample"].data
        self._expectations = sum(path.startswith("study/expect/") for path in result)
        arrays = [path for path in result if path.startswith(f"{RESULTS}/")]
        lengths = {lengths_of(path, result[path]) for path in arrays}
        self._arrays = [path for path in arrays if path not in lengths]
        self._shared: dict[str, Variable] = {}
        for path in self._arrays:
            variable = result[path]
            if variable.dims[:1] != ("sample",):
                self._shared[path] = Variable(variable.dims, variable.data, variable.units, variable.attrs)

    def __len__(self) -> int:
        return len(self.numbers)

    @cached_property
    def keys(self) -> Keys:
        """The key of every row (rows x bytes)."""
        stored = self.result["study/key"]
        parts = [bytes.fromhex("".join(keys)) for _, keys in stored.blocks()]
        return np.frombuffer(b"".join(parts), np.uint8).reshape(len(self), -1)

    def columns(self) -> dict[str, NDArray[Any]]:
        """Return the inputs, by path."""
        head = f"{SAMPLES}/"
        return {
            path.removeprefix(head): variable.data
            for path, variable in self.result.items()
            if path.startswith(head)
        }

    @property
    def rows_at_a_time(self) -> int:
        """Number of rows to hold in memory at a time."""
        values = sum(int(np.prod(self.result[path].shape[1:])) for path in self._arrays)
        return max(1, min(_BLOCK_ROWS, _BLOCK_VALUES // max(1, values)))

    def between(self, start: int, stop: int) -> Iterator[SampleBlock]:
        """Yield the finished samples of rows start … stop - 1, some at a time."""
        stop = min(stop, len(self))
        for begin in range(start, stop, self.rows_at_a_time):
            end = min(begin + self.rows_at_a_time, stop)
            codes = self.exit_codes[begin:end]
            if len(failed := np.flatnonzero(codes > 0)):
                errors = self.result["study/error"].rows(begin, end)[failed]
                nothing = np.empty((len(failed), 0), dtype=bool)
                yield SampleBlock(
                    failed + begin, {}, nothing, tuple(errors.tolist()), tuple(codes[failed].tolist())
                )
            if not len(done := np.flatnonzero(codes == 0)):
                continue
            met = [self.result[f"study/expect/{n}"].rows(begin, end) for n in range(self._expectations)]
            judged = np.array(met, dtype=bool).reshape(self._expectations, end - begin).T
            rows = {
                path: self.result[path].rows(begin, end) for path in self._arrays if path not in self._shared
            }
            lengths = {
                path: self.result[name].rows(begin, end)
                for path in rows
                if (name := lengths_of(path, self.result[path])) is not None
            }
            groups = np.zeros(len(done), dtype=np.intp)  # of samples whose arrays have equal lengths
            if lengths:
                table = np.concatenate([kept[done] for kept in lengths.values()], axis=1)
                groups = np.unique(table, axis=0, return_inverse=True)[1].reshape(-1)  # a column in NumPy 2.0
            for group in range(int(groups.max()) + 1):
                members = done[groups == group]
                yield SampleBlock(members + begin, self._values(members, rows, lengths), judged[members])

    def picked(self, rows: NDArray[np.intp], targets: NDArray[np.intp]) -> Iterator[SampleBlock]:
        """Yield the finished samples among ascending rows, with other numbers of rows."""
        for block in self.between(int(rows[0]), int(rows[-1]) + 1):
            _, places, matches = np.intersect1d(block.rows, rows, return_indices=True)
            if len(places):
                yield block.taken(places, targets[matches])

    def _values(
        self,
        samples: NDArray[np.intp],
        rows: Mapping[str, NDArray[Any]],
        lengths: Mapping[str, NDArray[np.int64]],
    ) -> dict[str, Variable]:
        """Return the values of samples whose arrays have equal lengths."""
        values = {}
        for path in self._arrays:
            name, variable = path.removeprefix(f"{RESULTS}/"), self.result[path]
            if path in self._shared:
                shared = self._shared[path]
                data = np.broadcast_to(shared.data, (len(samples), *shared.data.shape))
                values[name] = Variable(("sample", *shared.dims), data, shared.units, shared.attrs)
                continue
            data = rows[path][samples]
            if path in lengths:
                data = data[(slice(None), *(slice(int(length)) for length in lengths[path][samples[0]]))]
            if "stored" in variable.attrs:
                data = data.astype(str(variable.attrs["stored"]))
            attrs = {key: value for key, value in variable.attrs.items() if key not in ("stored", "lengths")}
            values[name] = Variable(variable.dims, data, variable.units, attrs)
        return values
