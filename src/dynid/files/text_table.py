"""Tables in text files: one row a line; names above it, and units above it or behind the names."""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from dynid.files.date_times import DateTimeError, is_stamp, kind_of, read_stamps
from dynid.files.stamps import printed_resolution
from dynid.files.table import ColumnRequest, DataFile, DataTable, time_column
from dynid.units import is_units_row, unit_of_field

_MISSING = ("", "nan", "na", "n/a")
_NO_TEXT = re.compile("[\x00-\x08\x0e-\x1f\u0900-\uffff]")
_DECIMAL = r"[-+]?(\d+[.,]\d*|\d*[.,]\d+)([eE][-+]?\d+)?"
#: A line that separates others above a table; --- between commas may stand for a missing sample.
_RULE = re.compile(r"[\s|+]*+(?:[-=_*~]{3,}+[\s|+:]*+)++|[\s;,]*+(?:[-=_*~]{4,}+[\s;,]*+)++")
_MARKS = "-=_*~"
#: The start of a line that may be a row of numbers.
_ROW = re.compile(r"\s*[\"']?[-+]?[.,]?\d")
_COMPLEX = (
    "Frequency responses are read by 'frf', modes by 'modes'; of records and matrices write real and "
    "imaginary parts in columns, or files, of their own."
)
ACCEPTED = "A missing sample is an empty field, nan, NA or n/a."


def read_columns(file: DataFile, request: ColumnRequest) -> DataTable:
    """Return all columns of a text file."""
    request.layout.only(file, "time")
    return read_text(file, request.layout.time)


def read_text(
    file: DataFile, time: str | int | None = None, number: Callable[[str], float | complex] | None = None
) -> DataTable:
    """Return all columns of a text file; `time` is the column of the times, default: it is found by its name.

    `number` converts a field; default: to a real number.
    """
    return read_lines(file, _text(file).split("\n"), time, number)


def read_lines(
    file: DataFile,
    lines_of_file: list[str],
    time: str | int | None = None,
    number: Callable[[str], float | complex] | None = None,
) -> DataTable:
    """Return all columns of the lines of a text file; parameters as of `read_text`."""
    rows = _rows(file, lines_of_file)
    skipped, late = _above_names(rows, number or _number)
    rows = rows[skipped:]
    start, dialect = rows[0][0], _find_dialect(file, rows)
    first = [field.strip() for field in dialect.split(rows[0][1])]
    has_header = _are_names(first)
    body = rows[has_header:]
    units: list[str] = []
    if has_header and body:
        below = dialect.split(body[0][1])
        if len(below) == len(first) and is_units_row(below):
            units, body = [unit_of_field(field) for field in below], body[1:]
    if not body:
        file.refuse("holds names but no data")
    if not has_header and len(first) == 1 and start > 1:
        # Samples may be missing in empty lines before a lone column without a header, or not.
        for at, line in enumerate(lines_of_file[: start - 1], 1):
            if not line.strip():
                message = "an empty line before the first sample"
                file.refuse(message, "Drop it, or write nan for a sample.", line=at)
    fields = [_row(file, number, line, dialect, len(first), late) for number, line in body]
    if len(first) > 1 and not first[-1] and all(not row[-1].strip() for row in fields):
        first, fields = first[:-1], [row[:-1] for row in fields]  # every line ends with the separator
    if dialect.comma:
        fields = [[dialect.number(field) for field in row] for row in fields]
    lines = [number for number, _ in body]
    stamps = {} if number else _taken_stamps(fields)
    values = np.array(
        [_numbers(file, at, row, number or _number, late) for at, row in zip(lines, fields, strict=True)],
        dtype=float if number is None else complex,
    ).reshape(len(fields), len(first))
    names = first if has_header else []
    above = f"the first {start - 1} lines of {file.path.name}" if start > 2 else f"line 1 of {file.path.name}"
    note = f"{above}, above the column names, {'are' if start > 2 else 'is'} skipped" if skipped else ""
    table = DataTable(file, names, values, lines, units=units[: len(first)], note=note)
    return table if number is not None else _timed(table, fields, stamps, time)


