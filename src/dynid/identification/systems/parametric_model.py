"""Parametric model of a record: a map from the unknown parameters to matrices and their exact derivatives.

Physical states and the coordinates of the unknown parameters form the augmented state of K. T. Yang 1997, eqs
12–13. A coordinate is the logarithm of a parameter, which keeps it positive, or the parameter itself; what is
known is part of the physical model and adds no state. For fixed parameters the physical part is linear and is
propagated exactly, with the signals' generators joined to it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, NamedTuple, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from dynid.arithmetic.dependent import Dependent
from dynid.arrays import Array
from dynid.errors import UsageError
from dynid.identification.systems.instruments import Instruments, RecordSampling
from dynid.identification.systems.known_parts import with_known_parts
from dynid.identification.systems.linear_system import Affine, LinearSystem, StateVariable, SystemModel
from dynid.identification.systems.structure_system import StructureSystem
from dynid.lti.exponential import balance, exponential, exponential_with_derivatives, rescaled
from dynid.lti.signals import Derivative, Sampled, Shifted, Signal
from dynid.lti.state_space import Matrices
from dynid.lti.time_response import Timeline, check_phase, drive_scale, joint_generator, timeline
from dynid.native import compiled
from dynid.parameters import Parameter, named, rates, values
from dynid.structure.model import StructuralModel

T = TypeVar("T", bound=np.generic)
Model: TypeAlias = StructuralModel | SystemModel
Rebuild: TypeAlias = Callable[[Mapping[str, float]], StructuralModel]
"""Returns the model for parameters by name."""
"""A model with unknown parameters: a structure, or any other one."""

# Most numbers that the sensitivities of a record may take, with the copies that their factorisation makes.
_MAX_SENSITIVITY_NUMBERS = 250_000_000
_COPIES = 4
# Coefficients from which a channel with a clock of its own is read out, as of a mode up to half the rate.
_CLOCK_ROWS = 14
# Part of a step, or of a record, by which an instant may lie beyond a node: round-off.
_NODE_TOL = 1e-9
# Relative jumps of an input below this are rounding.
_INPUT_JUMP_TOL = 1e-9


class Transition(NamedTuple):
    """One step: ``x+ = Phi x + Gamma w`` as ``step`` (n x (n + q)) on [x, w], and its derivatives.

    ``derivatives`` (parameters x n x (n + q)) are with respect to the coordinates of the parameters.
    """

    step: Array
    derivatives: Array


class DirectTerm(NamedTuple):
    """Feedthrough of the inputs to the outputs: `value` (times x channels), `slopes` (p x times x channels).

    `slopes` are by the coordinates; None where they vanish.
    """

    value: Array
    slopes: Array | None


@dataclass(frozen=True, eq=False)
class ParametricModel:
    """A model with unknown parameters, its loads and channels, on the record's timeline.

    Its matrices and their derivatives by the coordinates of the parameters are those of `at`; `transition`
    and the predictions follow from them. The kernels (`kernels.steps`) compute the steps of models that are
    `affine` themselves.

    The physical states are divided by `scale`, powers of two that balance the system matrix. Build it with
    `parametric_model`.
    """

    system: LinearSystem  # the model with the loads and channels of the record
    scale: Array  # unit of each state (n), in SI
    w_scale: float  # unit of the generator states
    line: Timeline  # the record's timeline
    # `initials`, `known`: first state that each load prescribes (loads x n), scaled, zero elsewhere; and
    # where one does (n)
    initials: Array
    known: NDArray[np.bool_]
    channels: tuple[Any, ...]  # the measured quantities
    # Names of the gains of the loads, and of those of the channels.
    gains: tuple[tuple[str, ...], tuple[str, ...]]
    state_root: Array  # root (n x n) of the wide prior covariance of the state (scaled), up to a factor
    reach: Array  # standard deviation of each channel under that prior (channels)
    # The matrices, scaled, where they are affine in the parameters, all of which are logarithmic.
    affine: Affine | None
    acting: NDArray[np.bool_]  # mask of the loads that act (loads)
    instruments: Instruments  # gains, offsets and delays
    # Times at which delayed channels record; None where no channel is delayed, or has its own clock.
    sampling: RecordSampling | None = None
    # Returns the system and the instruments with these, and with known masses and stiffnesses, among the
    # unknown parameters; None where there are none.
    free: Callable[[], tuple[LinearSystem, Instruments] | None] | None = None
    _last: dict[bytes, Matrices] = field(default_factory=dict, repr=False)
    _moved: dict[bytes, ParametricModel] = field(default_factory=dict, repr=False)

    @property
    def unknowns(self) -> tuple[Parameter, ...]:
        """The unknown parameters (p)."""
        return self.system.unknowns

    @property
    def signals(self) -> Sequence[Signal]:
        """The inputs, one signal a load."""
        return self.system.signals

    @property
    def initial(self) -> Array:
        """First state as far as it is prescribed (n), scaled, zero elsewhere."""
        return np.asarray(self.initials.sum(axis=0))

    @cached_property
    def W(self) -> Array:
        """Generator states at the nodes (nodes x q), scaled."""
        return self.line.W / self.w_scale

    @property
    def states(self) -> int:
        """Number of physical states."""
        return len(self.scale)

    @property
    def parameters(self) -> int:
        """Number of parameter states."""
        return len(self.unknowns)

    def at(self, eta: Array) -> Matrices:
        """Return the scaled matrices at coordinates of the parameters (p), slopes by the coordinates."""
        key = eta.tobytes()
        if key not in self._last:
            theta, rate = values(self.unknowns, eta), rates(self.unknowns, eta)
            if self.affine is None:
                at = named(self.unknowns, eta)
                matrices = _scaled(self.instruments.applied(self.system.at(at), at), self.scale)
            else:
                matrices = self.affine.at(theta)
            self._last.clear()
            self._last[key] = _by_coordinates(matrices, rate)
        return self._last[key]

    def lft(self, eta: Array) -> Matrices:
        """Return the scaled matrices as of `at`, those of loops that are cut included.

        The delayed answers are the last inputs, the answers the last outputs.
        """
        at, instruments = named(self.unknowns, eta), self.instruments
        ones, zeros = ((number,) * len(self.system.delayed) for number in (1.0, 0.0))
        padded = replace(
            instruments,
            load_gains=(*instruments.load_gains, *ones),
            load_delays=(*instruments.load_delays, *zeros),
            gains=(*instruments.gains, *ones),
            delays=(*instruments.delays, *zeros),
            clocks=(*instruments.clocks, *(None for _ in ones)),
        )
        matrices = _scaled(padded.applied(self.system.lft(at), at), self.scale)
        return _by_coordinates(matrices, rates(self.unknowns, eta))

    def loop_delays(self, eta: Array) -> tuple[Array, Array]:
        """Return the delays in loops (m), s, and their derivatives by the coordinates (p x m)."""
        delays, slopes = self.system.loop_delays(named(self.unknowns, eta))
        return delays, slopes * rates(self.unknowns, eta)[:, None]

    def transition(self, eta: Array, h: float) -> Transition:
        """Return the exact step over h at these coordinates, with its derivatives."""
        n, matrices = self.states, self.at(eta)
        readout = self.line.H * self.acting[:, None] * self.w_scale
        size = n + len(self.line.G)
        derivatives = np.zeros((len(eta), size, size))
        derivatives[:, :n, :n] = matrices.A_slopes
        derivatives[:, :n, n:] = matrices.B_slopes @ readout
        if self.instruments.unknown_delays:
            derivatives[:, :n, n:] -= (matrices.B * self.late(eta)[:, None]) @ (readout @ self.line.G)
        joint = joint_generator(matrices.A, matrices.B @ readout, self.line.G)
        E, dE = exponential_with_derivatives(joint, derivatives, h)
        return Transition(E[:n], dE[:, :n])

    def output(self, eta: Array) -> tuple[Array, Array]:
        """Return the output matrix (channels x n) and its derivatives (p x channels x n)."""
        matrices = self.at(eta)
        return matrices.C, matrices.C_slopes

    def follows_delays(self, eta: Array) -> NDArray[np.bool_]:
        """Return the mask of parameters on which delays depend (p)."""
        at, delays = named(self.unknowns, eta), (*self.instruments.load_delays, *self.instruments.delays)
        return np.asarray(self.instruments.numbers(delays, at).slopes.any(axis=1))

    def late(self, eta: Array) -> Array:
        """Return the derivatives of the loads' delays by the coordinates (p x loads)."""
        _, slopes = self.instruments.numbers(self.instruments.load_delays, named(self.unknowns, eta))
        return slopes * rates(self.unknowns, eta)[:, None]

    @cached_property
    def _constant_direct(self) -> DirectTerm:
        """The direct term where it does not depend on the parameters."""
        assert self.affine is not None
        return DirectTerm((self.line.inputs() * self.acting) @ self.affine.D[0].T, None)

    def direct(
        self, eta: Array, channels: slice = slice(None), chosen: slice | NDArray[np.int64] = slice(None)
    ) -> DirectTerm:
        """Return the direct effect of the loads on channels, and offsets, at all times or chosen ones."""
        if self.affine is not None:
            return DirectTerm(self._constant_direct.value[chosen][:, channels], None)
        matrices = self.at(eta)
        inputs = [self.line.inputs(order, chosen) * self.acting for order in range(len(matrices.D))]
        value = sum((u @ D[channels].T for u, D in zip(inputs, matrices.D, strict=True)), np.zeros(()))
        slopes = None
        if matrices.D_slopes.any():
            pairs = zip(inputs, matrices.D_slopes.swapaxes(0, 1), strict=True)
            slopes = sum((u @ D[:, channels].swapaxes(1, 2) for u, D in pairs), np.zeros(()))
        if not self.instruments.ideal:
            offset, change = self.instruments.numbers(self.instruments.offsets, named(self.unknowns, eta))
            value, change = value + offset[channels], change[:, channels]
            if change.any():
                moved = (change * rates(self.unknowns, eta)[:, None])[:, None]
                slopes = (0.0 if slopes is None else slopes) + np.repeat(moved, len(value), axis=1)
        return DirectTerm(value, slopes)

    @property
    def times(self) -> Array:
        """The sampling times (times), s."""
        sample_times = self.line.nodes[self.line.wanted]
        return np.asarray(sample_times if self.sampling is None else sample_times[self.sampling.own])

    def inputs(self, order: int = 0) -> Array:
        """Return a derivative of the acting signals at the sampling times (times x loads)."""
        inputs = self.line.inputs(order)
        return inputs if self.sampling is None else inputs[self.sampling.own]

    def gathered(self, values: Array) -> Array:
        """Return values at the timeline's times (u x channels x …) as the channels record (times x …)."""
        return values if self.sampling is None else self.sampling.gathered(values)

    def own(self, values: NDArray[T]) -> NDArray[T]:
        """Return values at the timeline's times (u x …) at the sampling times (times x …)."""
        return values if self.sampling is None else np.asarray(values[self.sampling.own])

    def moved(self, eta: Array) -> ParametricModel:
        """Return the model on the timeline of the delays and clocks at these coordinates."""
        if not (self.instruments.unknown_delays or self.instruments.clocked):
            return self
        at = named(self.unknowns, eta)
        if self.instruments.clocked and self._holds_instants(at):
            return self
        delay_sets = (self.instruments.load_delays, self.instruments.delays)
        delays = [self.instruments.numbers(delays_of, at).value for delays_of in delay_sets]
        delays.append(self.instruments.numbers(self.instruments.drifts, at).value)
        key = np.concatenate(delays).tobytes()
        if key not in self._moved:
            self._moved.clear()
            self._moved[key] = self._on(*_timeline(self.system, self.instruments, self.times, at))
        return self._moved[key]

    def _holds_instants(self, at: Mapping[str, float]) -> bool:
        """Return True if the timeline has all instants of the channels, and no load moves on it."""
        if any(isinstance(delay, Dependent) for delay in self.instruments.load_delays):
            return False
        instants, nodes = self.instruments.instants(self.times, at).value, self.line.nodes
        rounding = _NODE_TOL * float(nodes[-1] - nodes[0])
        return bool(nodes[0] - rounding <= instants.min() and instants.max() <= nodes[-1])

    def at_record_clock(self) -> ParametricModel:
        """Return the model whose channels all have the clock of the record."""
        at = {unknown.name: unknown.start for unknown in self.unknowns}
        instruments = self.instruments.synchronous()
        moved = self._on(*_timeline(self.system, instruments, self.times, at))
        return replace(moved, instruments=instruments)

    def at_times(self, times: Array) -> ParametricModel:
        """Return the model of other samples of the record, at these times, s."""
        at = {unknown.name: unknown.start for unknown in self.unknowns}
        return self._on(*_timeline(self.system, self.instruments, times, at))

    @cached_property
    def freed(self) -> ParametricModel | None:
        """The model with the unknown parameters of `free`; its states and timeline are the same."""
        system_and_instruments = None if self.free is None else self.free()
        if system_and_instruments is None:
            return None
        system, instruments = system_and_instruments
        return replace(
            self, system=system, instruments=instruments, affine=None, free=None, _last={}, _moved={}
        )

    @property
    def has_samples(self) -> bool:
        """True if an input is known by samples, which lie at the clock of the record."""
        signals = (signal.signal if isinstance(signal, Derivative) else signal for signal in self.signals)
        return any(isinstance(signal, Sampled) for signal in signals)

    def clocked(self, error: float) -> ParametricModel:
        """Return the model of a record whose step is known too long by a relative error; delays are known.

        The samples of signals lie at that clock, too.
        """
        first, at = float(self.times[0]), {unknown.name: unknown.start for unknown in self.unknowns}
        times = first + (self.times - first) * (1 + error)
        return self._on(*_timeline(self.system, self.instruments, times, at, 1 + error))

    def _on(self, line: Timeline, sampling: RecordSampling | None) -> ParametricModel:
        """Return the model on another timeline."""
        initials = self.initials
        if self.known.any():  # what is prescribed at the first time
            initials = self.system.prescribed(float(line.nodes[0]))[0] / self.scale * self.acting[:, None]
        return replace(self, line=line, sampling=sampling, initials=initials, _last={}, _moved={})

    @cached_property
    def has_moving_jumps(self) -> bool:
        """True if a load of unknown delay may jump; of samples those that are held."""
        moving = any(isinstance(delay, Dependent) for delay in self.instruments.load_delays)
        return moving and not all(
            isinstance(signal, Sampled) and signal.hold != "zero" for signal in self.signals
        )

    def jumps(self, eta: Array) -> Array | None:
        """Return what jumps of delayed inputs add to the derivatives of the state (intervals x p x n).

        Each is at the end of its interval. None where none moves.
        """
        if not self.has_moving_jumps:
            return None
        line, late = self.line, self.late(eta)
        jumped = np.zeros((len(line.which), len(line.H)))
        for length, h in enumerate(line.lengths):
            here = np.flatnonzero(line.which == length)
            jumped[here] = (line.W[here + 1] - line.W[here] @ exponential(line.G, float(h)).T) @ line.H.T
        size = np.abs(line.W @ line.H.T).max(axis=0, initial=0.0)
        jumped = np.where(np.abs(jumped) > _INPUT_JUMP_TOL * size, jumped, 0.0) * self.acting
        return np.asarray(-np.einsum("il,pl,nl->ipn", jumped, late, self.at(eta).B))

    def rates(self, eta: Array, states: Array) -> Array:
        """Return the derivatives of the outputs by time (times x channels).

        `eta`: coordinates of the parameters (p); `states`: states at the sampling times (times x n), scaled.
        """
        matrices = self.at(eta)
        moving = states @ matrices.A.T + (self.inputs() * self.acting) @ matrices.B.T
        rate = moving @ matrices.C.T
        for order, D in enumerate(matrices.D, 1):
            rate = rate + (self.inputs(order) * self.acting) @ D.T
        return np.asarray(rate)

    def poles(self, eta: Array) -> NDArray[np.complex128]:
        """Return the poles at these coordinates (n), 1/s; with delays in loops those of slow motions."""
        if self.system.delayed:
            return self.system.poles(named(self.unknowns, eta))
        return np.asarray(np.linalg.eigvals(self.at(eta).A), dtype=complex)

    def driven_by(self, loads: Sequence[int]) -> ParametricModel:
        """Return the model driven by these loads alone (places, from 0)."""
        only = np.isin(np.arange(len(self.initials)), loads)
        return replace(self, acting=only, initials=self.initials * only[:, None], _last={}, _moved={})


