"""The HDF5 file of a study: sample-first arrays, written block by block, and its lock.

`study/sample` numbers the samples; `study/samples/<path>` are the inputs; `study/results/<path>` the outputs,
NaN (or an empty text) for failed and pending samples; `study/status`, `study/error`, `study/exit_code`,
`study/key` and `study/expect/<n>` are the status of each sample; `study/statistics/<path>` the statistics of
the outputs. Nothing under `study/` depends on a clock, a host or a duration.

Numbers and Booleans are float64, so that missing ones can be NaN; the attribute `stored` is their own type.
Arrays whose length differs between samples are padded; the attribute `lengths` names the array of their
lengths.
"""

from __future__ import annotations

import errno
import os
import socket
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.errors import FileError
from dynid.result import Result, Scalar, Variable
from dynid.scene.outcomes import SampleBlock, is_shared, row_of
from dynid.store import hollow, write_blocks
from dynid.study.analysis.sample_statistics import computed, declare
from dynid.study.analysis.table import RESULTS, SAMPLES, statuses

#: Errors of file systems without locks, such as some network file systems.
_WITHOUT_LOCKS = frozenset({errno.ENOLCK, errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP})
#: Time to wait for a lock whose holder removes its file just then, s.
_LOCK_SECONDS = 0.2
#: Bytes of a lock file that Windows lets no other process read while they are locked; most bytes behind them.
_LOCK_BYTE, _MAX_HOLDER_BYTES = 1, 200


class _StudyArray:
    """Layout of one array of the results, complete when all samples have been added.

    `position` is the row of the first sample that has the array, and its place there.
    """

    def __init__(self, path: str, position: tuple[int, int], variable: Variable) -> None:
        self.path = path
        self.place = position
        self.dims = variable.dims
        self.units = variable.units
        self.attrs = dict(variable.attrs)
        self.kinds: set[str] = set()
        self.shape = variable.data.shape
        self.ragged = False
        # Coordinates may be shared by all samples, whose own may be shorter.
        is_coordinate = variable.dims == (path.rpartition("/")[2],)
        self.shared: NDArray[Any] | None = variable.data if is_coordinate else None

    def add(self, position: tuple[int, int], column: Variable) -> None:
        """Add the values of samples."""
        data, shape = column.data, column.data.shape[1:]
        self.kinds.add(data.dtype.kind)
        if position < self.place:
            self.place, self.units = position, column.units
        if shape != self.shape:
            self.ragged = True
            self.shape = tuple(max(pair) for pair in zip(self.shape, shape, strict=True))
        if self.attrs != column.attrs:
            self.attrs = {key: value for key, value in self.attrs.items() if column.attrs.get(key) == value}
        if self.shared is not None:
            same = data == data[:1]
            if data.dtype.kind in "fc":
                same |= data != data  # NaN
            one_row = is_shared(data) or bool(np.all(same))
            self.shared = _common(self.shared, row_of(column, 0).data) if one_row else None

    @property
    def dtype(self) -> np.dtype[Any]:
        """The type that holds every value and the fill value."""
        if "O" in self.kinds:
            return np.dtype(object)
        return np.dtype(np.complex128 if "c" in self.kinds else np.float64)

    @property
    def blank(self) -> Any:
        """The fill value of missing entries."""
        return "" if self.dtype.kind == "O" else complex(np.nan, np.nan) if self.dtype.kind == "c" else np.nan

    @property
    def lengths(self) -> str:
        """The path of the lengths of padded arrays."""
        return f"{self.path}_length"


