"""Laws: values and slopes of expressions, on floats or on numbers of high precision (flint `arb`).

Reverse accumulation: one pass forwards for the value, one backwards for the derivatives by all variables
(Griewank & Walther 2008, *Evaluating Derivatives*, chapter 3).
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Literal

from dynid.arithmetic.expression import Expression
from dynid.arithmetic.numbers import Irrational, Number, OutOfRangeError, apply
from dynid.bondgraph.graph import BondGraph, Port


class Gradient:
    """An expression as a function of some of its names, with its slopes.

    `high`: whether the numbers are those of flint (`arb`), at the precision of its context; else floats.
    Raises `ExpressionError` if a part that is constant has no value.
    """

    def __init__(
        self,
        expression: Expression,
        constants: Mapping[str, Number],
        variables: Sequence[str],
        high: bool = False,
    ) -> None:
        self._number: Callable[[Any], Any] = _high if high else float
        self._functions = _on_high_precision() if high else _ON_FLOATS
        self._count, self._high = len(variables), high
        places = {name: index for index, name in enumerate(variables)}
        self._given: list[Any] = []  # values of the constant entries behind the variables
        self._steps: list[tuple[int, str, tuple[int, ...]]] = []
        exact: dict[int, Number] = {}  # of the constant entries

        def constant(value: Number) -> int:
            exact[self._count + len(self._given)] = value
            self._given.append(self._number(value))
            return self._count + len(self._given) - 1

        def leaf(item: Fraction | str) -> int:
            if isinstance(item, str) and item in places:
                return places[item]
            if item == "pi":
                slot = constant(math.pi)
                self._given[-1] = self._functions["pi"]()
                return slot
            return constant(constants[item] if isinstance(item, str) else item)

        def operation(name: str, operands: list[int]) -> int:
            exact_operands = [exact[k] for k in operands if k in exact]
            if len(exact_operands) == len(operands):
                slot, value = constant(apply(name, exact_operands)), exact[len(self._given) + self._count - 1]
                if not isinstance(value, Fraction) or isinstance(
                    value, Irrational
                ):  # rounded: take it at the precision of the numbers
                    self._given[-1] = self._functions[name](*(self._given[k - self._count] for k in operands))
                return slot
            self._given.append(None)
            self._steps.append((self._count + len(self._given) - 1, name, tuple(operands)))
            return self._count + len(self._given) - 1

        self._root = expression.fold(leaf, operation)
        self._constant = frozenset(exact)

    def __call__(self, values: Sequence[Any], side: float = 1.0) -> tuple[Any, list[Any]]:
        """Return the value, and its derivative by every variable.

        `side`: sign of the argument of `abs` where it is zero; positive: `min` and `max` take the first one
        of equal arguments, else the last. Slopes that differ between both sides are those of a kink. Raises
        `OutOfRangeError` if the value or a derivative is not a finite number.
        """
        entries = [*(values if self._high else map(float, values)), *self._given]
        try:
            for slot, name, operands in self._steps:
                entries[slot] = self._functions[name](*[entries[k] for k in operands])
            value = _finite(entries[self._root])
        except (ValueError, ZeroDivisionError, OverflowError, TypeError):
            raise OutOfRangeError("the law has no finite value there") from None
        slopes: list[Any] = [self._number(0)] * len(entries)
        slopes[self._root] = self._number(1)
        try:
            for slot, name, operands in reversed(self._steps):
                rate = slopes[slot]
                if rate == 0:
                    continue
                x = [entries[k] for k in operands]
                for which, k in enumerate(operands):
                    if k not in self._constant:
                        slopes[k] = slopes[k] + rate * self._partial(name, which, x, entries[slot], side)
            return value, [_finite(slope) for slope in slopes[: self._count]]
        except (ValueError, ZeroDivisionError, OverflowError, TypeError):
            raise OutOfRangeError("the law has no finite slope there") from None

    def _partial(self, name: str, which: int, x: Sequence[Any], value: Any, side: float) -> Any:  # noqa: C901 - a table
        """Return the derivative of an operation by one of its operands."""
        match name:
            case "+" | "pos":
                return 1
            case "-":
                return 1 - 2 * which
            case "*":
                return x[1 - which]
            case "/":
                return 1 / x[1] if which == 0 else -value / x[1]
            case "**" if which == 0:
                return x[1] * self._functions["**"](x[0], x[1] - 1)
            case "**":
                return value * self._functions["log"](x[0])
            case "neg":
                return -1
            case "sqrt":
                return 1 / (2 * value)
            case "exp":
                return value
            case "log":
                return 1 / x[0]
            case "sin":
                return self._functions["cos"](x[0])
            case "cos":
                return -self._functions["sin"](x[0])
            case "tan":
                return 1 + value * value
            case "abs":
                return (1 if x[0] > 0 else -1) if x[0] != 0 else (1 if side > 0 else -1)
            case _:  # min and max
                equal = [index for index, operand in enumerate(x) if operand is value or operand == value]
                return int(which == (equal[0] if side > 0 else equal[-1]))


def _finite(number: Any) -> Any:
    if not (math.isfinite(number) if isinstance(number, float) else number.is_finite()):
        raise ValueError
    return number


_ON_FLOATS: dict[str, Callable[..., Any]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
    "**": lambda base, exponent: math.pow(base, exponent) if exponent else 1.0,
    "neg": operator.neg,
    "pos": operator.pos,
    "abs": abs,
    "min": min,
    "max": max,
    "pi": lambda: math.pi,
    **{name: getattr(math, name) for name in ("sqrt", "exp", "log", "sin", "cos", "tan")},
}


def _high(value: Number) -> Any:
    from flint import arb, fmpq

    return arb(fmpq(value.numerator, value.denominator) if isinstance(value, Fraction) else value)


def _on_high_precision() -> dict[str, Callable[..., Any]]:
    from flint import arb

    functions = {name: getattr(arb, name) for name in ("sqrt", "exp", "log", "sin", "cos", "tan", "pi")}
    return {**_ON_FLOATS, **functions, "**": operator.pow}


@dataclass(frozen=True)
class Law:
    """The law of a node."""

    #: ``e``: effort of an R or C; ``f``: flow of an R or I; ``value``: the resistance of an R, or the modulus
    #: of a TF or GY. Where the bond leaves the element its effort or flow is minus the law.
    gives: Literal["e", "f", "value"]
    expression: Expression
    constants: Mapping[str, Number]  # values of its parameters
    #: Its variables, by the names that the expression has for them; its own one is that of the node.
    variables: Mapping[str, Port]

    def gradient(self, high: bool = False) -> Gradient:
        """Return the law as a function of its variables, in their order."""
        return Gradient(self.expression, self.constants, list(self.variables), high)

    @property
    def ports(self) -> tuple[Port, ...]:
        """The variables, in their order."""
        return tuple(self.variables.values())


@dataclass(frozen=True)
class LawGraph:
    """A graph, some of whose nodes have laws in place of values."""

    graph: BondGraph  # the graph. The values of nodes with laws have no meaning.
    laws: Mapping[str, Law]  # the laws, by node

    def own(self, name: str) -> Port:
        """Return the variable whose slope is the value of an element with a law."""
        law, kind = self.laws[name], self.graph.nodes[name].type
        if kind in "IC":
            return Port(name, "p" if kind == "I" else "q")
        return Port(name, "e" if law.gives == "f" else "f")
