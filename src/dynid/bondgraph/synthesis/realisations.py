"""Realisations of an impedance in Cauer's, Foster's and Brune's forms.

Cauer's forms: ladders from continued fractions of an impedance, in exact rational arithmetic.

Every step removes from Z or, by turns, from Y = 1/Z the pole at infinity, and the constant there where what
is left stays positive real: where the real part is lowest at infinity. For LC, RC and RL impedances this
always ends; for others where they are ladders. The second form expands about 0 in place of infinity: it is
the first form of Z(1/s) (Cauer 1926; Anderson & Vongpanitlerd 1973).

Foster's forms: partial fractions of an impedance, with poles on the imaginary and the negative real axis.

A pole -σ of residue k > 0 is k/(s + σ), an R and a C in parallel. One of residue -k < 0 is, with k/σ taken
from the constant, (k/σ) s/(s + σ): an R and an I in parallel. So LC, RC and RL impedances have this form, and
sums of them. The second form is that of the admittance, with series branches in parallel.

Brune's synthesis of any positive real function (Brune 1931; Anderson & Vongpanitlerd 1973).

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

from dynid.bondgraph.synthesis.one_port import (
    BruneSection,
    Element,
    OnePort,
    dual,
    inverted,
    parallel,
    series,
)
from dynid.errors import NumericalError
from dynid.lti.positive_real import (
    axis_factor,
    ball_fraction,
    even_odd,
    fraction,
    in_square,
    negative_frequency,
    real_part,
    squared_magnitude,
    value_at,
)
from dynid.number_format import root_text
from dynid.progress import report_progress


class NoSuchForm(NumericalError):
    """An impedance without a realisation of the requested form."""


def cauer(numerator: Any, denominator: Any) -> OnePort:
    """Return the ladder of the continued fraction of Z = N/D about infinity, exactly.

    `numerator` and `denominator`: polynomials in lowest terms (flint `fmpq_poly`) of a positive real function
    that is not zero. Raises `NoSuchForm` where the expansion would need a negative element.
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
    for index, parts in reversed(list(enumerate(removed))):
        of_admittance = index % 2
        elements = [dual(element) if of_admittance else element for element in parts]
        ladder = [(parallel if of_admittance else series)(*elements, *ladder)]
    return ladder[0]


