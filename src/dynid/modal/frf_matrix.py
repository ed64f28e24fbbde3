"""Frequency responses between responses and references at common lines, with the deviation of their noise."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dynid.arrays import Array, ComplexArray
from dynid.errors import UsageError

#: Odd number of lines over which a relative variance by line is averaged. Unsmoothed variances of few
#: averages favour lines where the noise is small by chance: bars of three averages cover 58 % instead of 95.
SMOOTHED_LINES = 15
# Least lines: a pair has eight real residual terms, and a mode at least two more parameters.
_MIN_LINES = 20
# Coefficients of the third difference, which removes what is smooth over four lines.
_DIFFERENCE = np.array([1.0, -3.0, 3.0, -1.0])
# Median of |n|^2 of complex Gaussian noise over its mean.
_MEDIAN_OF_SQUARE = float(np.log(2.0))


@dataclass(frozen=True, eq=False)
class FrfMatrix:
    """Receptances of all responses to all references."""

    omega: Array  # lines (L), rad/s, above 0, increasing
    values: ComplexArray  # receptances (L x responses x references), NaN where missing
    deviation: Array  # of the complex noise, root of E |n|^2 (as `values`), in `scale`
    # Factor of the deviations (responses x references), estimated from the data where it is unknown.
    scale: Array
    estimated: bool = False  # True if the scale is estimated
    # True if the deviations from line to line are known up to the scale; else they are those here, or in
    # proportion to the response, whichever is more likely.
    shaped: bool = True

    # Lines over which noise is correlated: the sum of squared correlations; 1 without a window.
    correlation: float = 1.0
    #: Deviations where those from line to line are unknown; default: `deviation`.
    first: Array | None = None

    def __post_init__(self) -> None:
        if len(self.omega) < _MIN_LINES:
            raise UsageError(
                f"the band has {len(self.omega)} lines, and a modal analysis needs {_MIN_LINES}",
                remedy="Widen the band, or measure with a finer resolution.",
                names=("band",),
            )

    @property
    def flat(self) -> Array:
        """Deviations as they were first given."""
        return self.deviation if self.first is None else self.first

    @cached_property
    def weights(self) -> Array:
        """Weights of real and imaginary parts (as `values`), 1 over their deviations; 0 where missing."""
        there = np.isfinite(self.values) & np.isfinite(self.deviation) & (self.deviation > 0)
        deviation = np.where(there, self.deviation * self.scale, 1.0)
        return np.asarray(np.where(there, np.sqrt(2.0) / deviation, 0.0))

    @cached_property
    def weighted(self) -> ComplexArray:
        """Values in units of the deviations of their parts; 0 where missing."""
        return np.asarray(np.where(self.weights > 0, self.values, 0.0) * self.weights)

    @property
    def count(self) -> int:
        """Number of real values."""
        return 2 * int(np.count_nonzero(self.weights))

    def transposed(self) -> FrfMatrix:
        """Return the same functions with responses and references exchanged."""
        values, deviation = self.values.transpose(0, 2, 1), self.deviation.transpose(0, 2, 1)
        return replace(self, values=values, deviation=deviation, scale=self.scale.T, first=None)

    def windowed(self, exponential: float) -> FrfMatrix:
        """Return the responses with their noise correlated by an exponential window (time constant, s).

        The sum of squared correlations is duration times the integral of w^4 over the square of that of w^2.
        """
        duration = 2 * np.pi / float(np.median(np.diff(self.omega)))
        left = np.exp(-2 * duration / exponential)
        correlation = duration / exponential * (1 - left**2) / (1 - left) ** 2
        return replace(self, correlation=max(1.0, correlation))

    def with_scale_of_differences(self) -> FrfMatrix:
        """Return the responses with scales of the noise by third differences along the lines."""
        differences = sum(c * self.values[k : len(self.omega) - 3 + k] for k, c in enumerate(_DIFFERENCE))
        variance = sum(
            c**2 * self.deviation[k : len(self.omega) - 3 + k] ** 2 for k, c in enumerate(_DIFFERENCE)
        )
        ratio = np.abs(differences) ** 2 / np.where(variance > 0, variance, np.nan)
        squares = np.nanmedian(ratio, axis=0) / _MEDIAN_OF_SQUARE
        return replace(self, scale=np.sqrt(np.where(squares > 0, squares, 1.0)), estimated=True)


def smoothed_variance(
    variance: Array, values: ComplexArray, degrees: float, flat: Array | None = None
) -> Array:
    """Return variances by line (L x columns), averaged over lines in proportion to a profile.

    Profiles are the squared response and `flat` (default: 1), as of noise of the sensor; of each column the
    likelier one counts. With so many `degrees` of freedom a line their inverses are unbiased, as weights are.
    """
    half = SMOOTHED_LINES // 2
    best, smoothed = np.full(variance.shape[1], np.inf), np.full(variance.shape, np.nan)
    for profile in (np.abs(values) ** 2, np.ones(variance.shape) if flat is None else flat):
        size = np.where(profile > 0, profile, np.nan)
        padded = np.pad(variance / size, ((half, half), (0, 0)), mode="edge")
        windows = np.lib.stride_tricks.sliding_window_view(padded, SMOOTHED_LINES, axis=0)
        candidate = np.mean(windows, axis=-1) * size
        divisor = np.where(candidate > 0, candidate, np.nan)
        terms = np.nan_to_num(np.log(divisor) + variance / divisor)
        unlikelihood = np.sum(terms, axis=0)
        smoothed = np.where(unlikelihood < best, candidate, smoothed)
        best = np.minimum(best, unlikelihood)
    total = SMOOTHED_LINES * degrees
    return smoothed * total / (total - 2)
