"""What the entries of a user's matrices mean: exact rational numbers, or a fault that names its place."""

from __future__ import annotations

import math
from fractions import Fraction
from numbers import Rational, Real
from typing import Any, Literal

import numpy as np

from dynid.errors import UsageError
from dynid.words import did_you_mean

Reading = Literal["binary", "decimal"]
Rows = list[list[Fraction]]
#: Largest exponent of ten in text; beyond, a number takes no place in a matrix but fills the memory.
_EXPONENT = 5000


def one_of(what: str, name: object, known: tuple[str, ...]) -> None:
    """Raise a `UsageError` unless a name is a known one."""
    if name not in known:
        raise UsageError(
            f"no {what} {name!r}{did_you_mean(str(name), known)}", remedy=f"Use one of {', '.join(known)}."
        )


def exact_rows(name: str, matrix: Any, reading: Reading, shape: tuple[int, int] | None = None) -> Rows:
    """Return a matrix as rows of Fractions.

    Parameters
    ----------
    name
        What the matrix is called in faults.
    matrix
        Nested lists, a NumPy array or a SciPy sparse matrix of ints, Fractions, floats or text.
    reading
        What a float means: its binary value, or the shortest decimal that prints it.
    shape
        The shape that it must have. A flat list passes for one row or one column where that fits, a
        number 0 for a zero matrix.

    Raises
    ------
    UsageError
        For another shape, or an entry that is no finite real number.
    """
    one_of("reading", reading, ("binary", "decimal"))
    array = _shaped(_table(name, matrix), shape)
    if array.ndim != 2 or (shape is not None and array.shape != shape):
        wanted = f"{shape[0]} x {shape[1]}" if shape else "a matrix"
        found = " x ".join(map(str, array.shape)) or "a single number"
        raise UsageError(f"{name} is {found} where {wanted} is wanted", remedy="Check the matrices' shapes.")
    return [
        [_exact(f"{name}[{i + 1}, {j + 1}]", entry, reading) for j, entry in enumerate(row)]
        for i, row in enumerate(array.tolist() if array.dtype != object else array)
    ]


def _shaped(array: np.ndarray, shape: tuple[int, int] | None) -> np.ndarray:
    """Write out what stands for a matrix: nothing, a number, a flat list, 0."""
    if shape is None:
        return array.reshape((0, 0) if array.size == 0 else (1, 1)) if array.size + array.ndim < 2 else array
    if array.size == shape[0] * shape[1] and (array.ndim < 2 or not array.size):
        return array.reshape(shape)
    return np.zeros(shape, dtype=object) if array.ndim == 0 and array[()] == 0 else array


def shape_of(name: str, matrix: Any) -> tuple[int, ...]:
    """Return a matrix's shape as it is written."""
    return _table(name, matrix).shape


def _table(name: str, matrix: Any) -> np.ndarray:
    """Return a matrix as an array; what is no array of numbers keeps its entries as objects."""
    if hasattr(matrix, "toarray"):
        matrix = matrix.toarray()
    if isinstance(matrix, np.ndarray):
        return matrix if matrix.dtype.kind in "iuf" and matrix.dtype.itemsize >= 8 else matrix.astype(object)
    try:
        table = np.array(matrix, dtype=object)
    except ValueError:
        table = np.array([None])
    if any(entry is None or isinstance(entry, (list, tuple)) for entry in table.flat):
        raise UsageError(f"{name} is no rectangle of numbers", remedy="Give rows of the same length.")
    return table


def _exact(place: str, entry: Any, reading: Reading) -> Fraction:
    """Return one entry as a Fraction."""
    try:
        if isinstance(entry, str):
            _refuse_giants(entry)
            return Fraction(entry)
        if isinstance(entry, Rational):
            return Fraction(int(entry.numerator), int(entry.denominator))
        if hasattr(entry, "p") and hasattr(entry, "q"):  # flint's and sympy's rationals
            return Fraction(int(entry.p), int(entry.q))
        if isinstance(entry, Real) or hasattr(entry, "as_tuple"):
            if not math.isfinite(entry):
                raise ValueError
            decimal = reading == "decimal" and isinstance(entry, Real)
            return Fraction(str(entry) if decimal else entry)
    except (ValueError, ZeroDivisionError, OverflowError):
        pass
    raise UsageError(
        f"{place} is {entry!r}, which is no finite real number",
        remedy="Write ints, floats, Fractions, or text such as '1/3'.",
    )


def _refuse_giants(text: str) -> None:
    _, _, exponent = text.lower().partition("e")
    if len(text) > _EXPONENT or (exponent and abs(int(exponent)) > _EXPONENT):
        raise ValueError
