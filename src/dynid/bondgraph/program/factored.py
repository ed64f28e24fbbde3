"""Quotients of polynomials that stay factored: exact rational functions of s, and the same modulo a prime.

A greatest common divisor at every step is what makes exact rational arithmetic slow. Along a reduction
the same polynomials (the pivots) come back as numerators and denominators again and again, so a value is
kept as a product of powers of factors: products and quotients only add exponents, and a factor that meets
its own inverse disappears without any search. Only a sum multiplies out, and only the factors that its terms
do not share.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from functools import cache, reduce
from typing import Any, Self

# --- factored quotients ---------------------------------------------------------------------------


class PolynomialFactor:
    """A polynomial (of any ring type of flint); two factors are the same only if they are one object."""

    __slots__ = ("polynomial",)

    def __init__(self, polynomial: Any) -> None:
        self.polynomial = polynomial


class FactoredQuotient(ABC):
    """A product of powers of polynomials, not necessarily in lowest terms.

    Parameters
    ----------
    factors
        Exponent by factor, negative below the fraction bar; empty for 1, and None for 0.
    sign
        1 or -1.
    """

    __slots__ = ("factors", "sign")

    def __init__(self, factors: Mapping[PolynomialFactor, int] | None, sign: int = 1) -> None:
        self.factors = factors
        self.sign = sign

    @abstractmethod
    def _made(self, factors: Mapping[PolynomialFactor, int] | None, sign: int, other: Self) -> Self:
        """Return the result of an operation with `other`; each kind of number keeps it small in its way."""

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
        """Multiply two polynomials."""
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
        shared, *own = _shared(self.factors, other.factors)
        left, right = (self._product(factors) for factors in own)
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
        if least := min(p, q):
            shared[factor] = least
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
_SLACK = 1


class RationalFunction(FactoredQuotient):
    """A quotient of integer polynomials in s (flint `fmpz_poly`).

    Common factors are looked for only where a degree exceeds what the storage elements behind the value can
    explain.

    Parameters
    ----------
    factors, sign
        As for any quotient.
    storages
        Bit mask of the storage elements behind the value.
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
        given = ((numerator, 1), (denominator, -1))
        return cls({PolynomialFactor(part): power for part, power in given if part != 1}, 1, storages)

    def _made(self, factors: Mapping[PolynomialFactor, int] | None, sign: int, other: Self) -> Self:
        return type(self)(factors, sign, self.storages | other.storages)

    def __add__(self, other: Self) -> Self:
        total = super().__add__(other)  # products only add exponents: it is here that degrees grow
        above = below = 0
        for factor, power in (total.factors or {}).items():
            degree = factor.polynomial.degree() * power
            above, below = (above + degree, below) if power > 0 else (above, below - degree)
        if max(above, below) > total.storages.bit_count() + _SLACK:
            return self.of(*total.lowest_terms(), total.storages)
        return total

    def _zero(self) -> Any:
        from flint import fmpz_poly

        return fmpz_poly()


# --- modulo a prime -------------------------------------------------------------------------------


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
    """A quotient of polynomials modulo a prime, factored as it came about.

    Parameters
    ----------
    factors, sign
        As for any quotient.
    prime
        The prime.
    """

    __slots__ = ("prime",)

    def __init__(self, factors: Mapping[PolynomialFactor, int] | None, sign: int, prime: int) -> None:
        super().__init__(factors, sign)
        self.prime = prime

    def _made(
        self,
        factors: Mapping[PolynomialFactor, int] | None,
        sign: int,
        other: ModularQuotient,  # noqa: ARG002
    ) -> ModularQuotient:
        return ModularQuotient(factors, sign, self.prime)

    def _zero(self) -> Any:
        return polynomial([0], self.prime)


def polynomial(coefficients: list[int], prime: int) -> Any:
    """Return a polynomial modulo a prime, coefficients ascending."""
    from flint import nmod_poly

    return nmod_poly(coefficients, prime)
