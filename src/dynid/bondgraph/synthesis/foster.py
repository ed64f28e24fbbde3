"""Foster's forms: partial fractions of an impedance, with poles on the imaginary and the negative real axis.

A pole -σ of residue k > 0 is k/(s + σ), an R and a C in parallel. One of residue -k < 0 is, with k/σ taken
from the constant, (k/σ) s/(s + σ): an R and an I in parallel. So LC, RC and RL impedances have this form, and
sums of them. The second form is that of the admittance, with series branches in parallel.
"""

from __future__ import annotations

from fractions import Fraction
from typing import Any

from dynid.bondgraph.synthesis.cauer import NoSuchForm
from dynid.bondgraph.synthesis.one_port import Element, OnePort, dual, parallel, series
from dynid.lti.positive_real import axis_factor, ball_fraction, even_odd, fraction, in_square, value_at
from dynid.number_format import root_text


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


def foster(numerator: Any, denominator: Any, bits: int, name: str = "Z") -> OnePort:
    """Return the partial fractions of Z = N/D as one-ports in series.

    Parameters
    ----------
    numerator, denominator
        Polynomials in lowest terms (flint `fmpq_poly`) of a positive real function that is not zero.
    bits
        The precision of irrational values; rational ones are exact.
    name
        What messages call the function.

    Raises
    ------
    NoSuchForm
        Where a pole off the imaginary axis is complex or multiple, or the constant would be negative.
    """
    parts, above, below = without_axis_poles(numerator, denominator, bits)
    _refuse_poles(below, name)
    whole, rest = divmod(above, below)
    constant, known = fraction(whole[0]), True
    slope = below.derivative()
    sections: list[OnePort] = []
    for pole in real_roots(below, bits):
        residue, sigma = evaluated(rest, pole, bits) / evaluated(slope, pole, bits), -pole
        if residue > 0:
            sections.append(parallel(Element("R", residue / sigma), Element("C", 1 / residue)))
        else:
            constant += residue / sigma
            sections.append(parallel(Element("R", -residue / sigma), Element("I", -residue / sigma**2)))
            known = known and sigma.denominator.bit_length() < bits // 2
    if not known and abs(constant) < Fraction(1, 1 << bits // 2) * (abs(fraction(whole[0])) + 1):
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
            raise NoSuchForm(
                f"the pole {root_text(root.value)} of {name} has multiplicity {root.multiplicity}"
            )
