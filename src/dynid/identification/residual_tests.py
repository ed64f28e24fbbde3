"""Tests of residuals and innovations: whiteness, spectrum, given noise, offset, outliers, heavy tails.

Offset, outliers and heavy tails are tested for white Gaussian noise. A coloured residual is whitened by an
autoregression first (Yule–Walker), so that its colour alone raises no alarm.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import takewhile
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array
from dynid.defaults import WHITENESS
from dynid.identification.statistics import (
    HALF_WIDTH,
    autocovariances,
    chi_squared_tail,
    root_mean_square,
    standardised,
)

# Residuals below this part of the channel's RMS are explained whatever their colour (holds, reduced models).
_SMALL_RESIDUAL_RATIO = 0.03
# An estimate is at the optimum if the step left is below this part of its standard error …
_OPTIMAL_STEP_DEVIATIONS = 0.5
# … or below this relative size, where residuals are so small that the standard error is no yardstick.
_RELATIVE_STEP_TOL = 1e-4
# Lags of the autocorrelation; samples of a segment of the spectrum.
_AUTOCORRELATION_LAGS, _SEGMENT = 40, 512
#: Median absolute deviation of the normal distribution of standard deviation 1.
NORMAL_MAD = 0.6744897501960817
# Standard deviation of the logarithm of the median absolute deviation, times the root of the sample size.
_MAD_SPREAD = 1.1664
# Order of the autoregression that whitens a residual, and how many samples it takes at least for each.
_WHITENING_ORDER, _PER_ORDER = 20, 10
# Fewer samples than this are not tested.
_MIN_TESTED_SAMPLES = 20


def whiteness(*residuals: Array, coefficients: Sequence[int] = ()) -> float:
    """Return the p-value of the Ljung–Box test that residuals (times x channels a record) are white together.

    Near 0: coloured; 1 where the records are too short to be tested. `coefficients`: of each record the
    number of coefficients of the autoregressions that whitened it.

    Q = N (N + 2) sum_l r_l^2 / (N - l), summed over channels and records, against chi-squared; lags up to
    min(20, N / 4), and of whitened residuals as many more as coefficients a channel, which count as degrees
    of freedom. G. M. Ljung, G. E. P. Box, Biometrika 65 (1978) 297–303.
    """
    degrees, statistic = 0, 0.0
    for k, residual in enumerate(residuals):
        n, fitted = len(residual), coefficients[k] if coefficients else 0
        lags = min(20 + -(-fitted // residual.shape[1]), n // 4)
        if lags == 0:
            continue
        centred = standardised(residual)
        power = np.einsum("tc,tc->c", centred, centred)
        channels = np.flatnonzero(power > 0)
        if not len(channels):
            continue
        r = autocovariances(centred, lags)[:, channels] / power[channels]
        weights = n * (n + 2) / (n - np.arange(1, lags + 1))
        degrees += max(lags * len(channels) - fitted, 1)
        statistic += float(np.sum(weights[:, None] * r**2))
    return chi_squared_tail(degrees, statistic) if degrees else 1.0


def is_coloured(whiteness_p: float) -> bool:
    """Return True if residuals are clearly not white noise."""
    return whiteness_p < WHITENESS.value


def is_optimal(step: Array, deviations: Array) -> bool:
    """Return True if an estimate is at the optimum of the record.

    `step`: the Gauss–Newton step left, in coordinates (p); `deviations`: standard errors of the coordinates
    (p).
    """
    return bool(np.all(np.abs(step) <= np.maximum(_OPTIMAL_STEP_DEVIATIONS * deviations, _RELATIVE_STEP_TOL)))


def is_explained(residual_ratio: Array, whiteness_p: float) -> bool:
    """Return True if residuals are small, or white noise.

    `residual_ratio`: RMS of residuals over that of measured values (channels); `whiteness_p`: p-value of the
    residuals' whiteness.
    """
    return bool(np.all(residual_ratio <= _SMALL_RESIDUAL_RATIO)) or not is_coloured(whiteness_p)


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
        """True if the mean square of all lies in its interval."""
        return self.overall_low <= self.overall <= self.overall_high


def autocorrelation(residual: Array) -> tuple[Array, Array]:
    """Return the autocorrelation of each channel at lags 1, 2, … (lags x channels), and its 95 % band.

    Up to lag 40, or a quarter of the samples; and half the width of the band that 95 % of those of white
    noise lie in (channels).
    """
    lags = min(_AUTOCORRELATION_LAGS, len(residual) // 4)
    centred = standardised(residual)
    power = np.einsum("tc,tc->c", centred, centred)
    r = autocovariances(centred, lags) / np.where(power > 0, power, 1.0)
    return r, HALF_WIDTH / np.sqrt(np.count_nonzero(~np.isnan(residual), axis=0))


def spectral_lines(samples: int, step: float) -> Array:
    """Return the frequencies of the spectrum of so many samples, rad/s."""
    return np.asarray(2 * np.pi * np.fft.rfftfreq(min(samples, _SEGMENT), step))


def spectrum(residual: Array, step: float, steps: Array | None = None) -> tuple[Array, Array]:
    """Return the root of each channel's power spectral density, whose integral over omega is its mean square.

    Averaged over segments of up to 512 samples that overlap by half, under Hann's window (P. D. Welch, IEEE
    Trans. Audio Electroacoust. 15 (1967) 70–73). Missing samples count as zeros, and the power is raised by
    as many. Returns omega, rad/s, and roots of one-sided densities (omega x channels), unit times the root of
    s/rad. `steps` (channels): sampling steps of their own; their spectra are interpolated at the lines of
    `step`, NaN beyond half of their rates.
    """
    if steps is not None and np.any(steps != step):
        omega = spectral_lines(len(residual), step)
        amplitude = np.empty((len(omega), len(steps)))
        for own in np.unique(steps).tolist():
            here = steps == own
            lines, density = spectrum(residual[:, here], own)
            columns = [np.interp(omega, lines, column, right=np.nan) for column in density.T]
            amplitude[:, here] = np.column_stack(columns)
        return omega, amplitude
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
    present = np.count_nonzero(~np.isnan(residual), axis=0) / n
    density = power * step / (2 * np.pi * np.sum(window**2)) / present
    return spectral_lines(n, step), np.asarray(np.sqrt(density) * unit)


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
    low, high = (max(0.0, 1 - spread + z * math.sqrt(spread)) ** 3 for z in (-HALF_WIDTH, HALF_WIDTH))
    return low, high


class NoiseTest(NamedTuple):
    """Test of residuals against the given noise.

    `p` of all channels together; of each channel (NaN where no noise is given) `channel_p` and `ratio`, the
    observed standard deviation over the given one.
    """

    p: float
    channel_p: Array
    ratio: Array


class ResidualShape(NamedTuple):
    """Shape of the distribution of one channel's residual."""

    # `mean`, `mean_p`: mean, and the p-value of its being zero
    mean: float
    mean_p: float
    # Robust standard deviation: the median absolute deviation over that of a standard normal one.
    deviation: float
    # `kurtosis`, `kurtosis_p`: kurtosis (3 for a Gaussian one), and the p-value of tails that are no heavier
    # than Gaussian ones
    kurtosis: float
    kurtosis_p: float
    # `largest`, `largest_p`, `at`: largest deviation from the median over the robust standard deviation, the
    # p-value of the largest of so many Gaussian samples, and its place
    largest: float
    largest_p: float
    at: int
    outliers: NDArray[np.int_]  # places of all samples beyond the extreme-value level, the largest first
    share: float  # part of the residual's mean square (about its mean) that these samples make up


