"""Statistics of samples: RMS, autocovariance, and tails of the chi-squared and F distributions."""

from __future__ import annotations

import math

import numpy as np

from dynid.arrays import Array

#: Half width of a 95 % interval of a Gaussian in standard deviations; probability of each tail beyond it.
HALF_WIDTH, TAIL_PROBABILITY = 1.959963984540054, 0.025
# Most terms of a continued fraction (they grow with the root of the degrees of freedom), how close its values
# are to be, and the least number that is divided by.
_MAX_FRACTION_TERMS, _FRACTION_REL_TOL, _MIN_DIVISOR = 100_000, 1e-14, 1e-300
# A sum of squares above which those that underflow are below its rounding.
_MIN_SQUARES = 1e-280


def root_mean_square(residual: Array) -> Array:
    """Return the RMS of each channel (times x channels, NaN where missing), however large or small."""
    squares = np.einsum("ij,ij->j", residual, residual)
    if (squares > _MIN_SQUARES).all() and np.isfinite(squares).all():
        return np.asarray(np.sqrt(squares / len(residual)))
    missing = np.isnan(residual)
    filled = np.where(missing, 0.0, residual) if missing.any() else residual
    size = np.abs(filled).max(axis=0)
    shares = filled / np.where(size > 0, size, 1.0)
    count = len(residual) - np.count_nonzero(missing, axis=0)
    return np.asarray(np.sqrt(np.einsum("ij,ij->j", shares, shares) / count) * size)


def standardised(residual: Array) -> Array:
    """Return residuals (times x channels) over their largest, less their mean, 0 where missing."""
    channels = np.ascontiguousarray(residual.T)
    missing = np.isnan(channels)
    filled = np.where(missing, 0.0, channels)
    size = np.abs(filled).max(axis=1)
    filled /= np.where(size > 0, size, 1.0)[:, None]
    count = channels.shape[1] - np.count_nonzero(missing, axis=1)
    filled -= (filled.sum(axis=1) / np.maximum(count, 1))[:, None]
    filled[missing] = 0.0
    return filled.T


def autocovariances(values: Array, lags: int) -> Array:
    """Return the products of values (times x channels) with those 1, 2, … before, summed (lags x …)."""
    channels = np.ascontiguousarray(values.T)
    delayed = np.concatenate([np.zeros((len(channels), lags)), channels], axis=1)
    sums = [
        np.correlate(long, channel, "valid")[:lags][::-1]
        for long, channel in zip(delayed, channels, strict=True)
    ]
    return np.reshape(sums, (len(channels), lags)).T


def chi_squared_tail(degrees: int, x: float) -> float:
    """Return the probability that chi-squared of `degrees` (1, 2, …) exceeds x >= 0.

    Notes
    -----
    Q(degrees / 2, y), y = x / 2, is the finite sum of ``y^a e^-y / Gamma(a + 1)`` over a = degrees / 2 - 1,
    degrees / 2 - 2, … > -1/2, and of erfc(sqrt y) where the degrees are odd. All terms are positive, and
    taken in logarithms: the relative error is some roundings times y. DLMF 8.4.6, 8.8.2.
    """
    y = x / 2
    if y == 0:
        return 1.0
    tail = math.erfc(math.sqrt(y)) if degrees % 2 else 0.0
    powers = (degrees / 2 - 1 - k for k in range(degrees // 2))
    terms = (math.exp(a * math.log(y) - y - math.lgamma(a + 1)) for a in powers)
    return min(1.0, math.fsum([tail, *terms]))


def log_f_tail(degrees: int, left: float, ratio: float) -> float:
    """Return the logarithm of the probability that Fisher's F exceeds a ratio.

    `degrees`, `left`: degrees of freedom of numerator and denominator, above 0; `ratio`: mean square over
    mean square, not negative.

    The regularised incomplete beta function I_x(left/2, degrees/2), x = left / (left + degrees ratio), by
    its continued fraction (DLMF 8.17.22) on the side where that converges fast.
    """
    if ratio <= 0:
        return 0.0
    x = left / (left + degrees * ratio)
    a, b = left / 2, degrees / 2
    if x < (a + 1) / (a + b + 2):
        return min(0.0, _log_incomplete_beta(a, b, x, degrees * ratio / (left + degrees * ratio)))
    return math.log1p(-min(1 - 2**-53, math.exp(min(0.0, _log_incomplete_beta(b, a, 1 - x, x)))))


def _log_incomplete_beta(a: float, b: float, x: float, rest: float) -> float:
    """Return log I_x(a, b) for x below its mean; `rest` is 1 - x, to all digits."""
    if x <= 0:
        return -math.inf
    front = a * math.log(x) + b * math.log(rest) + math.lgamma(a + b) - math.lgamma(a) - math.lgamma(b)
    # Lentz's algorithm, modified: no partial denominator is zero.
    c, d = 1.0, 1 / _non_zero(1 - (a + b) * x / (a + 1))
    value = d
    for m in range(1, _MAX_FRACTION_TERMS):
        for term in (
            m * (b - m) * x / ((a + 2 * m - 1) * (a + 2 * m)),
            -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1)),
        ):
            d, c = 1 / _non_zero(1 + term * d), _non_zero(1 + term / c)
            value *= c * d
        if abs(c * d - 1) < _FRACTION_REL_TOL:
            break
    return front + math.log(value / a)


def _non_zero(number: float) -> float:
    """Return a number that is not zero."""
    return number if abs(number) > _MIN_DIVISOR else _MIN_DIVISOR
