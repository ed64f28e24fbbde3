"""Gains, filters, integrators and masses of sensors that a scene does not state, each as one more unknown.

A gain is that of a channel, or of all, which is that of the excitation; AC coupling, anti-alias filters and
integrators act on all channels, on those of one quantity, or on one; the mass of a sensor acts on the
structure where it stands. Of each kind the likeliest start is estimated with all parameters in a few steps,
from the estimate, and from the scene's start where that explains nothing. The likeliest kinds are estimated
in full, in all orders and shapes where the first of these explains anything. What acts on all channels comes
first; a single one is blamed where nothing common explains the records.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from dynid.arithmetic.dependent import Dependent
from dynid.arrays import Array
from dynid.errors import DynidError
from dynid.identification.diagnosis.corrections import (
    LEAST_GAIN,
    LEAST_STEP_GAIN,
    STEPS,
    Explanation,
    Places,
    gain_unknown,
    sensor_of,
)
from dynid.identification.estimators.maximum_likelihood import refine
from dynid.identification.likelihood.frf_record import FrfRecord
from dynid.identification.likelihood.lack_of_fit import compare_models
from dynid.identification.likelihood.likelihood import Fit, Likelihood
from dynid.identification.likelihood.time_record import TimeRecord
from dynid.identification.records.measurement import sampled_loads
from dynid.identification.systems.filtered_system import FilteredSystem
from dynid.identification.systems.instruments import Instruments
from dynid.identification.systems.linear_system import LinearSystem
from dynid.identification.systems.parametric_model import model_of_system, system_of
from dynid.identification.systems.structure_system import StructureSystem
from dynid.lti.filters import Filter, Kind, Shape
from dynid.lti.signals import Sampled
from dynid.number_format import frequency_text, quantity, with_error
from dynid.parameters import Parameter
from dynid.structure.ports import Channel
from dynid.structure.sensor_masses import with_sensor_masses

# Shapes and orders of filters, those of usual couplings, anti-alias filters and vibration meters; of each
# kind the first is tried first.
_FILTERS: dict[Kind, tuple[tuple[Shape, int], ...]] = {
    "high_pass": tuple(("butterworth", order) for order in (2, 1, 3, 4)),
    "low_pass": (
        *(("butterworth", order) for order in (2, 1, 3, 4, 6, 8)),
        *(("bessel", order) for order in (2, 3, 4)),
    ),
    "integrator": (("butterworth", 1), ("butterworth", 2)),
}
# Of one channel or quantity alone, up to this order.
_MAX_PARTIAL_ORDER = 4
# Corners that are tried, from the first to the last frequency of the data; factors of gains.
_CORNERS, _GAINS = 5, (0.5, 0.8, 1.25, 2.0)
# Steps of a first estimate; kinds of what is common, or of single channels, that are estimated in full.
_FIRST_STEPS, _ESTIMATED_KINDS = 8, 2
# Sensors beyond which a mass or filter of one alone is not sought.
_MAX_SINGLE_CHANNELS = 6
# First guess of the mass of a sensor, kg: that of a common accelerometer with its base.
_SENSOR_MASS = 0.02
# Values times states beyond which nothing is sought.
_MAX_SIZE = 2e5
# A corner of an integrator below so many standard errors is none.
_IDEAL_DEVIATIONS = 3.0

_NAMES = {
    "high_pass": "AC coupling",
    "low_pass": "an anti-alias filter",
    "integrator": "a vibration meter, or another quantity than is stated",
}


class _Unknown(NamedTuple):
    """One more unknown of a model.

    `starts`: values from which it is estimated; `channels`: those that it changes, by `filters` or a gain;
    `dof`: where it is a mass. `text` says what it is at a value with its standard error.
    """

    parameter: Parameter
    starts: Sequence[float]
    text: Callable[[float, float], str]
    channels: Places = ()
    filters: tuple[Filter, ...] = ()
    is_gain: bool = False
    dof: Any = None

    @property
    def states(self) -> int:
        """The states that it adds."""
        return len(self.channels) * sum(item.order for item in self.filters)


class _Estimate(NamedTuple):
    """An unknown with the likelihood that has it, and a fit of all parameters."""

    value: float
    unknown: _Unknown
    likelihood: Likelihood
    fit: Fit


def instrument_unknowns(plain: Likelihood, etas: Sequence[Array]) -> Iterator[Explanation]:
    """Yield the likeliest gain, filter, integrator or mass, common ones first.

    `plain`: records with white noise of unknown deviations; `etas`: coordinates of the parameters (p): the
    estimate, if there is one, and the start.
    """
    size = sum(record.data.values.size * max(1, record.nuisances) for record in plain.records)
    if size > _MAX_SIZE or any(map(_has_laws, plain.records)):
        return
    values = sum(int(record.data.counts.sum()) for record in plain.records)
    with suppress(DynidError, ArithmeticError, np.linalg.LinAlgError):
        at_estimate = plain.fit(etas[0])
        origins = etas if compare_models(plain, at_estimate).explained else etas[-1:]
        begun: dict[Any, _Estimate | None] = {}
        for all_kinds in (_common(plain), _single(plain)):
            kinds: dict[Any, list[_Unknown]] = {}
            for kind in all_kinds:
                key = _key(kind[0])
                kinds.setdefault(key, kind)
                if key not in begun:
                    begun[key] = _likeliest(plain, kind[:1], origins, values)
            firsts = [(first, kind) for key, kind in kinds.items() if (first := begun[key]) is not None]
            for first, kind in sorted(firsts, key=lambda pair: pair[0].value)[:_ESTIMATED_KINDS]:
                before = plain.misfit(at_estimate)
                best = _likeliest(plain, kind[:1], [first.fit.eta], values, STEPS)
                # Where the first of a kind explains no more than none does, its variants do not either.
                if best is not None and best.value < before:
                    best = _likeliest(plain, kind, [best.fit.eta], values)
                    best = best and _likeliest(plain, [best.unknown], [best.fit.eta], values, STEPS)
                if best is None or before - best.value <= LEAST_GAIN:
                    continue
                # The likelihood ratio of the unknown and none, the parameters estimated with either.
                with suppress(DynidError, ArithmeticError, np.linalg.LinAlgError):
                    alone = refine(plain, best.fit.eta[:-1], STEPS, least_gain=LEAST_STEP_GAIN).fit
                    before = min(before, plain.misfit(alone))
                yield Explanation(before - best.value, best.likelihood, best.fit, partial(_sentences, best))


def _key(unknown: _Unknown) -> Any:
    """Return what distinguishes unknowns of different kinds."""
    return unknown.channels, unknown.dof, unknown.is_gain, tuple(item.kind for item in unknown.filters)


def _likeliest(
    plain: Likelihood, kind: Sequence[_Unknown], etas: Sequence[Array], values: int, steps: int = _FIRST_STEPS
) -> _Estimate | None:
    """Return the likeliest of some unknowns; None where none can be estimated.

    `etas`: coordinates to start from, of the parameters (p), or with that of the first unknown (p + 1).
    """
    best: _Estimate | None = None
    for unknown in kind:
        with suppress(DynidError, ArithmeticError, np.linalg.LinAlgError):  # then it explains nothing
            other = _with(plain, unknown)
            p = len(other.unknowns) - 1
            if len(etas[0]) > p:
                scale = _delay(kind[0]) / _delay(unknown) if unknown.filters else 1.0
                start = kind[0].parameter.value(float(etas[0][-1])) * scale
                origins = [np.append(etas[0][:p], unknown.parameter.coordinate(start))]
            else:
                starts = [unknown.parameter.coordinate(start) for start in unknown.starts]
                origins = [np.append(eta, start) for eta in etas for start in starts]
            origin = min(origins, key=other.misfit_at) if len(origins) > 1 else origins[0]
            fit = refine(other, origin, steps, least_gain=LEAST_STEP_GAIN).fit
            # Initial states of filters are free: a state counts as one more unknown (Schwarz).
            value = other.misfit(fit) + unknown.states * math.log(values) / 2
            if best is None or value < best.value:
                best = _Estimate(value, unknown, other, fit)
    return best


def _delay(unknown: _Unknown) -> float:
    """Return a factor of corners that gives filters of one kind the same delay, or lead."""
    (item,) = unknown.filters
    delay = float(np.sum(-1 / item.poles).real)
    return {"low_pass": 1 / delay, "high_pass": 1.0 / delay if delay else 1.0, "integrator": 1.0}[item.kind]


def _sentences(estimate: _Estimate) -> Iterator[str]:
    unknown, fit = estimate.unknown, estimate.fit
    deviation = float(
        estimate.likelihood.information(fit, estimate.likelihood.likeliest(fit)).deviations()[-1]
    )
    value = unknown.parameter.value(float(fit.eta[-1]))
    yield unknown.text(value, deviation * (value if unknown.parameter.logarithmic else 1.0))


def _has_laws(record: Any) -> bool:
    """Return True if a record's model is not linear, and nothing is sought behind it."""
    model = (
        getattr(record.system_model, "model", None) if isinstance(record, TimeRecord | FrfRecord) else None
    )
    return not isinstance(record, TimeRecord | FrfRecord) or bool(getattr(model, "nonlinear", False))


