"""Strain energies of soft motions of stiff structures, whose parts cancel to many digits."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from dynid.structure.matrices import Matrix

Array = NDArray[np.float64]

# Dekker's constant: a product with it splits a double into two halves.
_SPLIT = 2.0**27 + 1


class Strain:
    """Strain energies ``x^T K x`` with the product ``K x`` summed in twice the working precision.

    Where x is an eigenvector to working precision, the rest of the error is quadratic in x's: what is left
    is the rounding of the entries of K alone.

    Parameters
    ----------
    K
        Stiffness (n x n), dense or sparse, scaled to where products neither overflow nor underflow.
    """

    def __init__(self, K: Matrix) -> None:
        from scipy.sparse import coo_array

        entries = coo_array(K)
        kept = entries.data != 0
        rows, columns, data = entries.row[kept], entries.col[kept], entries.data[kept]
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
        product, rest = _product(self._entries, self._halves, shape[self._columns])
        force, lost = np.zeros(len(shape)), np.zeros(len(shape))
        for first, last in pairwise(self._ends):
            part = slice(0, last - first)
            force[part], error = _sum(force[part], product[first:last])
            lost[part] += error + rest[first:last]
        moved = shape[self._rows]
        work, rest = _product(force, _halves(force), moved)
        return math.fsum([*work.tolist(), *(rest + moved * lost).tolist()])


def _product(a: Array, halves: tuple[Array, Array], b: Array) -> tuple[Array, Array]:
    """Return rounded products and what they lost, of numbers whose halves are known."""
    product = a * b
    (c, d), (e, f) = halves, _halves(b)
    return product, ((c * e - product) + c * f + d * e) + d * f


def _sum(a: Array, b: Array) -> tuple[Array, Array]:
    """Return rounded sums and what they lost (D. E. Knuth, The Art of Computer Programming 2, 4.2.2)."""
    total = a + b
    of_b = total - a
    return total, (a - (total - of_b)) + (b - of_b)


def _halves(values: Array) -> tuple[Array, Array]:
    """Split doubles into sums of two numbers of half the digits (T. J. Dekker, Numer. Math. 18, 1971)."""
    high = _SPLIT * values
    high = high - (high - values)
    return high, values - high
