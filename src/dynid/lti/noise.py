"""Signals known by samples, with a hold between them, and random ones: noise of a band and white noise."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dynid.arrays import Array
from dynid.defaults import HOLD
from dynid.errors import UsageError
from dynid.lti.generator import (
    TAYLOR_DEGREE,
    RecordTimes,
    Signal,
    polynomial_generator,
    require,
    require_finite,
)
from dynid.lti.waveforms import MAX_LINES, line_derivatives, sum_lines, time_scale

HOLDS = ("spline", "linear", "zero")


@dataclass(frozen=True, eq=False)
class Sampled(Signal):
    """A signal known by its samples at ``start + k step``, continued between them by a hold.

    Holds: ``spline`` (cubic, not-a-knot ends), ``linear``, ``zero`` (constant until the next sample).
    """

    kind: ClassVar[str] = "file"

    values: ArrayLike
    step: float
    hold: str = HOLD.value
    start: float = 0.0

    def __post_init__(self) -> None:
        values = np.array(self.values, dtype=float)
        require(values.ndim == 1, "a sampled signal needs one column of values", names=("file", "column"))
        require(
            self.hold in HOLDS,
            f"a sampled signal has no hold {self.hold!r}",
            f"Use one of {', '.join(HOLDS)}.",
            ("file", "hold"),
        )
        require(
            len(values) >= (1 if self.hold == "zero" else 2),
            "a sampled signal needs two samples or more",
            names=("file", "path", "samples"),
        )
        require(0 < self.step < math.inf, "a sampled signal's step must be positive", names=("file", "step"))
        require_finite("file", start=self.start, values=values)
        object.__setattr__(self, "values", values)

    @cached_property
    def _coefficients(self) -> Array:
        return _hold_coefficients(np.asarray(self.values), self.hold)

    @property
    def stop(self) -> float:
        """Time up to which the signal is known, s."""
        return self.start + len(self._coefficients) * self.step

    def generator(self) -> tuple[Array, Array]:
        """Return G and h of the hold's polynomial."""
        return polynomial_generator(self._coefficients.shape[1] - 1, self.step)

    def states(self, times: Array, middles: Array) -> Array:
        """Return the scaled derivatives (step^j times the j-th) of the pieces that hold `middles`."""
        c = self._coefficients
        position = (middles - self.start) / self.step
        if np.any((position < -1e-6) | (position > len(c) + 1e-6)):
            raise UsageError(
                f"a sampled signal is known from {self.start:g} s to {self.stop:g} s only",
                remedy="Give samples for the whole response, or end it earlier.",
                names=("file", "path"),
            )
        piece = np.clip(np.floor(position + 1e-9).astype(int), 0, len(c) - 1)
        s = (times - self.start) / self.step - piece
        s = np.where(np.abs(s) < 1e-9, 0.0, s)  # a knot, to rounding
        return _shifted_polynomials(c[piece], s)

    def breakpoints(self, start: float, stop: float) -> Array:
        """Return the sampling times in [start, stop]."""
        first = max(0, math.ceil((start - self.start) / self.step - 1e-9))
        last = min(len(self._coefficients), math.floor((stop - self.start) / self.step + 1e-9))
        return np.asarray(self.start + np.arange(first, last + 1) * self.step)


def _hold_coefficients(values: Array, hold: str) -> Array:
    """Return the polynomial of every piece of a hold."""
    if hold == "zero":
        return values[:, None].copy()
    rise = np.diff(values)
    if hold == "linear":
        return np.stack([values[:-1], rise], axis=1)
    n = len(values)
    if n < 4:  # one polynomial through all points
        p = np.polynomial.Polynomial.fit(np.arange(n), values, n - 1).deriv()
        slope = np.asarray(p(np.arange(n)))
    else:
        from scipy.linalg import solve_banded

        # Interior rows: curvature is continuous; end rows: so is the third derivative one knot inside.
        band = np.ones((3, n))
        band[1, 1:-1] = 4.0
        band[0, 1] = band[2, -2] = 2.0
        rhs = np.empty(n)
        rhs[1:-1] = 3 * (values[2:] - values[:-2])
        rhs[0] = (-5 * values[0] + 4 * values[1] + values[2]) / 2
        rhs[-1] = (5 * values[-1] - 4 * values[-2] - values[-3]) / 2
        slope = np.asarray(solve_banded((1, 1), band, rhs))
    left, right = slope[:-1], slope[1:]  # per step
    return np.stack([values[:-1], left, 3 * rise - 2 * left - right, left + right - 2 * rise], axis=1)


def _shifted_polynomials(c: Array, s: Array) -> Array:
    """Return the derivatives of ``sum_j c_j s^j`` (rows x orders) at s."""
    out = np.zeros_like(c)
    degree = c.shape[1] - 1
    for order in range(degree + 1):
        for power in range(degree, order - 1, -1):
            out[:, order] = out[:, order] * s + c[:, power] * math.perm(power, order)
    return out


#: Most samples of white noise (800 MB with the spline).
_MAX_NOISE_SAMPLES = 20_000_000


@dataclass(frozen=True)
class _Noise(Signal):
    """Noise of a seeded generator (PCG64); the record sets `step` (s) and the number of `samples` from t = 0.

    `amplitude` is the standard deviation; `hold` is for an estimator, which receives samples only.
    """

    kind: ClassVar[str] = "random"
    pace: ClassVar[str] = "band"

    amplitude: float
    seed: int
    step: float
    samples: int
    hold: str = HOLD.value

    def __post_init__(self) -> None:
        require_finite("random", amplitude=self.amplitude)
        require(
            self.hold in HOLDS,
            f"a random signal has no hold {self.hold!r}",
            f"Use one of {', '.join(HOLDS)}.",
            ("random", "hold"),
        )
        require(self.seed >= 0, "the seed of a random signal must not be negative", names=("random", "seed"))
        require(
            0 < self.step < math.inf and 0 < self.samples * self.step < math.inf,
            "a random signal needs a positive step, and one sample or more",
            names=("random", "step"),
        )

    def sampled(self, record: RecordTimes) -> Sampled:
        """Return the samples of `record` with the signal's hold, as an estimator receives them."""
        return Sampled(self.value(record.times), record.step, self.hold, record.start)


@dataclass(frozen=True)
class Random(_Noise):
    """Gaussian noise: a finite sum of Fourier lines with seeded complex normal amplitudes.

    The lines lie at multiples of 2 pi / (samples step), inside `band` (rad/s) or, without one, below the
    Nyquist frequency of `step`; `amplitude` is the expected standard deviation. The sum is the continuous
    signal, of which the samples are one period.
    """

    band: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        first, last = self._range
        require(
            last >= first,
            "a random signal's band holds no Fourier line of the record",
            f"Lines lie {self._spacing:g} rad/s apart: widen the band or lengthen the record.",
            ("random", "band"),
        )
        require(
            last - first < MAX_LINES,
            f"a random signal of {last - first + 1:.3g} lines is too much, {MAX_LINES:,} are allowed",
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


@dataclass(frozen=True)
class WhiteNoise(_Noise):
    """White Gaussian samples of standard deviation `amplitude`, joined by a cubic spline.

    The spline is the continuous signal: an estimator with a spline hold reproduces it exactly. Fourier lines
    up to the Nyquist frequency (`Random`), which no hold can follow, would bias the estimate.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        require(
            self.samples <= _MAX_NOISE_SAMPLES,
            f"a random signal of {self.samples:.3g} samples is too much, {_MAX_NOISE_SAMPLES:,} are allowed",
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
