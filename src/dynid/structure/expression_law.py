# ruff: noqa: ARG002, ARG005, D102 - the methods of all laws are those of `Law`, described there
"""The law of a joint as an expression of its deflection d and rate v, with exact derivatives."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from dynid.arithmetic.expression import Expression
from dynid.structure.law import Guard, Law, Slopes, Values

#: Value and derivatives by the operands, from operands and value, of the operations of expressions.
_OPERATIONS: dict[str, tuple[Callable[..., Any], Callable[..., tuple[Any, ...]]]] = {
    "+": (np.add, lambda a, b, y: (1.0, 1.0)),
    "-": (np.subtract, lambda a, b, y: (1.0, -1.0)),
    "*": (np.multiply, lambda a, b, y: (b, a)),
    "/": (np.divide, lambda a, b, y: (1 / b, -y / b)),
    "neg": (np.negative, lambda a, y: (-1.0,)),
    "pos": (np.positive, lambda a, y: (1.0,)),
    "sqrt": (np.sqrt, lambda a, y: (0.5 / y,)),
    "exp": (np.exp, lambda a, y: (y,)),
    "log": (np.log, lambda a, y: (1 / a,)),
    "sin": (np.sin, lambda a, y: (np.cos(a),)),
    "cos": (np.cos, lambda a, y: (-np.sin(a),)),
    "tan": (np.tan, lambda a, y: (1 + y * y,)),
}


class _Dual(NamedTuple):
    """A value, or values at nodes, with derivatives by name."""

    value: Any
    slopes: dict[str, Any]

    @classmethod
    def of(cls, operation: str, operands: Sequence[_Dual]) -> _Dual:
        """Return the result of an operation."""
        x = [operand.value for operand in operands]
        if operation == "**":
            base, exponent = operands
            value = np.power(*x)
            rates: tuple[Any, ...] = (
                x[1] * np.power(x[0], x[1] - 1.0) if base.slopes and np.any(x[1]) else 0.0,
            )
            rates += (value * np.log(x[0]) if exponent.slopes else 0.0,)
        else:
            function, derivatives = _OPERATIONS[operation]
            value = function(*x)
            rates = derivatives(*x, value)
        slopes: dict[str, Any] = {}
        for operand, rate in zip(operands, rates, strict=True):
            for name, slope in operand.slopes.items():
                slopes[name] = slopes.get(name, 0.0) + rate * slope
        return cls(value, slopes)


class ExpressionLaw(Law):
    """An expression of d, v and parameters; where `abs`, `min` or `max` switch, a regime ends."""

    kind = "expression"

    def __init__(self, expression: Expression, names: Sequence[str]) -> None:
        self.expression, self.names = expression, tuple(names)
        self.signed = self.names

    def _fold(self, p: Values, regime: int | None, d: Any, v: Any) -> tuple[_Dual, list[tuple[_Dual, bool]]]:
        """Return value and derivatives, and of each switch the function that is positive on its first branch.

        `regime`: bits of the switches that are on their second branch; None: where they are by themselves.
        """
        switches: list[tuple[_Dual, bool]] = []
        leaves = {"d": d, "v": v, **dict(zip(self.names, p, strict=True))}

        def leaf(item: Any) -> _Dual:
            if not isinstance(item, str):
                return _Dual(float(item), {})
            return _Dual(np.pi, {}) if item == "pi" else _Dual(leaves[item], {item: 1.0})

        def make(operation: str, operands: list[_Dual]) -> _Dual:
            if operation not in ("abs", "min", "max"):
                return _Dual.of(operation, operands)
            chosen = operands[0]
            for other in operands[1:] or [_Dual.of("neg", [chosen])]:
                difference = _Dual.of("-", [chosen, other])
                if operation == "min":
                    difference = _Dual.of("neg", [difference])
                second = bool(difference.value < 0) if regime is None else bool(regime >> len(switches) & 1)
                switches.append((difference, second))
                chosen = other if second else chosen
            return chosen

        with np.errstate(all="raise", under="ignore"):
            return self.expression.fold(leaf, make), switches

    def _slopes(self, dual: _Dual, sign: float = 1.0) -> Slopes:
        d, v, *by_p = (sign * dual.slopes.get(name, 0.0) for name in ("d", "v", *self.names))
        return Slopes(sign * dual.value, d, v, 0.0, by_p)

    def force(self, p: Values, regime: int, d: Any, v: Any, z: Any) -> Slopes:
        return self._slopes(self._fold(p, regime, d, v)[0])

    def regime(self, p: Values, d: float, v: float, z: float) -> int:
        _, switches = self._fold(p, None, d, v)
        return sum(second << index for index, (_, second) in enumerate(switches))

    def guards(self, p: Values, regime: int, d: Any, v: Any, z: Any) -> Sequence[Guard]:
        _, switches = self._fold(p, regime, d, v)
        return [
            Guard(self._slopes(dual, -1.0 if second else 1.0), regime ^ 1 << index)
            for index, (dual, second) in enumerate(switches)
        ]

    def tangent(self, p: Values, regime: int) -> tuple[float, float]:
        at_rest = self.force(p, regime, 0.0, 0.0, 0.0)
        return float(at_rest.d), float(at_rest.v)
