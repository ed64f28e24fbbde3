"""Points and samples modulo a large prime, at which a program distinguishes zero from nonzero."""

from __future__ import annotations

import random
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from itertools import count
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.bondgraph.program.program import ModularPoint

# --- points ---------------------------------------------------------------------------------------

# A prime near 10^18 sqrt(5), far from powers of two and ten: modulo 2^61 - 1, for example, 2^61 is 1, and
# binary fractions that differ by this factor are the same.
_LARGEST = 2236067977499789659


def primes() -> Iterator[int]:
    """Yield large primes, the largest first."""
    from flint import fmpz

    return (candidate for candidate in range(_LARGEST, 1, -2) if fmpz(candidate).is_prime())


def prime_for(values: Iterable[Fraction]) -> int:
    """Return a large prime that divides no numerator or denominator of these values."""
    return next(primes_for(values))


def primes_for(values: Iterable[Fraction]) -> Iterator[int]:
    """Yield large primes that divide no numerator or denominator of these values."""
    parts = [part for value in values for part in value.as_integer_ratio() if part]
    largest = max(map(abs, parts), default=1)
    return (prime for prime in primes() if largest < prime or all(part % prime for part in parts))


def random_point(names: Iterable[str], prime: int) -> ModularPoint:
    """Return a fixed random point: no numbers, only what holds for all of them."""
    from flint import nmod

    source = random.Random(0x5EED)
    laplace = nmod(source.getrandbits(60), prime)
    return ModularPoint(
        prime, {name: nmod(source.getrandbits(60), prime) for name in names}, laplace, general=True
    )


def numeric_point(values: Mapping[str, Fraction], prime: int) -> ModularPoint:
    """Return the point at these values and a fixed random s."""
    from flint import nmod

    laplace = nmod(random.Random(0xD1F1D).randrange(1, prime), prime)
    images = {name: nmod(v.numerator, prime) / nmod(v.denominator, prime) for name, v in values.items()}
    return ModularPoint(prime, images, laplace)


def axis_point(values: Mapping[str, Fraction], omega: Fraction) -> ModularPoint:
    """Return the point at these values and s = j omega, modulo a prime that has a square root of -1."""
    from flint import nmod

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

    Parameters
    ----------
    images
        The residues.
    vanished
        Samples in which something was divided by zero; shared by all numbers of a run, and added to.
    """

    __slots__ = ("images", "vanished")

    def __init__(self, images: ResidueArray, vanished: NDArray[np.bool_]) -> None:
        self.images = images
        self.vanished = vanished

    @classmethod
    def of(cls, values: Sequence[Fraction], vanished: NDArray[np.bool_]) -> SampledResidues:
        """Return the residues of exact values, one a sample."""
        above, below = (
            np.array([part % PRIME for part in parts], dtype=np.int64)
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
