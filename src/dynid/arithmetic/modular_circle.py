"""Points on the circle x^2 + y^2 = 1 modulo a prime P of which -1 is no square: a group of P + 1 angles."""

from __future__ import annotations

from functools import lru_cache
from random import Random

from flint import fmpz

#: Cosine and sine.
Point = tuple[int, int]
#: Bits of a number that is factored wholly; of the factors that are sought in longer ones.
_FACTORED_BITS, _SMOOTH_BITS = 80, 20


def is_square(image: int, prime: int) -> bool:
    """Test whether a residue is a square."""
    return fmpz(image).jacobi(prime) >= 0


@lru_cache(maxsize=4096)
def prime_factors(number: int) -> list[tuple[int, int]]:
    """Return the factors of a positive number, and their powers; what has no small factor is left whole."""
    small = number.bit_length() <= _FACTORED_BITS
    factors = fmpz(number).factor() if small else fmpz(number).factor_smooth(_SMOOTH_BITS)
    return [(int(base), int(power)) for base, power in factors]


class ModularCircle:
    """The circle modulo a prime, -1 modulo the order of the unit, a multiple of 8."""

    def __init__(self, prime: int, order: int) -> None:
        self.prime, self.order = prime, order

    def random_point(self, random: Random) -> Point:
        """Return a random point."""
        t = random.randrange(2, self.prime)
        scale = pow(1 + t * t, -1, self.prime)
        return (1 - t * t) * scale % self.prime, 2 * t * scale % self.prime

    def unit(self, random: Random) -> Point:
        """Return the point at 2 pi / order, one at which the roots of primes have their signs."""
        p, order = self.prime, self.order
        while True:
            point = self.times(self.random_point(random), (p + 1) // order)
            primes = [base for base, _ in prime_factors(order)]
            if any(self.times(point, order // base) == (1, 0) for base in primes):
                continue
            if self.times(point, order // 4) != (0, 1):
                continue
            if all(is_square(self._root_by_sines(point, base), p) for base in primes):
                return point

    def _root_by_sines(self, unit: Point, base: int) -> int:
        """Return sqrt(q) as the product of 2 sin(k pi / q), k < q/2; sqrt(2) as 2 cos(pi/4)."""
        p, order = self.prime, self.order
        if base == 2:
            return 2 * self.times(unit, order // 8)[0] % p
        step = self.times(unit, order // (2 * base))
        point, product = step, 1
        for _ in range((base - 1) // 2):
            product = product * 2 * point[1] % p
            point = self.turned(point, step)
        return product

    def turned(self, a: Point, b: Point) -> Point:
        """Return the point at the sum of two angles."""
        p = self.prime
        return (a[0] * b[0] - a[1] * b[1]) % p, (a[0] * b[1] + a[1] * b[0]) % p

    def times(self, point: Point, count: int) -> Point:
        """Return a multiple of an angle."""
        result = (1, 0)
        if count < 0:
            point, count = (point[0], -point[1] % self.prime), -count
        while count:
            if count & 1:
                result = self.turned(result, point)
            point, count = self.turned(point, point), count >> 1
        return result
