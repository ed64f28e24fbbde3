"""Measurements of records of time, and their data, measured or simulated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dynid.errors import NotIdentifiable, UsageError
from dynid.identification.goodness_of_fit.statistics import root_mean_square
from dynid.identification.records.noise import Autoregression, ColouredNoise
from dynid.identification.records.simulation import Simulation, check_finite, per_channel
from dynid.identification.systems.instruments import Instruments
from dynid.identification.systems.linear_system import SystemModel
from dynid.lti.signals import Random, RecordTimes, Shifted, WhiteNoise
from dynid.lti.time_response import TimeResponse, propagate
from dynid.parameters import true_values
from dynid.structure.excitation import drive, signals_of, starting_state
from dynid.structure.matrices import Label, as_array
from dynid.structure.model import StructuralModel
from dynid.structure.response import Channel

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Measurement:
    """A measurement: channels, sampling, and the source of the values.

    Parameters
    ----------
    step
        Sampling step, s.
    samples
        Number of samples.
    channels
        Measured quantities.
    source
        Measured values (samples x channels, SI units, NaN where a sample is missing), or how to simulate
        them.
    noise
        Given standard deviation of the noise, in the channel's unit: one number, or one a channel, NaN where
        it is unknown. Absent: it is estimated from the residuals, white; or coloured noise, also estimated.
    start
        Time of the first measured sample on the clock of the loads, s.
    prepared
        The steps by which the samples were prepared; see `preparation.prepare`.
    passed
        Part of the power of white noise that these steps pass.
    clock
        Figures of the clock by the time stamps of the file, by name, if there are any.
    notes
        Warnings of how the record was read.
    """

    step: float
    samples: int
    channels: tuple[Any, ...]
    source: Simulation | ArrayLike = field(default_factory=Simulation)
    noise: float | Sequence[float] | ColouredNoise | None = None
    start: float = 0.0
    prepared: tuple[str, ...] = ()
    passed: float = 1.0
    clock: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        channels = tuple(Channel(*one) if type(one) is tuple else one for one in self.channels)
        object.__setattr__(self, "channels", channels)
        if len(set(channels)) != len(channels):
            twice = [channel.name for channel in channels if channels.count(channel) > 1]
            raise UsageError(f"the channel {twice[0]} is named twice", names=twice[:1])
        _ = self.record
        given = self.given_noise
        if given is not None and not np.all(np.isnan(given) | ((given > 0) & np.isfinite(given))):
            raise UsageError(
                "a noise that is given must be finite and positive", names=("measurement.noise",)
            )
        if isinstance(self.source, Simulation):
            return
        values = np.array(self.source, dtype=float)
        if values.shape != (self.samples, len(channels)):
            raise UsageError(
                f"measured values are {values.shape}, but must be {(self.samples, len(channels))}"
            )
        check_finite(values, "measured values", "sample")
        object.__setattr__(self, "source", values)

    @property
    def given_noise(self) -> Array | None:
        """The given deviations of the noise (channels)."""
        if self.noise is None or isinstance(self.noise, ColouredNoise):
            return None
        return per_channel("measurement.noise", self.noise, len(self.channels))

    @property
    def record(self) -> RecordTimes:
        """The record: step, samples, and the time of the first one."""
        start = self.source.settle if isinstance(self.source, Simulation) else self.start
        return RecordTimes(self.step, self.samples, start)


class Experiment(NamedTuple):
    """One record and the forces it was taken under.

    The time of the forces is that of the simulation: with settling, the first sample is not t = 0.
    """

    loads: Sequence[Any]
    measurement: Measurement

    @property
    def dofs(self) -> list[Label]:
        """The DOFs that are loaded, measured or given an initial value."""
        source, channels = self.measurement.source, self.measurement.channels
        given = (source.displacement, source.velocity) if isinstance(source, Simulation) else ()
        dofs = [*(load.dof for load in self.loads), *(end for c in channels for end in (c.dof, c.reference))]
        dofs += [dof for motion in given for dof in motion or ()]
        return list(dict.fromkeys(dof for dof in dofs if dof is not None))


class RobustLoss(NamedTuple):
    """A record under a robust loss.

    Attributes
    ----------
    recorded
        The values as they were recorded (times x channels), NaN where missing.
    scale
        Robust standard deviation of the residuals (channels).
    clipped
        Part of the values whose influence is bounded (channels).
    given
        Given standard deviation of the noise (channels), NaN where none is given.
    """

    recorded: Array
    scale: Array
    clipped: Array
    given: Array


@dataclass(frozen=True, eq=False)
class RecordData:
    """A record.

    Attributes
    ----------
    values
        Measured values (times x channels), NaN where missing.
    noise
        Standard deviation of the noise (channels), if known.
    clean
        The values without noise (times x channels), if known.
    given
        Given standard deviation of the noise (channels), NaN where none is given; of pseudo-values None.
    passed
        Part of the power of white noise that a preparation passes. Error bars need the density in the pass
        band: the deviation of the residuals over the root of this part.
    robust
        Data of a robust loss, if one is used; `values` then are pseudo-values, see
        `dynid.identification.estimators.maximum_likelihood`.
    colour
        Colour of a simulated noise, if it is not white.
    by_line
        Deviation of a simulated noise by line (L x channels), if it is not the same at all lines.
    """

    values: Array
    noise: Array | None = None
    clean: Array | None = None
    given: Array | None = None
    passed: float = 1.0
    robust: RobustLoss | None = None
    colour: Autoregression | None = None
    by_line: Array | None = None

    @property
    def recorded(self) -> Array:
        """The values as they were recorded (times x channels)."""
        return self.values if self.robust is None else self.robust.recorded

    @property
    def given_noise(self) -> Array:
        """The given deviations of the noise (channels), NaN where none is given, whatever the loss."""
        if self.robust is not None:
            return self.robust.given
        return np.full(self.values.shape[1], np.nan) if self.given is None else self.given

    @cached_property
    def rms(self) -> Array:
        """Root mean square of each channel over the samples present."""
        return root_mean_square(self.values)

    @cached_property
    def counts(self) -> NDArray[np.int_]:
        """Number of values of each channel (channels)."""
        return np.asarray(np.count_nonzero(~np.isnan(self.values), axis=0))

    def within(self, samples: slice) -> RecordData:
        """Return some of the samples."""
        clean = None if self.clean is None else self.clean[samples]
        return replace(self, values=self.values[samples], clean=clean)

    def without_noise(self) -> RecordData:
        """Return the record without its noise, where that is known."""
        return self if self.clean is None else replace(self, values=self.clean)


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

    Raises
    ------
    UsageError
        If a true value is missing for a simulation.
    NotIdentifiable
        If a channel has no samples or measures nothing but zeros.
    """
    given = measurement.given_noise
    if isinstance(measurement.source, Simulation):
        if clean is None:
            clean = simulated(model, loads, measurement).outputs
        noise = measurement.source.deviation(clean)
        generator = np.random.Generator(np.random.PCG64(measurement.source.seed))
        added, colour = generator.standard_normal(clean.shape), None
        if measurement.source.noise_colour:
            colour = Autoregression.of(measurement.source.noise_colour, len(measurement.channels))
            added = colour.simulated(added)
        record = RecordData(clean + noise * added, noise, clean, given, colour=colour)
    else:
        record = RecordData(np.asarray(measurement.source), given=given, passed=measurement.passed)
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
    if instruments.ideal:
        return _ideally_simulated(model, loads, channels, times, source)
    gains, delays = (
        instruments.numbers(one, truth).value.tolist()
        for one in (instruments.load_gains, instruments.load_delays)
    )
    acting = [
        load._replace(signal=Shifted(load.signal, delay, gain), gain=1.0, delay=0.0)
        for load, delay, gain in zip(loads, delays, gains, strict=True)
    ]
    gain, offset, late = (
        instruments.numbers(one, truth).value
        for one in (instruments.gains, instruments.offsets, instruments.delays)
    )
    bare = [channel._replace(gain=1.0, offset=0.0, delay=0.0) for channel in channels]
    found = _ideally_simulated(model, acting, bare, times, source)
    outputs = found.outputs.copy()
    for delay in np.unique(late[late != 0]).tolist():
        moving = times - delay >= 0
        outputs[:, late == delay] = 0.0
        if moving.any():
            earlier = _ideally_simulated(model, acting, bare, times[moving] - delay, source)
            outputs[np.ix_(moving, late == delay)] = earlier.outputs[:, late == delay]
    return found._replace(outputs=gain * outputs + offset)


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
    truth = model.true_values()
    driven, matrices = drive(model, loads, channels, truth), model.dense(truth)
    start = driven.state(*matrices[:2], starting_state(model, loads, source.displacement, source.velocity))
    return propagate(driven.system(*matrices), signals_of(loads), times, start)


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
    states = simulated(truth, loads, measurement).states
    if not isinstance(truth, StructuralModel) or not isinstance(model, StructuralModel):
        return states
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
    return np.asarray(moved.reshape(len(states), -1))


def as_estimated(loads: Sequence[Any], record: RecordTimes) -> list[Any]:
    """Return the loads as an estimator knows them: of a random signal its samples only."""
    return [
        load._replace(signal=load.signal.sampled(record))
        if isinstance(load.signal, Random | WhiteNoise)
        else load
        for load in loads
    ]