def second_cauer(numerator: Any, denominator: Any) -> OnePort:
    """Return the ladder of the continued fraction of Z = N/D about 0, exactly.

    Raises `NoSuchForm` where the expansion would need a negative element.
    """
    from flint import fmpq_poly

    size = max(numerator.length(), denominator.length())
    above, below = (
        fmpq_poly([*([0] * (size - polynomial.length())), *reversed(polynomial.coeffs())])
        for polynomial in (numerator, denominator)
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
        remainder = real_part(numerator, denominator) - constant * squared_magnitude(denominator)
        if negative_frequency(remainder) is None:
            numerator -= constant * denominator
            parts.append(Element("R", fraction(constant)))
    return parts, numerator


def _without_axis_poles(
    numerator: Any, denominator: Any, bits: int, factor: Any = None
) -> tuple[list[OnePort], Any, Any]:
    """Return the elements of the poles of Z = N/D on the imaginary axis, and N and D of what is left.

    A pole at infinity is an I, one at 0 a C, a pair ±jω an I and a C in parallel. What is left is exact also
    where ω² is irrational: only the values of those elements are then rounded.
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
    tanks = []
    for root in _real_roots(factor, bits):
        weight = evaluated(numerator, root, bits) / evaluated(factor.derivative(), root, bits)
        tanks.append(parallel(Element("I", -weight / root), Element("C", 1 / weight)))
    return tanks


def _real_roots(polynomial: Any, bits: int) -> list[Fraction]:
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


def foster(numerator: Any, denominator: Any, bits: int, name: str = "Z") -> OnePort:
    """Return the partial fractions of Z = N/D as one-ports in series.

    `numerator` and `denominator`: polynomials in lowest terms (flint `fmpq_poly`) of a positive real function
    that is not zero. `bits`: the precision of irrational values; rational ones are exact. Raises `NoSuchForm`
    where a pole off the imaginary axis is complex or multiple, or the constant would be negative.
    """
    parts, above, below = _without_axis_poles(numerator, denominator, bits)
    _refuse_poles(below, name)
    quotient, rest = divmod(above, below)
    constant, is_exact = fraction(quotient[0]), True
    slope = below.derivative()
    sections: list[OnePort] = []
    for pole in _real_roots(below, bits):
        residue, sigma = evaluated(rest, pole, bits) / evaluated(slope, pole, bits), -pole
        if residue > 0:
            sections.append(parallel(Element("R", residue / sigma), Element("C", 1 / residue)))
        else:
            constant += residue / sigma
            sections.append(parallel(Element("R", -residue / sigma), Element("I", -residue / sigma**2)))
            is_exact = is_exact and sigma.denominator.bit_length() < bits // 2
    if not is_exact and abs(constant) < Fraction(1, 1 << bits // 2) * (abs(fraction(quotient[0])) + 1):
        constant = Fraction(0)
    if constant < 0:
        raise NoSuchForm(f"the partial fractions of {name} have the negative constant {float(constant):.6g}")
    if constant:
        sections.insert(0, Element("R", constant))
    return series(*parts, *sections)


def second_foster(numerator: Any, denominator: Any, bits: int) -> OnePort:
    """Return the partial fractions of Y = D/N as one-ports in parallel; parameters and errors of `foster`."""
    return dual(foster(denominator, numerator, bits, "Y"))


def _refuse_poles(denominator: Any, name: str) -> None:
    """Raise where a polynomial has complex or multiple roots."""
    from dynid.lti.certified_roots import certified_roots

    for root in certified_roots(denominator.numer()):
        if root.value.imag:
            pair = root_text(complex(root.value.real, abs(root.value.imag)))
            raise NoSuchForm(f"the poles {pair} of {name} are neither real nor on the imaginary axis")
        if root.multiplicity > 1:
            pole = f"the pole {root_text(root.value)} of {name}"
            raise NoSuchForm(f"{pole} has multiplicity {root.multiplicity}")


class _Lowest(NamedTuple):
    """The lowest real part on the imaginary axis, and w = -ω² where it is neither at 0 nor at infinity."""

    value: Fraction
    square: Fraction | None


def brune(numerator: Any, denominator: Any, bits: int, *, exact: bool = True) -> OnePort:
    """Return Brune's realisation of Z = N/D.

    `numerator` and `denominator`: polynomials in lowest terms (flint `fmpq_poly`) of a positive real function
    that is not zero. `bits`: the precision of irrational values. `exact`: False of coefficients that were
    rounded: zeros and poles within 2^(-bits/4) of the axis are on it.
    """
    if numerator.degree() == denominator.degree() == 0:
        return Element("R", fraction(numerator[0] / denominator[0]))
    report_progress(f"Brune's form, degree {max(numerator.degree(), denominator.degree())} left")
    axis = _axis(denominator, bits, exact)
    branches, above, below = _without_axis_poles(numerator, denominator, bits, axis)
    if branches:
        return series(*branches, *([brune(above, below, bits, exact=exact)] if above else []))
    branches, below, above = _without_axis_poles(denominator, numerator, bits, _axis(numerator, bits, exact))
    if branches:
        branches = list(map(dual, branches))
        return parallel(*branches, *([brune(above, below, bits, exact=exact)] if below else []))
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
    branches = []
    if abs(value) * (1 << bits // 2) > fraction(numerator[0] / denominator[0]) or (exact and value):
        branches.append(Element("R", value))
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
    return series(*branches, section)


def _reactance(numerator: Any, denominator: Any, square: Fraction, bits: int) -> Fraction:
    """Return Im(N/D)/ω at w = -ω²."""
    (n_even, n_odd), (d_even, d_odd) = even_odd(numerator), even_odd(denominator)
    above = evaluated(n_odd * d_even - n_even * d_odd, square, bits)
    return rounded(above / evaluated(squared_magnitude(denominator), square, bits), bits)


def _lowest(numerator: Any, denominator: Any, bits: int) -> _Lowest:
    """Return the lowest real part of a function without poles on the axis; on a tie that at 0 or infinity."""
    real, size = real_part(numerator, denominator), squared_magnitude(denominator)
    at_infinity = fraction(real[size.degree()] / size.leading_coefficient())
    lowest = _Lowest(min(fraction(real[0] / size[0]), at_infinity), None)
    critical = real.derivative() * size - real * size.derivative()
    if critical.degree() < 1:
        return lowest
    critical //= critical.gcd(critical.derivative())
    tie = Fraction(1, 1 << bits // 2)
    for square in _real_roots(critical, bits):
        if square < 0:
            value = rounded(value_at(real, square) / value_at(size, square), bits)
            if value < lowest.value * (1 - tie):
                lowest = _Lowest(value, square)
    return lowest


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
