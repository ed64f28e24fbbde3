"""Workbooks (`.xlsx`): the rows of a sheet, read as those of a text table with tabs.

openpyxl reads in a separate process, which writes each row as a line: numbers with all digits, dates as ISO.
"""

from __future__ import annotations

import json
import re
import zipfile
from collections.abc import Iterator
from datetime import date, datetime, time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from dynid.files.recorder_files import converted, problems_in
from dynid.files.table import ColumnRequest, DataFile, DataTable
from dynid.files.text_table import read_lines
from dynid.files.untrusted import MOST_NUMBERS
from dynid.suggestions import did_you_mean, shortened

_WHAT = "a workbook"
_CHUNK, _MAX_TAG = 1 << 20, 40  # bytes of a sheet that are searched at a time, and of the start of a tag
#: Bytes of a workbook that are read in a second, at least.
_WORKBOOK_BYTES_A_SECOND = 100_000


def read_columns(file: DataFile, request: ColumnRequest) -> DataTable:
    """Return all columns of a sheet: the named one, or the only one with cells."""
    layout = request.layout
    layout.only(file, "time", "sheet")
    return read_lines(file, lines_of(file, layout.sheet), layout.time)


class _Sheet(NamedTuple):
    """A sheet: the name of the array of its lines, and why it cannot be read, if so."""

    array: str
    problem: str = ""


def sheets_of(file: DataFile) -> list[str]:
    """Return the names of the sheets that have cells."""
    return [*_sheets(_archive_of(file))]


def _archive_of(file: DataFile) -> Path:
    return converted(file, _WHAT, "openpyxl", archive, bytes_a_second=_WORKBOOK_BYTES_A_SECOND)


def _sheets(archive_file: Path) -> dict[str, _Sheet]:
    with np.load(archive_file, allow_pickle=False) as stored:
        return {name: _Sheet(*sheet) for name, sheet in json.loads(str(stored["index"])).items()}


def lines_of(file: DataFile, name: str | None) -> list[str]:
    """Return the rows of a sheet as lines; default: of the only one."""
    archive_file = _archive_of(file)
    sheets = _sheets(archive_file)
    if name is None and len(sheets) != 1:
        listed = f": {shortened([*sheets], 20)}" if sheets else ""
        problem = f"has {len(sheets) or 'no'} sheets with cells{listed}"
        file.refuse(problem, "Name one: sheet: NAME.", key="sheet")
    if name is not None and name not in sheets:
        hint = did_you_mean(name, sheets) or f"; it has {shortened([*sheets], 20)}"
        file.refuse(f"has no sheet '{name}' with cells{hint}", key="sheet")
    title = next(iter(sheets)) if name is None else name
    if sheets[title].problem:
        remedy = "Save the workbook with a spreadsheet program, which calculates it."
        file.refuse(f"has in the sheet '{title}', {sheets[title].problem}", remedy)
    with np.load(archive_file, allow_pickle=False) as stored:
        return str(stored[sheets[title].array]).split("\n")


def archive(path: str, target: str) -> None:
    """Write the rows of each sheet as lines into a NumPy archive, or why there are none."""
    from openpyxl import load_workbook

    with problems_in(target):
        calculated, stale = _formulas(path)
        formulas = load_workbook(path, read_only=True) if calculated else None
        stored = load_workbook(path, read_only=True, data_only=True)
        index: dict[str, _Sheet] = {}
        members: dict[str, Any] = {}
        cells = 0
        for sheet in stored.worksheets:
            lines = []
            problem = "" if formulas is None else _uncalculated(sheet, formulas[sheet.title], stale)
            for row in () if problem else _rows(sheet):
                cells += len(row)
                if cells > MOST_NUMBERS:
                    raise ValueError(f"it has more than {MOST_NUMBERS:.2g} cells")
                lines.append("\t".join(map(_field, row)).rstrip("\t"))
            width = max((line.count("\t") for line in lines), default=0)
            if problem or any(lines):
                index[sheet.title] = _Sheet(f"a{len(members)}", problem)
                filled = (line + "\t" * (width - line.count("\t")) if line else "" for line in lines)
                members[index[sheet.title].array] = "\n".join(filled)
        np.savez(target, index=json.dumps(index), **members)


def _rows(sheet: Any) -> Iterator[tuple[Any, ...]]:
    """Yield the values of the rows of a sheet."""
    sheet.reset_dimensions()  # those that the file claims may be wrong
    rows: Iterator[tuple[Any, ...]] = sheet.iter_rows(values_only=True)
    return rows


def _formulas(path: str) -> tuple[bool, bool]:
    """Return whether cells of a workbook are calculated, and whether that is left to who opens it.

    Programs that write workbooks without calculating leave the value of a formula out, or write 0 and mark
    the workbook.
    """
    with zipfile.ZipFile(path) as archive:
        sheets = [name for name in archive.namelist() if re.fullmatch(r"xl/worksheets/[^/]+\.xml", name)]
        calculated = any(_contains(archive, name, rb"<(\w+:)?f[\s/>]") for name in sheets)
        stale = _contains(archive, "xl/workbook.xml", rb"fullCalcOnLoad\s*=\s*[\"'](1|true)")
        return calculated, stale


def _contains(archive: zipfile.ZipFile, name: str, pattern: bytes) -> bool:
    """Return True if a part of a workbook contains a pattern."""
    end = b""
    with archive.open(name) as stream:
        while chunk := stream.read(_CHUNK):
            if re.search(pattern, end + chunk):
                return True
            end = chunk[-_MAX_TAG:]
    return False


def _uncalculated(sheet: Any, formulas: Any, stale: bool) -> str:
    """Return the first formula of a sheet whose value is not stored, or `stale`; empty if there is none."""
    for number, (row, sources) in enumerate(zip(_rows(sheet), _rows(formulas), strict=True), 1):
        for cell, source in zip(row, sources, strict=True):
            calculated = source != cell and not (source is None or isinstance(source, int | float))
            if calculated and (cell is None or (stale and isinstance(cell, int | float))):
                return f"row {number}, the formula {str(source)[:40]} without its value"
    return ""


def _field(cell: Any) -> str:
    """Return a cell as a field of a text table."""
    if cell is None:
        return ""
    if isinstance(cell, float):
        return repr(cell)
    if isinstance(cell, datetime | date | time):
        return cell.isoformat(sep=" ") if isinstance(cell, datetime) else cell.isoformat()
    return " ".join(str(cell).split())
