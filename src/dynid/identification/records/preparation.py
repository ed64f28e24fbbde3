"""Preparation of measured records by named steps: detrending, band-pass, decimation.

A filter that treats outputs and inputs alike leaves the linear relation between them unchanged, as far from
the ends of the record as its response reaches; so the ends are cut off. Between them, the filtered state
follows the same equations of motion, with free vibration and an unknown initial state as before.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array
from dynid.errors import UsageError
from dynid.identification.records.measurement import Experiment, Simulation, sampled_loads
from dynid.identification.records.noise import ColouredNoise
from dynid.lti.signals import Chirp, Impact, Impulse, Multisine, Sampled, Step
from dynid.structure.ports import Load

# Remainder of a filter's response where the ends of a record are cut off.
_FILTER_REMAINDER = 1e-5
# Cut-off of the anti-alias filter as a part of the new Nyquist frequency, its ripple in dB and its order
# (as scipy.signal.decimate has them; it passes twice).
_CUTOFF, _RIPPLE, _ALIAS_ORDER = 0.8, 0.05, 8
# A detrended channel below this part of what it was is rounding.
_DETREND_FLOOR = 1e-13
# Frequencies up to Nyquist's at which the gain of the filters is averaged.
_BINS = 20_001


Design = tuple[NDArray[Any], NDArray[Any], float]
"""Zeros, poles and gain of a digital filter."""


class Samples(NamedTuple):
    """Columns of samples at `step`, s, the first at `start`; only every `stride`-th is kept in the end."""

    values: Array
    step: float
    start: float
    stride: int = 1


@dataclass(frozen=True)
class Detrend:
    """Subtract the mean (`degree` 0) or the straight line (1) of least squares; samples may be missing."""

    degree: int

    name: ClassVar[str] = "detrend"
    refused: ClassVar[tuple[type, ...]] = (Step,)

    @property
    def description(self) -> str:
        """Description of the step."""
        return f"detrend {('constant', 'linear')[self.degree]}"

    def apply(self, samples: Samples) -> Samples:
        """Return the samples about their trend."""
        basis = np.vander(np.linspace(-1, 1, len(samples.values)), self.degree + 1)
        left = samples.values.copy()
        for k, column in enumerate(samples.values.T):
            there = ~np.isnan(column)
            trend = basis @ np.linalg.lstsq(basis[there], column[there], rcond=None)[0]
            rounding = _DETREND_FLOOR * np.abs(column[there]).max(initial=0.0)
            only_trend = np.abs(column - trend)[there].max(initial=0.0) <= rounding
            left[there, k] = 0.0 if only_trend else (column - trend)[there]
        return samples._replace(values=left)

    def gain(self, omega: Array, samples: Samples) -> Array:  # noqa: ARG002
        """Return ones: sines have no trend."""
        return np.ones(len(omega))


class _Filter(ABC):
    """A zero-phase filter, applied forwards and backwards: its gain is that of one run, squared."""

    refused: ClassVar[tuple[type, ...]] = (Step, Impulse, Impact)

    @abstractmethod
    def design(self, samples: Samples) -> Design:
        """Return zeros, poles and gain of one run."""

    def apply(self, samples: Samples) -> Samples:
        """Return the filtered samples, without the ends that its response reaches."""
        from scipy.signal import sosfiltfilt, zpk2sos  # heavy import, needed here only

        z, p, k = self.design(samples)
        n, radius = len(samples.values), float(np.abs(p).max())
        reach = math.ceil(math.log(_FILTER_REMAINDER) / math.log(radius)) if radius < 1 else n
        if n - 2 * reach < 2:
            raise UsageError(
                f"the filter's response reaches {reach * samples.step:.3g} s, and the record lasts "
                f"{n * samples.step:.3g} s: nothing is left of it",
                remedy="Widen the band, decimate less, or take a longer record.",
            )
        values = sosfiltfilt(zpk2sos(z, p, k), samples.values, axis=0, padlen=reach)
        start = samples.start + reach * samples.step
        return samples._replace(values=values[reach : n - reach], start=start)

    def gain(self, omega: Array, samples: Samples) -> Array:
        """Return the gain on sines."""
        z, p, k = self.design(samples)
        around = np.exp(1j * omega * samples.step)[:, None]
        return np.asarray(np.abs(k * np.prod(around - z, axis=1) / np.prod(around - p, axis=1)) ** 2)


@dataclass(frozen=True)
class BandPass(_Filter):
    """Zero-phase Butterworth filter of this `order` that passes the band from `low` to `high` (rad/s).

    Without a low end (0) it is a low-pass.
    """

    low: float
    high: float
    order: int = 2

    name: ClassVar[str] = "band_pass"

    @property
    def description(self) -> str:
        """Description of the step."""
        return f"band-pass {self.low:.5g} … {self.high:.5g} rad/s"

    def design(self, samples: Samples) -> Design:
        """Return zeros, poles and gain of one run."""
        from scipy.signal import butter  # heavy import, needed here only

        nyquist = math.pi / samples.step
        kept = nyquist / samples.stride
        if not self.high < kept:
            raise UsageError(
                f"the band ends at {self.high:.5g} rad/s, but at this sampling nothing is known from "
                f"{kept:.5g} rad/s ({kept / (2 * math.pi):.5g} Hz) on",
                remedy="End it below, or leave the filter out.",
            )
        edges = self.high / nyquist if self.low == 0 else [self.low / nyquist, self.high / nyquist]
        filter_design: Design = butter(
            self.order, edges, "lowpass" if self.low == 0 else "bandpass", output="zpk"
        )
        if not np.abs(filter_design[1]).max() < 1:  # poles at z = 1 in double precision: no gain at rest
            raise UsageError(
                f"the band begins at {self.low:.3g} rad/s, too low for this sampling: poles at z = 1",
                remedy="Begin it at 0, which is a low-pass, or higher.",
            )
        return filter_design


@dataclass(frozen=True)
class Decimate(_Filter):
    """Keep every `factor`-th sample, after a zero-phase anti-alias filter (Chebyshev).

    Inputs known by samples are filtered alike, but keep their samples: a response to them is exact as before.
    """

    factor: int

    name: ClassVar[str] = "decimate"

    @property
    def description(self) -> str:
        """Description of the step."""
        return f"decimate {self.factor}"

    def design(self, samples: Samples) -> Design:
        """Return zeros, poles and gain of one run."""
        from scipy.signal import cheby1  # heavy import, needed here only

        cutoff = _CUTOFF / (samples.stride * self.factor)
        filter_design: Design = cheby1(_ALIAS_ORDER, _RIPPLE, cutoff, output="zpk")
        return filter_design

    def apply(self, samples: Samples) -> Samples:
        """Return the filtered samples, of which fewer are kept."""
        return super().apply(samples)._replace(stride=samples.stride * self.factor)


Preparation: TypeAlias = Detrend | BandPass | Decimate
"""One step: its key in scenes, `name`, and the signals that it cannot be applied to, `refused`."""


def prepare(experiment: Experiment, steps: Sequence[Preparation]) -> Experiment:
    """Return a measured record, and what drove it, prepared by the steps in their order.

    Parameters
    ----------
    experiment
        The record. A noise that is given is that of its samples as they come.
    steps
        `Detrend`, `BandPass`, `Decimate`.

    Returns
    -------
    Experiment
        The record, shorter by the reach of the filters at both ends. Sines are scaled by the filters' gain
        and keep their continuous form; what is known by samples, and sweeps, are filtered as the channels
        are. Detrending leaves sines and transients as they are. `Measurement.prepared` names the steps.

    Raises
    ------
    UsageError
        Where a step makes no sense for the record; it names the step, ``prepare.<k>.<name>``.

    Notes
    -----
    A filter colours white noise. A given noise is passed on as its density in the pass band, for which error
    bars are valid; one that is estimated from the residuals is taken for white noise of which the filters
    pass the part `Measurement.passed`.
    """
    measured = experiment.measurement
    if not steps:
        return experiment
    if isinstance(measured.source, Simulation):
        raise UsageError("a simulated record needs no preparation", names=("prepare",))
    if isinstance(measured.noise, ColouredNoise) and any(isinstance(step, _Filter) for step in steps):
        raise UsageError(
            "coloured noise is that of the samples as they were recorded, which a filter changes",
            remedy="Leave the filters out: the model of the noise weights frequencies by itself.",
            names=("prepare",),
        )
    channels = len(measured.channels)
    loads = sampled_loads(experiment.loads, measured.record)
    for k, load in enumerate(loads):  # sweeps as samples, and samples at those of the record
        if isinstance(signal := load.signal, Sampled | Chirp):
            hold, sampled = getattr(signal, "hold", "spline"), signal.value(measured.record.times)
            loads[k] = load._replace(signal=Sampled(sampled, measured.step, hold, measured.record.start))
    inputs = [load.signal for load in loads if isinstance(load.signal, Sampled)]
    values = np.column_stack([np.asarray(measured.source), *(signal.values for signal in inputs)])
    samples = Samples(values, measured.step, measured.record.start)
    omega = np.linspace(0, math.pi / measured.step, _BINS)
    power = np.ones(len(omega))
    for index, step in enumerate(steps):
        try:
            loads = [_scaled(load, step, samples) for load in loads]
            missing = np.isnan(samples.values).sum(axis=0)
            if missing.any() and not isinstance(step, Detrend):
                channel = measured.channels[int(np.flatnonzero(missing)[0])]
                raise UsageError(
                    f"{channel.name} has {int(missing.max())} missing samples, which a filter would spread",
                    remedy="Fill the gaps, take a stretch without any, or leave the filter out.",
                )
            power *= step.gain(omega, samples) ** 2
            samples = step.apply(samples)
        except UsageError as error:
            name = f"prepare.{index}.{step.name}"
            raise UsageError(error.problem, remedy=error.remedy, names=(name,)) from error
    columns = iter(samples.values[:, channels:].T)
    for k, load in enumerate(loads):
        if isinstance(load.signal, Sampled):
            signal = Sampled(next(columns), samples.step, load.signal.hold, samples.start)
            loads[k] = load._replace(signal=signal)
    kept = samples.values[:: samples.stride, :channels]
    measurement = replace(
        measured,
        step=measured.step * samples.stride,
        samples=len(kept),
        source=kept,
        # The density of white noise in the band that is kept, per sample.
        noise=measured.noise
        if measured.given_noise is None
        else list(measured.given_noise / math.sqrt(samples.stride)),
        start=samples.start,
        passed=samples.stride * float(np.mean(power)),
        prepared=tuple(step.description for step in steps),
    )
    return Experiment(loads, measurement)


def _scaled(load: Load, step: Preparation, samples: Samples) -> Load:
    """Return a load with its sines scaled by the step's gain; other continuous signals are refused."""
    signal = load.signal
    if isinstance(signal, step.refused):
        raise UsageError(
            f"a signal of kind {signal.kind} does not stay one behind this step",
            remedy="Give its samples (kind: file), or leave the step out.",
        )
    if not isinstance(signal, Multisine):
        return load
    amplitude = np.asarray(signal.amplitude) * step.gain(np.asarray(signal.frequency), samples)
    return load._replace(signal=Multisine(amplitude.tolist(), signal.frequency, signal.phase))
