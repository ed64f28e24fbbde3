"""Brune's synthesis of any positive real function (Brune 1931; Anderson & Vongpanitlerd 1973).

Poles of Z and of Y = 1/Z on the imaginary axis are removed; then the lowest real part, as a resistance or,
where that leads to a zero at 0 or infinity, as a conductance. What is left may be a minimum function:
Re Z(jω1) = 0 with 0 < ω1 < infinity. With L1 = Im Z(jω1)/ω1, the impedance Z - s L1 has zeros ±jω1; removing
these from its inverse, a branch of L2 and C with ω1² = 1/(L2 C), leaves s L3 + Z2 with Z2 positive real and
of two degrees less. 1/L1 + 1/L2 + 1/L3 = 0, so that L1, L2 and L3, one of which is negative, are two
perfectly coupled coils.

All is exact as long as ω1² is rational. Irrational values are rounded to `bits` bits, and coefficients that
are zero by construction are left out.
"""

from __future__ import annotations

from fractions import Fraction
from typing import Any, NamedTuple

from dynid.bondgraph.synthesis.foster import (
    evaluated,
    real_roots,
    rounded,
    without_axis_poles,
)
from dynid.bondgraph.synthesis.one_port import BruneSection, Element, OnePort, dual, parallel, series
from dynid.lti.positive_real import (
    axis_factor,
    ball_fraction,
    even_odd,
    fraction,
    real_part,
    squared_magnitude,
    value_at,
)


class _Lowest(NamedTuple):
    """The lowest real part on the imaginary axis, and w = -ω² where it is neither at 0 nor at infinity."""

    value: Fraction
    square: Fraction | None


def brune(numerator: Any, denominator: Any, bits: int, *, exact: bool = True) -> OnePort:
    """Return Brune's realisation of Z = N/D.

    Parameters
    ----------
    numerator, denominator
        Polynomials in lowest terms (flint `fmpq_poly`) of a positive real function that is not zero.
    bits
        The precision of irrational values.
    exact
        False of coefficients that were rounded: zeros and poles within 2^(-bits/4) of the axis are on it.
    """
    if numerator.degree() == denominator.degree() == 0:
        return Element("R", fraction(numerator[0] / denominator[0]))
    own, above, below = without_axis_poles(numerator, denominator, bits, _axis(denominator, bits, exact))
    if own:
        return series(*own, *([brune(above, below, bits, exact=exact)] if above else []))
    own, below, above = without_axis_poles(denominator, numerator, bits, _axis(numerator, bits, exact))
    if own:
        own = list(map(dual, own))
        return parallel(*own, *([brune(above, below, bits, exact=exact)] if below else []))
    lowest, of_admittance = _lowest(numerator, denominator, bits), _lowest(denominator, numerator, bits)
    if lowest.square is None:
        rest = brune(numerator - _rational(lowest.value) * denominator, denominator, bits, exact=exact)
        return series(Element("R", lowest.value), rest)
    if of_admittance.square is None:
        rest = brune(numerator, denominator - _rational(of_admittance.value) * numerator, bits, exact=exact)
        return parallel(Element("R", 1 / of_admittance.value), rest)
    return _minimum(numerator, denominator, lowest, bits, exact=exact)


def _minimum(numerator: Any, denominator: Any, lowest: _Lowest, bits: int, *, exact: bool) -> OnePort:
    """Return a resistance and Brune's section, of a function whose real part is lowest at w = -ω1²."""
    from flint import fmpq_poly

    value, square = lowest
    assert square is not None
    exact = exact and max(square.numerator.bit_length(), square.denominator.bit_length()) < bits // 2
    own = []
    if abs(value) * (1 << bits // 2) > fraction(numerator[0] / denominator[0]) or (exact and value):
        own.append(Element("R", value))
        numerator -= _rational(value) * denominator
    s, pair = fmpq_poly([0, 1]), fmpq_poly([_rational(-square), 0, 1])
    first = _reactance(numerator, denominator, square, bits)
    above = (numerator - _rational(first) * s * denominator) // pair
    weight = _reactance(denominator, above, square, bits)  # of the branch: weight s / (s² + ω1²)
    below = (denominator - _rational(weight) * s * above) // pair
    second = 1 / weight
    third = fraction(above.leading_coefficient() / below.leading_coefficient())
    above -= _rational(third) * s * below
    if not exact:
        above, below = (
            fmpq_poly([_rational(rounded(fraction(c), bits)) for c in p.coeffs()]) for p in (above, below)
        )
    load = brune(above, below, bits, exact=exact)
    section = BruneSection(first + second, weight / -square, 1 + first / second, load)
    return series(*own, section)


def _reactance(numerator: Any, denominator: Any, square: Fraction, bits: int) -> Fraction:
    """Return Im(N/D)/ω at w = -ω²."""
    (n_even, n_odd), (d_even, d_odd) = even_odd(numerator), even_odd(denominator)
    above = evaluated(n_odd * d_even - n_even * d_odd, square, bits)
    return rounded(above / evaluated(squared_magnitude(denominator), square, bits), bits)


def _lowest(numerator: Any, denominator: Any, bits: int) -> _Lowest:
    """Return the lowest real part of a function without poles on the axis; on a tie that at 0 or infinity."""
    part, size = real_part(numerator, denominator), squared_magnitude(denominator)
    at_infinity = fraction(part[size.degree()] / size.leading_coefficient())
    found = _Lowest(min(fraction(part[0] / size[0]), at_infinity), None)
    critical = part.derivative() * size - part * size.derivative()
    if critical.degree() < 1:
        return found
    critical //= critical.gcd(critical.derivative())
    tie = Fraction(1, 1 << bits // 2)
    for square in real_roots(critical, bits):
        if square < 0:
            value = rounded(value_at(part, square) / value_at(size, square), bits)
            if value < found.value * (1 - tie):
                found = _Lowest(value, square)
    return found


def _axis(polynomial: Any, bits: int, exact: bool) -> Any:
    """Return the polynomial in w = s² of the roots ±jω of a polynomial."""
    from flint import ctx, fmpq_poly

    if exact:
        return axis_factor(polynomial)
    factor = fmpq_poly([1])
    with ctx.workprec(bits):
        for root, _ in polynomial.numer().complex_roots():
            if root.imag > 0 and abs(root.real) * 2 ** (bits // 4) < root.imag:
                omega = ball_fraction(root.imag.mid())
                factor *= fmpq_poly([_rational(omega**2), 1])
    return factor


def _rational(number: Fraction) -> Any:
    from flint import fmpq

    return fmpq(number.numerator, number.denominator)
