"""Corrections of the channels of a record, and the estimate that belongs to them."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from dynid.arrays import Array
from dynid.identification.estimators.maximum_likelihood import refine
from dynid.identification.likelihood.likelihood import Fit, Likelihood
from dynid.identification.likelihood.time_record import TimeRecord

#: Gain of the logarithm of the likelihood: at least, and for each channel that is corrected.
LEAST_GAIN, GAIN_EACH = 20.0, 7.0
#: Steps of an estimate, and of a first one.
STEPS, FEW_STEPS = 30, 12


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


class Found(NamedTuple):
    """Corrections, and the estimate with them; the standard error of the logarithm of a free gain."""

    corrections: Corrections
    likelihood: Likelihood
    fit: Fit
    value: float
    spread: float = 0.0


def estimated(
    likelihood: Likelihood, plain: Likelihood, corrections: Corrections, eta: Array, steps: int
) -> Found:
    """Return the estimate from corrected channels."""
    corrected_likelihood = corrected(likelihood, corrections)
    fit = refine(corrected_likelihood, eta, steps).fit
    return Found(corrections, corrected_likelihood, fit, concentrated(plain, fit, corrections))


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
