"""Strain energies of soft motions of stiff structures by compensated summation: their terms cancel.

The same products in twice the working precision project a stiffness, and give the residuals of a refinement.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from dynid.structure.matrices import Matrix, triplets

Array = NDArray[np.float64]

# Dekker's constant: a product with it splits a double into two halves.
_SPLIT = 2.0**27 + 1
# Numbers that a block of products takes at a time: 16 MB each.
_BLOCK = 2_000_000


class StrainEnergy:
    """Strain energies ``x^T K x`` with the product ``K x`` summed in twice the working precision.

    Where x is an eigenvector to working precision, the rest of the error is quadratic in x's: what is left
    is the rounding of the entries of K alone.

    Parameters
    ----------
    K
        Stiffness (n x n), dense or sparse, scaled to where products neither overflow nor underflow.
    """

    def __init__(self, K: Matrix) -> None:
        rows, columns, data = triplets(K)
        kept = data != 0
        rows, columns, data = rows[kept], columns[kept], data[kept]
        # The entries of a row, one after the other; rows of many entries first.
        count = np.bincount(rows, minlength=K.shape[0])
        self._rows = np.argsort(-count, kind="stable")
        rank = np.argsort(self._rows, kind="stable")
        order = np.argsort(rows, kind="stable")
        place = np.arange(len(rows)) - np.repeat(np.cumsum(count) - count, count)
        order = order[np.lexsort((rank[rows[order]], place))]
        self._columns, self._entries = columns[order], data[order]
        self._ends = np.concatenate([[0], np.cumsum(np.bincount(place))]).tolist()
        self._halves = _halves(self._entries)

    def energy(self, shape: Array) -> float:
        """Return the strain energy of a shape (n)."""
        force, lost = (part[:, 0] for part in self._forces(shape[:, None]))
        moved = shape[self._rows]
        work, rest = _product(force, _halves(force), moved)
        return math.fsum([*work.tolist(), *(rest + moved * lost).tolist()])

    def gram(self, left: Array, right: Array) -> Array:
        """Return ``left^T K right`` (a x b) of shapes (n x a, n x b)."""
        out, moved = np.zeros((left.shape[1], right.shape[1])), right[self._rows]
        for columns in self._blocks(left.shape[1]):
            forces = self._forces(left[:, columns])
            for column, force, lost in zip(columns, forces[0].T, forces[1].T, strict=True):
                high, low = _halves(force)
                work, rest = _product(force[:, None], (high[:, None], low[:, None]), moved)
                out[column] = _total(work, rest + moved * lost[:, None])
        return out

    def residual(self, X: Array, B: Array) -> Array:
        """Return ``B - K X`` (n x c), rounded once."""
        out = np.empty_like(B)
        for columns in self._blocks(X.shape[1]):
            force, lost = self._forces(X[:, columns])
            left, error = _sum(B[self._rows][:, columns], -force)
            out[np.ix_(self._rows, columns)] = left + (error - lost)
        return out

    def _blocks(self, columns: int) -> list[NDArray[np.intp]]:
        """Return the columns in blocks whose products fit into memory."""
        each = max(1, _BLOCK // max(1, len(self._entries)))
        return [np.arange(first, min(first + each, columns)) for first in range(0, columns, each)]

    def _forces(self, X: Array) -> tuple[Array, Array]:
        """Return ``K X`` (n x c) and its rounding error, in the order of `_rows`."""
        high, low = self._halves
        product, rest = _product(self._entries[:, None], (high[:, None], low[:, None]), X[self._columns])
        force, lost = np.zeros(X.shape), np.zeros(X.shape)
        for first, last in pairwise(self._ends):
            part = slice(0, last - first)
            force[part], error = _sum(force[part], product[first:last])
            lost[part] += error + rest[first:last]
        return force, lost


def _product(a: Array, halves: tuple[Array, Array], b: Array) -> tuple[Array, Array]:
    """Return rounded products and their errors, of numbers whose halves are known."""
    product = a * b
    (c, d), (e, f) = halves, _halves(b)
    return product, ((c * e - product) + c * f + d * e) + d * f


def _sum(a: Array, b: Array) -> tuple[Array, Array]:
    """Return rounded sums and their errors (D. E. Knuth, The Art of Computer Programming 2, 4.2.2)."""
    total = a + b
    of_b = total - a
    return total, (a - (total - of_b)) + (b - of_b)


def _total(values: Array, rest: Array) -> Array:
    """Return the sums of columns (n x c) and of the errors of their entries, pairwise."""
    while len(values) > 1:
        if len(values) % 2:
            values, rest = (np.concatenate([part, np.zeros_like(part[:1])]) for part in (values, rest))
        half = len(values) // 2
        values, error = _sum(values[:half], values[half:])
        rest = rest[:half] + rest[half:] + error
    return np.asarray(values[0] + rest[0]) if len(values) else np.zeros(values.shape[1])


def _halves(values: Array) -> tuple[Array, Array]:
    """Split doubles into sums of two numbers of half the digits (T. J. Dekker, Numer. Math. 18, 1971)."""
    high = _SPLIT * values
    high = high - (high - values)
    return high, values - high
