"""Polynomials in s and in the values that vary, evaluated exactly for many samples."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

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
    """Return factors of a polynomial that for almost all values have simple roots, none in common.

    Pairs of roots s and -s have a factor of their own, a polynomial in s^2. Factors without s are left out.
    """
    ring = polynomial.context()
    s = ring.gen(0)
    power = min((int(powers[0]) for powers in polynomial.monoms()), default=0)
    found = [Factor(s, power)] if power else []
    for part, multiplicity in _squarefree(polynomial // s**power):
        even, rest = _paired(part)
        found += [Factor(one, multiplicity) for one in (even, rest) if one.degrees()[0]]
    return tuple(found)


def _squarefree(polynomial: Any) -> Iterator[tuple[Any, int]]:
    """Yield the square-free factors in s with their multiplicities (Yun's algorithm)."""
    slope = polynomial.derivative(0)
    if slope == 0:
        return
    common = polynomial.gcd(slope)
    b, multiplicity = polynomial // common, 1
    d = slope // common - b.derivative(0)
    while b.degrees()[0]:
        part = b.gcd(d)
        if part.degrees()[0]:
            yield part, multiplicity
        b, multiplicity = b // part, multiplicity + 1
        d = d // part - b.derivative(0)


def _paired(polynomial: Any) -> tuple[Any, Any]:
    """Split into a polynomial in s^2 and one that shares no root with its mirror image."""
    ring, s = polynomial.context(), polynomial.context().gen(0)
    terms = polynomial.to_dict()
    even = ring.from_dict({powers: c for powers, c in terms.items() if powers[0] % 2 == 0})
    odd = polynomial - even
    # what the even and the odd part share; the odd part less its factor s is even as well
    shared = even.gcd(odd // s) if odd != 0 else polynomial
    return shared, polynomial // shared


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
