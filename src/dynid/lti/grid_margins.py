"""Margins of a loop whose response is no rational function: between the points of a grid."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from dynid.arrays import Array, ComplexArray
from dynid.lti.margins import LIMIT, Margins, lag, largest_of

#: Relative accuracy of crossings, and steps after which they are as they are.
_ROOT_RTOL, _MAX_STEPS = 1e-14, 60
#: Golden sections of the interval of a peak: its height is accurate to the square of what is left.
_GOLDEN, _SECTIONS = (math.sqrt(5) - 1) / 2, 40

_Gain = Callable[[Array], ComplexArray]


def _sign_changes(function: Callable[[Array], Array], grid: Array, values: Array | None = None) -> Array:
    """Return the zeros of a function between points of a grid, all by false position at once (Illinois).

    `values`: those at its points.
    """
    values = function(grid) if values is None else values
    k = np.flatnonzero(np.sign(values[1:]) * np.sign(values[:-1]) < 0)
    low, below, high, above = grid[k], values[k], grid[k + 1], values[k + 1]
    for _ in range(_MAX_STEPS if len(k) else 0):
        middle = (low * above - high * below) / (above - below)
        value = function(middle)
        passed = np.sign(value) * np.sign(above) < 0
        low, below = np.where(passed, high, low), np.where(passed, above, below / 2)
        change, high, above = np.abs(middle - high), middle, np.where(value == 0, np.spacing(0.0), value)
        if np.all(change <= _ROOT_RTOL * np.abs(high)):
            break
    return high


def lags(gain: _Gain, grid: Array, values: ComplexArray | None = None) -> list[tuple[float, float]]:
    """Return the phase lags, degrees, that turn L to -1 where |L| = 1, with the frequencies, rad/s."""
    sizes = None if values is None else np.log(np.abs(values))
    at = _sign_changes(lambda omega: np.log(np.abs(gain(omega))), grid, sizes)
    return [(lag(value), omega) for value, omega in zip(gain(at).tolist(), at.tolist(), strict=True)]


def grid_margins(gain: _Gain, grid: Array, values: ComplexArray) -> Margins:
    """Return the margins of a loop up to a frequency at which L is real; the verdict is left open.

    `grid`: frequencies from nearly 0 to there, rad/s, between which L turns by little; `values`: L at them.
    """
    phases = lags(gain, grid, values)
    phase, gain_crossover = min(phases, default=(math.inf, math.inf))
    crossings = _sign_changes(lambda at: gain(at).imag, grid[:-1], values[:-1].imag)
    real = [*zip(gain(crossings).real.tolist(), crossings.tolist(), strict=True)]
    real += [(float(values[-1].real), float(grid[-1])), (_at_rest(gain), 0.0)]
    gains = [(-1 / value, omega) for value, omega in real if value < 0]
    above = [candidate for candidate in gains if candidate[0] >= 1 - LIMIT]
    below = [candidate for candidate in gains if candidate[0] < 1 - LIMIT]
    gain_margin, phase_crossover = min(above, default=(math.inf, math.inf))
    reduction = max(below, default=(0.0, math.inf))
    Ms, Ms_at = _peak(lambda at: np.abs(1 / (1 + gain(at))), grid, np.abs(1 / (1 + values)))
    Mt, Mt_at = _peak(lambda at: np.abs(1 - 1 / (1 + gain(at))), grid, np.abs(1 - 1 / (1 + values)))
    return Margins(
        stable=False,
        stability="",
        unstable_poles=math.inf,
        gain=gain_margin,
        gain_reduction=reduction[0],
        phase=phase,
        delay=math.nan,
        modulus=1 / Ms,
        gain_crossover=gain_crossover,
        phase_crossover=phase_crossover if above else reduction[1],
        modulus_at=Ms_at,
        Ms=Ms,
        Mt=Mt,
        Mt_at=Mt_at,
    )


def _at_rest(gain: _Gain) -> float:
    """Return L(0); 0 where it is infinite."""
    try:
        value = complex(gain(np.zeros(1))[0]).real
    except np.linalg.LinAlgError:
        return 0.0
    return value if math.isfinite(value) and abs(value) < 1 / LIMIT else 0.0


def _peak(size: Callable[[Array], Array], grid: Array, values: Array) -> tuple[float, float]:
    """Return the largest value of a function and its frequency."""
    k = np.flatnonzero((values[1:-1] >= values[:-2]) & (values[1:-1] > values[2:])) + 1
    k = k[values[k] > values.max() / 2]
    low, high = grid[k - 1], grid[k + 1]
    left, right = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    at_left, at_right = size(left), size(right)
    for _ in range(_SECTIONS if len(k) else 0):
        lower = at_left > at_right  # the peak is left of `right`
        low, high = np.where(lower, low, left), np.where(lower, right, high)
        new = np.where(lower, high - _GOLDEN * (high - low), low + _GOLDEN * (high - low))
        at_new = size(new)
        left, right = np.where(lower, new, right), np.where(lower, left, new)
        at_left, at_right = np.where(lower, at_new, at_right), np.where(lower, at_left, at_new)
    peaks = [(float(values[end]), float(grid[end])) for end in (0, -1)]
    peaks += zip(at_left.tolist(), left.tolist(), strict=True)
    return largest_of(sorted(peaks, key=lambda peak: peak[1]))
