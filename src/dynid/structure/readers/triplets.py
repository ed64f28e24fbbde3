"""Bare text triplets, as Abaqus exports matrices: `row column value`, or `node,dof,node,dof,value`."""

from __future__ import annotations

import io
import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dynid.errors import FileError
from dynid.structure.matrices import Matrix
from dynid.structure.readers.imported import Imported, read_errors

_COMMENTS = ("*", "#", "%")
_MARKS = ("", *_COMMENTS)


def read(path: Path) -> Imported:
    """Read triplets, one a line; entries of one triangle only are mirrored, repeated ones are added.

    Lines that start with ``*``, ``#`` or ``%`` are comments. With three columns rows and columns count from
    1; with five, DOFs are labelled ``<node>:<dof>``, in ascending order.

    Raises
    ------
    FileError
        If a line is no triplet.
    """
    with read_errors(path, "triplets"):
        table = _numbers(path)
    if table.shape[1] not in (3, 5):
        raise FileError(f"{path} has {table.shape[1]} columns; triplets have 3 (row, column, value) or 5")
    ends = table[:, :-1]
    with np.errstate(invalid="ignore"):
        whole = (np.abs(ends) < 2**53) & (ends == np.floor(ends))
    if not whole.all():
        at = int(np.argmin(whole.all(axis=1)))
        raise FileError(f"{path}: row {at + 1} of numbers names no row and column: {ends[at].tolist()}")
    places = ends.astype(np.int64)
    if table.shape[1] == 3:
        return Imported(_matrix(path, places, table[:, -1]), at_least=True)
    return _labelled(path, places, table[:, -1])


def _numbers(path: Path) -> NDArray[np.float64]:
    text = path.read_text(encoding="utf-8")
    # Fortran writes 1.0D+05. Only numbers can have a D: comments are dropped.
    text = text.replace("D", "E").replace("d", "e")
    commas = "," in next((line for line in text.splitlines() if line.strip(" \t")[:1] not in _MARKS), "")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # that there is no data is said below
        table = np.loadtxt(
            io.StringIO(text), comments=list(_COMMENTS), delimiter="," if commas else None, ndmin=2
        )
    if not table.size:
        raise FileError(f"{path} holds no triplets")
    return table


def _matrix(path: Path, places: NDArray[np.int64], values: NDArray[np.float64]) -> Matrix:
    from scipy.sparse import coo_array  # heavy import, needed here only

    n, size = int(places.max()), path.stat().st_size
    if places.min() < 1 or n > max(size, 1000):
        wrong = int(places.min()) if places.min() < 1 else n
        raise FileError(f"{path} names row or column {wrong}; they count from 1, in a file of {size} bytes")
    rows, columns = places.T - 1
    off = rows != columns
    if np.all(rows <= columns) or np.all(rows >= columns):
        rows, columns = np.concatenate([rows, columns[off]]), np.concatenate([columns, rows[off]])
        values = np.concatenate([values, values[off]])
    matrix: Matrix = coo_array((values, (rows, columns)), shape=(n, n)).tocsc()
    return matrix


def _labelled(path: Path, places: NDArray[np.int64], values: NDArray[np.float64]) -> Imported:
    both = np.concatenate([places[:, :2], places[:, 2:]])
    dofs, inverse = np.unique(both, axis=0, return_inverse=True)
    ends = inverse.reshape(2, -1).T + 1
    labels = tuple(f"{node}:{dof}" for node, dof in dofs.tolist())
    matrix = _matrix(path, ends, values)
    return Imported(matrix, labels)
