"""What measured inputs do between their samples, tested against the record.

An input of a file is a cubic spline between its samples unless the scene states another hold. One that a
digital source held, or that a simulation joined by lines, moves the structure otherwise near the Nyquist
frequency: a fit with a wrong hold may converge, with a damping that is off by standard errors. The parameters
are estimated with every other hold, from the estimate.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from dynid.arrays import Array
from dynid.errors import DynidError
from dynid.identification.diagnosis.corrections import Explanation
from dynid.identification.diagnosis.equivalent_optima import DECIDED
from dynid.identification.diagnosis.posterior import Posterior
from dynid.identification.estimators.maximum_likelihood import refine
from dynid.identification.likelihood.likelihood import Likelihood
from dynid.identification.likelihood.time_record import TimeRecord
from dynid.identification.records.measurement import sampled_loads
from dynid.identification.systems.parametric_model import model_of_system
from dynid.lti.noise import HOLDS
from dynid.lti.signals import Derivative, Sampled, Signal

# Gain of the logarithm of the likelihood from which another hold is suggested: where the stated one is right,
# a likelihood ratio beyond e^x has a probability of e^-x at the most (Markov's inequality), here 5e-5.
_LEAST_GAIN = 10.0
# Shift, standard errors, from which a hold is named that the record does not exclude: beyond the interval.
_UNDECIDED_SHIFT = 2.0
# Steps of an estimate with another hold, which lies a few standard errors away.
_STEPS = 8
# Values times states beyond which nothing is tried.
_MAX_SIZE = 2e7
# Least shift of a parameter that is named, standard errors; the most parameters that are.
_LEAST_SHIFT, _MOST_NAMED = 0.1, 3
_BETWEEN = {
    "spline": "a smooth curve between its samples",
    "linear": "linear between its samples",
    "zero": "constant until the next sample",
}


@dataclass(frozen=True, eq=False, kw_only=True)
class OtherHold(Explanation):
    """The likelihood with another hold of the inputs than the stated one, and its estimate."""

    undecided: str  # the sentence where the record does not decide between both
    largest_shift: float  # of the estimates (p), in standard errors


def better_hold(posterior: Posterior) -> list[str]:
    """Return a sentence on the hold with which the records fit and are far likelier, else would move.

    Empty where every other hold is far less likely, or moves nothing.
    """
    holds = sorted(_other_holds(posterior.likelihood, posterior.fit.eta), key=lambda hold: -hold.gain)
    if holds and holds[0].gain > _LEAST_GAIN and not holds[0].comparison.lacks_fit:
        return list(holds[0].sentences())
    if posterior.comparison.lacks_fit:
        return []
    return [
        hold.undecided for hold in holds if hold.gain > -DECIDED and hold.largest_shift > _UNDECIDED_SHIFT
    ][:1]


def _other_holds(likelihood: Likelihood, eta: Array) -> Iterator[OtherHold]:
    """Yield the likelihood with every other hold of the inputs of files, and its estimate from `eta` (p)."""
    records = [record for record in likelihood.records if isinstance(record, TimeRecord)]
    stated = [load.signal.hold for record in records for load in record.conditions.loads if _of_file(load)]
    size = sum(record.data.values.size * max(1, record.nuisances) for record in records)
    if not stated or size > _MAX_SIZE or any(record.data.robust is not None for record in records):
        return
    with suppress(DynidError, ArithmeticError, np.linalg.LinAlgError):
        fit = refine(likelihood, eta, _STEPS).fit
        deviations = likelihood.information(fit, likelihood.likeliest(fit)).deviations()
        for hold in HOLDS:
            if set(stated) == {hold}:
                continue
            with suppress(DynidError, ArithmeticError, np.linalg.LinAlgError):  # of motions not smooth enough
                other = replace(
                    likelihood, records=tuple(_with(record, hold) for record in likelihood.records)
                )
                moved = refine(other, fit.eta, _STEPS).fit
                gain = likelihood.misfit(fit) - other.misfit(moved)
                shifts = (moved.eta - fit.eta) / deviations
                likelier, undecided = _sentences(likelihood.names, stated, hold, gain, shifts)
                yield OtherHold(
                    gain,
                    other,
                    moved,
                    partial(iter, (likelier,)),
                    undecided=undecided,
                    largest_shift=float(np.abs(shifts).max()),
                )


def _of_file(load: Any) -> bool:
    return isinstance(load.signal, Sampled)


def _with(record: Any, hold: str) -> Any:
    """Return a record whose inputs of files have another hold."""
    if not isinstance(record, TimeRecord):
        return record
    loads = sampled_loads(record.conditions.loads, record.conditions.measurement.record)
    system = copy.copy(record.model.system)
    system.signals = [
        _held(signal, hold) if _of_file(load) else signal
        for signal, load in zip(system.signals, record.conditions.loads, strict=True)
    ]
    return replace(record, model=model_of_system(system, loads, record.channels, record.model.times))


def _held(signal: Signal, hold: str) -> Signal:
    if isinstance(signal, Derivative):  # of a prescribed motion
        return replace(signal, signal=_held(signal.signal, hold))
    return replace(signal, hold=hold) if isinstance(signal, Sampled) else signal


def _sentences(
    names: Sequence[str], stated: Sequence[str], hold: str, gain: float, shifts: Array
) -> tuple[str, str]:
    """Return what is said where the record is likelier with a hold, and where it does not decide."""
    moves = [
        f"{names[k]} moves by {shifts[k]:+.2g} standard errors"
        for k in np.argsort(-np.abs(shifts))[:_MOST_NAMED]
        if abs(shifts[k]) > _LEAST_SHIFT
    ]
    moved = ", ".join(moves) or "no parameter moves"
    return (
        f"the record is far likelier where its excitation is {_BETWEEN[hold]} than with hold: "
        f"{' and '.join(sorted(set(stated)))} (logarithm of the likelihood {gain:+.3g}); with it {moved}: "
        f"state hold: {hold} in its excitation",
        f"the record does not decide whether its excitation is {_BETWEEN[hold]} (hold: {hold}, logarithm of "
        f"the likelihood {gain:+.2g}): with it {moved}, which the intervals do not include; state the "
        "hold of its source in its excitation",
    )
