"""Modes, from scaled eigenpairs to what a user is told."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.errors import NumericalError, Singular, UsageError
from dynid.structure.matrices import Array, Matrix
from dynid.structure.modes.pencil import Pencil, absolute, times
from dynid.structure.modes.strain import Strain

# Strain energy of a rigid-body motion, relative to that of its parts: rounding of the stiffness.
_ROUNDING = 16 * float(np.finfo(float).eps)
_UNIT = float(np.finfo(float).eps) / 2
# Below this part of its terms the energy of a motion is summed without rounding.
_SOFT = 1e-6
# So summed, the energy of a rigid-body motion is a smaller part where the entries of the stiffness belong to
# each other; where they were rounded one by one, nothing tells such a motion from a slow elastic one.
_EXACT = 1e-6 * _UNIT
# What looks rigid is told from elastic modes by its distance where these are so many times faster than it may
# be: when the first mode of a beam with its ends held is lost, the second is four to seven times as fast.
_APART = 10.0
# The part of a frequency that rounding may leave open without a word: as much as measurements do.
_LOOSE = 1e-3
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
    leaves each frequency open, rad/s; `undecided` (modes): whether it is larger than the frequency, and
    nothing else tells whether the mode is a rigid-body one.
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
    undecided: NDArray[np.bool_]

    @property
    def doubt(self) -> str:
        """What is to be known of modes that rounding leaves open, in words; empty where it leaves none."""
        elastic = self.omega > 0
        loose = self.uncertainty > _LOOSE * np.where(elastic, self.omega, np.inf)
        if self.undecided.any():
            numbers, most = np.flatnonzero(self.undecided) + 1, self.uncertainty[self.undecided].max()
            what = f"nothing tells {_numbered(numbers)} from rigid-body motion"
            said = f"{what}: rounding of the stiffness leaves frequencies open by {most:.2g} rad/s"
        elif loose.any():
            numbers = np.flatnonzero(loose) + 1
            part = 100 * float((self.uncertainty[loose] / self.omega[loose]).max())
            said = (
                f"rounding of the stiffness leaves the frequency of {_numbered(numbers)} open by {part:.2g} %"
            )
        else:
            return ""
        return f"{said}; use fewer, longer elements, or constraints in place of nearly rigid ones"

    def first(self, count: int) -> Modes:
        """Return the lowest modes only."""
        return self._replace(
            omega=self.omega[:count],
            damping=self.damping[:count],
            shapes=self.shapes[:, :count],
            residuals=self.residuals[:count],
            uncertainty=self.uncertainty[:count],
            undecided=self.undecided[:count],
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
    square, rigid, undecided = _refined(pencil, square, shapes, whole, _rigid(strain, whole))
    order = np.argsort(square, kind="stable")
    shapes, residuals, whole = shapes[:, order], residuals[order], whole[order]
    square, rigid, undecided = square[order], rigid[order], undecided[order]
    if (worst := float(residuals.max(initial=0.0))) > _RESIDUAL:
        raise NumericalError(
            f"the modes have residuals of {worst:.1g} (found by {method})",
            remedy="Use another backend; check the units of the matrices.",
        )
    shapes = pencil.scale[:, None] * shapes
    shapes = shapes * _signs(shapes)
    omega = np.sqrt(square)
    return Modes(
        omega, _damping(C, omega, rigid, shapes), shapes, residuals, int(rigid.sum()), massless,
        float(np.sqrt(counted)), method, _uncertainty(omega, rigid | undecided, whole), undecided,
    )  # fmt: skip


def _damping(C: Matrix, omega: Array, rigid: NDArray[np.bool_], shapes: Array) -> Array:
    """Return damping ratios; rigid-body modes have none."""
    dissipation = np.einsum("im,im->m", shapes, times(C, shapes))
    return np.where(rigid, 0.0, dissipation / (2 * np.where(rigid, 1.0, omega)))


def _uncertainty(omega: Array, open_to_zero: NDArray[np.bool_], whole: Array) -> Array:
    """Return what entries rounded by half a unit in the last place make of frequencies."""
    moved = _UNIT * whole  # that part of the energies of a shape's parts moves omega^2
    return np.where(open_to_zero, np.sqrt(moved), moved / np.where(open_to_zero, 1.0, omega) + _UNIT * omega)


def _refined(
    pencil: Pencil, square: Array, shapes: Array, whole: Array, still: NDArray[np.bool_]
) -> tuple[Array, NDArray[np.bool_], NDArray[np.bool_]]:
    """Return eigenvalues, of soft motions from energies without cancellation; and what is rigid, undecided.

    Parameters
    ----------
    pencil, square, shapes
        As of `finished`, ascending.
    whole
        The parts that each strain energy is a sum of, without their signs.
    still
        Which modes have a strain energy that is rounding: rigid-body motions if the elastic modes are far, or
        if nothing at all holds them (an eigenvalue of 0).
    """
    better, may_be = np.where(still, 0.0, square), _ROUNDING * whole
    elastic = float(square[~still].min()) if not still.all() else 0.0
    doubtful = still & (square != 0) & (elastic < _APART**2 * may_be)
    soft = np.flatnonzero(doubtful | (~still & (square > 0) & (square < _SOFT * whole)))
    if not len(soft):
        return better, still, doubtful
    strain = Strain(pencil.K)
    for mode in soft:
        shape = shapes[:, mode]
        energy = strain.energy(shape) / float(shape @ times(pencil.M, shape))
        better[mode] = energy if energy > (_EXACT * whole[mode] if doubtful[mode] else 0.0) else better[mode]
    undecided = doubtful & (better > 0)
    return better, still & ~undecided, undecided


def _signs(shapes: Array) -> Array:
    """Return what makes the largest component positive, the first of those as large but for rounding."""
    size = np.abs(shapes)
    largest = (size >= (1 - 1e-6) * size.max(axis=0, initial=0.0)).argmax(axis=0)
    return np.asarray(np.where(np.take_along_axis(shapes, largest[None], axis=0) < 0, -1.0, 1.0))


def _numbered(numbers: NDArray[np.intp]) -> str:
    """Name modes by their numbers, which follow each other."""
    first, last = int(numbers[0]), int(numbers[-1])
    return f"mode {first}" if first == last else f"modes {first} to {last}"


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
