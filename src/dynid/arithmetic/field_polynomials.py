"""Numbers and polynomials over the field of a scene's irrational numbers, with the interface of flint's.

Coefficients are coded numbers (`real_field`): rational arithmetic on them is exact up to their coding, and
what is zero modulo the field's prime is zero. A greatest common divisor has the degree that it has modulo the
prime. For what is done by rational polynomials alone (isolating roots, verdicts), `rounded` gives one of the
same structure: its multiplicities, its roots at 0 and on the imaginary axis, and its zero coefficients.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Sequence
from fractions import Fraction
from typing import Any, Self, TypeVar

from flint import arb, ctx, fmpq, fmpq_poly, fmpz_poly

from dynid.arithmetic.real_field import ROUNDED_BITS, RealField
from dynid.errors import NumericalError

#: Length of coefficients, in lengths of coded numbers, beyond which they are coded anew.
_MAX_COEFFICIENT_RATIO = 16


class _RingElement(ABC):
    """Sums and products over the field, of the flint `value` of numbers and polynomials alike."""

    __slots__ = ("field", "value")

    field: RealField
    value: Any

    @abstractmethod
    def _made(self, value: Any) -> Self:
        """Return the element of a value, coded anew where that is long."""

    @abstractmethod
    def _value(self, other: Any) -> Any:
        """Return the flint value of an operand."""

    def __bool__(self) -> bool:
        return bool(self.value != 0)

    def __add__(self, other: Any) -> Self:
        return self._made(self.value + self._value(other))

    __radd__ = __add__

    def __sub__(self, other: Any) -> Self:
        return self._made(self.value - self._value(other))

    def __rsub__(self, other: Any) -> Self:
        return self._made(self._value(other) - self.value)

    def __mul__(self, other: Any) -> Self:
        return self._made(self.value * self._value(other))

    __rmul__ = __mul__


class FieldNumber(_RingElement):
    """A number of the field, coded (flint `fmpq`)."""

    __slots__ = ()

    def __init__(self, field: RealField, value: Any) -> None:
        self.field = field
        self.value = value if value.p % field.prime else fmpq(0)

    def _made(self, value: Any) -> Self:
        if value.p.bit_length() > _MAX_COEFFICIENT_RATIO * self.field.bits and value.p % self.field.prime:
            value = _coded_anew(self.field, value)
        return type(self)(self.field, value)

    def _value(self, other: Any) -> Any:
        return other.value if isinstance(other, FieldNumber) else other

    def __truediv__(self, other: Any) -> Self:
        return self._made(self.value / self._value(other))

    def __rtruediv__(self, other: Any) -> Self:
        return self._made(self._value(other) / self.value)

    def __neg__(self) -> Self:
        return type(self)(self.field, -self.value)

    @property
    def p(self) -> Any:
        """The numerator."""
        return self.value.p

    @property
    def q(self) -> Any:
        """The denominator."""
        return self.value.q


def _residue(field: RealField, value: Any) -> int:
    return int(value.p % field.prime) * pow(int(value.q), -1, field.prime) % field.prime


def _coded_anew(field: RealField, value: Any) -> Any:
    """Return a coded number with a short numerator and denominator."""
    return field.near(value, _residue(field, value))


def settled(field: RealField, value: Any) -> Any:
    """Return the number that a coded one is rounded to in the end: equal numbers to equal ones."""
    if value.p % field.prime == 0:
        return fmpq(0)
    with ctx.workprec(ROUNDED_BITS):
        ball = arb(value) * arb(1, 2.0**-200)  # with the uncertainty that its coding may have grown to
    exact = field.rational(_residue(field, value), ball)
    if exact is not None:
        return fmpq(exact.numerator, exact.denominator)
    shift = ROUNDED_BITS - value.p.bit_length() + value.q.bit_length()
    scale = fmpq(2) ** shift
    target = value * scale
    return fmpq(int((2 * target.p + target.q) // (2 * target.q))) / scale


P = TypeVar("P", bound="FieldPolynomial")


class FieldPolynomial(_RingElement):
    """A polynomial over the field, its coefficients coded (flint `fmpq_poly` or `fmpz_poly`)."""

    __slots__ = ()

    def __init__(self, field: RealField, value: Any) -> None:
        value = fmpq_poly(value)
        numerator = value.numer()
        coefficients = numerator.coeffs()
        if any(c and c % field.prime == 0 for c in coefficients):
            below = value.denom()
            value = fmpq_poly([c if c % field.prime else 0 for c in coefficients]) / below
        self.field, self.value = field, value

    def _made(self, value: Any) -> Self:
        polynomial = type(self)(self.field, value)
        return (
            polynomial.shortened()
            if polynomial.value.numer().height_bits() > _MAX_COEFFICIENT_RATIO * self.field.bits
            else polynomial
        )

    def _value(self, other: Any) -> Any:
        return (
            other.value
            if isinstance(other, FieldPolynomial)
            else fmpq_poly(other)
            if isinstance(other, fmpz_poly)
            else other
        )

    @property
    def image(self) -> Any:
        """The polynomial modulo the prime."""
        prime = self.field.prime
        numerator, below = self.value.numer(), pow(int(self.value.denom()), -1, prime)
        return self.field.polynomials([int(c % prime) * below % prime for c in numerator.coeffs()])

    def shortened(self) -> Self:
        """Return the same polynomial with coefficients of usual length."""
        short = fmpq_poly([_coded_anew(self.field, c) if c else c for c in self.value.coeffs()])
        return type(self)(self.field, short)

    def over(self, number: Any) -> Self:
        """Return the polynomial over a number of the field (flint `fmpq`)."""
        return self._made(self.value / number).shortened()

    def monic(self) -> Self:
        """Return the polynomial over its leading coefficient."""
        return self.over(self.leading_coefficient())

    # --- as flint's ----------------------------------------------------------------------------

    def coeffs(self) -> list[Any]:
        """Return the coefficients, ascending."""
        return list(self.value.coeffs())

    def degree(self) -> int:
        """Return the degree."""
        return int(self.value.degree())

    def length(self) -> int:
        """Return the number of coefficients."""
        return int(self.value.length())

    def __len__(self) -> int:
        return self.length()

    def leading_coefficient(self) -> Any:
        """Return the leading coefficient."""
        return self.value.leading_coefficient()

    def derivative(self) -> Self:
        """Return the derivative."""
        return self._made(self.value.derivative())

    def content(self) -> int:
        """Return 1: the content of a polynomial over a field."""
        return 1

    def __getitem__(self, power: int) -> Any:
        return self.value[power]

    def __eq__(self, other: object) -> bool:
        return not type(self)(self.field, self.value - self._value(other))

    __hash__ = None  # type: ignore[assignment]

    def __pow__(self, exponent: int) -> Self:
        return self._made(self.value**exponent)

    def __neg__(self) -> Self:
        return self._made(-self.value)

    def __floordiv__(self, other: Any) -> Self:
        return _divided(self, self._made(self._value(other)))[0]

    def __mod__(self, other: Any) -> Self:
        return _divided(self, self._made(self._value(other)))[1]

    def gcd(self, other: Any) -> Self:
        """Return the monic greatest common divisor; `NumericalError` where coding loses its accuracy."""
        a, b = self, self._made(self._value(other))
        if not a or not b:
            return (a or b).monic() if a or b else a
        degree = a.image.gcd(b.image).degree()
        if degree == 0:
            return self._made(fmpq_poly([1]))
        if a.degree() < b.degree():
            a, b = b, a
        while b:
            a, b = b.monic(), a % b.monic()
        common = a.monic()
        if common.degree() != degree or not (_divides(common, self) and _divides(common, other)):
            raise NumericalError(
                "common factors of polynomials with irrational coefficients need more than "
                f"{self.field.bits:,} bits",
                remedy="Write values as decimals, or give the graph fewer storage elements.",
            )
        return common

    def factor_squarefree(self) -> tuple[Any, list[tuple[Self, int]]]:
        """Return the leading coefficient, and the monic square-free factors with their powers (Yun)."""
        factors: list[tuple[Self, int]] = []
        common = self.gcd(self.derivative())
        rest, slope = self // common, self.derivative() // common
        power = 0
        while rest.degree() > 0:
            power += 1
            slope = slope - rest.derivative()
            factor = rest.gcd(slope)
            if factor.degree() > 0:
                factors.append((factor.monic(), power))
            rest, slope = rest // factor, slope // factor
        return self.leading_coefficient(), factors

    # --- structure -----------------------------------------------------------------------------

    def rounded(self) -> Any:
        """Return a monic rational polynomial (flint `fmpq_poly`) of the same structure, close to it."""
        if not self:
            return fmpq_poly([])
        return math.prod((part**power for part, power in self._settled_parts()), start=fmpq_poly([1]))

    def factors(self) -> list[tuple[Any, int]]:
        """Return rational polynomials with the roots of the square-free factors, and their multiplicities."""
        return [(part.numer(), power) for part, power in self._settled_parts()]

    def _settled_parts(self) -> Iterator[tuple[Any, int]]:
        for factor, power in self.factor_squarefree()[1]:
            for part in _parts(factor):
                yield fmpq_poly(settled_coefficients(part.monic())), power

    def complex_roots(self) -> list[tuple[Any, int]]:
        """Return enclosures of the roots with their multiplicities, as flint's polynomials do."""
        return list(self.numer().complex_roots())

    def numer(self) -> Any:
        """Return an integer polynomial (flint `fmpz_poly`) of the same structure, close to a multiple."""
        return self.rounded().numer()


