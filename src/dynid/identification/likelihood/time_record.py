"""Likelihood of records of time: initial state, residuals, information, and priors of filter passes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array
from dynid.defaults import RECORD_SEARCH_WORK
from dynid.identification.information import Information, information
from dynid.identification.least_squares import STATE_RANK, least_squares, thin_svd, triangular_factors
from dynid.identification.likelihood.likelihood import Likelihood
from dynid.identification.likelihood.record_likelihood import RecordFit, RecordLikelihood
from dynid.identification.likelihood.saturated_model import Regressors, SaturatedCoordinates
from dynid.identification.likelihood.saturated_record import coordinates
from dynid.identification.likelihood.shared_decays import first_state_rows, fit_from, sensitive
from dynid.identification.likelihood.state_deviations import initial_root
from dynid.identification.records.measurement import Experiment, RecordData, Simulation
from dynid.identification.records.noise import Autoregression, ColouredNoise, Whitening, estimated
from dynid.identification.residual_tests import spectrum
from dynid.identification.statistics import root_mean_square
from dynid.identification.systems import kernels
from dynid.identification.systems.free_decays import FreeDecays, are_many, free_decays
from dynid.identification.systems.known_inputs import (
    NONE_LEFT_OUT,
    SAMPLE_TIME_TOL,
    KnownSamples,
    known_samples,
    known_span,
)
from dynid.identification.systems.linear_system import LinearSystem
from dynid.identification.systems.parametric_model import ParametricModel, check_sensitivities
from dynid.identification.systems.prediction import (
    ALL_CHANNELS,
    Free,
    Prediction,
    PredictionBlock,
    Trajectory,
    free_blocks,
    free_prediction,
    kernels_used,
    prediction,
    prediction_blocks,
)
from dynid.lti.signals import Sampled
from dynid.native import compiled
from dynid.parameters import named, rates, starts, values
from dynid.structure.ports import Channel

# The prior lets every channel be this many times larger than measured.
_PRIOR_WIDTH = 10.0
# Numbers of the largest sensitivities that are kept from a fit for the tests of it.
_MAX_KEPT_NUMBERS = 1_000_000
# Most numbers of sensitivities that are held at once, of a block of channels or of steps: 32 MB.
_MAX_BLOCK_NUMBERS = 4_000_000
# Copies of a block of samples that whitening makes, and what the samples of a block are a multiple of.
_BLOCK_COPIES, _ROWS_MULTIPLE = 4, 256
# Those of large models that share decays, whose sensitivities are dear: 64 MB.
_MAX_SHARED_NUMBERS = 8_000_000
# Fewest evaluations that a search may take: those that rank one round of starts.
_MIN_RECORD_EVALUATIONS = 256
# The exponential of a matrix and each of its derivatives take so many products of its size.
_TRANSITION_WORK = 30
# A sample of a record of loops with delays takes as long as so many multiplications, whatever the size.
_DELAYED_WORK = 100_000
# The first part of a large record, one in so many, from which an estimate begins.
_FIRST_PART = 8
# Fewest values of a part of a record for each unknown.
_MIN_VALUES_PER_UNKNOWN = 4


@dataclass(frozen=True, eq=False)
class TimeRecord(RecordLikelihood):
    """The likelihood of one record of time with its model."""

    model: ParametricModel  # the model of the record
    data: RecordData  # the record
    experiment: Experiment | None = None  # loads and measurement as they were given, for messages and results
    sharing: int = 1  # number of records that share the parameters
    # Autoregression of the noise, by which values and derivatives are whitened; absent: the noise is white.
    colour: Autoregression | None = None
    # Samples of the record at which not every input is known: `model` and `data` are without them.
    left_out: KnownSamples = NONE_LEFT_OUT
    recorded: RecordData | None = None  # the record with them; None where there are none
    # True: channels with clocks of their own are interpolated at the times of the record, for searches.
    resampled: bool = False
    _last: dict[bytes, Prediction] = field(default_factory=dict, init=False, repr=False)
    #: Regressors of the saturated model at the last coordinates, unless they are large.
    kept_regressors: dict[bytes, Regressors] = field(default_factory=dict, init=False, repr=False)

    @classmethod
    def of(cls, model: ParametricModel, data: RecordData, experiment: Experiment, sharing: int = 1) -> Self:
        """Return the likelihood of a record where every input is known.

        Of unknown delays, for the range in which they are sought first; `covering` adapts it to an estimate.
        """
        record = cls(model, data, experiment, sharing)
        spread = [unknown.first_spread for unknown in model.unknowns]
        left_out = record._left_out_at(starts(model.unknowns), np.array(spread))
        return record.leaving_out(left_out)

    def leaving_out(self, samples: KnownSamples) -> Self:
        """Return the likelihood of the record without so many samples at its ends."""
        if samples == self.left_out:
            return self
        record, times = self.full_data, self.conditions.measurement.record.times
        if samples.of_channels:
            emptied = replace(self, left_out=samples, recorded=record, colour=None)
            return replace(emptied, data=record.where(emptied.known))
        kept = slice(samples.before, len(times) - samples.after)
        model = self.model.at_times(times[kept])
        return replace(
            self, model=model, data=record.within(kept), left_out=samples, recorded=record, colour=None
        )

    def first_part(self, divisor: int) -> Self:
        """Return the likelihood of the first part of the record, one in so many, or a longer one."""
        unknowns = self.nuisances + self.model.parameters
        fewest = -(-_MIN_VALUES_PER_UNKNOWN * unknowns // len(self.data.rms))
        return self.first(max(fewest, len(self.times) // divisor))

    def first(self, samples: int) -> Self:
        """Return the likelihood of the first samples of the record."""
        kept = slice(0, samples)
        model = self.model.at_times(self.model.times[kept])
        return replace(self, model=model, data=self.data.within(kept), recorded=None)

    def covering(self, eta: Array, *, narrowed: bool) -> Self:
        """Return the likelihood of samples at which every input is known at coordinates `eta` (p).

        `narrowed`: of all such samples; else of the present ones alone, among which a search of delays ends.
        """
        needed = self._left_out_at(eta, np.zeros(len(eta)))
        return self.leaving_out(needed if narrowed else needed.including(self.left_out))

    def _left_out_at(self, eta: Array, reach: Array) -> KnownSamples:
        """Return the samples left out for coordinates that may be off by so much (p)."""
        instruments = self.model.instruments
        if self.experiment is None or not (instruments.delayed or instruments.clocked):
            return self.left_out
        measurement = self.experiment.measurement
        simulated = isinstance(measurement.source, Simulation)
        return known_samples(self.model, measurement.record.times, eta, reach, at_rest_before=simulated)

    def at_record_clock(self) -> Self:
        """Return the likelihood with channels interpolated at the times of the record; itself if none is.

        It guides searches, which are not blocked by what a drift does: that has no influence there.
        """
        model = self.model
        if not model.instruments.clocked:
            return self
        at = named(self.unknowns, starts(self.unknowns))
        instants = model.instruments.instants(model.times, at).value
        late = model.instruments.numbers(model.instruments.delays, at).value
        columns = zip(self.data.values.T, (instants + late).T, strict=True)
        values = np.column_stack([_interpolated(column, own, model.times) for column, own in columns])
        data = replace(self.data, values=values, clean=None)
        return replace(
            self, model=model.at_record_clock(), data=data, recorded=None, colour=None, resampled=True
        )

    @property
    def may_idle(self) -> bool:
        """True if parameters may have no influence: drifts of channels that are interpolated."""
        return self.resampled or super().may_idle

    @property
    def known(self) -> NDArray[np.bool_]:
        """Mask of values of channels at which every input is known (times x channels)."""
        known = self.model.instruments.present(len(self.data.values))
        if self.left_out.of_channels:
            before, after = np.array(self.left_out.of_channels).T
            rows = np.arange(len(known))[:, None]
            known &= (rows >= before) & (rows < self.sample_counts - after)
        return known

    def within_inputs(self, eta: Array) -> NDArray[np.bool_]:
        """Return the mask of the record's times at which every input is known (times)."""
        first, last = known_span(self.model, eta)
        times, rounding = self.model.times, SAMPLE_TIME_TOL * self.sampling_step
        return np.asarray((times >= first - rounding) & (times <= last + rounding))

    @property
    def sample_counts(self) -> NDArray[np.int_]:
        """Number of samples of each channel by its clock, present or missing (channels)."""
        return np.asarray(self.model.instruments.present(len(self.data.values)).sum(axis=0))

    @cached_property
    def channel_steps(self) -> Array:
        """Sampling steps of the channels (channels), s."""
        clocks = self.model.instruments.clocks
        return np.array([self.sampling_step if clock is None else clock.step for clock in clocks])

    def channel_times(self, eta: Array) -> Array:
        """Return the times of the channels' samples by their clocks (times x channels), s, NaN without one.

        They are at the record's time, from its first sample on, less the delays.
        """
        model = self.model
        times = model.instruments.instants(model.times, named(self.unknowns, eta)).value
        return np.where(model.instruments.present(len(times)), times - model.times[0], np.nan)

    @property
    def full_data(self) -> RecordData:
        """The record with all its samples."""
        return self.data if self.recorded is None else self.recorded

    @property
    def times(self) -> Array:
        """Times of the samples, s, from the first one of the record on."""
        first = self.left_out.before
        return np.asarray((first + np.arange(len(self.data.values))) * self.sampling_step)

    @property
    def channels(self) -> Sequence[Channel]:
        """The channels."""
        return self.model.channels

    @property
    def conditions(self) -> Experiment:
        """Loads and measurement, which have to be known."""
        assert self.experiment is not None
        return self.experiment

    @property
    def sampling_step(self) -> float:
        """Sampling step, s."""
        return self.conditions.measurement.step

    @property
    def notes(self) -> tuple[str, ...]:
        """Warnings of how it was read."""
        return () if self.experiment is None else self.experiment.measurement.notes

    @property
    def mean_is_offset(self) -> bool:
        """True unless the record was detrended: that takes the mean of the motion, too."""
        return not any(step.startswith("detrend") for step in self.conditions.measurement.prepared)

    def row_label(self, row: int) -> str:
        """Return the time of a sample."""
        return f"{self.times[row]:.5g} s"

    def unexplained(self, fit: RecordFit, column: int) -> tuple[float, Array]:
        """Return the raw residual of a channel over its signal (RMS), and that residual (times x 1)."""
        residual = self._raw_residual(fit, column)
        recorded = self.data.recorded[:, [column]]
        ratio = float(root_mean_square(residual)[0] / root_mean_square(recorded)[0])
        return ratio, residual if self.colour is None else self.channel_series(fit.residual, column)

    def residual_peak(self, fit: RecordFit, column: int) -> float:
        """Return the frequency, rad/s, at which the residual of a channel is strongest."""
        omega, density = spectrum(self._raw_residual(fit, column), float(self.channel_steps[column]))
        return float(omega[int(np.argmax(density[:, 0]))])

    def _raw_residual(self, fit: RecordFit, column: int) -> Array:
        return np.asarray((self.data.recorded - fit.predicted.outputs)[:, [column]])

    @cached_property
    def root(self) -> Array:
        """Lower root of the wide prior covariance of the state (n x n)."""
        return np.asarray(_PRIOR_WIDTH * (self.data.rms / self.model.reach).max() * self.model.state_root)

    @property
    def system_model(self) -> LinearSystem:
        """The model with the loads and channels of the record."""
        return self.model.system

    @property
    def nuisances(self) -> int:
        """Number of physical states, whose initial values are unknown."""
        return self.model.states

    @property
    def evaluation_work(self) -> int:
        """Multiplications of a prediction with its sensitivities, about."""
        n = len(self.system_model.states)
        if self.system_model.delayed:
            return _DELAYED_WORK * len(self.times)
        return (len(self.times) + _TRANSITION_WORK * n) * n**2 * (1 + len(self.unknowns))

    def fit(self, eta: Array, values: Array, noise: Array | None = None) -> RecordFit:
        """Fit the initial state to `values` (times x channels) at coordinates of the parameters.

        Channels are weighted by `noise`, their standard deviations (channels); absent: by their RMS.
        """
        model = self.model
        self.system_model.evaluations += 1
        predicted: Prediction | None = None
        if (decays := self.decays(eta)) is not None:
            at = kernels.steps_at(model, eta)
            x0, _ = self._started(decays, at, values, noise)
            trajectory, residual, triangles = fit_from(model, at, decays, x0, values)
            triangles /= self.data.rms[:, None, None]
            counts = np.full(len(triangles), len(values))
        elif self._fitted_in_blocks:
            kept = values.size * model.states <= _MAX_KEPT_NUMBERS
            fitted = kernels.fitted(model, eta, values, self._first_state(noise), kept=kept)
            assert fitted.factors is not None
            x0, residual, triangles, counts = fitted.start, fitted.residual, fitted.factors, fitted.counts
            trajectory = Trajectory(fitted.outputs, fitted.states, x0)
            if fitted.by_state is not None and fitted.by_parameter is not None:
                predicted = Prediction(*trajectory[:2], fitted.by_parameter, fitted.by_state)
        elif self.rows_at_once() < len(values):
            trajectory, residual, triangles, counts = self._fit_in_blocks(eta, values, noise)
        else:
            free, steps = free_prediction(model, eta)
            x0 = self._start(self._rows(free, values)[0], noise)
            predicted = prediction(model, eta, x0, free, steps)
            residual = values - predicted.outputs
            triangles, counts = self.triangles(residual, predicted.by_state, predicted.by_parameter)
            trajectory = Trajectory(predicted.outputs, predicted.states, x0)
        self._last.clear()
        if predicted is not None and predicted.by_state.size <= _MAX_KEPT_NUMBERS:
            self._last[eta.tobytes() + x0.tobytes()] = predicted
        size = np.sqrt(np.einsum("cr,cr->c", triangles[..., -1], triangles[..., -1]) / counts) * self.data.rms
        level = self.noise_in(counts, size)
        return RecordFit(eta, trajectory, residual, counts, size, level, triangles, measured=values)

    def _fit_in_blocks(
        self, eta: Array, values: Array, noise: Array | None
    ) -> tuple[Trajectory, Array, Array, NDArray[np.int_]]:
        """Return trajectory, residuals, triangles and counts of a fit, in blocks of samples."""
        at = kernels.steps_at(self.model, eta)
        x0 = self._start(self._start_rows(at, values)[0], noise)
        outputs, states = np.empty(values.shape), np.empty((len(values), self.model.states))

        def blocks() -> Iterator[tuple[Array, Array, Array]]:
            predicted = prediction_blocks(self.model, at, x0, self.rows_at_once())
            for samples, *parts, by_parameter, by_state in predicted:
                outputs[samples], states[samples] = parts
                yield values[samples] - outputs[samples], by_state, by_parameter

        triangles, counts = self.triangles_of(blocks(), ~np.isnan(values))
        return Trajectory(outputs, states, x0), values - outputs, triangles, counts

    def _start_rows(self, at: kernels.Linear, values: Array) -> tuple[Array, NDArray[np.int_]]:
        """Return what `_rows` does, in blocks of samples."""
        blocks = free_blocks(self.model, at, self.rows_at_once())
        rows = (
            (values[samples] - (forced + by_state @ self.model.initial), by_state, by_state[..., :0])
            for samples, forced, by_state in blocks
        )
        return self.triangles_of(rows, ~np.isnan(values))

    def rows_at_once(self, beside: int = 0) -> int:
        """Return the number of samples whose sensitivities, and so many numbers beside, are held at once.

        All where they are few, or are not predicted in blocks.
        """
        samples, channels = map(int, self.data.values.shape)
        few = samples * channels * self.nuisances <= _MAX_KEPT_NUMBERS
        if few or not (self._predicted_in_blocks and self.superposes):
            return samples
        numbers = channels * (self.nuisances + self.model.parameters + beside)
        rows = _MAX_BLOCK_NUMBERS // (_BLOCK_COPIES * numbers) // _ROWS_MULTIPLE * _ROWS_MULTIPLE
        return min(samples, max(_ROWS_MULTIPLE, rows))

    def decays(self, eta: Array) -> FreeDecays | None:
        """Return the decays that all channels share; None where there are missing values, or few of all."""
        if not (are_many(self.model) and self._fitted_in_blocks and self.superposes):
            return None
        if np.isnan(self.data.values).any():
            return None
        return free_decays(self.model, eta)

    def _started(
        self, decays: FreeDecays, at: kernels.Linear, values: Array, noise: Array | None
    ) -> tuple[Array, Array]:
        """Return the first state, and what `values` have beside the prediction from it."""
        left, rows = first_state_rows(self.model, at, decays, values)
        start = self._start(rows / self.data.rms[:, None, None], noise)
        return start, left - decays.columns @ (decays.weights @ (start - self.model.initial)).T

    @property
    def _fitted_in_blocks(self) -> bool:
        """True if the compiled fit does all: of white noise, at times that do not move."""
        return self.colour is None and self._predicted_in_blocks

    @property
    def _predicted_in_blocks(self) -> bool:
        """True if predictions are compiled, at times that do not move."""
        moving = self.model.sampling is not None or self.model.instruments.unknown_delays  # or clocks
        return not moving and kernels_used(self.model)

    def _first_state(self, noise: Array | None) -> kernels.FirstState:
        """Return how the first state is fitted, channels weighted by `noise` (channels) or their RMS."""
        rms = self.data.rms
        weights = np.ones(len(rms)) if noise is None else rms / noise
        return kernels.FirstState(rms, weights, self.root, STATE_RANK)

    def check_whole(self) -> None:
        """Refuse the record (UsageError) if the sensitivities of all samples and channels are too many."""
        samples, channels = self.data.values.shape
        check_sensitivities(samples, channels, self.nuisances)

    def channel_blocks(self, beside: int = 0, *, shared: bool = False) -> list[slice]:
        """Return the channels whose sensitivities are held at once; all where they depend on each other.

        `beside`: number of further columns of each; `shared`: decays are, derivatives by the state not held.
        """
        channels = len(self.data.rms)
        size = channels
        if self._predicted_in_blocks and self.superposes:
            columns = self.model.parameters + beside + (0 if shared else self.nuisances)
            limit = _MAX_SHARED_NUMBERS if shared else _MAX_BLOCK_NUMBERS
            size = max(1, limit // (len(self.data.values) * columns))
        return [slice(first, min(first + size, channels)) for first in range(0, channels, size)]

    def predicted(self, fit: RecordFit, channels: slice = ALL_CHANNELS) -> Prediction:
        """Return the prediction of channels with all sensitivities: that of the fit itself, if kept."""
        key = fit.eta.tobytes() + fit.predicted.start.tobytes()
        if key not in self._last:
            return self.prediction_from(fit.eta, fit.predicted.start, self.model, channels)
        return self._last[key].of(channels)

    def with_model(self, model: ParametricModel) -> Self:
        """Return the likelihood of the same record with another model of the same states."""
        return replace(self, model=model)

    def prediction_from(
        self,
        eta: Array,
        start: Array,
        model: ParametricModel,
        channels: slice = ALL_CHANNELS,
        *,
        by_state: bool = True,
    ) -> Prediction:
        """Return the prediction of channels at coordinates `eta` from a start in the units of a model.

        `by_state`: False: derivatives by the first state may be left out.
        """
        start = start * (model.scale / self.model.scale)
        if (decays := self.decays(eta)) is not None:
            predicted = sensitive(self.model, eta, start, channels)
            if not by_state:
                return predicted
            return predicted._replace(by_state=np.moveaxis(decays.columns @ decays.weights[channels], 0, 1))
        free, steps = free_prediction(self.model, eta, channels)
        return prediction(self.model, eta, start, free, steps)

    def state_slopes(self, fit: RecordFit) -> Array | None:
        """Return the derivatives of the states (times x n, scaled) by first states and coordinates (… x q).

        None where they follow from the transition matrices.
        """
        if not self.system_model.delayed:
            return None
        from dynid.identification.systems.delayed_prediction import delayed_state_slopes

        return delayed_state_slopes(self.model.moved(fit.eta), fit.eta, fit.predicted.start)

    # Noise model.

    @property
    def requested_noise(self) -> ColouredNoise | None:
        """The coloured noise that is to be estimated; None: white noise is assumed."""
        noise = None if self.experiment is None else self.experiment.measurement.noise
        return noise if isinstance(noise, ColouredNoise) else None

    @property
    def modelled(self) -> bool:
        """True if the noise is coloured and to be estimated together with the parameters."""
        return self.requested_noise is not None

    @property
    def noise_remedy(self) -> str:
        """The remedy of coloured residuals, where white noise was assumed of unfiltered samples."""
        if self.modelled or self.data.passed != 1 or self.data.robust is not None:
            return ""
        return "; if the model is right, state noise: {kind: coloured, order: auto} in the measurement"

    def renewed(self, fit: RecordFit, root_of_parameters: Array, *, settling: bool = False) -> Self:
        """Return the likelihood with the autoregression of the noise, given a fit.

        The noise is the residual plus the error of the prediction, which has the covariance of initial state
        and parameters: without it the noise would be underestimated where the model fits best, near
        resonances. Repeated, this is the EM algorithm of restricted maximum likelihood (N. M. Laird, J. H.
        Ware, Biometrics 38 (1982) 963–974).
        """
        requested = self.requested_noise
        if requested is None:
            return self
        if not self._predicted_in_blocks:
            self.check_whole()
        root = initial_root(
            self, fit, np.maximum(fit.noise, np.finfo(float).eps * self.data.rms), root_of_parameters
        )
        orders = self.colour.orders if settling and self.colour is not None else None

        def errors_by_channel() -> Iterator[Array]:
            for _, predicted in self.channelwise(fit):
                yield np.concatenate([predicted.by_state, predicted.by_parameter], axis=2)[:, 0] @ root

        def errors_by_samples() -> Iterator[Array]:
            for block in self.blocks(fit.eta, fit.predicted.start, self.model, self.rows_at_once()):
                yield np.concatenate([block.by_state, block.by_parameter], axis=2) @ root

        colour = estimated(fit.residual, errors_by_channel(), requested, orders, errors_by_samples)
        return replace(self, colour=colour)

    def with_noise_of(self, record: Any) -> Self:
        """Return the likelihood with samples and autoregression of another one of the same record."""
        return replace(self.leaving_out(record.left_out), data=record.data, colour=record.colour)

    def continuing(self, record: Any) -> Self:
        """Return the likelihood of the samples of another one of the same record."""
        return self.leaving_out(record.left_out)

    def ideal(self) -> Self:
        """Return the likelihood without noise, as far as that is known, with the true colour."""
        noiseless = self.on(self.data.without_noise())
        return noiseless if self.data.clean is None else replace(noiseless, colour=self.data.colour)

    def level(self, estimated: Array, *, ideal: bool) -> Array:
        """Return the true deviations of the noise (of its innovations) where known, else estimated ones."""
        if self.data.noise is None or (not ideal and (self.colour or self.data.colour)):
            return estimated
        return self.data.noise * (1.0 if self.data.colour is None else self.data.colour.shares)

    def log_determinant(self) -> float:
        """Return half the logarithm of the determinant of the covariance, in units of the innovations."""
        return 0.0 if self.colour is None else self.colour.log_determinant(~np.isnan(self.data.values))

    def residual_rms_at(self, eta: Array) -> Array:
        """Return the RMS of the residuals, whitened, at these coordinates (channels)."""
        if self._fitted_in_blocks:
            size: Array = self._sizes(eta[None])[0]
            return root_mean_square(self.residual(eta)) if np.isnan(size).any() else size
        self.system_model.evaluations += 1
        if self.rows_at_once() < len(self.data.values):
            rows, counts = self._start_rows(kernels.steps_at(self.model, eta), self.data.values)
        else:
            rows, counts = self._rows(free_prediction(self.model, eta)[0], self.data.values)
        left = rows[..., -1] - rows[..., :-1] @ (self._start(rows, None) - self.model.initial)
        return np.asarray(np.sqrt(np.einsum("cr,cr->c", left, left) / counts) * self.data.rms)

    def residual_rms_of(self, etas: Array) -> Array:
        """Return the RMS of the residuals at coordinates (count x p), NaN without a prediction."""
        sizes = self._sizes(etas)
        if (missed := np.isnan(sizes).any(axis=1)).any():
            sizes[missed] = super().residual_rms_of(etas[missed])
        return sizes

    def _sizes(self, etas: Array) -> Array:
        """Return the RMS of the residuals (count x channels) by one call, NaN where that is not possible."""
        together = self.superposes and self.model.affine is not None and self._fitted_in_blocks
        if not together or are_many(self.model) or not compiled("dynid_sizes"):
            return np.full((len(etas), len(self.data.rms)), np.nan)
        self.system_model.evaluations += len(etas)
        return kernels.residual_rms(self.model, etas, self.data.values, self._first_state(None))

    def unwhitened_rms(self, fit: RecordFit) -> Array:
        """Return the RMS of the residuals (channels), not whitened."""
        return fit.size if self.colour is None else root_mean_square(fit.residual)

    def scatter(self, counts: NDArray[np.int_], size: Array) -> Array:
        """Return the RMS of residuals, corrected for the number of fitted values, coefficients included."""
        if self.colour is not None:
            counts = counts - np.minimum(self.colour.orders, counts - 1)
            size = size * np.sqrt((counts + self.colour.orders) / counts)
        return super().scatter(counts, size)

    @property
    def noise_orders(self) -> NDArray[np.int_]:
        """Number of estimated coefficients of the noise (channels)."""
        return super().noise_orders if self.colour is None else self.colour.orders

    @property
    def noise_coefficients(self) -> int:
        """Number of estimated coefficients and correlations of the noise."""
        mixed = self.colour is not None and self.colour.mixing is not None
        pairs = len(self.data.rms) * (len(self.data.rms) - 1) // 2
        return int(self.noise_orders.sum()) + pairs * mixed

    def series(self, residual: Array) -> Array:
        """Return residuals (times x channels), whitened where the noise is coloured."""
        if self.colour is None:
            return residual
        present = ~np.isnan(residual)
        white = self.colour.whitened(np.nan_to_num(residual)[..., None], present)[..., 0]
        return np.where(present, white, np.nan)

    def residual(self, eta: Array) -> Array:
        """Return the residual of the fit at coordinates `eta` (times x channels), NaN where missing."""
        self.system_model.evaluations += 1
        if (decays := self.decays(eta)) is not None:
            return self._started(decays, kernels.steps_at(self.model, eta), self.data.values, None)[1]
        if self._fitted_in_blocks:
            first = self._first_state(None)
            return kernels.fitted(self.model, eta, self.data.values, first, factors=False).residual
        if self.rows_at_once() < len(self.data.values):
            at = kernels.steps_at(self.model, eta)
            x0 = self._start(self._start_rows(at, self.data.values)[0], None)
            C, direct = self.model.output(eta)[0], self.model.direct(eta).value
            return np.asarray(self.data.values - kernels.outputs_from(self.model, at, C, direct, x0))
        free, _ = free_prediction(self.model, eta)
        x0 = self._start(self._rows(free, self.data.values)[0], None)
        return np.asarray(self.data.values - free.forced - free.by_state @ x0)

    def _rows(self, free: Free, values: Array) -> tuple[Array, NDArray[np.int_]]:
        """Return triangles of the derivatives by the initial state and of what `values` have beside it."""
        forced = free.forced + free.by_state @ self.model.initial
        return self.triangles(values - forced, free.by_state, free.by_state[..., :0])

    def _start(self, rows: Array, noise: Array | None) -> Array:
        """Return the initial state (n) by triangles (channels x n + 1 x n + 1), as of `fit`."""
        if noise is not None:
            rows = rows * (self.data.rms / noise)[:, None, None]
        matrix = (rows[..., :-1] @ self.root).reshape(-1, len(self.root))
        # Rank-revealing: initial states that are not observable stay at zero.
        shift = least_squares(matrix, rows[..., -1].ravel(), STATE_RANK)
        return np.asarray(self.model.initial + self.root @ shift)

    def slopes(self, fit: RecordFit, noise: Array) -> Array:
        """Return few rows with the same products as the derivatives by the coordinates over noise (… x p)."""
        n, p = self.nuisances, self.model.parameters
        return self.rows(fit, noise)[:, n : n + p]

    def by_start(self, fit: RecordFit, noise: Array) -> Array:
        """Return the derivatives by the first state in units of its prior (… x n), rows as of `slopes`."""
        return np.asarray(self.rows(fit, noise)[:, : self.nuisances] @ self.root)

    def nuisance_degrees(self, fit: RecordFit, noise: Array) -> Array:
        """Return the degrees of freedom that the initial state takes from each channel (channels)."""
        rows = self.by_start(fit, noise)
        U, s, _ = thin_svd(rows)
        U = U[:, : len(s)][:, s > STATE_RANK * s.max(initial=0.0)]
        return np.asarray(np.sum(U**2, axis=1).reshape(len(noise), -1).sum(axis=1))

    def by_row(self, level: NDArray[Any]) -> NDArray[Any]:
        """Return numbers of channels (channels) row by row as the triangles stand."""
        return np.repeat(level, self.nuisances + self.model.parameters + 1)

    def on(self, data: RecordData) -> Self:
        """Return the likelihood of other values of the same record."""
        return replace(self, data=data)

    def information(self, fit: RecordFit, noise: Array) -> Information:
        """Return the information on the parameters of a fit, for a noise of this deviation (channels)."""
        n, p = self.nuisances, self.model.parameters
        rows = self.rows(fit, noise)
        names = tuple(unknown.name for unknown in self.model.unknowns)
        present = ~np.isnan(fit.residual)
        outputs = fit.predicted.outputs
        if self.colour is not None:
            outputs = self.series(np.where(present, outputs, np.nan))
        signal = float(np.linalg.norm(np.where(present, outputs, 0.0) / noise))
        count = int(np.count_nonzero(present))
        at = values(self.unknowns, fit.eta), rates(self.unknowns, fit.eta)
        return information(names, rows[:, n : n + p], rows[:, :n] @ self.root, signal, count, *at)

    def channelwise(self, fit: RecordFit, *, by_state: bool = True) -> Iterator[tuple[int, Prediction]]:
        """Yield the channels with their predictions, as many at once as memory allows.

        `by_state`: False: derivatives by the first state are left out where they are shared.
        """
        start, decays = fit.predicted.start, self.decays(fit.eta)
        for block in self.channel_blocks(shared=decays is not None):
            if decays is None:
                predicted = self.predicted(fit, block)
            else:
                predicted = sensitive(self.model, fit.eta, start, block)
            for k, c in enumerate(range(block.start, block.stop)):
                channel = predicted.of(slice(k, k + 1))
                if decays is not None and by_state:
                    channel = channel._replace(by_state=decays.by_state(c)[:, None])
                yield c, channel

    def blocks(
        self, eta: Array, start: Array, model: ParametricModel, rows: int, *, by_state: bool = True
    ) -> Iterator[PredictionBlock]:
        """Yield what `prediction_from` returns, so many samples (`rows_at_once`) after the other."""
        samples = len(self.data.values)
        if rows < samples:
            at, scaled = kernels.steps_at(self.model, eta), start * (model.scale / self.model.scale)
            yield from prediction_blocks(self.model, at, scaled, rows, by_state=by_state)
            return
        whole = self._last.get(eta.tobytes() + start.tobytes())
        whole = whole or self.prediction_from(eta, start, model, by_state=by_state)
        yield PredictionBlock(slice(0, samples), *whole)

    def coordinates(self, fit: RecordFit) -> list[SaturatedCoordinates]:
        """Return the channels, in units of their RMS, in directions of their saturated models."""
        return coordinates(self, fit)

    def weighted(self, fit: RecordFit, noise: Array) -> Array:
        """Return the residuals over noise, row by row as the information has them."""
        return self.rows(fit, noise)[:, -1]

    def rows(self, fit: RecordFit, noise: Array) -> Array:
        """Return derivatives by first state and coordinates, and residuals, over noise (… x n + p + 1)."""
        assert fit.triangles is not None
        rows = fit.triangles * (self.data.rms / noise)[:, None, None]
        return rows.reshape(-1, rows.shape[-1])

    def triangles(
        self, residual: Array, by_state: Array, by_parameter: Array, channels: slice = ALL_CHANNELS
    ) -> tuple[Array, NDArray[np.int_]]:
        """Return the triangles (channels x w x w) of derivatives and residuals, and counts of the latter.

        `channels`: those that the columns are of; where the noise is coloured, all.
        """
        return self.triangles_of([(residual, by_state, by_parameter)], ~np.isnan(residual), channels)

    def triangles_of(
        self,
        blocks: Iterable[tuple[Array, Array, Array]],
        present: NDArray[np.bool_],
        channels: slice = ALL_CHANNELS,
    ) -> tuple[Array, NDArray[np.int_]]:
        """Return what `triangles` does, of blocks of samples one after the other.

        `blocks`: residuals, and derivatives by state and parameters; `present`: mask of all residuals.
        """
        rms = self.data.rms[channels]
        white = None if self.colour is None else Whitening(self.colour, present)
        columns = (_whitened(white, *block) for block in blocks)
        if not kernels_used(self.model):  # all at once
            by_state, by_parameter, residual = next(columns)
            rows = np.concatenate([by_state, by_parameter, residual[..., None]], axis=2)
            rows /= rms[:, None]
            rows[np.isnan(residual)] = 0.0
            return triangular_factors(rows), np.count_nonzero(present, axis=0)
        factors = kernels.Triangles()
        for block in columns:
            factors.absorb(*block)
        return factors.over(rms), factors.counts


def _whitened(
    white: Whitening | None, residual: Array, by_state: Array, by_parameter: Array
) -> tuple[Array, Array, Array]:
    """Return derivatives and residuals of a block of samples, whitened if the noise is coloured."""
    if white is None:
        return by_state, by_parameter, residual
    n = by_state.shape[2]
    both = np.concatenate([by_state, by_parameter, np.nan_to_num(residual)[..., None]], axis=2)
    both = white.following(both)
    return both[..., :n], both[..., n:-1], np.where(np.isnan(residual), np.nan, both[..., -1])


@dataclass(frozen=True, eq=False)
class TimeLikelihood(Likelihood):
    """Records of time that share their parameters."""

    records: tuple[TimeRecord, ...]  # one or more, all with the same unknowns

    def at_record_clock(self) -> Self:
        """Return the likelihood of records whose channels all have the clock of their record."""
        records = tuple(record.at_record_clock() for record in self.records)
        same = all(new is old for new, old in zip(records, self.records, strict=True))
        return self if same else replace(self, records=records, noiseless=None)

    def shortened(self, eta: Array) -> Self:
        """Return the likelihood of the first parts of records whose channels share decays at coordinates (p).

        Itself where not all do.
        """
        if any(record.decays(eta) is None for record in self.records):
            return self
        parts = tuple(record.first_part(_FIRST_PART) for record in self.records)
        return replace(self, records=parts, noiseless=None)

    @property
    def most_evaluations(self) -> float:
        """Most evaluations that a search may take, from the work of one."""
        work = sum(record.evaluation_work for record in self.records)
        return max(_MIN_RECORD_EVALUATIONS, RECORD_SEARCH_WORK.value // max(1, work))


def _interpolated(values: Array, at: Array, times: Array) -> Array:
    """Return values at even instants, NaN where missing, by a spline at times; NaN outside of them."""
    there = np.flatnonzero(~np.isnan(values))
    first, last = int(there[0]), int(there[-1])
    filled = np.interp(np.arange(first, last + 1), there, values[there])
    inside = (times >= at[first]) & (times <= at[last])
    out = np.full(len(times), np.nan)
    if last > first:
        signal = Sampled(filled, float(at[last] - at[first]) / (last - first), "spline", float(at[first]))
        out[inside] = signal.value(times[inside])
    return out
