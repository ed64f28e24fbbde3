"""Corrections of the channels of records, and the estimates that belong to them; gains that explain a misfit.

A gain is that of a channel, or of all, which is that of the excitation. The parameters are estimated anew for
every gain, and the likelihood is that of both. With one too large a gain of the excitation all channels are
too small against the model. `plain` is the likelihood of the channels as recorded, with white noise.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from dynid.arithmetic.dependent import Dependent
from dynid.arrays import Array
from dynid.errors import DynidError
from dynid.identification.estimators.maximum_likelihood import refine
from dynid.identification.likelihood.lack_of_fit import compare_models
from dynid.identification.likelihood.likelihood import Fit, Likelihood
from dynid.identification.likelihood.time_record import TimeRecord
from dynid.lti.signals import Sampled
from dynid.number_format import with_error

#: Gain of the logarithm of the likelihood: at least, and for each channel that is corrected.
LEAST_GAIN, GAIN_EACH = 20.0, 7.0
#: Steps of an estimate, and of a first one.
STEPS, FEW_STEPS = 30, 12
# Bounds of the logarithm of a gain, and around what was found; tolerances and most steps of both searches.
_LOG_GAINS, _LOG_AROUND = (-math.log(4), math.log(4)), 0.2
_ROUGH_SEARCH: Any = {"xatol": 0.05, "maxiter": 8}
_FINE_SEARCH: Any = {"xatol": 2e-3, "maxiter": 20}
# How many of the gains that explain most are searched so far that they can be compared.
_SEARCHED_GAINS = 3
# Parabolas that are laid through its likelihood, the first over this step, the others over its deviation.
_PARABOLAS, _FIRST_LOG_STEP = 3, 0.01
# Values times states times gains beyond which no free gain is sought.
_MAX_WORK_OF_GAINS = 5e5

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


class Found(NamedTuple):
    """Corrections, and the estimate with them; the standard error of the logarithm of a free gain."""

    corrections: Corrections
    likelihood: Likelihood
    fit: Fit
    value: float
    spread: float = 0.0


def estimated(plain: Likelihood, corrections: Corrections, eta: Array, steps: int) -> Found:
    """Return the estimate from corrected channels."""
    corrected_likelihood = corrected(plain, corrections)
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


def free_gain(plain: Likelihood, eta: Array) -> Found | None:
    """Return the likeliest gain of the channels whose gain explains most; None where it may be 1.

    The residuals may not contradict the model then: of a wrong model, some gain explains most of the signal.
    """
    groups = _groups(plain)
    size = sum(record.data.values.size for record in plain.records) * max(1, plain.records[0].nuisances)
    if size * len(groups) > _MAX_WORK_OF_GAINS:
        return None
    rough: list[tuple[Places, float, Found]] = []
    for places in groups:
        with suppress(DynidError, ArithmeticError, np.linalg.LinAlgError):
            rough.append((places, *_likeliest_gain(plain, places, eta, _LOG_GAINS, _ROUGH_SEARCH)))
    fine: list[tuple[Places, float, Found]] = []
    for places, log, near in sorted(rough, key=lambda candidate: candidate[2].value)[:_SEARCHED_GAINS]:
        with suppress(DynidError, ArithmeticError, np.linalg.LinAlgError):
            around = log - _LOG_AROUND, log + _LOG_AROUND
            estimate = _likeliest_gain(plain, places, near.fit.eta, around, _FINE_SEARCH)
            fine.append((places, *estimate))
    if not fine:
        return None
    none = [[NONE] * len(record.channels) for record in plain.records]
    try:
        best = _sharpened(plain, *min(fine, key=lambda candidate: candidate[2].value))
        before = [estimated(plain, none, start, STEPS).value for start in (eta, best.fit.eta)]
    except (DynidError, ArithmeticError, np.linalg.LinAlgError):
        return None
    # The likelihood ratio of the gain and 1, the parameters estimated with either.
    if not (best.spread and min(before) - best.value > LEAST_GAIN + GAIN_EACH):
        return None
    return None if compare_models(best.likelihood, best.fit).lacks_fit else best


def _groups(plain: Likelihood) -> list[Places]:
    """Return the channels that may share a gain: all, those of a record (of its excitation), and each."""
    # Channels of unknown gains need none.
    by_record = [
        tuple((k, c) for c, channel in enumerate(record.channels) if not gain_unknown(channel))
        for k, record in enumerate(plain.records)
    ]
    channels = tuple(channel for of_record in by_record for channel in of_record)
    groups = dict.fromkeys([channels, *by_record, *((channel,) for channel in channels)])
    return [group for group in groups if group]


def gain_unknown(channel: Any) -> bool:
    """Return True if the gain of a channel depends on unknown parameters."""
    return isinstance(_sensor(channel).gain, Dependent)


def _sensor(channel: Any) -> Any:
    """Return a channel, of a frequency response that of its response."""
    return getattr(channel, "channel", channel)


def _at_gain(plain: Likelihood, places: Places, log: float, eta: Array) -> Found:
    """Return the estimate with a gain of this logarithm in some channels."""
    corrections = [[NONE] * len(record.channels) for record in plain.records]
    for k, c in places:
        corrections[k][c] = Correction(math.exp(log))
    return estimated(plain, corrections, eta, FEW_STEPS)


def _likeliest_gain(
    plain: Likelihood, places: Places, eta: Array, bounds: tuple[float, float], effort: Any
) -> tuple[float, Found]:
    """Return the logarithm of the likeliest gain, with the estimate that belongs to it."""
    # The parameters are estimated anew for every gain, so that they take of it what they can.
    from scipy.optimize import minimize_scalar

    estimates: dict[float, Found] = {}

    def value(log: float) -> float:
        near = estimates[min(estimates, key=lambda tried: abs(tried - log))].fit.eta if estimates else eta
        estimates[log] = _at_gain(plain, places, log, near)
        return estimates[log].value

    minimize_scalar(value, bounds=bounds, method="bounded", options=effort)
    return min(estimates.items(), key=lambda item: item[1].value)


def _sharpened(plain: Likelihood, places: Places, log: float, best: Found) -> Found:
    """Return the estimate at the vertex of parabolas through three likelihoods, and the gain's deviation."""
    # The deviation is 0 where the likelihood has no maximum there.
    step = _FIRST_LOG_STEP
    for _ in range(_PARABOLAS):
        less, more = (_at_gain(plain, places, log + by, best.fit.eta).value for by in (-step, step))
        curvature = (less + more - 2 * best.value) / step**2
        if not curvature > 0:
            return best._replace(spread=0.0)
        move = (less - more) / (2 * step * curvature)
        log, step = log + float(np.clip(move, -step, step)), 1 / math.sqrt(curvature)
        best = _at_gain(plain, places, log, best.fit.eta)
    return best._replace(spread=step)


