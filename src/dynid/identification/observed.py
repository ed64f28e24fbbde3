"""What the likelihood asks of anything that is observed: records of time, or frequency response functions."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from dynid.identification.information import Information
from dynid.identification.measurement import Data
from dynid.identification.prediction import Trajectory
from dynid.structure.joints import Unknown

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Fit:
    """A fit at fixed parameters, the initial state being the best one (linear least squares).

    Attributes
    ----------
    logs
        Logarithms of the parameters (p).
    predicted
        Noise-free prediction, the states in SI divided by the model's scale.
    residual
        Measured minus predicted (times x channels), NaN where missing.
    counts, size
        How many values each channel has, and RMS of its residuals (channels).
    noise
        Standard deviation of the noise (channels): as given, else estimated from the residuals.
    triangles
        Of each channel, over its RMS, a triangle of derivatives by the initial state (scaled) and by the
        logarithms, and residuals, side by side (channels x n + p + 1 x n + p + 1). Whatever the channels are
        to count by, these few rows tell what all values tell. None where `by_parameter` is used.
    by_parameter
        Derivatives of the prediction by the logarithms (times x channels x p), where there are no triangles.
    """

    logs: Array
    predicted: Trajectory
    residual: Array
    counts: NDArray[np.int_]
    size: Array
    noise: Array
    triangles: Array | None = None
    by_parameter: Array | None = None


class Observed(ABC):
    """Real values (rows x channels) that depend on the parameters, with white Gaussian noise.

    Attributes
    ----------
    data
        The values.
    sharing
        Number of records that share the parameters.
    """

    data: Data
    sharing: int

    @property
    @abstractmethod
    def unknowns(self) -> tuple[Unknown, ...]:
        """The unknown parameters (p)."""

    @property
    @abstractmethod
    def nuisances(self) -> int:
        """Number of unknowns beside the parameters."""

    @abstractmethod
    def fit(self, logs: Array, values: Array, noise: Array | None = None) -> Fit:
        """Fit what is unknown beside the parameters to `values` (rows x channels) at exp(logs).

        Channels count by `noise`, their standard deviations (channels); absent: by their RMS.
        """

    def residual(self, logs: Array) -> Array:
        """Return what the fit at exp(logs) leaves of the record (rows x channels), NaN where missing."""
        return self.fit(logs, self.data.values).residual

    @abstractmethod
    def slopes(self, fit: Fit, noise: Array) -> Array:
        """Return the derivatives by the logarithms over noise (… x p), or few rows with the same products."""

    @abstractmethod
    def on(self, data: Data) -> Self:
        """Return the same, of other values."""

    @abstractmethod
    def information(self, fit: Fit, noise: Array) -> Information:
        """Return the information on the parameters of a fit, for a noise of this deviation (channels)."""

    @cached_property
    def given(self) -> Array:
        """The noise's deviations (channels) as far as they are given, else NaN."""
        return np.full(self.data.values.shape[1], np.nan) if self.data.given is None else self.data.given

    def known_or(self, estimated: Array) -> Array:
        """Return the noise's deviations (channels): those given, else these."""
        return np.asarray(np.where(np.isnan(self.given), estimated, self.given))

    def scatter(self, counts: NDArray[np.int_], size: Array) -> Array:
        """Return the RMS of residuals of this size (channels), corrected for the number of fitted values."""
        fitted = (self.nuisances + len(self.unknowns) / self.sharing) / len(size)
        return np.asarray(size * np.sqrt(counts / np.maximum(counts - fitted, 1)))

    def noise_in(self, counts: NDArray[np.int_], size: Array) -> Array:
        """Return the noise given, else the density that residuals show in their band (channels)."""
        return self.known_or(self.scatter(counts, size) / math.sqrt(self.data.passed))

    def weighted(self, fit: Fit, noise: Array) -> Array:
        """Return the residuals over noise, row by row as the information has them, 0 where missing."""
        return (np.nan_to_num(fit.residual) * weights(noise, fit.residual)).ravel()

    def series(self, residual: Array) -> Array:
        """Return residuals (rows x channels) as what is white, row after row, if the model is right."""
        return residual


def weights(noise: Array, values: Array) -> Array:
    """Return one over the noise's deviations (rows x channels), 0 where a value is missing."""
    return np.asarray(np.where(np.isnan(values), 0.0, 1 / noise))
