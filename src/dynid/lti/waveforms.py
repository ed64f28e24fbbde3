"""Deterministic signals: step, impulse, impact, sines and chirp."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array, ComplexArray
from dynid.errors import UsageError
from dynid.lti.generator import (
    TAYLOR_DEGREE,
    Signal,
    inside,
    polynomial_generator,
    require,
    require_finite,
)

MAX_LINES = 1_000_000
"""Most Fourier lines of a signal."""
# Most products of line, time and column that are summed directly: about half a minute.
_MAX_DIRECT_PRODUCTS = 2e10
# Complex numbers in the table of a block (32 MB).
_MAX_TABLE_ENTRIES = 2_000_000


def sum_lines(omega: Array, weights: ComplexArray, times: Array, period: float | None = None) -> Array:
    """Sum ``Re weights exp(i omega t)`` over lines: weights (lines x columns), sums (times x columns).

    By FFT where the times are equidistant and divide the common period of all lines, s; else in blocks.
    `UsageError` before the computation, where there are too many lines and times.
    """
    count = None if period is None else _samples_of_a_period(times, period, len(omega))
    if count is not None and period is not None:  # by FFT; harmonics beyond `count` alias
        bins = np.rint(omega * period / (2 * np.pi)).astype(np.int64) % count
        again, turned = np.arange(len(times)) % count, np.exp(1j * omega * times[0])
        out = np.empty((len(times), weights.shape[1]))
        for column in range(weights.shape[1]):
            w = weights[:, column] * turned
            spectrum = np.bincount(bins, w.real, count) + 1j * np.bincount(bins, w.imag, count)
            out[:, column] = (np.fft.ifft(spectrum).real * count)[again]
        return out
    terms = float(len(times)) * len(omega) * weights.shape[1]
    if terms > _MAX_DIRECT_PRODUCTS:
        raise UsageError(
            f"a sum of {len(omega)} Fourier lines at {len(times)} times takes too long",
            remedy="Ask for times a step of the signal's record apart, or for fewer; or narrow the band.",
            names=("random", "band"),
        )
    return _by_blocks(omega, weights, times)


def _samples_of_a_period(times: Array, period: float, lines: int) -> int | None:
    """Return the number of time steps in a period, if it is a whole number to rounding."""
    if len(times) < 2:
        return None
    count = round(float(period / ((times[-1] - times[0]) / (len(times) - 1))))
    if not 1 <= count <= 4 * (len(times) + 2 * lines):
        return None
    exact = times[0] + np.arange(len(times)) * (period / count)
    rounding = 8 * np.finfo(float).eps * float(np.abs(times).max())
    return count if np.abs(times - exact).max() <= rounding else None


def _by_blocks(omega: Array, weights: ComplexArray, times: Array) -> Array:
    """Sum in blocks of lines and times; one table serves all blocks of equidistant times."""
    out = np.zeros((len(times), weights.shape[1]))
    steps = np.diff(times)
    step = float(steps.mean()) if len(steps) else 0.0
    even = np.all(np.abs(steps - step) <= 4 * np.finfo(float).eps * np.abs(times).max(initial=0.0))
    rows = 64 if even else 1024
    width = _MAX_TABLE_ENTRIES // rows
    for left in range(0, len(omega), width):
        w, c = omega[left : left + width], weights[left : left + width]
        table = np.exp(1j * np.outer(np.arange(min(rows, len(times))) * step, w)) if even else None
        for first in range(0, len(times), rows):
            here = times[first : first + rows]
            if table is None:
                out[first : first + rows] += (np.exp(1j * np.outer(here, w)) @ c).real
            else:
                turned = c * np.exp(1j * w * here[0])[:, None]
                out[first : first + rows] += (table[: len(here)] @ turned).real
    return out


def line_derivatives(omega: Array, c: ComplexArray, times: Array, tau: float) -> Array:
    """Return ``tau^j u^(j)`` (times x orders 0 … 18) of a sum of lines."""
    orders = np.arange(TAYLOR_DEGREE + 1)
    return sum_lines(omega, c[:, None] * (1j * omega[:, None] * tau) ** orders, times)


def time_scale(omega: Array) -> float:
    """Return the time in which the fastest line turns by one radian, s (1 s for a constant)."""
    fastest = float(np.max(np.abs(omega), initial=0.0))
    return 1 / fastest if fastest > 0 else 1.0


#: 0! … 18!.
_FACTORIALS = np.array([math.factorial(n) for n in range(TAYLOR_DEGREE + 1)], dtype=float)

# Most lines as rotations, two generator states each; for more, one Taylor polynomial has fewer states.
_ROTATING_LINES = TAYLOR_DEGREE // 2


@dataclass(frozen=True)
class Step(Signal):
    """A step of height `amplitude` at t = `start`, s."""

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
class Impulse(Signal):
    """A Dirac impulse at t = 0, which makes the state jump by B times its strength (N·s for a force)."""

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
class Impact(Signal):
    """A half sine of an impact hammer, from t = 0 to `duration`, s, with the peak `amplitude`."""

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
        """Return G and h of a rotation."""
        omega = math.pi / self.duration
        return np.array([[0.0, omega], [-omega, 0.0]]), np.array([1.0, 0.0])

    def states(self, times: Array, middles: Array) -> Array:
        """Return sine and cosine of the contact's phase, and zeros out of contact."""
        on = (middles >= 0) & (middles < self.duration)
        phase = np.where(on, times, 0.0) * (math.pi / self.duration)
        w = self.amplitude * np.stack([np.sin(phase), np.cos(phase)], axis=1)
        return np.asarray(np.where(on[:, None], w, 0.0))

    def breakpoints(self, start: float, stop: float) -> Array:
        """Return the start and end of contact."""
        return inside(np.array([0.0, self.duration]), start, stop)


