"""Exact dynamic condensation: frequency responses of a structure whose unknown parts act on few coordinates.

With a the coordinates on which unknown parameters act and i the others, the dynamic stiffness at a line is

    [Z_aa  Z_ai]        S = Z_aa - Z_ai Z_ii^-1 Z_ia,   f = b_a - Z_ai Z_ii^-1 b_i,
    [Z_ia  Z_ii],       H = r_i Z_ii^-1 b_i + f(r)^T S^-1 f(b)

for a force b and a read-out r. All but Z_aa is the same whatever the parameters are, and eliminated once: an
evaluation then costs a few coordinates a line, and is exact to rounding for changes of any size.

Source: A. Y. T. Leung, Int. J. Numer. Methods Eng. 12 (1978) 1705–1715.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array, ComplexArray
from dynid.lti.frequency_response import checked_solve

# Elimination pays where at most this part of the coordinates is kept.
_MAX_KEPT_SHARE = 0.6
# Sums whose terms exceed them by this factor lose too many digits: near a resonance of the eliminated part.
_MAX_CANCELLED = 1e4
# Relative singular values of the parts that vary: above the first they count, below the second they are
# rounding. With others between them the rank is unclear.
_COUNTS, _ROUNDING = 1e-9, 1e-13
# Numbers in one block of lines.
_RESPONSE_BLOCK_NUMBERS = 1_000_000


@dataclass(frozen=True, eq=False)
class ActiveCoordinates:
    """Coordinates outside of which some symmetric matrices vanish."""

    places: NDArray[np.intp]  # places of the DOFs that take part (d)
    basis: Array  # orthonormal columns (d x d): the first `count` span what the matrices act on
    count: int  # number of coordinates on which the matrices act (a)

    @classmethod
    def of(cls, parts: Sequence[Array]) -> ActiveCoordinates:
        """Return those of some symmetric matrices (n x n): their DOFs, or combinations of these if fewer."""
        acting = np.any([matrix.any(axis=0) for matrix in parts], axis=0)
        places = np.flatnonzero(acting)
        d = len(places)
        blocks = [matrix[np.ix_(places, places)] for matrix in parts]
        columns = np.concatenate([matrix / np.abs(matrix).max() for matrix in blocks if matrix.any()], axis=1)
        U, sizes, _ = np.linalg.svd(columns)
        sizes = sizes / sizes[0]
        count = int(np.count_nonzero(sizes > _ROUNDING * d))
        if count == d or sizes[count - 1] < _COUNTS:
            return cls(places, np.eye(d), d)
        return cls(places, U, count)

    @property
    def active(self) -> Array:
        """The columns that span what the matrices act on (d x a)."""
        return self.basis[:, : self.count]

    def block(self, matrix: Array) -> Array:
        """Return a matrix (n x n) in the active coordinates (a x a)."""
        return np.asarray(self.active.T @ matrix[np.ix_(self.places, self.places)] @ self.active)

    def rotated(self, columns: Array) -> Array:
        """Return columns (n x any) in other coordinates: the active ones first, then all the others."""
        others = np.delete(columns, self.places, axis=0)
        return np.concatenate([self.basis.T @ columns[self.places], others])


@dataclass(frozen=True, eq=False)
class CondensedLines:
    """Contribution of the eliminated coordinates at each line (L), for the coordinates that are kept (a)."""

    omega: Array  # rad/s
    coordinates: ActiveCoordinates
    stiffness: ComplexArray  # Z_ai Z_ii^-1 Z_ia (L x a x a)
    forces: ComplexArray  # b_a - Z_ai Z_ii^-1 b_i of each direction (L x a x e)
    compliance: ComplexArray  # r_i Z_ii^-1 b_i of each pair of directions (L x pairs)
    usable: NDArray[np.bool_]  # lines that do not lie on a resonance of the eliminated coordinates (L)
    pairs: NDArray[np.intp]  # places of each pair's force and read-out among the directions (2 x pairs)

    def solve(self, M: Array, C: Array, K: Array) -> tuple[ComplexArray, ComplexArray, NDArray[np.bool_]]:
        """Return the receptances of the pairs, the motion of the kept coordinates, and where both are right.

        `M`, `C`, `K`: mass, damping and stiffness (n x n).

        It returns receptances (L x pairs); motion (L x a x e); a mask of the lines (L).
        """
        kept = self.coordinates
        Z, scale = _dynamic_stiffness(kept.block(M), kept.block(C), kept.block(K), self.omega)
        across = scale[:, :, None] * scale[:, None, :]
        right = _beside_probe(scale[:, :, None] * self.forces)
        solution, bad = checked_solve(across * (Z - self.stiffness), right)
        motion = scale[:, :, None] * solution[:, :, :-1]
        force, read = self.pairs
        H = self.compliance + np.sum(self.forces[:, :, read] * motion[:, :, force], axis=1)
        size, subtracted = (
            np.abs(across * matrix).max(axis=(1, 2), initial=0.0) for matrix in (Z, self.stiffness)
        )
        level = np.abs(H) + np.median(np.abs(H), axis=0)
        cancelled = (subtracted > _MAX_CANCELLED * size) | np.any(
            np.abs(self.compliance) > _MAX_CANCELLED * level, axis=1
        )
        return H, motion, self.usable & ~bad & ~cancelled


def condensed_lines(
    matrices: tuple[Array, Array, Array],
    coordinates: ActiveCoordinates,
    ends: Array,
    pairs: NDArray[np.intp],
    omega: Array,
) -> CondensedLines | None:
    """Eliminate all but the active coordinates at each line; None where these are too many for that to pay.

    `matrices`: mass, damping and stiffness (n x n), symmetric; `coordinates`: those to keep (a); `ends`:
    directions of forces and read-outs (e x n); `pairs`: as of `CondensedLines`; `omega`: the lines, rad/s.
    """
    n, a, e = len(matrices[0]), coordinates.count, len(ends)
    if a > _MAX_KEPT_SHARE * n:
        return None
    turned = [coordinates.rotated(coordinates.rotated(matrix).T) for matrix in matrices]
    inner, between = [matrix[a:, a:] for matrix in turned], [matrix[a:, :a] for matrix in turned]
    b = coordinates.rotated(ends.T)
    stiffness = np.empty((len(omega), a, a), dtype=complex)
    forces = np.empty((len(omega), a, e), dtype=complex)
    compliance = np.empty((len(omega), pairs.shape[1]), dtype=complex)
    usable = np.empty(len(omega), dtype=bool)
    chunk = max(1, _RESPONSE_BLOCK_NUMBERS // (n - a) ** 2)
    for first in range(0, len(omega), chunk):
        matrix = slice(first, first + chunk)
        Z, scale = _dynamic_stiffness(inner[0], inner[1], inner[2], omega[matrix])
        s = 1j * omega[matrix, None, None]
        coupling = between[2] + s * between[1] + s**2 * between[0]
        sides = np.broadcast_to(b[a:], (len(Z), n - a, e))
        right = _beside_probe(scale[:, :, None] * np.concatenate([coupling, sides], axis=2))
        solution, bad = checked_solve(scale[:, :, None] * Z * scale[:, None, :], right)
        by_kept, by_end = np.split(scale[:, :, None] * solution[:, :, :-1], [a], axis=2)
        to_kept = coupling.swapaxes(1, 2)
        stiffness[matrix] = to_kept @ by_kept
        forces[matrix] = b[:a] - to_kept @ by_end
        compliance[matrix] = np.einsum("mp,lmp->lp", b[a:, pairs[1]], by_end[:, :, pairs[0]])
        usable[matrix] = ~bad
    return CondensedLines(omega, coordinates, stiffness, forces, compliance, usable, pairs)


def _dynamic_stiffness(M: Array, C: Array, K: Array, omega: Array) -> tuple[ComplexArray, Array]:
    """Return the dynamic stiffness at lines (L x n x n), and scales that balance its diagonal (L x n)."""
    s, w = 1j * omega[:, None, None], omega[:, None]
    size = np.abs(np.diag(K)) + w**2 * np.abs(np.diag(M)) + w * np.abs(np.diag(C))
    return K + s * C + s**2 * M, 1 / np.sqrt(np.where(size > 0, size, 1.0))


def _beside_probe(columns: ComplexArray) -> ComplexArray:
    """Return columns (L x n x any) and a fixed random one, whose growth estimates the condition."""
    probe = np.random.Generator(np.random.PCG64(0)).standard_normal((columns.shape[1], 1))
    return np.concatenate([columns, np.broadcast_to(probe, (*columns.shape[:2], 1))], axis=2)
