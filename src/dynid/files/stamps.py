"""Time stamps of a record: their rounding, their agreement with a sampling step, and the clock behind them.

Stamps that are even as far as they are printed agree. Others are fitted by a line: samples were dropped where
they skip a place of it, duplicated where they stay at one; the rest of the deviation is jitter.
"""

from __future__ import annotations

from collections.abc import Iterable
from decimal import Decimal
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

_MEAN = 1e-6
"""Largest relative difference of the mean step of a record from that of the scene."""

_EVEN_STEP_TOL = 1e-3
"""Largest distance of a sample from its place, in steps."""


_UNEVEN = 0.1
"""Largest distance of a sample from its place in a record whose stamps are uneven, in steps."""

_WINDOW, _USUAL = 64, 0.25
"""Samples over which the usual step is measured; its largest relative difference from that of the scene."""

_COARSE = 0.7
"""Rounding of stamps, in steps, beyond which they show no dropped samples."""


class Clock(NamedTuple):
    """The clock of a record by its time stamps."""

    step: float  # the measured step, s: slope of the line through the stamps
    drift: float  # its relative difference from the step of the scene
    jitter: float  # root mean square of the stamps' distance from the line, s; rounding is part of it
    #: Number of places without a sample, and of samples at a place that has one already.
    dropped: int = 0
    duplicated: int = 0
    #: Place of each sample, from 0; None where each has its own and none is missing.
    rows: NDArray[np.intp] | None = None

    @property
    def summary(self) -> dict[str, float]:
        """The figures by name."""
        names = ("step", "drift", "jitter", "dropped", "duplicated")
        return {name: float(getattr(self, name)) for name in names}

    def warnings(self, noun: str = "the record") -> list[str]:
        """Return warnings of dropped and duplicated samples and of uneven stamps."""
        sentences = []
        if self.dropped:
            sentences.append(
                f"by its times {noun} has dropped {_samples(self.dropped)}: they count as missing"
            )
        if self.duplicated:
            sentences.append(
                f"by its times {noun} has {_samples(self.duplicated)} twice: one of each is used"
            )
        if self.rows is not None and self.jitter > _EVEN_STEP_TOL * self.step:
            sentences.append(
                f"the times of {noun} are uneven: {self.jitter:.2g} s RMS from even ones "
                f"({100 * self.jitter / self.step:.2g} % of a step), which acts as noise; resample: true "
                "takes the samples at their times"
            )
        return sentences


def _samples(count: int) -> str:
    return f"{count} sample{'s' * (count != 1)}"


class StepDisagreement(NamedTuple):
    """Disagreement of times with a step, and its row (from 0) if it is at one."""

    problem: str
    row: int | None = None


def printed_resolution(fields: Iterable[str]) -> NDArray[np.float64]:
    """Return the last place of each printed number, as the most precise of them are printed.

    Numbers are printed with a number of decimals or of digits, and zeros at the end may be left out; the
    most decimals and the most digits that occur are taken for the format's.
    """
    numbers = [Decimal(field) for field in fields]
    finite = [number.as_tuple() for number in numbers if number.is_finite()]
    decimals = max((-int(parts.exponent) for parts in finite), default=0)
    digits = max((len(parts.digits) for parts in finite), default=1)
    places = [number.adjusted() + 1 - digits if number.is_finite() and number else -999 for number in numbers]
    resolution: NDArray[np.float64] = 10.0 ** np.maximum(np.array(places, dtype=float), -decimals)
    return resolution


