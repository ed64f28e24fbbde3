"""Mass, damping and stiffness of a structure recovered from its state space.

Of a state space ``[0 I; -M^-1 K, -M^-1 C]`` the system matrix alone gives the modes, not their masses: with
left eigenvectors Psi of ``M^-1 K``, every ``M = Psi^T D Psi`` with a positive diagonal D is symmetric with
``K = M (M^-1 K)``. A collocated input and output (``M b = c``: a unit force and the motion that it moves)
give them, as residues of that channel.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dynid.arrays import Array, guarded
from dynid.errors import NumericalError, UsageError

# The relative contradiction that rounded numbers of a state space may contain.
_CONTRADICTION_TOL = 1e-6

_WORST_BASIS = 1e8

# A mode that takes part in a channel by less does not show its mass in it.
_PART = 1e-6


class _RecoveredMatrices(NamedTuple):
    """Matrices (n x n) of a state space; `scaled`: a collocated input and output give the modal masses."""

    M: Array
    C: Array
    K: Array
    scaled: bool


@guarded("the recovery of mass and stiffness")
def recovered(A: Array, B: Array | None = None, C: Array | None = None) -> _RecoveredMatrices:
    """Recover the matrices of a structure from its state space, states [x, x'].

    `A`: system matrix (2n x 2n); `B`, `C`: inputs (2n x p) and outputs (q x 2n), if known. The first pair at
    one place tells the modal masses; without one they are those closest to a unit mass matrix. Raises
    UsageError if the state space is not that of a structure with symmetric matrices, and NumericalError if
    the modes are nearly linearly dependent.
    """
    n = _half(A)
    X, Y = -A[n:, :n], -A[n:, n:]
    square, right = np.linalg.eig(X)
    size = float(np.abs(square).max(initial=0.0))
    if (
        np.abs(square.imag).max() > _CONTRADICTION_TOL * size
        or square.real.min() < -_CONTRADICTION_TOL * size
    ):
        worst = square[int(np.argmax(np.abs(square.imag) + np.maximum(-square.real, 0)))]
        raise UsageError(
            f"the state space is no passive structure: M^-1 K has the eigenvalue {worst:.4g}",
            remedy="The squares of natural frequencies are real and not negative.",
            names=("state_space",),
        )
    if np.abs(X - X.T).max() <= 1e-12 * max(float(np.abs(X).max()), np.finfo(float).tiny):
        right = np.linalg.eigh((X + X.T) / 2)[1]
    condition = float(np.linalg.cond(right))
    if condition > _WORST_BASIS:
        raise NumericalError(
            f"the modes of the state space are nearly dependent (condition {condition:.2g})",
            remedy="A structure with symmetric matrices has independent ones; check the file.",
            names=("state_space",),
        )
    left = np.linalg.inv(right).real
    coupling = left @ Y @ right.real
    masses = _port_masses(n, left, right.real, B, C)
    scaled = masses is not None
    if masses is None:
        masses = _nearest_masses(left, coupling)
    M = left.T @ (masses[:, None] * left)
    return _RecoveredMatrices(_even("mass", M), _even("damping", M @ Y), _even("stiffness", M @ X), scaled)


def _half(A: Array) -> int:
    rows, columns = A.shape
    if rows != columns or rows % 2 or not rows:
        raise UsageError(
            f"the system matrix is {rows} x {columns}; that of a structure is square and even",
            names=("state_space",),
        )
    if not np.isfinite(A).all():
        raise UsageError("the system matrix has entries that are no numbers", names=("state_space",))
    n: int = rows // 2
    wrong = np.argwhere(A[:n] != np.eye(n, 2 * n, k=n))
    if len(wrong):
        i, j = wrong[0]
        raise UsageError(
            f"the upper half of the system matrix is not [0 I]: entry ({i + 1}, {j + 1}) is {A[i, j]:.6g}",
            remedy="The states must be all displacements, then all velocities.",
            names=("state_space",),
        )
    return n


def _port_masses(n: int, left: Array, right: Array, B: Array | None, C: Array | None) -> Array | None:
    """Return the modal masses (n) from the first collocated input and output."""
    if B is None or C is None or B.shape[0] != 2 * n or C.shape[1] != 2 * n:
        return None
    for b in B[n:].T[np.abs(B[:n]).max(axis=0, initial=0.0) == 0]:
        for row in C:
            # The output reads displacements or velocities, not both.
            if np.any(row[:n]) == np.any(row[n:]):
                continue
            driven, seen = left @ b, right.T @ (row[:n] + row[n:])
            if np.abs(driven).min() <= _PART * np.abs(driven).max():
                continue
            masses = seen / driven
            if masses.min() > _PART * masses.max():
                return np.asarray(masses)
    return None


def _nearest_masses(left: Array, coupling: Array) -> Array:
    """Return the modal masses (n) that make damping symmetric and the mass matrix closest to unity."""
    gram = left @ left.T
    size = max(float(np.abs(coupling).max()), np.finfo(float).tiny)
    Z = coupling / size
    np.fill_diagonal(Z, 0.0)
    # D_i Z_ij = D_j Z_ji makes C symmetric: the null space of their squares' sum, rounding of Z left out.
    Z[np.abs(Z) < _CONTRADICTION_TOL] = 0.0
    symmetry = np.diag((Z**2).sum(axis=1)) - Z * Z.T
    values, vectors = np.linalg.eigh(symmetry)
    free = vectors[:, values <= _CONTRADICTION_TOL**2 + _CONTRADICTION_TOL * values[-1]]
    masses = free @ np.linalg.lstsq(free.T @ gram**2 @ free, free.T @ np.diag(gram), rcond=None)[0]
    if masses.min() <= 0:
        raise UsageError(
            "the state space is no passive structure: no positive modal masses make its damping symmetric",
            names=("state_space",),
        )
    return np.asarray(masses)


def _even(name: str, matrix: Array) -> Array:
    gap = np.abs(matrix - matrix.T)
    if gap.max() > _CONTRADICTION_TOL * max(float(np.abs(matrix).max()), np.finfo(float).tiny):
        i, j = np.unravel_index(int(np.argmax(gap)), gap.shape)
        raise UsageError(
            f"the {name} that the state space gives is not symmetric: entry ({i + 1}, {j + 1}) is "
            f"{matrix[i, j]:.6g}, ({j + 1}, {i + 1}) is {matrix[j, i]:.6g}",
            names=("state_space",),
        )
    return (matrix + matrix.T) / 2
