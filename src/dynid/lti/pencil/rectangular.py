"""Finite zeros in floating point of pencils of any shape and rank, counted exactly beforehand."""

from __future__ import annotations

import numpy as np

from dynid.errors import Undecided
from dynid.lti.pencil.eigenvalues import (
    EXACT,
    FiniteEigenvalues,
    finite_eigenvalues,
    scaled,
    settle_origin,
)
from dynid.lti.pencil.integer import IntegerPencil, Structure

#: The rank falls where the smallest singular value is below the first share; elsewhere it exceeds the second.
_FALLS, _STANDS = 1e-11, 1e-7


def checked_zeros(pencil: IntegerPencil) -> tuple[FiniteEigenvalues, Structure]:
    """Return the finite zeros of a pencil with error bounds, and its exact structure.

    Raises
    ------
    Undecided
        Where floating point does not find as many as there are.
    """
    structure = pencil.structure()
    if structure.finite == 0:
        return FiniteEigenvalues(np.zeros(0, complex), np.zeros(0), 0), structure
    F, G = pencil.floats()
    if pencil.shape == (structure.rank, structure.rank):
        return finite_eigenvalues(F, G, structure.finite, origin=structure.origin), structure
    return _of_compression(F, G, structure), structure


def _of_compression(F: np.ndarray, G: np.ndarray, structure: Structure) -> FiniteEigenvalues:
    """Return those eigenvalues of a random square compression at which the whole pencil's rank falls.

    At a zero of the pencil every compression is singular; its other eigenvalues are zeros of nothing.
    """
    from scipy.sparse import csr_array

    sparse_F, sparse_G, unit = scaled(csr_array(F), csr_array(G))
    F, G = sparse_F.toarray(), sparse_G.toarray()
    rank, generator = structure.rank, np.random.default_rng(0)
    U = np.linalg.qr(generator.standard_normal((F.shape[0], rank)))[0].T
    V = np.linalg.qr(generator.standard_normal((F.shape[1], rank)))[0]
    found = finite_eigenvalues(U @ F @ V, U @ G @ V)
    floor = np.array([_lowest(F, G, z, rank) for z in found.values])
    order = np.argsort(floor, kind="stable")
    kept, others = order[: structure.finite], order[structure.finite :]
    if len(kept) < structure.finite or not ((floor[kept] < _FALLS).all() and (floor[others] > _STANDS).all()):
        raise Undecided(
            f"rounding hides which points are the {structure.finite} zeros of a pencil of rank {rank}",
            remedy=EXACT,
        )
    kept = np.sort(kept)
    values, bounds = found.values[kept] * unit, found.bounds[kept] * unit
    settle_origin(values, bounds, structure.origin)
    return FiniteEigenvalues(values, bounds, rank - structure.finite)


def _lowest(F: np.ndarray, G: np.ndarray, z: complex, rank: int) -> float:
    """Return how far the pencil is from a lower rank at a point, relative to its terms there."""
    smallest = np.linalg.svd(z * F - G, compute_uv=False)[rank - 1]
    return float(smallest / (abs(z) * np.linalg.norm(F) + np.linalg.norm(G))) if smallest else 0.0