# Unknowns: kinds, of each its variants


def _common(plain: Likelihood) -> Iterator[list[_Unknown]]:
    """Yield unknowns of all channels, of a record or a quantity, and masses of sensors."""
    every = [(k, c) for k, record in enumerate(plain.records) for c in range(len(record.channels))]
    quantities = {sensor_of(plain.records[k].channels[c]).quantity for k, c in every}
    yield from _filters(plain, tuple(every))
    if len(quantities) > 1:
        for name in sorted(quantities):
            yield from _filters(
                plain,
                tuple((k, c) for k, c in every if sensor_of(plain.records[k].channels[c]).quantity == name),
            )
    # Channels of unknown gains need none.
    calibrated = [(k, c) for k, c in every if not gain_unknown(plain.records[k].channels[c])]
    by_record = [tuple(place for place in calibrated if place[0] == k) for k in range(len(plain.records))]
    for places in dict.fromkeys([tuple(calibrated), *by_record, *((place,) for place in calibrated)]):
        if places:
            yield [_gain(plain, places)]
    channels = list(dict.fromkeys(sensor_of(plain.records[k].channels[c]) for k, c in every))
    for channel in channels if len(channels) <= _MAX_SINGLE_CHANNELS else ():
        if isinstance(channel, Channel) and channel.reference is None and _can_be_loaded(plain):
            yield [_mass(channel)]


