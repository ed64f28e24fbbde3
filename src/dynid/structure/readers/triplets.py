"""Triplets, row, column and value, and the sparse matrices that they make."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dynid.errors import FileError
from dynid.structure.matrices import Matrix


def one_triangle(ends: NDArray[np.int64]) -> bool:
    """Return True if triplets (rows and columns, N x 2) are of one triangle only."""
    return bool(np.all(ends[:, 0] <= ends[:, 1]) or np.all(ends[:, 0] >= ends[:, 1]))


def whole_places(path: Path, table: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return columns of whole numbers.

    Raises
    ------
    FileError
        Where a number is not whole.
    """
    with np.errstate(invalid="ignore"):
        whole = (np.abs(table) < 2**53) & (table == np.floor(table))
    if not whole.all():
        at = int(np.argmin(whole.all(axis=1)))
        found = ", ".join(f"{value:g}" for value in table[at])
        raise FileError(f"{path}: row {at + 1} of the numbers names no row and column: {found}")
    return table.astype(np.int64)


def assembled(
    path: Path, ends: NDArray[np.int64], values: NDArray[np.float64], shape: tuple[int, int], *, mirror: bool
) -> Matrix:
    """Return the sparse matrix of triplets, rows and columns from 1; with `mirror` both triangles.

    Raises
    ------
    FileError
        If a row or column does not exist.
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
        values = np.concatenate([values, values[off]])
    matrix: Matrix = coo_array((values, (rows, columns)), shape=shape).tocsc()
    return matrix
