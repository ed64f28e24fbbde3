"""Intervals by profile likelihood, where the likelihood contradicts those of the information.

The profile of a parameter is the misfit as its function, the others at their optimum. Where the likelihood
ripples, or falls to a plateau, its quantile of chi-squared is passed long before the probability beyond is
small. So the profile is integrated: the interval has 2.5 % of ``exp(-misfit)`` on either side, which is the
interval of the information where the likelihood is Gaussian.

Source: L. Tierney, J. B. Kadane, J. Am. Stat. Assoc. 81 (1986) 82–86, eq 2.4, the determinant of the others
taken as constant.
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
from dynid.identification.statistics import TAIL_PROBABILITY

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
