"""Points modulo a large prime, at which a program tells zero from nonzero."""

from __future__ import annotations

import random
from collections.abc import Iterable, Mapping
from fractions import Fraction

from dynid.bondgraph.reduction.program import Point

_LARGEST = (1 << 61) - 1  # a prime


def prime_for(values: Iterable[Fraction]) -> int:
    """Return a large prime that divides no numerator or denominator of these values."""
    from flint import fmpz

    product = 1
    for value in values:
        product *= (value.numerator or 1) * value.denominator
    prime = _LARGEST
    while product % prime == 0:
        prime -= 2
        while not fmpz(prime).is_prime():
            prime -= 2
    return prime


def random_point(names: Iterable[str], prime: int) -> Point:
    """Return a fixed random point: no numbers, only what holds for all of them."""
    source = random.Random(0x5EED)
    laplace = source.randrange(1, prime)
    return Point(prime, {name: source.randrange(1, prime) for name in names}, laplace)


def numeric_point(values: Mapping[str, Fraction], prime: int) -> Point:
    """Return the point at these values and a fixed random s."""
    laplace = random.Random(0xD1F1D).randrange(1, prime)
    images = {name: v.numerator * pow(v.denominator, -1, prime) % prime for name, v in values.items()}
    return Point(prime, images, laplace)
