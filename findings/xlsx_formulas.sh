#!/usr/bin/env bash
# openpyxl 3.1.5, XlsxWriter 3.2.9 and formulas without values.
#
# A cell with a formula stores its last value beside the formula. XlsxWriter calculates nothing: it stores 0 and marks
# the workbook to be calculated when it is opened (fullCalcOnLoad), which spreadsheet programs do. openpyxl with
# data_only=True returns that 0 as the value, as if it were measured, and says of every workbook that it is marked,
# also of one that is not: the mark is to be read from xl/workbook.xml. Of workbooks that openpyxl itself has written
# the value is None.
#
# Installs the pinned packages in a temporary folder; fails if the behaviour changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/env"
"$folder/env/bin/pip" install -q --disable-pip-version-check openpyxl==3.1.5 XlsxWriter==3.2.9
"$folder/env/bin/python" - "$folder" <<'PY'
import sys
import zipfile

import openpyxl
import xlsxwriter

written, unmarked, own = (f"{sys.argv[1]}/{name}.xlsx" for name in ("written", "unmarked", "own"))
with xlsxwriter.Workbook(written) as book:
    book.add_worksheet().write_row(0, 0, [21.0, "=2*A1"])
with zipfile.ZipFile(written) as book, zipfile.ZipFile(unmarked, "w") as copy:
    for name in book.namelist():
        copy.writestr(name, book.read(name).replace(b' fullCalcOnLoad="1"', b""))
book = openpyxl.Workbook()
book.active.append([21.0, "=2*A1"])
book.save(own)
values, marks = [], []
for path in (written, unmarked, own):
    book = openpyxl.load_workbook(path, data_only=True)
    values.append(book.active["B1"].value)
    marks.append(book.calculation.fullCalcOnLoad)
print(f"2 * 21 is read as {values[0]} (XlsxWriter) and {values[2]} (openpyxl); marks, of which the second is absent: {marks}")
assert values == [0, 0, None], "the values are read differently now"
assert marks == [True, True, True], "the mark is read differently now"
PY
