"""Safe arithmetic: expressions of numbers and names, exact as long as they can be.

Nothing is ever executed. What a text is allowed to say is decided in `grammar`; what numbers do is in
`numbers`; an expression can as well be folded over any other kind of number, such as polynomials.
"""

from __future__ import annotations

import ast
import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any, TypeVar

from dynid.scene.arithmetic.grammar import (
    FUNCTIONS,
    ExpressionError,
    column_of,
    literal_of,
    name_problem,
    operation_of,
    parse_arithmetic,
)
from dynid.scene.arithmetic.numbers import Number, OutOfRangeError, apply, as_number, to_fraction
from dynid.suggestions import did_you_mean

__all__ = [
    "FUNCTIONS",
    "Expression",
    "ExpressionError",
    "Number",
    "OutOfRangeError",
    "parse",
    "resolve_parameters",
    "to_fraction",
]

T = TypeVar("T")


@dataclass(frozen=True)
class Expression:
    """A checked arithmetic expression.

    Parameters
    ----------
    text
        As written.
    steps
        The nodes of its syntax tree in the order of evaluation: numbers, names, arithmetic and calls of
        the known functions, and nothing else.
    """

    text: str
    steps: tuple[ast.expr, ...]

    @cached_property
    def names(self) -> frozenset[str]:
        """The names that need a value."""
        return frozenset(node.id for node in self.steps if isinstance(node, ast.Name)) - {"pi"}

    def fold(self, leaf: Callable[[Fraction | str], T], apply: Callable[[str, list[T]], T]) -> T:
        """Evaluate over any kind of number, without recursion.

        Parameters
        ----------
        leaf
            Gives the value of a literal (a `Fraction`) or of a name (a `str`; `pi` is one).
        apply
            Gives the value of an operation (`+ - * / **`, `neg`, `pos`, or a function's name). What it
            raises as `OutOfRangeError` becomes an `ExpressionError` with the place.
        """
        stack: list[T] = []
        for node in self.steps:
            try:
                if isinstance(node, ast.Constant | ast.Name):
                    stack.append(leaf(node.id if isinstance(node, ast.Name) else literal_of(node)))
                else:
                    operation, count = operation_of(node)
                    operands = stack[len(stack) - count :]
                    del stack[len(stack) - count :]
                    stack.append(apply(operation, operands))
            except OutOfRangeError as error:
                raise ExpressionError(str(error), self.text, column_of(self.text, node)) from None
        return stack[0]

    def evaluate(self, env: Mapping[str, Number]) -> Number:
        """Give the value: a `Fraction` where only exact operations are involved, else a float.

        Raises
        ------
        ExpressionError
            When a name has no value, or the value is not a finite real number of reasonable size.
        """

        def leaf(item: Fraction | str) -> Number:
            if isinstance(item, Fraction):
                return item
            if item == "pi":
                return math.pi
            if item not in env:
                raise OutOfRangeError(f"no parameter '{item}'{did_you_mean(item, env)}")
            return as_number(env[item])

        return self.fold(leaf, apply)


def parse(text: str) -> Expression:
    """Read an arithmetic expression.

    Raises
    ------
    ExpressionError
        When the text is anything but arithmetic on numbers, names, `pi` and the known functions.
    """
    return Expression(text, parse_arithmetic(text))


def resolve_parameters(raw: Mapping[str, Any]) -> tuple[dict[str, Number], dict[str, str]]:
    """Give every parameter its value; they may refer to each other in any order.

    Parameters
    ----------
    raw
        Numbers and expressions by name. Numbers are read as the decimals they are written as.

    Returns
    -------
    tuple
        The values, and a message for every parameter at fault. A parameter that depends on one at
        fault has neither.
    """
    faults: dict[str, str] = {}
    expressions: dict[str, Expression] = {}
    values: dict[str, Number] = {}
    for name, value in raw.items():
        try:
            _read_parameter(name, value, raw, values, expressions)
        except (ExpressionError, OutOfRangeError) as error:
            faults[str(name)] = str(error)
    _evaluate_in_order(expressions, values, faults)
    waiting = {
        name: expressions[name].names for name in expressions if name not in values and name not in faults
    }
    for cycle in _cycles(waiting):
        chain = [*cycle, cycle[0]]
        if len(chain) > 8:  # each message repeats the cycle; in full, they would grow with its square
            chain[4:-3] = [f"({len(chain) - 7} more)"]
        faults |= {name: f"'{name}' is defined by itself: {' -> '.join(chain)}" for name in cycle}
    return values, faults


def _read_parameter(
    name: Any,
    value: Any,
    raw: Mapping[str, Any],
    values: dict[str, Number],
    expressions: dict[str, Expression],
) -> None:
    problem = name_problem(name) if isinstance(name, str) else f"{name} cannot be a name; it is not a word"
    if problem:
        raise OutOfRangeError(problem)
    if not isinstance(value, str):
        if value is None or isinstance(value, list | dict):
            raise OutOfRangeError("a parameter is a number or an expression")
        values[name] = to_fraction(value)
        return
    expression = parse(value)
    for unknown in sorted(used for used in expression.names if used not in raw):
        raise OutOfRangeError(f"no parameter '{unknown}'{did_you_mean(unknown, map(str, raw))}")
    expressions[name] = expression


def _evaluate_in_order(
    expressions: Mapping[str, Expression], values: dict[str, Number], faults: dict[str, str]
) -> None:
    missing = {name: sum(used not in values for used in expressions[name].names) for name in expressions}
    users: dict[str, list[str]] = defaultdict(list)
    for name, expression in expressions.items():
        for used in expression.names:
            users[used].append(name)
    ready = [name for name, count in missing.items() if count == 0]
    while ready:
        name = ready.pop()
        try:
            values[name] = expressions[name].evaluate(values)
        except ExpressionError as error:
            faults[name] = str(error)
            continue
        for user in users[name]:
            missing[user] -= 1
            if missing[user] == 0:
                ready.append(user)


def _cycles(waiting: Mapping[str, Iterable[str]]) -> list[list[str]]:
    """Find definitions that wait for each other, by following from each the first one it waits for."""
    following = {
        name: min((other for other in needs if other in waiting), default="")
        for name, needs in waiting.items()
    }
    cycles: list[list[str]] = []
    walked: set[str] = set()
    for start in sorted(waiting):
        chain: dict[str, None] = {}
        name = start
        while name and name not in walked and name not in chain:
            chain[name] = None
            name = following[name]
        if name in chain:
            names = list(chain)
            cycles.append(names[names.index(name) :])
        walked |= chain.keys()
    return cycles
