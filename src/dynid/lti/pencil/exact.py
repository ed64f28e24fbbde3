"""Determinants and finite zeros of rational pencils, exactly, from images modulo many primes.

The determinant of a square pencil is put together by the Chinese remainder theorem from as many images as
Hadamard's bound on its coefficients asks for, block by block of the block triangular form. The finite
(Smith) zeros of a pencil that is not square or not of full rank are a factor of one of its largest minors;
their images are the common factors with the determinant of a random compression.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from flint import fmpz_mat, fmpz_poly

from dynid.lti.pencil.blocks import diagonal_blocks
from dynid.lti.pencil.integer import IntegerPencil
from dynid.lti.pencil.modular import AGREEING, Residues, primes


def zeros(pencil: IntegerPencil) -> tuple[Any, int]:
    """Return the polynomial of the finite zeros, repeated (flint `fmpz_poly`), and the rank."""
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
        product *= _of_block(_part(F, rows, columns), _part(G, rows, columns))
    return _signed(product, Residues(F, G, next(primes(seed=2))))


def _of_block(F: Any, G: Any) -> Any:
    if F.nrows() == 1:
        return fmpz_poly([-G[0, 0], F[0, 0]])
    bits, size, source = _hadamard_bits(F, G), F.nrows(), primes()
    images: list[Any] = []
    moduli: list[int] = []
    while sum(prime.bit_length() - 1 for prime in moduli) < bits:
        moduli.append(next(source))
        images.append(Residues(F, G, moduli[-1]).determinant())
        if len(images) == AGREEING and not any(images):
            return fmpz_poly([])
    return combined(images, moduli, size)


def _signed(product: Any, residues: Residues) -> Any:
    """Give the product of the blocks the sign that the order of their rows and columns has; a check too."""
    P, s0 = residues.shifted()
    expected, value = int(P.det()), int(product(s0) % residues.prime)
    if expected == value:
        return product
    if (expected + value) % residues.prime:
        raise ArithmeticError("the blocks of a pencil disagree with its determinant")
    return -product


def combined(images: list[Any], moduli: list[int], degree: int) -> Any:
    """Return the integer polynomial with the given images whose coefficients are smallest."""
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
    # Mignotte: a factor, its leading coefficient made that of the whole, is this small
    norm = math.isqrt(sum(int(c) ** 2 for c in minor.coeffs())) + 1
    bits = norm.bit_length() + minor.degree() + 2
    degree = minor.degree() + 1
    images: list[Any] = []
    moduli: list[int] = []
    while len(moduli) < AGREEING or sum(prime.bit_length() - 1 for prime in moduli) < bits:
        prime = next(source)
        if lead % prime == 0:
            continue
        other = pencil.residues(prime).compressed(rank)
        image = type(other)([int(c % prime) for c in minor.coeffs()], prime).gcd(other)
        if image.degree() == 0:
            return fmpz_poly([1])
        if image.degree() < degree:
            degree, images, moduli = image.degree(), [], []
        if image.degree() == degree:
            images.append(image * (lead % prime))
            moduli.append(prime)
    found = combined(images, moduli, degree)
    return found // found.content()


def _part(M: Any, rows: Any, columns: Any) -> Any:
    return fmpz_mat(len(rows), len(columns), [M[int(i), int(j)] for i in rows for j in columns])


def _hadamard_bits(F: Any, G: Any) -> int:
    """Return how many bits the coefficients of det(sF - G) can have, sign included."""
    pairs = zip(F.tolist(), G.tolist(), strict=True)
    sizes = [[int(abs(f) + abs(g)) for f, g in zip(*rows, strict=True)] for rows in pairs]
    products = [
        math.prod(math.isqrt(sum(x * x for x in line)) + 1 for line in lines)
        for lines in (sizes, zip(*sizes, strict=True))
    ]
    return min(products).bit_length() + 2