def _step_disagreement(
    times: NDArray[np.float64], step: float, resolution: NDArray[np.float64]
) -> StepDisagreement | None:
    """Return the disagreement of times, rounded to `resolution`, with a step; None where they agree."""
    rows = np.flatnonzero(~np.isnan(times))
    if len(rows) < 2:
        return None
    measured_times, counts = times[rows], np.diff(rows)
    rounding = resolution[rows] + 4 * np.spacing(np.abs(measured_times).max())
    steps = np.diff(measured_times) / counts
    usual = float(np.median(steps))
    jump = np.abs(steps - usual) * counts - _EVEN_STEP_TOL * step - np.maximum(rounding[1:], rounding[:-1])
    if np.any(jump > 0):
        row = int(np.argmax(jump > 0))
        return StepDisagreement(
            f"the time goes on by {steps[row] * counts[row]:.9g} s here, {usual:.9g} s a row elsewhere; "
            f"'step' is {step:.9g} s",
            int(rows[row + 1]),
        )
    return _drift(measured_times, rows, step, rounding)


def clock_of(
    times: NDArray[np.float64], step: float, resolution: NDArray[np.float64]
) -> Clock | StepDisagreement | None:
    """Return the clock of a record, or the disagreement of its times with its step; None of under two."""
    rows = np.flatnonzero(~np.isnan(times))
    if len(rows) < 2:
        return None
    wrong = _step_disagreement(times, step, resolution)
    if wrong is None:
        mean, away = _line(rows, times[rows])
        return Clock(mean, mean / step - 1, _rms(away))
    rounding = float(resolution.max()) + 4 * float(np.spacing(np.abs(times[rows]).max()))
    window = min(_WINDOW, len(times) - 1)
    usual = float(np.median(times[window:] - times[:-window])) / window
    typical = (usual, float(np.median(np.diff(times))))
    if (
        len(rows) < len(times)
        or np.any(np.diff(times) < 0)
        or rounding > _COARSE * step
        or min(abs(typical_step - step) for typical_step in typical) > _USUAL * step
    ):
        return wrong
    places = np.round((times - times[0]) / step).astype(np.intp)
    mean, away = _line(places, times)
    first = float((times - away - mean * places)[0])
    places = np.round((times - first) / mean).astype(np.intp)
    places -= places[0]
    mean, away = _line(places, times)
    dropped = int(places[-1] + 1 - len(np.unique(places)))
    if dropped > len(times) or float(np.abs(away).max()) > _UNEVEN * step + 0.6 * rounding:
        return wrong
    if abs(mean - step) > _MEAN * step + max(rounding, 4 * _rms(away)) / max(int(places[-1]), 1):
        return StepDisagreement(f"the times are {mean:.9g} s apart, but 'step' is {step:.9g} s")
    duplicated = len(times) - len(np.unique(places))
    return Clock(mean, mean / step - 1, _rms(away), dropped, duplicated, places)


def _line(places: NDArray[np.intp], times: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
    """Return the slope of the line of least squares through times at places, and their distances from it."""
    centred, about = places - places.mean(), times - times.mean()
    square = float(centred @ centred)
    slope = float(centred @ about) / square if square else 1.0
    return slope, about - slope * centred


def _rms(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _drift(
    times: NDArray[np.float64], rows: NDArray[np.intp], step: float, rounding: NDArray[np.float64]
) -> StepDisagreement | None:
    """Compare times, at their rows and rounded by so much, with those that lie step after step."""
    span = int(rows[-1] - rows[0])
    mean = float(times[-1] - times[0]) / span
    away = np.abs(times - times[0] - mean * (rows - rows[0]))
    # Times that are even as printed are not rounded, unless they are too few to show it.
    rounded = float(rounding.max()) if len(rows) < 4 else min(2 * float(away.max()), float(rounding.max()))
    if abs(mean - step) > _MEAN * step + rounded / span:
        return StepDisagreement(f"the times are {mean:.9g} s apart, but 'step' is {step:.9g} s")
    late = away - _EVEN_STEP_TOL * step - rounding
    if np.any(late > 0):
        row = int(np.argmax(late))
        return StepDisagreement(
            f"the times are uneven: this one lies {away[row]:.3g} s off its place; 'step' is {step:.9g} s",
            int(rows[row]),
        )
    return None
