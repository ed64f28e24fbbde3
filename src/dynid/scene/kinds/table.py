"""A table of numbers out of a user's file, and the file as faults name it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import numpy as np

from dynid.errors import FileError
from dynid.scene.kinds.times import printed_resolution, step_disagreement
from dynid.words import did_you_mean

if TYPE_CHECKING:
    from numpy.typing import NDArray

#: Names of a column of times.
TIME = ("time", "t")


@dataclass(frozen=True)
class DataFile:
    """A file and the dotted place in the scene that names it, where faults are reported."""

    path: Path
    place: str

    def refuse(
        self,
        problem: str,
        remedy: str = "",
        *,
        line: int | None = None,
        key: str = "path",
        colon: bool = False,
    ) -> NoReturn:
        """Raise the fault of this file, at a line of it and at a key of the scene."""
        where = f"{self.path}:{line}:" if line is not None else f"{self.path}{':' * colon}"
        names = [f"{self.place}.{key}"] if self.place else []
        raise FileError(f"{where} {problem}", remedy=remedy, names=names)


@dataclass(frozen=True)
class Layout:
    """Where in a file the table is: see `dynid.scene.schema.common.TablePlace`."""

    variable: str | None = None
    row: int | None = None
    time: str | int | None = None
    first: int | None = None

    def only(self, file: DataFile, *keys: str) -> None:
        """Refuse what a file of this format has not, but these keys."""
        for key in ("variable", "row", "time"):
            if key not in keys and getattr(self, key) is not None:
                file.refuse(f"takes no '{key}'", "It tells parts of other formats apart.", key=key)


@dataclass(frozen=True)
class Table:
    """Rows of numbers, the names of their columns (none: no header), and their times where they have any.

    `timed` is the column of the times, from 0; absent: it is known by its name.
    """

    file: DataFile
    names: list[str]
    values: NDArray[np.float64]
    lines: list[int] | None = None
    times: NDArray[np.float64] | None = None
    resolution: NDArray[np.float64] | None = None
    timed: int | None = None

    @property
    def data(self) -> list[int]:
        """The columns that are not the time, from 0."""
        timed = time_column(self.names) if self.timed is None else self.timed
        return [k for k in range(self.values.shape[1]) if k != timed]

    def timed_by(self, column: str | int) -> Table:
        """Return the table with a column of times, as many digits as these have."""
        found = self.find(column, "time")
        times = self.values[:, found]
        return replace(
            self, times=times, resolution=printed_resolution(f"{t:.12g}" for t in times), timed=found
        )

    def since(self, first: int) -> Table:
        """Return the table from a row on, counted from 1."""
        if first > len(self.values):
            self.file.refuse(f"has {len(self.values)} rows; none is number {first}", key="first")
        cut = slice(first - 1, None)
        return replace(
            self,
            values=self.values[cut],
            lines=None if self.lines is None else self.lines[cut],
            times=None if self.times is None else self.times[cut],
            resolution=None if self.resolution is None else self.resolution[cut],
        )

    def refuse_row(self, row: int, problem: str, remedy: str = "") -> NoReturn:
        """Raise a fault of one row."""
        if self.lines is None:
            self.file.refuse(f"row {row + 1}: {problem}", remedy, colon=True)
        self.file.refuse(problem, remedy, line=self.lines[row])

    def find(self, name: str | int, key: str) -> int:
        """Return the place of a column that is named, or numbered from 1."""
        count = self.values.shape[1]
        if isinstance(name, int):
            if not 1 <= name <= count:
                columns = f"{count} columns" if count != 1 else "one column"
                self.file.refuse(f"has {columns}, no column {name}", key=key)
            return name - 1
        if self.names.count(name) > 1:
            self.file.refuse(f"has {self.names.count(name)} columns '{name}'", "Give its number.", key=key)
        if name not in self.names:
            hint = did_you_mean(name, self.names)
            known = (
                "" if hint else f"; it has {', '.join(self.names)}" if self.names else "; it has no header"
            )
            self.file.refuse(f"has no column '{name}'{hint or known}", key=key)
        return self.names.index(name)

    def checked(self, columns: Iterable[int], step: float | None) -> NDArray[np.float64]:
        """Return columns without infinite values, at the step that they are taken to have."""
        chosen = self.values[:, list(columns)]
        infinite = np.argwhere(np.isinf(chosen))
        if len(infinite):
            self.refuse_row(int(infinite[0, 0]), "the value is infinite", "Leave a saturated sample empty.")
        if self.times is not None and self.resolution is not None and step is not None:
            if np.isinf(self.times).any():
                self.refuse_row(int(np.argmax(np.isinf(self.times))), "the time is infinite")
            wrong = step_disagreement(self.times, step, self.resolution)
            if wrong is not None:
                remedy = "The rows of a record lie one 'step' apart; a missing sample keeps its row."
                if wrong.row is not None:
                    self.refuse_row(wrong.row, wrong.problem, remedy)
                self.file.refuse(wrong.problem, "Correct the step, or the file.", colon=True)
        return chosen


def time_column(names: Sequence[str]) -> int | None:
    """Return the column of the time, by its name; a unit may stand behind it in brackets.

    Beside `t`, `T` is another quantity.
    """
    bare = [re.sub(r"[\[(].*", "", name).strip() for name in names]
    spelt = [k for k, name in enumerate(bare) if name in TIME]
    return next(iter([*spelt, *(k for k, name in enumerate(bare) if name.lower() in TIME)]), None)


def are_numbers(columns: Sequence[str | int]) -> bool:
    """Tell whether columns are named by their numbers."""
    return all(isinstance(name, int) for name in columns)
