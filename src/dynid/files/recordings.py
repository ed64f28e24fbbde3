"""Recordings: channels with units and clocks of their own, in groups, and tables of those with one clock.

Recorders store each channel with its rate, its start and its unit. The channels of a table share one clock;
others are refused, as a record has one time axis.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from dynid.files.table import ColumnRequest, DataFile, DataTable, time_column, unit_and_doubt
from dynid.suggestions import did_you_mean, shortened
from dynid.units import split_heading

if TYPE_CHECKING:
    from numpy.typing import NDArray

#: Largest difference of the starts and times of channels with one clock, in steps.
_ONE_CLOCK_TOL = 1e-3


class RecordedChannel(NamedTuple):
    """A channel of a recording: `length` samples, each `step` after the one before, from `start` (s) on.

    `step` is 0 where the file states none. `values` and `times` name arrays of the recording; without
    `times` only `start` and `step` are known. `what` says what it holds where that is no numbers.
    """

    name: str
    group: str
    unit: str
    length: int
    start: float = 0.0
    step: float = 0.0
    values: str = ""
    times: str = ""
    what: str = ""

    @property
    def path(self) -> str:
        """Its group and name."""
        return f"{self.group}/{self.name}" if self.group else self.name

    @property
    def bare_name(self) -> str:
        """Its name without a unit."""
        return self.heading[0]

    @property
    def heading(self) -> tuple[str, str]:
        """Its name and unit, that in the name where it has no other."""
        return (self.name, self.unit) if self.unit else split_heading(self.name)


#: Columns of an array that are channels, at most; one of more is likely to have its axes the other way round.
_MAX_COLUMNS = 1000


def array_channels(
    name: str, key: str, shape: tuple[int, ...], dtype: np.dtype[Any], unit: str = "", group: str = ""
) -> list[RecordedChannel]:
    """Return the channels in an array: itself (``KEY:0``), or its columns, ``KEY:NUMBER``, from 1."""
    if not (what := not_numbers(dtype)):
        lengths = [length for length in shape if length != 1]
        if len(shape) > 2 or (len(shape) == 2 and min(shape) > 1 and shape[1] > min(shape[0], _MAX_COLUMNS)):
            what = f"an array of the shape {shape}, which has no columns as channels"
        elif len(lengths) < 2:
            length = lengths[0] if lengths else 1
            return [RecordedChannel(name or "column 1", group, unit, length, values=f"{key}:0")]
    if what:
        return [RecordedChannel(name or key, group, unit, shape[0] if shape else 1, what=what)]
    return [
        RecordedChannel(
            f"{name or 'column'}{':' if name else ' '}{k}", group, unit, shape[0], values=f"{key}:{k}"
        )
        for k in range(1, shape[1] + 1)
    ]


def not_numbers(dtype: np.dtype[Any]) -> str:
    """Return what an array of a type holds if that is no real numbers; empty if it is."""
    kinds = {"c": "complex numbers", "U": "text", "S": "text", "O": "objects", "M": "dates", "m": "durations"}
    return "" if dtype.kind in "iufb" else kinds.get(dtype.kind, "structures")


@dataclass(frozen=True)
class Recording:
    """The channels of a file, and a function that returns an array by its name."""

    file: DataFile
    channels: tuple[RecordedChannel, ...]
    array: Callable[[str], NDArray[Any]]

    @property
    def groups(self) -> list[str]:
        """The groups that have channels of numbers, in order."""
        return list(dict.fromkeys(channel.group for channel in self.channels if not channel.what))

    def of_group(self, group: str | None) -> list[RecordedChannel]:
        """Return the channels of a group; default: of all."""
        if group is None:
            return list(self.channels)
        channels = [channel for channel in self.channels if channel.group == group]
        if not channels:
            hint = did_you_mean(group, self.groups)
            listed = f"it has {shortened(self.groups, 20)}" if any(self.groups) else "it has no groups"
            self.file.refuse(f"has no group '{group}'{hint or f'; {listed}'}", key="group")
        return channels

    def channel(self, channels: Sequence[RecordedChannel], name: str | int, key: str) -> RecordedChannel:
        """Return one of some channels by its name, with its group or without, or by its number from 1."""
        numeric = [channel for channel in channels if not channel.what]
        if isinstance(name, int):
            if not 1 <= name <= len(numeric):
                self.file.refuse(f"has {len(numeric)} channels of numbers, no channel {name}", key=key)
            return numeric[name - 1]
        for naming in ("name", "path", "bare_name"):
            matches = [channel for channel in channels if getattr(channel, naming) == name]
            if len(matches) > 1:
                paths = shortened([channel.path for channel in matches], 8)
                remedy = "Name the group: file: {path: …, group: NAME}, or give its number."
                self.file.refuse(f"has {len(matches)} channels '{name}': {paths}", remedy, key=key)
            if matches:
                if matches[0].what:
                    self.file.refuse(f"has {matches[0].what} in '{name}', no numbers", key=key)
                return matches[0]
        names = [channel.name if len(self.groups) < 2 else channel.path for channel in numeric]
        hint = did_you_mean(name, names)
        listed = f"has {shortened(names, 20)}" if names else "has no channels of numbers"
        self.file.refuse(
            f"has no channel '{name}'{hint or f'; it {listed}'}", f"It {listed}." if hint else "", key=key
        )

    def time_of(
        self, channel: RecordedChannel, channels: Sequence[RecordedChannel]
    ) -> RecordedChannel | None:
        """Return the channel of times beside one without a clock, by its name; None if there is none."""
        if channel.times or channel.step:
            return None
        beside = [
            other
            for other in channels
            if not other.what and other.group == channel.group and other.length == channel.length
        ]
        headings = (other.heading for other in beside)
        at = time_column([f"{name} [{unit}]" if unit else name for name, unit in headings])
        return None if at is None else beside[at]

    def times(self, channel: RecordedChannel) -> NDArray[np.float64]:
        """Return the times of the samples of a channel that states its clock, s."""
        after = self.array(channel.times) if channel.times else channel.step * np.arange(channel.length)
        return np.asarray(after + channel.start, dtype=np.float64)


def read(source: Callable[[DataFile], Recording], file: DataFile, request: ColumnRequest) -> DataTable:
    """Return the requested channels of a file that a function reads as a recording."""
    return table_of(source(file), request)


def table_of(recording: Recording, request: ColumnRequest) -> DataTable:
    """Return the requested channels of a recording as a table; refused unless they have one clock."""
    file, layout, columns = recording.file, request.layout, request.columns
    layout.only(file, "group", "time")
    channels = recording.of_group(layout.group)
    clock = None if layout.time is None else recording.channel(channels, layout.time, "time")
    if columns is None:
        chosen = _all_of(recording, channels, clock)
    else:
        key = "column" if request.single else "columns"
        chosen = [recording.channel(channels, name, key) for name in columns]
    if not chosen:
        file.refuse("holds no channels of numbers")
    if empty := [channel.path for channel in chosen if not channel.length]:
        file.refuse(f"has no samples in '{empty[0]}'", key="columns")
    clock = clock or recording.time_of(chosen[0], channels)
    if clock is None:
        for channel in chosen:
            if not (np.isfinite([channel.start, channel.step]).all() and channel.step >= 0):
                stated = f"the step {channel.step:g} s and the start {channel.start:g} s"
                file.refuse(f"states {stated} of '{channel.path}'", "Save it with a positive, finite step.")
        _check_one_clock(recording, chosen)
    if any(channel.length != (clock or chosen[0]).length for channel in chosen):
        listed = shortened([f"{channel.path} {channel.length}" for channel in chosen], 8)
        timed = f"; the times '{clock.path}' have {clock.length}" if clock else ""
        file.refuse(f"has channels of different lengths: {listed}{timed}", _ONE_CLOCK_REMEDY, key="columns")
    parts = [np.asarray(recording.array(channel.values), dtype=float) for channel in chosen]
    headings = [channel.heading for channel in chosen]
    names = [name for name, _ in headings]
    units, doubts = (
        [*column] for column in zip(*(unit_and_doubt(unit) for _, unit in headings), strict=True)
    )
    selected = columns is not None
    if clock is not None:
        stored = recording.array(clock.values)
        precision = np.finfo(stored.dtype).eps if stored.dtype.kind == "f" else 0.0
        times = np.asarray(stored, dtype=float)
        name, unit = clock.heading
        table = DataTable(
            file,
            [*names, name],
            np.column_stack([*parts, times]),
            units=[*units, unit],
            doubts=[*doubts, ""],
            selected=selected,
        )
        return table.timed_by(len(parts), np.abs(np.nan_to_num(times)) * precision)
    table = DataTable(
        file, names, np.column_stack(parts), units=units, doubts=doubts, timed=-1, selected=selected
    )
    if not (chosen[0].times or chosen[0].step):
        return table
    times = recording.times(chosen[0])
    return replace(table, times=times, resolution=np.abs(times) * float(np.finfo(float).eps))


def _all_of(
    recording: Recording, channels: Sequence[RecordedChannel], clock: RecordedChannel | None
) -> list[RecordedChannel]:
    """Return all channels of numbers but those of times."""
    groups = list(dict.fromkeys(channel.group for channel in channels if not channel.what))
    if len(groups) > 1:
        recording.file.refuse(
            f"has {len(groups)} groups of channels: {shortened(groups, 20)}",
            "Name one: file: {path: …, group: NAME}.",
            key="group",
        )
    times = [clock, *(recording.time_of(channel, channels) for channel in channels)]
    return [channel for channel in channels if not channel.what and channel not in times]


_ONE_CLOCK_REMEDY = (
    "Name columns of one clock: columns: […], and others in 'beside', their channels with a clock: {step: …}."
)


def _check_one_clock(recording: Recording, channels: Sequence[RecordedChannel]) -> None:
    """Refuse channels whose rates, starts or lengths differ."""
    first = channels[0]
    for channel in channels[1:]:
        same = channel[3:6] == first[3:6] and channel.times == first.times
        if not same and channel.length == first.length:
            if channel.times and first.times:
                a, b = recording.times(first), recording.times(channel)
                step = float(np.median(np.diff(a))) if len(a) > 1 else 0.0
                same = bool(np.all(np.abs(a - b) <= _ONE_CLOCK_TOL * step))
            elif not (channel.times or first.times):
                near = abs(channel.start - first.start) <= _ONE_CLOCK_TOL * first.step
                same = near and abs(channel.step - first.step) * first.length <= _ONE_CLOCK_TOL * first.step
        if not same:
            recording.file.refuse(
                f"has channels of different clocks: {_clock_text(recording, first)}; "
                f"{_clock_text(recording, channel)}",
                _ONE_CLOCK_REMEDY,
                key="columns",
            )


def _clock_text(recording: Recording, channel: RecordedChannel) -> str:
    """Return name, number of samples, step and start of a channel in words."""
    start, step = channel.start, channel.step
    if channel.times and channel.length > 1:
        times = recording.times(channel)
        start, step = float(times[0]), float(np.median(np.diff(times)))
    every = f" every {step:.9g} s from {start:.9g} s" if step else " without times"
    return f"'{channel.path}' has {channel.length} samples{every}"
