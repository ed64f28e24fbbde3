"""Dates and times of day in tables, as data loggers write them, turned into seconds.

Read are ``2024-12-11T17:41:40.002+01:00`` (a blank for the T, slashes or points for the dashes),
``11.12.2024 17:41:40,002``, ``12/31/2024 5:41:40 PM``, ``12-Mar-2021 10:00:00``, and a date and a time of day
in columns of their own.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import date
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

_MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
_DATE = (
    r"(?P<date>(?P<y>\d{4})(?P<s>[-/.])(?P<m>\d{1,2})(?P=s)(?P<d>\d{1,2})"
    r"|(?P<one>\d{1,2})(?P<r>[-/.])(?P<two>\d{1,2})(?P=r)(?P<year>\d{4}|\d{2})"
    r"|(?P<day>\d{1,2})[- /.](?P<name>[A-Za-z]{3})[a-z]*[- /.](?P<named_year>\d{4}|\d{2}))"
)
_TIME = (
    r"(?P<h>\d{1,2}):(?P<min>\d{2})(?::(?P<sec>\d{2})(?:[.,](?P<frac>\d+))?)?"
    r"(?:\s*(?P<half>[aApP])\.?[mM]\.?)?\s*(?P<zone>Z|UTC|GMT|[-+]\d{2}(?::?\d{2})?)?"
)
_DATE_TIME = re.compile(rf"{_DATE}(?:\s+|T|,\s+){_TIME}")
_DATE_ALONE, _TIME_ALONE = re.compile(_DATE), re.compile(_TIME)
_DAY = 86400


class DateTimeError(ValueError):
    """A fault of a stamp, and its row (from 0; None: of no single one)."""

    def __init__(self, problem: str, row: int | None = None) -> None:
        super().__init__(problem)
        self.row = row


class Stamps(NamedTuple):
    """Seconds since the first stamp (NaN where one is missing), and the last place of them as printed, s."""

    seconds: NDArray[np.float64]
    resolution: float


def kind_of(field: str) -> str:
    """Return ``date and time``, ``date`` or ``time`` of a field; empty of another."""
    text = field.strip()
    forms = {"date and time": _DATE_TIME, "date": _DATE_ALONE, "time": _TIME_ALONE}
    return next((kind for kind, form in forms.items() if form.fullmatch(text)), "")


def is_stamp(field: str) -> bool:
    """Return True of a date, a time of day, or both."""
    return field[:1].isdigit() and bool(kind_of(field))


def read_stamps(fields: Sequence[str]) -> Stamps:
    """Return the times of stamps, one a row; times of day without a date go on at midnight."""
    filled = [(row, text) for row, field in enumerate(fields) if (text := field.strip())]
    dated = any(kind_of(text) == "date and time" for _, text in filled)
    form = _DATE_TIME if dated else _TIME_ALONE
    matches: list[tuple[int, re.Match[str]]] = []
    for row, text in filled:
        match = form.fullmatch(text)
        if match is None:
            raise DateTimeError(f"'{text[:40]}' is no {'date and time' if dated else 'time of day'}", row)
        matches.append((row, match))
    day_first = _day_first([match for _, match in matches]) if dated else True
    decimals = max((len(match["frac"] or "") for _, match in matches), default=0)
    scale, midnights = 10**decimals, 0
    ticks: list[int] = []
    before: int | None = None
    for row, match in matches:
        try:
            second = _second(match)
            days = _ordinal(match, day_first) if dated else 0
        except ValueError as error:
            raise DateTimeError(f"'{match[0]}' does not exist: {error}", row) from None
        if not dated and before is not None and second - before < -_DAY // 2:
            midnights += 1
        before = second
        fraction = int((match["frac"] or "").ljust(decimals, "0") or 0)
        ticks.append(((days + midnights) * _DAY + second) * scale + fraction)
    seconds = np.full(len(fields), np.nan)
    # Whole numbers, so that no digit is lost to the date.
    seconds[[row for row, _ in matches]] = [(tick - ticks[0]) / scale for tick in ticks]
    return Stamps(seconds, 1 / scale if matches and matches[0][1]["sec"] else 60.0)


def _second(match: re.Match[str]) -> int:
    """Return the second of the day in universal time, or in that of the file."""
    hour, minute, second = int(match["h"]), int(match["min"]), int(match["sec"] or 0)
    if match["half"]:
        if not 1 <= hour <= 12:
            raise ValueError("hours before or after noon are 1 to 12")
        hour = hour % 12 + 12 * (match["half"] in "pP")
    if hour > 24 or minute > 59 or second > 60:
        raise ValueError("there are 24 hours, 60 minutes and 60 seconds")
    offset = 0
    if (zone := match["zone"]) and zone[0] in "+-":
        digits = zone[1:].replace(":", "").ljust(4, "0")
        offset = (int(digits[:2]) * 3600 + int(digits[2:]) * 60) * (-1 if zone[0] == "-" else 1)
    return hour * 3600 + minute * 60 + second - offset


def _ordinal(match: re.Match[str], day_first: bool) -> int:
    """Return the number of a day."""
    if match["y"]:
        year, month, day = int(match["y"]), int(match["m"]), int(match["d"])
    elif match["name"]:
        if match["name"].lower() not in _MONTHS:
            raise ValueError(f"{match['name']} is no month")
        year, month = int(match["named_year"]), _MONTHS.index(match["name"].lower()) + 1
        day = int(match["day"])
    else:
        day, month = (int(match[group]) for group in (("one", "two") if day_first else ("two", "one")))
        year = int(match["year"])
    return date(year if year > 99 else 2000 + year, month, day).toordinal()


def _day_first(matches: Sequence[re.Match[str]]) -> bool:
    """Return True if the day stands before the month in dates that end with the year."""
    pairs = {(int(match["one"]), int(match["two"])) for match in matches if match["one"]}
    points = any(match["r"] == "." for match in matches if match["one"])
    over = any(first > 12 for first, _ in pairs), any(second > 12 for _, second in pairs)
    if over[0] and over[1]:
        raise DateTimeError("its dates have numbers above 12 at the places of day and month")
    # Of one day only differences count.
    if not points and not any(over) and len(pairs) > 1:
        (first, second), *_ = sorted(pairs)
        raise DateTimeError(f"day and month of '{first}/{second}' cannot be distinguished")
    return not over[1]
