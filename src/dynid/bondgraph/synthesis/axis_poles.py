"""Removal of the poles of an impedance on the imaginary axis, as elements in series."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

from dynid.bondgraph.synthesis.one_port import Element, OnePort, parallel
from dynid.lti.positive_real import axis_factor, ball_fraction, even_odd, fraction, in_square, value_at


def without_axis_poles(
    numerator: Any, denominator: Any, bits: int, factor: Any = None
) -> tuple[list[OnePort], Any, Any]:
    """Return the elements of the poles of Z = N/D on the imaginary axis, and N and D of what is left.

    A pole at infinity is an I, one at 0 a C, a pair ±jω an I and a C in parallel. What is left is exact also
    where ω² is irrational: only the values of those elements are then rounded.

    Parameters
    ----------
    numerator, denominator
        Polynomials in lowest terms (flint `fmpq_poly`) of a positive real function.
    bits
        The precision of irrational values.
    factor
        The polynomial in w = s² of the poles ±jω; absent: found exactly.
    """
    from flint import fmpq_poly

    parts: list[OnePort] = []
    s = fmpq_poly([0, 1])
    if numerator.degree() > denominator.degree():
        inertia = numerator.leading_coefficient() / denominator.leading_coefficient()
        numerator -= inertia * s * denominator
        parts.append(Element("I", fraction(inertia)))
    if denominator[0] == 0:
        rest = denominator // s
        stiffness = numerator[0] / rest[0]
        numerator, denominator = (numerator - stiffness * rest) // s, rest
        parts.append(Element("C", 1 / fraction(stiffness)))
    factor = axis_factor(denominator) if factor is None else factor
    if factor.degree() > 0:
        # N/D = F/G(s²) + remainder/rest, with F = s U(s²) for a positive real function
        poles = in_square(factor)
        rest = denominator // poles
        inverse = rest.xgcd(poles)[1]
        above = (numerator * inverse) % poles
        numerator, denominator = (numerator - above * rest) // poles, rest
        parts += _tanks(even_odd(above)[1], factor, bits)
    return parts, numerator, denominator


def _tanks(numerator: Any, factor: Any, bits: int) -> list[OnePort]:
    """Return the I and C in parallel of every root w of G: U(w)/G'(w) s / (s² - w)."""
    found = []
    for root in real_roots(factor, bits):
        weight = evaluated(numerator, root, bits) / evaluated(factor.derivative(), root, bits)
        found.append(parallel(Element("I", -weight / root), Element("C", 1 / weight)))
    return found


def real_roots(polynomial: Any, bits: int) -> list[Fraction]:
    """Return the real roots of a square-free polynomial in descending order: rational ones exactly."""
    from flint import ctx

    with ctx.workprec(bits):
        balls = [root.real for root, _ in polynomial.numer().complex_roots() if root.imag == 0]
        approximate = [ball_fraction(ball.mid()) for ball in balls]
    roots = []
    for root in approximate:
        simple = root.limit_denominator(1 << bits // 4)
        roots.append(simple if value_at(polynomial, simple) == 0 else root)
    return sorted(roots, reverse=True)


def evaluated(polynomial: Any, point: Fraction, bits: int) -> Fraction:
    """Return the value of a polynomial at a point, rounded to so many bits where it is longer."""
    return rounded(value_at(polynomial, point), bits)


def rounded(number: Fraction, bits: int) -> Fraction:
    """Return a number rounded to so many bits; one that has no more in numerator and denominator as it is."""
    above, below = number.numerator.bit_length(), number.denominator.bit_length()
    if max(above, below) <= bits:
        return number
    shift = bits - above + below
    scaled = number * (1 << shift) if shift >= 0 else number / (1 << -shift)
    return round(scaled) * (Fraction(1, 1 << shift) if shift >= 0 else Fraction(1 << -shift))
