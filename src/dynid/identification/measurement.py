"""Records: what is measured, given or simulated."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dynid.errors import NotIdentifiable, UsageError
from dynid.identification.diagnostics import root_mean_square
from dynid.lti.propagate import response
from dynid.lti.signals import Random, Record
from dynid.structure.model import StructuralModel
from dynid.structure.response import Channel, Load, ports
from dynid.structure.state_space import state_space

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Simulation:
    """How to simulate a record.

    Parameters
    ----------
    noise_ratio
        Standard deviation of the added white noise over the channel's RMS (Yang, eq 23); 0: clean.
    seed
        Seed of the noise (PCG64).
    settle
        Time from rest at t = 0 to the first sample, s.
    """

    noise_ratio: float = 0.0
    seed: int = 0
    settle: float = 0.0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.noise_ratio) and self.noise_ratio >= 0):
            raise UsageError("the noise ratio must be finite and not negative", names=("noise_ratio",))
        if not (math.isfinite(self.settle) and self.settle >= 0):
            raise UsageError("the settling time must be finite and not negative", names=("settle",))
        if self.seed < 0:
            raise UsageError("a seed must not be negative", names=("seed",))


@dataclass(frozen=True, eq=False)
class Measurement:
    """What is measured, when, and where the values come from.

    Parameters
    ----------
    step
        Sampling step, s.
    samples
        Number of samples.
    channels
        Measured quantities.
    source
        Measured values (samples x channels, SI units, NaN where a sample is missing), or how to simulate
        them.
    """

    step: float
    samples: int
    channels: tuple[Channel, ...]
    source: Simulation | ArrayLike = field(default_factory=Simulation)

    def __post_init__(self) -> None:
        channels = tuple(Channel(*channel) for channel in self.channels)
        object.__setattr__(self, "channels", channels)
        if len(set(channels)) != len(channels):
            twice = [channel.name for channel in channels if channels.count(channel) > 1]
            raise UsageError(f"the channel {twice[0]} is named twice", names=twice[:1])
        _ = self.record
        if isinstance(self.source, Simulation):
            return
        values = np.array(self.source, dtype=float)
        if values.shape != (self.samples, len(channels)):
            raise UsageError(
                f"measured values are {values.shape}, but must be {(self.samples, len(channels))}"
            )
        if np.isinf(values).any():
            raise UsageError("measured values must be finite, or NaN where a sample is missing")
        object.__setattr__(self, "source", values)

    @property
    def record(self) -> Record:
        """The record: step, samples, and the time of the first one."""
        start = self.source.settle if isinstance(self.source, Simulation) else 0.0
        return Record(self.step, self.samples, start)


class Experiment(NamedTuple):
    """One record and the forces it was taken under.

    The time of the forces is that of the simulation: with settling, the first sample is not t = 0.
    """

    loads: Sequence[Load]
    measurement: Measurement


@dataclass(frozen=True, eq=False)
class Data:
    """A record.

    Attributes
    ----------
    values
        Measured values (times x channels), NaN where missing.
    noise
        Standard deviation of the noise (channels), if known.
    clean
        The values without noise (times x channels), if known.
    given
        Standard deviation of the noise that the estimator is told (channels), NaN where it is not told.
    """

    values: Array
    noise: Array | None = None
    clean: Array | None = None
    given: Array | None = None

    @property
    def rms(self) -> Array:
        """Root mean square of each channel over the samples present."""
        return root_mean_square(self.values)


def data(model: StructuralModel, loads: Sequence[Load], measurement: Measurement) -> Data:
    """Return the measured values, simulated with `model` where they are to be simulated.

    Simulated values are exact for the continuous loads, from rest at t = 0, the unknown joint parameters at
    their true values; the noise of each channel then has the standard deviation noise ratio x RMS.

    Raises
    ------
    UsageError
        If a true value is missing for a simulation.
    NotIdentifiable
        If a channel has no samples or measures nothing but zeros.
    """
    if isinstance(measurement.source, Simulation):
        clean = simulated(model, loads, measurement)
        noise = measurement.source.noise_ratio * root_mean_square(clean)
        generator = np.random.Generator(np.random.PCG64(measurement.source.seed))
        record = Data(clean + noise * generator.standard_normal(clean.shape), noise, clean)
    else:
        record = Data(np.asarray(measurement.source))
    for column, channel in enumerate(measurement.channels):
        if not np.any(np.nan_to_num(record.values[:, column])):
            raise NotIdentifiable(
                f"the channel {channel.name} measures nothing but zeros or missing values",
                remedy="Leave it out, or check the sensor and the excitation.",
                names=(channel.name,),
            )
    return record


def simulated(model: StructuralModel, loads: Sequence[Load], measurement: Measurement) -> Array:
    """Return the exact, noise-free response at the sampling times (times x channels)."""
    inputs = [load.dof for load in loads]
    system = state_space(*model.dense(model.true_values()), *ports(model, inputs, measurement.channels))
    return response(system, [load.signal for load in loads], measurement.record.times).outputs


def as_estimated(loads: Sequence[Load], record: Record) -> list[Load]:
    """Return the loads as an estimator knows them: of a random signal its samples only."""
    return [
        load._replace(signal=load.signal.sampled(record)) if isinstance(load.signal, Random) else load
        for load in loads
    ]
