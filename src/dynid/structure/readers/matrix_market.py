"""Matrix Market files (`%%MatrixMarket` in the first line).

SciPy's compiled reader ends the process at a number that is cut off; NumPy's text reader does not.
Source: R. F. Boisvert, R. Pozo, K. A. Remington, "The Matrix Market exchange formats", NISTIR 5935, 1996.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from dynid.errors import FileError
from dynid.structure.matrices import Matrix
from dynid.structure.readers.imported import Imported, check_backed, check_claim, read_errors
from dynid.structure.readers.text import assembled, numbers, places

BANNER = "%%matrixmarket"

_FIELDS = ("real", "double", "integer")
_SYMMETRIES = ("general", "symmetric")


class _Header(NamedTuple):
    layout: str
    symmetric: bool
    shape: tuple[int, int]
    entries: int
    lines: int


def read(path: Path) -> Imported:
    """Read a Matrix Market file, coordinates or array, symmetric storage mirrored.

    Raises
    ------
    FileError
        If it is damaged, or holds no real matrix.
    """
    with read_errors(path, "Matrix Market"):
        header = _header(path)
        table = numbers(path, header.lines, "%") if header.entries else np.empty((0, 3))
        columns = 3 if header.layout == "coordinate" else 1
        if header.entries and (len(table) != header.entries or table.shape[1] != columns):
            raise FileError(
                f"{path} has {len(table)} rows of {table.shape[1]} numbers behind its header, which claims "
                f"{header.entries} of {columns}: it is truncated, or its header is wrong"
            )
        if columns == 1:
            return Imported(_dense(header, table[:, 0]))
        ends = places(path, table[:, :2])
        return Imported(assembled(path, ends, table[:, 2], header.shape, mirror=header.symmetric))


def _dense(header: _Header, values: np.ndarray[tuple[int], np.dtype[np.float64]]) -> Matrix:
    """Return the matrix of values column by column, of a symmetric one the lower triangle."""
    rows, columns = header.shape
    if not header.symmetric:
        return np.ascontiguousarray(values.reshape(columns, rows).T)
    matrix = np.zeros(header.shape)
    matrix.T[np.triu_indices(rows)] = values
    return matrix + np.tril(matrix, -1).T


def _header(path: Path) -> _Header:
    with path.open(encoding="utf-8") as lines:
        words = lines.readline(1000).lower().split()
        if len(words) != 5:
            raise FileError(f"{path}:1: a Matrix Market header has five words")
        _, _, layout, field, symmetry = words
        for word, known in ((layout, ("coordinate", "array")), (field, _FIELDS), (symmetry, _SYMMETRIES)):
            if word not in known:
                raise FileError(f"{path}:1: the matrix is {word}; what is read is {' or '.join(known)}")
        number, line = 2, lines.readline(100_000)
        while line.startswith("%") or (line and not line.strip()):
            number, line = number + 1, lines.readline(100_000)
    sizes = line.split()
    if len(sizes) != (3 if layout == "coordinate" else 2) or not all(
        size.isascii() and size.isdigit() for size in sizes
    ):
        raise FileError(f"{path}:{number}: the sizes of the matrix belong here, not {line.strip()[:40]!r}")
    rows, columns, *given = (int(size) for size in sizes)
    symmetric = symmetry == "symmetric"
    if symmetric and rows != columns:
        raise FileError(f"{path}:{number}: a symmetric matrix is square, not {rows} x {columns}")
    if layout == "array":
        check_claim(path, (rows, columns))
    entries = given[0] if given else rows * (rows + 1) // 2 if symmetric else rows * columns
    check_backed(path, max(rows, columns), entries, 6 if given else 2)
    return _Header(layout, symmetric, (rows, columns), entries, number)
