"""Scaled pencil of stiffness and mass, and strain energies of soft motions by compensated summation.

In the scaled pencil, translations and rotations, stiff and soft parts compare. The terms of a strain energy
of a soft motion of a stiff structure cancel. The same products in twice the working precision project a
stiffness, and give the residuals of a refinement.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array, finite
from dynid.errors import Singular, UsageError
from dynid.native import call, compiled
from dynid.structure.matrices import Matrix, as_array, is_sparse, triplets


@dataclass(frozen=True, eq=False)
class Pencil:
    """``K`` and ``M`` with rows and columns scaled by `scale` (n), whose entries are powers of two.

    The eigenvalues are those of the matrices as given; a shape is `scale` times a scaled one. `shift` is a
    positive value far below the lowest elastic eigenvalue's upper bound ``min K_ii / M_ii`` (Rayleigh).
    """

    K: Matrix
    M: Matrix
    scale: Array
    shift: float

    @property
    def size(self) -> int:
        """Number of DOFs."""
        return len(self.scale)

    @property
    def without_mass(self) -> NDArray[np.intp]:
        """The massless DOFs (from 0)."""
        return np.flatnonzero(self.M.diagonal() == 0)


# A DOF this much faster by itself than the slowest (in squares), and this much lighter than the heaviest,
# moves without mass to all digits. The first alone would hold for heavy DOFs beside one that is nearly free,
# the other of rotations in large units of length.
_MASSLESS_RATIO = 1e28
# The least shift relative to the bound, large against rounding. The lowest elastic eigenvalue of n DOFs is
# about the bound over n^2 (strings, plates) or more (solids): a shift far below it would make rigid-body
# modes hide it in the inverse.
_LEAST_SHIFT = 1e-10


def scaled(K: Matrix, M: Matrix) -> Pencil:
    """Scale stiffness and mass.

    Raises UsageError if a diagonal entry is negative, or entries are not finite, and Singular if a DOF has
    neither mass nor stiffness.
    """
    for matrix in (K, M):
        finite("a structural matrix", matrix.data if is_sparse(matrix) else as_array(matrix))
    stiffness, mass = K.diagonal(), M.diagonal()
    for what, diagonal, error in (("mass", mass, UsageError), ("stiffness", stiffness, Singular)):
        if np.any(diagonal < 0):
            raise error(
                f"the {what} matrix is indefinite: DOF {np.argmax(diagonal < 0) + 1} has a negative {what}",
                remedy="Check signs and units of the matrix.",
            )
    if np.any(empty := (stiffness == 0) & (mass == 0)):
        raise Singular(
            f"DOF {np.argmax(empty) + 1} has neither mass nor stiffness",
            remedy="Take it out of the model, or join it to something.",
        )
    both = (stiffness > 0) & (mass > 0)
    bound = float((stiffness[both] / mass[both]).min()) if both.any() else 1.0
    light = (
        both & (mass * bound * _MASSLESS_RATIO < stiffness) & (mass * _MASSLESS_RATIO < mass.max(initial=0.0))
    )
    weight = stiffness + bound * mass
    finite("the ratio of stiffness and mass", weight)
    scale = np.exp2(np.round(-0.5 * np.log2(weight)))
    shift = bound * max(float(len(scale)) ** -2, _LEAST_SHIFT)
    return Pencil(_on_both_sides(K, scale), _on_both_sides(M, np.where(light, 0.0, scale)), scale, shift)


def _on_both_sides(matrix: Matrix, scale: Array) -> Matrix:
    if not is_sparse(matrix):
        return as_array(matrix) * scale * scale[:, None]
    from scipy.sparse import csc_array

    out = csc_array(matrix, dtype=float, copy=True)
    out.data *= scale[out.indices]
    out.data *= np.repeat(scale, np.diff(out.indptr))
    return out


def times(matrix: Matrix, X: Array) -> Array:
    """Return a matrix times vectors."""
    return np.asarray(matrix @ X)


#: Modes worked on together: their products with matrices are a small part of the memory of many modes.
_BLOCK = 16


def blocks(count: int) -> list[slice]:
    """Return slices of so many modes for work in blocks of memory."""
    return [slice(first, min(first + _BLOCK, count)) for first in range(0, count, _BLOCK)]


def absolute(matrix: Matrix) -> Matrix:
    """Return a matrix of the absolute values."""
    out: Any = abs(matrix)
    return cast("Matrix", out)


def too_many(count: int, finite: int) -> UsageError:
    """Return the error for more modes than there are."""
    return UsageError(
        f"{count} modes are asked for, but the structure has {finite} with finite frequencies",
        remedy="Ask for fewer; massless DOFs add none.",
        names=("modes",),
    )


# Dekker's constant: a product with it splits a double into two halves.
_SPLIT = 2.0**27 + 1


class StrainEnergy:
    """Strain energies ``x^T K x`` with the product ``K x`` summed in twice the working precision.

    Where x is an eigenvector to working precision, the rest of the error is quadratic in x's: what is left
    is the rounding of the entries of K alone.

    `K`: stiffness (n x n), dense or sparse, scaled to where products neither overflow nor underflow.
    """

    def __init__(self, K: Matrix) -> None:
        if is_sparse(K):
            rows = K.tocsr()  # a copy: K is stored by columns
            rows.sum_duplicates()
            rows.eliminate_zeros()
            starts, columns, data = rows.indptr.astype(np.intp), rows.indices.astype(np.intp), rows.data
        else:
            places, columns, data = triplets(K)  # row by row
            starts = np.searchsorted(places, np.arange(K.shape[0] + 1))
        self._compiled = compiled("dynid_doubled_gram")
        if self._compiled:
            self._columns, self._entries = np.ascontiguousarray(columns), np.ascontiguousarray(data)
            self._starts = np.ascontiguousarray(starts)
            return
        # The first entries of all rows, then the second ones, and so on; rows of many entries first.
        count = np.diff(starts)
        self._rows = np.argsort(-count, kind="stable")
        have = np.searchsorted(-count[self._rows], -np.arange(int(count.max(initial=0))), side="left")
        first = starts[self._rows]
        order = np.concatenate([first[:0], *(first[:n] + offset for offset, n in enumerate(have))])
        self._columns, self._entries = columns[order], data[order]
        self._ends = np.concatenate([[0], np.cumsum(have)]).tolist()
        self._halves = _halves(self._entries)

    def energy(self, shape: Array) -> float:
        """Return the strain energy of a shape (n)."""
        return float(self.gram(shape[:, None], shape[:, None])[0, 0])

    def gram(self, left: Array, right: Array) -> Array:
        """Return ``left^T K right`` (a x b) of shapes (n x a, n x b)."""
        out = np.zeros((left.shape[1], right.shape[1]))
        if self._compiled:
            force, lost = (column.T for column in self._forces(left))
            size, right = (right.shape[0], *out.shape), np.ascontiguousarray(right)
            call("dynid_doubled_gram", *size, force, lost, right, np.empty(2 * out.shape[1]), out)
            return out
        moved = right[self._rows]
        for column, (force, lost) in enumerate(
            zip(*(columns.T for columns in self._forces(left)), strict=True)
        ):
            high, low = _halves(force)
            work, rest = _product(force[:, None], (high[:, None], low[:, None]), moved)
            out[column] = _total(work, rest + moved * lost[:, None])
        return out

    def residual(self, X: Array, B: Array) -> Array:
        """Return ``B - K X`` (n x c), rounded once."""
        out = np.empty_like(B)
        force, lost = self._forces(X)
        rows = slice(None) if self._compiled else self._rows
        left, error = _sum(B[rows], -force)
        out[rows] = left + (error - lost)
        return out

    def _forces(self, X: Array) -> tuple[Array, Array]:
        """Return ``K X`` (n x c) and its rounding error, in the order of `_rows` by NumPy."""
        force, lost = np.zeros(X.shape, order="F"), np.zeros(X.shape, order="F")
        if self._compiled:
            matrix = len(X), self._starts, self._columns, self._entries
            vectors = np.ascontiguousarray(X.T, dtype=float)
            call("dynid_doubled_product", *matrix, X.shape[1], vectors, force.T, lost.T)
            return force, lost
        for column in range(X.shape[1]):
            self._add_force(np.ascontiguousarray(X[:, column]), force[:, column], lost[:, column])
        return force, lost

    def _add_force(self, x: Array, force: Array, lost: Array) -> None:
        """Add ``K x`` and its rounding error, one entry of all rows at a time: in fast memory."""
        (a, b), (c, d) = self._halves, _halves(x)
        for first, last in pairwise(self._ends):
            entries, local = slice(first, last), slice(0, last - first)
            at = self._columns[entries]
            product, high, low = self._entries[entries] * x[at], c[at], d[at]
            rest = ((a[entries] * high - product) + a[entries] * low + b[entries] * high) + b[entries] * low
            force[local], error = _sum(force[local], product)
            lost[local] += error + rest


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
            values, rest = (np.concatenate([rows, np.zeros_like(rows[:1])]) for rows in (values, rest))
        half = len(values) // 2
        values, error = _sum(values[:half], values[half:])
        rest = rest[:half] + rest[half:] + error
    return np.asarray(values[0] + rest[0]) if len(values) else np.zeros(values.shape[1])


def _halves(values: Array) -> tuple[Array, Array]:
    """Split doubles into sums of two numbers of half the digits (T. J. Dekker, Numer. Math. 18, 1971)."""
    high = _SPLIT * values
    high = high - (high - values)
    return high, values - high
