"""What the residuals and the innovations of a fit say, channel by channel."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.identification.diagnostics import lagged, root_mean_square, standardised

Array = NDArray[np.float64]

# Half width of a 95 % interval in standard deviations.
_WIDE = 1.959963984540054
# Lags of the autocorrelation; samples of a segment of the spectrum.
_LAGS, _SEGMENT = 40, 512


class Consistency(NamedTuple):
    """Mean squares of normalised innovations, which are 1 where the filter knows its errors.

    `mean_square` (channels) and that of all, `overall`, with the intervals that 95 % of records lie in:
    `low`, `high` (channels), `overall_low`, `overall_high`.
    """

    mean_square: Array
    low: Array
    high: Array
    overall: float
    overall_low: float
    overall_high: float

    @property
    def consistent(self) -> bool:
        """Whether the mean square of all lies in its interval."""
        return self.overall_low <= self.overall <= self.overall_high


def autocorrelation(residual: Array) -> tuple[Array, Array]:
    """Return the autocorrelation of each channel at lags 1, 2, … (lags x channels), and its 95 % band.

    Parameters
    ----------
    residual
        Residuals (times x channels), NaN where missing.

    Returns
    -------
    tuple
        The autocorrelations, up to 40 or a quarter of the samples; and half the width of the band that 95 %
        of those of white noise lie in (channels).
    """
    lags = min(_LAGS, len(residual) // 4)
    centred = standardised(residual)
    power = np.einsum("tc,tc->c", centred, centred)
    r = lagged(centred, lags) / np.where(power > 0, power, 1.0)
    return r, _WIDE / np.sqrt(np.count_nonzero(~np.isnan(residual), axis=0))


def spectrum(residual: Array, step: float) -> tuple[Array, Array]:
    """Return the root of each channel's power spectral density, whose integral over omega is its mean square.

    Averaged over segments of up to 512 samples that overlap by half, under Hann's window (P. D. Welch, IEEE
    Trans. Audio Electroacoust. 15 (1967) 70–73). Missing samples count as zeros, and the power is raised by
    as many.

    Parameters
    ----------
    residual
        Residuals (times x channels), NaN where missing.
    step
        Sampling step, s.

    Returns
    -------
    tuple
        omega, rad/s, and roots of one-sided densities (omega x channels), unit times the root of s/rad.
    """
    n = len(residual)
    length = min(n, _SEGMENT)
    window = np.sin(np.pi * (np.arange(length) + 0.5) / length)[:, None] ** 2
    starts = range(0, n - length + 1, max(1, length // 2))
    unit = np.where((size := root_mean_square(residual)) > 0, size, 1.0)
    filled = np.nan_to_num(residual / unit)
    power = np.mean(
        [np.abs(np.fft.rfft(window * filled[k : k + length], axis=0)) ** 2 for k in starts], axis=0
    )
    power[1 : (length + 1) // 2] *= 2
    omega = 2 * np.pi * np.fft.rfftfreq(length, step)
    present = np.count_nonzero(~np.isnan(residual), axis=0) / n
    density = power * step / (2 * np.pi * np.sum(window**2)) / present
    return np.asarray(omega, dtype=float), np.asarray(np.sqrt(density) * unit)


def consistency(innovations: Array) -> Consistency:
    """Return the mean squares of normalised innovations (times x channels), with their intervals.

    The sum of m squares is chi-squared of m degrees; its quantiles by E. B. Wilson, M. M. Hilferty, Proc.
    Natl. Acad. Sci. 17 (1931) 684–688, better than 1 % of the width from ten degrees on.
    """
    counts = np.count_nonzero(~np.isnan(innovations), axis=0)
    squares = np.nansum(innovations**2, axis=0)
    low, high = np.transpose([_interval(int(count)) for count in counts])
    total = int(counts.sum())
    return Consistency(
        squares / np.maximum(counts, 1), low, high, float(squares.sum() / max(total, 1)), *_interval(total)
    )


def _interval(degrees: int) -> tuple[float, float]:
    """Return the central 95 % interval of the mean of so many squares."""
    if not degrees:
        return 0.0, math.inf
    spread = 2 / (9 * degrees)
    low, high = (max(0.0, 1 - spread + z * math.sqrt(spread)) ** 3 for z in (-_WIDE, _WIDE))
    return low, high
