"""Enclosures of terms: real balls (Arb) at the working precision, each computed once."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

from flint import arb, ctx, fmpq, fmpz

from dynid.arithmetic.terms import Term, in_order


def root_ball(ball: Any, degree: int) -> Any:
    """Return the root of an enclosure."""
    return ball.sqrt() if degree == 2 else ball.root(degree)


class TermEnclosures:
    """The enclosures of terms, by precision."""

    def __init__(self) -> None:
        self._balls: dict[tuple[int, int], Any] = {}

    def enclosure(self, number: Term | Fraction) -> Any:
        """Return an enclosure of a number at the working precision (flint `arb`)."""
        if isinstance(number, Fraction):
            return arb(fmpq(number.numerator, number.denominator))
        key = ctx.prec
        if (key, id(number)) not in self._balls:
            for term in in_order([number]):
                if (key, id(term)) not in self._balls:
                    self._balls[key, id(term)] = self._ball(term)
        return self._balls[key, id(number)]

    def _ball(self, term: Term) -> Any:
        balls = [
            self._balls[ctx.prec, id(operand)] if isinstance(operand, Term) else self.enclosure(operand)
            for operand in term.operands
        ]
        match term.operation:
            case "pi":
                return arb.pi()
            case "+":
                return balls[0] + balls[1]
            case "-":
                return balls[0] - balls[1]
            case "*":
                return balls[0] * balls[1]
            case "/":
                return balls[0] / balls[1]
            case "neg":
                return -balls[0]
            case "**":
                exponent = term.operands[1]
                if isinstance(exponent, Term):
                    return (balls[1] * balls[0].log()).exp()
                if exponent.denominator == 1:
                    return balls[0] ** fmpz(int(exponent))
                return root_ball(balls[0], exponent.denominator) ** fmpz(exponent.numerator)
        return getattr(balls[0], term.operation)()
