"""Rational pencils over the integers, and what can be counted of them."""

from __future__ import annotations

import math
from fractions import Fraction
from itertools import islice
from typing import NamedTuple

import numpy as np
from flint import fmpz_mat
from numpy.typing import NDArray

from dynid.lti.pencil.modular import AGREEING, Residues, primes

Rows = list[list[Fraction]]
Real = NDArray[np.float64]


class Structure(NamedTuple):
    """Normal rank, number of finite zeros by multiplicity, and how many of them are 0."""

    rank: int
    finite: int
    origin: int


class IntegerPencil:
    """A rational pencil with rows and columns scaled to integers without common factors.

    Parameters
    ----------
    F, G
        Rows of Fractions; the pencil is sF - G.

    Attributes
    ----------
    F, G
        Flint `fmpz_mat`.
    scale
        What the determinant of the integer pencil is to be multiplied by.
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

    def structure(self) -> Structure:
        """Return what can be counted without finding a single zero."""
        rank = self.rank()
        images = [self.residues(prime).zeros(rank) for prime in islice(primes(), AGREEING)]
        low = [next(k for k, c in enumerate(image.coeffs()) if c) for image in images]
        return Structure(rank, min(image.degree() for image in images), min(low))

    def floats(self) -> tuple[Real, Real]:
        """Return the pencil in floating point, its rows scaled by powers of two to stay in range."""
        rows = [f + g for f, g in zip(self.F.tolist(), self.G.tolist(), strict=True)]
        bits = [max((int(x).bit_length() for x in row), default=0) for row in rows]
        table = np.array(
            [[int(x) / (1 << k) for x in row] for row, k in zip(rows, bits, strict=True)], dtype=float
        ).reshape(len(rows), 2 * self.shape[1])
        return table[:, : self.shape[1]], table[:, self.shape[1] :]
