"""Likelihood of records that share their parameters, with the priors of these.

Every record has its own loads, channels, sampling, noise and unknown initial state, or is a set of frequency
responses. Records are independent given the parameters: their likelihoods multiply, and information adds up.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from dynid.defaults import HUBER
from dynid.identification.calibration import CalibrationDerivatives
from dynid.identification.information import Information, joint_information
from dynid.identification.measurement import RecordData
from dynid.identification.prediction import Trajectory
from dynid.identification.priors import Priors
from dynid.identification.residual_tests import whiteness
from dynid.identification.saturated_model import SaturatedCoordinates
from dynid.identification.statistics import root_mean_square
from dynid.structure.joints import Unknown

Array = NDArray[np.float64]

# Residuals below this part of a channel's RMS are rounding.
_ROUNDING = 1e-13


class NamedChannel(Protocol):
    """A channel with a name and a unit."""

    @property
    def name(self) -> str:
        """Name in results."""

    @property
    def unit(self) -> str:
        """Unit, SI."""


@dataclass(frozen=True, eq=False)
class RecordFit:
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
        Number of values of each channel, and RMS of its residuals (channels).
    noise
        Standard deviation of the noise (channels): as given, else estimated from the residuals.
    triangles
        Of each channel, over its RMS, a triangle of derivatives by the initial state (scaled) and by the
        logarithms, and residuals, side by side (channels x n + p + 1 x n + p + 1). Whatever the channels are
        to count by, these few rows hold the information of all values. None where `by_parameter` is used.
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


class RecordLikelihood(ABC):
    """Real values (rows x channels) that depend on the parameters, with white Gaussian noise.

    Attributes
    ----------
    data
        The values.
    sharing
        Number of records that share the parameters.
    """

    data: RecordData
    sharing: int

    # Description, for messages and results.

    @property
    def noun(self) -> str:
        """Noun for what is observed."""
        return "record"

    @property
    def channels(self) -> Sequence[NamedChannel]:
        """The channels."""
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
    @abstractmethod
    def unknowns(self) -> tuple[Unknown, ...]:
        """The unknown parameters (p)."""

    @property
    @abstractmethod
    def nuisances(self) -> int:
        """Number of unknowns beside the parameters."""

    @abstractmethod
    def fit(self, logs: Array, values: Array, noise: Array | None = None) -> RecordFit:
        """RecordFit what is unknown beside the parameters to `values` (rows x channels) at exp(logs).

        Channels are weighted by `noise`, their standard deviations (channels); absent: by their RMS.
        """

    def residual(self, logs: Array) -> Array:
        """Return the residual of the fit at exp(logs) (rows x channels), NaN where missing."""
        return self.fit(logs, self.data.values).residual

    @abstractmethod
    def slopes(self, fit: RecordFit, noise: Array) -> Array:
        """Return the derivatives by the logarithms over noise (… x p), or few rows with the same products."""

    def taken(self, fit: RecordFit, noise: Array) -> Array:  # noqa: ARG002
        """Return the degrees of freedom that the nuisances take from each channel (channels)."""
        return np.zeros(len(fit.counts))

    @abstractmethod
    def by_row(self, level: NDArray[Any]) -> NDArray[Any]:
        """Return numbers of channels (channels) row by row as `weighted` and the information have them."""

    @abstractmethod
    def on(self, data: RecordData) -> Self:
        """Return the same, of other values."""

    @abstractmethod
    def information(self, fit: RecordFit, noise: Array) -> Information:
        """Return the information on the parameters of a fit, for a noise of this deviation (channels)."""

    @abstractmethod
    def coordinates(self, fit: RecordFit) -> list[SaturatedCoordinates]:
        """Return the channels, in units of their RMS, in directions of their saturated models."""

    @abstractmethod
    def calibration(self, fit: RecordFit, noise: Array) -> CalibrationDerivatives:
        """Return the derivatives by gains and delay, for a noise of this deviation (channels)."""

    def yielding(self, fit: RecordFit) -> Array:
        """Return the residuals (rows x channels), NaN where missing or where a robust loss bounds them.

        A bounded residual does not move the estimate to first order, whatever the record there.
        """
        robust = self.data.robust
        if robust is None:
            return fit.residual
        left = np.abs(self.data.recorded - fit.predicted.outputs)
        return np.where(left < HUBER.value * robust.scale, fit.residual, np.nan)

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

    def weighted(self, fit: RecordFit, noise: Array) -> Array:
        """Return the residuals over noise, row by row as the information has them, 0 where missing."""
        return (np.nan_to_num(fit.residual) * weights(noise, fit.residual)).ravel()

    def series(self, residual: Array) -> Array:
        """Return residuals (rows x channels) as series that are white if the model is right."""
        return residual

    def residual_rms(self, fit: RecordFit) -> Array:
        """Return the RMS of the residuals (channels), in the channels' units."""
        return fit.size

    def unexplained(self, fit: RecordFit, column: int) -> tuple[float, Array]:
        """Return the residual of a channel over its signal (RMS), and the series to test for whiteness."""
        part = float(fit.size[column] / self.data.rms[column])
        return part, self.series(fit.residual[:, [column]])

    def residual_peak(self, fit: RecordFit, column: int) -> float:  # noqa: ARG002
        """Return the frequency, rad/s, at which the residual of a channel is strongest."""
        return math.nan