def _parts(factor: FieldPolynomial) -> Iterator[FieldPolynomial]:
    """Yield a square-free polynomial in parts: s, its pairs of roots s and -s, and the rest."""
    field = factor.field
    if factor[0] == 0:
        yield FieldPolynomial(field, fmpq_poly([0, 1]))
        factor = FieldPolynomial(field, fmpq_poly(factor.coeffs()[1:]))
    coefficients = factor.coeffs()
    even, odd = (FieldPolynomial(field, fmpq_poly(coefficients[k::2])) for k in (0, 1))
    shared = even.gcd(odd)
    if shared.degree() > 0:
        pairs = FieldPolynomial(field, fmpq_poly([c for w in shared.coeffs() for c in (w, 0)]))
        yield pairs
        factor = factor // pairs
    if factor.degree() > 0:
        yield factor


def _divided(above: P, below: P) -> tuple[P, P]:
    """Return quotient and remainder."""
    kind = type(above)
    if above.degree() < below.degree():
        return kind(above.field, fmpq_poly([])), above
    quotient, remainder = divmod(above.value, below.value)
    return kind(above.field, quotient).shortened(), kind(above.field, remainder).shortened()


def _divides(factor: FieldPolynomial, polynomial: Any) -> bool:
    """Test whether what a division leaves is small beside the polynomial, both at about |s| of the roots."""
    above, below = (
        fmpq_poly(argument.value if isinstance(argument, FieldPolynomial) else argument)
        for argument in (polynomial, factor)
    )
    first = next(k for k, c in enumerate(below.coeffs()) if c != 0)
    spread = _size(below[first]) - _size(below.leading_coefficient())
    radius = Fraction(spread, max(below.degree() - first, 1))  # log2 of the geometric mean of the roots
    left, dividend = (
        max((_size(c) + radius * k for k, c in enumerate(argument.coeffs()) if c != 0), default=None)
        for argument in (divmod(above, below)[1], above)
    )
    return left is None or (dividend is not None and left <= dividend - ROUNDED_BITS)