def _single(plain: Likelihood) -> Iterator[list[_Unknown]]:
    """Yield filters of one channel."""
    places: dict[Any, list[tuple[int, int]]] = {}
    for k, record in enumerate(plain.records):
        for c, channel in enumerate(record.channels):
            places.setdefault(sensor_of(channel), []).append((k, c))
    if 1 < len(places) <= _MAX_SINGLE_CHANNELS:
        for of_channel in places.values():
            yield from _filters(plain, tuple(of_channel), _MAX_PARTIAL_ORDER)


def _filters(plain: Likelihood, places: Places, max_order: int = 10) -> Iterator[list[_Unknown]]:
    """Yield filters of channels by kind, where these have none of the kind."""
    channels = list(dict.fromkeys(sensor_of(plain.records[k].channels[c]) for k, c in places))
    stated = {item.kind for channel in channels for item in channel.filters}
    low, high = _band(plain)
    name = f"corner of {', '.join(channel.name for channel in channels)}"
    for kind, variants in _FILTERS.items():
        if kind in stated:
            continue
        integrates = kind == "integrator"
        starts = [low] if integrates else np.geomspace(low, high, _CORNERS).tolist()
        parameter = Parameter(name, starts[0], scale="linear" if integrates else "log")
        corner = Dependent.parameter(name, parameter.start)
        items = [Filter(kind, corner, order, shape) for shape, order in variants if order <= max_order]
        yield [
            _Unknown(parameter, starts, partial(_filter_text, plain, channels, item), places, (item,))
            for item in items
        ]


def _gain(plain: Likelihood, places: Places) -> _Unknown:
    parameter = Parameter("gain of instruments", 1.0)
    return _Unknown(parameter, _GAINS, partial(_gain_text, plain, places), places, is_gain=True)


def _mass(channel: Channel) -> _Unknown:
    parameter = Parameter(f"mass at {channel.dof}", _SENSOR_MASS, unit="kg")

    def text(value: float, deviation: float) -> str:
        mass = quantity(value, deviation or None)
        return (
            f"the lack of fit is explained where a mass of {mass} kg moves with DOF {channel.dof}: "
            f"that of the sensor {channel.name}? State mass: {mass} in its channel"
        )

    return _Unknown(parameter, [_SENSOR_MASS], text, dof=channel.dof)


def _can_be_loaded(plain: Likelihood) -> bool:
    """Return True if all records are of structures without filters, which a mass may load."""
    return all(isinstance(_system(record), StructureSystem) for record in plain.records)


def _system(record: Any) -> LinearSystem:
    """Return the linear system of a record."""
    system: LinearSystem = (record.model if isinstance(record, TimeRecord) else record.system).system
    return system


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


# Likelihoods


