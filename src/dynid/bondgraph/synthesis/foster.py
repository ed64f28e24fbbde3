"""Foster's forms: partial fractions of an impedance, with poles on the imaginary and the negative real axis.

A pole -σ of residue k > 0 is k/(s + σ), an R and a C in parallel. One of residue -k < 0 is, with k/σ taken
from the constant, (k/σ) s/(s + σ): an R and an I in parallel. So LC, RC and RL impedances have this form, and
sums of them. The second form is that of the admittance, with series branches in parallel.
"""

from __future__ import annotations

from fractions import Fraction
from typing import Any

from dynid.bondgraph.synthesis.axis_poles import evaluated, real_roots, without_axis_poles
from dynid.bondgraph.synthesis.cauer import NoSuchForm
from dynid.bondgraph.synthesis.one_port import Element, OnePort, dual, parallel, series
from dynid.lti.positive_real import fraction
from dynid.number_format import root_text


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
