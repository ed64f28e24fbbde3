"""Scaled pencil of stiffness and mass: translations and rotations, stiff and soft parts compare."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from dynid.errors import Singular, UsageError
from dynid.lti.floating import finite
from dynid.structure.matrices import Array, Matrix, as_array, is_sparse


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
_MASSLESS = 1e28
# The least shift relative to the bound, large against rounding. The lowest elastic eigenvalue of n DOFs is
# about the bound over n^2 (strings, plates) or more (solids): a shift far below it would make rigid-body
# modes hide it in the inverse.
_LEAST_SHIFT = 1e-10


def scaled(K: Matrix, M: Matrix) -> Pencil:
    """Scale stiffness and mass.

    Raises
    ------
    UsageError
        If a diagonal entry is negative, or entries are not finite.
    Singular
        If a DOF has neither mass nor stiffness.
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
    light = both & (mass * bound * _MASSLESS < stiffness) & (mass * _MASSLESS < mass.max(initial=0.0))
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
