"""Cauer's forms: ladders from continued fractions of an impedance, in exact rational arithmetic.

Every step removes from Z or, by turns, from Y = 1/Z the pole at infinity, and the constant there where what
is left stays positive real: where the real part is lowest at infinity. For LC, RC and RL impedances this
always ends; for others where they are ladders. The second form expands about 0 in place of infinity: it is
the first form of Z(1/s) (Cauer 1926; Anderson & Vongpanitlerd 1973).
"""

from __future__ import annotations

from typing import Any

from dynid.bondgraph.synthesis.one_port import Element, OnePort, dual, inverted, parallel, series
from dynid.errors import NumericalError
from dynid.lti.positive_real import fraction, negative_frequency, real_part, squared_magnitude


class NoSuchForm(NumericalError):
    """An impedance without a realisation of the requested form."""


def cauer(numerator: Any, denominator: Any) -> OnePort:
    """Return the ladder of the continued fraction of Z = N/D about infinity, exactly.

    Parameters
    ----------
    numerator, denominator
        Polynomials in lowest terms (flint `fmpq_poly`) of a positive real function that is not zero.

    Raises
    ------
    NoSuchForm
        Where the expansion would need a negative element.
    """
    removed: list[list[Element]] = []  # from Z, from Y, from Z, …
    while True:
        parts, numerator = _removed_at_infinity(numerator, denominator)
        if not parts and removed and not removed[-1]:
            raise NoSuchForm("the continued fraction needs a negative element")
        removed.append(parts)
        if numerator == 0:
            break
        numerator, denominator = denominator, numerator
    ladder: list[OnePort] = []
    for place, parts in reversed(list(enumerate(removed))):
        of_admittance = place % 2
        own = [dual(part) if of_admittance else part for part in parts]
        ladder = [(parallel if of_admittance else series)(*own, *ladder)]
    return ladder[0]


def second_cauer(numerator: Any, denominator: Any) -> OnePort:
    """Return the ladder of the continued fraction of Z = N/D about 0, exactly.

    Raises
    ------
    NoSuchForm
        Where the expansion would need a negative element.
    """
    from flint import fmpq_poly

    size = max(numerator.length(), denominator.length())
    above, below = (
        fmpq_poly([*([0] * (size - one.length())), *reversed(one.coeffs())])
        for one in (numerator, denominator)
    )
    return inverted(cauer(above, below))


def _removed_at_infinity(numerator: Any, denominator: Any) -> tuple[list[Element], Any]:
    """Return the elements for the pole and the constant of N/D at infinity, and N of what is left."""
    from flint import fmpq_poly

    parts = []
    if numerator.degree() > denominator.degree():
        pole = numerator.leading_coefficient() / denominator.leading_coefficient()
        numerator -= pole * fmpq_poly([0, 1]) * denominator
        parts.append(Element("I", fraction(pole)))
    if numerator.degree() == denominator.degree():
        constant = numerator.leading_coefficient() / denominator.leading_coefficient()
        part = real_part(numerator, denominator) - constant * squared_magnitude(denominator)
        if negative_frequency(part) is None:
            numerator -= constant * denominator
            parts.append(Element("R", fraction(constant)))
    return parts, numerator
