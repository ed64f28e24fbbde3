"""Parameters and expressions over many samples, with the very numbers of each sample alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from functools import partial
from typing import Any

from dynid.scene.arithmetic.expression import Expression, ExpressionError, OutOfRangeError, parse
from dynid.scene.arithmetic.grammar import name_problem
from dynid.scene.arithmetic.numbers import Number, apply, as_number, to_fraction

Column = list[Number | None]
"""One value a sample; None where it has none: run alone, the sample says why."""


def evaluate(expression: Expression, known: Mapping[str, Number | Column], count: int) -> Column:
    """Evaluate an expression for every sample.

    Parameters
    ----------
    expression
        The expression.
    known
        For every name its value, or one a sample.
    count
        How many samples there are.

    Raises
    ------
    ExpressionError
        Where what all samples share has no value.
    """

    def leaf(item: Fraction | str) -> Number | Column:
        if isinstance(item, Fraction):
            return item
        if item not in known:
            return expression_constant(item)
        return known[item]

    found = expression.fold(leaf, partial(_apply, count=count))
    return found if isinstance(found, list) else [found] * count


def expression_constant(name: str) -> Number:
    """Return the number that a name stands for in every expression."""
    import math

    if name != "pi":
        raise OutOfRangeError(f"no parameter '{name}'")
    return math.pi
