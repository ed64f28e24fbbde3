"""Roots of real polynomials inside the unit circle, counted in ball arithmetic (Schur 1918, Cohn 1922)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any


def roots_inside(coefficients: Sequence[Any]) -> int | None:
    """Return the number of roots inside the unit circle; None where the balls do not decide.

    A step p -> (p(0) p* - p(inf) p)/z removes a root inside the circle where |p(inf)| > |p(0)|; else it is
    taken of the reversed polynomial p*, whose roots are the inverses. The count is one of roots strictly
    inside; the others lie strictly outside.

    `coefficients`: balls (flint `arb`), ascending; the last one is not zero.
    """
    polynomial, inside, sign = list(coefficients), 0, 1
    while len(polynomial) > 1:
        degree, low, top = len(polynomial) - 1, polynomial[0], polynomial[-1]
        size = abs(top) - abs(low)
        if size < 0:
            polynomial, low, top = polynomial[::-1], top, low
            inside, sign = inside + sign * degree, -sign
        elif not size > 0:
            return None
        ratio = low / top
        inside += sign
        polynomial = [polynomial[k + 1] - ratio * polynomial[degree - 1 - k] for k in range(degree)]
    return inside
