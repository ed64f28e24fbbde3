"""Noise of the full band that samples can carry, in a continuous form that its samples determine."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from dynid.choices import HOLD
from dynid.lti.generator import Array, Record, Smooth, require
from dynid.lti.sampled import Sampled, require_noise

#: Most samples (800 MB with what is needed to join them).
_MOST = 20_000_000


@dataclass(frozen=True)
class White(Smooth):
    """White Gaussian samples joined by a cubic spline.

    The spline is the continuous truth: an estimator that enters the samples by a spline hold loses nothing;
    lines up to the Nyquist frequency (`Random`), which no hold can follow, would bias what it finds.

    Parameters
    ----------
    amplitude
        Standard deviation of the samples.
    seed
        Seed of the generator (PCG64).
    step
        Sampling step of the record, s (set by the record, not a key of scenes).
    samples
        Number of steps from t = 0 on (set by the record, not a key of scenes).
    hold
        How an estimator, which sees samples only, goes on between them; see `Sampled`.
    """

    kind: ClassVar[str] = "random"
    pace: ClassVar[str] = "band"

    amplitude: float
    seed: int
    step: float
    samples: int
    hold: str = HOLD.value

    def __post_init__(self) -> None:
        require_noise(self.amplitude, self.seed, self.step, self.samples, self.hold)
        require(
            self.samples <= _MOST,
            f"a random signal of {self.samples:.3g} samples is too much, {_MOST:,} are allowed",
            "Shorten the record or its settling, or give the signal a band.",
            ("random", "band"),
        )

    @cached_property
    def _curve(self) -> Sampled:
        normal = np.random.Generator(np.random.PCG64(self.seed)).standard_normal(self.samples + 1)
        return Sampled(self.amplitude * normal, self.step)

    def generator(self) -> tuple[Array, Array]:
        """Return the shift of the spline's polynomial."""
        return self._curve.generator()

    def states(self, times: Array, middles: Array) -> Array:
        """Return the scaled derivatives of the pieces that hold `middles`."""
        return self._curve.states(times, middles)

    def breakpoints(self, start: float, stop: float) -> Array:
        """Return the sampling times in [start, stop]."""
        return self._curve.breakpoints(start, stop)

    def value(self, times: ArrayLike) -> Array:
        """Return the spline at `times`."""
        return self._curve.value(times)

    def sampled(self, record: Record) -> Sampled:
        """Return what an estimator may see: the samples of `record`, with the signal's hold."""
        return Sampled(self.value(record.times), record.step, self.hold, record.start)
