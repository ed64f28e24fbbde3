"""A structure whose frequency responses are those of its modes in a band: what a search works with.

At every value of the parameters the structure is projected onto its modes below a multiple of the highest
line, with residual vectors: the static response of all other modes, and their first correction for inertia,
to every force, read-out and joint. The basis follows the parameters, so that it is as good far from the start
as there; what it leaves out is of the order of (line / highest mode)^4 of the residual flexibility.

Source: R. R. Craig, A. J. Kurdila, Fundamentals of Structural Dynamics, 2nd ed. 2006, section 17.7.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property

import numpy as np

from dynid.arrays import Array, ComplexArray, finite
from dynid.identification.systems.linear_system import LinearSystem, Pairs, Responses
from dynid.identification.systems.structure_system import StructureSystem
from dynid.structure.dynamic_condensation import ActiveCoordinates

#: Modes up to this multiple of the highest line are kept at first.
BAND_FACTOR = 3.0
# Columns of residual vectors below this part of the largest are rounding.
_RESIDUAL_VECTOR_TOL = 1e-10
# A search works with the basis where it has at most this part of the DOFs, and there are this many or more.
_MAX_BASIS_SHARE, _MIN_DOFS = 0.6, 40
# Lines at which responses from poles are tested, and the residual that they may leave.
_TESTED_LINES, _RESIDUAL_REL_TOL = 16, 1e-10
# Numbers in one block of lines.
_LINE_BLOCK_NUMBERS = 100_000
# Most coordinates of joints that get residual vectors of their own.
_MAX_JOINT_DIRECTIONS = 12


class _BandLimitedSystem(StructureSystem):
    """A structure whose responses are those of its modes in the band of the lines, with residual vectors.

    `system`: the whole structure with its loads and channels; `band`: modes up to this multiple of the
    highest line are kept.
    """

    def __init__(self, system: StructureSystem, band: float = BAND_FACTOR) -> None:
        super().__init__(system.model, system.loads, system.channels)
        self.band, self.considered = band, system.considered

    def basis(self, values: Mapping[str, float], omega: Array, pairs: Pairs) -> Array:
        """Return the modes in the band of the lines, and residual vectors (n x r)."""
        M, _, K = self.model.dense(values)
        return _band_basis(M, K, self.directions(pairs), self.band * float(omega[-1]))

    def solved_size(self, omega: Array, pairs: Pairs) -> int:
        """Return the number of columns of the basis at the starts."""
        return int(
            self.basis({unknown.name: unknown.start for unknown in self.unknowns}, omega, pairs).shape[1]
        )

    def _evaluated(
        self, values: Mapping[str, float], omega: Array, pairs: Pairs, *, slopes: bool
    ) -> Responses:
        """Return the responses and derivatives of `paired_response`, from the modes in the band."""
        ends, where = self._ends(pairs)
        self.model.needs_positive(omega)
        _, C, K = self.model.dense(values, loss=True)
        V = self.basis(values, omega, pairs)
        k, c, b = V.T @ K @ V, V.T @ C @ V, V.T @ ends.T
        factor = self._factors(omega, pairs)
        rows = np.eye(len(k)) if slopes else b.T
        motion = _responses(k, c, b, rows, omega)
        finite("the frequency response", motion)
        if not slopes:
            return factor * motion[:, where[1], where[0]], np.zeros((*factor.shape, 0), dtype=complex)
        H = factor * np.einsum("rp,lrp->lp", b[:, where[1]], motion[:, :, where[0]])
        return H, self._moved(values, omega, factor, (motion, where), lambda matrix: V.T @ matrix @ V)

    def directions(self, pairs: Pairs) -> Array:
        """Return the directions of forces, read-outs and unknown joints (any x n), for residual vectors."""
        return np.concatenate([self._ends(pairs)[0], self._joint_directions])

    @cached_property
    def _joint_directions(self) -> Array:
        acting = self._acting(self.model.joint_terms)
        if not any(matrix.any() for matrix in acting):
            return np.zeros((0, self.model.size))
        coordinates = ActiveCoordinates.of(acting)
        rows = np.zeros((coordinates.count, self.model.size))
        rows[:, coordinates.places] = coordinates.active.T
        return rows[:_MAX_JOINT_DIRECTIONS]


def _responses(k: Array, c: Array, b: Array, rows: Array, omega: Array) -> ComplexArray:
    """Return ``rows (k + s c + s^2)^-1 b`` at s = i omega (L x rows x e), from the poles where these differ.

    Around double poles, as of rigid-body motions, the eigenvectors are dependent; at some lines the residuals
    show that, and the equations are solved line by line.
    """
    r, s = len(k), 1j * omega
    A = np.block([[np.zeros((r, r)), np.eye(r)], [-k, -c]])
    poles, X = np.linalg.eig(A)
    try:
        modal = np.linalg.solve(X, np.concatenate([np.zeros_like(b), b]).astype(complex))
    except np.linalg.LinAlgError:
        modal = np.full((2 * r, b.shape[1]), np.nan)
    size = np.abs(k).max() + omega[-1] ** 2
    tried = s[:: max(1, len(s) // _TESTED_LINES)]
    there = X[:r] @ (modal / (tried[:, None, None] - poles[:, None]))
    left = k @ there + tried[:, None, None] * (c @ there) + tried[:, None, None] ** 2 * there - b
    if np.all(np.abs(left).max() <= _RESIDUAL_REL_TOL * (size * np.abs(there).max() + np.abs(b).max())):
        return np.asarray((rows @ X[:r]) @ (modal / (s[:, None, None] - poles[:, None])))
    blocks = [
        rows @ np.linalg.solve(k + w * c + w**2 * np.eye(r), b.astype(complex))
        for w in np.array_split(s[:, None, None], max(1, len(s) * r * r // _LINE_BLOCK_NUMBERS))
    ]
    return np.concatenate(blocks)


def band_limited(system: LinearSystem, omega: Array, pairs: Pairs, band: float) -> _BandLimitedSystem | None:
    """Return the system that a search works with; None where the whole one takes as little or less work."""
    if not isinstance(system, StructureSystem) or system.model.size < _MIN_DOFS:
        return None
    limited = _BandLimitedSystem(system, band)
    try:
        size = limited.solved_size(omega, pairs)
    except np.linalg.LinAlgError:  # a motion has no mass
        return None
    most = min(_MAX_BASIS_SHARE * system.model.size, system.solved_size(omega, pairs))
    return limited if size <= most else None


def _band_basis(M: Array, K: Array, directions: Array, top: float) -> Array:
    """Return the modes below a frequency, and residual vectors for directions, mass-normalised (n x r)."""
    # `M`, `K`: mass, positive definite, and stiffness (n x n); `directions`: forces (any x n). `top`: the
    # frequency, rad/s. Raises numpy.linalg.LinAlgError if the mass is singular.
    if np.any(np.diag(M) <= 0):
        raise np.linalg.LinAlgError("a DOF has no mass")
    scale = 1 / np.sqrt(np.diag(M))
    inverse = np.linalg.inv(np.linalg.cholesky(M * scale * scale[:, None])) * scale  # of the root of M
    stiffness = inverse @ K @ inverse.T
    square, shapes = np.linalg.eigh((stiffness + stiffness.T) / 2)
    shapes = inverse.T @ shapes
    count = int(np.searchsorted(square, top**2))
    others = shapes[:, count:]
    statics = (others.T @ directions.T) / square[count:, None]
    vectors = np.concatenate([statics, statics / square[count:, None]], axis=1)
    sizes = np.linalg.norm(vectors, axis=0)
    U, singular_values, _ = np.linalg.svd(vectors / np.where(sizes > 0, sizes, 1.0), full_matrices=False)
    return np.concatenate([shapes[:, :count], others @ U[:, singular_values > _RESIDUAL_VECTOR_TOL]], axis=1)
