"""Positive realness of a rational function, decided exactly, with the point that disproves it.

Z(s) with real coefficients is positive real if it has no pole in the open right half-plane, its poles on the
imaginary axis, infinity included, are simple with positive residues, and Re Z(jω) >= 0 at all other ω
(Anderson & Vongpanitlerd, Network Analysis and Synthesis, 1973). With N(s) = Ne(s²) + s No(s²)
and D alike, Re Z(jω) |D|² is a polynomial in w = -ω². Its sign is constant between its roots, which are
isolated in certified discs, and is taken exactly at a rational frequency in every interval.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from decimal import Context, Decimal
from fractions import Fraction
from typing import Any

from dynid.errors import NumericalError

#: First precision, bits, at which the sign of a residue is taken.
_RESIDUE_BITS = 128


class NotPositiveReal(NumericalError):
    """A function that is no driving-point impedance of a passive system."""


@dataclass(frozen=True)
class _Violation:
    """The point at which a rational function fails to be positive real."""

    #: ``real part``, ``pole`` (in the right half-plane, or a multiple one on the imaginary axis) or
    #: ``residue`` (negative, of a pole on the imaginary axis).
    kind: str
    #: The frequency, rad/s: rational where the real part is negative, else the imaginary part of the pole;
    #: infinite for a pole at infinity.
    omega: Fraction | float
    value: complex  # the real part, the pole or the residue there
    sentence: str  # the same in words


def lowest_terms(numerator: Any, denominator: Any) -> tuple[Any, Any]:
    """Return two polynomials (flint `fmpq_poly`) without common factor, the denominator monic, not zero."""
    common = numerator.gcd(denominator)
    above, below = numerator // common, denominator // common
    lead = below.leading_coefficient()
    return above / lead, below / lead


def even_odd(polynomial: Any) -> tuple[Any, Any]:
    """Return Pe and Po of P(s) = Pe(s²) + s Po(s²)."""
    from flint import fmpq_poly

    coefficients = polynomial.coeffs()
    return fmpq_poly(coefficients[::2]), fmpq_poly(coefficients[1::2])


def in_square(polynomial: Any) -> Any:
    """Return P(s²) of P(w)."""
    from flint import fmpq_poly

    return fmpq_poly([c for w in polynomial.coeffs() for c in (w, 0)])


def real_part(numerator: Any, denominator: Any) -> Any:
    """Return Re(N conj D) on s = jω as a polynomial in w = -ω²; over `squared_magnitude` of D it is Re Z."""
    from flint import fmpq_poly

    (n_even, n_odd), (d_even, d_odd) = even_odd(numerator), even_odd(denominator)
    return n_even * d_even - fmpq_poly([0, 1]) * n_odd * d_odd


def squared_magnitude(polynomial: Any) -> Any:
    """Return |P(jω)|² as a polynomial in w = -ω²."""
    return real_part(polynomial, polynomial)


def negative_frequency(polynomial: Any) -> Fraction | None:
    """Return a rational ω > 0 with P(-ω²) < 0, of few decimals; None where there is none.

    It lies in the interval in which P(w) (flint `fmpq_poly`) has the lowest value at the chosen frequency.
    """
    if polynomial == 0:
        return None
    values = []
    edges = [Fraction(0), *(edge for ball in _positive_roots(polynomial) for edge in ball), None]
    for low, high in zip(edges[::2], edges[1::2], strict=True):
        assert low is not None
        omega = _decimal_between(low, high)
        value = value_at(polynomial, -(omega**2))
        if value < 0:
            values.append((value, omega))
    return min(values)[1] if values else None


def value_at(polynomial: Any, point: Fraction) -> Fraction:
    """Return the exact value of a polynomial (flint `fmpq_poly`) at a rational point."""
    from flint import fmpq

    value = polynomial(fmpq(point.numerator, point.denominator))
    return fraction(value)


def axis_factor(denominator: Any) -> Any:
    """Return G(w), whose roots w = -ω² are the squares of the poles on the imaginary axis other than 0.

    Holds for polynomials without roots in the open right half-plane and without a multiple root at 0.
    """
    even, odd = even_odd(denominator)
    return even.gcd(odd)


def find_violation(numerator: Any, denominator: Any) -> _Violation | None:
    """Return a point at which N/D in lowest terms is not positive real; None where it is."""
    if numerator == 0:
        return None
    even_part = real_part(numerator, denominator)
    omega = negative_frequency(even_part)
    if omega is not None:
        size = value_at(squared_magnitude(denominator), -(omega**2))
        value = nearest_double(value_at(even_part, -(omega**2)) / size)
        sentence = f"its real part is {value:.6g} at ω = {_decimal_text(omega)} rad/s"
        return _Violation("real part", omega, value, sentence)
    return _wrong_pole(denominator) or _wrong_residue(numerator, denominator)


def _wrong_pole(denominator: Any) -> _Violation | None:
    """Return a pole in the open right half-plane, or a multiple one on the imaginary axis."""
    from dynid.lti.certified_roots import certified_roots

    for root in certified_roots(denominator.numer()):
        pole = root.value
        if root.side > 0:
            where = f"{pole.real:.6g}" + (f" ± {abs(pole.imag):.6g}j" if pole.imag else "")
            return _Violation(
                "pole", abs(pole.imag), pole, f"its pole at s = {where} lies in the right half-plane"
            )
        if root.side == 0 and root.multiplicity > 1:
            where = f"±{abs(pole.imag):.6g}j" if pole.imag else "0"
            sentence = f"its pole at s = {where} on the imaginary axis has multiplicity {root.multiplicity}"
            return _Violation("pole", abs(pole.imag), pole, sentence)
    return None


def _wrong_residue(numerator: Any, denominator: Any) -> _Violation | None:
    """Return a pole on the axis, 0 and infinity included, whose residue, a real one, is negative."""
    excess = numerator.degree() - denominator.degree()
    lead = nearest_double(fraction(numerator.leading_coefficient() / denominator.leading_coefficient()))
    if excess > 1:
        return _Violation(
            "pole", math.inf, complex(lead), f"it grows as s^{excess}: its pole at infinity is multiple"
        )
    if excess == 1 and lead < 0:
        return _Violation(
            "residue", math.inf, lead, f"it grows as {lead:.6g} s: the residue at infinity is negative"
        )
    if denominator[0] == 0:
        residue = numerator[0] / denominator[1]
        if residue < 0:
            value = nearest_double(fraction(residue))
            return _Violation("residue", 0.0, value, f"the residue of its pole at s = 0 is {value:.6g}")
    factor = axis_factor(denominator)
    if factor.degree() == 0:
        return None
    # With D = G(s²) Q(s), at s² = w0: residue = N / (2 s G'(w0) Q) = N (-s) Q(-s) / (2 G'(w0) |s Q|²)
    from flint import acb_poly, ctx, fmpq_poly

    rest = fmpq_poly([0, 1]) * (denominator // in_square(factor))
    above, below = real_part(numerator, rest), 2 * factor.derivative() * squared_magnitude(rest)
    precision = _RESIDUE_BITS
    while True:
        with ctx.workprec(precision):
            roots = [root for root, _ in factor.numer().complex_roots()]
            residues = [acb_poly(above)(root).real / acb_poly(below)(root).real for root in roots]
        if all(residue > 0 or residue < 0 for residue in residues):
            break
        precision *= 2
    for root, residue in zip(roots, residues, strict=True):
        if residue < 0:
            omega, value = float((-root.real).sqrt()), float(residue)
            return _Violation(
                "residue", omega, value, f"the residue of its poles at s = ±{omega:.6g}j is {value:.6g}"
            )
    return None


def _positive_roots(polynomial: Any) -> list[tuple[Fraction, Fraction]]:
    """Return disjoint intervals around x of the roots w = -x < 0 of a polynomial, in ascending order of x."""
    from flint import fmpq_poly

    from dynid.lti.enclosures import enclosures

    simple = polynomial // polynomial.gcd(polynomial.derivative())
    if simple[0] == 0:
        simple //= fmpq_poly([0, 1])
    if simple.degree() < 1:
        return []
    real = [
        -ball.real for ball in enclosures(simple.numer(), sides=False) if ball.imag == 0 and ball.real < 0
    ]
    return sorted((ball_fraction(ball.lower()), ball_fraction(ball.upper())) for ball in real)


def fraction(number: Any) -> Fraction:
    """Return an integer or a rational number of flint as a fraction."""
    return Fraction(int(number.p), int(number.q)) if hasattr(number, "q") else Fraction(int(number))


def ball_fraction(number: Any) -> Fraction:
    """Return an exact ball (flint `arb`), such as the middle of one, as a fraction."""
    return fraction(number.fmpq())


def nearest_double(value: Fraction) -> float:
    """Return the nearest double of a rational number, infinite beyond their range."""
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf


def _decimal_between(low: Fraction, high: Fraction | None) -> Fraction:
    """Return a decimal ω of few digits with low < ω² < high (None: infinity)."""
    middle = (low + high) / 2 if high is not None else 2 * low or Fraction(1)
    digits = 1
    while True:
        context = Context(prec=digits + 5)
        root = context.sqrt(context.divide(Decimal(middle.numerator), Decimal(middle.denominator)))
        omega = Fraction(Context(prec=digits).plus(root))
        if low < omega**2 and (high is None or omega**2 < high):
            return omega
        digits += 1


def _decimal_text(omega: Fraction) -> str:
    """Return a decimal fraction with all of its digits."""
    digits = len(str(omega.numerator)) + 5
    return str(Context(prec=digits).divide(Decimal(omega.numerator), Decimal(omega.denominator)))
