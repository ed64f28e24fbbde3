"""Matrices as files hold them: what readers return, and their checks."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from dynid.errors import FileError
from dynid.files.untrusted import check_claim, read_errors
from dynid.structure.labels import Label
from dynid.structure.matrices import Matrix, is_sparse

_LAYOUTS = ("csc", "csr", "coo")

COMPLEX = "complex numbers"
"""Descriptions of entries that are no real matrix."""

USE_REAL_PART = "Save its real part; its imaginary part describes damping, in a matrix of its own."
"""The remedy for a complex matrix other than a stiffness, whose imaginary part is structural damping."""


@dataclass(frozen=True, eq=False)
class ImportedMatrix:
    """A matrix as it is stored in a file."""

    matrix: Matrix
    labels: tuple[Label, ...] = ()  # labels of rows and columns, where the format has them
    #: True where the format does not state the size: rows and columns at the end may be missing.
    at_least: bool = False


class Container(NamedTuple):
    """The reader of a format that holds several matrices.

    `members` returns by name their shapes, and what stands in the file that is no real matrix; `load` one.
    """

    members: Callable[[Path], Mapping[str, tuple[int, ...] | str]]
    load: Callable[[Path, str], Matrix | ImportedMatrix]

    def shapes(self, path: Path) -> dict[str, tuple[int, ...]]:
        """Return the shapes of the matrices of a file, by name."""
        return {name: what for name, what in self.members(path).items() if not isinstance(what, str)}

    def others(self, path: Path) -> dict[str, str]:
        """Return what stands in a file that is no real matrix, by name."""
        return {name: what for name, what in self.members(path).items() if isinstance(what, str)}

    def matrix(self, path: Path, name: str, *, loss: bool = False) -> ImportedMatrix:
        """Return one matrix of a file, by its name; with `loss` it may be complex."""
        matrix = self.load(path, name)
        imported = matrix if isinstance(matrix, ImportedMatrix) else ImportedMatrix(matrix)
        if not loss:
            check_real_numbers(path, name, imported.matrix)
        return imported


def check_real_numbers(path: Path, name: str, matrix: Matrix) -> None:
    """Refuse a complex matrix."""
    if np.iscomplexobj(matrix):
        where = f"{path}{f': {name!r}' if name else ''}"
        raise FileError(f"{where} holds {COMPLEX}; a structural matrix is real", remedy=USE_REAL_PART)


def real_matrix(path: Path, name: str, values: Any) -> Matrix:
    """Return a matrix of real numbers in double precision from the object that a library has read."""
    matrix = numeric_matrix(path, name, values)
    check_real_numbers(path, name, matrix)
    return matrix


def numeric_matrix(path: Path, name: str, values: Any) -> Matrix:
    """Return a matrix of real or complex numbers in double precision from what a library has read."""
    where = f"{path}{f': {name!r}' if name else ''}"
    dtype = getattr(values, "dtype", None)
    if dtype is None or dtype.kind not in "iufbc":
        raise FileError(f"{where} holds no plain numbers; a structural matrix is real")
    if values.ndim != 2:
        raise FileError(f"{where} has {values.ndim} dimensions; a matrix has two")
    double: Any = np.complex128 if dtype.kind == "c" else np.float64
    if is_sparse(values):
        from scipy.sparse import csc_array  # loaded already: the matrix is sparse

        return csc_array(values, dtype=double)
    return np.asarray(values, dtype=double)


def compressed(path: Path, shape: Any, parts: tuple[Any, Any, Any], layout: str) -> Matrix:
    """Return a sparse matrix out of its stored arrays, which are not trusted.

    These are data, indices and indptr; of coordinates (``coo``) data, rows and columns, from 0.
    """
    from scipy.sparse import coo_array, csc_array, csr_array

    rows, columns = (int(number) for number in np.asarray(shape).ravel())
    if layout not in _LAYOUTS:
        raise FileError(f"{path} holds a sparse matrix of layout {layout!r}; {', '.join(_LAYOUTS)} are read")
    data, *places = (np.asarray(array).ravel() for array in parts)
    check_claim(path, (rows, columns), len(data))
    numbers = numeric_matrix(path, "data", data[None, :])
    assert isinstance(numbers, np.ndarray)
    with read_errors(path, "a sparse matrix"):
        if layout == "coo":
            result: Matrix = coo_array((numbers[0], tuple(places)), shape=(rows, columns)).tocsc()
            return result
        if (
            np.diff(places[1]) < 0
        ).any():  # SciPy looks only where the last pointer says that there is anything
            raise ValueError("the row or column pointers do not increase")
        matrix = {"csc": csc_array, "csr": csr_array}[layout]((numbers[0], *places), shape=(rows, columns))
        matrix.check_format(full_check=True)
        result = matrix.tocsc()
    return result
