"""Modes of many structures that differ in numbers alone, side by side in stacks of matrices.

Modes are found by one decomposition of the inverse problem, ``L^-1 M L^-T`` with ``K = L L^T``, and squared
frequencies far above the lowest by Rayleigh quotients. A mode is `certain` in the usual case: its structure
has mass at all DOFs, it is elastic and separate from others. Where `dynid.structure.modes` sums energies in
twice the working precision, numbers differ by the rounding of the matrices' entries, which `uncertainty`
bounds.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array
from dynid.structure.modes.pencil import StrainEnergy

Sure = NDArray[np.bool_]

UNIT_ROUNDING = float(np.finfo(float).eps) / 2
RIGID_STRAIN = 1e-12
"""Strain energy relative to its terms below which a motion may be rigid."""

# Strain energy relative to its terms below which it is summed in twice the working precision.
_SOFT_STRAIN = 1e-6
# From this ratio to the lowest squared frequency on a Rayleigh quotient has fewer errors than the inverse.
_RAYLEIGH_RATIO = 100.0
# Frequencies nearer to each other, relative to the higher one, may have any shapes between them.
_MIN_SEPARATION = 1e-6
_MAX_RESIDUAL = 1e-11
# A pivot of the scaled stiffness below which a structure may be free; it is then shifted by this part of the
# bound on its squared frequencies.
_MIN_PIVOT, _SHIFT = 1e-8, 1e-2


class StackedModes(NamedTuple):
    """Modes of structures.

    `omega` (s x r), rad/s; `shapes` (s x n x r), of unit modal mass; `uncertainty` (s x r), rad/s, as of
    `Modes`; `certain` (s x r), which are elastic and separate from others.
    """

    omega: Array
    shapes: Array
    uncertainty: Array
    certain: Sure

    @property
    def sure(self) -> Sure:
        """The structures all of whose modes here are certain (s)."""
        return np.asarray(self.certain.all(axis=1))

    def numbered(self, numbers: Sequence[int]) -> StackedModes:
        """Return some modes, by their numbers from 1."""
        arrays: tuple[Any, ...] = self
        columns = np.array(numbers, dtype=np.intp) - 1
        return StackedModes(*(array[..., columns] for array in arrays))


class Stack:
    """Mass, damping and stiffness of structures (s x n x n), whose modes are found once."""

    def __init__(self, M: Array, C: Array, K: Array) -> None:
        self.M, self.C, self.K = M, C, K
        self._lowest: StackedModes | None = None
        self._blocks: dict[tuple[int, ...], Stack] = {}

    def __getitem__(self, samples: NDArray[np.intp]) -> Stack:
        """Return some of the structures."""
        return Stack(self.M[samples], self.C[samples], self.K[samples])

    def block(self, dofs: NDArray[np.intp]) -> Stack:
        """Return the structures whose DOFs other than these are held."""
        key = tuple(dofs.tolist())
        if key not in self._blocks:
            rows = (slice(None), dofs[:, None], dofs)
            self._blocks[key] = Stack(self.M[rows], self.C[rows], self.K[rows])
        return self._blocks[key]

    def projected(self, T: Array) -> Stack:
        """Return the structures in coordinates q with ``x = T q``."""
        return Stack(*(congruent(T, matrix) for matrix in (self.M, self.C, self.K)))

    def modes(self, count: int) -> StackedModes:
        """Return the lowest modes."""
        if self._lowest is None or self._lowest.omega.shape[1] < count:
            self._lowest = self._refined(count)
        return self._lowest.numbered(range(1, count + 1))

    @property
    def frequencies(self) -> Array:
        """All natural frequencies to a few digits, rad/s, ascending (s x n); infinite where none is found."""
        inverse = self._inverse_modes
        positive = inverse.values > 0
        square = 1 / np.where(positive, inverse.values, 1.0) - inverse.shift[:, None]
        return np.asarray(np.sqrt(np.where(positive, np.maximum(square, 0.0), np.inf)))

    @cached_property
    def _inverse_modes(self) -> _InverseModes:
        stiffness, mass = diagonal(self.K), diagonal(self.M)
        sure = np.all((stiffness > 0) & (mass > 0), axis=1)
        stiffness, mass = (np.where(sure[:, None], entries, 1.0) for entries in (stiffness, mass))
        bound = (stiffness / mass).min(axis=1, keepdims=True)
        scale = np.exp2(np.round(-0.5 * np.log2(stiffness + bound * mass)))
        sides = scale[:, :, None] * scale[:, None, :]
        K, M = self.K * sides, self.M * sides
        shift = np.zeros(len(K))
        L, held = _cholesky(K)
        free = ~held | ((diagonal(L) ** 2).min(axis=1, initial=1.0) < _MIN_PIVOT)
        if free.any():  # rigid-body modes, or nearly: their inertia holds them
            shift[free] = _SHIFT * bound[free, 0]
            L[free], held[free] = _cholesky(K[free] + shift[free, None, None] * M[free])
        inverse = np.asarray(np.linalg.inv(L), dtype=float)
        A = inverse @ M @ transposed(inverse)
        values, vectors = np.linalg.eigh((A + transposed(A)) / 2)
        return _InverseModes(K, M, scale, shift, inverse, values[:, ::-1], vectors[:, :, ::-1], sure & held)

    def _refined(self, count: int) -> StackedModes:
        """Return modes with their squared frequencies to all digits, and normed shapes."""
        K, M, scale, shift, inverse, values, vectors, sure = self._inverse_modes
        kept = min(count + 1, K.shape[-1])  # one more tells whether the last is separate
        values, vectors = values[:, :kept], vectors[:, :, :kept]
        certain = sure[:, None] & (values > 0)
        values = np.where(certain, values, 1.0)
        shapes = transposed(inverse) @ vectors / np.sqrt(values)[:, None, :]
        size = np.abs(shapes)
        Kx, Mx, strain_terms = K @ shapes, M @ shapes, np.abs(K) @ size
        strain, inertia = (shapes * Kx).sum(axis=1), (shapes * Mx).sum(axis=1)
        sum_of_terms, mass_terms = ((size * terms).sum(axis=1) for terms in (strain_terms, np.abs(M) @ size))
        by_energy = (values[:, :1] > _RAYLEIGH_RATIO * values) | (shift > 0)[:, None]
        square = np.where(by_energy, strain / inertia, 1 / values)
        certain &= strain > RIGID_STRAIN * sum_of_terms
        for s, mode in zip(*np.nonzero((square < _SOFT_STRAIN * sum_of_terms) & certain), strict=True):
            square[s, mode] = StrainEnergy(K[s]).energy(shapes[s, :, mode]) / inertia[s, mode]
        sizes = np.linalg.norm(strain_terms + np.abs(square)[:, None, :] * (np.abs(M) @ size), axis=1)
        residuals = np.linalg.norm(Kx - square[:, None, :] * Mx, axis=1) / np.where(sizes > 0, sizes, 1.0)
        certain &= (residuals < _MAX_RESIDUAL) & (square > 0)
        omega = np.sqrt(np.maximum(square, 0.0))
        separate = np.diff(omega, axis=1) > _MIN_SEPARATION * omega[:, 1:]
        certain[:, 1:] &= separate
        certain[:, :-1] &= separate
        omega = np.where(certain, omega, 1.0)
        shapes = scale[:, :, None] * shapes
        # The largest component is positive: the first of those as large but for rounding.
        size = np.abs(shapes)
        largest = (size >= (1 - 1e-6) * size.max(axis=1, keepdims=True)).argmax(axis=1)[:, None, :]
        shapes = shapes * np.where(np.take_along_axis(shapes, largest, axis=1) < 0, -1.0, 1.0)
        uncertainty = UNIT_ROUNDING * (sum_of_terms / omega + np.maximum(mass_terms, 1.0) * omega)
        return StackedModes(
            omega[:, :count], shapes[:, :, :count], uncertainty[:, :count], certain[:, :count]
        )


class _InverseModes(NamedTuple):
    """Scaled K and M, the scales, shifts of K by M, inverse Cholesky factors, eigenpairs of ``L^-1 M L^-T``.

    The largest eigenvalues are first.
    """

    K: Array
    M: Array
    scale: Array
    shift: Array
    inverse: Array
    values: Array
    vectors: Array
    sure: Sure


def diagonal(A: Array) -> Array:
    """Return the sizes of diagonal entries."""
    return np.asarray(np.abs(np.einsum("sii->si", A)))


def transposed(X: Array) -> Array:
    """Return the transposes of matrices."""
    return X.swapaxes(-1, -2)


def _cholesky(A: Array) -> tuple[Array, Sure]:
    """Return Cholesky factors, unity where there is none, and where there is one."""
    try:
        L = np.asarray(np.linalg.cholesky(A), dtype=float)
        return L, np.ones(len(A), dtype=bool)
    except np.linalg.LinAlgError:
        definite = np.linalg.eigvalsh(A)[:, 0] > 0
        L = np.broadcast_to(np.eye(A.shape[-1]), A.shape).copy()
        for s in np.flatnonzero(definite):
            try:
                L[s] = np.linalg.cholesky(A[s])
            except np.linalg.LinAlgError:
                definite[s] = False
        return L, definite


def congruent(T: Array, matrix: Array) -> Array:
    """Return ``T^T matrix T``, symmetric."""
    product = transposed(T) @ matrix @ T
    return np.asarray((product + transposed(product)) / 2)
