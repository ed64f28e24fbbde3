"""Priors and limits of the parameters; a prior counts as a measurement, independent of the records.

The mean of a prior is a pseudo-observation of the coordinate of its parameter. The prior of one parameter, as
a scene gives it, is `ParameterPrior` in `parameters.py`.

Limits are those of a uniform prior of the coordinate. What the records leave open between two limits has no
maximum of the posterior; there the estimate is the middle, to which a pull far weaker than the limits leads.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array
from dynid.parameters import Parameter

# Information of the records on a parameter, relative to that of its prior, below which the two are not
# compared.
_INFORMATIVE = 1e-6
# Deviation of a parameter that is fixed, in units: its part in the errors of others is round-off.
_FIXED = 1e-9
#: Deviation of the pull to the middle of two limits over their distance. A coordinate with the deviation s,
# limits w apart, it moves by less than s / (2 * 30^2) * (s / w), and a direction that is open, all the way.
PULL = 30.0
# Deviation of a uniform distribution over its width.
_UNIFORM = 1 / math.sqrt(12)


class InitialState(NamedTuple):
    """Initial augmented state of a pass: state (n, scaled), coordinates (p), and a root of their covariance.

    `root` (n + p x n + p) is any S with S S^T the covariance of state and coordinates.
    """

    state: Array
    eta: Array
    root: Array


@dataclass(frozen=True, eq=False)
class Priors:
    """Limits and priors of the coordinates of the parameters."""

    # `low`, `high`: limits (p), infinite where there are none
    low: Array
    high: Array
    # `means`, `deviations`: means and standard deviations of the priors (p), NaN where there are none
    means: Array
    deviations: Array
    units: Array  # steps of the coordinates that count as one (p): 1 of logarithms
    pull: float = PULL  # deviation of the pull to the middle of two limits over their distance

    @classmethod
    def of(cls, unknowns: Sequence[Parameter], pull: float = PULL) -> Priors:
        """Return the priors and limits of unknown parameters.

        The deviation of the logarithm is that of the log-normal distribution of the same relative deviation.
        """
        low = [-math.inf if unknown.low is None else unknown.coordinate(unknown.low) for unknown in unknowns]
        high = [
            math.inf if unknown.high is None else unknown.coordinate(unknown.high) for unknown in unknowns
        ]
        priors = [(unknown, unknown.prior) for unknown in unknowns]
        means = [math.nan if prior is None else unknown.coordinate(prior.value) for unknown, prior in priors]
        deviations = [
            math.nan
            if prior is None
            else math.sqrt(math.log1p(prior.relative**2))
            if unknown.logarithmic
            else prior.absolute
            for unknown, prior in priors
        ]
        units = [unknown.first_spread / 2 for unknown in unknowns]
        priors_and_limits = cls(
            np.array(low), np.array(high), np.array(means), np.array(deviations), np.array(units), pull
        )
        # Where the limits are one value, a prior that is as narrow keeps the information regular.
        return replace(
            priors_and_limits,
            means=np.where(priors_and_limits.fixed, priors_and_limits.low, priors_and_limits.means),
            deviations=np.where(
                priors_and_limits.fixed, _FIXED * priors_and_limits.units, priors_and_limits.deviations
            ),
        )

    @cached_property
    def fixed(self) -> NDArray[np.bool_]:
        """Mask of parameters whose limits are one value (p)."""
        return np.asarray(self.low == self.high)

    @cached_property
    def has_prior(self) -> NDArray[np.bool_]:
        """Mask of parameters that have a prior (p)."""
        return ~np.isnan(self.means)

    @cached_property
    def limited(self) -> NDArray[np.bool_]:
        """Mask of parameters with two limits (p): their prior is proper."""
        return np.isfinite(self.low) & np.isfinite(self.high) & (self.low < self.high)

    @cached_property
    def spreads(self) -> Array:
        """Standard deviations of proper priors, Gaussian or uniform (p); NaN of parameters without one."""
        width = np.where(self.limited, self.high - self.low, np.nan)
        return np.fmin(self.deviations, _UNIFORM * width)

    @cached_property
    def pulled(self) -> NDArray[np.bool_]:
        """Mask of parameters that are pulled to the middle of their limits (p)."""
        return self.limited & ~self.has_prior

    def holding(self, k: int, coordinate: float) -> Priors:
        """Return the priors with the k-th coordinate fixed, in place of its own prior and limits."""
        held = np.arange(len(self.low)) == k
        return replace(
            self,
            low=np.where(held, coordinate, self.low),
            high=np.where(held, coordinate, self.high),
            means=np.where(held, coordinate, self.means),
            deviations=np.where(held, _FIXED * self.units, self.deviations),
        )

    def clipped(self, eta: Array) -> Array:
        """Return the nearest coordinates within the limits (p)."""
        return np.clip(eta, self.low, self.high)

    def constrained(self, eta: Array, root: Array) -> Array:
        """Return the likeliest coordinates within the limits (p) of a Gaussian of this mean.

        `eta`, `root`: its mean (p), and a root of its covariance (p x p).
        """
        inside = self.clipped(eta)
        if np.array_equal(inside, eta):
            return inside
        weight = np.linalg.pinv(root).astype(float)
        return self.nearest(weight, weight @ eta)

    def nearest(self, rows: Array, right: Array) -> Array:
        """Return the coordinates within the limits (p) with the least ``|rows eta - right|``.

        Bounded-variable least squares: P. B. Stark, R. L. Parker, Comput. Stat. 10 (1995) 129–141.
        """
        from scipy.optimize import lsq_linear  # heavy import, needed here only

        free = self.low < self.high
        eta = np.where(free, 0.0, self.low)
        size = np.linalg.norm(rows[:, free], axis=0)
        size = np.where(size > 0, size, 1.0)
        limits = self.low[free] * size, self.high[free] * size
        solution = lsq_linear(rows[:, free] / size, right - rows @ eta, limits, method="bvls")
        eta[free] = solution.x / size
        return self.clipped(eta)

    def at_bound(self, eta: Array) -> NDArray[np.bool_]:
        """Return the mask of coordinates that are at a limit (p)."""
        return (eta <= self.low) | (eta >= self.high)

    def blocked(self, eta: Array, direction: Array) -> NDArray[np.bool_]:
        """Return the mask of coordinates that a limit keeps from moving in this direction (p)."""
        return ((eta <= self.low) & (direction < 0)) | ((eta >= self.high) & (direction > 0))

    def rows(self, *, fixed: bool = True) -> Array:
        """Return the sensitivities of the priors' pseudo-observations over their deviations (count x p).

        Gaussian priors come first, then the pulls to the middle of two limits. Without `fixed`, those of
        fixed parameters are left out.
        """
        pulls = np.diag(1 / (self.pull * np.where(self.pulled, self.high - self.low, 1.0)))
        gaussian = np.diag(1 / self.deviations)[self.has_prior & (fixed | ~self.fixed)]
        return np.concatenate([gaussian, pulls[self.pulled]])

    def residual(self, eta: Array) -> Array:
        """Return the residuals of the pseudo-observations over their deviations (count), as `rows`."""
        low, high = self.low[self.pulled], self.high[self.pulled]
        pulls = ((low + high) / 2 - eta[self.pulled]) / (self.pull * (high - low))
        return np.concatenate([self.gaussian_residual(eta), pulls])

    def gaussian_residual(self, eta: Array) -> Array:
        """Return the residuals of the means of Gaussian priors over their deviations (count)."""
        return np.asarray(((self.means - eta) / self.deviations)[self.has_prior])

    def open(self, deviations: Array) -> NDArray[np.bool_]:
        """Return the mask of parameters (p) that only the pull determines, by their deviations."""
        return self.pulled & (deviations > self.pull / 10 * np.where(self.pulled, self.high - self.low, 1.0))

    def conflict(self, eta: Array, deviations: Array) -> Array:
        """Return how far priors and records are apart, in deviations of that distance (p); 0 without a prior.

        It is the normalised residual of a pseudo-observation: its residual at the estimate over the deviation
        of that residual. 0 where the information of the records is less than a millionth of the prior's.

        `eta`, `deviations`: the estimate, and its deviations with the priors (p).
        """
        free = 1 - (deviations / self.deviations) ** 2
        compared = self.has_prior & (free > _INFORMATIVE)
        apart = np.abs(self.means - eta) / self.deviations
        return np.where(compared, apart / np.sqrt(np.where(compared, free, 1.0)), 0.0)

    def combined(self, prior: InitialState) -> InitialState:
        """Return the initial state of a filter pass, updated by the pseudo-observations."""
        n = len(prior.state)
        z, S = np.concatenate([prior.state, prior.eta]), prior.root.copy()
        for k in np.flatnonzero(self.has_prior):
            phi = S[n + k] / self.deviations[k]
            spread = float(phi @ phi) + 1.0
            gain = S @ phi / spread
            z += gain * (self.means[k] - z[n + k]) / self.deviations[k]
            S -= np.outer(gain / (1 + math.sqrt(1 / spread)), phi)
        return InitialState(z[:n], z[n:], S)
