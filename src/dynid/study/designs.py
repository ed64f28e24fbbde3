"""Experimental designs: points of the unit cube, their correlation, and quantiles of distributions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from dynid.errors import UsageError
from dynid.scene.schema.study import Listed, Normal, Spread, Triangular, Uniform

if TYPE_CHECKING:
    from collections.abc import Sequence

    from dynid.scene.schema.quantities import Quantity
    from dynid.scene.schema.study import StudyFactor


def spread(factor: StudyFactor) -> NDArray[Any]:
    """Return the values of a factor on a grid: evenly spaced, or at equal steps of probability."""
    count = cast("int", getattr(factor, "points", None))
    if not isinstance(factor, Spread):
        return cast("NDArray[Any]", quantiles(factor, (np.arange(count) + 0.5) / count))
    start, stop = factor.start, factor.stop
    if factor.scale == "log":
        values = np.geomspace(float(start), float(stop), count)
    else:
        step = (stop.exact - start.exact) / max(1, count - 1)
        is_integer = start.exact.denominator == step.denominator == 1
        if is_integer and abs(start.exact) <= 2**53:  # seeds, sizes, numbers of modes
            return np.array([int(start.exact + step * index) for index in range(count)], dtype=np.int64)
        values = np.linspace(float(start), float(stop), count)
    values[[0, -1]] = float(start), float(stop) if count > 1 else float(start)
    return values


def quantiles(factor: StudyFactor, unit: NDArray[np.float64]) -> NDArray[Any] | Sequence[Any]:
    """Return the quantiles of a factor's distribution at probabilities strictly between 0 and 1.

    A range is uniform on its scale; listed values are equally likely.
    """
    if isinstance(factor, Listed):
        count = len(factor.values)
        return [factor.values[index] for index in np.minimum((unit * count).astype(int), count - 1)]
    if isinstance(factor, Spread):
        return _between(float(factor.start), float(factor.stop), unit, factor.scale == "log")
    if isinstance(factor, Uniform):
        if factor.distribution == "integer":
            low, high = int(factor.low.exact), int(factor.high.exact)
            return low + np.minimum((unit * (high - low + 1)).astype(np.int64), high - low)
        return _between(float(factor.low), float(factor.high), unit, factor.distribution == "loguniform")
    if isinstance(factor, Triangular):
        left, mode, right = float(factor.low), float(factor.mode), float(factor.high)
        below = left + np.sqrt(unit * (right - left) * (mode - left))
        above = right - np.sqrt((1 - unit) * (right - left) * (right - mode))
        return np.where(unit * (right - left) < mode - left, below, above)
    return _normal(factor, unit)


def _between(low: float, high: float, unit: NDArray[np.float64], log: bool) -> NDArray[np.float64]:
    if log:
        return math.copysign(1, low) * np.exp(
            math.log(abs(low)) + unit * (math.log(abs(high)) - math.log(abs(low)))
        )
    return low + unit * (high - low)


def _normal(factor: Normal, unit: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return quantiles of a Gaussian or lognormal distribution, truncated at its bounds."""
    from scipy.special import ndtr, ndtri

    mean, std = float(factor.mean), float(factor.std)
    log = factor.distribution == "lognormal"
    if log:  # mean and deviation of the logarithm, from those of the value
        variance = math.log1p((std / mean) ** 2)
        mean, std = math.log(mean) - variance / 2, math.sqrt(variance)

    def score(bound: Quantity | None, absent: float) -> float:
        if bound is None:
            return absent
        value = float(bound)
        if log:
            value = math.log(value) if value > 0 else -math.inf
        return (value - mean) / std

    low, high = score(factor.low, -math.inf), score(factor.high, math.inf)
    if low > 0:  # probabilities of the upper tail, close to 1, would lose digits
        scores = -ndtri(ndtr(-low) + unit * (ndtr(-high) - ndtr(-low)))
    else:
        scores = ndtri(ndtr(low) + unit * (ndtr(high) - ndtr(low)))
    values = mean + std * np.clip(scores, low, high)
    return cast("NDArray[np.float64]", np.exp(values) if log else values)


def unit_samples(
    method: str, count: int, factors: int, seed: int, indices: bool = False
) -> NDArray[np.float64]:
    """Return points inside the unit cube (samples x factors); equal seeds give equal points.

    Methods: `random`, `latin-hypercube` (one point at random in each of `count` strata of each factor) or
    `sobol` (scrambled; a power of two is balanced). With `indices` it is Saltelli's design for Sobol indices:
    `count * (factors + 2)` points, the blocks A, B and, for each factor i, A with its column i from B.

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
        A, B = both[:, :factors], both[:, factors:]
        mixed = [np.where(np.arange(factors) == factor, B, A) for factor in range(factors)]
        return np.concatenate([A, B, *mixed])
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


def _inside(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Clip probabilities to inside (0, 1): the ends of unbounded distributions are infinite."""
    return np.clip(points, 2.0**-54, 1 - 2.0**-53)


def correlated(
    unit: NDArray[np.float64], pairs: Sequence[tuple[int, int, float]], strata: bool
) -> NDArray[np.float64]:
    """Return points of the unit cube (samples x factors) whose normal scores have given correlations.

    `pairs` are pairs of factors with their correlation. With `strata` the values of each factor are reordered
    (Iman & Conover), which keeps a Latin hypercube; else by a Gaussian copula. Raises `UsageError` if the
    correlation matrix is not positive definite.

    References
    ----------
    R. L. Iman, W. J. Conover, "A distribution-free approach to inducing rank correlation among input
    variables", Commun. Stat. B 11 (1982) 311-334.
    """
    if not pairs:
        return unit
    from scipy.special import ndtr, ndtri

    correlations = np.eye(unit.shape[1])
    for row, column, value in pairs:
        correlations[row, column] = correlations[column, row] = value
    try:
        root = np.linalg.cholesky(correlations)
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
        sample_correlations = np.atleast_2d(np.corrcoef(scores, rowvar=False))
        scores = np.linalg.solve(
            np.linalg.cholesky(sample_correlations), ((scores - scores.mean(0)) / scores.std(0)).T
        ).T
    target = scores @ root.T
    ordered = np.sort(unit, axis=0)
    ranks = np.argsort(np.argsort(target, axis=0, kind="stable"), axis=0, kind="stable")
    return np.take_along_axis(ordered, ranks, axis=0)
