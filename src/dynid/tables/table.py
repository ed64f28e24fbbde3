"""A table of numbers in a user's file, its faults, and the agreement of its times with a sampling step."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, NoReturn

import numpy as np

from dynid.errors import FileError
from dynid.suggestions import did_you_mean
from dynid.units import si_factor, split_heading, unit_fits

if TYPE_CHECKING:
    from numpy.typing import NDArray


#: Names of a dataset of times.
TIME = ("time", "t")
#: Names of a column of times, as instruments and languages have them; a unit may follow in many ways.
_TIMES = (
    r"(t|times?|time ?stamps?|(elapsed|relative|rel\.?|sample|record) time|zeit|messzeit|temps|tiempo|tempo"
    r"|seconds|secs?|x_value)([ _/.]*(s|sec|seconds|ms|msec|us|usec|µs))?"
)


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
class TableLayout:
    """Place of a table in a file: variable, row of a cell array, column of the times, first row."""

    variable: str | None = None
    row: int | None = None
    time: str | int | None = None
    first: int | None = None

    def only(self, file: DataFile, *keys: str) -> None:
        """Refuse the keys of other formats, all but the given ones."""
        for key in ("variable", "row", "time"):
            if key not in keys and getattr(self, key) is not None:
                file.refuse(f"takes no '{key}'", "It belongs to files of other formats.", key=key)


class Heading(NamedTuple):
    """Name of a column, and its unit; empty where the file has none."""

    name: str
    unit: str


@dataclass(frozen=True)
class DataTable:
    """Rows of numbers, the names of their columns (none: no header), and their times where they have any.

    `timed` is the column of the times, from 0; absent: it is found by its name. `units` are those of the
    columns in a row of their own; empty: they stand in the names, if anywhere.
    """

    file: DataFile
    names: list[str]
    values: NDArray[np.float64]
    lines: list[int] | None = None
    times: NDArray[np.float64] | None = None
    resolution: NDArray[np.float64] | None = None
    timed: int | None = None
    units: Sequence[str] = ()

    def heading(self, column: int) -> Heading:
        """Return name and unit of a column, empty where the file has none."""
        name, unit = split_heading(self.names[column]) if self.names else ("", "")
        return Heading(name, self.units[column] or unit if self.units else unit)

    @property
    def data(self) -> list[int]:
        """The columns that are not the time, from 0."""
        timed = time_column(self.names) if self.timed is None else self.timed
        return [k for k in range(self.values.shape[1]) if k != timed]

    def timed_by(self, column: int, resolution: NDArray[np.float64] | None = None) -> DataTable:
        """Return the table with a column of times, in s or in the unit that its heading has.

        `resolution` is the last place of each time as written; absent: they have twelve digits.
        """
        times = self.values[:, column]
        if resolution is None:
            resolution = printed_resolution(f"{t:.12g}" for t in times)
        name, unit = self.heading(column)
        if unit and not unit_fits(unit, ["s"]):
            self.file.refuse(f"has '{name}' in {unit}, which is no time", key="time")
        factor = si_factor(unit, ["s"]) if unit else 1.0
        return replace(self, times=factor * times, resolution=factor * resolution, timed=column)

    def since(self, first: int) -> DataTable:
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
        """Return the index of a column by its name, with or without its unit, or by its number from 1."""
        count = self.values.shape[1]
        if isinstance(name, int):
            if not 1 <= name <= count:
                columns = f"{count} columns" if count != 1 else "one column"
                self.file.refuse(f"has {columns}, no column {name}", key=key)
            return name - 1
        bare = [split_heading(own)[0] for own in self.names]
        listings = ((self.names, name), (bare, name), (bare, split_heading(name)[0]))
        found = next((own for own, sought in listings if sought in own), None)
        if found is None:
            hint = did_you_mean(name, self.names)
            known = (
                "" if hint else f"; it has {', '.join(self.names)}" if self.names else "; it has no header"
            )
            self.file.refuse(f"has no column '{name}'{hint or known}", key=key)
        sought = name if name in found else split_heading(name)[0]
        if found.count(sought) > 1:
            self.file.refuse(f"has {found.count(sought)} columns '{sought}'", "Give its number.", key=key)
        return found.index(sought)

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
    """Return the column of the time, found by its name; a unit may follow the name.

    Beside `t`, `T` is another quantity; so is what has a unit that is none of time.
    """
    bare = [re.sub(r"[\[(].*", "", split_heading(name)[0]).strip() for name in names]
    known = [
        k
        for k, name in enumerate(names)
        if re.fullmatch(_TIMES, bare[k], re.IGNORECASE)
        and not ((unit := split_heading(name)[1]) and not unit_fits(unit, ["s"]))
    ]
    return min(known, key=lambda k: (not bare[k].islower(), bare[k] == "T"), default=None)


def are_numbers(columns: Sequence[str | int]) -> bool:
    """Return True if columns are given by their numbers."""
    return all(isinstance(name, int) for name in columns)


_MEAN = 1e-6
"""Largest relative difference of the mean step of a record from that of the scene."""

_EVEN = 1e-3
"""Largest distance of a sample from its place, in steps."""


class StepDisagreement(NamedTuple):
    """Disagreement of times with a step, and its row (from 0) if it is at one."""

    problem: str
    row: int | None = None


def printed_resolution(fields: Iterable[str]) -> NDArray[np.float64]:
    """Return the last place of each printed number, as the most precise of them are printed.

    Numbers are printed with a number of decimals or of digits, and zeros at the end may be left out; the
    most decimals and the most digits that occur are taken for the format's.
    """
    numbers = [Decimal(field) for field in fields]
    finite = [number.as_tuple() for number in numbers if number.is_finite()]
    decimals = max((-int(parts.exponent) for parts in finite), default=0)
    digits = max((len(parts.digits) for parts in finite), default=1)
    places = [number.adjusted() + 1 - digits if number.is_finite() and number else -999 for number in numbers]
    resolution: NDArray[np.float64] = 10.0 ** np.maximum(np.array(places, dtype=float), -decimals)
    return resolution


def step_disagreement(
    times: NDArray[np.float64], step: float, resolution: NDArray[np.float64]
) -> StepDisagreement | None:
    """Return the disagreement of the times of a record with its step.

    Parameters
    ----------
    times
        One time a row, s; NaN where it is missing.
    step
        The step that the rows are taken to have, s.
    resolution
        The last place of each time: they are rounded to it.

    Returns
    -------
    StepDisagreement or None
        None where the times agree: evenly spaced to a thousandth of a step, their mean step right to a
        millionth, each beside what the times are rounded by.
    """
    rows = np.flatnonzero(~np.isnan(times))
    if len(rows) < 2:
        return None
    given, counts = times[rows], np.diff(rows)
    rounding = resolution[rows] + 4 * np.spacing(np.abs(given).max())
    steps = np.diff(given) / counts
    usual = float(np.median(steps))
    jump = np.abs(steps - usual) * counts - _EVEN * step - np.maximum(rounding[1:], rounding[:-1])
    if np.any(jump > 0):
        row = int(np.argmax(jump > 0))
        return StepDisagreement(
            f"the time goes on by {steps[row] * counts[row]:.9g} s here, {usual:.9g} s a row elsewhere; "
            f"'step' is {step:.9g} s",
            int(rows[row + 1]),
        )
    return _drift(given, rows, step, rounding)


def _drift(
    given: NDArray[np.float64], rows: NDArray[np.intp], step: float, rounding: NDArray[np.float64]
) -> StepDisagreement | None:
    """Compare times, at their rows and rounded by so much, with those that lie step after step."""
    span = int(rows[-1] - rows[0])
    mean = float(given[-1] - given[0]) / span
    away = np.abs(given - given[0] - mean * (rows - rows[0]))
    # Times that are even as printed are not rounded, unless they are too few to show it.
    rounded = float(rounding.max()) if len(rows) < 4 else min(2 * float(away.max()), float(rounding.max()))
    if abs(mean - step) > _MEAN * step + rounded / span:
        return StepDisagreement(f"the times are {mean:.9g} s apart, but 'step' is {step:.9g} s")
    late = away - _EVEN * step - rounding
    if np.any(late > 0):
        row = int(np.argmax(late))
        return StepDisagreement(
            f"the times are uneven: this one lies {away[row]:.3g} s off its place; 'step' is {step:.9g} s",
            int(rows[row]),
        )
    return None
