"""Exact numbers of programs: rational functions that stay factored, and points modulo a large prime.

At points modulo a large prime a program distinguishes zero from nonzero. A greatest common divisor at every
step is what makes exact rational arithmetic slow. Along a reduction the same polynomials (the pivots) come
back as numerators and denominators again and again, so a value is kept as a product of powers of factors:
products and quotients only add exponents, and a factor that meets its own inverse disappears without any
search. Only a sum multiplies out, and only the factors that its terms do not share.
"""

from __future__ import annotations

import random
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from functools import cache, lru_cache, reduce
from itertools import count
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from dynid.bondgraph.program.program import ModularPoint

if TYPE_CHECKING:
    from dynid.arithmetic.real_field import RealField

# --- points ---------------------------------------------------------------------------------------

# A prime near 10^18 sqrt(5), far from powers of two and ten: modulo 2^61 - 1, for example, 2^61 is 1, and
# binary fractions that differ by this factor are the same.
_MAX_PRIME = 2236067977499789659


def primes() -> Iterator[int]:
    """Yield large primes, the largest first."""
    from flint import fmpz

    return (candidate for candidate in range(_MAX_PRIME, 1, -2) if fmpz(candidate).is_prime())


def prime_for(values: Iterable[Fraction]) -> int:
    """Return a large prime that divides no numerator or denominator of these values."""
    return next(primes_for(values))


def primes_for(values: Iterable[Fraction]) -> Iterator[int]:
    """Yield large primes that divide no numerator or denominator of these values."""
    parts = [number for value in values for number in value.as_integer_ratio() if number]
    largest = max(map(abs, parts), default=1)
    return (prime for prime in primes() if largest < prime or all(number % prime for number in parts))


def random_point(names: Iterable[str], prime: int) -> ModularPoint:
    """Return a fixed random point: no numbers, only what holds for all of them."""
    from flint import nmod

    source = random.Random(0x5EED)
    laplace = nmod(source.getrandbits(60), prime)
    values = {name: nmod(source.getrandbits(60), prime) for name in names}
    return ModularPoint(prime, values, laplace, general=True)


def numeric_point(values: Mapping[str, Fraction], prime: int) -> ModularPoint:
    """Return the point at these values and a fixed random s."""
    from flint import nmod

    laplace = nmod(random.Random(0xD1F1D).randrange(1, prime), prime)
    images = {name: nmod(v.numerator, prime) / nmod(v.denominator, prime) for name, v in values.items()}
    return ModularPoint(prime, images, laplace)


class _ComplexResidue:
    """A number modulo a prime of which -1 is no square, with a part that multiplies a root of -1."""

    __slots__ = ("imaginary", "real")

    def __init__(self, real: Any, imaginary: Any) -> None:
        self.real, self.imaginary = real, imaginary

    def __bool__(self) -> bool:
        return bool(self.real) or bool(self.imaginary)

    def __add__(self, other: _ComplexResidue) -> _ComplexResidue:
        return _ComplexResidue(self.real + other.real, self.imaginary + other.imaginary)

    def __sub__(self, other: _ComplexResidue) -> _ComplexResidue:
        return _ComplexResidue(self.real - other.real, self.imaginary - other.imaginary)

    def __neg__(self) -> _ComplexResidue:
        return _ComplexResidue(-self.real, -self.imaginary)

    def __mul__(self, other: _ComplexResidue | int) -> _ComplexResidue:
        if isinstance(other, int):
            return _ComplexResidue(self.real * other, self.imaginary * other)
        real = self.real * other.real - self.imaginary * other.imaginary
        return _ComplexResidue(real, self.real * other.imaginary + self.imaginary * other.real)

    def __truediv__(self, other: _ComplexResidue) -> _ComplexResidue:
        square = other.real * other.real + other.imaginary * other.imaginary
        return self * _ComplexResidue(other.real / square, -other.imaginary / square)


