"""Signals with an event: step, impulse, impact."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dynid.lti.generator import Array, Smooth, inside, require, require_finite


@dataclass(frozen=True)
class Step(Smooth):
    """A step at t = `start`.

    Parameters
    ----------
    amplitude
        Height.
    start
        Time of the step, s.
    """

    kind: ClassVar[str] = "step"

    amplitude: float = 1.0
    start: float = 0.0

    def __post_init__(self) -> None:
        require_finite("step", amplitude=self.amplitude, start=self.start)

    def generator(self) -> tuple[Array, Array]:
        """Return G and h of a constant."""
        return np.zeros((1, 1)), np.ones(1)

    def states(self, times: Array, middles: Array) -> Array:  # noqa: ARG002
        """Return the height of the pieces that hold `middles`."""
        return np.where(middles >= self.start, self.amplitude, 0.0)[:, None]

    def breakpoints(self, start: float, stop: float) -> Array:
        """Return the time of the step."""
        return inside(np.array([self.start]), start, stop)


@dataclass(frozen=True)
class Impulse(Smooth):
    """A Dirac impulse at t = 0, which makes the state jump by B times its strength.

    Parameters
    ----------
    amplitude
        Strength, the time integral of the signal (N·s for a force).
    """

    kind: ClassVar[str] = "impulse"

    amplitude: float = 1.0

    def __post_init__(self) -> None:
        require_finite("impulse", amplitude=self.amplitude)

    @property
    def jump(self) -> float:
        """Strength of the Dirac impulse at t = 0."""
        return self.amplitude

    def generator(self) -> tuple[Array, Array]:
        """Return an empty generator."""
        return np.zeros((0, 0)), np.zeros(0)

    def states(self, times: Array, middles: Array) -> Array:  # noqa: ARG002
        """Return no states."""
        return np.zeros((len(times), 0))


@dataclass(frozen=True)
class Impact(Smooth):
    """A half sine of an impact hammer, from t = 0 to `duration`.

    Parameters
    ----------
    amplitude
        Peak value.
    duration
        Length of contact, s.
    """

    kind: ClassVar[str] = "impact"

    amplitude: float
    duration: float

    def __post_init__(self) -> None:
        require_finite("impact", amplitude=self.amplitude)
        require(
            self.duration > 0 and math.isfinite(self.duration) and math.isfinite(math.pi / self.duration),
            "an impact needs a positive duration",
            names=("impact", "duration"),
        )

    def generator(self) -> tuple[Array, Array]:
        """Return one rotation."""
        omega = math.pi / self.duration
        return np.array([[0.0, omega], [-omega, 0.0]]), np.array([1.0, 0.0])

    def states(self, times: Array, middles: Array) -> Array:
        """Return sine and cosine of the contact's phase, and zeros out of contact."""
        on = (middles >= 0) & (middles < self.duration)
        phase = np.where(on, times, 0.0) * (math.pi / self.duration)
        w = self.amplitude * np.stack([np.sin(phase), np.cos(phase)], axis=1)
        return np.asarray(np.where(on[:, None], w, 0.0))

    def breakpoints(self, start: float, stop: float) -> Array:
        """Return begin and end of contact."""
        return inside(np.array([0.0, self.duration]), start, stop)
