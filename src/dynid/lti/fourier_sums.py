"""Sums of many Fourier lines at many times."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dynid.errors import UsageError
from dynid.lti.generator import TAYLOR_DEGREE

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

MOST_LINES = 1_000_000
"""Most Fourier lines of a signal."""
# Most products of line, time and column that are summed directly: about half a minute.
_MOST_TERMS = 2e10
# Complex numbers in the table of a block (32 MB).
_TABLE = 2_000_000


def sum_lines(omega: Array, weights: ComplexArray, times: Array, period: float | None = None) -> Array:
    """Sum ``Re weights exp(i omega t)`` over lines.

    By FFT where the times are equidistant and divide the period; else in blocks.

    Parameters
    ----------
    omega
        Frequencies (lines), rad/s.
    weights
        Complex amplitudes (lines x columns).
    times
        Times, s.
    period
        A period that all lines have in common, s, if there is one.

    Returns
    -------
    Array
        The sums (times x columns).

    Raises
    ------
    UsageError
        Before the computation, where there are too many lines and times.
    """
    count = None if period is None else _samples_of_a_period(times, period, len(omega))
    if count is not None and period is not None:  # by FFT; harmonics beyond `count` alias
        place = np.rint(omega * period / (2 * np.pi)).astype(np.int64) % count
        again, turned = np.arange(len(times)) % count, np.exp(1j * omega * times[0])
        out = np.empty((len(times), weights.shape[1]))
        for column in range(weights.shape[1]):
            w = weights[:, column] * turned
            spectrum = np.bincount(place, w.real, count) + 1j * np.bincount(place, w.imag, count)
            out[:, column] = (np.fft.ifft(spectrum).real * count)[again]
        return out
    terms = float(len(times)) * len(omega) * weights.shape[1]
    if terms > _MOST_TERMS:
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
    width = _TABLE // rows
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
