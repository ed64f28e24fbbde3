"""Irrational numbers with their exact meaning: a double, and the expression that it rounds.

Computing with them is computing with doubles. Where a sum nearly cancels, it is decided exactly whether it
is zero (`dynid.arithmetic.real_field`); a zero is a plain fraction.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from fractions import Fraction
from typing import Any, NoReturn, Self

#: A sum, or a comparison, is decided exactly where this part of its terms or less is left of it: beyond it
#: the rounding errors of some 10^9 operations on doubles cannot reach.
CANCELLATION = 1e-6
#: Characters of a term in a message.
_SHOWN = 60
#: Operations that may be zero although no operand is.
_VANISHING = frozenset({"+", "-", "sin", "cos", "tan", "log"})
_INFIX = {"+": " + ", "-": " - ", "*": "*", "/": "/", "**": "**"}


class Term:
    """An operation on numbers that are kept as written.

    Parameters
    ----------
    operation
        Named as in `numbers.apply`; `pi` has no operands.
    operands
        Fractions and terms.
    """

    __slots__ = ("operands", "operation")

    def __init__(self, operation: str, operands: tuple[Term | Fraction, ...] = ()) -> None:
        self.operation, self.operands = operation, operands

    def __str__(self) -> str:
        text = self._text(_SHOWN)
        return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}…"

    def _text(self, room: int) -> str:
        """Return the term as text, the innermost parts left out."""
        if self.operation == "pi" or room <= 0:
            return "pi" if self.operation == "pi" else "…"
        parts = []
        for operand in self.operands:
            if isinstance(operand, Term):
                part = operand._text((room - 2) // len(self.operands))
                parts.append(f"({part})" if operand.operation in ("+", "-", "neg") else part)
            else:
                decimal = repr(float(operand)).removesuffix(".0")
                parts.append(decimal if Fraction(decimal) == operand else str(operand))
        if self.operation == "neg":
            return f"-{parts[0]}"
        if len(parts) == 2:
            return _INFIX[self.operation].join(parts)
        return f"{self.operation}({parts[0].removeprefix('(').removesuffix(')')})"


def in_order(terms: Iterable[Term]) -> Iterator[Term]:
    """Yield terms and those they are made of, operands first and each once; without recursion."""
    done: set[int] = set()
    stack = [(term, False) for term in terms]
    while stack:
        term, ready = stack.pop()
        if id(term) in done:
            continue
        if ready:
            done.add(id(term))
            yield term
        else:
            stack.append((term, True))
            stack += [(operand, False) for operand in term.operands if isinstance(operand, Term)]


class Irrational(Fraction):
    """A number that is the value of a term.

    As a `Fraction` it is the shortest decimal that prints the double, or what the term was coded as
    (`RealField.coded`); its operations go on with the term.
    """

    __slots__ = ("_coded", "_double", "term")

    _coded: tuple[int, int] | None
    _double: float
    term: Term

    def __new__(cls, term: Term, double: float, coded: Fraction | None = None) -> Self:
        """Return the value of a term, which rounds to a double."""
        self = object.__new__(cls)
        self.term, self._double = term, double
        self._coded = None if coded is None else (coded.numerator, coded.denominator)
        return self

    @property
    def _ratio(self) -> tuple[int, int]:
        if self._coded is None:
            decimal = Fraction(repr(self._double))
            self._coded = decimal.numerator, decimal.denominator
        return self._coded

    @property
    def _numerator(self) -> int:  # type: ignore[override]  # in place of the slot of `Fraction`
        return self._ratio[0]

    @property
    def _denominator(self) -> int:  # type: ignore[override]
        return self._ratio[1]

    def __reduce__(self) -> Any:
        return type(self), (self.term, self._double, None if self._coded is None else Fraction(*self._coded))

    def __copy__(self) -> Self:
        return self

    def __deepcopy__(self, memo: Any) -> Self:
        return self

    def __float__(self) -> float:
        return self._double

    def __hash__(self) -> int:
        return hash(self._double)

    def __bool__(self) -> bool:
        return True

    def __eq__(self, other: object) -> bool:
        return _number(other) and _sign(self, other) == 0

    def __lt__(self, other: Any) -> bool:
        return _sign(self, other) < 0

    def __le__(self, other: Any) -> bool:
        return _sign(self, other) <= 0

    def __gt__(self, other: Any) -> bool:
        return _sign(self, other) > 0

    def __ge__(self, other: Any) -> bool:
        return _sign(self, other) >= 0

    def __add__(self, other: Any) -> Any:
        return _applied("+", self, other)

    def __radd__(self, other: Any) -> Any:
        return _applied("+", other, self)

    def __sub__(self, other: Any) -> Any:
        return _applied("-", self, other)

    def __rsub__(self, other: Any) -> Any:
        return _applied("-", other, self)

    def __mul__(self, other: Any) -> Any:
        return _applied("*", self, other)

    def __rmul__(self, other: Any) -> Any:
        return _applied("*", other, self)

    def __truediv__(self, other: Any) -> Any:
        return _applied("/", self, other)

    def __rtruediv__(self, other: Any) -> Any:
        return _applied("/", other, self)

    def __pow__(self, other: Any, _modulus: None = None) -> Any:
        return _applied("**", self, other)

    def __rpow__(self, other: Any, _modulus: None = None) -> Any:
        return _applied("**", other, self)

    def __neg__(self) -> Any:
        return _applied("neg", self)

    def __pos__(self) -> Self:
        return self

    def __abs__(self) -> Any:
        return -self if self._double < 0 else self


def _number(value: object) -> bool:
    return isinstance(value, int | float | Fraction)


def _applied(operation: str, *operands: Any) -> Any:
    """Return the result of an operator, of which an operand is irrational."""
    from dynid.arithmetic.numbers import apply

    if not all(map(_number, operands)):
        return NotImplemented
    return apply(operation, [Fraction(each) if isinstance(each, int) else each for each in operands])


def pi() -> Irrational:
    """Return pi."""
    return Irrational(_PI, math.pi)


_PI = Term("pi")


def operand_of(value: Fraction) -> Term | Fraction:
    """Return a number as an operand of terms."""
    return value.term if isinstance(value, Irrational) else value


def irrational(operation: str, operands: Iterable[Fraction], double: float) -> Fraction:
    """Return the value of an operation on exact numbers of which a double is known.

    Raises
    ------
    OutOfRangeError
        Where it cannot be decided whether a sum is zero, or whether its value can be rounded.
    """
    given = tuple(operands)
    term = Term(operation, tuple(map(operand_of, given)))
    scale = max(abs(float(each)) for each in given) if operation in ("+", "-") else 1.0
    if operation in _VANISHING and abs(double) <= CANCELLATION * scale:
        return decided(term)
    if operation == "tan" and abs(double) >= 1 / CANCELLATION:
        return decided(term)
    return Irrational(term, double) if double else Fraction(0)


def decided(term: Term) -> Fraction:
    """Return the value of a term: a plain fraction where it is rational, else correctly rounded."""
    from dynid.arithmetic.real_field import RealField

    return RealField([term]).simplified(term)


def _sign(one: Fraction, other: Any) -> int:
    """Return the sign of the difference of two numbers."""
    a, b = float(one), float(other)
    difference = a - b
    close = abs(difference) <= CANCELLATION * max(abs(a), abs(b))
    if close and not isinstance(other, float):
        difference = one - Fraction(other) if isinstance(other, int) else one - other
    return (difference > 0) - (difference < 0)


def undecided(term: Term, digits: int) -> NoReturn:
    """Raise the error for two terms of which it cannot be decided whether they are equal."""
    from dynid.arithmetic.numbers import OutOfRangeError

    pair = " and ".join(f"'{operand}'" for operand in term.operands) or f"'{term}'"
    what = f"{pair} agree to {digits:,} digits" if term.operation == "-" else f"'{term}' is 0 to {digits:,} digits"
    raise OutOfRangeError(f"{what}, and it cannot be decided whether exactly; simplify one of the expressions")
