"""Measurements of records of time, and their data, measured or simulated with noise from a seed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dynid.arithmetic.numbers import LARGEST
from dynid.arrays import Array
from dynid.errors import UsageError
from dynid.identification.records.noise import Autoregression, ColouredNoise
from dynid.identification.statistics import root_mean_square
from dynid.lti.signals import Random, RecordTimes, WhiteNoise
from dynid.structure.matrices import Label
from dynid.structure.ports import Channel


@dataclass(frozen=True)
class Simulation:
    """Settings of a simulated record."""

    # Standard deviation of the added white noise over the channel's RMS (Yang, eq 23); 0: clean. One number,
    # or one a channel.
    noise_ratio: float | Sequence[float] = 0.0
    seed: int = 0  # seed of the noise (PCG64)
    settle: float = 0.0  # time from t = 0 to the first sample, s
    # Standard deviation of the noise instead of the ratio, in the channel's unit; one number, or one a
    # channel.
    noise: float | Sequence[float] | None = None
    # `displacement`, `velocity`: initial displacement, m, and velocity, m/s, by DOF; absent: at rest
    displacement: Mapping[Label, float] = field(default_factory=dict)
    velocity: Mapping[Label, float] = field(default_factory=dict)
    # Coefficients a_1, a_2, … of an autoregressive noise ``x_t = a_1 x_(t-1) + a_2 x_(t-2) + … + e_t``,
    # stationary from the first sample on, the same in all channels; its standard deviation is that of
    # `noise_ratio` or `noise`. Absent: white.
    noise_colour: Sequence[float] = ()
    # True: the noise of a frequency response is in proportion to its magnitude, line by line.
    noise_by_line: bool = False

    def __post_init__(self) -> None:
        for name, level in (("noise_ratio", self.noise_ratio), ("noise", self.noise)):
            numbers = np.asarray(0.0 if level is None else level, dtype=float)
            if not (np.isfinite(numbers).all() and np.all(numbers >= 0)):
                words = name.replace("_", " ")
                raise UsageError(f"the {words} must be finite and not negative", names=(name,))
        if self.noise is not None and np.any(self.noise_ratio):
            raise UsageError("the noise has either a ratio or a standard deviation", names=("noise",))
        if not (math.isfinite(self.settle) and self.settle >= 0):
            raise UsageError("the settling time must be finite and not negative", names=("settle",))
        Autoregression.of(self.noise_colour, 1)
        if self.seed < 0:
            raise UsageError("a seed must not be negative", names=("seed",))

    def deviation(self, clean: Array) -> Array:
        """Return the standard deviation of the noise of each channel (channels) of a clean record."""
        if self.noise is not None:
            return per_channel("noise", self.noise, clean.shape[1])
        return per_channel("noise_ratio", self.noise_ratio, clean.shape[1]) * root_mean_square(clean)


def check_finite(values: NDArray[Any], what: str, sample: str) -> None:
    """Refuse measured values that are infinite, or whose squares are; NaN is a missing one."""
    largest = float(np.nanmax(np.abs(values), initial=0.0))
    if largest == math.inf:
        raise UsageError(f"{what} must be finite, or NaN where a {sample} is missing", names=("measurement",))
    if largest > LARGEST:
        raise UsageError(
            f"{what} reach {largest:.3g}; they may reach {LARGEST:g}, whose square is finite: check columns "
            "and units",
            names=("measurement",),
        )


def per_channel(name: str, level: float | Sequence[float], channels: int) -> Array:
    """Return one number a channel (channels).

    Raises UsageError if there are more or fewer of them.
    """
    numbers = np.atleast_1d(np.asarray(level, dtype=float))
    if numbers.shape not in ((1,), (channels,)):
        raise UsageError(
            f"'{name}' has {len(numbers)} entries, but there are {channels} channels", names=(name,)
        )
    return np.broadcast_to(numbers, channels).copy()


@dataclass(frozen=True, eq=False)
class Measurement:
    """A measurement: channels, sampling, and the source of the values."""

    step: float  # sampling step, s
    samples: int  # number of samples
    channels: tuple[Any, ...]  # measured quantities
    # Measured values (samples x channels, SI units, NaN where a sample is missing), or how to simulate them.
    source: Simulation | ArrayLike = field(default_factory=Simulation)
    # Given standard deviation of the noise, in the channel's unit: one number, or one a channel, NaN where it
    # is unknown. Absent: it is estimated from the residuals, white; or coloured noise, also estimated.
    noise: float | Sequence[float] | ColouredNoise | None = None
    start: float = 0.0  # time of the first measured sample on the clock of the loads, s
    prepared: tuple[str, ...] = ()  # the steps by which the samples were prepared; see `preparation.prepare`
    passed: float = 1.0  # part of the power of white noise that these steps pass
    # Figures of the clock by the time stamps of the file, by name, if there are any.
    clock: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()  # warnings of how the record was read

    def __post_init__(self) -> None:
        channels = tuple(
            Channel(*channel) if type(channel) is tuple else channel for channel in self.channels
        )
        object.__setattr__(self, "channels", channels)
        if len(set(channels)) != len(channels):
            twice = [channel.name for channel in channels if channels.count(channel) > 1]
            raise UsageError(f"the channel {twice[0]} is named twice", names=twice[:1])
        for channel in channels:
            clock = getattr(channel, "clock", None)
            if clock is not None and clock.samples > self.samples:
                raise UsageError(
                    f"{channel.name} has {clock.samples} samples by its clock, and the record {self.samples}",
                    remedy="A record has as many samples as its longest channel.",
                    names=("measurement.channels",),
                )
        _ = self.record
        noise = self.given_noise
        if noise is not None and not np.all(np.isnan(noise) | ((noise > 0) & np.isfinite(noise))):
            raise UsageError(
                "a noise that is given must be finite and positive", names=("measurement.noise",)
            )
        if isinstance(self.source, Simulation):
            return
        values = np.array(self.source, dtype=float)
        if values.shape != (self.samples, len(channels)):
            raise UsageError(
                f"measured values are {values.shape}, but must be {(self.samples, len(channels))}"
            )
        check_finite(values, "measured values", "sample")
        object.__setattr__(self, "source", values)

    @property
    def given_noise(self) -> Array | None:
        """The given deviations of the noise (channels)."""
        if self.noise is None or isinstance(self.noise, ColouredNoise):
            return None
        return per_channel("measurement.noise", self.noise, len(self.channels))

    @property
    def record(self) -> RecordTimes:
        """The record: step, samples, and the time of the first one."""
        start = self.source.settle if isinstance(self.source, Simulation) else self.start
        return RecordTimes(self.step, self.samples, start)


class Experiment(NamedTuple):
    """One record and the forces it was taken under.

    The time of the forces is that of the simulation: with settling, the first sample is not t = 0.
    """

    loads: Sequence[Any]
    measurement: Measurement

    @property
    def dofs(self) -> list[Label]:
        """The DOFs that are loaded, measured or given an initial value."""
        source, channels = self.measurement.source, self.measurement.channels
        motions = (source.displacement, source.velocity) if isinstance(source, Simulation) else ()
        dofs = [*(load.dof for load in self.loads), *(end for c in channels for end in (c.dof, c.reference))]
        dofs += [dof for motion in motions for dof in motion or ()]
        return list(dict.fromkeys(dof for dof in dofs if dof is not None))


class RobustLoss(NamedTuple):
    """A record under a robust loss."""

    recorded: Array  # the values as they were recorded (times x channels), NaN where missing
    scale: Array  # robust standard deviation of the residuals (channels)
    clipped: Array  # part of the values whose influence is bounded (channels)
    given: Array  # given standard deviation of the noise (channels), NaN where none is given


@dataclass(frozen=True, eq=False)
class RecordData:
    """A record."""

    values: Array  # measured values (times x channels), NaN where missing
    noise: Array | None = None  # standard deviation of the noise (channels), if known
    clean: Array | None = None  # the values without noise (times x channels), if known
    # Given standard deviation of the noise (channels), NaN where none is given; of pseudo-values None.
    given: Array | None = None
    # Part of the power of white noise that a preparation passes. Error bars need the density in the pass
    # band: the deviation of the residuals over the root of this part.
    passed: float = 1.0
    # Data of a robust loss, if one is used; `values` then are pseudo-values, see
    # `dynid.identification.estimators.maximum_likelihood`.
    robust: RobustLoss | None = None
    colour: Autoregression | None = None  # colour of a simulated noise, if it is not white
    # Deviation of a simulated noise by line (L x channels), if it is not the same at all lines.
    by_line: Array | None = None

    @property
    def recorded(self) -> Array:
        """The values as they were recorded (times x channels)."""
        return self.values if self.robust is None else self.robust.recorded

    @property
    def given_noise(self) -> Array:
        """The given deviations of the noise (channels), NaN where none is given, whatever the loss."""
        if self.robust is not None:
            return self.robust.given
        return np.full(self.values.shape[1], np.nan) if self.given is None else self.given

    @cached_property
    def rms(self) -> Array:
        """Root mean square of each channel over the samples present."""
        return root_mean_square(self.values)

    @cached_property
    def counts(self) -> NDArray[np.int_]:
        """Number of values of each channel (channels)."""
        return np.asarray(np.count_nonzero(~np.isnan(self.values), axis=0))

    def within(self, samples: slice) -> RecordData:
        """Return some of the samples."""
        clean = None if self.clean is None else self.clean[samples]
        return replace(self, values=self.values[samples], clean=clean)

    def where(self, kept: NDArray[np.bool_]) -> RecordData:
        """Return the record with some of its values (times x channels), the others missing."""
        return replace(self, values=np.where(kept, self.values, np.nan))

    def without_noise(self) -> RecordData:
        """Return the record without its noise, where that is known."""
        return self if self.clean is None else replace(self, values=self.clean)


def sampled_loads(loads: Sequence[Any], record: RecordTimes) -> list[Any]:
    """Return the loads as an estimator knows them: of a random signal its samples only."""
    return [
        load._replace(signal=load.signal.sampled(record))
        if isinstance(load.signal, Random | WhiteNoise)
        else load
        for load in loads
    ]
