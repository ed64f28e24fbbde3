"""Whether the times that stand beside a record are those that a scene takes it to have."""

from __future__ import annotations

from collections.abc import Iterable
from decimal import Decimal
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

_MEAN = 1e-6
"""What the mean step of a record may differ from the scene's, relative."""

_EVEN = 1e-3
"""How far a sample may lie from its place, in steps."""


class Disagreement(NamedTuple):
    """What is wrong with times, and the row (from 0) where it shows, if at one."""

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


def step_disagreement(
    times: NDArray[np.float64], step: float, resolution: NDArray[np.float64]
) -> Disagreement | None:
    """Compare the times of a record with its step.

    Parameters
    ----------
    times
        One time a row, s; NaN where it is missing.
    step
        The step that the rows are taken to have, s.
    resolution
        The last place of each time: they are rounded to it.

    Returns
    -------
    Disagreement or None
        None where the times agree: evenly spaced to a thousandth of a step, their mean step right to a
        millionth, each beside what the times are rounded by.
    """
    rows = np.flatnonzero(~np.isnan(times))
    if len(rows) < 2:
        return None
    given, counts = times[rows], np.diff(rows)
    rounding = resolution[rows] + 4 * np.spacing(np.abs(given).max())
    steps = np.diff(given) / counts
    usual = float(np.median(steps))
    jump = np.abs(steps - usual) * counts - _EVEN * step - np.maximum(rounding[1:], rounding[:-1])
    if np.any(jump > 0):
        row = int(np.argmax(jump > 0))
        return Disagreement(
            f"the time goes on by {steps[row] * counts[row]:.9g} s here, {usual:.9g} s a row elsewhere; "
            f"'step' is {step:.9g} s",
            int(rows[row + 1]),
        )
    return _drift(given, rows, step, rounding)


def _drift(
    given: NDArray[np.float64], rows: NDArray[np.intp], step: float, rounding: NDArray[np.float64]
) -> Disagreement | None:
    """Compare times, at their rows and rounded by so much, with those that lie step after step."""
    span = int(rows[-1] - rows[0])
    mean = float(given[-1] - given[0]) / span
    away = np.abs(given - given[0] - mean * (rows - rows[0]))
    # Times that are even as printed are not rounded, unless they are too few to show it.
    rounded = float(rounding.max()) if len(rows) < 4 else min(2 * float(away.max()), float(rounding.max()))
    if abs(mean - step) > _MEAN * step + rounded / span:
        return Disagreement(f"the times are {mean:.9g} s apart, but 'step' is {step:.9g} s")
    late = away - _EVEN * step - rounding
    if np.any(late > 0):
        row = int(np.argmax(late))
        return Disagreement(
            f"the times are uneven: this one lies {away[row]:.3g} s off its place; 'step' is {step:.9g} s",
            int(rows[row]),
        )
    return None
