"""Likelihood of frequency response functions with circular complex Gaussian noise.

Source: R. Pintelon, J. Schoukens, System Identification: A Frequency Domain Approach, 2nd ed. 2012, ch. 9.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from dynid.arrays import Array, ComplexArray
from dynid.defaults import DENSE_STRUCTURES, SEARCH_WORK
from dynid.errors import NumericalError
from dynid.identification.information import RESPONSE, Observed
from dynid.identification.likelihood.likelihood import Likelihood
from dynid.identification.likelihood.record_likelihood import RecordFit, RecordLikelihood
from dynid.identification.likelihood.saturated_model import (
    ChannelColumns,
    SaturatedCoordinates,
    delayed_residuals_by_line,
    most_regressors,
    regressors_by_line,
    saturated_coordinates,
    saturated_directions,
)
from dynid.identification.records.frf_measurement import Frf, FrfMeasurement, stacked, unstacked
from dynid.identification.records.measurement import RecordData
from dynid.identification.statistics import root_mean_square
from dynid.identification.systems.band_limited_system import band_limited
from dynid.identification.systems.frf_system import FrfSystem, check_cost
from dynid.identification.systems.linear_system import LinearSystem
from dynid.identification.systems.parametric_model import Model
from dynid.number_format import frequency_text
from dynid.parameters import named

# A steady state takes as long as so many multiplications, whatever its size.
_STEADY_STATE_WORK = 1e7
# Fewest evaluations that a search may take.
_MIN_FRF_EVALUATIONS = 64


@dataclass(frozen=True, eq=False)
class FrfRecord(RecordLikelihood):
    """Likelihood of measured frequency response functions with a structure."""

    system: FrfSystem  # the model with the responses' channels and forces
    measurement: FrfMeasurement  # lines and channels
    # The measured values over the noise's profile, real parts above imaginary ones (2 L x channels).
    data: RecordData
    # True if only the logarithms of the magnitudes are compared (L x channels): less precise, but with far
    # fewer local minima.
    magnitudes: bool = False
    sharing: int = 1

    @classmethod
    def of(cls, model: Model, measurement: FrfMeasurement, data: RecordData, sharing: int = 1) -> Self:
        """Return the likelihood of responses with a model.

        Raises UsageError if there is more to solve than can be.
        """
        check_cost(model, len(measurement.omega))
        return cls(FrfSystem.of(model, measurement.channels), measurement, data, sharing=sharing)

    @property
    def observed(self) -> Observed:
        """Words for a set of responses."""
        return RESPONSE

    @property
    def notes(self) -> tuple[str, ...]:
        """Warnings of how they were read."""
        return self.measurement.notes

    @property
    def channels(self) -> Sequence[Frf]:
        """The responses."""
        return self.measurement.channels

    def row_label(self, row: int) -> str:
        """Return the frequency of a line."""
        return frequency_text(self.measurement.omega[row % len(self.measurement.omega)], 5)

    def responses(self, values: Array) -> ComplexArray:
        """Return values as they are compared (2 L x channels) as responses (L x channels)."""
        return np.asarray(unstacked(values) * self.measurement.profile)

    def residual_rms(self, fit: RecordFit) -> Array:
        """Return the RMS of the complex residuals (channels)."""
        return np.asarray(np.sqrt(np.nanmean(np.abs(self.responses(fit.residual)) ** 2, axis=0)))

    def residual_peak(self, fit: RecordFit, column: int) -> float:
        """Return the frequency, rad/s, at which the residual of a channel is largest, weighted by line."""
        sizes = np.abs(unstacked(fit.residual))[:, column]
        return float(self.measurement.omega[int(np.nanargmax(sizes))])

    # Noise model.

    @property
    def modelled(self) -> bool:
        """True if the noise is proportional to the response."""
        return self.measurement.proportional and not self.magnitudes

    def renewed(self, fit: RecordFit, root: Array, *, settling: bool = False) -> Self:  # noqa: ARG002
        """Return the likelihood with a noise in proportion to the predicted responses."""
        return self._weighted_by(np.abs(self.responses(fit.predicted.outputs))) if self.modelled else self

    def with_noise_of(self, weighted: Any) -> Self:
        """Return the likelihood with the deviations by line of another one, in whose units the values are."""
        return replace(self, measurement=weighted.measurement)

    def first_weighted(self) -> Self:
        """Return the likelihood with a proportional noise in proportion to the measured responses."""
        return self._weighted_by(np.abs(self.responses(self.data.values))) if self.modelled else self

    def _weighted_by(self, deviation: Array) -> Self:
        """Return the likelihood with other deviations by line, known to a factor (L x channels)."""
        measurement = replace(self.measurement, deviation=deviation, relative=True, proportional=True)
        ratio = np.tile(self.measurement.profile / measurement.profile, (2, 1))
        clean = None if self.data.clean is None else self.data.clean * ratio
        data = replace(self.data, values=self.data.values * ratio, clean=clean)
        return replace(self, measurement=measurement, data=data)

    def ideal(self) -> Self:
        """Return the likelihood without noise, as far as that is known, with its true deviations by line."""
        noiseless, by_line = self.on(self.data.without_noise()), self.data.by_line
        if self.data.clean is None or (by_line is None and not self.modelled):
            return noiseless
        return noiseless._weighted_by(np.ones(self.measurement.profile.shape) if by_line is None else by_line)

    def level(self, estimated: Array, *, ideal: bool) -> Array:
        """Return the true deviations of the noise, in units of those by line, where known; else estimated."""
        if self.data.noise is None or (not ideal and (self.modelled or self.data.by_line is not None)):
            return estimated
        return self.data.noise if self.data.by_line is None else np.full(len(estimated), np.sqrt(0.5))

    def log_determinant(self) -> float:
        """Return the sum of the logarithms of the deviations by line where the noise model has them."""
        if not self.modelled:
            return 0.0
        deviations = np.tile(self.measurement.profile, (2, 1))
        return float(np.sum(np.log(deviations[~np.isnan(self.data.values)])))

    @property
    def system_model(self) -> LinearSystem:
        """The model with the responses' channels and forces."""
        return self.system.system

    def fit(self, eta: Array, values: Array, noise: Array | None = None) -> RecordFit:  # noqa: ARG002
        """Predict the responses at coordinates of the parameters and compare them with `values`."""
        return self._fit_at(eta, *self._compared(eta), values)

    def residual_rms_at(self, eta: Array) -> Array:
        """Return the RMS of the residuals at these coordinates (channels)."""
        return root_mean_square(self.data.values - self._compared(eta, slopes=False)[0])

    def _compared(self, eta: Array, *, slopes: bool = True) -> tuple[Array, Array]:
        """Return the predicted values as they are compared, and their derivatives by the coordinates."""
        response = self.system.response(self.measurement.omega, eta, slopes=slopes)
        self._check_branch(response.values)
        if self.magnitudes:
            there = np.where(response.values == 0, 1.0, response.values)
            return _logarithms(np.abs(response.values)), (response.slopes / there[..., None]).real
        profile = self.measurement.profile
        return stacked(response.values / profile), stacked(response.slopes / profile[..., None])

    def _check_branch(self, values: ComplexArray) -> None:
        """Refuse parameters for which a measured steady state does not exist."""
        missing = np.isnan(values) & ~np.isnan(self.data.values[: len(values)])
        if missing.any():
            column = int(missing.any(axis=0).argmax())
            lines = self.measurement.omega[missing[:, column]]
            line = lines[-1] if self.channels[column].sweep == "down" else lines[0]
            raise NumericalError(
                f"the branch of {self.channels[column].name} ends at a fold before the measured line at "
                f"{frequency_text(line, 5)}",
                remedy="Start nearer to the true values, or leave out lines next to a jump. Lines behind it "
                "are of the other branch: a channel of its own with the other 'sweep'.",
                names=("measurement.channels",),
            )

    def on(self, data: RecordData) -> Self:
        """Return the likelihood of other values of the same responses."""
        return replace(self, data=data)

    def coordinates(self, fit: RecordFit) -> list[SaturatedCoordinates]:
        """Return the channels, in units of their RMS, in directions of their saturated models."""
        assert fit.by_parameter is not None
        assert fit.measured is not None
        system, omega = self.system.system, self.measurement.omega
        poles = np.empty(0, dtype=complex)
        if len(system.states) <= 2 * DENSE_STRUCTURES.value:  # of a larger one they take too long
            poles = system.poles(named(self.unknowns, fit.eta))
        coordinates = []
        for c, rms in enumerate(self.data.rms):
            there, count = ~np.isnan(fit.residual[:, c]), int(self.data.counts[c])
            weight = there / rms
            profile = np.nan_to_num(self.measurement.profile[:, c], nan=1.0)
            shared = regressors_by_line(poles, omega, profile, most_regressors(count))
            outputs = np.nan_to_num(fit.predicted.outputs[:, c]) * weight
            measured = np.nan_to_num(fit.measured[:, c]) * weight
            residual = np.nan_to_num(fit.residual[:, c]) * weight
            by_parameter = np.nan_to_num(fit.by_parameter[:, c]) * weight[:, None]
            before = delayed_residuals_by_line(residual) * there[:, None]
            columns = np.column_stack([outputs, by_parameter, before, measured, residual])
            widths = by_parameter.shape[1], 0, 0, before.shape[1]
            shared = shared.where(there)
            ranges = saturated_directions(shared.factors[1], shared.values.shape[1])
            channel = ChannelColumns.of(shared, columns, widths)
            coordinates.append(saturated_coordinates(shared, ranges, channel, count))
        return coordinates

    def series(self, residual: Array) -> Array:
        """Return the residuals line after line, real and imaginary parts side by side."""
        return residual if self.magnitudes else np.concatenate(np.split(residual, 2), axis=1)

    @property
    def multiplications(self) -> float:
        """Approximate number of multiplications of one evaluation."""
        omega, of = self.measurement.omega, self.system
        if of.nonlinear:
            return len(omega) * _STEADY_STATE_WORK * len(of.functions)
        return len(omega) * float(max(1, of.system.solved_size(omega, of.pairs))) ** 3

    def band_limited(self, band: float) -> FrfRecord | None:
        """Return the responses of the model's modes below `band` times the highest line, if that pays."""
        if self.system.nonlinear:
            return None
        limited = band_limited(self.system.system, self.measurement.omega, self.system.pairs, band)
        return None if limited is None else replace(self, system=replace(self.system, system=limited))

    def by_magnitude(self) -> FrfRecord:
        """Return the same responses compared by the logarithms of their magnitudes."""
        sizes = np.abs(unstacked(self.data.values)) * self.measurement.profile
        return replace(self, data=RecordData(_logarithms(sizes)), magnitudes=True)


