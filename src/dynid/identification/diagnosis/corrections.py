"""Explanations of a lack of fit: what is suggested, and when; corrections of channels with their estimates.

`plain` is the likelihood of the channels as recorded, with white noise.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from dynid.arithmetic.dependent import Dependent
from dynid.arrays import Array
from dynid.identification.estimators.maximum_likelihood import refine
from dynid.identification.likelihood.lack_of_fit import ModelComparison, compare_models
from dynid.identification.likelihood.likelihood import Fit, Likelihood
from dynid.identification.likelihood.time_record import TimeRecord

#: Gain of the logarithm of the likelihood: at least, and for each channel that is corrected.
LEAST_GAIN, GAIN_EACH = 20.0, 7.0
#: Steps of an estimate, and of a first one.
STEPS, FEW_STEPS = 30, 12
#: Gain of the logarithm of the likelihood by which a step decides nothing.
LEAST_STEP_GAIN = 0.01

Places = tuple[tuple[int, int], ...]
"""Channels, each by the places of its record and of itself."""


class Correction(NamedTuple):
    """A correction of a channel: the record is `factor` times the model, `delay` samples later.

    It is recorded as the channel `column` of its record; None: as itself.
    """

    factor: float = 1.0
    delay: int = 0
    column: int | None = None

    def recorded(self, values: Array, channel: int) -> Array:
        """Return what is recorded of a channel, among the channels of its record."""
        return np.asarray(values[:, channel if self.column is None else self.column])


NONE = Correction()
Corrections = list[list[Correction]]
"""Corrections of the channels of each record."""


@dataclass(frozen=True, eq=False)
class Explanation:
    """What may explain a lack of fit: a likelihood with so many `changes`, and its fit.

    `gain`: that of the logarithm of the likelihood; `sentences`: what is suggested. `large`: it may be
    suggested if it explains the signal, though something else then contradicts the model.
    """

    gain: float
    likelihood: Likelihood
    fit: Fit
    sentences: Callable[[], Iterable[str]]
    changes: int = 1
    large: bool = False

    @property
    def explains(self) -> bool:
        """True if the likelihood grows far beyond what the choice of the changes explains."""
        return self.gain > LEAST_GAIN + GAIN_EACH * self.changes

    @cached_property
    def comparison(self) -> ModelComparison:
        """The test of the residuals."""
        return compare_models(self.likelihood, self.fit)


class Corrected(NamedTuple):
    """Corrections, and the estimate with them."""

    corrections: Corrections
    likelihood: Likelihood
    fit: Fit
    value: float


def estimated(plain: Likelihood, corrections: Corrections, eta: Array, steps: int) -> Corrected:
    """Return the estimate from corrected channels."""
    corrected_likelihood = corrected(plain, corrections)
    fit = refine(corrected_likelihood, eta, steps, least_gain=LEAST_STEP_GAIN).fit
    return Corrected(corrections, corrected_likelihood, fit, concentrated(plain, fit, corrections))


def concentrated(plain: Likelihood, fit: Fit, corrections: Corrections | None) -> float:
    """Return minus the logarithm of the concentrated likelihood of the channels as recorded."""
    total = 0.0
    for k, (record, record_fit) in enumerate(zip(plain.records, fit.parts, strict=True)):
        factors = (
            1.0
            if corrections is None
            else np.array([abs(correction.factor) for correction in corrections[k]])
        )
        size = np.maximum(record_fit.size * factors, 1e-9 * record.data.rms)
        total += float(record.data.counts @ np.log(size))
    return total


def corrected(likelihood: Likelihood, corrections: Corrections) -> Likelihood:
    """Return the likelihood of corrected channels, with white noise of unknown deviations."""
    records = []
    for record, of_channels in zip(likelihood.records, corrections, strict=True):
        values = record.data.recorded
        columns = [
            shifted(correction.recorded(values, c), -correction.delay) / correction.factor
            for c, correction in enumerate(of_channels)
        ]
        data = replace(
            record.data, values=np.column_stack(columns), noise=None, clean=None, given=None, colour=None
        )
        white = replace(record, colour=None) if isinstance(record, TimeRecord) else record
        records.append(white.on(data))
    return Likelihood(tuple(records))


def shifted(values: Array, delay: int) -> Array:
    """Return samples so much later, NaN where none are."""
    out = np.full(len(values), np.nan)
    if delay >= 0:
        out[delay:] = values[: len(values) - delay]
    else:
        out[:delay] = values[-delay:]
    return out


def gain_unknown(channel: Any) -> bool:
    """Return True if the gain of a channel depends on unknown parameters."""
    return isinstance(sensor_of(channel).gain, Dependent)


def sensor_of(channel: Any) -> Any:
    """Return a channel, of a frequency response that of its response."""
    return getattr(channel, "channel", channel)
