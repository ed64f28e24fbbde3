"""Matrices in text files: Matrix Market, bare triplets as Abaqus exports them, and full rows.

Matrix Market files have the banner `%%MatrixMarket` in their first line (R. F. Boisvert, R. Pozo,
K. A. Remington, "The Matrix Market exchange formats", NISTIR 5935, 1996). SciPy's reader is fast, but takes
`1.0D+5` for 1 and ends the process at a number that is cut off; it is given only what has been checked. All
else goes to NumPy's text reader. Triplets are lines `row column value` or
`node,dof,node,dof,value`. The body of a Matrix Market file without its banner has the same lines below a
size line `rows columns entries`, which is recognised.
"""

from __future__ import annotations

import io
import re
import warnings
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.errors import FileError
from dynid.files.matrix_data import ImportedMatrix
from dynid.files.untrusted import MOST_NUMBERS, check_backed, check_claim, check_size, read_errors
from dynid.structure.matrices import Matrix

BANNER = "%%matrixmarket"

_FIELDS = ("real", "double", "integer")
# The factor of the triangle that is not stored, 0 where both are.
_SYMMETRIES = {"general": 0, "symmetric": 1, "skew-symmetric": -1}
# Lines `row column value`: two whole numbers and a decimal one. Nothing is matched twice (`++`).
_ENTRIES = re.compile(
    rb"(?:[ \t]*+\d++[ \t]++\d++[ \t]++-?+(?:\d++\.?+\d*+|\.\d++)(?:[eE][+-]?+\d++)?+[ \t]*+\r?+\n)++"
)


def has_banner(start: bytes) -> bool:
    """Return True if a file starts with the banner of Matrix Market."""
    return start.lstrip().lower().startswith(BANNER.encode())


class _MatrixMarketHeader(NamedTuple):
    layout: str
    symmetry: str
    shape: tuple[int, int]
    entries: int
    lines: int

    @property
    def mirrored(self) -> int:
        """The factor of the triangle that is not stored; 0 where both are."""
        return _SYMMETRIES[self.symmetry]


def read_matrix_market(path: Path) -> ImportedMatrix:
    """Read a Matrix Market file, coordinates or array, symmetric and skew-symmetric storage mirrored."""
    with read_errors(path, "Matrix Market"):
        header = _matrix_market_header(path)
        if header.layout == "coordinate" and (matrix_read := _by_scipy(path, header)) is not None:
            return ImportedMatrix(matrix_read)
        table = _numbers(path, header.lines, "%") if header.entries else np.empty((0, 3))
        columns = 3 if header.layout == "coordinate" else 1
        if header.entries and (len(table) != header.entries or table.shape[1] != columns):
            raise FileError(
                f"{path} has {len(table)} rows of {table.shape[1]} numbers behind its header, which claims "
                f"{header.entries} of {columns}: it is truncated, or its header is wrong"
            )
        if columns == 1:
            # Column by column; of a symmetric matrix the lower triangle.
            rows, columns = header.shape
            if not header.mirrored:
                return ImportedMatrix(np.ascontiguousarray(table[:, 0].reshape(columns, rows).T))
            matrix = np.zeros(header.shape)
            matrix.T[np.triu_indices(rows, header.mirrored < 0)] = table[:, 0]
            return ImportedMatrix(matrix + header.mirrored * np.tril(matrix, -1).T)
        ends = entry_indices(path, table[:, :2])
        return ImportedMatrix(assembled(path, ends, table[:, 2], header.shape, mirror=header.mirrored))


def _by_scipy(path: Path, header: _MatrixMarketHeader) -> Matrix | None:
    """Return the matrix of a file whose entries are all plainly written; else None."""
    from scipy.io import mmread  # heavy imports, needed here only
    from scipy.sparse import coo_array

    # As real numbers, whatever the header says: of integers SciPy would read 1.5 as 1.
    sizes = f"{header.shape[0]} {header.shape[1]} {header.entries}"
    checked = io.BytesIO()  # one copy of the file in memory
    start = checked.write(f"%%MatrixMarket matrix coordinate real {header.symmetry}\n{sizes}\n".encode())
    with path.open("rb") as lines:
        for _ in range(header.lines):
            lines.readline()
        end = b""
        while block := lines.read(2**20):
            checked.write(block)
            end = block[-1:]
    checked.write(b"" if end == b"\n" else b"\n")
    with checked.getbuffer() as content:
        plain = _ENTRIES.fullmatch(content, start) is not None
    if not plain:
        return None
    checked.seek(0)
    try:
        matrix: Matrix = coo_array(mmread(checked, spmatrix=False)).tocsc()
    except (ValueError, OverflowError):  # another number of entries, or outside: NumPy's reader says which
        return None
    return matrix


