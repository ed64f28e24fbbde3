"""Values of records of time: measured, or simulated with a model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from dynid.arrays import Array
from dynid.errors import NotIdentifiable
from dynid.identification.records.measurement import Measurement, RecordData, Simulation
from dynid.identification.records.noise import Autoregression
from dynid.identification.systems.instruments import Instruments
from dynid.identification.systems.linear_system import SystemModel
from dynid.lti.signals import Shifted
from dynid.lti.time_response import TimeResponse, propagate
from dynid.parameters import true_values
from dynid.structure.excitation import drive, signals_of, starting_state
from dynid.structure.matrices import as_array
from dynid.structure.model import StructuralModel
from dynid.structure.ports import Channel


def data(
    model: StructuralModel | SystemModel,
    loads: Sequence[Any],
    measurement: Measurement,
    clean: Array | None = None,
) -> RecordData:
    """Return the measured values, simulated with `model` where they are to be simulated.

    Simulated values are exact for the continuous loads, the unknown parameters at
    their true values; the noise of each channel then has the standard deviation noise ratio x RMS. `clean`
    are the values without noise, if they are simulated already.

    Raises UsageError if a true value is missing for a simulation. Raises NotIdentifiable if a channel has no
    samples or measures nothing but zeros.
    """
    given_noise = measurement.given_noise
    if isinstance(measurement.source, Simulation):
        if clean is None:
            clean = simulated(model, loads, measurement).outputs
        noise = measurement.source.deviation(clean)
        generator = np.random.Generator(np.random.PCG64(measurement.source.seed))
        added, colour = generator.standard_normal(clean.shape), None
        if measurement.source.noise_colour:
            colour = Autoregression.of(measurement.source.noise_colour, len(measurement.channels))
            added = colour.simulated(added)
        record = RecordData(clean + noise * added, noise, clean, given_noise, colour=colour)
    else:
        record = RecordData(np.asarray(measurement.source), given=given_noise, passed=measurement.passed)
    for column, channel in enumerate(measurement.channels):
        if not np.any(np.nan_to_num(record.values[:, column])):
            raise NotIdentifiable(
                f"the channel {channel.name} measures nothing but zeros or missing values",
                remedy="Leave it out, or check the sensor and the excitation.",
                names=(channel.name,),
            )
    return record


def simulated(
    model: StructuralModel | SystemModel, loads: Sequence[Any], measurement: Measurement
) -> TimeResponse:
    """Return the exact, noise-free response at the sampling times, from the initial state at t = 0.

    The outputs are those that the channels record. Before t = 0 nothing moves.
    """
    source = measurement.source if isinstance(measurement.source, Simulation) else Simulation()
    times, channels, truth = measurement.record.times, measurement.channels, true_values(model.unknowns)
    instruments = Instruments.of(tuple(truth), loads, channels)
    if instruments.ideal and not instruments.clocked:
        return _ideally_simulated(model, loads, channels, times, source)
    gains, delays = (
        instruments.numbers(numbers, truth).value.tolist()
        for numbers in (instruments.load_gains, instruments.load_delays)
    )
    acting = [
        load._replace(signal=Shifted(load.signal, delay, gain), gain=1.0, delay=0.0)
        for load, delay, gain in zip(loads, delays, gains, strict=True)
    ]
    gain, offset = (
        instruments.numbers(numbers, truth).value for numbers in (instruments.gains, instruments.offsets)
    )
    instants = instruments.instants(times, truth).value
    bare = [_at_record_clock(channel)._replace(gain=1.0, offset=0.0, delay=0.0) for channel in channels]
    response = _ideally_simulated(model, acting, bare, times, source)
    outputs = response.outputs.copy()
    for own in np.unique(instants, axis=1).T:
        if np.array_equal(own, times):
            continue
        channel, moving = np.all(instants == own[:, None], axis=0), own >= 0
        outputs[:, channel] = 0.0
        if moving.any():
            at, rows = np.unique(own[moving], return_inverse=True)
            of_clock = _ideally_simulated(model, acting, bare, at, source).outputs[rows]
            outputs[np.ix_(moving, channel)] = of_clock[:, channel]
    recorded = np.where(instruments.present(len(times)), gain * outputs + offset, np.nan)
    return response._replace(outputs=recorded)


def _at_record_clock(channel: Any) -> Any:
    """Return a channel with the clock of the record."""
    return channel if getattr(channel, "clock", None) is None else channel._replace(clock=None)


def _ideally_simulated(
    model: StructuralModel | SystemModel,
    loads: Sequence[Any],
    channels: Sequence[Any],
    times: Array,
    source: Simulation,
) -> TimeResponse:
    """Return the response with ideal instruments."""
    if not isinstance(model, StructuralModel):
        return model.simulated(loads, channels, times, source)
    model.needs_causal("record of time")
    truth = model.true_values()
    driven, matrices = drive(model, loads, channels, truth), model.dense(truth)
    motion = starting_state(model, loads, source.displacement, source.velocity)
    filtered = any(getattr(channel, "filters", ()) for channel in channels)
    if model.nonlinear:
        from dynid.structure.nonlinear.response import nonlinear_response

        if filtered:
            from dynid.identification.systems.filtered_system import not_nonlinear

            raise not_nonlinear()
        return nonlinear_response(model, driven, signals_of(loads), times, motion, truth)[0]
    space, start = driven.system(*matrices), driven.state(*matrices[:2], motion)
    if filtered:
        from dynid.identification.systems.filtered_system import filtered_space, filters_of

        space = filtered_space(space, filters_of(channels), truth)
        start = np.pad(start, (0, len(space.A) - len(start)))
    return propagate(space, signals_of(loads), times, start)


def true_states(
    truth: StructuralModel | SystemModel,
    model: StructuralModel | SystemModel,
    loads: Sequence[Any],
    measurement: Measurement,
) -> Array | None:
    """Return the true states of a simulated record (times x n, SI), in the coordinates of `model`.

    Displacements, then velocities. Coordinates of a reduced model that are DOFs of the truth are taken from
    there; if there are others, the motion is projected onto the basis, orthogonally by kinetic energy.
    """
    if not isinstance(measurement.source, Simulation):
        return None
    measurement = replace(measurement, channels=tuple(map(_at_record_clock, measurement.channels)))
    states = simulated(truth, loads, measurement).states
    filters = sum(item.order for channel in measurement.channels for item in getattr(channel, "filters", ()))
    states, of_filters = states[:, : states.shape[1] - filters], states[:, states.shape[1] - filters :]
    if not isinstance(truth, StructuralModel) or not isinstance(model, StructuralModel):
        return np.concatenate([states, of_filters], axis=1)
    if states.shape[1] != 2 * truth.size:  # massless DOFs are no states
        channels = tuple(Channel(dof, kind) for kind in ("displacement", "velocity") for dof in truth.dofs)
        states = simulated(truth, loads, replace(measurement, channels=channels)).outputs
    if model.basis is None or (truth.basis is not None and truth.dofs == model.dofs):
        read = np.eye(truth.size)
    elif set(truth.dofs).issuperset(model.dofs):
        read = np.array([truth.row(dof) for dof in model.dofs])
    else:
        full = model.basis.parent
        momentum = model.basis.T.T @ np.asarray(as_array(full.M))
        read = np.asarray(np.linalg.lstsq(as_array(model.M), momentum, rcond=None)[0])
    moved = states.reshape(len(states), 2, truth.size) @ read.T
    return np.concatenate([moved.reshape(len(states), -1), of_filters], axis=1)
