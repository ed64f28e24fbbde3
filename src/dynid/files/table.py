"""A table of numbers in a user's file, its columns by name, its times, and its faults."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, NoReturn

import numpy as np

from dynid.errors import FileError
from dynid.file_access import check_readable
from dynid.files.stamps import Clock, StepDisagreement, clock_of, printed_resolution
from dynid.suggestions import did_you_mean, shortened
from dynid.units import UnknownUnitError, readings, si_factor, split_heading, unit_fits

if TYPE_CHECKING:
    from numpy.typing import NDArray


#: Names of a dataset of times.
TIME = ("time", "t")
#: Names of a column of times, as instruments and languages have them; a unit may follow in many ways.
_TIMES = (
    r"(t|times?|time ?stamps?|(elapsed|relative|rel\.?|sample|record) time|zeit|messzeit|temps|tiempo|tempo"
    r"|seconds|secs?|x_value)([ _/.]*(s|sec|seconds|ms|msec|us|usec|µs))?"
)


_LONGEST_SYMBOL = 3  # of a unit, whose capitals count: of Volts they do not
# Resampling: the widest gap that is bridged, in steps, and the most that the step may change.
_WIDEST, _RATIO = 4, 1.1


@dataclass(frozen=True)
class DataFile:
    """A file and the dotted place in the scene that names it, where faults are reported."""

    path: Path
    place: str = ""

    def check(self) -> None:
        """Refuse a file that does not exist or cannot be read."""
        check_readable(self.path, self._names("path"))

    def _names(self, key: str) -> list[str]:
        return [f"{self.place}.{key}"] if self.place else []

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
        raise FileError(f"{where} {problem}", remedy=remedy, names=self._names(key))


@dataclass(frozen=True)
class TableLayout:
    """Place of a table in a file: variable, row of a cell array, column of the times, first row.

    `resample`: whether its columns are interpolated at even times. `group` is that of the channels of a
    recorder, `sheet` that of a workbook.
    """

    variable: str | None = None
    row: int | None = None
    time: str | int | None = None
    first: int | None = None
    resample: bool = False
    group: str | None = None
    sheet: str | None = None

    def inside(self, name: str) -> str:
        """Return the name of what stands in the group, if there is one, with the group."""
        return name if self.group is None else f"{self.group}/{name}"

    def only(self, file: DataFile, *keys: str) -> None:
        """Refuse the keys of other formats, all but the given ones."""
        for key in ("variable", "row", "time", "group", "sheet"):
            if key not in keys and getattr(self, key) is not None:
                file.refuse(f"takes no '{key}'", "It belongs to files of other formats.", key=key)


class ColumnRequest(NamedTuple):
    """Columns to be read: names or numbers from 1, or None for all; and where in the file they are.

    Of a `single` column not named there must be only one. A longer dataset of an HDF5 file is read up to a
    number of `rows`.
    """

    columns: Sequence[str | int] | None
    layout: TableLayout
    single: bool = False
    rows: int | None = None


class Heading(NamedTuple):
    """Name of a column, its unit (empty: the file has none), and why this is in doubt, if it is."""

    name: str
    unit: str
    doubt: str = ""


@dataclass(frozen=True)
class DataTable:
    """Rows of numbers, the names of their columns (none: no header), and their times where they have any.

    `timed` is the column of the times, from 0; default: it is found by its name. `units` are those of the
    columns in a row of their own; empty: they stand in the names, if anywhere. `doubts` say for which a
    file contradicts itself; `note` says what was skipped; `stamped` are columns of dates and times of day,
    which hold no data. A table that is `selected`
    has only the columns that were requested by name.
    """

    file: DataFile
    names: list[str]
    values: NDArray[np.float64]
    lines: list[int] | None = None
    times: NDArray[np.float64] | None = None
    resolution: NDArray[np.float64] | None = None
    timed: int | None = None
    units: Sequence[str] = ()
    doubts: Sequence[str] = ()
    note: str = ""
    stamped: tuple[int, ...] = ()
    selected: bool = False

    def heading(self, column: int) -> Heading:
        """Return name and unit of a column, empty where the file has none."""
        name, unit = split_heading(self.names[column]) if self.names else ("", "")
        unit = self.units[column] or unit if self.units else unit
        return Heading(name, unit, self.doubts[column] if self.doubts else "")

    @property
    def data(self) -> list[int]:
        """The columns that are not the time, from 0."""
        timed = time_column(self.names) if self.timed is None else self.timed
        return [k for k in range(self.values.shape[1]) if k != timed and k not in self.stamped]

    def timed_by(self, column: int, resolution: NDArray[np.float64] | None = None) -> DataTable:
        """Return the table with a column of times, in s or in the unit that its heading has.

        `resolution` is the last place of each time as written; default: they have twelve digits.
        """
        times = self.values[:, column]
        if resolution is None:
            resolution = printed_resolution(f"{t:.12g}" for t in times)
        name, unit, _ = self.heading(column)
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
        bare = [split_heading(column)[0] for column in self.names]
        listings = ((self.names, name), (bare, name), (bare, split_heading(name)[0]))
        listing = next((column for column, sought in listings if sought in column), None)
        if listing is None:
            # Names that differ in their numbers alone are those of other sensors.
            short, pattern = split_heading(name)[0], re.sub(r"\d+", "0", split_heading(name)[0])
            others = [
                column
                for column, other in zip(self.names, bare, strict=True)
                if other == short or re.sub(r"\d+", "0", other) != pattern
            ]
            hint = did_you_mean(name, others)
            listed = f"has {shortened(self.names, 20)}" if self.names else "has no header"
            problem = f"has no column '{name}'{hint or f'; it {listed}'}"
            self.file.refuse(problem, f"It {listed}." if hint else "", key=key)
        sought = name if name in listing else split_heading(name)[0]
        if listing.count(sought) > 1:
            self.file.refuse(f"has {listing.count(sought)} columns '{sought}'", "Give its number.", key=key)
        return listing.index(sought)

    def checked(
        self, columns: Iterable[int], step: float | None, *, resample: bool = False
    ) -> tuple[NDArray[np.float64], Clock | None]:
        """Return columns without infinite values, at the step that they are taken to have, and their clock.

        Dropped samples are missing (NaN), duplicated ones left out. With `resample` the columns are
        interpolated at even times.
        """
        columns = list(columns)
        if dates := [k for k in columns if k in self.stamped]:
            name = self.names[dates[0]] if self.names else f"column {dates[0] + 1}"
            self.file.refuse(f"has dates or times of day in '{name}', no samples", key="columns")
        chosen = self.values[:, columns]
        infinite = np.argwhere(np.isinf(chosen))
        if len(infinite):
            self.refuse_row(int(infinite[0, 0]), "the value is infinite", "Leave a saturated sample empty.")
        if self.times is not None and self.resolution is not None and step is not None:
            if np.isinf(self.times).any():
                self.refuse_row(int(np.argmax(np.isinf(self.times))), "the time is infinite")
            if resample:
                return self._resampled(chosen, step), None
            clock = clock_of(self.times, step, self.resolution)
            if isinstance(clock, StepDisagreement):
                remedy = "The rows of a record lie one 'step' apart; a missing sample keeps its row."
                remedy += self._interpolates(step)
                if clock.row is not None:
                    self.refuse_row(clock.row, clock.problem, remedy)
                remedy = f"Correct the step, or the file.{self._interpolates(step)}"
                self.file.refuse(clock.problem, remedy, colon=True)
            return (chosen if clock is None else self._placed(chosen, clock)), clock
        if resample:
            self.file.refuse("has no times to resample by", "Name their column: time: NAME.", key="resample")
        return chosen, None

    def _interpolates(self, step: float) -> str:
        """Return the remedy of interpolation at even times where the times allow it, else nothing."""
        assert self.times is not None
        steps = np.diff(self.times)
        usual = float(np.median(steps)) if len(steps) else np.nan
        possible = steps.min(initial=np.inf) > 0 and steps.max(initial=0) <= _WIDEST * step
        if not (possible and 1 / _RATIO < usual / step < _RATIO):
            return ""
        return " resample: true takes the samples at their times, and interpolates them at even ones."

    def _placed(self, values: NDArray[np.float64], clock: Clock) -> NDArray[np.float64]:
        """Return each sample at its place; duplicates must agree."""
        if clock.rows is None:
            return values
        again = np.flatnonzero(np.diff(clock.rows) == 0)
        differ = again[np.any(values[again] != values[again + 1], axis=1)]
        if len(differ):
            self.refuse_row(
                int(differ[0]) + 1, "the time of the row before, with other values", "Drop one of the rows."
            )
        placed = np.full((int(clock.rows[-1]) + 1, values.shape[1]), np.nan)
        placed[clock.rows] = values
        return placed

    def _resampled(self, values: NDArray[np.float64], step: float) -> NDArray[np.float64]:
        """Return columns interpolated at even times from the first one on, by cubic splines."""
        from scipy.interpolate import CubicSpline  # heavy import, needed here only

        assert self.times is not None
        times, steps = self.times, np.diff(self.times)
        backwards = ~(steps > 0)
        if backwards.any():
            self.refuse_row(int(np.argmax(backwards)) + 1, "the time does not go on", "Drop one of the rows.")
        wide = steps > _WIDEST * step
        if wide.any():
            first = int(np.argmax(wide))
            self.refuse_row(
                first + 1,
                f"the time goes on by {steps[first]:.9g} s: more than {_WIDEST} steps are not interpolated",
                "Take a stretch without a gap.",
            )
        usual = float(np.median(steps))
        if not 1 / _RATIO < usual / step < _RATIO:
            problem = f"the times are {usual:.9g} s apart, but 'step' is {step:.9g} s"
            self.file.refuse(
                problem, "Resampling keeps the step; decimate prepares a longer one.", colon=True
            )
        even = np.arange(int((times[-1] - times[0]) / step + 1e-6) + 1) * step + times[0]
        if np.isnan(values).any():
            row = int(np.argmax(np.isnan(values).any(axis=1)))
            self.refuse_row(row, "a sample is missing", "Resampling needs every sample; drop the row.")
        return np.asarray(CubicSpline(times, values)(np.minimum(even, times[-1])))


def unit_and_doubt(stated: str) -> tuple[str, str]:
    """Return the unit that a file states of a channel, and why it is in doubt; words may have capitals."""
    for text in (stated, stated.lower() if len(stated) > _LONGEST_SYMBOL else stated):
        try:
            readings(text)
        except UnknownUnitError:
            continue
        return text, ""
    return "", f"the file states '{stated}', which is no known unit" if stated else ""


def time_column(names: Sequence[str]) -> int | None:
    """Return the column of the time, found by its name; a unit may follow the name.

    Beside `t`, `T` is another quantity; so is what has a unit that is none of time.
    """
    bare = [re.sub(r"[\[(].*", "", split_heading(name)[0]).strip() for name in names]
    columns = [
        k
        for k, name in enumerate(names)
        if re.fullmatch(_TIMES, bare[k], re.IGNORECASE)
        and not ((unit := split_heading(name)[1]) and not unit_fits(unit, ["s"]))
    ]
    return min(columns, key=lambda k: (not bare[k].islower(), bare[k] == "T"), default=None)


def are_numbers(columns: Sequence[str | int]) -> bool:
    """Return True if columns are given by their numbers."""
    return all(isinstance(name, int) for name in columns)