def parametric_model(
    model: Model, loads: Sequence[Any], channels: Sequence[Any], times: Array
) -> ParametricModel:
    """Build the augmented model of a record (Yang, eqs 12–13).

    `model`: the model; its unknowns become parameter states; `loads`: the loads as the estimator knows them.
    `channels`: the measured quantities; `times`: sampling times, s. Raises UsageError if nothing is unknown,
    nothing is measured, a DOF does not exist, or the record is too large.
    """
    unknowns_of(model)
    if not channels:
        raise UsageError("nothing is measured", remedy="Give at least one channel.")
    system = system_of(model, loads, channels)
    system.check()
    freed = partial(_freed, model, loads, channels, system.states)
    return replace(model_of_system(system, loads, channels, times), free=freed)


def model_of_system(
    system: LinearSystem, loads: Sequence[Any], channels: Sequence[Any], times: Array
) -> ParametricModel:
    """Build the augmented model of a system with the loads and channels of a record.

    All else is as of `parametric_model`.
    """
    unknowns = system.unknowns
    instruments = Instruments.of([unknown.name for unknown in unknowns], loads, channels)
    starts = {unknown.name: unknown.start for unknown in unknowns}
    started = instruments.applied(system.at(starts), starts)
    d = balance(started.A)
    poles = np.linalg.eigvals(rescaled(started.A, d)).astype(complex)
    check_phase(poles, float(times[-1] - times[0]), [unknown.name for unknown in unknowns])
    line, sampling = _timeline(system, instruments, times, starts)
    initials, prescribed = system.prescribed(float(line.nodes[0]))
    if prescribed.any() and any(load.delay for load in loads):
        raise UsageError("a prescribed motion cannot be delayed", names=("excitation",))
    moving = instruments.unknown_delays or system.delayed
    in_blocks = compiled() and sampling is None and not moving  # nor own clocks
    if in_blocks:  # sensitivities are held in blocks of samples, or of channels
        _check_numbers(len(line.nodes) * len(d) + _COPIES * len(channels) * len(times))
    else:
        beside = len(line.nodes) * len(d) * (1 + len(unknowns))
        if instruments.clocked:
            beside += _CLOCK_ROWS * len(channels) * len(line.nodes) * (len(d) + len(unknowns))
        check_sensitivities(len(times), len(channels), len(d), beside)
    length = max(float(np.ptp(line.nodes)), 1.0)
    state_root, gains = system.prior(starts, length), instruments.numbers(instruments.gains, starts).value
    state_root[prescribed] = 0.0
    affine = system.affine if instruments.ideal else None
    if affine is not None:
        zero = np.zeros(len(unknowns))
        scaled = _scaled(affine.at(zero), d)
        affine = Affine(*scaled[:5], scaled.C_slopes)
    return ParametricModel(
        system=system,
        scale=d,
        w_scale=drive_scale(rescaled(started.A, d), started.B @ line.H / d[:, None]),
        line=line,
        initials=initials / d,
        known=prescribed,
        channels=tuple(channels),
        gains=(tuple(load.gain_name for load in loads), tuple(channel.gain_name for channel in channels)),
        state_root=state_root / d[:, None],
        reach=system.reach(starts, length) * np.abs(gains),
        affine=affine,
        acting=np.ones(len(loads), dtype=bool),
        instruments=instruments,
        sampling=sampling,
    )


