"""Intervals where those of the information do not hold: by profile likelihood, and within limits.

The profile of a parameter is the misfit as its function, the others at their optimum. Where the likelihood
ripples, or falls to a plateau, its quantile of chi-squared is passed long before the probability beyond is
small. So the profile is integrated: the interval has 2.5 % of ``exp(-misfit)`` on either side, which is the
interval of the information where the likelihood is Gaussian.

Source: L. Tierney, J. B. Kadane, J. Am. Stat. Assoc. 81 (1986) 82–86, eq 2.4, the determinant of the others
taken as constant.

Where a limit cuts the likelihood of the linearised model off, ``exp(-|r - J d|^2 / 2)`` for a change d of the
coordinates from the estimate (r: weighted residuals, J: derivatives), means and intervals are those of seeded
samples: Gibbs sampling along the principal axes of J, in which the Gaussian has independent components, and
along the coordinates, in turn, each from its exact conditional distribution. J. Geweke, Proc. 23rd Symposium
on the Interface (1991) 571–578; C. P. Robert, Stat. Comput. 5 (1995) 121–125.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from dynid.arrays import Array, guarded
from dynid.errors import DynidError
from dynid.identification.estimators.maximum_likelihood import refine
from dynid.identification.likelihood.likelihood import Fit, Likelihood
from dynid.identification.statistics import HALF_WIDTH, TAIL_PROBABILITY

# A step outwards is this part of a standard error, or of the distance so far.
_STEP, _GROWTH = 0.5, 0.125
# The steps end so many standard errors away, or where the misfit has exceeded the least by so much from four
# fifths of the distance on: a likelihood of 1 in 3,000.
_REACH, _NEGLIGIBLE, _BEYOND = 6.0, 8.0, 1.25
# The farthest coordinate, in units: a factor of a thousand of a logarithm.
_FARTHEST = math.log(1e3)
# Steps in which the other parameters follow.
_FOLLOWING_STEPS = 8
# Points between two steps at which the profile is interpolated, and a rise that stands for an infinite one.
_FINE, _IMPOSSIBLE = 20, 100.0


class _ProfilePoint(NamedTuple):
    """Coordinates (p) of a point of a profile, and by how much the misfit exceeds that of the fit there."""

    eta: Array
    rise: float


@dataclass(frozen=True, eq=False)
class Profile:
    """The misfit as a function of one parameter, the others at their optimum."""

    likelihood: Likelihood  # the likelihood of the records
    fit: Fit  # a fit at its maximum
    k: int  # index of the parameter

    def at(self, coordinate: float, beside: Array | None = None) -> _ProfilePoint:
        """Return the point at a coordinate of the parameter; of infinite rise where there is no model.

        The others follow from coordinates (p) `beside` it, by default those of the fit.
        """
        start = self.fit.eta if beside is None else beside
        eta = np.where(np.arange(len(start)) == self.k, coordinate, start)
        priors = self.likelihood.priors.holding(self.k, coordinate)
        try:
            with guarded("the prediction"):
                fit = refine(replace(self.likelihood, stated_priors=priors), eta, _FOLLOWING_STEPS).fit
        except (DynidError, np.linalg.LinAlgError):
            return _ProfilePoint(eta, math.inf)
        return _ProfilePoint(fit.eta, self.likelihood.misfit(fit) - self.likelihood.misfit(self.fit))

    def towards(self, side: int, deviation: float) -> list[_ProfilePoint]:
        """Return points on a side (+1 or -1), the fit first, to where the likelihood is negligible.

        Or to the limit of the parameter, or a factor of a thousand. `deviation`: its standard error.
        """
        priors, centre = self.likelihood.priors, float(self.fit.eta[self.k])
        limit = float(priors.high[self.k] - centre if side > 0 else centre - priors.low[self.k])
        farthest = min(limit, max(_FARTHEST * priors.units[self.k], _REACH * deviation))
        points, distance, reach = [_ProfilePoint(self.fit.eta, 0.0)], 0.0, _REACH * deviation
        while distance < min(reach, farthest):
            distance = min(distance + max(_STEP * deviation, _GROWTH * distance), farthest)
            points.append(self.at(centre + side * distance, points[-1].eta))
            if points[-1].rise < _NEGLIGIBLE:
                reach = max(reach, _BEYOND * distance)
        return points


class _ProfileIntervals(NamedTuple):
    """Ends of the 95 % intervals of the coordinates (p each), and the best point met on the way."""

    low: Array
    high: Array
    best: _ProfilePoint


def profile_intervals(likelihood: Likelihood, fit: Fit, deviations: Array) -> _ProfileIntervals:
    """Return the intervals of all parameters that are not fixed.

    An end is infinite where the records do not limit the parameter within a factor of a thousand.

    `likelihood`, `fit`: the likelihood of the records and a fit at its maximum; `deviations`: standard
    errors of the coordinates (p).
    """
    low, high, best = fit.eta.copy(), fit.eta.copy(), _ProfilePoint(fit.eta, 0.0)
    for k in np.flatnonzero(~likelihood.priors.fixed).tolist():
        profile = Profile(likelihood, fit, k)
        below, above = (profile.towards(side, float(deviations[k])) for side in (-1, 1))
        points = [*below[:0:-1], *above]
        x = np.array([point.eta[k] for point in points])
        low[k], high[k] = _quantiles(x, np.array([point.rise for point in points]))
        if below[-1].rise < _NEGLIGIBLE and x[0] > likelihood.priors.low[k]:
            low[k] = -math.inf
        if above[-1].rise < _NEGLIGIBLE and x[-1] < likelihood.priors.high[k]:
            high[k] = math.inf
        best = min([best, *points], key=lambda point: point.rise)
    return _ProfileIntervals(low, high, best)


def _quantiles(x: Array, rise: Array) -> tuple[float, float]:
    """Return the 2.5 % and 97.5 % quantiles of the density ``exp(-rise)`` at increasing points x."""
    from scipy.interpolate import PchipInterpolator  # heavy import, needed here only

    fine = np.interp(np.linspace(0, len(x) - 1, _FINE * (len(x) - 1) + 1), np.arange(len(x)), x)
    density = np.exp(-PchipInterpolator(x, np.minimum(rise - rise.min(), _IMPOSSIBLE))(fine))
    share = np.concatenate([[0.0], np.cumsum(np.diff(fine) * (density[1:] + density[:-1]))])
    low, high = np.interp([TAIL_PROBABILITY, 1 - TAIL_PROBABILITY], share / share[-1], fine)
    return float(low), float(high)


#: Distance of a limit, in standard deviations, beyond which it cuts off nothing.
REACH_DEVIATIONS = 6.0
# Chains, sweeps before the first sample, samples of each chain, sweeps between them, and the seed.
_CHAINS, _BURN_IN_SWEEPS, _SAMPLES_OF_CHAIN, _THINNING, _GIBBS_SEED = 256, 40, 48, 2, 20261128
# Exponents over a chord below which a density counts as exponential, or as uniform.
_EXPONENTIAL_EXPONENT, _UNIFORM_EXPONENT = 1e-6, 1e-9


@dataclass(frozen=True, eq=False)
class LimitedPosterior:
    """Standard deviations, intervals and samples of coordinates within limits."""

    deviations: Array  # standard deviations (p)
    # `low`, `high`: ends of the 95 % intervals (p)
    low: Array
    high: Array
    # Samples (samples x p); None where no limit matters, and the posterior is Gaussian.
    samples: Array | None = None

    @classmethod
    def of(
        cls, eta: Array, deviations: Array, rows: Array, residual: Array, limits: tuple[Array, Array]
    ) -> LimitedPosterior:
        """Return the posterior of coordinates about an estimate.

        `eta`: the estimate (p); `deviations`: standard deviations without limits (p). `rows`, `residual`:
        derivatives (values x p) and residuals (values) over their deviations; `limits`: least and largest
        coordinates (p), infinite where there are none.
        """
        low, high = limits
        free = low < high
        near = (eta - low < REACH_DEVIATIONS * deviations) | (high - eta < REACH_DEVIATIONS * deviations)
        if not near[free].any():
            half = HALF_WIDTH * deviations
            return cls(deviations, eta - half, eta + half)
        samples = np.tile(eta, (_CHAINS * _SAMPLES_OF_CHAIN, 1))
        below, above = (low - eta)[free], (high - eta)[free]
        samples[:, free] += _sampled(rows[:, free], residual, below, above, deviations[free])
        ends = np.quantile(samples, [TAIL_PROBABILITY, 1 - TAIL_PROBABILITY], axis=0)
        return cls(samples.std(axis=0), ends[0], ends[1], samples)

    def widened(self, low: Array, high: Array) -> LimitedPosterior:
        """Return the posterior with intervals that hold those from `low` to `high` (p each).

        Standard deviations are those of Gaussians with the wider half of each; an end that is infinite does
        not count.
        """
        low, high = np.minimum(self.low, low), np.maximum(self.high, high)
        middle = (self.low + self.high) / 2
        ends = np.array([middle - low, high - middle])
        half = np.max(np.where(np.isfinite(ends), ends, 0.0), axis=0)
        return replace(self, deviations=np.maximum(self.deviations, half / HALF_WIDTH), low=low, high=high)


def _sampled(rows: Array, residual: Array, low: Array, high: Array, deviations: Array) -> Array:
    """Return samples of changes of the coordinates within limits (samples x p)."""
    scale = np.minimum(deviations, high - low)
    _, R = np.linalg.qr(np.column_stack([rows * scale, residual]))
    J, r = R[:, :-1], R[:, -1]
    low, high = low / scale, high / scale
    axes = np.linalg.svd(J)[2]
    directions = np.concatenate([axes, np.eye(len(scale))])
    changes = (J @ directions.T).T
    generator = np.random.default_rng(_GIBBS_SEED)
    x = np.zeros((_CHAINS, len(scale)))
    kept = []
    for sweep in range(1, _BURN_IN_SWEEPS + _SAMPLES_OF_CHAIN * _THINNING + 1):
        left = r - x @ J.T
        for d, change in zip(directions, changes, strict=True):
            with np.errstate(divide="ignore", invalid="ignore"):
                ends = np.stack([(low - x) / d, (high - x) / d])
            ends[:, :, d == 0] = np.array([-np.inf, np.inf])[:, None, None]
            first = np.min(ends, axis=0).max(axis=1)
            last = np.max(ends, axis=0).min(axis=1)
            first, last = np.minimum(first, 0.0), np.maximum(last, 0.0)
            step = _drawn(change @ change, left @ change, first, last, generator.random(_CHAINS))
            x, left = x + step[:, None] * d, left - step[:, None] * change
        x = np.clip(x, low, high)
        if sweep > _BURN_IN_SWEEPS and (sweep - _BURN_IN_SWEEPS) % _THINNING == 0:
            kept.append(x)
    return np.asarray(np.concatenate(kept) * scale)


def _drawn(curvature: float, slope: Array, first: Array, last: Array, uniform: Array) -> Array:
    """Return draws t in [first, last] with the density ``exp(slope t - curvature t^2 / 2)`` (chains)."""
    from scipy.special import log_ndtr, ndtri_exp  # heavy import, needed here only

    chord = last - first
    if np.all(curvature * chord**2 < _EXPONENTIAL_EXPONENT):  # exponential; of no slope uniform
        lift = slope * chord
        flat = np.abs(lift) < _UNIFORM_EXPONENT
        safe = np.where(flat, 1.0, lift)
        # From the end where it is greatest, lest the exponential overflow.
        size = np.abs(safe)
        depth = -np.log1p(uniform * np.expm1(-size)) / size
        fraction = np.where(flat, uniform, np.where(safe > 0, 1 - depth, depth))
        return np.asarray(first + chord * fraction)
    deviation, mean = 1 / np.sqrt(curvature), slope / curvature
    a, b = (first - mean) / deviation, (last - mean) / deviation
    mirrored = a > 0  # in the lower tail, whose logarithm is exact
    a, b = np.where(mirrored, -b, a), np.where(mirrored, -a, b)
    below, above = log_ndtr(a), log_ndtr(b)
    z = ndtri_exp(above + np.log(uniform + (1 - uniform) * np.exp(below - above)))
    z = np.where(mirrored, -z, z)
    return np.asarray(np.clip(mean + deviation * z, first, last))
