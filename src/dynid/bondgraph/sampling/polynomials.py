"""Polynomials in s and in the values that vary, evaluated exactly for many samples."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

#: Polynomials of more terms than this are not factored, only made square-free: that could take long.
_FACTORED = 2000

Integers = NDArray[np.object_]


@dataclass(frozen=True)
class Factor:
    """A factor of a polynomial of a graph, without multiple roots for almost all values.

    Parameters
    ----------
    polynomial
        The factor (flint `fmpz_mpoly`, s being the first variable).
    multiplicity
        How often it occurs.
    """

    polynomial: Any
    multiplicity: int

    @property
    def degree(self) -> int:
        """The degree in s."""
        return int(self.polynomial.degrees()[0])

    @property
    def even(self) -> bool:
        """Whether it is a polynomial in s^2: with s, -s is a root as well."""
        return all(powers[0] % 2 == 0 for powers in self.polynomial.monoms())

    @property
    def is_laplace(self) -> bool:
        """Whether it is s itself, up to a sign."""
        return len(self.polynomial) == 1 and self.degree == 1


def factors(polynomial: Any) -> tuple[Factor, ...]:
    """Return the factors of a polynomial that s stands in, and those whose vanishing makes it vanish."""
    if polynomial == 0:
        return ()
    split = polynomial.factor if len(polynomial) <= _FACTORED else polynomial.factor_squarefree
    return tuple(Factor(part, int(power)) for part, power in split()[1])


class Tables:
    """Powers of the values of many samples, as integers over a common denominator.

    A value n/d that occurs up to the power D enters as n^e d^(D - e): the same positive or negative factor
    multiplies every polynomial.

    Parameters
    ----------
    values
        For every variable but s the values of the samples.
    polynomials
        What will be evaluated (flint `fmpz_mpoly`).
    samples
        How many samples there are.
    """

    def __init__(
        self, values: Sequence[Sequence[Fraction]], polynomials: Iterable[Any], samples: int
    ) -> None:
        degrees = np.max([(*polynomial.degrees(),) for polynomial in polynomials], axis=0, initial=0)[1:]
        self.samples = samples
        self._powers = [_powers(column, int(degree)) for column, degree in zip(values, degrees, strict=True)]

    def coefficients(self, polynomial: Any) -> list[Integers]:
        """Return the coefficients of s, ascending: for every power one integer a sample."""
        found: list[Any] = [0] * (int(polynomial.degrees()[0]) + 1)
        for (power, *exponents), coefficient in polynomial.terms():
            term: Any = int(coefficient)
            for table, exponent in zip(self._powers, exponents, strict=True):
                term = term * table[exponent]
            found[power] = found[power] + term
        return [np.broadcast_to(np.asarray(column, dtype=object), (self.samples,)) for column in found]


def _powers(values: Sequence[Fraction], degree: int) -> list[Integers]:
    """Return n^e d^(D - e) for e up to D."""
    above, below = (
        np.array(part, dtype=object)
        for part in zip(*((v.numerator, v.denominator) for v in values), strict=True)
    )
    return [above**e * below ** (degree - e) for e in range(degree + 1)]


def nonzero(columns: Sequence[Integers]) -> NDArray[np.bool_]:
    """Tell for which samples first and last coefficient are not zero."""
    first, last = columns[0], columns[-1]
    found: NDArray[np.bool_] = (first != 0) & (last != 0)
    return found.astype(bool)