def _freed(
    model: Model, loads: Sequence[Any], channels: Sequence[Any], states: Sequence[StateVariable]
) -> tuple[LinearSystem, Instruments] | None:
    """Return system and instruments with what is considered among the unknown parameters."""
    # Known values are left out where other values of them would give a graph other states.
    for known_parts in (True, False):
        freed = freed_model(model, channels, known_parts=known_parts)
        if freed is None:
            continue
        system = system_of(freed, loads, channels)
        if tuple(system.states) == tuple(states):
            names = [unknown.name for unknown in freed.unknowns]
            return system, Instruments.of(names, loads, channels)
    return None


def freed_model(model: Model, channels: Sequence[Any], *, known_parts: bool = True) -> Model | None:
    """Return a model whose considered parameters are unknown; None where it has none.

    `known_parts`: also the known masses and stiffnesses of a structure, and masses at the sensors of
    `channels`; of a graph the known storages.
    """
    parameters = [parameter.freed() for parameter in model.parameters]
    if known_parts and isinstance(model, StructuralModel):
        return with_known_parts(model, parameters, channels)
    freed = model.with_parameters(parameters)
    if known_parts and hasattr(freed, "with_known_storages"):  # of a graph
        freed = freed.with_known_storages(parameters)
    return freed if len(freed.unknowns) > len(model.unknowns) else None


