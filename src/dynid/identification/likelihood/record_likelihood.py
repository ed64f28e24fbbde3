"""Likelihood of one record: prediction, residuals, information, and the directions in which it is tested.

Records of time (`time_record`), frequency responses (`frf_record`) and segments of records of time
(`estimators.segments`) implement it.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array, guarded
from dynid.defaults import HUBER
from dynid.errors import DynidError
from dynid.identification.information import RECORD, Information, Observed, information
from dynid.identification.likelihood.saturated_model import SaturatedCoordinates
from dynid.identification.records.measurement import RecordData
from dynid.identification.statistics import root_mean_square
from dynid.identification.systems.linear_system import LinearSystem
from dynid.identification.systems.prediction import Trajectory
from dynid.parameters import Parameter, rates, values

#: Part of its variance that parameters leave of a value, or combination, below which no error shows in it.
HIDDEN = 0.05
# Residuals below this part of a channel's RMS are rounding.
_RESIDUAL_FLOOR = 1e-13


@dataclass(frozen=True, eq=False)
class ScatterTest:
    """Residuals of values whose scatter is given, channel by channel."""

    residual: Array  # over the scatter (values x channels), NaN where there are none
    leverage: Array  # part of an error of each value that the parameters absorb (values x channels)
    degrees: Array  # degrees of freedom of the residuals (channels)
    by_parameter: Array  # derivatives by the coordinates over the scatter, free of nuisances (values x p)
    values: int  # their number less that of nuisances
    explained: float  # part of the values that the model explains (0 to 1)
    # Sums of squares that are independent of each other and of what is left, with their degrees of freedom:
    # of channels with few values, which the many of the others would hide.
    groups: Sequence[tuple[float, int]] = ()

    @property
    def squares(self) -> Array:
        """Sums of squares of the residuals over the scatter (channels)."""
        return np.asarray(np.nansum(self.residual**2, axis=0))

    @property
    def studentised(self) -> Array:
        """Residuals over their own deviations (values x channels), NaN of values that decide parameters.

        That of an error of b standard errors is ``b sqrt(1 - leverage)``. R. D. Cook, S. Weisberg, Residuals
        and Influence in Regression, 1982, sec. 2.2.
        """
        remaining = 1 - self.leverage
        return np.where(remaining > HIDDEN, self.residual / np.sqrt(np.maximum(remaining, HIDDEN)), np.nan)


@dataclass(frozen=True, eq=False)
class RecordFit:
    """A fit at fixed parameters, the initial state being the best one (linear least squares)."""

    eta: Array  # coordinates of the parameters (p)
    predicted: Trajectory  # without noise, the states in SI divided by the model's scale
    residual: Array  # measured minus predicted (times x channels), NaN where missing
    counts: NDArray[np.int_]  # number of values (channels)
    size: Array  # RMS of the residuals (channels)
    noise: Array  # standard deviation of the noise (channels): as given, else estimated from the residuals
    # Of each channel, over its RMS, a triangular factor of the derivatives by the initial state (scaled) and
    # by the coordinates, and the residuals, side by side (channels x n + p + 1 x n + p + 1): it has the
    # information of all values for any weights of the channels. None where `by_parameter` is used.
    triangles: Array | None = None
    by_parameter: Array | None = None  # derivatives by the coordinates (times x channels x p)
    measured: Array | None = None  # what it is fitted to (times x channels), NaN where missing


class RecordLikelihood(ABC):
    """Likelihood of real values (rows x channels) that depend on the parameters, with Gaussian noise.

    Noise that is not white is whitened: `fit`, `information`, `weighted`, `coordinates` and `series` are
    those of whitened values, for the noise model that `renewed` estimates.
    """

    data: RecordData  # the values
    sharing: int  # number of records that share the parameters
    #: True for measured modes.
    modal: ClassVar[bool] = False
    #: The remedy of outliers that cannot be corrected; empty where there is none.
    outlier_remedy: ClassVar[str] = "estimator: {loss: huber}"

    #: True if responses to loads and first states add up.
    superposes: ClassVar[bool] = True
    #: True if the start says nothing of what the values determine: a slider that sticks there may slip.
    origin_is_free: ClassVar[bool] = False

    @property
    def sample_counts(self) -> NDArray[np.int_]:
        """Number of values of each channel, present or missing (channels)."""
        samples, channels = self.data.values.shape
        return np.full(channels, samples)

    @property
    def may_idle(self) -> bool:
        """True if parameters may have no influence without having run away: those of a joint that sticks."""
        return not self.superposes

    @property
    def full_data(self) -> RecordData:
        """The values with those at which not every input is known."""
        return self.data

    def covering(self, eta: Array, *, narrowed: bool) -> Self:  # noqa: ARG002
        """Return the likelihood of the values at which every input is known at coordinates `eta` (p).

        `narrowed`: of all such values; else of the present ones alone.
        """
        return self

    # Description, for messages and results.

    @property
    def notes(self) -> tuple[str, ...]:
        """Warnings of how it was read."""
        return ()

    @property
    def observed(self) -> Observed:
        """Words for what is observed."""
        return RECORD

    @property
    def channels(self) -> Sequence[Any]:
        """The channels, with `name` and `unit`."""
        return ()

    @property
    def sampling_step(self) -> float | None:
        """Sampling step, s; None of frequency responses."""
        return None

    @property
    def mean_is_offset(self) -> bool:
        """True if the mean of a residual is an offset of the sensor."""
        return False

    def row_label(self, row: int) -> str:
        """Return the time or frequency of a row, with its unit."""
        return str(row)

    # Prediction, residuals and information.

    @property
    def unknowns(self) -> tuple[Parameter, ...]:
        """The unknown parameters (p)."""
        return self.system_model.unknowns

    @property
    @abstractmethod
    def system_model(self) -> LinearSystem:
        """The model with the loads and channels of the record."""

    @property
    def considered(self) -> tuple[Parameter, ...]:
        """Parameters that are known with uncertainty."""
        return self.system_model.considered

    @property
    def nuisances(self) -> int:
        """Number of nuisances: unknowns beside the parameters."""
        return 0

    @abstractmethod
    def fit(self, eta: Array, values: Array, noise: Array | None = None) -> RecordFit:
        """Fit the nuisances, such as an initial state, to `values` (rows x channels) at coordinates `eta`.

        Channels are weighted by `noise`, their standard deviations (channels); absent: by their RMS.
        """

    def _fit_at(self, eta: Array, outputs: Array, by_parameter: Array, values: Array) -> RecordFit:
        """Return the fit of a prediction without nuisances to `values`."""
        predicted, residual = Trajectory(outputs, np.zeros((len(outputs), 0))), values - outputs
        counts, size = np.count_nonzero(~np.isnan(residual), axis=0), root_mean_square(residual)
        level = self.noise_in(counts, size)
        return RecordFit(
            eta, predicted, residual, counts, size, level, by_parameter=by_parameter, measured=values
        )

    def residual(self, eta: Array) -> Array:
        """Return the residual of the fit at coordinates `eta` (rows x channels), NaN where missing."""
        return self.fit(eta, self.data.values).residual

    def slopes(self, fit: RecordFit, noise: Array) -> Array:
        """Return the derivatives by the coordinates over noise (… x p), or rows with the same products.

        Those of a fit that has them value by value, 0 where a value is missing.
        """
        assert fit.by_parameter is not None
        weight = weights(noise, fit.residual)
        return (np.nan_to_num(fit.by_parameter) * weight[..., None]).reshape(-1, len(self.unknowns))

    def nuisance_degrees(self, fit: RecordFit, noise: Array) -> Array:  # noqa: ARG002
        """Return the degrees of freedom of each channel that the nuisances use up (channels)."""
        return np.zeros(len(fit.counts))

    def by_row(self, level: NDArray[Any]) -> NDArray[Any]:
        """Return numbers of channels (channels), one for each row of `weighted` and of the information."""
        return np.tile(level, len(self.data.values))

    @abstractmethod
    def on(self, data: RecordData) -> Self:
        """Return the likelihood of other values of the same record."""

    def information(self, fit: RecordFit, noise: Array) -> Information:
        """Return the information on the parameters of a fit, for a noise of this deviation (channels)."""
        names = tuple(unknown.name for unknown in self.unknowns)
        weight = weights(noise, fit.residual)
        slopes = self.slopes(fit, noise)
        signal = float(np.linalg.norm(np.nan_to_num(fit.predicted.outputs) * weight))
        count = int(np.count_nonzero(weight)) - self.nuisances
        at = values(self.unknowns, fit.eta), rates(self.unknowns, fit.eta)
        return information(names, slopes, np.zeros((len(slopes), 0)), signal, count, *at, self.observed)

    @abstractmethod
    def coordinates(self, fit: RecordFit) -> list[SaturatedCoordinates]:
        """Return the channels, in units of their RMS, in directions of their saturated models."""

    # Noise model.

    @property
    def modelled(self) -> bool:
        """True if a model of the noise is to be estimated together with the parameters."""
        return False

    @property
    def noise_remedy(self) -> str:
        """The remedy of coloured residuals, as the end of a sentence; empty where there is none."""
        return ""

    def renewed(self, fit: RecordFit, root: Array, *, settling: bool = False) -> Self:  # noqa: ARG002
        """Return the likelihood with the noise model of its own fit.

        `root`: one of the covariance of the coordinates, given all records (p x p). `settling`: the order of
        the noise model stays as it is.
        """
        return self

    def with_noise_of(self, record: Any) -> Self:  # noqa: ARG002
        """Return the likelihood with the noise model of another one of the same record."""
        return self

    def continuing(self, record: Any) -> Self:  # noqa: ARG002
        """Return the likelihood of the samples of another one of the same record."""
        return self

    def tested(self, fit: RecordFit, root: Callable[[], Array]) -> ScatterTest | None:  # noqa: ARG002
        """Return the residuals over the scatter that is given; None where a saturated model tests them.

        `root` returns a root of the covariance of the coordinates (p x p), 0 of those at a limit.
        """
        return None

    def ideal(self) -> Self:
        """Return the likelihood without noise, as far as that is known, with the true model of the noise."""
        return self.on(self.data.without_noise())

    def level(self, estimated: Array, *, ideal: bool) -> Array:  # noqa: ARG002
        """Return the true deviations of the noise (channels) where they are known, else the estimated ones.

        `ideal`: for the noise model of `ideal`.
        """
        return estimated if self.data.noise is None else self.data.noise

    def log_determinant(self) -> float:
        """Return what the misfit has besides the deviations and residuals: 0 of white noise."""
        return 0.0

    def misfit(self, counts: NDArray[np.int_], size: Array) -> float:
        """Return minus the logarithm of the likelihood, of residuals of this number and RMS (channels)."""
        level = self.above_rounding(size)
        squares = np.where(np.isnan(self.stated_noise), 0.0, size / level) ** 2
        return float(counts @ (np.log(level) + squares / 2)) + self.log_determinant()

    def residual_rms_at(self, eta: Array) -> Array:
        """Return the RMS of the residuals, whitened, at these coordinates (channels)."""
        return root_mean_square(self.residual(eta))

    def residual_rms_of(self, etas: Array) -> Array:
        """Return the RMS of the residuals at coordinates (count x p), NaN without a prediction."""
        sizes = np.full((len(etas), len(self.data.rms)), np.nan)
        for size, eta in zip(sizes, etas, strict=True):
            with suppress(DynidError), guarded("the prediction"):
                size[:] = self.residual_rms_at(eta)
        return sizes

    def unwhitened_rms(self, fit: RecordFit) -> Array:
        """Return the RMS of the residuals (channels), not whitened."""
        return fit.size

    def influential(self, fit: RecordFit) -> Array:
        """Return the residuals (rows x channels), NaN where missing or where a robust loss bounds them.

        To first order the estimate does not depend on a bounded residual.
        """
        robust = self.data.robust
        if robust is None:
            return fit.residual
        left = np.abs(self.data.recorded - fit.predicted.outputs)
        return np.where(left < HUBER.value * robust.scale, fit.residual, np.nan)

    @cached_property
    def stated_noise(self) -> Array:
        """Deviations of the noise (channels), NaN where none is given."""
        return np.full(self.data.values.shape[1], np.nan) if self.data.given is None else self.data.given

    def stated_noise_or(self, estimated: Array) -> Array:
        """Return the deviations of the noise (channels): the given ones, else these."""
        return np.asarray(np.where(np.isnan(self.stated_noise), estimated, self.stated_noise))

    def above_rounding(self, estimated: Array) -> Array:
        """Return the given noise, else this estimate of it, not below rounding (channels)."""
        return self.stated_noise_or(np.hypot(estimated, _RESIDUAL_FLOOR * self.data.rms))

    def scatter(self, counts: NDArray[np.int_], size: Array) -> Array:
        """Return the RMS of residuals of this size (channels), corrected for the number of fitted values."""
        fitted = (self.nuisances + len(self.unknowns) / self.sharing) / len(size)
        return np.asarray(size * np.sqrt(counts / np.maximum(counts - fitted, 1)))

    def noise_in(self, counts: NDArray[np.int_], size: Array) -> Array:
        """Return the given noise, else the density of the residuals in their band (channels)."""
        return self.above_rounding(self.scatter(counts, size) / math.sqrt(self.data.passed))

    def weighted(self, fit: RecordFit, noise: Array) -> Array:
        """Return the residuals over noise, row by row as the information has them, 0 where missing."""
        return (np.nan_to_num(fit.residual) * weights(noise, fit.residual)).ravel()

    @property
    def noise_orders(self) -> NDArray[np.int_]:
        """Number of estimated coefficients of the noise (channels)."""
        return np.zeros(self.data.values.shape[1], dtype=int)

    @property
    def noise_coefficients(self) -> int:
        """Number of estimated numbers of the noise besides its deviations."""
        return int(self.noise_orders.sum())

    def series(self, residual: Array) -> Array:
        """Return residuals (rows x channels) as series that are white if the model is right."""
        return residual

    def channel_series(self, residual: Array, column: int) -> Array:
        """Return the series of a channel, of residuals (rows x channels) of all."""
        return self.series(residual)[:, column :: residual.shape[1]]

    def residual_rms(self, fit: RecordFit) -> Array:
        """Return the RMS of the residuals (channels), in the channels' units."""
        return self.unwhitened_rms(fit)

    def unexplained(self, fit: RecordFit, column: int) -> tuple[float, Array]:
        """Return the residual of a channel over its signal (RMS), and the series to test for whiteness."""
        ratio = float(fit.size[column] / self.data.rms[column])
        return ratio, self.channel_series(fit.residual, column)

    def residual_peak(self, fit: RecordFit, column: int) -> float:  # noqa: ARG002
        """Return the frequency, rad/s, at which the residual of a channel is strongest."""
        return math.nan


def weights(noise: Array, values: Array) -> Array:
    """Return one over the noise's deviations (rows x channels), 0 where a value is missing."""
    return np.asarray(np.where(np.isnan(values), 0.0, 1 / noise))
