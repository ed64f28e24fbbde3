"""Rational pencils sF - G: normal rank, determinant and finite zeros, exactly, from images modulo primes.

The determinant of a square pencil is combined by the Chinese remainder theorem from as many images as
Hadamard's bound on its coefficients requires, block by block of the block triangular form. The finite
(Smith) zeros of a pencil that is not square or not of full rank are a factor of one of its largest minors;
their images are the common factors with the determinant of a random compression.

A prime of 62 bits, drawn by a seeded generator, divides a given nonzero integer of b bits with a probability
below b 2^-60; a random shift or compression fails with one below n 2^-60. A result on which three primes
agree is therefore wrong with a probability below 2^-100 for any pencil that fits a computer.
"""

from __future__ import annotations

import math
import random
from collections.abc import Iterator
from fractions import Fraction
from itertools import islice
from typing import Any, NamedTuple

import numpy as np
from flint import fmpz, fmpz_mat, fmpz_poly, nmod_mat, nmod_poly
from numpy.typing import NDArray

from dynid.lti.pencil.eigenvalues import diagonal_blocks

Rows = list[list[Fraction]]
Real = NDArray[np.float64]
#: Bits of the primes, number of primes that decide a structure, number of shifts that prove singularity.
_PRIME_BITS, AGREEING, _RANDOM_SHIFTS = 62, 3, 3


class PencilStructure(NamedTuple):
    """Normal rank, number of finite zeros by multiplicity, and number of zeros at the origin."""

    rank: int
    finite: int
    origin: int


class IntegerPencil:
    """A rational pencil sF - G with rows and columns scaled to integers without common factors.

    `scale` is the factor from the determinant of the integer pencil to that of the given one.
    """

    def __init__(self, F: Rows, G: Rows, columns: int) -> None:
        self.shape = len(F), columns
        rows: list[list[int]] = []
        scale = Fraction(1)
        for f, g in zip(F, G, strict=True):
            exact = [*f, *g]
            factor = Fraction(
                math.gcd(*(x.numerator for x in exact)) or 1, math.lcm(*(x.denominator for x in exact))
            )
            rows.append([int(x / factor) if x else 0 for x in exact])
            scale *= factor
        for j in range(columns):
            common = math.gcd(*(row[k] for row in rows for k in (j, columns + j))) or 1
            if common > 1:
                scale *= common
                for row in rows:
                    row[j] //= common
                    row[columns + j] //= common
        self.scale = scale
        self.F = fmpz_mat(len(F), columns, [x for row in rows for x in row[:columns]])
        self.G = fmpz_mat(len(F), columns, [x for row in rows for x in row[columns:]])

    def residues(self, prime: int) -> Residues:
        """Return the pencil modulo a prime."""
        return Residues(self.F, self.G, prime)

    def rank(self) -> int:
        """Return the normal rank."""
        return max(self.residues(prime).rank() for prime in islice(primes(), AGREEING))

    def structure(self) -> PencilStructure:
        """Return the structure, which is known without computing the zeros."""
        rank = self.rank()
        images = [self.residues(prime).zeros(rank) for prime in islice(primes(), AGREEING)]
        low = [next(k for k, c in enumerate(image.coeffs()) if c) for image in images]
        return PencilStructure(rank, min(image.degree() for image in images), min(low))

    def floats(self) -> tuple[Real, Real]:
        """Return the pencil in floating point, its rows scaled by powers of two to stay in range."""
        rows = [f + g for f, g in zip(self.F.tolist(), self.G.tolist(), strict=True)]
        bits = [max((int(x).bit_length() for x in row), default=0) for row in rows]
        table = np.array(
            [[int(x) / (1 << k) for x in row] for row, k in zip(rows, bits, strict=True)], dtype=float
        ).reshape(len(rows), 2 * self.shape[1])
        return table[:, : self.shape[1]], table[:, self.shape[1] :]


def zeros(pencil: IntegerPencil) -> tuple[Any, int]:
    """Return the polynomial of the finite zeros with multiplicity (flint `fmpz_poly`), and the rank."""
    rank = pencil.rank()
    if pencil.shape == (rank, rank):
        return determinant(pencil.F, pencil.G), rank
    return _common_zeros(pencil, rank), rank


