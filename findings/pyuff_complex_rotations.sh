#!/usr/bin/env bash
# pyuff 2.5.8 and complex mode shapes with rotations (Universal File, data set 55).
#
# Values stand six in a line (6E13.5), so that six complex ones of a node take two lines. pyuff takes every second
# line for a node, and refuses such a data set. It reads three complex or six real values a node, which fit a line.
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


def mode(values, kind, count):
    """Return a file with a mode at one node: values there, real (2) or complex (5), so many a node."""
    lines = ["".join(f"{value:13.5E}" for value in values[k : k + 6]) for k in range(0, len(values), 6)]
    return "\n".join([
        "    -1", "    55", *["NONE".ljust(80)] * 5,
        f"         1         3         {2 if count == 3 else 3}         8{kind:10d}{count:10d}",
        "         2         6         0         1",
        " -2.00000E-01  3.70000E+01  1.00000E+00  0.00000E+00  0.00000E+00  0.00000E+00",
        "        12", *lines, "    -1", "",
    ])


def read(text):
    path = f"{sys.argv[1]}/file.uff"
    with open(path, "w") as file:
        file.write(text)
    try:
        return [complex(value) for value in pyuff.UFF(path).read_sets()["r3"]]
    except Exception as error:
        return f"{type(error).__name__}: {error}"


found = {
    "three complex values": read(mode([1, 2, 3, 4, 5, 6], 5, 3)),
    "six real values": read(mode([1, 2, 3, 4, 5, 6], 2, 6)),
    "six complex values": read(mode([*range(1, 13)], 5, 6)),
}
for name, value in found.items():
    print(f"{name}: {value}")
assert found["three complex values"] == [5 + 6j], "pyuff behaves differently now"
assert found["six real values"] == [3], "pyuff behaves differently now"
assert isinstance(found["six complex values"], str), "pyuff behaves differently now"
PY