def gain_sentence(plain: Likelihood, estimate: Found) -> str:
    """Return the sentence of a gain: of a channel, or of all whose gain is known, as the excitation's."""
    several = len(plain.records) > 1
    places = [
        (k, c)
        for k, corrections in enumerate(estimate.corrections)
        for c, correction in enumerate(corrections)
        if correction != NONE
    ]
    names = [f"{f'record_{k + 1}.' if several else ''}{plain.records[k].channels[c].name}" for k, c in places]
    factor = estimate.corrections[places[0][0]][places[0][1]].factor
    records = [plain.records[k] for k in dict.fromkeys(k for k, _ in places)]
    with_known_gain = sum(not gain_unknown(channel) for record in records for channel in record.channels)
    where, starts = "its channel" if len(names) == 1 else "every channel", set[float]()
    what = "a sensor"
    if len(names) == with_known_gain:
        sensors = "the sensor" if with_known_gain == 1 else "all sensors"
        what = f"the excitation, recorded {1 / factor:.3g} times as large as it is, or {sensors}"
        starts = {start for record in records for start in _starts_of_loads(record, factor)}
        where = "the excitation" if starts else where
    starts = starts or {factor * float(_sensor(plain.records[k].channels[c]).gain) for k, c in places}
    return (
        f"the lack of fit is explained where {', '.join(names)} {'are' if len(names) > 1 else 'is'} "
        f"{with_error(factor, factor * estimate.spread)} times the model: {what} out of calibration? "
        f"To estimate its gain, state gain: NAME in {where}, and parameters: {_parameters(starts)}"
    )


def _parameters(starts: set[float]) -> str:
    """Return the parameters that start at these gains."""
    names = ["NAME", *(f"NAME_{k}" for k in range(2, len(starts) + 1))]
    statements = (
        f"{name}: {{start: {start:.4g}{', scale: linear' if start < 0 else ''}}}"
        for name, start in zip(names, sorted(starts), strict=True)
    )
    return f"{{{', '.join(statements)}}}"


def _starts_of_loads(record: Any, factor: float) -> list[float]:
    """Return the known gains of the loads of a record times a factor, as a scene states them."""
    # That of a file is of what is recorded, and the inverse of that of the load. Frequency responses have
    # none.
    if not isinstance(record, TimeRecord):
        return []
    loads = [load for load in record.conditions.loads if not isinstance(load.gain, Dependent)]
    gains = [(isinstance(load.signal, Sampled), factor * float(load.gain)) for load in loads]
    return [1 / gain if of_file else gain for of_file, gain in gains]
