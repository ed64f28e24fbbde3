"""Settings of simulated records: noise, seed, settling time and initial state."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.arithmetic.numbers import LARGEST
from dynid.arrays import Array
from dynid.errors import UsageError
from dynid.identification.records.noise import Autoregression
from dynid.identification.statistics import root_mean_square
from dynid.structure.matrices import Label


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