def _logarithms(sizes: Array) -> Array:
    """Return the logarithms of sizes, NaN of zeros."""
    return np.log(np.where(sizes > 0, sizes, np.nan))


@dataclass(frozen=True, eq=False)
class FrfLikelihood(Likelihood):
    """The likelihood of frequency response functions."""

    records: tuple[FrfRecord, ...]

    def by_magnitude(self) -> FrfLikelihood:
        """Return the likelihood of the logarithms of magnitudes."""
        return FrfLikelihood(tuple(record.by_magnitude() for record in self.records))

    @property
    def most_evaluations(self) -> float:
        """Most evaluations that a search may take, from the work of one."""
        work = sum(record.multiplications for record in self.records)
        return max(_MIN_FRF_EVALUATIONS, SEARCH_WORK.value // work)

    def with_weights_of(self, weighted: Any) -> FrfLikelihood:
        """Return the likelihood with the weights by line of one of the same responses with another model."""
        pairs = zip(self.records, weighted.records, strict=True)
        return FrfLikelihood(tuple(replace(end, system=record.system) for record, end in pairs))

    def band_limited(self, band: float) -> FrfLikelihood | None:
        """Return the likelihood with the model's modes below `band` times the highest line, if that pays."""
        records = [limited for record in self.records if (limited := record.band_limited(band)) is not None]
        return FrfLikelihood(tuple(records)) if len(records) == len(self.records) else None
