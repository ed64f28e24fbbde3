"""Expressions over many samples, with the very numbers of each sample alone."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from decimal import Decimal
from fractions import Fraction
from functools import partial
from typing import Any

from dynid.scene.arithmetic.expression import Expression
from dynid.scene.arithmetic.numbers import Number, OutOfRangeError, apply, to_fraction

SampleColumn = list[Number | None]
"""One value a sample; None where it has none: run alone, the sample says why."""


def numbers(raw: Sequence[Any]) -> SampleColumn:
    """Read the values of samples as the decimals they are written as."""
    return [_number(value) for value in raw]


def evaluate(expression: Expression, known: Mapping[str, Number | SampleColumn], count: int) -> SampleColumn:
    """Evaluate an expression for every sample.

    Parameters
    ----------
    expression
        The expression.
    known
        For every name in it a value, or one a sample.
    count
        How many samples there are.
    """

    def leaf(item: Fraction | str) -> Number | SampleColumn:
        if isinstance(item, Fraction):
            return item
        return math.pi if item == "pi" else known[item]

    found = expression.fold(leaf, partial(_apply, count=count))
    return found if isinstance(found, list) else [found] * count


def _number(value: Any) -> Number | None:
    if type(value) is float and math.isfinite(value):  # the quick way to the same fraction
        return Fraction(*Decimal(repr(value)).as_integer_ratio())
    try:
        return to_fraction(value)
    except OutOfRangeError:
        return None


def _apply(operation: str, operands: list[Number | SampleColumn], *, count: int) -> Number | SampleColumn:
    if not any(isinstance(operand, list) for operand in operands):
        return apply(operation, operands)  # type: ignore[arg-type]
    columns = [operand if isinstance(operand, list) else [operand] * count for operand in operands]
    return [_applied(operation, list(row)) for row in zip(*columns, strict=True)]


def _applied(operation: str, row: list[Number | None]) -> Number | None:
    if any(value is None for value in row):
        return None
    try:
        return apply(operation, row)  # type: ignore[arg-type]
    except OutOfRangeError:
        return None
