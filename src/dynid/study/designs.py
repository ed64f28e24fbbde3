"""Points of the unit cube: at random, on a Latin hypercube, or of a Sobol sequence; and their correlation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dynid.errors import UsageError


def unit_samples(
    method: str, count: int, factors: int, seed: int, indices: bool = False
) -> NDArray[np.float64]:
    """Return points of the unit cube (samples x factors), strictly inside it.

    Parameters
    ----------
    method
        `random`, `latin-hypercube` (one point at random in each of `count` strata of each factor) or `sobol`
        (scrambled; a power of two is balanced).
    count
        How many.
    factors
        Of how many dimensions.
    seed
        The same seed gives the same points.
    indices
        Saltelli's design instead, for Sobol indices: `count * (factors + 2)` points, the blocks A, B and, for
        each factor i, A with its column i from B.

    References
    ----------
    A. Saltelli et al., "Variance based sensitivity analysis of model output", Comput. Phys. Commun. 181
    (2010) 259-270.
    """
    if method == "random":
        points = np.random.default_rng(seed).random((count, factors))
    elif method == "latin-hypercube":
        from scipy.stats import qmc

        points = qmc.LatinHypercube(factors, rng=np.random.default_rng(seed)).random(count)
    elif indices:
        both = _sobol(count, 2 * factors, seed)
        return _saltelli(both[:, :factors], both[:, factors:])
    else:
        points = _sobol(count, factors, seed)
    return _inside(points)


def _sobol(count: int, factors: int, seed: int) -> NDArray[np.float64]:
    from scipy.stats import qmc

    drawn = qmc.Sobol(factors, scramble=True, rng=np.random.default_rng(seed)).random_base2(
        max(0, int(count - 1).bit_length())
    )
    points: NDArray[np.float64] = drawn[:count]
    return _inside(points)


def _saltelli(A: NDArray[np.float64], B: NDArray[np.float64]) -> NDArray[np.float64]:
    mixed = []
    for factor in range(A.shape[1]):
        block = A.copy()
        block[:, factor] = B[:, factor]
        mixed.append(block)
    return np.concatenate([A, B, *mixed])


def _inside(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Keep away from the ends, which unbounded distributions have at infinity."""
    return np.clip(points, 2.0**-54, 1 - 2.0**-53)


def correlated(
    unit: NDArray[np.float64], pairs: Sequence[tuple[int, int, float]], strata: bool
) -> NDArray[np.float64]:
    """Give points of the unit cube correlations of their normal scores.

    Parameters
    ----------
    unit
        Independent points (samples x factors).
    pairs
        Two factors and their correlation, each.
    strata
        Whether the values of each factor are only put into another order (Iman & Conover), so that a Latin
        hypercube stays one; else they are those of a Gaussian copula.

    Raises
    ------
    UsageError
        Where no distribution has these correlations.

    References
    ----------
    R. L. Iman, W. J. Conover, "A distribution-free approach to inducing rank correlation among input
    variables", Commun. Stat. B 11 (1982) 311-334.
    """
    if not pairs:
        return unit
    from scipy.special import ndtr, ndtri

    wanted = np.eye(unit.shape[1])
    for one, other, value in pairs:
        wanted[one, other] = wanted[other, one] = value
    try:
        root = np.linalg.cholesky(wanted)
    except np.linalg.LinAlgError:
        raise UsageError(
            "no values have these correlations at once: their matrix is not positive definite",
            remedy="Make them smaller, or give those of the remaining pairs too.",
            names=["sampling.correlation"],
        ) from None
    scores = ndtri(unit)
    if not strata:
        return _inside(ndtr(scores @ root.T))
    if len(unit) > unit.shape[1]:
        found = np.atleast_2d(np.corrcoef(scores, rowvar=False))
        scores = np.linalg.solve(np.linalg.cholesky(found), ((scores - scores.mean(0)) / scores.std(0)).T).T
    target = scores @ root.T
    ordered = np.sort(unit, axis=0)
    ranks = np.argsort(np.argsort(target, axis=0, kind="stable"), axis=0, kind="stable")
    return np.take_along_axis(ordered, ranks, axis=0)
