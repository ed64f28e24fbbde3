"""How far a fit can be trusted."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Residuals below this part of the channel's RMS are explained whatever their colour (holds, reduced models).
_EXPLAINED = 0.03
# Above it they must look like white noise at least at this level.
_WHITE = 1e-6
# An estimate is at the optimum if the step left is below this part of its standard error …
_STEP_IN_DEVIATIONS = 0.5
# … or below this relative size, where residuals are so small that the standard error is no yardstick.
_STEP = 1e-4


def root_mean_square(residual: Array) -> Array:
    """Return the RMS of each channel (times x channels, NaN where missing), however large or small."""
    missing = np.isnan(residual)
    filled = np.where(missing, 0.0, residual) if missing.any() else residual
    size = np.abs(filled).max(axis=0)
    shares = filled / np.where(size > 0, size, 1.0)
    count = len(residual) - np.count_nonzero(missing, axis=0)
    return np.asarray(np.sqrt(np.einsum("ij,ij->j", shares, shares) / count) * size)


def whiteness(*residuals: Array) -> float:
    """Return the p-value of the Ljung–Box test that the residuals are white, all channels together.

    Parameters
    ----------
    *residuals
        Residuals of each record (times x channels); NaN where missing.

    Returns
    -------
    float
        Near 0: coloured. 1 where the records are too short to tell.

    Notes
    -----
    Q = N (N + 2) sum_l r_l^2 / (N - l), summed over channels and records, against chi-squared; lags up to
    min(20, N / 4). G. M. Ljung, G. E. P. Box, Biometrika 65 (1978) 297–303.
    """
    degrees, statistics = zip(*(_ljung_box(residual) for residual in residuals), strict=True)
    return chi_squared_tail(sum(degrees), sum(statistics)) if any(degrees) else 1.0


def _ljung_box(residual: Array) -> tuple[int, float]:
    """Return degrees of freedom and statistic of one record."""
    n = len(residual)
    lags = min(20, n // 4)
    if lags == 0:
        return 0, 0.0
    centred = standardised(residual)
    power = np.einsum("tc,tc->c", centred, centred)
    channels = np.flatnonzero(power > 0)
    if not len(channels):
        return 0, 0.0
    r = lagged(centred, lags)[:, channels] / power[channels]
    weights = n * (n + 2) / (n - np.arange(1, lags + 1))
    return lags * len(channels), float(np.sum(weights[:, None] * r**2))


def standardised(residual: Array) -> Array:
    """Return residuals (times x channels) over their largest, less their mean, 0 where missing."""
    each = np.ascontiguousarray(residual.T)
    missing = np.isnan(each)
    filled = np.where(missing, 0.0, each)
    size = np.abs(filled).max(axis=1)
    filled /= np.where(size > 0, size, 1.0)[:, None]
    count = each.shape[1] - np.count_nonzero(missing, axis=1)
    filled -= (filled.sum(axis=1) / np.maximum(count, 1))[:, None]
    filled[missing] = 0.0
    return filled.T


def lagged(values: Array, lags: int) -> Array:
    """Return the products of values (times x channels) with those 1, 2, … before, summed (lags x …)."""
    each = np.ascontiguousarray(values.T)
    sums = [np.einsum("ct,ct->c", each[:, lag:], each[:, :-lag]) for lag in range(1, lags + 1)]
    return np.reshape(sums, (lags, values.shape[1]))


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


def is_coloured(whiteness_p: float) -> bool:
    """Tell whether residuals are clearly no white noise."""
    return whiteness_p < _WHITE


def is_settled(step: Array, deviations: Array) -> bool:
    """Tell whether an estimate is at the optimum of the record.

    Parameters
    ----------
    step
        The Gauss–Newton step left, in logarithms (p).
    deviations
        Standard errors of the logarithms (p).
    """
    return bool(np.all(np.abs(step) <= np.maximum(_STEP_IN_DEVIATIONS * deviations, _STEP)))


def is_explained(residual_ratio: Array, whiteness_p: float) -> bool:
    """Tell whether residuals are small, or noise.

    Parameters
    ----------
    residual_ratio
        RMS of residuals over that of measured values (channels).
    whiteness_p
        p-value of the residuals' whiteness.
    """
    return bool(np.all(residual_ratio <= _EXPLAINED)) or not is_coloured(whiteness_p)
