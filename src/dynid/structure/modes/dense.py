"""All modes of small structures, by dense matrices."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array
from dynid.errors import Singular, UsageError
from dynid.structure.modes.pencil import Pencil, StrainEnergy

# A spread of eigenvalues beyond which the low ones lose digits to the high ones in one decomposition.
_MAX_EIGENVALUE_RATIO = 1e4
# The widest part of a spectrum that one shift resolves: to eps times its root at both ends.
_WINDOW = 1e10
# Eigenvectors with larger residuals are corrected, if so many products in twice the precision suffice.
_FINE, _CORRECTIONS, _AFFORDABLE = 1e-13, 4, 100_000_000
# The largest correction of first order that is one.
_FIRST_ORDER = 0.1


def eigenpairs(pencil: Pencil) -> tuple[Array, Array, int]:
    """Return the finite eigenvalues, eigenvectors of unit modal mass, and the number of infinite ones.

    Directions without mass follow the others without inertia: they are condensed exactly.

    Raises Singular if a motion has neither inertia nor strain energy, and UsageError if the mass is
    indefinite.
    """
    K, M = np.asarray(pencil.K), np.asarray(pencil.M)
    back, K, M = condense_massless(K, M, pencil.without_mass)
    T, K, M = _condensed_to_range(K, M)
    square, shapes = _beside_free(K, M)
    return square, back @ (T @ shapes), pencil.size - len(M)


def condense_massless(K: Array, M: Array, zero: NDArray[np.intp]) -> tuple[Array, Array, Array]:
    """Condense DOFs without mass; return the way back (n x kept) and the condensed matrices."""
    n = len(K)
    if len(zero) == 0:
        return np.eye(n), K, M
    keep = np.setdiff1d(np.arange(n), zero)
    if np.any(M[zero]):
        raise UsageError(
            f"the mass matrix is indefinite: DOF {zero[np.argmax(np.any(M[zero], axis=1))] + 1} has no mass "
            "on the diagonal, but beside it",
            remedy="Check the mass matrix.",
        )
    follow = -_solved(K[np.ix_(zero, zero)], K[np.ix_(zero, keep)])
    back = np.zeros((n, len(keep)))
    back[keep, np.arange(len(keep))] = 1.0
    back[zero] = follow
    condensed = K[np.ix_(keep, keep)] + K[np.ix_(keep, zero)] @ follow
    return back, (condensed + condensed.T) / 2, M[np.ix_(keep, keep)]


def _condensed_to_range(K: Array, M: Array) -> tuple[Array, Array, Array]:
    """Condense the rest of the null space of M: directions that are no single DOFs."""
    from scipy.linalg import cholesky, eigh

    d = 1 / np.sqrt(np.diag(M))
    K, M = K * d * d[:, None], M * d * d[:, None]
    tolerance = len(M) * float(np.finfo(float).eps)
    try:
        pivots = np.diag(cholesky(M)) ** 2
        if pivots.min(initial=1.0) > 100 * tolerance:
            return np.diag(d), K, M
    except np.linalg.LinAlgError:
        pass
    inertia, Q = eigh(M)
    if inertia[0] < -10 * tolerance:
        raise UsageError(
            f"the mass matrix is indefinite (it has a negative eigenvalue, {inertia[0]:.2g} when scaled to a "
            "unit diagonal)",
            remedy="Check signs and units of the masses.",
        )
    null = inertia <= 10 * tolerance
    R, Z = Q[:, ~null], Q[:, null]
    T = R - Z @ _solved(Z.T @ K @ Z, Z.T @ K @ R)
    condensed = T.T @ K @ T
    return d[:, None] * T, (condensed + condensed.T) / 2, np.diag(inertia[~null])


def _solved(K: Array, right: Array) -> Array:
    """Solve with the stiffness of massless directions, which must hold them."""
    from scipy.linalg import cho_factor, cho_solve

    d = np.sqrt(np.abs(np.diag(K)))
    d = np.where(d > 0, d, 1.0)
    try:
        factor = cho_factor(K / d / d[:, None])
        if np.diag(factor[0]).min(initial=1.0) ** 2 <= 10 * len(K) * np.finfo(float).eps:
            raise np.linalg.LinAlgError
    except np.linalg.LinAlgError:
        raise Singular(
            "massless DOFs can move without strain: the structure has a motion with neither inertia nor "
            "stiffness",
            remedy="Give them mass, or join them.",
        ) from None
    return np.asarray(cho_solve(factor, right / d[:, None]) / d[:, None])


def _beside_free(K: Array, M: Array) -> tuple[Array, Array]:
    """Solve the regular problem; DOFs that nothing at all holds are rigid bodies, and exactly so.

    The other modes have no momentum with them: the free DOFs follow by their mass.
    """
    from scipy.linalg import cholesky, solve_triangular

    held = np.any(K, axis=0)
    if held.all():
        return by_windows(K, M)
    rigid = solve_triangular(cholesky(M[np.ix_(~held, ~held)]), np.eye(int(np.sum(~held))))
    follow = -rigid @ (rigid.T @ M[np.ix_(~held, held)])
    square, elastic = by_windows(
        K[np.ix_(held, held)], M[np.ix_(held, held)] + M[np.ix_(held, ~held)] @ follow
    )
    shapes = np.zeros((len(K), len(K)))
    first = rigid.shape[1]
    shapes[~held, :first] = rigid
    shapes[~held, first:], shapes[held, first:] = follow @ elastic, elastic
    return np.concatenate([np.zeros(first), square]), shapes


def by_windows(K: Array, M: Array) -> tuple[Array, Array]:
    """Solve the regular problem; where the spectrum is wide, the low part by inverted problems.

    ``eigh(K, M)`` has absolute errors of eps times the highest eigenvalue; ``eigh(M, K + a M)``, whose
    eigenvalues are 1/(lambda + a), resolves those about a instead. From the top down each window of the
    spectrum is taken from a problem of its own; one is enough but for spectra of 16 decades and more.
    """
    from scipy.linalg import eigh

    if len(K) == 0:
        return np.zeros(0), np.zeros((0, 0))
    square, shapes = eigh(K, M)
    top = float(np.abs(square).max())
    rounding = len(K) * float(np.finfo(float).eps) * top
    stiff = np.diag(K) > 0
    bound = (np.diag(K)[stiff] / np.diag(M)[stiff]).min(initial=top)  # where rounding hides the lowest
    elastic = float(square[square > 10 * rounding].min(initial=bound))
    if top == 0 or square[0] < -1e-3 * top or elastic * _MAX_EIGENVALUE_RATIO > top:
        return square, shapes
    levels = max(1, int(np.ceil(np.log(top / elastic) / np.log(_WINDOW))))
    ratio = float((top / elastic) ** (1 / levels))
    for level in reversed(range(levels)):
        shift = elastic * ratio**level
        try:
            inverse, inverted = eigh(M, K + shift * M)
        except np.linalg.LinAlgError:  # K is indefinite: said by who checks the eigenvalues
            break
        split = int(np.count_nonzero(square < shift * np.sqrt(ratio)))
        low = inverse[::-1][:split]
        square[:split] = 1 / low - shift
        # Unit modal mass: the eigenvectors have unit phi^T (K + a M) phi.
        shapes[:, :split] = inverted[:, ::-1][:, :split] / np.sqrt(low)
    return _corrected(K, M, square, shapes)


def _corrected(K: Array, M: Array, square: Array, shapes: Array) -> tuple[Array, Array]:
    """Correct eigenpairs of a wide spectrum to first order, their energies summed in twice the precision.

    With ``S = X^T K X`` and ``R = X^T M X`` nearly diagonal, ``X (I + E)`` diagonalises both for
    ``e_ij = (lambda_j r_ij - s_ij) / (lambda_i - lambda_j)`` (T. Ogita, K. Aishima, Japan J. Indust. Appl.
    Math. 35 (2018) 1007-1035, for pencils): shares that rounding has left in each other are taken out.
    """
    if len(K) ** 3 > _AFFORDABLE:
        return square, shapes
    exact, stiffness, mass = StrainEnergy(K), np.abs(K), np.abs(M)
    for _ in range(_CORRECTIONS):
        size = np.abs(shapes)
        sizes = np.linalg.norm(stiffness @ size + np.abs(square) * (mass @ size), axis=0)
        wrong = np.linalg.norm(K @ shapes - square * (M @ shapes), axis=0)
        if np.all(wrong <= _FINE * sizes):
            break
        S, R = exact.gram(shapes, shapes), shapes.T @ M @ shapes
        square = np.diag(S) / np.diag(R)
        gap = square[:, None] - square
        E = np.divide(square * R - S, gap, out=np.full_like(S, np.inf), where=gap != 0)
        E = np.where(np.abs(E) * np.sqrt(np.diag(R)[:, None] / np.diag(R)) < _FIRST_ORDER, E, 0.0)
        shapes = (shapes + shapes @ E) / np.sqrt(np.diag(R))
    return square, shapes
