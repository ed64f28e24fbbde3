"""Points modulo a large prime, at which a program tells zero from nonzero."""

from __future__ import annotations

import random
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from fractions import Fraction
from itertools import count

from dynid.bondgraph.reduction.program import Point

_LARGEST = (1 << 61) - 1  # a prime


def primes() -> Iterator[int]:
    """Yield large primes, the largest first."""
    from flint import fmpz

    return (candidate for candidate in range(_LARGEST, 1, -2) if fmpz(candidate).is_prime())


def prime_for(values: Iterable[Fraction]) -> int:
    """Return a large prime that divides no numerator or denominator of these values."""
    return next(_fitting(values))


def _fitting(values: Iterable[Fraction]) -> Iterator[int]:
    parts = {part for value in values for part in (value.numerator or 1, value.denominator)}
    return (prime for prime in primes() if all(part % prime for part in parts))


def random_point(names: Iterable[str], prime: int) -> Point:
    """Return a fixed random point: no numbers, only what holds for all of them."""
    from flint import nmod

    source = random.Random(0x5EED)
    laplace = nmod(source.getrandbits(60), prime)
    return Point(prime, {name: nmod(source.getrandbits(60), prime) for name in names}, laplace)


def numeric_point(values: Mapping[str, Fraction], prime: int) -> Point:
    """Return the point at these values and a fixed random s."""
    from flint import nmod

    laplace = nmod(random.Random(0xD1F1D).randrange(1, prime), prime)
    images = {name: nmod(v.numerator, prime) / nmod(v.denominator, prime) for name, v in values.items()}
    return Point(prime, images, laplace)


def axis_point(values: Mapping[str, Fraction], omega: Fraction) -> Point:
    """Return the point at these values and s = j omega, modulo a prime that has a square root of -1."""
    from flint import nmod

    prime = next(prime for prime in _fitting([*values.values(), omega]) if prime % 4 == 1)
    roots = (pow(base, (prime - 1) // 4, prime) for base in count(2))
    j = next(root for root in roots if root * root % prime == prime - 1)
    point = numeric_point(values, prime)
    return replace(point, laplace=nmod(j * omega.numerator, prime) / nmod(omega.denominator, prime))
