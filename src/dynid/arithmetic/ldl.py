"""Symmetric semidefinite matrices as sums of squares: ``A = L D L^T``, exact, with diagonal pivoting."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any, NamedTuple

from dynid.arithmetic.dependent import Dependent, Real
from dynid.arithmetic.numbers import to_fraction

Rows = Mapping[int, Mapping[int, Real]]
"""The nonzero entries of a symmetric matrix, row by row."""

# A pivot may be rounding of the entries where it is a smaller part of the diagonal.
_SUSPICIOUS = Fraction(1, 10**6)


class Square(NamedTuple):
    """One term ``D_k l_k l_k^T`` of the sum: D_k > 0, and ``l_k``, which is 1 in the row of the pivot."""

    pivot: int
    value: Any
    entries: dict[int, Any]


class Indefinite(ArithmeticError):
    """The matrix has a negative eigenvalue."""


def nonzero(matrix: Sequence[Sequence[Real]]) -> dict[int, dict[int, Real]]:
    """Return the entries of a matrix that are not always zero."""
    return {
        i: {j: entry for j, entry in enumerate(row) if isinstance(entry, Dependent) or entry}
        for i, row in enumerate(matrix)
    }


def at_reference(rows: Rows) -> dict[int, dict[int, Fraction]]:
    """Return a matrix at the reference values of unknown parameters, as fractions."""
    values = {}
    for i, row in rows.items():
        exact = {j: reference(entry) for j, entry in row.items()}
        values[i] = {j: value for j, value in exact.items() if value}
    return values


def reference(entry: Real) -> Fraction:
    """Return a number at the reference values of the parameters, as a fraction."""
    return to_fraction(entry.reference if isinstance(entry, Dependent) else entry)


def squares(
    rows: Mapping[int, Mapping[int, Fraction]], rounding: float = 0.0, *, signed: bool = False
) -> list[Square]:
    """Return a positive semidefinite matrix of fractions as a sum of as many squares as its rank.

    The pivot is the diagonal entry whose row has the shortest numbers, so that fractions and fill stay small.
    With a relative `rounding` of the entries, a pivot no larger than that of the sum it is made of is zero.
    If `signed`, an indefinite matrix, else an error, is a sum of squares of either sign, more than its rank
    where its diagonal vanishes.
    """
    left = {i: dict(row) for i, row in rows.items()}
    diagonal = {i: row.get(i, Fraction(0)) for i, row in rows.items()}
    result: list[Square] = []
    size = {i: _bits(row) for i, row in left.items()}
    while left:
        if rounding:
            sound = [i for i in left if left[i].get(i, Fraction(0)) > _SUSPICIOUS * diagonal[i]]
        else:
            sound = [i for i in left if left[i].get(i, 0) > 0]
        if not sound:
            sound = [i for i in left if left[i] and not _is_rounding(rows, result, left, i, rounding)]
        if not sound:
            break
        pivot = min(sound, key=lambda i: (size[i], i))
        row = left.pop(pivot)
        value = row.pop(pivot, Fraction(0))
        if value <= 0 and not signed:
            raise Indefinite
        if not value:  # a diagonal of zeros: a square is taken off and added again
            value = Fraction(1)
            result.append(Square(pivot, -value, {}))
        entries = {i: entry / value for i, entry in row.items()}
        for i, factor in entries.items():
            target = left[i]
            del target[pivot]
            for j, entry in row.items():
                total = target.get(j, Fraction(0)) - factor * entry
                if total:
                    target[j] = total
                else:
                    target.pop(j, None)
            size[i] = _bits(target)
        result.append(Square(pivot, value, entries))
    return result


def _bits(row: Mapping[int, Any]) -> int:
    return sum(value.numerator.bit_length() + value.denominator.bit_length() for value in row.values())


def _is_rounding(rows: Rows, pivots: Sequence[Square], left: Rows, candidate: int, rounding: float) -> bool:
    """Test whether what is left of a row is the rounding of the entries that it was computed from.

    The pivot is ``r^T A r`` of the motion r in which the squares found so far vanish.
    """
    if not rounding:
        return False
    motion = {candidate: 1.0}
    for column in reversed(pivots):
        total = sum(float(entry) * motion[i] for i, entry in column.entries.items() if i in motion)
        if total:
            motion[column.pivot] = -total
    terms = sum(
        abs(float(entry) * motion[i] * motion[j])
        for i in motion
        for j, entry in rows[i].items()
        if j in motion
    )
    return abs(float(left[candidate].get(candidate, 0))) <= rounding * terms


def dependent_squares(rows: Rows, order: Sequence[Square]) -> list[Square]:
    """Return the squares of a matrix of dependent numbers, with the pivots that it has at reference values.

    `ZeroDivisionError` if an entry of a square is zero there, but not at other values.
    """
    left = {i: dict(row) for i, row in rows.items()}
    result = []
    for candidate in order:
        row = left.pop(candidate.pivot)
        value = row.pop(candidate.pivot)
        for i in [i for i in row if i not in candidate.entries]:
            _check_zero(row.pop(i))
            left[i].pop(candidate.pivot, None)
        for i, entry in row.items():
            target, factor = left[i], entry / value
            del target[candidate.pivot]
            for j, other in row.items():
                target[j] = target.get(j, Fraction(0)) - factor * other
        result.append(Square(candidate.pivot, value, {i: entry / value for i, entry in row.items()}))
    for row in left.values():
        for entry in row.values():
            _check_zero(entry)
    return result


def _check_zero(entry: Any) -> None:
    """Raise where a number that is zero at the reference values of its parameters is not zero at others."""
    if not isinstance(entry, Dependent):
        return
    values, size = {}, 0.0
    for k, operand in enumerate(entry._order):
        if not operand.operation:
            values[operand.operands[0]] = (float(operand) or 1.0) * (1 + 0.1 / (k + 1))
        size = max(size, abs(float(operand)))
    if abs(entry.at(values).value) > 1e-9 * size:
        raise ZeroDivisionError
