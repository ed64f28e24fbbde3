"""Separator and decimal mark of a table in text, from its lines; what could be read in two ways is refused.

Fields are separated by semicolons, tabs, bars, commas or spaces. Decimals take a point, or a comma where
commas do not separate.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from typing import NamedTuple

from dynid.tables.table import DataFile

Lines = Sequence[tuple[int, str]]
"""Lines of a file with their numbers."""

_EXPONENT = r"([eE][-+]?\d+)?"
_WITH_COMMA = re.compile(rf"[-+]?(\d+,\d*|,\d+){_EXPONENT}")
_WITH_POINT = re.compile(rf"[-+]?(\d+\.\d*|\.\d+){_EXPONENT}")
_THOUSANDS = re.compile(r"[-+]?[1-9]\d{0,2}(,\d{3})+")
_PLAIN = re.compile(rf"[-+]?\d+{_EXPONENT}|nan|na|n/a|", re.IGNORECASE)


class Dialect(NamedTuple):
    """`separator` of the fields (None: spaces), and whether decimals take a `comma`."""

    separator: str | None
    comma: bool = False

    def split(self, line: str) -> list[str]:
        """Return the fields of a line."""
        if self.separator is not None and '"' in line:
            found = next(csv.reader([line], delimiter=self.separator, skipinitialspace=True))
            return [field.strip() for field in found]
        fields = line.split(self.separator)
        return [field.strip().strip('"') for field in fields] if '"' in line else fields

    def number(self, field: str) -> str:
        """Return a field with a decimal point, whatever the table has."""
        return field.replace(",", ".") if self.comma and _WITH_COMMA.fullmatch(field.strip()) else field


def find_dialect(file: DataFile, rows: Lines) -> Dialect:
    """Return the dialect of a table.

    Raises
    ------
    FileError
        Where commas could be read in two ways.
    """
    first = rows[0][1]
    separator = next((mark for mark in ";\t" if mark in first), None)
    if separator is None and "|" in first and all("|" in line for _, line in rows if line.strip()):
        separator = "|"
    if separator is None and "," in "".join(line for _, line in rows[:2]):
        return _with_commas(file, rows)
    found = Dialect(separator)
    fields = [
        (number, field.strip())
        for number, line in rows
        if "," in line
        for field in found.split(line)
        if "," in field
    ]
    numbers = [(number, field) for number, field in fields if _WITH_COMMA.fullmatch(field)]
    if numbers and all(_THOUSANDS.fullmatch(field) for _, field in numbers):
        number, field = numbers[0]
        file.refuse(
            f"'{field}' may be {field.replace(',', '.')} or {field.replace(',', '')}: every comma has three "
            "digits behind it",
            "Write decimals with a point, and no marks between thousands.",
            line=number,
        )
    if numbers:
        pointed = next(
            (
                (number, field)
                for number, line in rows
                if "." in line
                for field in map(str.strip, found.split(line))
                if _WITH_POINT.fullmatch(field)
            ),
            None,
        )
        if pointed is not None:
            file.refuse(
                f"'{pointed[1]}' has a decimal point, '{numbers[0][1]}' a comma",
                "Write decimals in one way.",
                line=max(pointed[0], numbers[0][0]),
            )
    return Dialect(separator, bool(numbers))


def _with_commas(file: DataFile, rows: Lines) -> Dialect:
    """Return the dialect of a table with commas, which separate or are decimal, and no other separators.

    Where both is possible, it is refused.
    """
    separating, decimal = Dialect(","), Dialect(None, comma=True)
    header = (
        len(rows) > 1 and not _is_numeric(separating, rows[0][1]) and not _is_numeric(decimal, rows[0][1])
    )
    body = [(number, line) for number, line in rows[header:] if line.strip()]
    count = len(separating.split(rows[0][1])) if header else None
    by_comma = all(
        _is_numeric(separating, line) and count in (None, len(separating.split(line))) for _, line in body
    )
    by_space = (not header or count == 1) and all(_is_numeric(decimal, line) for _, line in body)
    remedy = "Separate the fields by semicolons, or write decimals with a point; or add a line of names."
    if by_comma and by_space and any("," in line for _, line in body):
        number, line = body[0]
        file.refuse(f"'{line.strip()[:40]}': the comma may separate or be decimal", remedy, line=number)
    if not by_comma and by_space:
        return decimal
    if "." not in "".join(line for _, line in body[:2]):
        for number, line in body:
            fields = [field.strip() for field in separating.split(line)]
            if len(fields) > 1 and any(re.fullmatch(r"0\d+", field) for field in fields[1:]):
                file.refuse(
                    f"'{line.strip()[:40]}': commas seem to separate and to be decimal", remedy, line=number
                )
    return separating


def _is_numeric(dialect: Dialect, line: str) -> bool:
    """Return True if all fields of a line are numbers, or missing."""
    numeric = (_WITH_COMMA,) if dialect.comma else (_WITH_POINT,)
    return all(
        any(form.fullmatch(field.strip()) for form in (*numeric, _PLAIN)) for field in dialect.split(line)
    )