def noise_test(squares: Array, degrees: Array, robust: NDArray[np.bool_]) -> NoiseTest:
    """Return the two-sided chi-squared test of residuals against a given noise.

    `squares`: sums of squared residuals over the given variance (channels), NaN where none is given;
    `degrees`: their degrees of freedom: values less those of the fit (channels). Channels without any are
    not tested. `robust`: mask of channels whose `squares` are those of a median absolute deviation times
    `degrees` (channels).

    The sum over all channels and each channel by itself are tested; the p-value of all is the smallest of
    these times their number (Bonferroni), so that too small a noise in one channel does not mask too large a
    noise in another.
    """
    tested = ~np.isnan(squares) & (degrees >= 0.5)
    p, ratio = np.full((2, len(squares)), np.nan)
    for k in np.flatnonzero(tested):
        ratio[k] = math.sqrt(squares[k] / degrees[k])
        if not robust[k]:
            p[k] = _two_sided_p(squares[k], degrees[k])
        elif ratio[k] > 0:  # of a robust deviation of so many values to the true one
            p[k] = math.erfc(abs(math.log(ratio[k])) * math.sqrt(degrees[k] / 2) / _MAD_SPREAD)
        else:
            p[k] = 0.0
    if not tested.any():
        return NoiseTest(math.nan, p, ratio)
    p_values = p[tested].tolist()
    if len(p_values) > 1 and not robust.any():
        p_values.append(_two_sided_p(float(squares[tested].sum()), float(degrees[tested].sum())))
    return NoiseTest(min(1.0, len(p_values) * min(p_values)), p, ratio)


def _two_sided_p(x: float, degrees: float) -> float:
    """Return the two-sided p-value of chi-squared `x` of so many degrees (any positive number)."""
    from scipy.special import gammainc, gammaincc  # heavy import, needed here only

    below, above = float(gammainc(degrees / 2, x / 2)), float(gammaincc(degrees / 2, x / 2))
    return min(1.0, 2 * min(below, above))


def robust_deviation(values: Array) -> Array:
    """Return the robust standard deviation about zero of each column, NaN where missing."""
    return np.asarray(np.nanmedian(np.abs(values), axis=0) / NORMAL_MAD)


