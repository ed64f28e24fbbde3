"""Modes, from scaled eigenpairs to what a user is told."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.errors import NumericalError, Singular, UsageError
from dynid.structure.matrices import Array, Matrix, is_sparse
from dynid.structure.modes.pencil import Pencil, absolute, times
from dynid.structure.modes.strain import strain_energy

# Strain energy of a rigid-body motion, relative to that of its parts: rounding of the stiffness.
_ROUNDING = 16 * float(np.finfo(float).eps)
_UNIT = float(np.finfo(float).eps) / 2
# Below this part of its terms the energy of a motion is summed without rounding, up to this many DOFs.
_SOFT, _MOST_REFINED = 1e-6, 400
# A stiffness rounded to single precision or to six printed digits has energies as negative as this.
_INDEFINITE = 1e-5
_RESIDUAL = 1e-9


class Modes(NamedTuple):
    """Modes in ascending order.

    `omega` (modes): natural frequencies, rad/s, exactly 0 of rigid-body modes; `damping` (modes): modal
    damping ratios, 0 of rigid-body modes; `shapes` (n x modes): normed to unit modal mass, the largest
    component positive; `residuals` (modes): ``K phi - omega^2 M phi`` relative to the sizes of its parts;
    `rigid`: number of rigid-body modes among them; `massless`: dimension of the massless directions, whose
    frequencies are infinite (by sparse methods: number of massless DOFs); `counted`: rad/s up to which pivots
    have proved that no mode is missing (infinite where all modes were computed, 0 where no proof was asked
    for); `method`: how they were found; `uncertainty` (modes): how far the rounding of the matrices' entries
    leaves each frequency open, rad/s.
    """

    omega: Array
    damping: Array
    shapes: Array
    residuals: Array
    rigid: int
    massless: int
    counted: float
    method: str
    uncertainty: Array

    def first(self, count: int) -> Modes:
        """Return the lowest modes only."""
        return self._replace(
            omega=self.omega[:count],
            damping=self.damping[:count],
            shapes=self.shapes[:, :count],
            residuals=self.residuals[:count],
            uncertainty=self.uncertainty[:count],
            rigid=min(self.rigid, count),
        )


def finished(
    pencil: Pencil, C: Matrix, square: Array, shapes: Array, *, massless: int, counted: float, method: str
) -> Modes:
    """Name, norm, check and sort scaled eigenpairs.

    Parameters
    ----------
    pencil
        The scaled stiffness and mass.
    C
        Damping, not scaled.
    square, shapes
        Eigenvalues and scaled eigenvectors of unit modal mass.
    massless, counted, method
        As of `Modes`; `counted` is an eigenvalue here.

    Raises
    ------
    Singular
        If the stiffness is indefinite beyond rounding, so that a frequency is imaginary.
    NumericalError
        If a residual is too large.
    """
    order = np.argsort(square, kind="stable")
    square, shapes = square[order], shapes[:, order]
    stiffness, size = absolute(pencil.K), np.abs(shapes)
    Kx, Mx, parts = times(pencil.K, shapes), times(pencil.M, shapes), times(stiffness, size)
    # The strain energy of the shape itself: its rounding is that of its parts, not of the highest mode.
    strain, whole = np.einsum("im,im->m", shapes, Kx), np.einsum("im,im->m", size, parts)
    # What the rounding of a shape makes of forces and energy is none: nothing else may hold the mode.
    blur = pencil.size * _UNIT * size.max(axis=0, initial=0.0)
    row = times(stiffness, np.ones(pencil.size))
    free = np.abs(strain) <= row.sum() * blur**2
    strain, square = np.where(free, 0.0, strain), np.where(free, 0.0, square)
    inertia = np.abs(square) * times(absolute(pencil.M), size)
    sizes = np.linalg.norm(parts + inertia, axis=0)  # 0 for a mass that nothing holds
    excess = np.maximum(np.abs(Kx - square * Mx) - np.where(free, np.outer(row, blur), 0.0), 0.0)
    residuals = np.linalg.norm(excess, axis=0) / np.where(sizes > 0, sizes, 1.0)
    rigid = _rigid(strain, whole)
    square = _refined(pencil, np.where(rigid, 0.0, square), shapes, whole)
    if (worst := float(residuals.max(initial=0.0))) > _RESIDUAL:
        raise NumericalError(
            f"the modes have residuals of {worst:.1g} (found by {method})",
            remedy="Use another backend; check the units of the matrices.",
        )
    shapes = pencil.scale[:, None] * shapes
    shapes = shapes * _signs(shapes)
    omega = np.sqrt(square)
    dissipation = np.einsum("im,im->m", shapes, times(C, shapes))
    damping = np.where(rigid, 0.0, dissipation / (2 * np.where(rigid, 1.0, omega)))
    # Entries rounded by half a unit in the last place move omega^2 by that part of `whole`.
    moved = _UNIT * whole
    uncertainty = np.where(rigid, np.sqrt(moved), moved / np.where(rigid, 1.0, omega) + _UNIT * omega)
    return Modes(
        omega, damping, shapes, residuals, int(rigid.sum()), massless, float(np.sqrt(counted)), method,
        uncertainty,
    )  # fmt: skip


def _refined(pencil: Pencil, square: Array, shapes: Array, whole: Array) -> Array:
    """Return the eigenvalues, those of soft motions by their strain energies without cancellation."""
    if is_sparse(pencil.K) or pencil.size > _MOST_REFINED:
        return square
    K, M = np.asarray(pencil.K), np.asarray(pencil.M)
    soft = np.flatnonzero((square > 0) & (square < _SOFT * whole))
    better = square.copy()
    for mode in soft:
        shape = shapes[:, mode]
        better[mode] = strain_energy(K, shape) / float(shape @ M @ shape)
    return np.where(better > 0, better, square)


def _signs(shapes: Array) -> Array:
    """Return what makes the largest component positive, the first of those as large but for rounding."""
    size = np.abs(shapes)
    largest = (size >= (1 - 1e-6) * size.max(axis=0, initial=0.0)).argmax(axis=0)
    return np.asarray(np.where(np.take_along_axis(shapes, largest[None], axis=0) < 0, -1.0, 1.0))


def _rigid(square: Array, parts: Array) -> NDArray[np.bool_]:
    """Tell rigid-body modes by their strain energy, which is rounding of the sum it is made of.

    A stiffness that was rounded (printed with few digits) shows the size of its rounding in energies below
    zero; modes with an energy of that size are rigid too.
    """
    energy = square / np.where(parts > 0, parts, 1.0)
    lowest = -float(energy.min(initial=0.0))
    if lowest > _INDEFINITE:
        raise Singular(
            f"the stiffness matrix is indefinite (omega^2 = {square[energy.argmin()]:.3g})",
            remedy="The structure has no natural frequency there; check signs and units of the stiffness.",
        )
    return np.asarray((energy <= max(_ROUNDING, 10 * lowest)) | (parts == 0))


def too_many(count: int, finite: int) -> UsageError:
    """Return the refusal of more modes than there are."""
    return UsageError(
        f"{count} modes are asked for, but the structure has {finite} with finite frequencies",
        remedy="Ask for fewer; massless DOFs add none.",
        names=("modes",),
    )