def determinant(F: Any, G: Any) -> Any:
    """Return det(sF - G) of a square integer pencil (flint `fmpz_mat`) as a flint `fmpz_poly`."""
    from scipy.sparse import csr_array

    pattern = np.array([bool(f) or bool(g) for f, g in zip(F.entries(), G.entries(), strict=True)])
    blocks = diagonal_blocks(csr_array(pattern.reshape(F.nrows(), F.ncols()).astype(np.int8)))
    if blocks is None:
        return fmpz_poly([])
    product = fmpz_poly([1])
    for rows, columns in blocks:
        product *= _block_determinant(_part(F, rows, columns), _part(G, rows, columns))
    # The order of rows and columns in the blocks gives the sign; checked modulo a prime.
    residues = Residues(F, G, next(primes(seed=2)))
    P, s0 = residues.shifted()
    expected, value = int(P.det()), int(product(s0) % residues.prime)
    if expected == value:
        return product
    if (expected + value) % residues.prime:
        raise ArithmeticError("the blocks of a pencil disagree with its determinant")
    return -product


def _block_determinant(F: Any, G: Any) -> Any:
    """Return the determinant of one block, from as many images as Hadamard's bound requires."""
    if F.nrows() == 1:
        return fmpz_poly([-G[0, 0], F[0, 0]])
    pairs = zip(F.tolist(), G.tolist(), strict=True)
    sizes = [[int(abs(f) + abs(g)) for f, g in zip(*rows, strict=True)] for rows in pairs]
    products = [
        math.prod(math.isqrt(sum(x * x for x in line)) + 1 for line in lines)
        for lines in (sizes, zip(*sizes, strict=True))
    ]
    bits, source = min(products).bit_length() + 2, primes()
    images: list[Any] = []
    moduli: list[int] = []
    while sum(prime.bit_length() - 1 for prime in moduli) < bits:
        moduli.append(next(source))
        images.append(Residues(F, G, moduli[-1]).determinant())
        if len(images) == AGREEING and not any(images):
            return fmpz_poly([])
    return combined(images, moduli, F.nrows())


def combined(images: list[Any], moduli: list[int], degree: int) -> Any:
    """Return the integer polynomial of smallest coefficients with the given images."""
    modulus = math.prod(moduli)
    weights = [modulus // p * pow(modulus // p, -1, p) for p in moduli]
    table = fmpz_mat(degree + 1, len(moduli), [int(f[k]) for k in range(degree + 1) for f in images])
    residues = [int(x) % modulus for x in (table * fmpz_mat(len(moduli), 1, weights)).entries()]
    return fmpz_poly([x - modulus if 2 * x > modulus else x for x in residues])


def _common_zeros(pencil: IntegerPencil, rank: int) -> Any:
    """Return the gcd of all minors of the rank's size, as a factor of one of them."""
    source = primes(seed=1)
    rows, columns = pencil.residues(next(source)).minor()
    minor = determinant(_part(pencil.F, rows, columns), _part(pencil.G, rows, columns))
    lead = int(minor.leading_coefficient())
    # Mignotte's bound on the coefficients of a factor with the leading coefficient of the minor
    norm = math.isqrt(sum(int(c) ** 2 for c in minor.coeffs())) + 1
    bits = norm.bit_length() + minor.degree() + 2
    degree = minor.degree() + 1
    images: list[Any] = []
    moduli: list[int] = []
    while len(moduli) < AGREEING or sum(prime.bit_length() - 1 for prime in moduli) < bits:
        prime = next(source)
        if lead % prime == 0:
            continue
        pair = pencil.residues(prime).compressed(rank)
        image = type(pair)([int(c % prime) for c in minor.coeffs()], prime).gcd(pair)
        if image.degree() == 0:
            return fmpz_poly([1])
        if image.degree() < degree:
            degree, images, moduli = image.degree(), [], []
        if image.degree() == degree:
            images.append(image * (lead % prime))
            moduli.append(prime)
    combination = combined(images, moduli, degree)
    return combination // combination.content()


def _part(M: Any, rows: Any, columns: Any) -> Any:
    return fmpz_mat(len(rows), len(columns), [M[int(i), int(j)] for i in rows for j in columns])


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
        """Return rows and columns of a largest nonzero minor."""
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
            determinant = self.determinant()
            return determinant / determinant.leading_coefficient() if determinant else determinant
        return self.compressed(rank).gcd(self.compressed(rank))

    def _noise(self, rows: int, columns: int) -> Any:
        entries = [self.random.randrange(self.prime) for _ in range(rows * columns)]
        return nmod_mat(rows, columns, entries, self.prime)


def primes(seed: int = 0) -> Iterator[int]:
    """Yield different random primes below 2^62, the same for the same seed."""
    generator, seen = random.Random(seed), set()
    while True:
        prime = generator.getrandbits(_PRIME_BITS) | (1 << (_PRIME_BITS - 1)) | 1
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
    for _ in range(_RANDOM_SHIFTS):
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