def residual_shape(residual: Array, level: float) -> ResidualShape | None:
    """Return the shape of a channel's residual (times, NaN where missing); None of too few or of zeros.

    `level`: p-value below which the largest sample is an outlier.
    """
    unit = float(root_mean_square(residual[:, None])[0])
    there = ~np.isnan(residual)
    if np.count_nonzero(there) < _MIN_TESTED_SAMPLES or not unit > 0:
        return None
    residual = residual / unit  # squares of large units overflow
    mean = float(residual[there].mean())
    white, gain, order = _whitened(residual)
    used = np.flatnonzero(~np.isnan(white))
    z, n = white[used], len(used)
    spread, power = float(np.std(z)) * gain / math.sqrt(n), float(np.sum((z - z.mean()) ** 2))
    sizes = np.abs(z - np.median(z))
    deviation = float(np.median(sizes) / NORMAL_MAD) or float(np.sqrt(np.mean(sizes**2)))
    if not (deviation > 0 and spread > 0):
        return None
    # Of few samples the median absolute deviation is uncertain, which the level of outliers includes.
    sure = deviation * (1 + 2 * _MAD_SPREAD / math.sqrt(n))
    ranked = np.argsort(-sizes, kind="stable")
    beyond = ranked[: sum(1 for _ in takewhile(lambda k: n * _tails(sizes[k] / sure) < level, ranked))]
    kurtosis, kurtosis_p = _kurtosis(z)
    t = abs(mean) / spread  # the mean in its standard errors
    mean_p = _tails(t)
    if order:
        from scipy.special import stdtr  # heavy import, needed here only

        # The density at frequency 0 of an autoregression is known to n / (2 order) degrees of freedom
        # (K. N. Berk, Ann. Statist. 2 (1974) 489–502).
        mean_p = 2 * float(stdtr(n / (2 * order), -t))
    return ResidualShape(
        mean * unit,
        mean_p,
        deviation * unit,
        kurtosis,
        kurtosis_p,
        float(sizes[ranked[0]] / deviation),
        min(1.0, n * _tails(sizes[ranked[0]] / sure)),
        int(used[ranked[0]]),
        used[beyond],
        float(np.sum((z[beyond] - z.mean()) ** 2)) / power,
    )


def _tails(x: float) -> float:
    """Return the probability that a standard normal number is farther from zero than x."""
    return math.erfc(x / math.sqrt(2))


def _whitened(residual: Array) -> tuple[Array, float, int]:
    """Return a whitened residual (times), what multiplies the deviation of its mean, and the order."""
    # The variance of the mean of an autoregression is that of its innovations over (1 - sum a)^2 n.
    there = ~np.isnan(residual)
    n = int(np.count_nonzero(there))
    order = min(_WHITENING_ORDER, n // _PER_ORDER)
    if not is_coloured(whiteness(residual[:, None])) or not order:
        return residual, 1.0, 0
    x = np.where(there, residual - residual[there].mean(), 0.0)
    unit = float(np.abs(x).max())
    x /= unit
    r = np.concatenate([[float(x @ x)], autocovariances(x[:, None], order)[:, 0]])
    places = np.abs(np.subtract.outer(np.arange(order), np.arange(order)))
    # A residual that is predicted exactly (a pure sine) has a singular matrix: a little noise regularises it.
    a = np.linalg.solve(r[places] + 1e-9 * r[0] * np.eye(order), r[1:])
    predicted = np.concatenate([[0.0], np.convolve(x, a)[: len(x) - 1]])
    predictable = there & (np.arange(len(x)) >= order)  # before there is too little to predict from
    return (
        np.where(predictable, unit * (x - predicted), np.nan),
        1 / max(abs(1 - float(a.sum())), 1e-9),
        order,
    )


def _kurtosis(z: Array) -> tuple[float, float]:
    """Return the kurtosis, and the p-value that the tails are no heavier than those of a normal distribution.

    F. J. Anscombe, W. J. Glynn, Biometrika 70 (1983) 227–234.
    """
    n = float(len(z))
    left = z - z.mean()
    left = left / np.abs(left).max()
    b2 = float(np.mean(left**4) / np.mean(left**2) ** 2)
    expected = 3 * (n - 1) / (n + 1)
    variance = 24 * n * (n - 2) * (n - 3) / ((n + 1) ** 2 * (n + 3) * (n + 5))
    skew = 6 * (n**2 - 5 * n + 2) / ((n + 7) * (n + 9))
    skew *= math.sqrt(6 * (n + 3) * (n + 5) / (n * (n - 2) * (n - 3)))
    A = 6 + 8 / skew * (2 / skew + math.sqrt(1 + 4 / skew**2))
    x = (b2 - expected) / math.sqrt(variance)
    below = 1 + x * math.sqrt(2 / (A - 4))
    if below <= 0:  # tails far lighter than Gaussian ones
        return b2, 1.0
    score = (1 - 2 / (9 * A) - ((1 - 2 / A) / below) ** (1 / 3)) / math.sqrt(2 / (9 * A))
    return b2, 0.5 * math.erfc(score / math.sqrt(2))
