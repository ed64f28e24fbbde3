"""Measured frequency response functions: lines, channels, and their data, measured or simulated.

Complex values are treated as real ones, their real parts above their imaginary parts, over a deviation by
line where that differs: residuals then are white.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dynid.arrays import Array, ComplexArray
from dynid.errors import UsageError
from dynid.identification.records.measurement import Simulation, check_finite, per_channel
from dynid.structure.matrices import Label
from dynid.structure.ports import ratio

# Least deviation of a line, as a part of the largest.
_LEAST_DEVIATION = 1e-6


class Frf(NamedTuple):
    """A frequency response function: the response of `channel` to a unit of `force`, a DOF or source.

    The `kind` of a DOF is as of a `Channel`. With an `amplitude` of the force, by a sine that is stepped up
    or down (`sweep`): the first harmonic of the steady state over the force.
    """

    channel: Any
    force: Label
    kind: str = ""
    amplitude: float | None = None
    sweep: str = "up"

    @property
    def load(self) -> Any:
        """The load, a unit impulse."""
        load = self.channel.unit_load(self.force)
        return load._replace(kind=self.kind) if self.kind else load

    @property
    def name(self) -> str:
        """Its name in results, ``<dof>.<quantity>/<force>``, with the amplitude of a stepped sine."""
        name = f"{self.channel.name}/{self.force}"
        if self.amplitude is None:
            return name
        return f"{name} at {self.amplitude:g} {self.load.unit}{', down' * (self.sweep == 'down')}"

    @property
    def unit(self) -> str:
        """Its unit, SI."""
        return ratio(self.channel.unit, self.load.unit)


@dataclass(frozen=True, eq=False)
class FrfMeasurement:
    """Frequency response functions at common lines."""

    omega: Array  # lines (L), rad/s, increasing
    channels: tuple[Frf, ...]  # the frequency response functions
    # Measured values (L x channels, complex, SI units, NaN where a line is missing), or how to simulate them:
    # complex noise whose standard deviation is the ratio times the channel's RMS.
    source: Simulation | ArrayLike = field(default_factory=Simulation)
    # Standard deviation of the complex noise, root of E |n|^2: one number, or one a channel, NaN where it is
    # unknown. Absent: it is estimated from the residuals.
    noise: float | Sequence[float] | None = None
    deviation: Array | None = None  # the noise's standard deviation by line (L x channels)
    # True if only the ratio of deviations from line to line is known; their size is then `noise`.
    relative: bool = False
    # True if the deviation of the noise at each line is a ratio of the response there, which is `noise`, or
    # estimated. The weights are first those of the measured values, then of the model's at the estimate:
    # those of measured values favour lines where the noise is against the response.
    proportional: bool = False
    notes: tuple[str, ...] = ()  # warnings of how they were read
    coherence: Array | None = None  # of each response with its force (L x channels), where it was measured

    def __post_init__(self) -> None:
        omega = np.atleast_1d(np.array(self.omega, dtype=float))
        object.__setattr__(self, "omega", omega)
        if not (np.isfinite(omega).all() and np.all(omega >= 0) and np.all(np.diff(omega) > 0)):
            raise UsageError(
                "the lines of a frequency response must be finite, not negative, and increase",
                names=("measurement.frf",),
            )
        names = [channel.name for channel in self.channels]
        if len(set(names)) != len(names):
            twice = next(name for name in names if names.count(name) > 1)
            raise UsageError(f"the frequency response {twice} is named twice", names=("measurement",))
        shape = (len(omega), len(names))
        if not isinstance(self.source, Simulation):
            values = np.array(self.source, dtype=complex)
            if values.shape != shape:
                raise UsageError(f"measured responses are {values.shape}, but must be {shape}")
            check_finite(values, "measured responses", "line")
            object.__setattr__(self, "source", values)
        if self.deviation is not None:
            self._check_deviation(np.asarray(self.deviation, dtype=float), shape)

    def _check_deviation(self, deviation: Array, shape: tuple[int, int]) -> None:
        if deviation.shape != shape:
            raise UsageError(f"deviations by line are {deviation.shape}, but must be {shape}")
        good = np.isnan(deviation) | (np.isfinite(deviation) & (deviation >= 0))
        if not good.all():
            raise UsageError("deviations by line must be finite and not negative", names=("measurement.frf",))
        if isinstance(self.source, Simulation) and not self.proportional:
            raise UsageError("simulated responses have the same noise at all lines")
        if self.noise is not None and not self.relative:
            raise UsageError("the noise is given by line already", names=("measurement.noise", "measurement"))

    @property
    def given_noise(self) -> Array | None:
        """The given deviations of the complex noise (channels), in units of `profile`."""
        if self.deviation is not None and not self.relative:
            return np.ones(len(self.channels))
        return (
            None if self.noise is None else per_channel("measurement.noise", self.noise, len(self.channels))
        )

    @property
    def profile(self) -> Array:
        """Deviation by line (L x channels) by which values are divided; 1 where none is given."""
        if self.deviation is None:
            return np.ones((len(self.omega), len(self.channels)))
        deviation = np.asarray(self.deviation, dtype=float)
        largest = np.nanmax(deviation, axis=0, initial=0.0)
        floored = np.maximum(
            np.nan_to_num(deviation, nan=0.0), _LEAST_DEVIATION * np.where(largest > 0, largest, 1)
        )
        return np.asarray(np.where(np.isnan(deviation), np.nan, floored))


def stacked(values: ComplexArray) -> Array:
    """Return complex values (L x …) as real ones (2 L x …), the imaginary parts below the real ones."""
    return np.concatenate([values.real, values.imag])


def unstacked(values: Array) -> ComplexArray:
    """Return real values (2 L x …) as the complex ones they were stacked from (L x …)."""
    real, imaginary = np.split(values, 2)
    return np.asarray(real + 1j * imaginary)