class Layout:
    """Layouts of the arrays of the results of a study, from its outcomes in any order."""

    def __init__(self) -> None:
        self._arrays: dict[tuple[str, tuple[str, ...], bool], _StudyArray] = {}
        self.expectations = 0

    def add(self, block: SampleBlock) -> None:
        """Add the arrays of samples."""
        self.expectations = max(self.expectations, block.met.shape[1])
        for number, (path, column) in enumerate(block.values.items()):
            position, kind = (int(block.rows[0]), number), _kind(path, column)
            if kind not in self._arrays:
                self._arrays[kind] = _StudyArray(path, position, row_of(column, 0))
            self._arrays[kind].add(position, column)

    @cached_property
    def arrays(self) -> list[_StudyArray]:
        """All arrays, in the order of the samples, with unique names."""
        names: set[str] = set()
        arrays = sorted(self._arrays.values(), key=lambda array: array.place)
        for array in arrays:
            name, count = array.path, 1
            while name in names:
                count += 1
                name = f"{array.path}_{count}"
            names.add(name)
            array.path = name
        return arrays

    def array(self, path: str, column: Variable) -> _StudyArray:
        """Return the array for values; other axes, or texts instead of numbers, belong to another one."""
        return self._arrays[_kind(path, column)]

    def declare(self, result: Result, count: int) -> None:
        """Add all arrays to a result, those with a row per sample still without values."""
        for array in self.arrays:
            path, attrs = f"{RESULTS}/{array.path}", dict(array.attrs)
            if array.shared is not None:
                result.add(path, array.shared, array.dims, array.units, **attrs)
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
            result.add(path, data, ("sample", *array.dims), array.units, **attrs)

    @property
    def row_bytes(self) -> int:
        """Approximate memory of one sample, bytes."""
        return 1 + sum(16 * int(np.prod(array.shape)) for array in self.arrays)


def _kind(path: str, column: Variable) -> tuple[str, tuple[str, ...], bool]:
    return path, column.dims, column.data.dtype.kind == "O"


def _common(a: NDArray[Any], b: NDArray[Any]) -> NDArray[Any] | None:
    """Return the longer of two coordinates if the other is its beginning; else None."""
    longer, count = (a if len(a) >= len(b) else b), min(len(a), len(b))
    same = a.dtype == b.dtype and np.array_equal(a[:count], b[:count], equal_nan=a.dtype.kind in "fc")
    return longer if same else None


_BLOCK_BYTES = 32 * 2**20
_BLOCK_ROWS = 4096


@dataclass(frozen=True)
class StudyHeading:
    """Content of the file of a study except the outcomes."""

    title: str
    text: str  # YAML text of the study
    base: str  # YAML text of the scene that it varies
    seed: int  # of its sampling
    numbers: NDArray[np.int64]  # of the sample of each row in the plan, from 0
    columns: Mapping[str, NDArray[Any]]  # inputs by path: a number or text for each row
    keys: NDArray[np.uint8]  # rows x bytes
    attrs: Mapping[str, Scalar] = field(default_factory=dict)  # of the group `study`
    folder: str = "."  # to which relative paths in the scene refer


#: Yields the finished samples of rows start … stop - 1, in any order.
Rows = Callable[[int, int], Iterator[SampleBlock]]


def write_study(
    path: str | os.PathLike[str], heading: StudyHeading, outcomes: Rows, complete: bool = True
) -> None:
    """Write the file of a study, completely or not at all; `outcomes` are read twice.

    Raises
    ------
    FileError
        If the file cannot be written. An existing file is kept.
    """
    count, layout = len(heading.numbers), Layout()
    for start in range(0, count, _BLOCK_ROWS):
        for block in outcomes(start, min(start + _BLOCK_ROWS, count)):
            layout.add(block)
    root: dict[str, Scalar] = {"scene": heading.text, "seed": heading.seed, "folder": heading.folder}
    result = Result("study", heading.title, root)
    result.add_axis("study/sample", heading.numbers)
    result.add("study/scene", np.array(heading.base, dtype=object))
    result.annotate("study", **heading.attrs)
    for name, column in heading.columns.items():
        result.add(f"{SAMPLES}/{name}", column, ("sample",))
    for name in ("status", "error", "key"):
        result.add(f"study/{name}", hollow((count,), object), ("sample",))
    result.add("study/exit_code", hollow((count,), np.int64), ("sample",))
    for number in range(layout.expectations):
        result.add(f"study/expect/{number}", hollow((count,), np.bool_), ("sample",))
    layout.declare(result, count)
    declare(result)
    write_blocks(result, path, _blocks(heading, layout, outcomes), complete, computed)


