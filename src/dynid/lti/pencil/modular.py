"""Pencils modulo a prime: normal rank, determinant, and the finite zeros, exactly and cheaply.

A prime of 62 bits, drawn by a seeded generator, divides a given nonzero integer of b bits with a probability
below b 2^-60; a random shift or compression is unlucky with one below n 2^-60. What three primes agree on is
therefore wrong with a probability below 2^-100 for any pencil that fits a computer.
"""

from __future__ import annotations

import random
from collections.abc import Iterator
from typing import Any

from flint import fmpz, nmod_mat, nmod_poly

#: Size of the primes, how many decide a structure, and how many shifts show that a pencil is singular.
_BITS, AGREEING, _SHIFTS = 62, 3, 3


class Residues:
    """The pencil sF - G (flint `fmpz_mat`, any shape) modulo a prime."""

    def __init__(self, F: Any, G: Any, prime: int, seed: int = 0) -> None:
        self.prime = prime
        self.random = random.Random(f"{prime} {seed}")
        self.F, self.G = nmod_mat(F, prime), nmod_mat(G, prime)

    def shifted(self) -> tuple[Any, int]:
        """Return s0 F - G at a random s0, and s0."""
        s0 = self.random.randrange(1, self.prime)
        return self.F * s0 - self.G, s0

    def rank(self) -> int:
        """Return the normal rank (never too large)."""
        return int(self.shifted()[0].rank())

    def minor(self) -> tuple[list[int], list[int]]:
        """Return rows and columns of a largest minor that does not vanish."""
        P, _ = self.shifted()
        return _pivots(P.transpose()), _pivots(P)

    def determinant(self) -> Any:
        """Return det(sF - G) of a square pencil as a polynomial (flint `nmod_poly`)."""
        return _determinant(self.F, self.G, self)

    def compressed(self, rank: int) -> Any:
        """Return det(U (sF - G) V) with random U and V of as many rows and columns as the rank."""
        U, V = self._noise(rank, self.F.nrows()), self._noise(self.F.ncols(), rank)
        return _determinant(U * self.F * V, U * self.G * V, self)

    def zeros(self, rank: int) -> Any:
        """Return the monic polynomial of the finite zeros: the gcd of all minors of the rank's size."""
        if self.F.nrows() == self.F.ncols() == rank:
            found = self.determinant()
            return found / found.leading_coefficient() if found else found
        return self.compressed(rank).gcd(self.compressed(rank))

    def _noise(self, rows: int, columns: int) -> Any:
        entries = [self.random.randrange(self.prime) for _ in range(rows * columns)]
        return nmod_mat(rows, columns, entries, self.prime)


def primes(seed: int = 0) -> Iterator[int]:
    """Yield different random primes below 2^62, the same for the same seed."""
    generator, seen = random.Random(seed), set()
    while True:
        prime = generator.getrandbits(_BITS) | (1 << (_BITS - 1)) | 1
        while not fmpz(prime).is_prime():
            prime += 2
        if prime not in seen:
            seen.add(prime)
            yield prime


def _determinant(F: Any, G: Any, residues: Residues) -> Any:
    """Return det(sF - G): a characteristic polynomial, of F^-1 G or about a shift."""
    size, prime = F.nrows(), residues.prime
    if size == 0:
        return nmod_poly([1], prime)
    if lead := F.det():
        return F.solve(G).charpoly() * lead
    for _ in range(_SHIFTS):
        s0 = residues.random.randrange(1, prime)
        P = F * s0 - G
        if level := P.det():
            # det(P + t F) = det P det(I + t P^-1 F), reversed from the characteristic polynomial
            coefficients = P.solve(F).charpoly().coeffs()[::-1]
            about = nmod_poly([c if k % 2 == 0 else -c for k, c in enumerate(coefficients)], prime)
            return about(nmod_poly([prime - s0, 1], prime)) * level
    return nmod_poly([], prime)


def _pivots(P: Any) -> list[int]:
    """Return independent columns of a matrix."""
    echelon, rank = P.rref()
    rows = echelon.tolist()
    return [next(j for j, entry in enumerate(rows[i]) if entry) for i in range(rank)]