def _with(plain: Likelihood, unknown: _Unknown) -> Likelihood:
    """Return the likelihood with one more unknown."""
    records: list[Any] = []
    factor = Dependent.parameter(unknown.parameter.name, unknown.parameter.start)
    for k, record in enumerate(plain.records):
        sensors = [sensor_of(channel) for channel in record.channels]
        changed = [(k, c) in unknown.channels for c in range(len(sensors))]
        if unknown.is_gain:
            gained = [
                sensor._replace(gain=factor * sensor.gain) if own else sensor
                for sensor, own in zip(sensors, changed, strict=True)
            ]
        else:
            gained = sensors
        # Of responses, several share a channel.
        passing = {sensor: unknown.filters for sensor, own in zip(sensors, changed, strict=True) if own}
        channels = list(dict.fromkeys(sensors))
        filters = [() if unknown.is_gain else passing.get(channel, ()) for channel in channels]
        if isinstance(record, TimeRecord):
            conditions = record.conditions
            loads: Sequence[Any] = sampled_loads(conditions.loads, conditions.measurement.record)
            system = _extended(record.model.system, unknown, channels, filters, loads)
            model = model_of_system(system, loads, gained, record.model.times)
            records.append(replace(record, model=model))
        else:
            assert isinstance(record, FrfRecord)
            loads = list(dict.fromkeys(function.load for function in record.system.functions))
            system = _extended(record.system.system, unknown, channels, filters, loads)
            instruments = Instruments.of([item.name for item in system.unknowns], (), gained)
            of_record = replace(record.system, system=system, instruments=instruments)
            records.append(replace(record, system=of_record))
    return Likelihood(tuple(records))


def _extended(
    system: LinearSystem,
    unknown: _Unknown,
    channels: Sequence[Any],
    filters: Sequence[Sequence[Filter]],
    loads: Sequence[Any],
) -> LinearSystem:
    """Return a system with one more unknown: a mass on the structure, the corner of filters, or a gain."""
    if unknown.dof is None:
        return FilteredSystem(system, channels, filters, [unknown.parameter])
    assert isinstance(system, StructureSystem)
    model = system.model.with_parameters((*system.model.parameters, unknown.parameter))
    mass = Dependent.parameter(unknown.parameter.name, unknown.parameter.start)
    return system_of(with_sensor_masses(model, {unknown.dof: mass}), loads, channels)


# Sentences


def _filter_text(
    plain: Likelihood, channels: Sequence[Any], item: Filter, value: float, deviation: float
) -> str:
    every = {sensor_of(channel) for record in plain.records for channel in record.channels}
    names = (
        "all channels" if len(channels) == len(every) > 1 else ", ".join(channel.name for channel in channels)
    )
    article, kind = (
        ("an", "integrator") if item.kind == "integrator" else ("a", f"{item.kind.replace('_', '-')} filter")
    )
    hertz = quantity(value / (2 * math.pi), deviation / (2 * math.pi) or None)
    keys = f"frequency: {hertz}, order: {item.order}{', type: bessel' * (item.shape == 'bessel')}, unit: Hz"
    corner, free = f" at {frequency_text(value, 4)}", ", or the name of an unknown parameter as its frequency"
    if item.kind == "integrator" and value < _IDEAL_DEVIATIONS * deviation:
        keys, corner, free = f"order: {item.order}", "", ""
    return (
        f"the lack of fit is explained where {names} {'pass' if len(channels) > 1 else 'passes'} {article} "
        f"{kind} of order {item.order}{corner}: {_NAMES[item.kind]}? State {item.kind}: {{{keys}}}{free}"
    )


def _gain_text(plain: Likelihood, places: Places, factor: float, deviation: float) -> str:
    """Return the sentence of a gain: of a channel, or of all whose gain is known, as the excitation's."""
    several = len(plain.records) > 1
    names = [f"{f'record_{k + 1}.' if several else ''}{plain.records[k].channels[c].name}" for k, c in places]
    records = [plain.records[k] for k in dict.fromkeys(k for k, _ in places)]
    with_known_gain = sum(not gain_unknown(channel) for record in records for channel in record.channels)
    where, starts = "its channel" if len(names) == 1 else "every channel", set[float]()
    what = "a sensor"
    if len(names) == with_known_gain:
        sensors = "the sensor" if with_known_gain == 1 else "all sensors"
        what = f"the excitation, recorded {1 / factor:.3g} times as large as it is, or {sensors}"
        starts = {start for record in records for start in _starts_of_loads(record, factor)}
        where = "the excitation" if starts else where
    starts = starts or {factor * float(sensor_of(plain.records[k].channels[c]).gain) for k, c in places}
    return (
        f"the lack of fit is explained where {', '.join(names)} {'are' if len(names) > 1 else 'is'} "
        f"{with_error(factor, deviation)} times the model: {what} out of calibration? "
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
