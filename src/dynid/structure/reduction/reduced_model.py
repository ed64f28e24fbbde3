"""Reduced models: projection on a basis, its rounding, and the choice of coordinates.

The coordinates are the masters' displacements, or the modes of the reduced model where these lose digits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynid.arrays import Array
from dynid.structure.labels import Label
from dynid.structure.matrices import Matrix, is_sparse
from dynid.structure.model import StructuralModel
from dynid.structure.modes.pencil import StrainEnergy

# Rounding of a sum of positive and negative terms, relative to their sizes.
_ROUNDING = 16 * float(np.finfo(float).eps)
# Energies within this factor of it may be soft springs: what is taken for rounding is far below the others.
_SOFT_SPRING_RATIO = 100.0
# A coordinate whose strain energy is a smaller part of its terms is projected in twice the working precision;
# where that takes fewer products than the other, all coordinates are.
_SOFT = 1e-6
_AFFORDABLE = 20_000_000


@dataclass(frozen=True, eq=False)
class StructuralReduction:
    """A reduced model, which expands back to all DOFs, with the choices and conditions of its reduction."""

    model: StructuralModel
    masters: tuple[Label, ...] = ()
    # Numbers of the modes that the basis is made of: of the structure that the method takes them from.
    modes: tuple[int, ...] = ()
    # Of the inverted matrix, scaled: the modes at the masters where masters stand for modes, else the
    # stiffness of the slaves; None where nothing is inverted.
    condition: float | None = None
    # True where these modes are those of the structure with its joints, so that the reduced model has them.
    retained: bool = False
    # The rule that they were chosen by, in words, and what rounding leaves open; empty where there is none.
    rule: str = ""
    doubt: str = ""
    inverted: str = "the modes at the masters"

    @property
    def T(self) -> Array:
        """The basis (n x r)."""
        assert self.model.basis is not None
        return self.model.basis.T


def projected(
    model: StructuralModel, T: Array, names: Sequence[Label], rigid: Sequence[int] = ()
) -> StructuralModel:
    """Project a structure; stiffness that is rounding of the sum it is made of is taken for none.

    The stiffness of soft coordinates, whose terms cancel to many digits, is summed in twice the working
    precision. Rigid-body motions stay such in the reduced model, where the size of that sum is not known any
    more.

    `T`: the basis (n x r); `names`: labels of the coordinates (r); `rigid`: those in which the structure with
    its joints moves as a rigid body.
    """
    reduced = model.projected(T, names, rigid)
    K = without_rounding(projected_stiffness(T, model.K), T, model.K)
    # The rounding of a rigid-body motion would look like a soft spring: its couplings are roots of it.
    K[list(rigid)], K[:, list(rigid)] = 0.0, 0.0
    return replace(reduced, K=K)


def projected_stiffness(T: Array, K: Matrix) -> Array:
    """Return ``T^T K T``, what cancels to many digits summed in twice the working precision."""
    product = np.asarray(K @ T)
    plain: Array = T.T @ product
    plain = (plain + plain.T) / 2
    parts = np.einsum("ij,ij->j", np.abs(T), np.asarray(abs(K) @ np.abs(T)))
    entries = K.nnz if is_sparse(K) else K.size
    few = (entries + len(T) * T.shape[1]) * T.shape[1] <= _AFFORDABLE
    soft = np.flatnonzero((np.diag(plain) < _SOFT * parts) | few)
    if len(soft):
        exact = StrainEnergy(K).gram(T[:, soft], T)
        plain[soft], plain[:, soft] = exact, exact.T
    return plain


def without_rounding(reduced: Array, T: Array, K: Matrix) -> Array:
    """Return a projected stiffness without the rounding of ``|T|^T |K| |T|``, motions and coordinates."""
    parts = np.einsum("ij,ij->j", np.abs(T), np.asarray(abs(K) @ np.abs(T)))
    size = np.sqrt(np.where(parts > 0, parts, 1.0))
    values, vectors = np.linalg.eigh((reduced + reduced.T) / 2 / size / size[:, None])
    rounding = values <= _ROUNDING
    low, high = values[rounding], values[~rounding]
    # Energies that could be rounding are those of soft springs where they are positive, and not far below.
    if not rounding.any() or (low.min() > 0 and len(high) and high.min() < _SOFT_SPRING_RATIO * _ROUNDING):
        return np.asarray((reduced + reduced.T) / 2)
    root = size[:, None] * vectors * np.sqrt(np.where(values > _ROUNDING, values, 0.0))
    stiff = (root**2).sum(axis=1) > _ROUNDING * parts
    return np.asarray(np.where(np.outer(stiff, stiff), root @ root.T, 0.0))


def modal_rule(lost: float) -> str:
    """Return the reason in words why the coordinates are modes although there are masters."""
    digits = f"{np.log10(lost):.0f}" if np.isfinite(lost) else "all"
    return f"coordinates are the reduced model's modes: in the masters' displacements {digits} digits cancel"


def cancellation(masters: Array, square: Array) -> tuple[Array, Array]:
    """Return the modes' coordinates by the masters' displacements, and the worst cancellation of these.

    By that factor the terms of a mode's energies exceed these in the masters' displacements; it is infinite,
    and the coordinates are not finite, where the masters do not determine the modes.

    `masters`: the masters' displacements (m x m) in the modes of unit modal mass; or a stack of them;
    `square`: the squared frequencies (m).
    """
    try:
        inverse = np.asarray(np.linalg.inv(masters), dtype=np.float64)
    except np.linalg.LinAlgError:
        return np.full_like(masters, np.nan), np.full(masters.shape[:-2], np.inf)
    size, turned = np.abs(masters), inverse.swapaxes(-1, -2)
    M, K = turned @ inverse, (turned * square[..., None, :]) @ inverse
    of_mass, of_strain = ((size * (np.abs(matrix) @ size)).sum(axis=-2) for matrix in (M, K))
    of_strain = np.where(square > 0, of_strain / np.where(square > 0, square, 1.0), 1.0)
    largest = np.maximum(of_mass, of_strain).max(axis=-1, initial=1.0)
    return inverse, np.where(np.isfinite(largest), largest, np.inf)