def field_point(
    values: Mapping[str, Fraction], field: RealField, omega: Fraction | None = None
) -> ModularPoint:
    """Return the point at values of a field, modulo its prime, and at a fixed random s or at j omega."""
    unity: Any
    laplace: Any
    if omega is None:
        unity, laplace = field.residues(1), field.residues(random.Random(0xD1F1D).randrange(1, field.prime))
    else:  # -1 has no root modulo the prime, but in the field of its square
        unity = _ComplexResidue(field.residues(1), field.residues(0))
        laplace = _ComplexResidue(field.residues(0), field.residues(field.residue(omega)))
    images = {name: unity * field.residue(value) for name, value in values.items()}
    return ModularPoint(field.prime, images, laplace, one=unity)


def axis_point(
    values: Mapping[str, Fraction], omega: Fraction, field: RealField | None = None
) -> ModularPoint:
    """Return the point at these values and s = j omega, modulo a prime that has a square root of -1."""
    from flint import nmod

    if field is not None:
        return field_point(values, field, omega)
    prime = next(prime for prime in primes_for([*values.values(), omega]) if prime % 4 == 1)
    roots = (pow(base, (prime - 1) // 4, prime) for base in count(2))
    j = next(root for root in roots if root * root % prime == prime - 1)
    point = numeric_point(values, prime)
    return replace(point, laplace=nmod(j * omega.numerator, prime) / nmod(omega.denominator, prime))


# --- arrays of residues ---------------------------------------------------------------------------

#: A Mersenne prime; products of residues fit into 64 bits.
PRIME = (1 << 31) - 1

ResidueArray = NDArray[np.int64]


class SampledResidues:
    """One residue for every sample.

    `vanished`: samples in which something was divided by zero; shared by all numbers of a run, and added to.
    """

    __slots__ = ("images", "vanished")

    def __init__(self, images: ResidueArray, vanished: NDArray[np.bool_]) -> None:
        self.images = images
        self.vanished = vanished

    @classmethod
    def of(cls, values: Sequence[Fraction], vanished: NDArray[np.bool_]) -> SampledResidues:
        """Return the residues of exact values, one a sample."""
        above, below = (
            np.array([integer % PRIME for integer in parts], dtype=np.int64)
            for parts in ([v.numerator for v in values], [v.denominator for v in values])
        )
        return cls(above, vanished) / cls(below, vanished)

    def _made(self, images: Any) -> SampledResidues:
        return SampledResidues(images % PRIME, self.vanished)

    def __add__(self, other: SampledResidues) -> SampledResidues:
        return self._made(self.images + other.images)

    def __sub__(self, other: SampledResidues) -> SampledResidues:
        return self._made(self.images - other.images)

    def __neg__(self) -> SampledResidues:
        return self._made(-self.images)

    def __mul__(self, other: SampledResidues | int) -> SampledResidues:
        return self._made(self.images * (other % PRIME if isinstance(other, int) else other.images))

    def __truediv__(self, other: SampledResidues) -> SampledResidues:
        self.vanished |= other.images == 0
        inverse, power, exponent = np.ones_like(other.images), other.images, PRIME - 2
        while exponent:  # Fermat: x^(p - 2) is 1/x
            if exponent & 1:
                inverse = inverse * power % PRIME
            power, exponent = power * power % PRIME, exponent >> 1
        return self._made(self.images * inverse)


# --- factored quotients ---------------------------------------------------------------------------


class PolynomialFactor:
    """A polynomial (of any ring type of flint); two factors are the same only if they are one object."""

    __slots__ = ("polynomial",)

    def __init__(self, polynomial: Any) -> None:
        self.polynomial = polynomial


class FactoredQuotient(ABC):
    """A product of powers of polynomials, not necessarily in lowest terms.

    `factors`: exponent by factor, negative below the fraction bar; empty for 1, and None for 0.
    """

    __slots__ = ("factors", "sign")

    def __init__(self, factors: Mapping[PolynomialFactor, int] | None, sign: int = 1) -> None:
        self.factors = factors
        self.sign = sign

    @abstractmethod
    def _made(self, factors: Mapping[PolynomialFactor, int] | None, sign: int, operand: Self) -> Self:
        """Return the result of an operation with `operand`; each kind of number keeps it small in its way."""

    @abstractmethod
    def _zero(self) -> Any:
        """Return the polynomial 0."""

    @property
    def is_zero(self) -> bool:
        """True where the value is 0."""
        return self.factors is None

    def lowest_terms(self) -> tuple[Any, Any]:
        """Return numerator and denominator as polynomials without a common factor."""
        numerator, denominator = self.multiplied_out()
        common = numerator.gcd(denominator)
        return numerator // common, denominator // common

    def multiplied_out(self) -> tuple[Any, Any]:
        """Return numerator and denominator as polynomials, which may have common factors."""
        if self.factors is None:
            return self._zero(), self._zero() ** 0
        above = {factor: power for factor, power in self.factors.items() if power > 0}
        below = {factor: -power for factor, power in self.factors.items() if power < 0}
        numerator = self._product(above)
        return numerator if self.sign > 0 else -numerator, self._product(below)

    def _product(self, factors: Mapping[PolynomialFactor, int]) -> Any:
        """Multiply out a product of positive powers, short factors first."""
        parts = [f.polynomial if power == 1 else f.polynomial**power for f, power in factors.items()]
        return reduce(self._multiplied, sorted(parts, key=len)) if parts else self._zero() ** 0

    def _multiplied(self, a: Any, b: Any) -> Any:
        return a * b

    def __neg__(self) -> Self:
        return self._made(self.factors, -self.sign, self)

    def __mul__(self, other: Self | int) -> Self:
        if isinstance(other, int):
            return self._made(self.factors if other else None, self.sign if other > 0 else -self.sign, self)
        if self.factors is None or other.factors is None:
            return self._made(None, 1, other)
        return self._made(_combined(self.factors, other.factors, 1), self.sign * other.sign, other)

    def __truediv__(self, other: Self) -> Self:
        if other.factors is None:
            raise ZeroDivisionError("a pivot is zero with these values")
        if self.factors is None:
            return self._made(None, 1, other)
        return self._made(_combined(self.factors, other.factors, -1), self.sign * other.sign, other)

    def __sub__(self, other: Self) -> Self:
        return self + (-other)

    def __add__(self, other: Self) -> Self:
        if self.factors is None or other.factors is None:
            return self if other.factors is None else other
        shared, *rest = _shared(self.factors, other.factors)
        left, right = (self._product(factors) for factors in rest)
        if self.sign != other.sign:
            right = -right
        total = left + right
        if total == 0:
            return self._made(None, 1, other)
        return self._made(shared if total == 1 else {PolynomialFactor(total): 1, **shared}, self.sign, other)


def _shared(
    a: Mapping[PolynomialFactor, int], b: Mapping[PolynomialFactor, int]
) -> tuple[dict[PolynomialFactor, int], dict[PolynomialFactor, int], dict[PolynomialFactor, int]]:
    """Return what two products have in common, so that what is left of either has no negative powers."""
    shared: dict[PolynomialFactor, int] = {}
    left: dict[PolynomialFactor, int] = {}
    right: dict[PolynomialFactor, int] = {}
    for factor in {**a, **b}:
        p, q = a.get(factor, 0), b.get(factor, 0)
        if p > q:
            left[factor] = p - q
        elif q > p:
            right[factor] = q - p
        if power := min(p, q):
            shared[factor] = power
    return shared, left, right


def _combined(
    a: Mapping[PolynomialFactor, int], b: Mapping[PolynomialFactor, int], times: int
) -> dict[PolynomialFactor, int]:
    """Add the exponents of two products, those of the second multiplied by `times`."""
    if len(a) < len(b) and times == 1:
        a, b = b, a
    result = dict(a)
    for factor, power in b.items():
        total = result.get(factor, 0) + times * power
        if total:
            result[factor] = total
        else:
            del result[factor]
    return result


# --- rational functions of s ----------------------------------------------------------------------

#: Beyond the storage elements behind it, a value may carry one factor s (a momentum or displacement output).
_MAX_EXTRA_DEGREE = 1


class RationalFunction(FactoredQuotient):
    """A quotient of integer polynomials in s (flint `fmpz_poly`).

    Common factors are looked for only where a degree exceeds what the storage elements behind the value can
    explain.

    `storages`: bit mask of the storage elements behind the value.
    """

    __slots__ = ("storages",)

    def __init__(
        self, factors: Mapping[PolynomialFactor, int] | None, sign: int = 1, storages: int = 0
    ) -> None:
        super().__init__(factors, sign)
        self.storages = storages

    @classmethod
    def of(cls, numerator: Any, denominator: Any, storages: int = 0) -> Self:
        """Return the quotient of two polynomials."""
        if numerator == 0:
            return cls(None, 1, storages)
        powers = ((numerator, 1), (denominator, -1))
        return cls(
            {PolynomialFactor(polynomial): power for polynomial, power in powers if polynomial != 1},
            1,
            storages,
        )

    def _made(self, factors: Mapping[PolynomialFactor, int] | None, sign: int, operand: Self) -> Self:
        return type(self)(factors, sign, self.storages | operand.storages)

    def __add__(self, other: Self) -> Self:
        total = super().__add__(other)  # products only add exponents: it is here that degrees grow
        above = below = 0
        for factor, power in (total.factors or {}).items():
            degree = factor.polynomial.degree() * power
            above, below = (above + degree, below) if power > 0 else (above, below - degree)
        if max(above, below) > total.storages.bit_count() + _MAX_EXTRA_DEGREE:
            return self.of(*total.lowest_terms(), total.storages)
        return total

    def _zero(self) -> Any:
        from flint import fmpz_poly

        return fmpz_poly()


# --- over a field, and modulo a prime --------------------------------------------------------------


@lru_cache(maxsize=8)
def rational_functions_over(field: RealField) -> type[RationalFunction]:
    """Return the type of rational functions of s over the field of irrational numbers."""
    from dynid.arithmetic.field_polynomials import polynomial as over_field

    class RatioOverField(RationalFunction):
        """A rational function of s over the field."""

        __slots__ = ()

        def _zero(self) -> Any:
            return over_field(field, [])

        def lowest_terms(self) -> tuple[Any, Any]:
            numerator, denominator = super().lowest_terms()
            return numerator.shortened(), denominator.shortened()

    return RatioOverField


@cache
def rational_functions_modulo(prime: int) -> type[RationalFunction]:
    """Return the type of rational functions of s modulo a prime (flint `nmod_poly`)."""

    class RatioModulo(RationalFunction):
        """A rational function of s modulo the prime."""

        __slots__ = ()

        def _zero(self) -> Any:
            return polynomial([0], prime)

    return RatioModulo


class ModularQuotient(FactoredQuotient):
    """A quotient of polynomials modulo a prime, factored as it came about."""

    __slots__ = ("prime",)

    def __init__(self, factors: Mapping[PolynomialFactor, int] | None, sign: int, prime: int) -> None:
        super().__init__(factors, sign)
        self.prime = prime

    def _made(
        self,
        factors: Mapping[PolynomialFactor, int] | None,
        sign: int,
        operand: ModularQuotient,  # noqa: ARG002
    ) -> ModularQuotient:
        return ModularQuotient(factors, sign, self.prime)

    def _zero(self) -> Any:
        return polynomial([0], self.prime)


def polynomial(coefficients: list[int], prime: int) -> Any:
    """Return a polynomial modulo a prime, coefficients ascending."""
    from flint import nmod_poly

    if prime > _MAX_PRIME:
        return _long_polynomials(prime)(coefficients)
    return nmod_poly(coefficients, prime)


@lru_cache(maxsize=8)
def _long_polynomials(prime: int) -> Any:
    from flint import fmpz_mod_ctx, fmpz_mod_poly_ctx

    return fmpz_mod_poly_ctx(fmpz_mod_ctx(prime))
