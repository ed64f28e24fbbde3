"""Matrix Market files (`%%MatrixMarket` in the first line)."""

from __future__ import annotations

from pathlib import Path

from dynid.errors import FileError
from dynid.structure.readers.imported import Imported, as_numbers, check_backed, check_claim, read_errors

BANNER = "%%matrixmarket"

_FIELDS = ("real", "double", "integer")
_SYMMETRIES = ("general", "symmetric")


def read(path: Path) -> Imported:
    """Read a Matrix Market file, coordinates or array, symmetric storage mirrored.

    Raises
    ------
    FileError
        If it is damaged, or holds no real matrix.
    """
    from scipy.io import mmread  # heavy import, needed here only

    with read_errors(path, "Matrix Market"):
        _check_header(path)
        matrix = mmread(path, spmatrix=False)
    return Imported(as_numbers(path, "", matrix))


def _check_header(path: Path) -> None:
    with path.open(encoding="utf-8") as lines:
        words = lines.readline(1000).lower().split()
        if len(words) != 5:
            raise FileError(f"{path}:1: a Matrix Market header has five words")
        _, _, layout, field, symmetry = words
        if field not in _FIELDS:
            raise FileError(f"{path}:1: the matrix is {field}; a structural matrix is real")
        if symmetry not in _SYMMETRIES:
            raise FileError(f"{path}:1: the matrix is {symmetry}; a structural matrix is symmetric")
        number, line = 1, "%"
        while line.startswith("%") or (line and not line.strip()):
            number, line = number + 1, lines.readline(100_000)
    sizes = line.split()
    if len(sizes) != (3 if layout == "coordinate" else 2) or not all(size.isdecimal() for size in sizes):
        raise FileError(f"{path}:{number}: the sizes of the matrix belong here, not {line.strip()[:40]!r}")
    rows, columns, *entries = (int(size) for size in sizes)
    if layout == "coordinate":
        check_backed(path, max(rows, columns), entries[0], 6)
    else:
        check_claim(path, (rows, columns))
        check_backed(path, rows, rows * columns // (2 if symmetry == "symmetric" else 1), 2)
