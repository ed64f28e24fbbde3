"""Values of the samples of a batch, exactly as each sample alone has them."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from decimal import Decimal
from fractions import Fraction
from graphlib import TopologicalSorter
from typing import Any

from dynid.arithmetic.expression import Expression, parse
from dynid.arithmetic.numbers import Number, OutOfRangeError, apply, to_fraction
from dynid.scene.schema.base import DefinedParameter
from dynid.scene.schema.raw import reference_key, reference_values

SampleColumn = list[Number | None]
"""One value a sample; None where it has none: run alone, the sample reports why."""


def varied_parameter(parameters: Mapping[str, Any], path: Sequence[str]) -> str | None:
    """Return the parameter that a varied path sets to any value; None where it is no such path.

    Parameters
    ----------
    parameters
        The parameters of the scene.
    path
        The parts of the dotted path.
    """
    match path:
        case ["parameters", name] if name in parameters:
            return name
        case ["parameters", name, key] if _is_reference(parameters.get(name), key):
            return name
    return None


def _is_reference(given: Any, key: str) -> bool:
    """Return True for the key that alone determines a parameter's value, which may have any."""
    if not isinstance(given, DefinedParameter) or getattr(given, key, None) is None:
        return False
    bounded = given.min is not None or given.max is not None or given.scale == "log"
    return not bounded and key == reference_key(dict(given))


def dependent_parameters(given: dict[Any, Any], varied: Collection[str]) -> dict[str, Expression]:
    """Return the expressions of parameters that depend on varied ones, each after those that it needs.

    Parameters
    ----------
    given
        The parameters of the scene, as plain data.
    varied
        The names of those that vary.
    """
    raw = reference_values(given)
    texts = {name: parse(text) for name, text in raw.items() if isinstance(text, str)}
    order = TopologicalSorter({name: text.names & texts.keys() for name, text in texts.items()})
    found: dict[str, Expression] = {}
    for name in order.static_order():
        if name not in varied and texts[name].names & {*varied, *found}:
            found[name] = texts[name]
    return found


def numbers(raw: Sequence[Any]) -> SampleColumn:
    """Return the values of samples as the decimals they are written as."""
    column: SampleColumn = []
    for value in raw:
        if type(value) is float and math.isfinite(value):  # the quick way to the same fraction
            column.append(Fraction(*Decimal(repr(value)).as_integer_ratio()))
            continue
        try:
            column.append(to_fraction(value))
        except OutOfRangeError:
            column.append(None)
    return column


def evaluate(expression: Expression, known: Mapping[str, Number | SampleColumn], count: int) -> SampleColumn:
    """Return the values of an expression, one a sample: the very numbers of each sample alone.

    Parameters
    ----------
    expression
        The expression.
    known
        For every name in it a value, or one a sample.
    count
        The number of samples.
    """

    def leaf(item: Fraction | str) -> Number | SampleColumn:
        if isinstance(item, Fraction):
            return item
        return math.pi if item == "pi" else known[item]

    def operate(operation: str, operands: list[Number | SampleColumn]) -> Number | SampleColumn:
        if not any(isinstance(operand, list) for operand in operands):
            return apply(operation, operands)  # type: ignore[arg-type]
        columns = [operand if isinstance(operand, list) else [operand] * count for operand in operands]
        results: SampleColumn = []
        for row in zip(*columns, strict=True):
            try:
                results.append(None if any(value is None for value in row) else apply(operation, list(row)))
            except OutOfRangeError:
                results.append(None)
        return results

    found = expression.fold(leaf, operate)
    return found if isinstance(found, list) else [found] * count