def _timed(
    table: DataTable, fields: list[list[str]], stamps: dict[int, list[str]], time: str | int | None
) -> DataTable:
    """Return a table with the times of a column of numbers, or of stamps."""
    timed = time_column(table.names) if time is None else table.find(time, "time")
    table = replace(table, stamped=tuple(stamps))
    if stamps and (timed is None or timed in stamps):
        return _timed_by_stamps(table, stamps, timed)
    if timed is None:
        return table
    times = table.values[:, timed]
    written = [row[timed] if np.isfinite(t) else "nan" for row, t in zip(fields, times, strict=True)]
    return table.timed_by(timed, printed_resolution(written))


def _taken_stamps(fields: list[list[str]]) -> dict[int, list[str]]:
    """Return the columns of dates and times of day, and leave them empty; a date without a time is none."""
    stamps = {}
    for column in range(len(fields[0])):
        first = next((row[column] for row in fields if row[column].strip().lower() not in _MISSING), "")
        if is_stamp(first.strip()):
            texts = [row[column].strip() for row in fields]
            stamps[column] = ["" if text.lower() in _MISSING else text for text in texts]
    if all(kind_of(next(filter(None, texts))) == "date" for texts in stamps.values()):
        return {}
    for row in fields:
        for column in stamps:
            row[column] = ""
    return stamps


def _timed_by_stamps(table: DataTable, stamped: dict[int, list[str]], timed: int | None) -> DataTable:
    """Return a table with the times of its stamps, s from the first one on."""
    kinds = {column: kind_of(next(filter(None, texts))) for column, texts in stamped.items()}
    if timed is None or kinds[timed] != "date and time":
        by_kind = {
            kind: [k for k in stamped if kinds[k] == kind] for kind in ("date and time", "date", "time")
        }
        if timed is None and len(by_kind["date and time"]) == 1:
            (timed,) = by_kind["date and time"]
        else:
            times = [timed] if timed is not None and kinds[timed] == "time" else by_kind["time"]
            if len(times) != 1 or len(by_kind["date"]) > 1:
                return table
            (timed,) = times
    texts = stamped[timed]
    if kinds[timed] == "time" and (dates := [k for k in stamped if kinds[k] == "date"]):
        texts = [
            f"{day} {time}" if day and time else ""
            for day, time in zip(stamped[dates[0]], texts, strict=True)
        ]
    try:
        stamps = read_stamps(texts)
    except DateTimeError as error:
        remedy = "Write times in seconds, or as 2024-12-11 17:41:40.002."
        table.file.refuse(str(error), remedy, line=table.lines[error.row or 0] if table.lines else None)
    resolution = np.full(len(texts), stamps.resolution)
    return replace(table, times=stamps.seconds, resolution=resolution, timed=timed)


def _are_names(fields: list[str]) -> bool:
    """Return True if the fields of a line are names: they may be whole numbers, but not the first."""
    leading = next((field for field in fields if field), "")
    return (
        not _reads(_number, leading)
        and not re.match(r"(?!\d+:?[-+]?r?[xyz]\b)[-+.,]*\d", leading, re.IGNORECASE)  # but 20:-z is a name
        and not any(re.fullmatch(_DECIMAL, field) for field in fields)
    )


def _rows(file: DataFile, lines: list[str]) -> list[tuple[int, str]]:
    """Return the lines from the first row to the last that is not empty, with their numbers."""
    rows = [(number, line) for number, line in enumerate(lines, 1) if not line.lstrip().startswith("#")]
    top = next((k for k, (_, line) in enumerate(rows) if _ROW.match(line)), 0)
    rows = [row for k, row in enumerate(rows) if k >= top or not _is_rule(row[1])]
    filled = [k for k, (_, line) in enumerate(rows) if line.strip(" \t")]
    if not filled:
        file.refuse("holds no data")
    return rows[filled[0] : filled[-1] + 1]


def _is_rule(line: str) -> bool:
    """Return True of a line of dashes, also around a title."""
    text = line.strip()
    titled = len(text) - len(text.lstrip(_MARKS)) > 2 and len(text) - len(text.rstrip(_MARKS)) > 2
    return _RULE.fullmatch(line) is not None or (titled and re.search("[A-Za-z]", text) is not None)


#: Lines among which the first row of numbers is looked for.
_TOP = 200
_DELETE = "Delete the lines above the column names, if there are any."