@dataclass(frozen=True)
class Multisine(Signal):
    """A sum of sines, ``sum_j amplitude_j sin(frequency_j t + phase_j)``.

    A frequency of 0 rad/s makes a constant of the phase; default phases are 0.
    """

    kind: ClassVar[str] = "multisine"

    amplitude: Sequence[float]
    frequency: Sequence[float]
    phase: Sequence[float] | None = None

    def __post_init__(self) -> None:
        phase = np.zeros(len(self.amplitude)) if self.phase is None else self.phase
        lists = {"amplitude": self.amplitude, "frequency": self.frequency, "phase": phase}
        for name in ("amplitude", "phase"):
            require(
                len(lists[name]) == len(self.frequency),
                "a multisine needs as many amplitudes and phases as frequencies",
                names=(self.kind, name),
            )
        require(
            len(self.frequency) > 0, "a multisine needs at least one sine", names=(self.kind, "frequency")
        )
        require_finite(self.kind, **lists)
        for name, values in lists.items():
            object.__setattr__(self, name, tuple(float(value) for value in values))

    @cached_property
    def lines(self) -> tuple[Array, NDArray[np.complex128]]:
        """Frequencies (rad/s) and complex amplitudes c of the sum ``Re c exp(i omega t)``."""
        omega = np.asarray(self.frequency)
        return omega, -1j * np.asarray(self.amplitude) * np.exp(1j * np.asarray(self.phase))

    @property
    def _rotates(self) -> bool:
        return len(self.frequency) <= _ROTATING_LINES

    @property
    def longest_step(self) -> float:
        """Longest step, s, over which the generator is exact to rounding."""
        return math.inf if self._rotates else time_scale(self.lines[0])

    def generator(self) -> tuple[Array, Array]:
        """Return G and h of one rotation per sine, or of one Taylor polynomial for many sines."""
        if not self._rotates:
            return polynomial_generator(TAYLOR_DEGREE, self.longest_step)
        omega, _ = self.lines
        G = np.zeros((2 * len(omega), 2 * len(omega)))
        even = np.arange(0, 2 * len(omega), 2)
        G[even, even + 1] = -omega
        G[even + 1, even] = omega
        return G, np.tile([1.0, 0.0], len(omega))

    def states(self, times: Array, middles: Array) -> Array:  # noqa: ARG002
        """Return real and imaginary part of each line, or the scaled derivatives of the sum."""
        omega, c = self.lines
        if not self._rotates:
            return line_derivatives(omega, c, times, self.longest_step)
        z = c * np.exp(1j * np.outer(times, omega))
        return np.stack([z.real, z.imag], axis=2).reshape(len(times), -1)


