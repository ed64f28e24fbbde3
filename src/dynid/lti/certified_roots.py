"""Roots of exact polynomials with certified error bounds and half-planes.

Multiplicities come from an exact square-free factorisation. Roots on the imaginary axis are recognised
exactly: they are common roots of the even and the odd part of a polynomial. Every other root is refined
until its enclosing disc (`dynid.lti.enclosures`) does not meet the axis. Where a polynomial has neither
multiple roots nor roots on the axis, this is proved modulo a prime, in which a common factor over the
integers would appear.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING, Any, NamedTuple

from dynid.errors import NumericalError
from dynid.lti.stability import SidedRoot

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from dynid.lti.axis_boxes import Work
    from dynid.lti.pencil.rational_matrices import Reading

#: Working precision of square roots, bits.
_SQUARE_ROOT_BITS = 128
#: Degree and bits of polynomials whose roots Arb isolates faster than they are followed, and its precision.
_SMALL_DEGREE, _SMALL_BITS, _SMALL_PRECISION = 12, 1000, 128
#: Prime modulo which coprimality is proved.
_PRIME = (1 << 61) - 1


@dataclass(frozen=True)
class CertifiedRoot(SidedRoot):
    """A root with its exact multiplicity; `radius` bounds its error, the rounding of `value` included.

    Each part of the value is correctly rounded where the bound allows, the real part exactly 0 on the axis.
    """

    side: int


class _ZerosPoles(NamedTuple):
    """Zeros and poles of a rational function, repeated by multiplicity, and as certified roots."""

    zeros: NDArray[np.complex128]
    poles: NDArray[np.complex128]
    zero_roots: tuple[CertifiedRoot, ...]
    pole_roots: tuple[CertifiedRoot, ...]


def certified_roots(
    polynomial: Any, starts: Sequence[complex] | None = None, work: Work | None = None
) -> tuple[CertifiedRoot, ...]:
    """Return the roots of an integer polynomial (flint `fmpz_poly`), smallest modulus first.

    A polynomial over a field of irrational numbers (`FieldPolynomial`) is rounded to 320 bits, its
    multiplicities and its roots on the imaginary axis kept. `starts` are approximate roots, such as the
    eigenvalues of state equations; they save time, and do not change the result. `work` limits the cost
    (`dynid.lti.enclosures.EVALUATIONS`). `NumericalError` where a root other than 0 is outside the range of
    doubles, 1e-323 to 1e308; `ValueError` for the zero polynomial, of which every number is a root.
    """
    from flint import fmpz_poly

    if not isinstance(polynomial, fmpz_poly):
        polynomial = polynomial.numer()
    roots = [
        root
        for factor, count in _square_free(polynomial)
        for root in _simple_roots(factor, count, starts, work)
    ]
    return tuple(sorted(roots, key=lambda root: (abs(root.value), root.value.real, root.value.imag)))


def root_balls(
    polynomial: Any, starts: Sequence[complex] | None = None, work: Work | None = None
) -> list[Any]:
    """Return balls (flint `acb`) of the roots, repeated by multiplicity, their half-planes undecided.

    They cost less than certified roots. Real roots are exactly real. Parameters and errors as of
    `certified_roots`.
    """
    from flint import acb, ctx, fmpz_poly

    from dynid.lti.enclosures import enclosures

    small = polynomial.degree() <= _SMALL_DEGREE and polynomial.height_bits() <= _SMALL_BITS
    balls = []
    for factor, count in _square_free(polynomial):
        if starts is not None and small:  # of families of polynomials: one isolation costs less than a step
            if work is not None:
                work.spend(factor.degree() ** 2)
            with ctx.workprec(_SMALL_PRECISION):
                balls += [ball for ball, _ in factor.complex_roots()] * count
            continue
        rest = factor
        if factor[0] == 0:
            balls += [acb(0)] * count
            rest = factor // fmpz_poly([0, 1])
        if rest.degree() > 0:
            balls += enclosures(rest, starts, sides=False, work=work) * count
    return balls


def _square_free(polynomial: Any) -> list[tuple[Any, int]]:
    """Return the square-free factors that are not constant, with their multiplicities."""
    if polynomial == 0:
        raise ValueError("every number is a root of the zero polynomial")
    if _gcd(polynomial, polynomial.derivative()).degree() == 0:
        return [(polynomial, 1)] if polynomial.degree() > 0 else []
    return [(factor, int(count)) for factor, count in polynomial.factor_squarefree()[1]]


def repeated(roots: Iterable[SidedRoot]) -> NDArray[np.complex128]:
    """Return the values of roots as an array, repeated by multiplicity."""
    import numpy as np

    return np.array([root.value for root in roots for _ in range(root.multiplicity)], dtype=np.complex128)


def roots(
    numerator: Sequence[float | Fraction | str],
    denominator: Sequence[float | Fraction | str],
    reading: Reading = "binary",
) -> _ZerosPoles:
    """Return zeros and poles of one rational function, certified; common factors are kept.

    Parameters
    ----------
    numerator, denominator
        Coefficients in descending powers: ints, floats, Fractions or text such as '3125/47'.
    reading
        Interpretation of floats: 'binary', the exact value, or 'decimal', the shortest decimal that prints
        as the float (0.1 is 1/10).

    Raises
    ------
    ValueError
        Where either polynomial is zero.
    UsageError
        For a coefficient that is not a finite real number, or an unknown reading.
    """
    from dynid.lti.pencil.rational_matrices import exact_rows

    above, below = (
        integer_polynomial([x for row in exact_rows(name, [list(polynomial)], reading) for x in row])
        for name, polynomial in (("numerator", numerator), ("denominator", denominator))
    )
    zero_roots, pole_roots = certified_roots(above), certified_roots(below)
    return _ZerosPoles(repeated(zero_roots), repeated(pole_roots), zero_roots, pole_roots)


def integer_polynomial(coefficients: Sequence[float | Fraction | str]) -> Any:
    """Return descending coefficients as an integer polynomial with the same roots (flint `fmpz_poly`)."""
    from flint import fmpq, fmpq_poly

    exact = [Fraction(coefficient) for coefficient in reversed(coefficients)]
    return fmpq_poly([fmpq(c.numerator, c.denominator) for c in exact]).numer()


def _gcd(a: Any, b: Any) -> Any:
    """Return the greatest common divisor; coprimality modulo a prime proves coprimality."""
    from flint import fmpz_poly, nmod_poly

    if a and b and a.leading_coefficient() % _PRIME:
        images = [nmod_poly([int(c % _PRIME) for c in p.coeffs()], _PRIME) for p in (a, b)]
        if images[0].gcd(images[1]).degree() == 0:
            return fmpz_poly([1])
    return a.gcd(b)


def _simple_roots(
    polynomial: Any, multiplicity: int, starts: Sequence[complex] | None, work: Work | None
) -> list[CertifiedRoot]:
    """Return the roots of a square-free polynomial."""
    from flint import acb, arb, ctx, fmpz_poly

    from dynid.lti.enclosures import enclosures

    roots = []
    if polynomial[0] == 0:
        roots.append(CertifiedRoot(0j, multiplicity, 0.0, 0))
        polynomial = polynomial // fmpz_poly([0, 1])
    coefficients = polynomial.coeffs()
    # p(s) = E(w) + s O(w) with w = s^2: common roots of E and O are pairs of roots s and -s
    shared = _gcd(fmpz_poly(coefficients[::2]), fmpz_poly(coefficients[1::2]))
    if shared.degree() > 0:
        pairs = fmpz_poly([c for w in shared.coeffs() for c in (w, 0)])
        polynomial = polynomial // pairs
        for square in enclosures(shared, sides=False, work=work):
            with ctx.workprec(max(_SQUARE_ROOT_BITS, square.real.bits(), square.imag.bits())):
                # A negative w lies on the imaginary axis; else the principal branch is the right half-plane.
                on_axis = bool(square.imag == 0 and square.real < 0)
                s = acb(arb(0), (-square.real).sqrt()) if on_axis else square.sqrt()
                side = 0 if on_axis else 1
                roots += [_rounded(s, multiplicity, side), _rounded(-s, multiplicity, -side)]
    if polynomial.degree() > 0:
        balls = enclosures(polynomial, starts, work=work)
        roots += [_rounded(ball, multiplicity, 1 if ball.real > 0 else -1) for ball in balls]
    return roots


def _rounded(ball: Any, multiplicity: int, side: int) -> CertifiedRoot:
    """Round a ball clear of 0 to the nearest complex number and bound the distance to the true root."""
    from flint import acb, ctx

    with ctx.workprec(_SQUARE_ROOT_BITS + max(ball.real.bits(), ball.imag.bits())):
        value = complex(_nearest(ball.real.mid()), _nearest(ball.imag.mid()))
        if not value:
            raise _out_of_range()
        distance = (ball - acb(value.real, value.imag)).abs_upper()
        bound = math.nextafter(float(distance), math.inf) if distance > 0 else 0.0
    return CertifiedRoot(value, multiplicity, bound, side)


def _nearest(number: Any) -> float:
    """Round an exact ball (flint `arb`) to the nearest double."""
    exact = number.fmpq()
    try:
        return int(exact.p) / int(exact.q)
    except OverflowError:
        raise _out_of_range() from None


def _out_of_range() -> NumericalError:
    from dynid.arrays import REMEDY

    return NumericalError("a zero or pole is beyond the range of double precision", remedy=REMEDY)