def _spread(signal: Signal, factor: float, first: float) -> Signal:
    """Return a signal whose samples are this many times as far from a time, and apart; any other as it is."""
    if isinstance(signal, Sampled):
        start = first + factor * (signal.start - first)
        return replace(signal, step=factor * signal.step, start=start)
    if isinstance(signal, Derivative):
        return replace(signal, signal=_spread(signal.signal, factor, first))
    return signal


def freed_coordinates(freed: Sequence[Parameter], unknowns: Sequence[Parameter], eta: Array) -> Array:
    """Return coordinates of the parameters of a freed model: `eta` of the unknown ones, else their values."""
    coordinates = {
        unknown.name: coordinate for unknown, coordinate in zip(unknowns, eta.tolist(), strict=True)
    }
    return np.array(
        [coordinates.get(parameter.name, parameter.coordinate(parameter.start)) for parameter in freed]
    )


def _timeline(
    system: LinearSystem,
    instruments: Instruments,
    times: Array,
    values: Mapping[str, float],
    longer: float = 1.0,
) -> tuple[Timeline, RecordSampling | None]:
    """Return the timeline of signals and channels that are delayed as at values of the parameters."""
    # Samples of signals are `longer` times as far from the first time, and apart, as they say.
    clocked, sampling = instruments.clocked, None
    if clocked:
        evaluated_times = _around(times, instruments.instants(times, values).value)
    else:
        sampling = RecordSampling.of(times, instruments.numbers(instruments.delays, values).value)
        evaluated_times = times if sampling is None else sampling.times
    system_signals = (
        system.signals
        if longer == 1
        else [_spread(signal, longer, float(times[0])) for signal in system.signals]
    )
    signals = instruments.acting(system_signals, values)
    if sampling is not None or clocked:
        # A search of delays passes through values at which samples lie outside of a signal's: it keeps its
        # first and last sample before and after them.
        first, last = evaluated_times[[0, -1]]
        signals = [
            Shifted(signal, 0.0)
            if isinstance(signal, Sampled) and not (signal.start <= first and last <= signal.stop)
            else signal
            for signal in signals
        ]
    line = timeline(signals, evaluated_times, float(evaluated_times[0]))
    if clocked:  # every node is wanted: channels are read out between them
        line = replace(line, wanted=np.arange(len(line.nodes)))
        sampling = RecordSampling.at_nodes(line.nodes, times, len(instruments.clocks))
    return line, sampling