def _matrix_market_header(path: Path) -> _MatrixMarketHeader:
    with path.open(encoding="utf-8") as lines:
        words = lines.readline(1000).lower().split()
        if len(words) != 5:
            raise FileError(f"{path}:1: a Matrix Market header has five words")
        _, _, layout, field, symmetry = words
        for word, accepted in ((layout, ("coordinate", "array")), (field, _FIELDS), (symmetry, _SYMMETRIES)):
            if word not in accepted:
                raise FileError(f"{path}:1: the matrix is {word}; what is read is {' or '.join(accepted)}")
        number, line = 2, lines.readline(100_000)
        while line.startswith("%") or (line and not line.strip()):
            number, line = number + 1, lines.readline(100_000)
    sizes = line.split()
    if len(sizes) != (3 if layout == "coordinate" else 2) or not all(
        size.isascii() and size.isdigit() for size in sizes
    ):
        raise FileError(f"{path}:{number}: the sizes of the matrix belong here, not {line.strip()[:40]!r}")
    rows, columns, *count = (int(size) for size in sizes)
    mirrored = _SYMMETRIES[symmetry]
    if mirrored and rows != columns:
        raise FileError(f"{path}:{number}: a {symmetry} matrix is square, not {rows} x {columns}")
    if layout == "array":
        check_claim(path, (rows, columns))
    entries = count[0] if count else rows * (rows + mirrored) // 2 if mirrored else rows * columns
    check_backed(path, max(rows, columns), entries, 6 if count else 2)
    return _MatrixMarketHeader(layout, symmetry, (rows, columns), entries, number)


_COMMENTS = ("*", "#", "%")


def read_triplets(path: Path) -> ImportedMatrix:
    """Read triplets, one a line; entries of one triangle only are mirrored, repeated ones are added.

    Lines that start with ``*``, ``#`` or ``%`` (whichever comes first) are comments. With three columns rows
    and columns count from 1; with five, DOFs are labelled ``<node>:<dof>``, in ascending order. A first line
    of three whole numbers ``rows columns N`` above N entries that lie within these sizes is a size line.
    """
    with read_errors(path, "triplets"):
        comment, first = _opening(path)
        table = _numbers(path, 0, comment)
        if not table.size:
            raise FileError(f"{path} holds no triplets")
        if table.shape[1] not in (3, 5):
            raise FileError(f"{path} has {table.shape[1]} columns; triplets have 3 (row, column, value) or 5")
        ends, values = entry_indices(path, table[:, :-1]), table[:, -1]
        if len(first) == 3 and all(word.isascii() and word.isdigit() for word in first):
            rows, columns, entries = (int(word) for word in first)
            within = not len(ends[1:]) or bool(np.all(ends[1:].max(axis=0) <= (rows, columns)))
            if within and entries == len(ends) - 1:
                if rows != columns:
                    raise FileError(
                        f"{path} holds a matrix of {rows} x {columns}; a structural matrix is square"
                    )
                check_backed(path, rows, entries, 6)
                matrix = assembled(path, ends[1:], values[1:], (rows, columns), mirror=one_triangle(ends[1:]))
                return ImportedMatrix(matrix)
            if within and rows == columns:
                _refuse_doubtful(path, comment, first, ends)
        labels: tuple[str, ...] = ()
        if table.shape[1] == 5:
            both = np.concatenate([ends[:, :2], ends[:, 2:]])
            dofs, inverse = np.unique(both, axis=0, return_inverse=True)
            ends = inverse.reshape(2, -1).T + 1
            labels = tuple(f"{node}:{dof}" for node, dof in dofs.tolist())
        # No more rows than bytes: an index that is wrong must not take memory.
        n = min(int(ends.max()), max(path.stat().st_size, 1000))
        matrix = assembled(path, ends, values, (max(n, 1), max(n, 1)), mirror=one_triangle(ends))
    return ImportedMatrix(matrix, labels, at_least=not labels)


def _opening(path: Path) -> tuple[str, list[str]]:
    """Return the mark of comments, and the words of the first other line; refuse a banner behind it."""
    comment = ""
    with path.open(encoding="utf-8") as lines:
        for line in lines:
            mark = line.strip()[:1]
            if line.strip().lower().startswith(BANNER):
                raise FileError(
                    f"{path} has the banner of a Matrix Market file behind its first line",
                    remedy="Move it to the first line.",
                )
            if mark in _COMMENTS and comment in ("", mark):
                comment = mark
            elif mark:
                first = line.replace(",", " ").split()
                # A file without comments above its numbers may have some below.
                later = (later for line in lines if (later := line.strip()[:1]) in _COMMENTS)
                return comment or next(later, "*"), first
    return comment or "*", []


