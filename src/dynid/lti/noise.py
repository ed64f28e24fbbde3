"""Random signals: Gaussian noise of a band, and white noise up to the Nyquist frequency."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dynid.defaults import HOLD
from dynid.lti.generator import (
    TAYLOR_DEGREE,
    Array,
    RecordTimes,
    SmoothSignal,
    polynomial_generator,
    require,
    require_finite,
)
from dynid.lti.sampled import HOLDS, Sampled
from dynid.lti.waveforms import MOST_LINES, line_derivatives, sum_lines, time_scale

#: Most samples of white noise (800 MB with the spline).
_MOST = 20_000_000


@dataclass(frozen=True)
class Random(SmoothSignal):
    """Gaussian noise: a finite sum of Fourier lines with seeded complex normal amplitudes.

    The lines lie at multiples of 2 pi / (samples step), inside `band` or, without one, below the Nyquist
    frequency of `step`; the expected standard deviation is `amplitude`. The sum is the continuous signal.

    Parameters
    ----------
    amplitude
        Standard deviation.
    seed
        Seed of the generator (PCG64).
    band
        Lowest and highest angular frequency, rad/s, optional.
    step
        Sampling step of the record, s (set by the record, not a key of scenes).
    samples
        Number of steps in one period, from t = 0 on (set by the record, not a key of scenes).
    hold
        Hold between the samples for an estimator, which receives samples only; see `Sampled`.
    """

    kind: ClassVar[str] = "random"
    pace: ClassVar[str] = "band"

    amplitude: float
    seed: int
    step: float
    samples: int
    band: tuple[float, float] | None = None
    hold: str = HOLD.value

    def __post_init__(self) -> None:
        _require_noise(self.amplitude, self.seed, self.step, self.samples, self.hold)
        first, last = self._range
        require(
            last >= first,
            "a random signal's band holds no Fourier line of the record",
            f"Lines lie {self._spacing:g} rad/s apart: widen the band or lengthen the record.",
            ("random", "band"),
        )
        require(
            last - first < MOST_LINES,
            f"a random signal of {last - first + 1:.3g} lines is too much, {MOST_LINES:,} are allowed",
            f"Lines lie {self._spacing:g} rad/s apart: narrow the band or shorten the record.",
            ("random", "band"),
        )

    @property
    def period(self) -> float:
        """The period of all lines, s."""
        return self.samples * self.step

    @property
    def _spacing(self) -> float:
        return 2 * math.pi / self.period

    @property
    def _range(self) -> tuple[float, float]:
        """First and last line number."""
        if self.band is None:
            return 1.0, (self.samples + 1) // 2 - 1.0
        low, high = self.band
        require(
            0 <= low < high < math.inf,
            "a random signal's band must run from low to high",
            names=("random", "band"),
        )
        first = max(1.0, float(np.ceil(low / self._spacing * (1 - 1e-12))))
        return first, float(np.floor(high / self._spacing * (1 + 1e-12)))

    @cached_property
    def lines(self) -> tuple[Array, NDArray[np.complex128]]:
        """Frequencies (rad/s) and complex amplitudes c of the sum ``Re c exp(i omega t)``."""
        first, last = self._range
        numbers = np.asarray(first + np.arange(int(last - first) + 1))
        normal = np.random.Generator(np.random.PCG64(self.seed)).standard_normal((2, len(numbers)))
        c = (normal[0] + 1j * normal[1]) * (self.amplitude / math.sqrt(len(numbers)))
        return np.asarray(numbers * self._spacing), np.asarray(c)

    @property
    def longest_step(self) -> float:
        """Longest step, s, over which the Taylor polynomial is exact to rounding."""
        return time_scale(self.lines[0])

    def generator(self) -> tuple[Array, Array]:
        """Return G and h of a Taylor polynomial."""
        return polynomial_generator(TAYLOR_DEGREE, self.longest_step)

    def states(self, times: Array, middles: Array) -> Array:  # noqa: ARG002
        """Return the scaled derivatives of the sum at `times`."""
        return line_derivatives(*self.lines, times, self.longest_step)

    def value(self, times: ArrayLike) -> Array:
        """Return the sum of lines at `times`."""
        t = np.asarray(times, dtype=float)
        omega, c = self.lines
        return sum_lines(omega, c[:, None], t.ravel(), self.period)[:, 0].reshape(t.shape)

    def sampled(self, record: RecordTimes) -> Sampled:
        """Return the samples of `record` with the signal's hold, as an estimator receives them."""
        return Sampled(self.value(record.times), record.step, self.hold, record.start)


@dataclass(frozen=True)
class WhiteNoise(SmoothSignal):
    """White Gaussian samples joined by a cubic spline.

    The spline is the continuous signal: an estimator with a spline hold reproduces it exactly. Fourier lines
    up to the Nyquist frequency (`Random`), which no hold can follow, would bias the estimate.

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
        Hold between the samples for an estimator, which receives samples only; see `Sampled`.
    """

    kind: ClassVar[str] = "random"
    pace: ClassVar[str] = "band"

    amplitude: float
    seed: int
    step: float
    samples: int
    hold: str = HOLD.value

    def __post_init__(self) -> None:
        _require_noise(self.amplitude, self.seed, self.step, self.samples, self.hold)
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
        """Return G and h of the spline's polynomial."""
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

    def sampled(self, record: RecordTimes) -> Sampled:
        """Return the samples of `record` with the signal's hold, as an estimator receives them."""
        return Sampled(self.value(record.times), record.step, self.hold, record.start)


def _require_noise(amplitude: float, seed: int, step: float, samples: int, hold: str) -> None:
    """Raise a `UsageError` for invalid parameters."""
    require_finite("random", amplitude=amplitude)
    require(
        hold in HOLDS,
        f"a random signal has no hold {hold!r}",
        f"Use one of {', '.join(HOLDS)}.",
        ("random", "hold"),
    )
    require(seed >= 0, "the seed of a random signal must not be negative", names=("random", "seed"))
    require(
        0 < step < math.inf and 0 < samples * step < math.inf,
        "a random signal needs a positive step, and one sample or more",
        names=("random", "step"),
    )
