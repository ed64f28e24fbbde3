"""Matrices in MATLAB scripts of triplets (`.m`), as Sierra/SD and other programs write them.

A function that lists ``row column value;`` between brackets and passes them to ``sparse``. Nothing is
executed.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from dynid.errors import FileError
from dynid.structure.readers.imported_matrix import ImportedMatrix, read_errors
from dynid.structure.readers.triplets import assembled, one_triangle, whole_places

# The largest script, bytes.
_LONGEST = 4_000_000_000
_SPARSE = re.compile(
    r"^\s*(?P<name>\w+)\s*=\s*sparse\(\s*\w+\(:,1\)\s*,\s*\w+\(:,2\)\s*,\s*\w+\(:,3\)"
    r"\s*(?:,\s*(?P<rows>\d+)\s*,\s*(?P<columns>\d+)\s*)?\)"
)


def read_script(path: Path) -> ImportedMatrix:
    """Return the matrix of a script; entries of one triangle only are mirrored.

    Raises
    ------
    FileError
        If it is no such script, or damaged.
    """
    with read_errors(path, "a MATLAB script of a sparse matrix"):
        if path.stat().st_size > _LONGEST:
            raise FileError(f"{path} is too large for a script of a matrix")
        inside, found = False, None
        numbers: list[str] = []
        with path.open(encoding="utf-8") as lines:
            for line in lines:
                text = line.split("%")[0].strip()
                if inside:
                    body, bracket, _ = text.partition("]")
                    if body:
                        numbers.append(body)
                    inside = not bracket
                elif re.fullmatch(r"\w+\s*=\s*\[", text) and not numbers:
                    inside = True
                else:
                    found = found or _SPARSE.match(text)
        if inside or found is None:
            raise ValueError("the triplets have no end, or are not passed to 'sparse'")
        table = np.loadtxt([row.rstrip(";, ") for row in numbers], ndmin=2) if numbers else np.empty((0, 3))
        if table.shape[1] != 3:
            raise ValueError(f"its rows have {table.shape[1]} numbers, not row, column, value")
        ends = whole_places(path, table[:, :2])
        size = (int(found["rows"]), int(found["columns"])) if found["rows"] else None
        shape = size or (int(ends.max(initial=1)),) * 2
        if max(shape) > max(path.stat().st_size, 1000):
            raise ValueError(f"it claims {shape[0]} x {shape[1]}, more rows than its bytes")
        mirror = one_triangle(ends)
        return ImportedMatrix(assembled(path, ends, table[:, 2], shape, mirror=mirror), at_least=size is None)
