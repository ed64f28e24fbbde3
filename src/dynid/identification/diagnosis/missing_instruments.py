"""Filters and masses of sensors that a scene does not state, and that explain a lack of fit.

AC coupling and anti-alias filters act on all channels, on those of one quantity, or on one; the mass of a
sensor acts on the structure where it stands. Each candidate is one more unknown: the corner of a filter, or a
mass. Corners of a grid are compared at the estimate, the likeliest candidates are estimated with all
parameters, and one is suggested only where the likelihood grows far beyond what the choice explains, and its
residuals do not contradict the model.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from dynid.arithmetic.dependent import Dependent
from dynid.arrays import Array
from dynid.errors import DynidError
from dynid.identification.diagnosis.corrections import GAIN_EACH, LEAST_GAIN, STEPS
from dynid.identification.estimators.maximum_likelihood import refine
from dynid.identification.likelihood.frf_record import FrfRecord
from dynid.identification.likelihood.lack_of_fit import compare_models
from dynid.identification.likelihood.likelihood import Likelihood
from dynid.identification.likelihood.time_record import TimeRecord
from dynid.identification.records.measurement import sampled_loads
from dynid.identification.systems.filtered_system import FilteredSystem
from dynid.identification.systems.instruments import Instruments
from dynid.identification.systems.linear_system import LinearSystem
from dynid.identification.systems.parametric_model import model_of_system, system_of
from dynid.identification.systems.structure_system import StructureSystem
from dynid.lti.filters import Filter, Kind, Shape
from dynid.number_format import frequency_text, quantity
from dynid.parameters import Parameter
from dynid.structure.ports import Channel
from dynid.structure.sensor_masses import with_sensor_masses

# Corners that are tried, from the first to the last frequency of the data.
_CORNERS = 5
# Shapes and orders of filters that are tried: those of usual couplings and anti-alias filters.
_FILTERS: tuple[tuple[Kind, Shape, tuple[int, ...]], ...] = (
    ("high_pass", "butterworth", (1, 2, 3, 4)),
    ("low_pass", "butterworth", (1, 2, 3, 4, 6, 8)),
    ("low_pass", "bessel", (2, 4)),
)
# Of one channel or quantity alone, up to this order.
_MAX_PARTIAL_ORDER = 2
# Sensors beyond which a mass or filter of one alone is not sought; the candidates that are estimated.
_MAX_SINGLE_CHANNELS, _ESTIMATED = 6, 5
# First guess of the mass of a sensor, kg: that of a common accelerometer with its base.
_SENSOR_MASS = 0.02
# Values times states beyond which nothing is sought.
_MAX_SIZE = 2e5

_NAMES = {"high_pass": "AC coupling", "low_pass": "an anti-alias filter"}


class _Candidate(NamedTuple):
    """One more unknown: `system` returns a record's system with it; `text` says what it is at a value.

    `starts`: values from which it is estimated; `states`: the states that it adds.
    """

    system: Callable[[LinearSystem, Sequence[Any], Sequence[Any]], LinearSystem]
    starts: Sequence[float]
    text: Callable[[float, float], str]
    states: int = 0


def missing_instruments(plain: Likelihood, etas: Sequence[Array]) -> list[str]:
    """Return the filter or the mass of a sensor that explains what the model does not; none if none does.

    `plain`: records with white noise of unknown deviations; `etas`: coordinates of the parameters (p) to
    start from.
    """
    size = sum(record.data.values.size * max(1, record.nuisances) for record in plain.records)
    if size > _MAX_SIZE or any(map(_has_filters, plain.records)):
        return []
    before, values = plain.misfit(plain.fit(etas[0])), sum(int(r.data.counts.sum()) for r in plain.records)
    tried: dict[tuple[bool, int], list[tuple[float, _Candidate, Likelihood, Array]]] = {}
    for candidate in _candidates(plain):
        with suppress(DynidError, ArithmeticError, np.linalg.LinAlgError):  # then it explains nothing
            other = _with(plain, candidate)
            for number, eta in enumerate(etas):
                origins = [np.append(eta, math.log(start)) for start in candidate.starts]
                misfits = [other.misfit_at(origin) for origin in origins]
                k = int(np.argmin(misfits))
                found = misfits[k], candidate, other, origins[k]
                tried.setdefault((candidate.states > 0, number), []).append(found)
    best: tuple[float, str] | None = None
    likeliest = [sorted(found, key=lambda item: item[0])[:_ESTIMATED] for found in tried.values()]
    for _, candidate, other, origin in (item for found in likeliest for item in found):
        with suppress(DynidError, ArithmeticError, np.linalg.LinAlgError):
            fit = refine(other, origin, STEPS).fit
            # Initial states of filters are free: a state counts as one more unknown (Schwarz).
            value = other.misfit(fit) + candidate.states * math.log(values) / 2
            if best is not None and value >= best[0]:
                continue
            if before - value > LEAST_GAIN + GAIN_EACH and not compare_models(other, fit).lacks_fit:
                deviation = float(other.information(fit, other.likeliest(fit)).deviations()[-1])
                unknown = math.exp(float(fit.eta[-1]))
                best = value, candidate.text(unknown, unknown * deviation)
    return [] if best is None else [best[1]]


def _has_filters(record: Any) -> bool:
    """Return True where a channel has a stated filter already, or no filter is sought behind the model."""
    if not isinstance(record, TimeRecord | FrfRecord):
        return True
    model = getattr(record.system_model, "model", None)
    if getattr(model, "nonlinear", False):  # whose laws no linear system has
        return True
    channels: Any = record.channels
    return any(getattr(channel, "channel", channel).filters for channel in channels)


def _candidates(plain: Likelihood) -> Iterator[_Candidate]:
    """Yield filters of all channels, of a quantity or of one, and masses of sensors."""
    channels = list(dict.fromkeys(channel for record in plain.records for channel in _channels(record)))
    quantities = {channel.quantity for channel in channels}
    sets = [channels]
    if len(quantities) > 1:
        sets += [[channel for channel in channels if channel.quantity == kind] for kind in sorted(quantities)]
    if 1 < len(channels) <= _MAX_SINGLE_CHANNELS:
        sets += [[channel] for channel in channels if [channel] not in sets]
    low, high = _band(plain)
    for chosen in sets:
        for kind, shape, orders in _FILTERS:
            for order in orders:
                if order <= _MAX_PARTIAL_ORDER or chosen is channels:
                    stated = Filter(kind, math.sqrt(low * high), order, shape)
                    yield _filter(chosen, stated, np.geomspace(low, high, _CORNERS).tolist(), len(channels))
    for channel in channels if len(channels) <= _MAX_SINGLE_CHANNELS else ():
        if isinstance(channel, Channel) and channel.reference is None:
            yield _mass(channel)


def _channels(record: Any) -> Sequence[Any]:
    """Return the distinct channels of a record, of responses in the order of their system."""
    return list(dict.fromkeys(getattr(channel, "channel", channel) for channel in record.channels))


def _band(plain: Likelihood) -> tuple[float, float]:
    """Return the frequencies, rad/s, between which corners are tried."""
    ends = []
    for record in plain.records:
        if isinstance(record, FrfRecord):
            omega = record.measurement.omega
            ends.append((float(omega[omega > 0][0]) / 3, float(omega[-1])))
        else:
            step = float(record.sampling_step or 1.0)
            ends.append((4 * math.pi / (step * len(record.data.values)), 0.9 * math.pi / step))
    return min(low for low, _ in ends), max(high for _, high in ends)


def _filter(chosen: Sequence[Any], stated: Filter, corners: Sequence[float], count: int) -> _Candidate:
    key, corner = f"corner of {', '.join(channel.name for channel in chosen)}", float(stated.frequency)
    unknown, kind, order = Parameter(key, corner), stated.kind, stated.order
    item = replace(stated, frequency=Dependent.parameter(key, corner))

    def system(system: LinearSystem, channels: Sequence[Any], _: Sequence[Any]) -> LinearSystem:
        filters = [(item,) if channel in chosen else () for channel in channels]
        return FilteredSystem(system, channels, filters, [unknown])

    def text(value: float, deviation: float) -> str:
        names = "all channels" if len(chosen) == count > 1 else ", ".join(channel.name for channel in chosen)
        passes = "pass" if len(chosen) > 1 else "passes"
        hertz = quantity(value / (2 * math.pi), deviation / (2 * math.pi) or None)
        return (
            f"the lack of fit is explained where {names} {passes} a {kind.replace('_', '-')} filter of order "
            f"{order} at {frequency_text(value, 4)}: {_NAMES[kind]}? State {kind}: {{frequency: {hertz}, "
            f"order: {order}{', type: bessel' * (item.shape == 'bessel')}, unit: Hz}}, or the name of an "
            "unknown parameter as its frequency"
        )

    return _Candidate(system, corners, text, order * len(chosen))


def _mass(channel: Channel) -> _Candidate:
    unknown = Parameter(f"mass at {channel.dof}", _SENSOR_MASS, unit="kg")

    def system(system: LinearSystem, channels: Sequence[Any], loads: Sequence[Any]) -> LinearSystem:
        assert isinstance(system, StructureSystem)
        model = system.model.with_parameters((*system.model.parameters, unknown))
        mass = Dependent.parameter(unknown.name, unknown.start)
        return system_of(with_sensor_masses(model, {channel.dof: mass}), loads, channels)

    def text(value: float, deviation: float) -> str:
        mass = quantity(value, deviation or None)
        return (
            f"the lack of fit is explained where a mass of {mass} kg moves with DOF {channel.dof}: "
            f"that of the sensor {channel.name}? State mass: {mass} in its channel"
        )

    return _Candidate(system, [_SENSOR_MASS], text)


def _with(plain: Likelihood, candidate: _Candidate) -> Likelihood:
    """Return the likelihood with one more unknown."""
    records: list[Any] = []
    for record in plain.records:
        channels = _channels(record)
        if isinstance(record, TimeRecord):
            conditions = record.conditions
            loads = sampled_loads(conditions.loads, conditions.measurement.record)
            system = candidate.system(record.model.system, channels, loads)
            model = model_of_system(system, loads, channels, record.model.times)
            records.append(replace(record, model=model))
        else:
            assert isinstance(record, FrfRecord)
            loads = list(dict.fromkeys(function.load for function in record.system.functions))
            system = candidate.system(record.system.system, channels, loads)
            names = [unknown.name for unknown in system.unknowns]
            instruments = Instruments.of(
                names, (), [function.channel for function in record.system.functions]
            )
            of_record = replace(record.system, system=system, instruments=instruments)
            records.append(replace(record, system=of_record))
    return Likelihood(tuple(records))
