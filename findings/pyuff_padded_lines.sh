#!/usr/bin/env bash
# pyuff 2.5.8 and Universal Files as programs write them.
#
# Records of a Universal File have 80 columns, and many programs pad them with blanks. pyuff refuses a function
# (data set 58) whose last line is padded, and exponents with D, as Fortran prints double precision, with
# "Error when reading data-set(s)."
#
# Installs the pinned package in a temporary folder; fails if the behaviour changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/env"
"$folder/env/bin/pip" install -q --disable-pip-version-check pyuff==2.5.8
"$folder/env/bin/python" - "$folder" <<'PY'
import sys

import pyuff


def function(lines):
    """Return a file with one function of evenly spaced points in double precision."""
    count = sum(len(line.split()) for line in lines)
    return "\n".join([
        "    -1", "    58", "record", "NONE", "NONE", "NONE", "NONE",
        "    1         0    0         0       NONE         1   1       NONE         0   0",
        f"         4{count:10d}         1  0.00000E+00  5.00000E-01  0.00000E+00",
        "        17    0    0    0 Time                 s",
        "        12    0    0    0 NONE                 NONE",
        "         0    0    0    0 NONE                 NONE",
        "         0    0    0    0 NONE                 NONE",
        *lines, "    -1", "",
    ])


def read(text):
    path = f"{sys.argv[1]}/file.uff"
    with open(path, "w") as file:
        file.write(text)
    try:
        return pyuff.UFF(path).read_sets()["data"].tolist()
    except Exception as error:
        return str(error)


last = "   5.00000000000E+00   6.00000000000E+00"
cases = {
    "plain": function([last]),
    "padded": function([last.ljust(80)]),
    "exponents with D": function([last.replace("E", "D")]),
}
refused = "Error when reading data-set(s)."
expected = {"plain": [5.0, 6.0], "padded": refused, "exponents with D": refused}
found = {name: read(text) for name, text in cases.items()}
for name, value in found.items():
    print(f"{name}: {value}")
assert found == expected, "pyuff behaves differently now"
PY