def _around(times: Array, instants: Array) -> Array:
    """Return the times of a record, continued at its step beyond all instants, and at least once more."""
    step = float(times[-1] - times[0]) / (len(times) - 1) if len(times) > 1 else 1.0
    before = math.ceil((times[0] - instants.min()) / step - _NODE_TOL)
    after = math.ceil((instants.max() - times[-1]) / step) + 1
    earlier, later = step * np.arange(before, 0, -1), step * np.arange(1, max(after, 1) + 1)
    return np.concatenate([times[0] - earlier, times, times[-1] + later])


def system_of(model: Model, loads: Sequence[Any], channels: Sequence[Any]) -> LinearSystem:
    """Return a model with the loads and channels of a record.

    Raises UsageError if a load or channel makes no sense there.
    """
    if isinstance(model, StructuralModel):
        system: LinearSystem = StructureSystem(model, loads, channels)
    else:
        system = model.system(loads, channels)
    system.considered = tuple(parameter for parameter in model.parameters if parameter.std is not None)
    if (
        isinstance(model, StructuralModel)
        and model.nonlinear
        and any(getattr(channel, "clock", None) for channel in channels)
    ):
        raise UsageError(
            "a channel has a clock of its own, and a joint has nonlinear laws: their records have one clock",
            remedy="Resample the channel to the record's step and leave out its 'clock', or the laws.",
            names=("measurement.channels",),
        )
    if any(getattr(channel, "filters", ()) for channel in channels):
        from dynid.identification.systems.filtered_system import FilteredSystem, filters_of, not_nonlinear

        if isinstance(model, StructuralModel) and model.nonlinear:
            raise not_nonlinear()
        return FilteredSystem(system, channels, filters_of(channels))
    return system


