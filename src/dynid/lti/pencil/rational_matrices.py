"""Matrices of users as exact rational numbers; errors name the entry."""

from __future__ import annotations

import math
from fractions import Fraction
from numbers import Rational, Real
from typing import Any, Literal

import numpy as np

from dynid.errors import UsageError
from dynid.suggestions import did_you_mean

Reading = Literal["binary", "decimal"]
Rows = list[list[Fraction]]
#: Largest exponent of ten in text: beyond, the exact number would fill the memory.
_MAX_EXPONENT = 5000


def one_of(what: str, name: object, allowed: tuple[str, ...]) -> None:
    """Raise a `UsageError` unless a name is among the known ones."""
    if name not in allowed:
        raise UsageError(
            f"no {what} {name!r}{did_you_mean(str(name), allowed)}",
            remedy=f"Use one of {', '.join(allowed)}.",
        )


def exact_rows(name: str, matrix: Any, reading: Reading, shape: tuple[int, int] | None = None) -> Rows:
    """Return a matrix of ints, Fractions, floats or text as rows of Fractions; errors have its name.

    Floats are read as their binary value, or as the shortest decimal that prints them. With a `shape` a flat
    list may stand for one row or column where that fits, the number 0 for a zero matrix.
    """
    one_of("reading", reading, ("binary", "decimal"))
    array = _table(name, matrix)
    if shape is None:
        if array.size + array.ndim < 2:
            array = array.reshape((0, 0) if array.size == 0 else (1, 1))
    elif array.size == shape[0] * shape[1] and (array.ndim < 2 or not array.size):
        array = array.reshape(shape)
    elif array.ndim == 0 and array[()] == 0:
        array = np.zeros(shape, dtype=object)
    if array.ndim != 2 or (shape is not None and array.shape != shape):
        expected = f"{shape[0]} x {shape[1]}" if shape else "a matrix"
        actual = " x ".join(map(str, array.shape)) or "a single number"
        raise UsageError(
            f"{name} is {actual} where {expected} is wanted", remedy="Check the matrices' shapes."
        )
    return [
        [_exact(f"{name}[{i + 1}, {j + 1}]", entry, reading) for j, entry in enumerate(row)]
        for i, row in enumerate(array.tolist() if array.dtype != object else array)
    ]


def shape_of(name: str, matrix: Any) -> tuple[int, ...]:
    """Return a matrix's shape as given."""
    return _table(name, matrix).shape


def _table(name: str, matrix: Any) -> np.ndarray:
    """Return a matrix as an array of doubles or integers, else of objects."""
    if hasattr(matrix, "toarray"):
        matrix = matrix.toarray()
    if isinstance(matrix, np.ndarray):
        return matrix if matrix.dtype.kind in "iuf" and matrix.dtype.itemsize >= 8 else matrix.astype(object)
    try:
        table = np.array(matrix, dtype=object)
    except ValueError:
        table = np.array([None])
    if any(entry is None or isinstance(entry, (list, tuple)) for entry in table.flat):
        raise UsageError(
            f"{name} is not a rectangular table of numbers", remedy="Give rows of the same length."
        )
    return table


def _exact(position: str, entry: Any, reading: Reading) -> Fraction:
    """Return one entry as a Fraction."""
    try:
        if isinstance(entry, str):
            _, _, exponent = entry.lower().partition("e")
            if len(entry) > _MAX_EXPONENT or (exponent and abs(int(exponent)) > _MAX_EXPONENT):
                raise ValueError
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
        f"{position} is {entry!r}, which is not a finite real number",
        remedy="Write ints, floats, Fractions, or text such as '1/3'.",
    )
