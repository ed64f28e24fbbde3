"""Preparation of measured records by named steps.

A filter that treats outputs and inputs alike leaves the linear relation between them true, as far from the
ends of the record as its response reaches; so the ends are cut off. Inside, the filtered state follows the
same equations of motion: free vibration and unknown initial states stay what they are.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dynid.errors import UsageError
from dynid.identification.measurement import Experiment, Measurement, Simulation, as_estimated
from dynid.identification.preparation_steps import Detrend, Preparation, Samples
from dynid.lti.signals import Chirp, Multisine, Record, Sampled, Signal
from dynid.structure.response import Load

Array = NDArray[np.float64]

# Frequencies up to Nyquist's at which the gain of the filters is averaged.
_BINS = 20_001


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
        are. Detrending leaves sines and transients as they are. `Measurement.prepared` tells the steps.

    Raises
    ------
    UsageError
        Where a step makes no sense for the record; it names the step, ``prepare.<k>.<name>``.

    Notes
    -----
    White noise comes out of a filter coloured. A noise that is given is passed on as its density in the band
    that is left, so that error bars are right there; one that is estimated from the residuals is taken for
    white noise of which the filters have left the part `Measurement.passed`.
    """
    given = experiment.measurement
    if not steps:
        return experiment
    if isinstance(given.source, Simulation):
        raise UsageError("a simulated record needs no preparation", names=("prepare",))
    channels = len(given.channels)
    loads = [
        load._replace(signal=_as_samples(load.signal, given.record))
        for load in as_estimated(experiment.loads, given.record)
    ]
    inputs = [load.signal for load in loads if isinstance(load.signal, Sampled)]
    values = np.column_stack([np.asarray(given.source), *(signal.values for signal in inputs)])
    samples = Samples(values, given.step, given.record.start)
    omega = np.linspace(0, math.pi / given.step, _BINS)
    power = np.ones(len(omega))
    for place, step in enumerate(steps):
        try:
            loads = [_scaled(load, step, samples) for load in loads]
            _check_whole(experiment, step, samples.values)
            power *= step.gain(omega, samples) ** 2
            samples = step.apply(samples)
        except UsageError as error:
            name = f"prepare.{place}.{step.name}"
            raise UsageError(error.problem, remedy=error.remedy, names=(name,)) from error
    columns = iter(samples.values[:, channels:].T)
    measurement = replace(
        _measured(given, samples),
        passed=samples.stride * float(np.mean(power)),
        prepared=tuple(step.said for step in steps),
    )
    return Experiment([_sampled(load, columns, samples) for load in loads], measurement)


def _measured(given: Measurement, samples: Samples) -> Measurement:
    """Return a measurement with the prepared samples of its channels, which stand first."""
    kept = samples.values[:: samples.stride, : len(given.channels)]
    return replace(
        given,
        step=given.step * samples.stride,
        samples=len(kept),
        source=kept,
        # Of white noise this much is left in the band that is kept, per sample.
        noise=None if given.given_noise is None else list(given.given_noise / math.sqrt(samples.stride)),
        start=samples.start,
    )


def _as_samples(signal: Signal, record: Record) -> Signal:
    """Return a signal that is known by samples, or sweeps, as its samples at those of the record."""
    if isinstance(signal, Sampled | Chirp):
        hold = getattr(signal, "hold", "spline")
        return Sampled(signal.value(record.times), record.step, hold, record.start)
    return signal


def _sampled(load: Load, columns: Iterator[Array], samples: Samples) -> Load:
    """Return a load with the next of the prepared columns, if it is known by samples."""
    if not isinstance(load.signal, Sampled):
        return load
    return load._replace(signal=Sampled(next(columns), samples.step, load.signal.hold, samples.start))


def _scaled(load: Load, step: Preparation, samples: Samples) -> Load:
    """Return a load with its sines scaled by the step's gain; what the step cannot treat is refused."""
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


def _check_whole(experiment: Experiment, step: Preparation, values: Array) -> None:
    """Refuse to filter a record with missing samples."""
    if isinstance(step, Detrend):
        return
    missing = np.isnan(values).sum(axis=0)
    if missing.any():
        channel = experiment.measurement.channels[int(np.flatnonzero(missing)[0])]
        raise UsageError(
            f"{channel.name} has {int(missing.max())} missing samples, which a filter would spread",
            remedy="Fill the gaps, take a stretch without any, or leave the filter out.",
        )