def unknowns_of(model: Model) -> tuple[Parameter, ...]:
    """Return the unknown parameters of a model, of which there must be at least one.

    Raises UsageError if there is none.
    """
    if not model.unknowns:
        raise UsageError(
            "no parameter is unknown", remedy="Give a parameter, or a joint's k or c, a `start`."
        )
    return model.unknowns


def with_fixed(model: Model, fixed: Mapping[str, float]) -> Model:
    """Return a model in which unknown parameters are fixed at values, by name: both limits are the value."""

    def fix(parameter: Any, value: float | None) -> Any:
        same = value is None
        return parameter if same else replace(parameter, start=value, low=value, high=value, prior=None)

    changed = model.with_parameters([fix(old, fixed.get(old.name)) for old in model.parameters])
    if not isinstance(changed, StructuralModel):
        return changed
    joints = []
    for joint in changed.joints:
        held = [term for term in joint.terms if term.name in fixed]
        parts = {term.key: fix(getattr(joint, term.key), fixed[term.name]) for term in held}
        joints.append(replace(joint, **parts) if parts else joint)
    return changed.joined(joints)


def _by_coordinates(matrices: Matrices, rate: Array) -> Matrices:
    """Return matrices with slopes by the coordinates, given those by the values, and the rates of these."""
    slopes = (
        slope * rate.reshape(-1, *(1 for _ in slope.shape[1:])) if slope.any() else slope
        for slope in matrices[4:]
    )
    return Matrices(*matrices[:4], *slopes)


def _scaled(matrices: Matrices, d: Array) -> Matrices:
    """Return matrices for states that are divided by d (n)."""
    return Matrices(
        rescaled(matrices.A, d),
        matrices.B / d[:, None],
        matrices.C * d,
        matrices.D,
        rescaled(matrices.A_slopes, d),
        matrices.B_slopes / d[:, None],
        matrices.C_slopes * d,
        matrices.D_slopes,
    )


def check_sensitivities(samples: int, channels: int, states: int, beside: int = 0) -> None:
    """Refuse a record whose sensitivities would not fit into memory at once, with so many numbers beside."""
    _check_numbers(beside + _COPIES * 2 * channels * states * samples)


def _check_numbers(numbers: int) -> None:
    """Refuse a record that would not fit into memory, before any work on it."""
    if numbers > _MAX_SENSITIVITY_NUMBERS:
        raise UsageError(
            f"the record is too large: its sensitivities take {8e-9 * numbers:.2g} GB, "
            f"{8e-9 * _MAX_SENSITIVITY_NUMBERS:.2g} GB is the most",
            remedy="Use fewer samples or channels, or a smaller model.",
            names=("samples",),
        )