def weights(noise: Array, values: Array) -> Array:
    """Return one over the noise's deviations (rows x channels), 0 where a value is missing."""
    return np.asarray(np.where(np.isnan(values), 0.0, 1 / noise))


@dataclass(frozen=True, eq=False)
class Fit:
    """The fits of all records at the same parameters.

    Attributes
    ----------
    logs
        Logarithms of the parameters (p).
    parts
        One fit a record.
    """

    logs: Array
    parts: tuple[RecordFit, ...]

    @property
    def noise(self) -> list[Array]:
        """Standard deviations of the noise (channels) of each record, estimated from its residuals."""
        return [part.noise for part in self.parts]

    @property
    def residuals(self) -> list[Array]:
        """Residuals of each record (times x channels), NaN where missing."""
        return [part.residual for part in self.parts]


@dataclass(frozen=True, eq=False)
class Likelihood:
    """The likelihood of all records, as a function of the parameters, with their priors.

    Attributes
    ----------
    records
        One or more, all with the same unknowns.
    noiseless
        The same without its noise, if it is made already.
    """

    records: tuple[RecordLikelihood, ...]
    noiseless: Likelihood | None = field(default=None, kw_only=True)

    @property
    def ideal(self) -> Likelihood:
        """The same without the records' noise, as far as that is known."""
        if self.noiseless is not None:
            return self.noiseless
        return Likelihood(tuple(record.on(record.data.without_noise()) for record in self.records))

    @cached_property
    def at_truth(self) -> Fit:
        """The fit at the true values, all of which are known."""
        return self.fit(np.log([unknown.true or np.nan for unknown in self.unknowns]))

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        """The unknown parameters (p)."""
        return self.records[0].unknowns

    @cached_property
    def priors(self) -> Priors:
        """Priors and bounds of the parameters."""
        return Priors.of(self.unknowns)

    @property
    def names(self) -> list[str]:
        """Names of the unknown parameters."""
        return [unknown.name for unknown in self.unknowns]

    def fit(self, logs: Array, noise: Sequence[Array] | None = None, *, clean: bool = False) -> Fit:
        """RecordFit the initial states at the parameters exp(logs).

        Parameters
        ----------
        logs
            Logarithms of the parameters (p).
        noise
            Standard deviations that weight the channels of each record; absent: their RMS.
        clean
            True: fit the records without their noise, where these are known.
        """
        parts = []
        for k, record in enumerate(self.records):
            values = record.data.values
            if clean and record.data.clean is not None:
                values = record.data.clean
            parts.append(record.fit(logs, values, None if noise is None else noise[k]))
        return Fit(logs, tuple(parts))

    def information(self, fit: Fit, noise: Sequence[Array], *, prior: bool = True) -> Information:
        """Return the information on the parameters of a fit, for a noise of these deviations.

        With the priors, or of the records alone.
        """
        each = zip(self.records, fit.parts, noise, strict=True)
        found = joint_information([record.information(part, level) for record, part, level in each])
        return found.beside(self.priors.rows()) if prior else found

    def weighted(self, fit: Fit, noise: Sequence[Array]) -> Array:
        """Return the residuals over noise, row by row as the information has them, priors at the end."""
        each = zip(self.records, fit.parts, noise, strict=True)
        measured = [record.weighted(part, level) for record, part, level in each]
        return np.concatenate([*measured, self.priors.residual(fit.logs)])

    def misfit(self, fit: Fit) -> float:
        """Return minus the logarithm of the likelihood, priors included, up to a constant.

        The noise of a channel whose deviation is not given is the one that makes the likelihood largest.
        """
        return self._misfit(fit.logs, [part.counts for part in fit.parts], [part.size for part in fit.parts])

    def misfit_at(self, logs: Array) -> float:
        """Return the misfit of the fit at these logarithms (p), without making the rest of it."""
        sizes = [root_mean_square(record.residual(logs)) for record in self.records]
        return self._misfit(logs, [record.data.counts for record in self.records], sizes)

    def _misfit(self, logs: Array, counts: Sequence[NDArray[np.int_]], sizes: Sequence[Array]) -> float:
        total = float(np.sum(self.priors.residual(logs) ** 2)) / 2
        for record, count, size in zip(self.records, counts, sizes, strict=True):
            level = _likeliest(record, size)
            squares = np.where(np.isnan(record.given), 0.0, size / level) ** 2
            total += float(count @ (np.log(level) + squares / 2))
        return total

    def likeliest(self, fit: Fit) -> list[Array]:
        """Return the noise given, else the RMS of the residuals, not below rounding (channels)."""
        each = zip(self.records, fit.parts, strict=True)
        return [_likeliest(record, part.size) for record, part in each]

    def residual_ratio(self, fit: Fit) -> Array:
        """Return the RMS of the residuals over that of the measured values (channels of all records)."""
        each = zip(self.records, fit.parts, strict=True)
        return np.concatenate([part.size / record.data.rms for record, part in each])

    def whiteness(self, fit: Fit) -> float:
        """Return the p-value of the residuals' whiteness."""
        each = zip(self.records, fit.residuals, strict=True)
        return whiteness(*(record.series(residual) for record, residual in each))


def _likeliest(record: RecordLikelihood, size: Array) -> Array:
    """Return the noise given, else this RMS of the residuals, not below rounding (channels)."""
    return record.known_or(np.hypot(size, _ROUNDING * record.data.rms))
