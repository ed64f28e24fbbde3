"""The matrix that a reader returns, the checks that all readers share, and text files of FE programs."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO, TypeAlias

import numpy as np

from dynid.errors import DynidError, FileError
from dynid.file_access import obstacle
from dynid.structure.matrices import Label, Matrix, is_sparse

# The most numbers that are read into memory: 2 GB of double precision.
MOST_NUMBERS = 250_000_000
_LAYOUTS = ("csc", "csr", "coo")
COMPLEX = "complex numbers"
"""Descriptions of entries that are no real matrix."""
USE_REAL_PART = "Save its real part; its imaginary part describes damping, in a matrix of its own."
"""The remedy for a complex matrix."""


@dataclass(frozen=True, eq=False)
class ImportedMatrix:
    """A matrix as it is stored in a file.

    Attributes
    ----------
    matrix
        Array or sparse matrix.
    labels
        Labels of rows and columns, where the format has them.
    at_least
        True where the format does not state the size: rows and columns at the end may be missing.
    """

    matrix: Matrix
    labels: tuple[Label, ...] = ()
    at_least: bool = False


# What parsers say in terms of their own interface, and what is meant.
_WORDS = (
    (r"the number of columns changed from (\d+) to (\d+) at row (\d+).*", r"row \3 has \2 numbers, not \1"),
    (r"(invalid literal for int\(\) with base 10|could not convert string to float): ?(''|\"\").*",
     "a number is missing; the file may end too early"),
    (r"(invalid literal for int\(\) with base 10|could not convert string to float): ?(.+)",
     r"\2 is not a number"),
    (r"Object arrays cannot be loaded.*", "an array holds Python objects, which are not read"),
)  # fmt: skip


def _plain(said: str) -> str:
    """Return the message of a parser without terms of its interface."""
    for pattern, text in _WORDS:
        said = re.sub(pattern, text, said)
    return said


@contextmanager
def read_errors(path: Path, what: str, *, claims: bool = False) -> Iterator[None]:
    """Turn any error of a library that parses a user's file into a `FileError`.

    `claims`: the library allocates what a record claims, so that a lack of memory is a damaged file.
    """
    try:
        yield
    except MemoryError:
        if not claims:
            raise
        raise FileError(f"{path} cannot be read as {what}: a record claims more than the memory") from None
    except (DynidError, KeyboardInterrupt):
        raise
    except OSError as error:
        raise FileError(f"{path} cannot be read as {what}: {error.strerror or error}") from None
    except Exception as error:  # parsers fail in many ways on damaged files
        said = _plain(" ".join(str(error).split()))[:200] or type(error).__name__
        raise FileError(f"{path} cannot be read as {what}: {said}") from None


def check_claim(path: Path, shape: tuple[int, ...], entries: int | None = None) -> None:
    """Refuse a header that claims too much, before memory is allocated.

    Parameters
    ----------
    path
        The file.
    shape
        Rows and columns.
    entries
        The number of entries of a sparse matrix; absent: it is dense.

    Raises
    ------
    FileError
        If it is more than is read.
    """
    numbers = max(shape[0], shape[-1], entries) if entries is not None else int(np.prod(shape, dtype=object))
    if numbers > MOST_NUMBERS:
        size = f"{' x '.join(map(str, shape))}{f' with {entries} entries' if entries is not None else ''}"
        raise FileError(
            f"{path} claims a matrix of {size}, more than the {MOST_NUMBERS:.2g} numbers that are read",
            remedy="Large models are read from sparse formats.",
        )


def check_backed(path: Path, rows: int, entries: int, least: int) -> None:
    """Refuse a text file that is too short for what it claims (`least` bytes an entry).

    Raises
    ------
    FileError
        If it is truncated, or its header is wrong.
    """
    size = path.stat().st_size
    if entries * least > size or rows > max(size, 1000):
        raise FileError(
            f"{path} claims {rows} rows and {entries} entries in {size} bytes: it is truncated, "
            "or its header is wrong"
        )


def as_numbers(path: Path, name: str, values: Any) -> Matrix:
    """Return a matrix of real numbers in double precision from the object that a library has read.

    Raises
    ------
    FileError
        If it holds something else.
    """
    where = f"{path}{f': {name!r}' if name else ''}"
    dtype = getattr(values, "dtype", None)
    if dtype is None or dtype.kind not in "iufb":
        kind = COMPLEX if dtype is not None and dtype.kind == "c" else "no plain numbers"
        remedy = USE_REAL_PART if kind == COMPLEX else ""
        raise FileError(f"{where} holds {kind}; a structural matrix is real", remedy=remedy)
    if values.ndim != 2:
        raise FileError(f"{where} has {values.ndim} dimensions; a matrix has two")
    if is_sparse(values):
        from scipy.sparse import csc_array  # loaded already: the matrix is sparse

        return csc_array(values, dtype=np.float64)
    return np.asarray(values, dtype=np.float64)


def compressed(path: Path, shape: Any, parts: tuple[Any, Any, Any], layout: str) -> Matrix:
    """Return a sparse matrix out of its stored arrays, which are not trusted.

    These are data, indices and indptr; of coordinates (``coo``) data, rows and columns, from 0.

    Raises
    ------
    FileError
        If they contradict each other.
    """
    from scipy.sparse import coo_array, csc_array, csr_array

    rows, columns = (int(number) for number in np.asarray(shape).ravel())
    if layout not in _LAYOUTS:
        raise FileError(f"{path} holds a sparse matrix of layout {layout!r}; {', '.join(_LAYOUTS)} are read")
    data, *places = (np.asarray(part).ravel() for part in parts)
    check_claim(path, (rows, columns), len(data))
    numbers = as_numbers(path, "data", data[None, :])
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


# The most characters of a file and those that it includes, and how deep these are nested.
_MOST, _DEEPEST = 1_000_000_000, 10


Reference: TypeAlias = Callable[[Path, str], Path]
"""Function of a file and the name of another one in it, which returns the path of that, or refuses it."""


def included(path: Path, named: str) -> Path:
    """Return the path of a file that another one includes."""
    return path.parent / named


def opened(path: Path, depth: int, size: list[int]) -> TextIO:
    """Return a file opened for reading, as one of those that include each other.

    Parameters
    ----------
    path
        The file.
    depth
        How many files are above it; 0 of the first.
    size
        The characters so far, one entry; those of this file are added.

    Raises
    ------
    FileError
        If it cannot be read, or the files are too many or too large.
    """
    blocked = obstacle(path)
    if blocked is not None:
        raise FileError(f"{path} {blocked[0]}", remedy=blocked[1])
    size[0] += path.stat().st_size
    if depth > _DEEPEST or size[0] > _MOST:
        raise FileError(f"{path}: too many files include each other, or they are too large")
    return path.open(encoding="utf-8-sig", errors="replace")


def real(word: str) -> float:
    """Return a number of Fortran or Nastran: ``1.5D-3`` and ``1.5-3`` are 0.0015, a blank is 0."""
    if not word:
        return 0.0
    return float(re.sub(r"(?<=[0-9.])([+-])", r"e\1", word.upper().replace("D", "E")))
