"""Priors and bounds of the unknown parameters; a prior counts as an independent measurement."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid.identification.filter import FilterPrior
from dynid.structure.joints import Unknown

Array = NDArray[np.float64]

# What the records tell of a parameter, relative to its prior, below which the two are not compared.
_TOLD = 1e-6


@dataclass(frozen=True, eq=False)
class Priors:
    """Bounds and priors of the logarithms of the parameters.

    Attributes
    ----------
    low, high
        Bounds (p), infinite where there are none.
    means, deviations
        Priors (p), NaN where there are none.
    """

    low: Array
    high: Array
    means: Array
    deviations: Array

    @classmethod
    def of(cls, unknowns: Sequence[Unknown]) -> Priors:
        """Return what is known of unknowns.

        The deviation of the logarithm is that of the log-normal distribution of the same relative deviation.
        """
        low = [math.log(unknown.low) if unknown.low else -math.inf for unknown in unknowns]
        high = [math.log(unknown.high) if unknown.high else math.inf for unknown in unknowns]
        believed = [unknown.belief for unknown in unknowns]
        means = [math.nan if belief is None else math.log(belief.value) for belief in believed]
        deviations = [
            math.nan if belief is None else math.sqrt(math.log1p(belief.relative_deviation**2))
            for belief in believed
        ]
        return cls(np.array(low), np.array(high), np.array(means), np.array(deviations))

    @property
    def believed(self) -> NDArray[np.bool_]:
        """Mask of parameters that have a prior (p)."""
        return ~np.isnan(self.means)

    def clipped(self, logs: Array) -> Array:
        """Return the nearest logarithms within the bounds (p)."""
        return np.clip(logs, self.low, self.high)

    def at_bound(self, logs: Array) -> NDArray[np.bool_]:
        """Tell which logarithms stand at a bound (p)."""
        return (logs <= self.low) | (logs >= self.high)

    def blocked(self, logs: Array, direction: Array) -> NDArray[np.bool_]:
        """Tell which logarithms a bound keeps from going in this direction (p)."""
        return ((logs <= self.low) & (direction < 0)) | ((logs >= self.high) & (direction > 0))

    def rows(self) -> Array:
        """Return the sensitivities of the priors' pseudo-observations over their deviations (count x p)."""
        return np.asarray(np.diag(1 / self.deviations)[self.believed])

    def residual(self, logs: Array) -> Array:
        """Return the residuals of the pseudo-observations over their deviations (count)."""
        return np.asarray(((self.means - logs) / self.deviations)[self.believed])

    def conflict(self, logs: Array, deviations: Array) -> Array:
        """Return how far priors and records are apart, in deviations of that distance (p); 0 without a prior.

        It is the normalised residual of a pseudo-observation: its residual over the deviation that this has
        once the estimate has followed it. Where records tell less than a millionth of what a prior does,
        there is nothing to compare: 0.

        Parameters
        ----------
        logs, deviations
            The estimate, and its deviations with the priors (p).
        """
        free = 1 - (deviations / self.deviations) ** 2
        told = self.believed & (free > _TOLD)
        apart = np.abs(self.means - logs) / self.deviations
        return np.where(told, apart / np.sqrt(np.where(told, free, 1.0)), 0.0)

    def informed(self, prior: FilterPrior) -> FilterPrior:
        """Return the prior of a filter's pass with the pseudo-observations taken into account."""
        n = len(prior.state)
        z, S = np.concatenate([prior.state, prior.logs]), prior.root.copy()
        for k in np.flatnonzero(self.believed):
            phi = S[n + k] / self.deviations[k]
            spread = float(phi @ phi) + 1.0
            gain = S @ phi / spread
            z += gain * (self.means[k] - z[n + k]) / self.deviations[k]
            S -= np.outer(gain / (1 + math.sqrt(1 / spread)), phi)
        return FilterPrior(z[:n], z[n:], S)
