"""Modes of a structure, by the method that fits its size."""

from __future__ import annotations

import numpy as np

from dynid.choices import ALL_MODES, BACKEND, DENSE_MODES, FEW_MODES
from dynid.errors import UsageError
from dynid.lti.floating import guarded
from dynid.structure.matrices import Matrix, as_array
from dynid.structure.modes.pencil import Pencil, scaled
from dynid.structure.modes.solution import Modes, finished, too_many

# Below this size dense matrices are faster whatever is asked; above the other, out of question.
_SMALL, _LARGE = DENSE_MODES.value, ALL_MODES.value
# The part of all modes beyond which Lanczos is slower than dense matrices.
_PART = FEW_MODES.value


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

    Parameters
    ----------
    M, C, K
        Mass (positive semidefinite), damping and stiffness (positive semidefinite) (n x n), dense or sparse.
        Directions without mass follow the others; they have no modes of their own.
    count
        How many modes, the lowest; rigid-body modes included.
    below
        Or all modes below this frequency, rad/s; with both, as many of those as `count`. With neither,
        all modes.
    backend
        ``auto``: dense matrices or, for few modes of many DOFs, sparse ones factorised by SuperLU;
        ``dense``; or a factorisation backend: ``splu``, ``cholespy``, ``pardiso``.
    proof
        Whether sparse modes asked for by their number are proved complete by a count of pivots, which
        takes one factorisation more.

    Raises
    ------
    Singular
        If the stiffness is indefinite beyond rounding, or a motion has neither inertia nor stiffness.
    UsageError
        If more modes are asked for than there are with finite frequencies, the mass is indefinite, or the
        backend does not exist or is not installed.
    NumericalError
        If residuals are too large or modes stay missing.
    """
    _check(count, below)
    if backend == "auto":
        backend = solver_for(K.shape[0], count, below)
    if backend == "dense":
        return _dense(scaled(as_array(K), as_array(M)), C, count, below)
    return _sparse(M, C, K, count, below, backend, proof)


def _check(count: int | None, below: float | None) -> None:
    if count is not None and count < 1:
        raise UsageError("the number of modes must be 1 or more", names=("modes",))
    if below is not None and not 0 < below < np.inf:
        raise UsageError("modes are asked for below a frequency, which must be positive", names=("below",))


def solver_for(size: int, count: int | None, below: float | None) -> str:
    """Return the backend that is chosen by size, and by how many modes are asked for."""
    if size <= _SMALL:
        return "dense"
    few = count is not None and count <= size // _PART
    if few or (size > _LARGE and (count or below)):
        return BACKEND.value
    if size > _LARGE:
        raise UsageError(
            f"all modes of {size} DOFs are asked for",
            remedy=f"Give their number, or a frequency below which they are; all are computed of up to "
            f"{_LARGE} DOFs.",
            names=("modes",),
        )
    return BACKEND.value if below is not None else "dense"


def _dense(pencil: Pencil, C: Matrix, count: int | None, below: float | None) -> Modes:
    from dynid.structure.modes.dense import eigenpairs

    square, shapes, massless = eigenpairs(pencil)
    if count is not None and count > len(square):
        raise too_many(count, len(square))
    found = finished(pencil, C, square, shapes, massless=massless, counted=np.inf, method="dense matrices")
    kept = len(square) if below is None else int(np.count_nonzero(found.omega < below))
    return found.first(kept if count is None else min(count, kept))


def _sparse(
    M: Matrix, C: Matrix, K: Matrix, count: int | None, below: float | None, backend: str, proof: bool
) -> Modes:
    from scipy.sparse import csc_array

    from dynid.structure.modes.sparse import Spectrum

    pencil = scaled(csc_array(K), csc_array(M))
    spectrum = Spectrum(pencil, backend)
    if below is not None:
        square, shapes, counted = spectrum.below(below**2)
    elif count is not None:
        square, shapes, counted = spectrum.lowest(count, proof=proof)
    else:
        raise UsageError(
            f"the backend {backend} computes the lowest modes: their number or a limit must be given",
            remedy="Use the backend dense for all modes.",
        )
    method = f"shift-invert Lanczos, {backend}"
    massless = len(pencil.without_mass)
    found = finished(pencil, C, square, shapes, massless=massless, counted=counted, method=method)
    return found if count is None else found.first(min(count, len(square)))
