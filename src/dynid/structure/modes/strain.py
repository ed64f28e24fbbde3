"""Strain energies of soft motions of stiff structures, whose parts cancel to many digits."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Dekker's constant: a product with it splits a double into two halves.
_SPLIT = 2.0**27 + 1


def strain_energy(K: Array, shape: Array) -> float:
    """Return ``x^T K x`` with the product ``K x`` correctly rounded.

    Where x is an eigenvector to working precision, the rest of the error is quadratic in x's: what is left
    is the rounding of the entries of K alone.

    Parameters
    ----------
    K
        Stiffness (n x n), scaled to where products neither overflow nor underflow.
    shape
        The shape x (n).
    """
    rows, columns = np.nonzero(K * shape)
    entries, parts = K[rows, columns], shape[columns]
    product = entries * parts
    (a, b), (c, d) = _halves(entries), _halves(parts)
    rest = ((a * c - product) + a * d + b * c) + b * d
    force = np.zeros(len(K))
    ends = np.searchsorted(rows, np.arange(len(K) + 1))
    for row, (first, last) in enumerate(pairwise(ends.tolist())):
        force[row] = math.fsum([*product[first:last].tolist(), *rest[first:last].tolist()])
    return math.fsum((shape * force).tolist())


def _halves(values: Array) -> tuple[Array, Array]:
    """Split doubles into sums of two numbers of half the digits (T. J. Dekker, Numer. Math. 18, 1971)."""
    high = _SPLIT * values
    high = high - (high - values)
    return high, values - high
