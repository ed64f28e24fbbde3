"""Derivatives of expressions by the parameters of a scene, exact where the expressions are."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from dynid.arithmetic.expression import Expression, parse, resolve_parameters
from dynid.arithmetic.numbers import Number, apply

_ONE, _TWO = Fraction(1), Fraction(2)


@dataclass(frozen=True)
class Dual:
    """A value with its derivatives by the parameters that it depends on."""

    value: Number
    slopes: Mapping[str, Number]


def independent_parameters(raw: Mapping[str, Any]) -> dict[str, Dual]:
    """Return every parameter with its derivatives by the independent ones, which are plain numbers.

    Parameters
    ----------
    raw
        The parameters as written: numbers, and expressions of each other; free of faults.
    """
    values, _ = resolve_parameters(raw)
    known: dict[str, Dual] = {}
    for name, value in values.items():  # in an order in which each needs only earlier ones
        text = raw[name]
        expression = parse(text) if isinstance(text, str) else None
        if expression is None or not expression.names:
            known[name] = Dual(value, {name: _ONE})
        else:
            known[name] = differentiate(expression, known)
    return known


def differentiate(expression: Expression, known: Mapping[str, Dual]) -> Dual:
    """Evaluate an expression together with its derivatives (forward accumulation).

    Raises
    ------
    ExpressionError
        Where a value or a derivative is not a finite number, as that of sqrt(x) at 0.
    """

    def leaf(item: Fraction | str) -> Dual:
        if isinstance(item, Fraction):
            return Dual(item, {})
        return Dual(math.pi, {}) if item == "pi" else known[item]

    return expression.fold(leaf, operate)


def operate(operation: str, operands: list[Dual]) -> Dual:
    """Return the result of an operation with its derivatives."""
    value = apply(operation, [operand.value for operand in operands])
    slopes: dict[str, Number] = {}
    for operand, rate in zip(operands, _rates(operation, operands, value), strict=True):
        if rate != 0:
            for name, slope in operand.slopes.items():
                slopes[name] = apply("+", [slopes.get(name, Fraction(0)), apply("*", [rate, slope])])
    return Dual(value, slopes)


def _rates(operation: str, operands: list[Dual], value: Number) -> list[Number]:  # noqa: C901 - a table
    """Return the partial derivatives of an operation by its operands."""
    x = [operand.value for operand in operands]
    match operation:
        case "+":
            return [_ONE, _ONE]
        case "-":
            return [_ONE, -_ONE]
        case "*":
            return [x[1], x[0]]
        case "/":
            return [apply("/", [_ONE, x[1]]), -apply("/", [value, x[1]])]
        case "**":
            base, exponent = operands
            by_base: Number = Fraction(0)
            if exponent.value != 0 and base.slopes:
                by_base = exponent.value * apply("**", [base.value, exponent.value - 1])
            by_exponent = value * apply("log", [base.value]) if exponent.slopes else Fraction(0)
            return [by_base, by_exponent]
        case "neg":
            return [-_ONE]
        case "pos":
            return [_ONE]
        case "sqrt":
            return [apply("/", [_ONE, 2 * value])]
        case "exp":
            return [value]
        case "log":
            return [apply("/", [_ONE, x[0]])]
        case "sin":
            return [apply("cos", x)]
        case "cos":
            return [-apply("sin", x)]
        case "tan":
            return [1 + value * value]
        case "abs":
            return [_ONE if x[0] >= 0 else -_ONE]
        case _:  # min and max
            chosen = x.index(value)
            return [_ONE if place == chosen else Fraction(0) for place in range(len(x))]
