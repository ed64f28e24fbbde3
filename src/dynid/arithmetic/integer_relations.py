"""Rational relations between real numbers, by reduction of a lattice.

References
----------
A. K. Lenstra, H. W. Lenstra, L. Lovász, "Factoring polynomials with rational coefficients", Math. Ann. 261
(1982) 515-534.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Any

from flint import ctx, fmpz, fmpz_mat

#: Precision in which relations are sought, bits a term and in all.
_RELATION_BITS, _BASE_BITS = 40, 240


def integer_relation(
    real: Callable[[], Any], basis: Sequence[Callable[[], Any]], largest: int = 0
) -> list[Fraction] | None:
    """Return the rational coefficients by which a number seems to be a sum of others; None where it is none.

    They are known as enclosures at the working precision; `largest` limits numerators and denominators (0:
    not).
    """
    if not basis:
        return None
    precision = _BASE_BITS + _RELATION_BITS * (len(basis) + 1)
    with ctx.workprec(2 * precision):
        balls = [real(), *(value() for value in basis)]
    entries = []
    for ball in balls:
        with ctx.workprec(4 * precision):
            entry = (ball * (fmpz(1) << precision)).mid().floor().unique_fmpz()
        if entry is None:
            return None
        entries.append(entry)
    rest = list(range(len(balls)))
    while rest:  # what others are sums of is left out
        rows = [[*(int(j == k) for j in rest), entries[k]] for k in rest]
        short = [int(value) for value in fmpz_mat(rows).lll().tolist()[0]]
        if max(map(abs, short)).bit_length() > _RELATION_BITS:
            return None
        if short[0]:
            break
        rest.pop(max(j for j, value in enumerate(short[:-1]) if value))
    relation = dict(zip(rest, (Fraction(-value, short[0]) for value in short[:-1]), strict=True))
    multiples = [relation.get(k, Fraction(0)) for k in range(1, len(balls))]
    if largest and any(max(abs(f.numerator), f.denominator) > largest for f in multiples):
        return None
    return multiples
