"""Exact rational functions of s."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Self

from dynid.bondgraph.algebra.quotient import Factor, Quotient

#: Beyond the storages behind it, a value may carry one factor s (a momentum or displacement output).
_SLACK = 1


class Ratio(Quotient):
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

    def __init__(self, factors: Mapping[Factor, int] | None, sign: int = 1, storages: int = 0) -> None:
        super().__init__(factors, sign)
        self.storages = storages

    @classmethod
    def of(cls, numerator: Any, denominator: Any, storages: int = 0) -> Self:
        """Return the quotient of two polynomials."""
        if numerator == 0:
            return cls(None, 1, storages)
        given = ((numerator, 1), (denominator, -1))
        return cls({Factor(part): power for part, power in given if part != 1}, 1, storages)

    def _made(self, factors: Mapping[Factor, int] | None, sign: int, other: Self) -> Self:
        return type(self)(factors, sign, self.storages | other.storages)

    def __add__(self, other: Self) -> Self:
        total = super().__add__(other)  # products only add exponents: it is here that degrees grow
        if total._degree() > total.storages.bit_count() + _SLACK:
            return self.of(*total.lowest_terms(), total.storages)
        return total

    def _degree(self) -> int:
        """Return the larger degree of numerator and denominator, as they stand."""
        above = below = 0
        for factor, power in (self.factors or {}).items():
            degree = factor.polynomial.degree() * power
            above, below = (above + degree, below) if power > 0 else (above, below - degree)
        return max(above, below)

    def _zero(self) -> Any:
        from flint import fmpz_poly

        return fmpz_poly()
