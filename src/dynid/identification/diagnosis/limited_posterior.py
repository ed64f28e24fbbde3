"""Posterior of parameters within limits: a Gaussian likelihood times uniform priors.

The likelihood is that of the linearised model, ``exp(-|r - J d|^2 / 2)`` for a change d of the coordinates
from the estimate, where r are the weighted residuals and J the derivatives. Where a limit cuts it off, means
and intervals are those of seeded samples: Gibbs sampling along the principal axes of J, in which the Gaussian
has independent components, and along the coordinates, in turn, each from its exact conditional distribution.
J. Geweke, Proc. 23rd Symposium on the Interface (1991) 571–578; C. P. Robert, Stat. Comput. 5 (1995) 121–125.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dynid.arrays import Array
from dynid.identification.statistics import HALF_WIDTH, TAIL_PROBABILITY

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