def _above_names(rows: Lines, number: Callable[[str], float | complex]) -> tuple[int, int]:
    """Return how many rows stand above the names of the columns, and the line of the first row of numbers.

    Data loggers write what a record is of above its table. It is skipped only where the table is certain:
    two rows of numbers or more, a row of names with as many fields, perhaps one of units; what stands above
    has no numbers alone, and other numbers of fields, or an empty line below it. Else nothing is skipped.
    """
    for separator, joined in (
        (";", False),
        ("\t", False),
        ("|", False),
        (",", False),
        (None, False),
        (None, True),
    ):
        if separator is not None and separator not in rows[-1][1]:
            continue
        dialects = [_Dialect(separator, comma, joined) for comma in (False, True)]
        split = dialects[0].split

        def is_row(line: str, dialects: list[_Dialect] = dialects) -> bool:
            return any(_all_read(number, dialect, line) for dialect in dialects)

        if not is_row(rows[-1][1]):
            continue
        first = next((k for k, (_, line) in enumerate(rows[:_TOP]) if is_row(line)), None)
        if first is None:
            continue
        late, count = rows[first][0], len(split(rows[first][1]))
        names = first - 1
        if names > 0 and is_units_row(split(rows[names][1])):
            names -= 1
        below = [line for _, line in rows[names : first + 2]]
        certain = names > 0 and count > 1 and all(len(split(line)) == count for line in below)
        if not certain and separator is None and not joined:
            continue
        if not (certain and is_row(below[-1]) and _are_names([name.strip() for name in split(below[0])])):
            return 0, late
        width = _filled(split(below[0]))
        above = [_filled(split(line)) if line.strip() else 0 for _, line in rows[:names]]
        blank = max((k for k, filled in enumerate(above) if not filled), default=-1)
        return (0 if width in above[blank + 1 :] else names), late
    return 0, rows[-1][0] + 1


def _filled(fields: list[str]) -> int:
    """Return the number of fields up to the last that is not empty."""
    return max((number for number, field in enumerate(fields, 1) if field.strip()), default=0)


def _all_read(number: Callable[[str], float | complex], dialect: _Dialect, line: str) -> bool:
    """Return True if a line has numbers in all of its fields, one of them at least not missing."""
    fields = [dialect.number(field.strip()) for field in dialect.split(line)]
    return any(field.lower() not in _MISSING for field in fields) and all(
        _reads(number, field) or is_stamp(field) for field in fields
    )


def _text(file: DataFile) -> str:
    """Return the text of a file: UTF-8, UTF-16 with its mark, else the Windows code page of instruments."""
    for encoding in ("utf-8-sig", "utf-16", "cp1252"):
        try:
            text = file.path.read_text(encoding=encoding)
        except UnicodeError:
            continue
        except OSError as error:
            file.refuse(f"cannot be read: {error.strerror}")
        if encoding == "utf-8-sig" or not _NO_TEXT.search(text):
            return text
    file.refuse("is not a text", "Tables are text in UTF-8, or HDF5 (.h5).")


def _row(file: DataFile, number: int, line: str, dialect: _Dialect, count: int, late: int) -> list[str]:
    delete = f" {_DELETE}" if number <= late else ""
    if not line.strip(" \t" if dialect.separator != "\t" else " "):
        if count > 1:
            remedy = f"Drop it; a missing sample keeps its row.{delete}"
            file.refuse("an empty line among the rows", remedy, line=number)
        return [""]
    fields = dialect.split(line)
    if len(fields) != count:
        more = "Where commas separate, decimals take a point." if dialect.separator == "," else ""
        file.refuse(
            f"{len(fields)} field{'s' * (len(fields) != 1)} where the first row has {count}",
            f"{more}{delete}".strip(),
            line=number,
        )
    return fields


def _numbers(
    file: DataFile, at: int, fields: list[str], number: Callable[[str], float | complex], late: int
) -> list[float | complex]:
    try:
        return [number(field) for field in fields]
    except ValueError:
        wrong = next(field.strip() for field in fields if not _reads(number, field))
        if _reads(complex_number, wrong):
            file.refuse(f"'{wrong[:40]}' is a complex number, where real ones are read", _COMPLEX, line=at)
        file.refuse(
            f"'{wrong[:40]}' is not a number", f"{ACCEPTED} {_DELETE}" if at <= late else ACCEPTED, line=at
        )


def _reads(number: Callable[[str], float | complex], field: str) -> bool:
    try:
        number(field)
    except ValueError:
        return False
    return True


