"""Mistakes of instruments that explain a lack of fit: factors of units, signs, delays, exchanged channels.

A record of a wrong unit, a reversed sensor, two exchanged sensors, or instruments that started at different
samples does not fit the model, or fits it with wrong parameters. Each channel is compared with the
prediction: the delay of the largest correlation, and the factor among ±1, g, 1/g, 1000, 1/1000 that is
nearest to the ratio of their RMS; of an unknown gain, which takes any, none. The parameters are estimated
again from the corrected channels, in turn, until the corrections stay the same: a search for the greatest
concentrated likelihood over parameters and corrections. It starts from the estimate, from the start, and from
the start with one mistake in all channels, or in all of one quantity, with one reversed channel, or with two
exchanged channels of one quantity and unit. Where all that explains nothing, one more unknown is estimated:
a gain, the corner of a filter, or the mass of a sensor (`instrument_unknowns`); of frequency responses, the
other kind of damping is tried first (`damping_kinds`).

Anything is suggested only where the model lacked fit, the likelihood grows far beyond what the choice
explains, every corrected channel needs its own, and the record then fits.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from functools import partial
from itertools import combinations

import numpy as np

from dynid.arrays import Array
from dynid.errors import DynidError
from dynid.identification.diagnosis.corrections import (
    FEW_STEPS,
    NONE,
    STEPS,
    Corrected,
    Correction,
    Corrections,
    Explanation,
    concentrated,
    corrected,
    estimated,
    gain_unknown,
    shifted,
)
from dynid.identification.likelihood.frf_record import FrfLikelihood, FrfRecord
from dynid.identification.likelihood.likelihood import Fit, Likelihood
from dynid.identification.likelihood.time_record import TimeRecord
from dynid.identification.systems.band_limited_system import BAND_FACTOR
from dynid.units import GRAVITY

_COMMON = (-1.0, GRAVITY, 1 / GRAVITY, 1000.0, 1e-3)
_FACTORS = np.array([sign * one for sign in (1, -1) for one in (1, GRAVITY, 1 / GRAVITY, 1000, 1e-3)])
# The longest delay that is tried, in samples and as a part of the record; delays tried for all channels.
_MAX_DELAY_SAMPLES, _MAX_DELAY_SHARE, _COMMON_DELAYS = 20, 0.1, (1, -1, 2, -2, 3, -3)
# A channel whose square of the correlation with the prediction is less is left as it is.
_MIN_SQUARED_CORRELATION = 0.2
# Rounds of corrections and estimates.
_CORRECTION_ROUNDS = 6
# First steps of the searches from common mistakes, and how many of these, the likeliest, are followed.
_FIRST_STEPS, _MAX_FOLLOWED = 4, 6
# How many times smaller the mean square of a corrected channel's residual is than without its correction.
_SQUARE_RATIO = 2.0
# Multiplications of one evaluation of frequency responses beyond which nothing is searched.
_MAX_SEARCH_WORK = 3e7
# Values times states beyond which only the estimate and the start are searched from.
_MAX_SEARCH_SIZE = 2e5
# Channels beyond which a single reversed one is not searched for; pairs beyond which no exchanged ones are.
_MAX_REVERSED_CHANNELS, _MAX_EXCHANGED_PAIRS = 12, 30


def instrument_mistakes(likelihood: Likelihood, etas: Sequence[Array]) -> list[str]:
    """Return suggestions of corrections that explain what the model does not; none where none does.

    `likelihood`: records that the model does not explain; `etas`: coordinates of the parameters (p) to
    search from: the estimate, if there is one, and the start.
    """
    records = likelihood.records
    for record in records:
        if not isinstance(record, TimeRecord | FrfRecord) or record.data.robust is not None:
            return []
        if isinstance(record, FrfRecord) and (
            record.measurement.proportional or record.multiplications > _MAX_SEARCH_WORK
        ):
            return []
    second: Explanation | None = None  # one that explains the signal, where the residuals still contradict
    for explanation in _explanations(likelihood, etas):
        if not explanation.explains:
            continue
        if not explanation.comparison.lacks_fit:
            return list(explanation.sentences())
        if second is None and explanation.large and explanation.comparison.explained:
            second = explanation
    return [] if second is None else list(second.sentences())


def _explanations(likelihood: Likelihood, etas: Sequence[Array]) -> Iterator[Explanation]:
    """Yield what may explain a lack of fit: corrections of channels, then one more unknown."""
    if isinstance(likelihood, FrfLikelihood):
        from dynid.identification.diagnosis.damping_kinds import other_damping  # of responses alone

        yield from other_damping(likelihood, etas[0])
        likelihood = likelihood.band_limited(BAND_FACTOR) or likelihood
    plain = corrected(likelihood, [[NONE] * record.data.values.shape[1] for record in likelihood.records])
    try:
        before = concentrated(plain, plain.fit(etas[0]), None)
    except (DynidError, ArithmeticError, np.linalg.LinAlgError):
        before = math.inf
    predicted = [estimate for eta in etas if (estimate := _search(plain, eta)) is not None]
    if predicted:
        yield from _explained(plain, min(predicted, key=lambda estimate: estimate.value), before)
    if (common := _from_common_mistakes(plain, etas[-1])) is not None:
        yield from _explained(plain, common, before)
    from dynid.identification.diagnosis.instrument_unknowns import instrument_unknowns  # of a misfit alone

    yield from instrument_unknowns(plain, etas)


def _search(plain: Likelihood, eta: Array, first: Corrections | None = None) -> Corrected | None:
    """Return corrections and estimate that belong to each other; None where the estimate fails."""
    # The `first` corrections are those of the prediction at `eta` where none are given.
    try:
        corrections = first
        if corrections is None:
            none = [[NONE] * record.data.values.shape[1] for record in plain.records]
            corrections = _chosen(plain, plain.fit(eta), none)
        for _ in range(_CORRECTION_ROUNDS):
            estimate = estimated(plain, corrections, eta, STEPS)
            new = _chosen(plain, estimate.fit, corrections)
            if new == corrections:
                return estimate
            corrections, eta = new, estimate.fit.eta
    except (DynidError, ArithmeticError, np.linalg.LinAlgError):
        pass  # parameters that run away explain nothing
    return None


def _from_common_mistakes(plain: Likelihood, eta: Array) -> Corrected | None:
    """Return the best of the searches that start with one mistake in all channels, a quantity, or a sign."""
    if (
        sum(record.data.values.size for record in plain.records) * plain.records[0].nuisances
        > _MAX_SEARCH_SIZE
    ):
        return None
    quantities = [
        [str(getattr(channel, "quantity", "")) for channel in record.channels] for record in plain.records
    ]
    kinds = sorted({quantity for of_record in quantities for quantity in of_record})
    mistakes = [Correction(factor) for factor in _COMMON]
    tried = [
        [[mistake if kind in ("", quantity) else NONE for quantity in of_record] for of_record in quantities]
        for kind in ["", *(kinds if len(kinds) > 1 else [])]
        for mistake in mistakes
    ]
    if all(record.sampling_step is not None for record in plain.records):
        tried += [
            [[Correction(1.0, delay)] * len(of_record) for of_record in quantities]
            for delay in _COMMON_DELAYS
        ]
    # One reversed sensor: far from the estimate, no prediction shows its sign.
    channels = [(k, c) for k, of_record in enumerate(quantities) for c in range(len(of_record))]
    if 1 < len(channels) <= _MAX_REVERSED_CHANNELS:
        tried += [
            [
                [Correction(-1.0) if (k, c) == channel else NONE for c in range(len(of_record))]
                for k, of_record in enumerate(quantities)
            ]
            for channel in channels
        ]
    tried += _exchanges(plain)
    possible = _factors(plain)
    tried = [
        [
            [
                correction if correction.factor in factors else NONE
                for correction, factors in zip(of_record, allowed, strict=True)
            ]
            for of_record, allowed in zip(corrections, possible, strict=True)
        ]
        for corrections in tried
    ]
    begun = _estimates(plain, [(corrections, eta) for corrections in tried], _FIRST_STEPS)
    likeliest = sorted(begun, key=lambda estimate: estimate.value)[:_MAX_FOLLOWED]
    followed = [(estimate.corrections, estimate.fit.eta) for estimate in likeliest]
    estimates = _estimates(plain, followed, FEW_STEPS - _FIRST_STEPS)
    best = min(estimates, key=lambda estimate: estimate.value, default=None)
    return None if best is None else _search(plain, best.fit.eta, best.corrections)


def _estimates(
    plain: Likelihood, starts: Sequence[tuple[Corrections, Array]], steps: int
) -> Iterator[Corrected]:
    """Yield the estimates from corrections and coordinates (p), as far as there are any."""
    for corrections, eta in starts:
        with suppress(DynidError, ArithmeticError, np.linalg.LinAlgError):
            yield estimated(plain, corrections, eta, steps)


def _exchanges(plain: Likelihood) -> list[Corrections]:
    """Return the corrections of two exchanged channels of one record, quantity and unit."""
    pairs = [
        (k, a, b)
        for k, record in enumerate(plain.records)
        for (a, first), (b, second) in combinations(enumerate(record.channels), 2)
        if getattr(first, "quantity", "") == getattr(second, "quantity", "") and first.unit == second.unit
    ]
    if len(pairs) > _MAX_EXCHANGED_PAIRS:
        return []
    exchanges = []
    for k, a, b in pairs:
        corrections = [[NONE] * len(record.channels) for record in plain.records]
        corrections[k][a], corrections[k][b] = Correction(column=b), Correction(column=a)
        exchanges.append(corrections)
    return exchanges


def _chosen(plain: Likelihood, fit: Fit, now: Corrections) -> Corrections:
    """Return the correction of each channel that a prediction suggests; exchanged channels stay so."""
    return [
        [
            _best(
                correction.recorded(record.data.values, c),
                record_fit.predicted.outputs[:, c],
                factors,
                record.sampling_step is not None,
            )._replace(column=correction.column)
            for c, (correction, factors) in enumerate(zip(of_channels, possible, strict=True))
        ]
        for record, record_fit, of_channels, possible in zip(
            plain.records, fit.parts, now, _factors(plain), strict=True
        )
    ]


def _factors(plain: Likelihood) -> list[list[Array]]:
    """Return the factors that each channel of each record may have."""
    return [
        [np.ones(1) if gain_unknown(channel) else _FACTORS for channel in record.channels]
        for record in plain.records
    ]


def _best(recorded: Array, predicted: Array, factors: Array, in_time: bool) -> Correction:
    """Return delay and factor of a channel against its prediction; responses have no delay in samples."""
    max_delay = min(_MAX_DELAY_SAMPLES, int(_MAX_DELAY_SHARE * len(recorded))) if in_time else 0
    # Relative to the largest values, so that no square overflows.
    largest = (
        float(np.nanmax(np.abs(recorded), initial=0.0)),
        float(np.nanmax(np.abs(predicted), initial=0.0)),
    )
    if not (0 < largest[0] < math.inf and 0 < largest[1] < math.inf):
        return NONE
    recorded, predicted = recorded / largest[0], predicted / largest[1]
    squares: dict[int, float] = {}
    ratios: dict[int, float] = {}
    for delay in sorted(range(-max_delay, max_delay + 1), key=abs):
        later = shifted(predicted, delay)
        both = ~(np.isnan(recorded) | np.isnan(later))
        z, y = recorded[both], later[both]
        zz, yy, zy = float(z @ z), float(y @ y), float(z @ y)
        if zz > 0 and yy > 0:
            squares[delay] = zy * zy / (zz * yy)
            ratios[delay] = math.copysign(math.sqrt(zz / yy), zy) * (largest[0] / largest[1])
    if not squares or max(squares.values()) < _MIN_SQUARED_CORRELATION:
        return NONE
    left = 1 - max(squares.values())
    # The shortest of the delays that are nearly as good, as those of periodic signals are.
    delay = next(candidate for candidate, square in squares.items() if 1 - square <= 1.05 * left + 1e-9)
    ratio = ratios[delay]
    alike = factors[np.sign(factors) == np.sign(ratio)]
    if not alike.size:
        return NONE
    return Correction(float(alike[int(np.argmin(np.abs(np.log(np.abs(alike / ratio)))))]), delay)


def _explained(plain: Likelihood, estimate: Corrected, before: float) -> Iterator[Explanation]:
    """Yield what corrections explain, if there are any and each of them is needed."""
    changed = sum(correction != NONE for of_channels in estimate.corrections for correction in of_channels)
    for record, record_fit, of_channels in zip(
        plain.records, estimate.fit.parts, estimate.corrections, strict=True
    ):
        for c, correction in enumerate(of_channels):
            uncorrected = record.data.values[:, c] - record_fit.predicted.outputs[:, c]
            min_square = _SQUARE_RATIO * (record_fit.size[c] * correction.factor) ** 2
            if correction != NONE and not float(np.nanmean(uncorrected**2)) > min_square:
                return
    if changed:
        yield Explanation(
            before - estimate.value,
            estimate.likelihood,
            estimate.fit,
            partial(_sentences, plain, estimate),
            changed,
            large=True,
        )


def _sentences(plain: Likelihood, estimate: Corrected) -> Iterator[str]:
    """Yield one sentence for each kind of correction; delays of records at different steps are different."""
    several = len(plain.records) > 1
    places: dict[tuple[Correction, float], list[str]] = {}
    channels = 0
    for k, (record, of_channels) in enumerate(zip(plain.records, estimate.corrections, strict=True), 1):
        prefix = f"record_{k}." if several else ""
        for index, (channel, correction) in enumerate(zip(record.channels, of_channels, strict=True)):
            step = (record.sampling_step or 0.0) if correction.delay else 0.0
            places.setdefault((correction._replace(column=None), step), []).append(f"{prefix}{channel.name}")
            channels += 1
            if correction.column is not None and index < correction.column:
                both = f"{prefix}{channel.name} and {prefix}{record.channels[correction.column].name}"
                yield (
                    f"the lack of fit is explained where {both} are exchanged: exchanged cables, or columns "
                    "of the file in another order (columns)?"
                )
    for (correction, step), names in places.items():
        if correction == NONE:
            continue
        parts = []
        if correction.factor != 1:
            parts.append(f"{correction.factor:.6g} times the model")
        if correction.delay:
            early = "later" if correction.delay > 0 else "earlier"
            count = abs(correction.delay)
            parts.append(f"{count} sample{'s' * (count != 1)} ({count * step:.4g} s) {early} than the model")
        subject = f"{', '.join(names)} {'are' if len(names) > 1 else 'is'}"
        all_channels = len(names) == channels
        remedy = _remedy(correction, step, all_channels)
        yield f"the lack of fit is explained where {subject} {' and '.join(parts)}: {remedy}"


def _remedy(correction: Correction, step: float, all_channels: bool) -> str:
    """Return what may be wrong, and the key that corrects it."""
    hints = []
    if correction.factor < 0:
        hints.append("a reversed sensor (gain: -1)?")
    size = abs(correction.factor)
    if size == 1 / GRAVITY:
        hints.append("recorded in g (unit: g)?")
    elif size == GRAVITY:
        hints.append("recorded in m/s2, and taken for g?")
    elif size != 1:
        hints.append("a unit that is a thousand times another one (unit)?")
    if correction.delay:
        hints.append(f"another start of its instrument (delay: {correction.delay * step:.6g})?")
    if all_channels:
        inverse = f" (of a file: delay: {-correction.delay * step:.6g})" if correction.delay else ""
        hints.append(f"Or all of them are right, and the excitation has the inverse mistake{inverse}")
    return " ".join(hints)
