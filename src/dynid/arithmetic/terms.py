"""Terms: numbers that are kept as the operations that they are the value of, and their enclosures."""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterable, Iterator
from fractions import Fraction
from typing import Any

#: Characters of a term in a message.
_MAX_TERM_CHARACTERS = 60
_INFIX = {"+": " + ", "-": " - ", "*": "*", "/": "/", "**": "**"}
RATIONAL: dict[str, Callable[..., Any]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
    "neg": operator.neg,
}
"""Operations that are the same on numbers of any kind."""


class OutOfRangeError(ArithmeticError):
    """An operation has no finite real value of reasonable size; the message is one sentence."""


class Term:
    """An operation on fractions and terms, named as in `numbers.apply`; `pi` has no operands."""

    __slots__ = ("operands", "operation")

    def __init__(self, operation: str, operands: tuple[Term | Fraction, ...] = ()) -> None:
        self.operation, self.operands = operation, operands

    def __str__(self) -> str:
        text = self._text(_MAX_TERM_CHARACTERS)
        return text if len(text) <= _MAX_TERM_CHARACTERS else f"{text[:_MAX_TERM_CHARACTERS]}…"

    def _text(self, room: int) -> str:
        """Return the term as text, the innermost parts left out."""
        if self.operation == "pi" or room <= 0:
            return "pi" if self.operation == "pi" else "…"
        parts = []
        for operand in self.operands:
            if isinstance(operand, Term):
                text = operand._text((room - 2) // len(self.operands))
                parts.append(f"({text})" if operand.operation in ("+", "-", "neg") else text)
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


class Enclosures:
    """Enclosures of terms, by precision: real balls (flint `arb`), each computed once."""

    def __init__(self) -> None:
        self._balls: dict[tuple[int, int], Any] = {}

    def __call__(self, number: Term | Fraction) -> Any:
        """Return an enclosure of a number at the working precision."""
        from flint import arb, ctx, fmpq

        if isinstance(number, Fraction):
            return arb(fmpq(number.numerator, number.denominator))
        key = ctx.prec
        if (key, id(number)) not in self._balls:
            for term in in_order([number]):
                if (key, id(term)) not in self._balls:
                    self._balls[key, id(term)] = self._ball(term)
        return self._balls[key, id(number)]

    def _ball(self, term: Term) -> Any:
        from flint import arb, fmpz

        balls = [self(operand) for operand in term.operands]
        if term.operation == "pi":
            return arb.pi()
        if term.operation in RATIONAL:
            return RATIONAL[term.operation](*balls)
        if term.operation != "**":
            return getattr(balls[0], term.operation)()
        exponent = term.operands[1]
        if isinstance(exponent, Term):
            return (balls[1] * balls[0].log()).exp()
        return root_ball(balls[0], exponent.denominator) ** fmpz(exponent.numerator)


def root_ball(ball: Any, degree: int) -> Any:
    """Return the root of an enclosure."""
    return ball if degree == 1 else ball.sqrt() if degree == 2 else ball.root(degree)