class Sine(Multisine):
    """A sine, ``amplitude sin(frequency t + phase)``."""

    kind: ClassVar[str] = "sine"

    def __init__(self, amplitude: float = 1.0, frequency: float = 1.0, phase: float = 0.0) -> None:
        super().__init__((amplitude,), (frequency,), (phase,))


@dataclass(frozen=True)
class Chirp(Signal):
    """A sine whose frequency changes linearly from `start` to `stop` (rad/s) over the record.

    The phase is 0 at t = 0. Before the record (while settling) the frequency is `start`, after it `stop`. The
    record sets its `duration` and `begin`, s.
    """

    kind: ClassVar[str] = "chirp"
    pace: ClassVar[str] = "stop"

    amplitude: float
    start: float
    stop: float
    duration: float
    begin: float = 0.0

    def __post_init__(self) -> None:
        require_finite("chirp", amplitude=self.amplitude, start=self.start, stop=self.stop, begin=self.begin)
        require(
            self.duration > 0 and math.isfinite(self.duration),
            "a chirp needs a record of some length: two samples or more",
            names=("chirp",),
        )

    @property
    def _rate(self) -> float:
        return (self.stop - self.start) / self.duration

    @property
    def longest_step(self) -> float:
        """Longest step, s, over which the Taylor polynomial is exact to rounding."""
        # With |omega| tau <= 1 and rate tau^2 <= 1/16 the coefficients fall like those of exp.
        fastest = max(abs(self.start), abs(self.stop), 4 * math.sqrt(abs(self._rate)))
        return 1 / max(fastest, 1 / self.duration)

    def generator(self) -> tuple[Array, Array]:
        """Return G and h of a Taylor polynomial."""
        return polynomial_generator(TAYLOR_DEGREE, self.longest_step)

    def states(self, times: Array, middles: Array) -> Array:
        """Return the scaled derivatives of the signal at `times`."""
        tau = self.longest_step
        end = self.begin + self.duration
        sweeping = (middles >= self.begin) & (middles < end)
        rate = np.where(sweeping, self._rate, 0.0)
        omega = np.where(middles < self.begin, self.start, self.stop)
        omega = np.where(sweeping, self.start + self._rate * (times - self.begin), omega)
        elapsed = np.clip(times - self.begin, 0.0, self.duration)
        after = np.clip(times - self.begin - self.duration, 0.0, None)
        before = np.minimum(times, self.begin)
        swept = self.start * elapsed + 0.5 * self._rate * elapsed**2
        phase: Array = self.start * before + swept + self.stop * after
        f = np.empty((len(times), TAYLOR_DEGREE + 1), dtype=complex)
        f[:, 0] = self.amplitude * np.exp(1j * phase)
        f[:, 1] = 1j * omega * tau * f[:, 0]
        for n in range(2, TAYLOR_DEGREE + 1):  # f' = i (omega + rate t) f, term by term
            f[:, n] = 1j * (omega * tau * f[:, n - 1] + rate * tau**2 * f[:, n - 2]) / n
        return np.asarray(f.imag * _FACTORIALS)

    def breakpoints(self, start: float, stop: float) -> Array:
        """Return both ends of the sweep."""
        return inside(np.array([self.begin, self.begin + self.duration]), start, stop)