def _size(number: Any) -> int:
    """Return about log2 of the size of a number (flint `fmpq`)."""
    return int(number.p.bit_length()) - int(number.q.bit_length())


def polynomial(field: RealField | None, coefficients: Iterable[Any]) -> Any:
    """Return a polynomial over the integers, or over a field."""
    return (
        fmpz_poly(list(coefficients))
        if field is None
        else FieldPolynomial(field, fmpq_poly(list(coefficients)))
    )


def like(polynomial: Any, coefficients: Sequence[Any]) -> Any:
    """Return a polynomial of the kind of another one."""
    if isinstance(polynomial, FieldPolynomial):
        return FieldPolynomial(polynomial.field, fmpq_poly(coefficients))
    return type(polynomial)(coefficients)


def settled_coefficients(polynomial: Any) -> list[Any]:
    """Return the coefficients, ascending; those over a field rounded."""
    if isinstance(polynomial, FieldPolynomial):
        return [settled(polynomial.field, c) for c in polynomial.coeffs()]
    return list(polynomial.coeffs())


def primitive(polynomial: Any) -> Any:
    """Return a polynomial without a common factor of its coefficients, the leading one positive."""
    if isinstance(polynomial, FieldPolynomial):
        return polynomial.monic()
    return polynomial // polynomial.content() * (1 if polynomial.leading_coefficient() > 0 else -1)


def leading_ratio(above: Any, below: Any) -> Fraction:
    """Return the quotient of two leading coefficients; over a field rounded, as equal numbers are alike."""
    if isinstance(above, FieldPolynomial) and isinstance(below, FieldPolynomial):
        if not above:
            return Fraction(0)
        ratio = settled(above.field, above.leading_coefficient() / below.leading_coefficient())
        return Fraction(int(ratio.p), int(ratio.q))
    return Fraction(int(above.leading_coefficient()), int(below.leading_coefficient()))


def integers(*polynomials: Any, rounded: bool = False) -> list[Any]:
    """Return polynomials as integer polynomials (flint `fmpz_poly`), all times the same number.

    With `rounded` coefficients over a field are rounded in the end (`settled`), not as they are coded.
    """
    if not any(isinstance(polynomial, FieldPolynomial) for polynomial in polynomials):
        return list(polynomials)
    values = []
    for polynomial in polynomials:
        coefficients = settled_coefficients(polynomial) if rounded else polynomial.coeffs()
        values.append(fmpq_poly(coefficients))
    common = math.lcm(*(int(value.denom()) for value in values))
    return [(value * common).numer() for value in values]
