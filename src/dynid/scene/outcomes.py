"""Outcomes of samples of one scene, one by one and side by side; the arrays that `collect` names."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from functools import cached_property
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from dynid.errors import UsageError
from dynid.result import GATHERED_ANYWAY, NUMBERS, Result, Variable, coordinate_path
from dynid.suggestions import did_you_mean_path

Indices = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class SampleOutcome:
    """Outcome of one sample."""

    #: The collected arrays by path, with the coordinates of their axes; empty where the sample failed.
    values: Mapping[str, Variable] = field(default_factory=dict)
    error: str = ""  #: Why it failed; empty where it did not.
    exit_code: int = 0  #: The exit code of `dynid run`: 0, 2 (the scene), 3 (numerics) or 4 (a file).
    expectations: tuple[bool, ...] = ()  #: True for each `expect` of the scene that is met.


@dataclass(frozen=True, eq=False)
class SampleBlock:
    """Samples with the same arrays, of the same shapes; or failed ones."""

    rows: Indices  #: Their rows among all samples, ascending.
    values: Mapping[str, Variable]  #: Their arrays by path, with the samples along the first axis.
    met: NDArray[np.bool_]  #: True where a sample meets an expectation (sample x expectation).
    #: Message and exit code of each failed sample; empty where none failed.
    errors: tuple[str, ...] = ()
    exit_codes: tuple[int, ...] = ()

    def __len__(self) -> int:
        return len(self.rows)

    def result(self, index: int, kind: str = "", title: str = "") -> Result:
        """Return the arrays of one of these samples."""
        result = Result(kind, title)
        for path, variable in self.values.items():
            result.put(path, row_of(variable, index))
        return result

    def taken(self, places: Indices, rows: Indices) -> SampleBlock:
        """Return some of these samples, under other row numbers."""
        is_complete = len(places) == len(self.rows) and bool(np.all(places == np.arange(len(places))))
        if is_complete:
            return replace(self, rows=rows)
        values = {}
        for path, variable in self.values.items():
            data = variable.data
            if is_shared(data):  # a row that all samples share stays one row in memory
                some = np.broadcast_to(data[:1], (len(places), *data.shape[1:]))
            else:
                some = data[places]
            values[path] = Variable(variable.dims, some, variable.units, variable.attrs)
        return SampleBlock(
            rows,
            values,
            self.met[places],
            tuple(self.errors[index] for index in places) if self.errors else (),
            tuple(self.exit_codes[index] for index in places) if self.errors else (),
        )

    def outcome(self, index: int) -> SampleOutcome:
        """Return the outcome of one of these samples."""
        met = tuple(self.met[index].tolist())
        if self.errors:
            return SampleOutcome(error=self.errors[index], exit_code=self.exit_codes[index], expectations=met)
        return SampleOutcome(dict(self.result(index)), expectations=met)


def row_of(variable: Variable, index: int) -> Variable:
    """Return the part of one sample of an array with the samples along its first axis."""
    data = np.array(variable.data[index], dtype=variable.data.dtype)
    return Variable(variable.dims[1:], data, variable.units, variable.attrs)


def is_shared(data: NDArray[Any]) -> bool:
    """Return True if all rows of an array share one row in memory."""
    return data.strides[0] == 0 and len(data) > 0


class SampleOutcomes(Sequence[SampleOutcome]):
    """The outcomes of samples, in order; in memory they are arrays. One that is in no block is pending."""

    def __init__(self, blocks: Sequence[SampleBlock], count: int) -> None:
        self.blocks, self._count = blocks, count

    @classmethod
    def of(cls, outcomes: Iterable[SampleOutcome | None]) -> SampleOutcomes:
        """Return outcomes side by side; None is a pending one."""
        groups: dict[Any, list[tuple[int, SampleOutcome]]] = {}  # by their shapes; failed ones together
        count = 0
        for outcome in outcomes:
            if outcome is not None:
                form: list[Any] = [bool(outcome.error), len(outcome.expectations)]
                for path, variable in () if outcome.error else outcome.values.items():
                    # true, 1 and 1.0 are equal, and not the same.
                    attrs = tuple((name, type(value), value) for name, value in variable.attrs.items())
                    data = variable.data
                    form.append((path, variable.dims, data.dtype, data.shape, variable.units, attrs))
                groups.setdefault(tuple(form), []).append((count, outcome))
            count += 1
        return cls([_block(group) for group in groups.values()], count)

    def __len__(self) -> int:
        return self._count

    @overload
    def __getitem__(self, index: int) -> SampleOutcome: ...
    @overload
    def __getitem__(self, index: slice) -> list[SampleOutcome]: ...
    def __getitem__(self, index: int | slice) -> SampleOutcome | list[SampleOutcome]:
        if isinstance(index, slice):
            return [self[position] for position in range(*index.indices(self._count))]
        holders, places = self._index
        holder = holders[index]
        if holder < 0:
            raise LookupError(f"sample {index} is pending")
        outcome: SampleOutcome = self.blocks[holder].outcome(int(places[index]))
        return outcome

    @property
    def exit_codes(self) -> NDArray[np.int8]:
        """The exit code of every sample; -1 where it is pending."""
        codes = np.full(self._count, -1, dtype=np.int8)
        for block in self.blocks:
            codes[block.rows] = block.exit_codes if block.errors else 0
        return codes

    @property
    def pending(self) -> list[int]:
        """The samples that are in no block."""
        rows: list[int] = np.flatnonzero(self.exit_codes < 0).tolist()
        return rows

    def completed(self, outcomes: Sequence[SampleOutcome]) -> SampleOutcomes:
        """Return the same with the outcomes of its pending samples, in order."""
        if not outcomes:
            return self
        rows, rest = np.array(self.pending, dtype=np.intp), SampleOutcomes.of(outcomes)
        return SampleOutcomes([*self.blocks, *rest.picked(np.arange(len(rows)), rows)], self._count)

    def picked(self, places: Indices, rows: Indices) -> Iterator[SampleBlock]:
        """Yield some of the samples, each under its given row."""
        holders, within = self._index
        holders, within = holders[places], within[places]
        for holder in np.unique(holders[holders >= 0]):
            members = np.flatnonzero(holders == holder)
            yield self.blocks[holder].taken(within[members], rows[members])

    def between(self, start: int, stop: int) -> Iterator[SampleBlock]:
        """Yield the samples start … stop - 1."""
        places = np.arange(start, min(stop, self._count))
        return self.picked(places, places)

    def mapped(self, change: Callable[[SampleBlock], SampleBlock]) -> SampleOutcomes:
        """Return the same with changed blocks of samples that did not fail."""
        blocks = [block if block.errors else change(block) for block in self.blocks]
        return SampleOutcomes(blocks, self._count)

    @cached_property
    def _index(self) -> tuple[Indices, Indices]:
        holders, places = np.full(self._count, -1, dtype=np.intp), np.zeros(self._count, dtype=np.intp)
        for number, block in enumerate(self.blocks):
            holders[block.rows], places[block.rows] = number, np.arange(len(block))
        return holders, places


def _block(group: Sequence[tuple[int, SampleOutcome]]) -> SampleBlock:
    rows, outcomes = (list(column) for column in zip(*group, strict=True))
    first: SampleOutcome = outcomes[0]
    failed = bool(first.error)
    values = {}
    for path, variable in () if failed else first.values.items():
        parts = [outcome.values[path].data for outcome in outcomes]
        data: NDArray[Any]
        if all(column is variable.data for column in parts):
            data = np.broadcast_to(variable.data, (len(parts), *variable.data.shape))
        else:
            data = np.stack(parts)
        values[path] = Variable(("sample", *variable.dims), data, variable.units, variable.attrs)
    met = np.array([outcome.expectations for outcome in outcomes], dtype=bool)
    return SampleBlock(
        np.array(rows, dtype=np.intp),
        values,
        met.reshape(len(rows), len(first.expectations)),
        tuple(outcome.error for outcome in outcomes) if failed else (),
        tuple(outcome.exit_code for outcome in outcomes) if failed else (),
    )


def gather(result: Mapping[str, Variable], collect: tuple[str, ...]) -> dict[str, Variable]:
    """Return the arrays that `collect` names in a result, with the coordinates of their axes.

    With a characteristic that may be undefined, such as a settling time, comes the status that says why.

    Parameters
    ----------
    result
        Arrays by path.
    collect
        Paths, groups, or patterns with `*`; empty: every number under `properties` and `parameters`.

    Raises
    ------
    UsageError
        Where there is nothing at a path, or a table, which has no place in a study.
    """
    chosen = dict.fromkeys(_selected_paths(result, collect))
    for path in list(chosen):
        coordinates = (coordinate_path(result, path, dim) for dim in result[path].dims)
        chosen |= {coordinate: None for coordinate in coordinates if coordinate is not None}
    return {path: result[path] for path in chosen}


def _selected_paths(result: Mapping[str, Variable], collect: tuple[str, ...]) -> Iterator[str]:
    """Yield the paths of a result that `collect` names, and the status of what may be undefined."""
    for path_or_pattern in (path.strip("/") for path in collect or (NUMBERS,)):
        if path_or_pattern == NUMBERS:
            paths = [
                path
                for path, variable in result.items()
                if not GATHERED_ANYWAY.isdisjoint(path.split("/"))
                and (variable.data.dtype.kind in "bifc" or path.endswith("_status"))
            ]
        elif path_or_pattern in result:
            if result[path_or_pattern].data.dtype.names:
                raise UsageError(f"{path_or_pattern} is a table, which cannot be collected")
            paths = [path_or_pattern]
        else:
            paths = [
                path
                for path, variable in result.items()
                if (path.startswith(f"{path_or_pattern}/") or fnmatchcase(path, path_or_pattern))
                and not variable.data.dtype.names
            ]
        statuses = {status for path in (path_or_pattern, *paths) if (status := _status_of(path))}
        paths += [path for path in result if any(fnmatchcase(path, status) for status in statuses)]
        if not paths and path_or_pattern != NUMBERS:
            raise UsageError(
                f"there is nothing to collect at '{path_or_pattern}'"
                f"{did_you_mean_path(path_or_pattern, result)}",
                remedy="All paths of a result of the scene: dynid show FILE.h5 --all.",
            )
        yield from paths


def _status_of(path: str) -> str:
    """Return the path of the status that says why a characteristic is undefined; empty for other arrays."""
    group, _, name = path.rpartition("/")
    if "properties" not in group.split("/"):
        return ""
    from dynid.bondgraph.results.characteristics import STATUSES

    return f"{group}/{STATUSES[name]}" if name in STATUSES else ""