def _blocks(heading: StudyHeading, layout: Layout, outcomes: Rows) -> Iterator[tuple[str, int, NDArray[Any]]]:
    """Yield the rows of all arrays, a limited amount of memory at a time."""
    size = max(1, min(_BLOCK_ROWS, _BLOCK_BYTES // layout.row_bytes))
    for start in range(0, len(heading.numbers), size):
        stop = min(start + size, len(heading.numbers))
        text, digits = heading.keys[start:stop].tobytes().hex(), 2 * heading.keys.shape[1]
        keys = [text[first : first + digits] for first in range(0, len(text), digits)]
        yield "study/key", start, np.array(keys, dtype=object)
        for name, rows in _rows(layout, outcomes(start, stop), start, stop).items():
            yield name, start, rows


def _rows(layout: Layout, blocks: Iterator[SampleBlock], start: int, stop: int) -> dict[str, NDArray[Any]]:
    """Return rows start … stop - 1 of all arrays, from their finished samples."""
    count = stop - start
    codes, errors = np.full(count, -1), np.full(count, "", dtype=object)
    met = np.zeros((layout.expectations, count), dtype=bool)
    arrays = [array for array in layout.arrays if array.shared is None]
    data = {array.path: np.full((count, *array.shape), array.blank, array.dtype) for array in arrays}
    lengths = {array.path: np.zeros((count, len(array.shape)), np.int64) for array in arrays if array.ragged}
    for block in blocks:
        own_rows = block.rows - start
        codes[own_rows] = block.exit_codes if block.errors else 0
        errors[own_rows] = block.errors if block.errors else ""
        met[: block.met.shape[1], own_rows] = block.met.T
        for path, column in block.values.items():
            array = layout.array(path, column)
            if array.path in data:
                within: tuple[Any, ...] = tuple(map(slice, column.data.shape[1:]))
                data[array.path][(own_rows, *within)] = column.data
            if array.path in lengths:
                lengths[array.path][own_rows] = column.data.shape[1:]
    columns = {"study/status": statuses(codes), "study/error": errors, "study/exit_code": codes}
    columns |= {f"study/expect/{number}": column for number, column in enumerate(met)}
    columns |= {f"{RESULTS}/{path}": rows for path, rows in data.items()}
    return columns | {f"{RESULTS}/{path}_length": rows for path, rows in lengths.items()}


@contextmanager
def locked(target: str) -> Iterator[None]:
    """Lock the file of a study by `<file>.lock`, which the system releases when its process ends.

    Raises `FileError` if another process holds the lock (it is named), or the lock cannot be taken.
    """
    from filelock import FileLock, Timeout

    name = f"{target}.lock"
    # A file system without locks is refused: files that merely exist would outlive their process.
    lock = FileLock(name, timeout=_LOCK_SECONDS, fallback_to_soft=False)
    try:
        lock.acquire()
    except Timeout:
        raise FileError(
            f"another study is writing {target}: {_holder(name)}",
            remedy="Wait for it, or write another file with -o.",
            names=[target],
        ) from None
    except (OSError, NotImplementedError) as error:
        reason = getattr(error, "strerror", None) or str(error) or "not supported"
        unsupported = not isinstance(error, OSError) or error.errno in _WITHOUT_LOCKS
        raise FileError(
            f"{name} cannot be locked: {reason}",
            remedy=(
                "This file system has no locks: write the file to a local folder with -o, such as one in "
                f"{tempfile.gettempdir()}, and copy it when the study has ended."
            )
            if unsupported
            else "",
            names=[name],
        ) from error
    try:
        with open(name, "r+b", buffering=0) as file:  # noqa: PTH123
            file.seek(_LOCK_BYTE)
            file.write(f"process {os.getpid()} on {socket.gethostname()}".encode().ljust(_MAX_HOLDER_BYTES))
        yield
    finally:
        # While it is held: the next holder finds it removed. Windows removes no open file.
        with suppress(OSError):
            os.unlink(name)  # noqa: PTH108
        lock.release()


def _holder(name: str) -> str:
    """Return who holds a lock, as written behind the byte that Windows lets no other process read."""
    try:
        with open(name, "rb", buffering=0) as file:  # noqa: PTH123
            file.seek(_LOCK_BYTE)
            return file.read(_MAX_HOLDER_BYTES).decode(errors="replace").strip() or "another process"
    except OSError:
        return "another process"
