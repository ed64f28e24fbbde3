"""Residuals of an estimate: their channels, what of the records they leave, and the tests of their noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dynid.arrays import Array
from dynid.defaults import NOISE_CONTRADICTED, NOISE_MATTERS, OUTLIER
from dynid.errors import NumericalError
from dynid.identification.estimators.estimate import Estimate
from dynid.identification.information import Information
from dynid.identification.likelihood.likelihood import Fit, Likelihood
from dynid.identification.likelihood.record_likelihood import RecordLikelihood
from dynid.identification.residual_tests import (
    Consistency,
    NoiseTest,
    ResidualShape,
    consistency,
    is_coloured,
    is_explained,
    noise_test,
    residual_shape,
    whiteness,
)
from dynid.identification.statistics import root_mean_square

if TYPE_CHECKING:
    from dynid.identification.likelihood.nonlinearity import Nonlinearity

# Residuals above this part of a channel's RMS invalidate the estimates if they are not noise …
_INVALID_RESIDUAL_RATIO = 0.5
# … and above this one (all channels together) whatever they are.
_EXPLAINED_RATIO = 1.0
# Residuals below this part of the signal are round-off and holds: their distribution is not tested.
_SHAPE_ROUND_OFF = 1e-6


class ChannelOfRecord(NamedTuple):
    """A channel by `record` and `column`, its `name` in results and its `unit`."""

    record: int
    column: int
    name: str
    unit: str


def channels_of_records(records: Sequence[RecordLikelihood]) -> list[ChannelOfRecord]:
    """Return all channels, record by record; of several records and of modes the names have a prefix."""
    several = sum(not record.modal for record in records) > 1
    channels = []
    for k, record in enumerate(records):
        prefix = "modes." if record.modal else f"record_{k + 1}." if several else ""
        channels += [
            ChannelOfRecord(k, column, f"{prefix}{channel.name}", channel.unit)
            for column, channel in enumerate(record.channels)
        ]
    return channels


@dataclass(frozen=True, eq=False)
class Residuals:
    """The residuals of all records at an estimate."""

    likelihood: Likelihood  # the likelihood of all records, which `estimate` maximises
    method: str  # name of the estimator
    estimate: Estimate  # the estimate

    @property
    def fit(self) -> Fit:
        """The fit at the estimate."""
        return self.estimate.fit

    @property
    def several(self) -> bool:
        """True if there is more than one record."""
        return sum(not record.modal for record in self.likelihood.records) > 1

    @property
    def noun(self) -> str:
        """Noun for one record."""
        return self.likelihood.records[0].observed.noun

    @cached_property
    def channels(self) -> list[ChannelOfRecord]:
        """All channels, record by record."""
        return channels_of_records(self.likelihood.records)

    @cached_property
    def noise(self) -> list[Array]:
        """Noise of each record, given or that of the residuals (channels); above round-off, as a divisor."""
        pairs = zip(self.fit.noise, self.likelihood.records, strict=True)
        return [np.maximum(noise, np.finfo(float).eps * record.data.rms) for noise, record in pairs]

    @cached_property
    def information(self) -> Information:
        """The Fisher information at the estimate, for the noise given or that of the residuals."""
        return self.likelihood.information(self.fit, self.noise)

    @property
    def unexplained(self) -> str:
        """Return why the prediction does not explain the records; empty where it does."""
        fits = zip(self.likelihood.records, self.fit.parts, strict=True)
        # Corrected for the degrees of freedom of the fit.
        left = np.concatenate(
            [record.scatter(p.counts, record.unwhitened_rms(p)) / record.data.rms for record, p in fits]
        )
        if not np.mean(left**2) < _EXPLAINED_RATIO**2:
            return f"the prediction explains nothing of the {self.noun}{'s' * self.several}"
        for unexplained, channel in zip(left, self.channels, strict=True):
            if unexplained > _INVALID_RESIDUAL_RATIO and is_coloured(self.channel_whiteness_p(channel)):
                share = f"{100 * unexplained:.0f} % of {channel.name}"
                return f"{share} is unexplained, and the residual is not noise"
        return ""

    @cached_property
    def whiteness_p(self) -> float:
        """The p-value of the whiteness of the residuals."""
        comparison = self.estimate.comparison
        if comparison is not None and all(record.data.passed == 1 for record in self.likelihood.records):
            return comparison.whiteness_p
        return self.likelihood.whiteness(self.fit)

    @cached_property
    def residual_ratio(self) -> Array:
        """RMS of the residuals over that of the measured values (channels of all records)."""
        return self.likelihood.residual_ratio(self.fit)

    @property
    def residual_rms(self) -> Array:
        """RMS of the residuals (channels of all records), in the channels' units."""
        fits = zip(self.likelihood.records, self.fit.parts, strict=True)
        return np.concatenate([record.residual_rms(record_fit) for record, record_fit in fits])

    @property
    def explained(self) -> bool:
        """True if the residuals are small, or white noise."""
        return is_explained(self.residual_ratio, self.whiteness_p)

    def raw_residual(self, channel: ChannelOfRecord) -> Array:
        """Return the recorded values of a channel less the prediction (rows), NaN where missing."""
        record, record_fit = self.likelihood.records[channel.record], self.fit.parts[channel.record]
        return np.asarray((record.data.recorded - record_fit.predicted.outputs)[:, channel.column])

    def series(self, channel: ChannelOfRecord) -> Array:
        """Return the series of a channel that is white if the model is right (rows x columns)."""
        residual = self.fit.residuals[channel.record]
        return self.likelihood.records[channel.record].channel_series(residual, channel.column)

    def channel_whiteness_p(self, channel: ChannelOfRecord) -> float:
        """Return the p-value of the whiteness of the residuals of a channel."""
        order = self.likelihood.records[channel.record].noise_orders[channel.column]
        return whiteness(self.series(channel), coefficients=[int(order)])

    @cached_property
    def shapes(self) -> list[ResidualShape | None]:
        """Shapes of the residuals (channels of all records); None where they are round-off or too short."""
        shapes: list[ResidualShape | None] = []
        for channel in self.channels:
            record, residual = self.likelihood.records[channel.record], self.raw_residual(channel)
            both = np.column_stack([residual, record.data.recorded[:, channel.column]])
            left, signal = root_mean_square(both)
            shapes.append(
                residual_shape(residual, OUTLIER.value) if left > _SHAPE_ROUND_OFF * signal else None
            )
        return shapes

    @cached_property
    def nonlinearity(self) -> Nonlinearity | None:
        """The score test of the joints; None where there is no record of time, or no scalar joint."""
        if all(record.sampling_step is None for record in self.likelihood.records):
            return None
        from dynid.identification.likelihood.nonlinearity import nonlinearity  # of records of time alone

        try:
            return nonlinearity(self.likelihood, self.fit, white=not is_coloured(self.whiteness_p))
        except (FloatingPointError, NumericalError):  # numbers near the ends of double precision say nothing
            return None

    @property
    def robust(self) -> bool:
        """True if a robust loss was used."""
        return any(record.data.robust is not None for record in self.likelihood.records)

    @property
    def noise_is_given(self) -> bool:
        """True if error bars are for a noise that is given, of one channel at least."""
        return not all(np.isnan(record.stated_noise).all() for record in self.likelihood.records)

    @cached_property
    def noise_test(self) -> NoiseTest:
        """Test of the residuals against the noise that is given (channels of all records).

        Of prepared records only the part of the values counts that the filters pass of white noise. With a
        robust loss the robust deviation is compared.
        """
        squares, degrees, robust, first = [], [], [], 0
        # Degrees of freedom that the parameters take from each row of the information.
        shares = np.sum((self.information.projected @ self.information.root) ** 2, axis=1)
        for record, record_fit, noise in zip(
            self.likelihood.records, self.fit.parts, self.noise, strict=True
        ):
            column = record.by_row(np.arange(len(noise)))
            row_shares = shares[first : first + len(column)]
            first += len(column)
            fitted = record.nuisance_degrees(record_fit, noise) + np.bincount(column, row_shares, len(noise))
            given_noise, count = record.data.given_noise, record.data.passed * record_fit.counts
            if record.data.robust is not None:
                variance = record.data.robust.scale**2 / record.data.passed
                squares.append(variance / given_noise**2 * count)
                degrees.append(count)
            else:
                squares.append(record_fit.counts * (record_fit.size / given_noise) ** 2)
                degrees.append(count - fitted)
            robust.append(np.full(len(given_noise), record.data.robust is not None))
        return noise_test(np.concatenate(squares), np.concatenate(degrees), np.concatenate(robust))

    @property
    def contradicted_noise(self) -> list[int]:
        """Channels whose given noise the residuals contradict by enough to matter."""
        test = self.noise_test
        if not test.p < NOISE_CONTRADICTED.value:
            return []
        off = (test.ratio > NOISE_MATTERS.value) | (test.ratio < 1 / NOISE_MATTERS.value)
        return np.flatnonzero(off & (test.channel_p < NOISE_CONTRADICTED.value)).tolist()

    @cached_property
    def innovations(self) -> list[Array] | None:
        """Innovations of the filter's last pass; none of a first one, which assumes a noise of its own."""
        sweeps = self.estimate.histories
        if self.method not in ("filter", "sigma-point") or len(sweeps) < 2:
            return None
        return [history.innovations for history in sweeps[-1] if history.innovations is not None]

    @property
    def consistency(self) -> Consistency | None:
        """Mean square of the innovations of all records, as of one channel."""
        innovations = self.innovations
        return (
            None
            if innovations is None
            else consistency(np.concatenate([e.ravel() for e in innovations])[:, None])
        )
