"""Natural frequencies, mode shapes and modal damping of a structure, by the solver that fits its size.

Both solvers return scaled eigenpairs; `finished` norms them, checks their residuals, distinguishes
rigid-body modes from elastic ones and states the uncertainty of each frequency by rounding.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from time import perf_counter
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array, guarded
from dynid.defaults import ALL_MODES, DENSE_MODES, FEW_MODES
from dynid.errors import NumericalError, Singular, UsageError
from dynid.structure.matrices import Matrix, as_array, is_sparse
from dynid.structure.modes.pencil import Pencil, StrainEnergy, absolute, blocks, scaled, times, too_many

if TYPE_CHECKING:
    from dynid.structure.backends import Factorisation

# Strain energy of a rigid-body motion, relative to that of its parts: rounding of the stiffness.
_ROUNDING = 16 * float(np.finfo(float).eps)
_UNIT = float(np.finfo(float).eps) / 2
# Below this part of its terms the energy of a motion is summed without rounding.
_SOFT = 1e-6
# So summed, the energy of a rigid-body motion is a smaller part where the entries of the stiffness belong to
# each other; where they were rounded one by one, such a motion looks like a slow elastic one.
_EXACT = 1e-6 * _UNIT
# Motions that may be rigid are distinguished from elastic modes that are so many times faster than they may
# be: when the first mode of a beam with its ends held is lost, the second is four to seven times as fast.
_LOST_MODE_RATIO = 10.0
# The part of a frequency that rounding may leave open without a word: as much as measurements do.
_LOOSE = 1e-3
# A stiffness rounded to single precision or to six printed digits has energies as negative as this.
_ROUNDED_INDEFINITENESS = 1e-5
_MODE_RESIDUAL = 1e-9
# Below this size dense matrices are faster whatever is asked; above the other, out of question.
_SMALL, _LARGE = DENSE_MODES.value, ALL_MODES.value
# The part of all modes beyond which Lanczos is slower than dense matrices.
_PART = FEW_MODES.value


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
    the mode cannot be distinguished from a rigid-body one.
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

    def within(self, K: Matrix, shapes: Array) -> Modes:
        """Return the modes of a reduced model, open by the rounding of the structure's stiffness too.

        `K`: stiffness of the structure that was reduced, joints included (N x N); `shapes`: these modes'
        shapes in its DOFs (N x modes).
        """
        total_energy = np.einsum("im,im->m", np.abs(shapes), times(absolute(K), np.abs(shapes)))
        more = _uncertainty(
            self.omega, (self.omega == 0) | self.undecided, total_energy, np.ones(len(total_energy))
        )
        return self._replace(uncertainty=self.uncertainty + more)

    @property
    def doubt(self) -> str:
        """Warning about frequencies that rounding leaves open; empty where there are none."""
        elastic = self.omega > 0
        loose = self.uncertainty > _LOOSE * np.where(elastic, self.omega, np.inf)
        if self.undecided.any():
            numbers, largest = np.flatnonzero(self.undecided) + 1, self.uncertainty[self.undecided].max()
            what = f"nothing tells {_numbered(numbers)} from rigid-body motion"
            said = f"{what}: rounding of the stiffness leaves frequencies open by {largest:.2g} rad/s"
        elif loose.any():
            numbers = np.flatnonzero(loose) + 1
            percent = 100 * float((self.uncertainty[loose] / self.omega[loose]).max())
            frequency = f"the frequency of {_numbered(numbers)}"
            said = f"rounding of the stiffness leaves {frequency} open by {percent:.2g} %"
        else:
            return ""
        return f"{said}; use fewer, longer elements, or constraints in place of nearly rigid ones"

    def first(self, count: int) -> Modes:
        """Return the lowest modes only."""
        by_mode = ("omega", "damping", "shapes", "residuals", "uncertainty", "undecided")
        lowest: dict[str, Any] = {name: getattr(self, name)[..., :count] for name in by_mode}
        return self._replace(rigid=min(self.rigid, count), **lowest)


def finished(
    pencil: Pencil, C: Matrix, square: Array, shapes: Array, *, massless: int, counted: float, method: str
) -> Modes:
    """Return modes from scaled eigenpairs: sorted, normed and checked.

    `pencil`: the scaled stiffness and mass; `C`: damping, not scaled; `square`, `shapes`: eigenvalues and
    scaled eigenvectors of unit modal mass; `massless`, `counted`, `method`: as of `Modes`; `counted` is an
    eigenvalue here. Raises Singular if the stiffness is indefinite beyond rounding, so that a frequency is
    imaginary, and NumericalError if a residual is too large.
    """
    order = np.argsort(square, kind="stable")
    square, shapes = square[order], shapes[:, order]
    strain, total, moving, square, residuals = _energies(pencil, square, shapes)
    square, rigid, undecided = _refined(pencil, square, shapes, total, _rigid(strain, total))
    order = np.argsort(square, kind="stable")
    if np.any(np.diff(order) < 0):
        shapes = shapes[:, order]
    residuals, total, moving = residuals[order], total[order], moving[order]
    square, rigid, undecided = square[order], rigid[order], undecided[order]
    if (worst := float(residuals.max(initial=0.0))) > _MODE_RESIDUAL:
        raise NumericalError(
            f"the modes have residuals of {worst:.1g} (found by {method})",
            remedy="Use another backend; check the units of the matrices.",
        )
    shapes = pencil.scale[:, None] * shapes
    dissipation = np.zeros(len(square))
    for block in blocks(len(square)):
        # The largest component is positive: the first of those as large but for rounding.
        size = np.abs(shapes[:, block])
        largest = (size >= (1 - 1e-6) * size.max(axis=0, initial=0.0)).argmax(axis=0)
        negative = np.take_along_axis(shapes[:, block], largest[None], axis=0) < 0
        shapes[:, block] *= np.where(negative, -1.0, 1.0)
        dissipation[block] = np.einsum("im,im->m", shapes[:, block], times(C, shapes[:, block]))
    omega = np.sqrt(square)
    damping = np.where(rigid, 0.0, dissipation / (2 * np.where(rigid, 1.0, omega)))
    return Modes(
        omega, damping, shapes, residuals, int(rigid.sum()), massless,
        float(np.sqrt(counted)), method, _uncertainty(omega, rigid | undecided, total, moving), undecided,
    )  # fmt: skip


def _energies(pencil: Pencil, square: Array, shapes: Array) -> tuple[Array, Array, Array, Array, Array]:
    """Return strain energies of scaled shapes, the sums of their parts and of kinetic ones without signs.

    With them eigenvalues and residuals, relative to the sizes of their parts (all of modes). Forces and
    energies that are rounding of the shape count as zero.
    """
    stiffness, mass = absolute(pencil.K), absolute(pencil.M)
    row = times(stiffness, np.ones(pencil.size))
    strain, total, moving, residuals = np.zeros((4, len(square)))
    square = square.copy()
    for block in blocks(len(square)):
        x, size = shapes[:, block], np.abs(shapes[:, block])
        Kx, parts, inertia = times(pencil.K, x), times(stiffness, size), times(mass, size)
        # The strain energy of the shape itself: its rounding is that of its parts, not of the highest mode.
        strain[block], total[block] = np.einsum("im,im->m", x, Kx), np.einsum("im,im->m", size, parts)
        moving[block] = np.einsum("im,im->m", size, inertia)
        blur = pencil.size * _UNIT * size.max(axis=0, initial=0.0)
        free = np.abs(strain[block]) <= row.sum() * blur**2
        strain[block][free] = square[block][free] = 0.0
        excess = np.abs(Kx - square[block] * times(pencil.M, x))
        excess[:, free] = np.maximum(excess[:, free] - np.outer(row, blur[free]), 0.0)
        # 0 for a mass that nothing holds.
        sizes = np.linalg.norm(parts + np.abs(square[block]) * inertia, axis=0)
        residuals[block] = np.linalg.norm(excess, axis=0) / np.where(sizes > 0, sizes, 1.0)
    return strain, total, moving, square, residuals


def _uncertainty(omega: Array, open_to_zero: NDArray[np.bool_], total: Array, moving: Array) -> Array:
    """Return how far entries rounded by half a unit in the last place move the frequencies.

    `omega`, `open_to_zero`: the frequencies, and which of them may be zero; `total`, `moving`: strain and
    kinetic energies of the shapes of unit modal mass, summed without signs.
    """
    moved = _UNIT * total  # that part of the energies of a shape's parts moves omega^2
    elastic = moved / np.where(open_to_zero, 1.0, omega) + _UNIT * np.maximum(moving, 1.0) * omega
    return np.where(open_to_zero, np.sqrt(moved), elastic)


def _refined(
    pencil: Pencil, square: Array, shapes: Array, total: Array, still: NDArray[np.bool_]
) -> tuple[Array, NDArray[np.bool_], NDArray[np.bool_]]:
    """Return eigenvalues, of soft motions by exact sums of energy; and the rigid and undecided ones.

    `pencil`, `square`, `shapes`: as of `finished`, ascending; `total`: the parts that each strain energy is a
    sum of, without their signs; `still`: which modes have a strain energy that is rounding: rigid-body
    motions if the elastic modes are far, or if nothing at all holds them (an eigenvalue of 0).
    """
    better, may_be = np.where(still, 0.0, square), _ROUNDING * total
    elastic = float(square[~still].min()) if not still.all() else 0.0
    doubtful = still & (square != 0) & (elastic < _LOST_MODE_RATIO**2 * may_be)
    soft = np.flatnonzero(doubtful | (~still & (square > 0) & (square < _SOFT * total)))
    if not len(soft):
        return better, still, doubtful
    strain = StrainEnergy(pencil.K)
    for mode in soft:
        shape = shapes[:, mode]
        energy = strain.energy(shape) / float(shape @ times(pencil.M, shape))
        better[mode] = energy if energy > (_EXACT * total[mode] if doubtful[mode] else 0.0) else better[mode]
    undecided = doubtful & (better > 0)
    return better, still & ~undecided, undecided


def _numbered(numbers: NDArray[np.intp]) -> str:
    """Name modes by their numbers, which follow each other."""
    first, last = int(numbers[0]), int(numbers[-1])
    return f"mode {first}" if first == last else f"modes {first} to {last}"


def _rigid(square: Array, parts: Array) -> NDArray[np.bool_]:
    """Return the rigid-body modes: their strain energy is rounding of its terms.

    A stiffness that was rounded (printed with few digits) shows the size of its rounding in energies below
    zero; modes with an energy of that size are rigid too.
    """
    energy = square / np.where(parts > 0, parts, 1.0)
    lowest = -float(energy.min(initial=0.0))
    if lowest > _ROUNDED_INDEFINITENESS:
        raise Singular(
            f"the stiffness matrix is indefinite (omega^2 = {square[energy.argmin()]:.3g})",
            remedy="The structure has no natural frequency there; check signs and units of the stiffness.",
        )
    return np.asarray((energy <= max(_ROUNDING, 10 * lowest)) | (parts == 0))


class ScaledFactors(NamedTuple):
    """Factors of a sparse matrix (n x n) whose rows and columns are scaled by `scale`, powers of two.

    `condition`: that of the scaled matrix.
    """

    matrix: Matrix
    factor: Factorisation
    scale: Array
    condition: float


def _same(new: Matrix, old: Matrix) -> bool:
    return new is old or all(
        np.array_equal(getattr(new, part), getattr(old, part)) for part in ("indptr", "indices", "data")
    )


@dataclass
class ModeMemory:
    """The last modes of large matrices, for those who ask for the same ones again.

    `seconds` is the time that modes took that were asked for again: the cost of work that shares them is
    its own time and that. `cost` is the time that the last modes took. `inverse` is a stiffness that was
    factorised for something else, for the next modes of it: they own the factors, and free them.
    """

    seconds: float = 0.0
    matrices: tuple[Matrix, Matrix, Matrix] | None = None
    backend: str = ""
    modes: Modes | None = None
    cost: float = 0.0
    inverse: ScaledFactors | None = None

    def take_inverse(self, K: Matrix) -> ScaledFactors | None:
        """Return the factors of a stiffness, if they are known, and forget them."""
        inverse, self.inverse = self.inverse, None
        return inverse if inverse is not None and _same(K, inverse.matrix) else None

    def recall(self, matrices: tuple[Matrix, Matrix, Matrix], count: int, backend: str) -> Modes | None:
        """Return the lowest modes of the same matrices, if they are known."""
        if self.matrices is None or self.modes is None:
            return None
        if self.backend != backend or count > len(self.modes.omega):
            return None
        if not all(map(_same, matrices, self.matrices)):
            return None
        self.seconds += self.cost
        return self.modes.first(count)


_memory: ContextVar[ModeMemory | None] = ContextVar("memory", default=None)


@contextmanager
def remembered_modes() -> Iterator[ModeMemory]:
    """Compute the lowest modes of the same large matrices only once within the block, or one around it."""
    memory = _memory.get() or ModeMemory()
    token = _memory.set(memory)
    try:
        yield memory
    finally:
        _memory.reset(token)


@guarded("the modes of the structure")
def modes(
    M: Matrix,
    C: Matrix,
    K: Matrix,
    count: int | None = None,
    below: float | None = None,
    backend: str = "auto",
    *,
    proof: bool = True,
) -> Modes:
    """Solve ``K phi = omega^2 M phi``, all of it or the lowest part, with no mode missed.

    The damping ratio of a mode is ``phi^T C phi / (2 omega)``, the diagonal of the modal damping matrix;
    it is the exact one where damping is proportional.

    `M`, `C`, `K`: mass (positive semidefinite), damping and stiffness (positive semidefinite) (n x n), dense
    or sparse. Directions without mass follow the others; they have no modes of their own. `count`: how many
    modes, the lowest; rigid-body modes included. `below`: or all modes below this frequency, rad/s; with
    both, as many of those as `count`. With neither, all modes.

    `backend`: ``auto``: dense matrices or, for few modes of many DOFs, sparse ones factorised by the C
    library; ``dense``; or a factorisation backend: ``ldl``, ``splu``, ``cholespy``, ``pardiso``; `proof`:
    True if sparse modes asked for by their number are proved complete by a count of pivots, which takes one
    factorisation more.

    Raises Singular if the stiffness is indefinite beyond rounding, or a motion has neither inertia nor
    stiffness, UsageError if more modes are asked for than there are with finite frequencies, the mass is
    indefinite, or the backend does not exist or is not installed, and NumericalError if residuals are too
    large or modes stay missing.
    """
    if count is not None and count < 1:
        raise UsageError("the number of modes must be 1 or more", names=("modes",))
    if below is not None and not 0 < below < np.inf:
        raise UsageError("modes are asked for below a frequency, which must be positive", names=("below",))
    if backend == "auto":
        backend = solver_for(K.shape[0], count, below, K.nnz if is_sparse(K) else 0)
    if backend != "dense":
        return _lowest_sparse(M, C, K, count, below, backend, proof)
    from dynid.structure.modes.dense import eigenpairs

    pencil = scaled(as_array(K), as_array(M))
    square, shapes, massless = eigenpairs(pencil)
    if count is not None and count > len(square):
        raise too_many(count, len(square))
    result = finished(pencil, C, square, shapes, massless=massless, counted=np.inf, method="dense matrices")
    kept = len(square) if below is None else int(np.count_nonzero(result.omega < below))
    return result.first(kept if count is None else min(count, kept))


def solver_for(size: int, count: int | None, below: float | None, entries: int = 0) -> str:
    """Return the backend that is chosen by size, entries, and how many modes are asked for."""
    from dynid.structure.backends import backend_for

    if size <= _SMALL:
        return "dense"
    few = count is not None and count <= size // _PART
    if few or (size > _LARGE and (count or below)):
        return backend_for(size, entries)
    if size > _LARGE:
        raise UsageError(
            f"all modes of {size} DOFs are asked for",
            remedy=f"Give their number, or a frequency below which they are; all are computed of up to "
            f"{_LARGE} DOFs.",
            names=("modes",),
        )
    return backend_for(size, entries) if below is not None else "dense"


def _lowest_sparse(
    M: Matrix, C: Matrix, K: Matrix, count: int | None, below: float | None, backend: str, proof: bool
) -> Modes:
    memory = _memory.get() if proof and all(is_sparse(matrix) for matrix in (M, C, K)) else None
    if memory is not None:
        if below is None and count is not None and (known := memory.recall((M, C, K), count, backend)):
            return known
        memory.matrices = memory.modes = None  # they need not be kept any longer
    inverse = None if memory is None else memory.take_inverse(K)
    started = perf_counter()
    from scipy.sparse import csc_array

    from dynid.structure.modes.sparse import SparseSpectrum

    pencil = scaled(csc_array(K), csc_array(M))
    spectrum = SparseSpectrum(pencil, backend)
    if below is not None:
        del inverse  # a count comes first
        square, shapes, counted = spectrum.below(below**2)
    elif count is not None:
        if inverse is not None:
            spectrum.start_from(*inverse[1:])
        del inverse  # the spectrum frees its factors before it counts
        square, shapes, counted = spectrum.lowest(count, proof=proof)
    else:
        raise UsageError(
            f"the backend {backend} computes the lowest modes: their number or a limit must be given",
            remedy="Use the backend dense for all modes.",
        )
    method = f"shift-invert Lanczos, {backend}"
    massless = len(pencil.without_mass)
    result = finished(pencil, C, square, shapes, massless=massless, counted=counted, method=method)
    if count is not None:
        result = result.first(min(count, len(square)))
    if memory is not None:
        memory.matrices, memory.backend, memory.modes = (M, C, K), backend, result
        memory.cost = perf_counter() - started
    return result