def _refuse_doubtful(path: Path, comment: str, first: list[str], ends: NDArray[np.int64]) -> None:
    """Refuse a first line that looks like a size line above another number of entries."""
    again = bool(np.any(np.all(ends[1:] == ends[0], axis=1)))
    alone = len(ends) == 1 and ends.max() > 1
    only_whole_value = False  # True where all values but the first are written with a point or an exponent
    if len(ends) > 1:
        with path.open(encoding="utf-8") as lines:
            words = (
                line.replace(",", " ").split() for line in lines if line.strip()[:1] not in ("", comment)
            )
            next(words)
            only_whole_value = not any(line[-1].lstrip("+-").isdigit() for line in words)
    if again or alone or only_whole_value:
        raise FileError(
            f"{path} starts with '{' '.join(first)}' above {len(ends) - 1} entries: a size line of Matrix "
            "Market with a wrong number of entries, or an entry",
            remedy=f"Correct the number of entries; if it is an entry, write its value as {first[2]}.0.",
        )


def _numbers(path: Path, skip: int, comment: str) -> NDArray[np.float64]:
    """Return the columns of numbers behind `skip` lines, separated by spaces or commas."""
    with path.open(encoding="utf-8") as lines:
        line = next(
            (line for k, line in enumerate(lines) if k >= skip and line.strip()[:1] not in comment), ""
        )
    delimiter = "," if "," in line else None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # that there is nothing is said by whoever asks
        if "D" in line.upper():  # Fortran's 1.0D+05
            text = path.read_text(encoding="utf-8").replace("D", "E").replace("d", "e")
            return np.loadtxt(
                io.StringIO(text), comments=comment, delimiter=delimiter, skiprows=skip, ndmin=2
            )
        return np.loadtxt(
            path, comments=comment, delimiter=delimiter, skiprows=skip, ndmin=2, encoding="utf-8"
        )


def read_rows(path: Path) -> ImportedMatrix:
    """Read a matrix row by row, all its entries, as ``printA`` of OpenSees writes it."""
    with read_errors(path, "rows of a matrix"):
        check_size(path, "a matrix with all its entries", 40 * MOST_NUMBERS)
        table = _numbers(path, 0, "#")
        if table.shape[0] != table.shape[1] or not table.size:
            raise FileError(
                f"{path} has {table.shape[0]} rows of {table.shape[1]} numbers; a structural matrix is square"
            )
    return ImportedMatrix(table)


def one_triangle(ends: NDArray[np.int64]) -> bool:
    """Return True if triplets (rows and columns, N x 2) are of one triangle only."""
    return bool(np.all(ends[:, 0] <= ends[:, 1]) or np.all(ends[:, 0] >= ends[:, 1]))


def entry_indices(path: Path, table: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return columns of whole numbers."""
    with np.errstate(invalid="ignore"):
        integral = (np.abs(table) < 2**53) & (table == np.floor(table))
    if not integral.all():
        at = int(np.argmin(integral.all(axis=1)))
        values = ", ".join(f"{value:g}" for value in table[at])
        raise FileError(f"{path}: row {at + 1} of the numbers names no row and column: {values}")
    return table.astype(np.int64)


def assembled(
    path: Path, ends: NDArray[np.int64], values: NDArray[np.float64], shape: tuple[int, int], *, mirror: int
) -> Matrix:
    """Return the sparse matrix of triplets, rows and columns from 1.

    With `mirror` the triangle that is not stored is the other one times this factor.
    """
    from scipy.sparse import coo_array  # heavy import, needed here only

    if ends.size and (ends.min() < 1 or np.any(ends.max(axis=0) > shape)):
        wrong = (ends < 1) | (ends > np.array(shape))
        row, column = ends[int(np.argmax(wrong.any(axis=1)))]
        raise FileError(
            f"{path} names the entry ({row}, {column}); rows and columns count from 1 to "
            f"{shape[0]} and {shape[1]}"
        )
    index = np.int32 if max(shape) <= np.iinfo(np.int32).max else np.int64
    rows, columns = (end.astype(index) - 1 for end in ends.T)
    if mirror:
        off = rows != columns
        rows, columns = np.concatenate([rows, columns[off]]), np.concatenate([columns, rows[off]])
        values = np.concatenate([values, mirror * values[off]])
    matrix: Matrix = coo_array((values, (rows, columns)), shape=shape).tocsc()
    return matrix
