"""Numbers that depend on unknown parameters: arithmetic that is recorded, and evaluated with derivatives.

A builder of matrices or equations computes with such numbers as with floats; what it returns can then be
evaluated at any values of the parameters, with exact derivatives (forward accumulation). Derivatives of
expressions by the parameters of a scene are exact where the expressions are.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any, NamedTuple, TypeAlias, TypeVar, cast

from dynid.arithmetic.expression import Expression, parse, resolve_parameters
from dynid.arithmetic.numbers import Number, apply

_ONE, _TWO = Fraction(1), Fraction(2)


@dataclass(frozen=True)
class Dual:
    """A value with its derivatives by the parameters that it depends on."""

    value: Number
    slopes: Mapping[str, Number]


def independent_parameters(raw: Mapping[str, Any]) -> dict[str, Dual]:
    """Return every parameter, as written, with its derivatives by the independent ones, plain numbers."""
    values, _ = resolve_parameters(raw)
    duals: dict[str, Dual] = {}
    for name, value in values.items():  # in an order in which each needs only earlier ones
        text = raw[name]
        expression = parse(text) if isinstance(text, str) else None
        if expression is None or not expression.names:
            duals[name] = Dual(value, {name: _ONE})
        else:
            duals[name] = differentiate(expression, duals)
    return duals


def differentiate(expression: Expression, duals: Mapping[str, Dual]) -> Dual:
    """Evaluate an expression together with its derivatives (forward accumulation), all of them finite."""

    def leaf(item: Fraction | str) -> Dual:
        if isinstance(item, Fraction):
            return Dual(item, {})
        return Dual(math.pi, {}) if item == "pi" else duals[item]

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
            return [_ONE if index == chosen else Fraction(0) for index in range(len(x))]


T = TypeVar("T")


class _Evaluated(NamedTuple):
    """A value, and its derivatives by the parameters, by name, those that vanish left out."""

    value: float
    slopes: Mapping[str, float]


_Operator: TypeAlias = Callable[[Any, Any], Any]


def _operators(operation: str) -> tuple[_Operator, _Operator]:
    """Return an operator of dependent numbers, and the same with a dependent number on its right."""
    return lambda a, b: compute(operation, (a, b)), lambda b, a: compute(operation, (a, b))


class Dependent:
    """A number that depends on unknown parameters.

    Its operation is named as in `numbers.apply`, empty of a parameter, whose only operand is its name; of
    other operands one at least depends on parameters. `float` returns its `reference` value.
    """

    __slots__ = ("__dict__", "operands", "operation", "reference")
    __array_ufunc__ = None  # numbers of NumPy leave the arithmetic to this class

    def __init__(self, operation: str, operands: tuple[Any, ...], reference: Number) -> None:
        self.operation, self.operands, self.reference = operation, operands, reference

    @classmethod
    def parameter(cls, name: str, reference: Number) -> Dependent:
        """Return the number that a parameter is."""
        return cls("", (name,), reference)

    @cached_property
    def _order(self) -> list[Dependent]:
        """The dependent numbers that it is computed from, operands before results, itself last."""
        return _ordered(self, ())

    @cached_property
    def names(self) -> frozenset[str]:
        """The names of the parameters that it depends on."""
        return frozenset(node.operands[0] for node in self._order if not node.operation)

    @property
    def references(self) -> dict[str, Number]:
        """The reference values of the parameters that it depends on, by name."""
        return {node.operands[0]: node.reference for node in self._order if not node.operation}

    @property
    def is_multiple(self) -> bool:
        """True if it is a parameter, or a constant multiple of one."""
        if self.operation == "*":
            a, b = self.operands
            product, factor = (a, b) if isinstance(a, Dependent) else (b, a)
            return not isinstance(factor, Dependent) and product.is_multiple
        if self.operation == "/":
            a, b = self.operands
            return not isinstance(b, Dependent) and a.is_multiple
        return not self.operation

    def fold(self, leaf: Callable[[Real], T], make: Callable[[Dependent, list[T]], T]) -> T:
        """Evaluate it in any arithmetic: `leaf` gives numbers and parameters a value, `make` operations."""
        values: dict[int, T] = {}
        for node in self._order:
            if node.operation:
                operands = [
                    values[id(operand)] if isinstance(operand, Dependent) else leaf(operand)
                    for operand in node.operands
                ]
                values[id(node)] = make(node, operands)
            else:
                values[id(node)] = leaf(node)
        return values[id(self)]

    def dual(self, values: Mapping[str, Number]) -> Dual:
        """Return value and derivatives at values of the parameters, exact where these and it are.

        Absent parameters have their reference values. `OutOfRangeError` if value or derivative is not finite.
        """

        def leaf(item: Real) -> Dual:
            if not isinstance(item, Dependent):
                return Dual(item, {})
            name = item.operands[0]
            return Dual(values.get(name, item.reference), {name: Fraction(1)})

        return self.fold(leaf, lambda node, operands: operate(node.operation, operands))

    def at(self, values: Mapping[str, float]) -> _Evaluated:
        """Return value and derivatives at values of the parameters, as floats; raises as `dual`."""
        dual = self.dual(values)
        slopes = {name: float(rate) for name, rate in dual.slopes.items()}
        return _Evaluated(float(dual.value), slopes)

    def referred(self, values: Mapping[str, Number]) -> Dependent:
        """Return the same number with other reference values of parameters, by name; raises as `dual`."""

        def leaf(item: Real) -> Real:
            if not isinstance(item, Dependent):
                return item
            name = item.operands[0]
            return Dependent.parameter(name, values.get(name, item.reference))

        return cast("Dependent", self.fold(leaf, lambda node, operands: compute(node.operation, operands)))

    def __float__(self) -> float:
        return float(self.reference)

    def __repr__(self) -> str:
        return f"Dependent({float(self):g}; {', '.join(sorted(self.names))})"

    __add__, __radd__ = _operators("+")
    __sub__, __rsub__ = _operators("-")
    __mul__, __rmul__ = _operators("*")
    __truediv__, __rtruediv__ = _operators("/")
    __pow__, _ = _operators("**")

    def __neg__(self) -> Any:
        return compute("neg", (self,))


Real: TypeAlias = float | Fraction | Dependent
"""A number, or one that depends on unknown parameters."""


def compute(operation: str, operands: Iterable[Real]) -> Any:
    """Return the result of an operation: a number, or a dependent number where an operand is one."""
    arguments = tuple(operands)
    numbers = [argument.reference if isinstance(argument, Dependent) else argument for argument in arguments]
    value = apply(
        operation,
        [argument if isinstance(argument, float | Fraction) else Fraction(argument) for argument in numbers],
    )
    if any(isinstance(argument, Dependent) for argument in arguments):
        return Dependent(operation, arguments, value)
    return value


def sqrt(value: Real) -> Any:
    """Return the square root of a number."""
    return compute("sqrt", (value,)) if isinstance(value, Dependent) else math.sqrt(value)


def _ordered(number: Dependent, done: Container[int]) -> list[Dependent]:
    """Return the dependent numbers that one is computed from, itself last; those `done` by id left out."""
    order: list[Dependent] = []
    seen: set[int] = set()
    stack: list[tuple[Dependent, bool]] = [(number, False)]
    while stack:
        node, entered = stack.pop()
        if entered:
            order.append(node)
        elif id(node) not in seen and id(node) not in done:
            seen.add(id(node))
            stack.append((node, True))
            stack += [(operand, False) for operand in node.operands if isinstance(operand, Dependent)]
    return order


class _Multiple(NamedTuple):
    """A dependent number as a number times another: ``factor * core``."""

    factor: float
    core: Dependent


def like_terms(numbers: Sequence[Dependent]) -> list[_Multiple]:
    """Return numbers as multiples; those that are multiples of the same expression have the same core.

    Factors are drawn out of products, quotients, negatives and powers with a numerical exponent; an
    expression is the same if it is built alike from the same parameters and numbers.
    """
    split: dict[int, _Multiple] = {}
    places: dict[tuple[Any, ...], int] = {}
    at: dict[int, int] = {}  # by the ids of numbers, as `split` and `common`, which keeps them
    cores: dict[int, Dependent] = {}
    common: dict[int, Dependent] = {}
    terms = []
    for number in numbers:
        for node in _ordered(number, split):
            split[id(node)] = _multiple(node, split)
        factor, core = split[id(number)]
        if id(core) not in common:
            common[id(core)] = cores.setdefault(_place(core, places, at), core)
        terms.append(_Multiple(factor, common[id(core)]))
    return terms


def _multiple(node: Dependent, split: Mapping[int, _Multiple]) -> _Multiple:
    """Return a number as a multiple, its operands split already."""
    irreducible = _Multiple(1.0, node)
    if node.operation not in ("*", "/", "neg", "**"):
        return irreducible
    try:
        parts = [
            split[id(operand)] if isinstance(operand, Dependent) else (float(operand), None)
            for operand in node.operands
        ]
        (factor, core), (by, second) = parts[0], parts[-1]
        if node.operation == "neg":
            factor = -factor
        elif node.operation == "**":
            if core is None or second is not None:
                return irreducible
            factor, core = float(compute("**", (factor, by))), core if by == 1 else core ** node.operands[1]
        elif node.operation == "*":
            factor *= by
            core = (core or second) if core is None or second is None else core * second
        else:
            factor /= by
            core = core if second is None else (1 if core is None else core) / second
    except ArithmeticError:
        return irreducible
    return _Multiple(factor, core) if core is not None and math.isfinite(factor) and factor else irreducible


def _place(number: Dependent, places: dict[tuple[Any, ...], int], at: dict[int, int]) -> int:
    """Return the place of an expression among those that are built differently; `at` holds those known."""
    for node in _ordered(number, at):
        operands = tuple(
            ("of", at[id(operand)]) if isinstance(operand, Dependent) else ("is", operand)
            for operand in node.operands
        )
        at[id(node)] = places.setdefault((node.operation, *operands), len(places))
    return at[id(number)]


def evaluated(value: Real, values: Mapping[str, float]) -> _Evaluated:
    """Return any number with its derivatives at values of the parameters."""
    return value.at(values) if isinstance(value, Dependent) else _Evaluated(float(value), {})


def substituted(expression: Expression, values: Mapping[str, Real]) -> Any:
    """Return an expression in which names have these values: a number, or a dependent one."""

    def leaf(item: Fraction | str) -> Real:
        if isinstance(item, Fraction):
            return item
        return math.pi if item == "pi" else values[item]

    make: Callable[[str, list[Any]], Any] = compute
    return expression.fold(leaf, make)