def complex_number(field: str) -> complex:
    """Return a real number, or a complex one as ``1.5-2e-3j`` or ``(1.5-2e-3i)``."""
    bare = field.strip().strip("()")
    if bare[-1:] not in ("i", "j"):
        return complex(_number(field))
    if "_" in bare:
        raise ValueError(field)
    return complex(bare.replace(" ", "")[:-1] + "j")


def _number(field: str) -> float:
    try:
        number = float(field)
    except ValueError:
        if field.strip().lower() in _MISSING:
            return float("nan")
        raise
    if "_" in field:  # digits in groups are Python's
        raise ValueError(field)
    return number


Lines = Sequence[tuple[int, str]]
"""Lines of a file with their numbers."""

_EXPONENT = r"([eE][-+]?\d+)?"
_WITH_COMMA = re.compile(rf"[-+]?(\d+,\d*|,\d+){_EXPONENT}")
_WITH_POINT = re.compile(rf"[-+]?(\d+\.\d*|\.\d+){_EXPONENT}")
_THOUSANDS = re.compile(r"[-+]?[1-9]\d{0,2}(,\d{3})+")
_PLAIN = re.compile(rf"[-+]?\d+{_EXPONENT}|nan|na|n/a|", re.IGNORECASE)


class _Dialect(NamedTuple):
    """`separator` of the fields (None: spaces), whether decimals take a `comma`.

    `joined`: a date and the time of day behind it are one field, although a space separates them.
    """

    separator: str | None
    comma: bool = False
    joined: bool = False

    def split(self, line: str) -> list[str]:
        """Return the fields of a line."""
        if self.separator is not None and '"' in line:
            row = next(csv.reader([line], delimiter=self.separator, skipinitialspace=True))
            return [field.strip() for field in row]
        fields = line.split(self.separator)
        if self.joined:
            fields = _joined(fields)
        return [field.strip().strip('"') for field in fields] if '"' in line else fields

    def number(self, field: str) -> str:
        """Return a field with a decimal point, whatever the table has."""
        return field.replace(",", ".") if self.comma and _WITH_COMMA.fullmatch(field.strip()) else field


def _joined(fields: list[str]) -> list[str]:
    """Return fields with a date and the time of day behind it as one, and AM or PM with its time."""
    joined: list[str] = []
    for field in fields:
        if joined and kind_of(joined[-1]) and kind_of(f"{joined[-1]} {field}"):
            joined[-1] = f"{joined[-1]} {field}"
        else:
            joined.append(field)
    return joined


def _find_dialect(file: DataFile, rows: Lines) -> _Dialect:
    """Return the dialect of a table, refused where commas could be read in two ways."""
    dialect = _separated(file, rows)
    if dialect.separator is not None or len(rows) < 2:
        return dialect
    joined = dialect._replace(joined=True)
    names, last = len(dialect.split(rows[0][1])), rows[-1][1]
    return joined if len(dialect.split(last)) != names == len(joined.split(last)) else dialect


def _separated(file: DataFile, rows: Lines) -> _Dialect:
    first = rows[0][1]
    separator = next((mark for mark in ";\t" if mark in first), None)
    if separator is None and "|" in first and all("|" in line for _, line in rows if line.strip()):
        separator = "|"
    if separator is None and "," in "".join(line for _, line in rows[:2]):
        return _with_commas(file, rows)
    dialect = _Dialect(separator)
    fields = [
        (number, field.strip())
        for number, line in rows
        if "," in line
        for field in dialect.split(line)
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
                for field in map(str.strip, dialect.split(line))
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
    return _Dialect(separator, bool(numbers))


def _with_commas(file: DataFile, rows: Lines) -> _Dialect:
    """Return the dialect of a table with commas, which separate or are decimal, and no other marks."""
    separating, decimal = _Dialect(","), _Dialect(None, comma=True)
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


def _is_numeric(dialect: _Dialect, line: str) -> bool:
    """Return True if all fields of a line are numbers or stamps, or missing."""
    numeric = (_WITH_COMMA,) if dialect.comma else (_WITH_POINT,)
    return all(
        any(form.fullmatch(field.strip()) for form in (*numeric, _PLAIN)) or is_stamp(field.strip())
        for field in dialect.split(line)
    )
