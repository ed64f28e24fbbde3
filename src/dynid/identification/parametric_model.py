"""Parametric model of a record: a map from the unknown parameters to matrices and their exact derivatives.

Physical states and the coordinates of the unknown parameters form the augmented state of K. T. Yang 1997, eqs
12–13. A coordinate is the logarithm of a parameter, which keeps it positive, or the parameter itself; what is
known is part of the physical model and adds no state. For fixed parameters the physical part is linear and is
propagated exactly, with the signals' generators joined to it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.errors import UsageError
from dynid.identification.linear_system import Affine, LinearSystem, Matrices, SystemModel
from dynid.identification.structure_system import StructureSystem
from dynid.lti.exponential import balance, exponential_with_derivatives, rescaled
from dynid.lti.signals import Signal
from dynid.lti.time_response import check_phase, drive_scale, joint_generator
from dynid.lti.timeline import Timeline, timeline
from dynid.parameters import Parameter, named, rates, values
from dynid.structure.model import StructuralModel

Array = NDArray[np.float64]

# Most numbers that the sensitivities of a record may take, with the copies that their factorisation makes.
_MOST_NUMBERS = 250_000_000
_COPIES = 4


class Transition(NamedTuple):
    """One step: ``x+ = Phi x + Gamma w`` as ``step`` (n x (n + q)) on [x, w], and its derivatives.

    ``derivatives`` (parameters x n x (n + q)) are with respect to the coordinates of the parameters.
    """

    step: Array
    derivatives: Array


class DirectTerm(NamedTuple):
    """What inputs add to outputs at once: `value` (times x channels), `slopes` (p x times x channels).

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

    Attributes
    ----------
    system
        The model with the loads and channels of the record.
    scale
        Unit of each state (n), in SI.
    w_scale
        Unit of the generator states.
    line
        The record's timeline.
    initials, known
        First state that each load prescribes (loads x n), scaled, zero elsewhere; and where one does (n).
    channels
        The measured quantities.
    gains
        Names of the gains of the loads, and of those of the channels.
    state_root
        Root (n x n) of the wide prior covariance of the state (scaled), up to a factor.
    reach
        Standard deviation of each channel under that prior (channels).
    affine
        The matrices, scaled, where they are affine in the parameters, all of which are logarithmic.
    acting
        Mask of the loads that act (loads).
    """

    system: LinearSystem
    scale: Array
    w_scale: float
    line: Timeline
    initials: Array
    known: NDArray[np.bool_]
    channels: tuple[Any, ...]
    gains: tuple[tuple[str, ...], tuple[str, ...]]
    state_root: Array
    reach: Array
    affine: Affine | None
    acting: NDArray[np.bool_]
    _last: dict[bytes, Matrices] = field(default_factory=dict, repr=False)

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
                found = _scaled(self.system.at(named(self.unknowns, eta)), self.scale)
            else:
                found = self.affine.at(theta)
            slopes = (
                slope * rate.reshape(-1, *(1 for _ in slope.shape[1:])) if slope.any() else slope
                for slope in found[4:]
            )
            self._last.clear()
            self._last[key] = Matrices(*found[:4], *slopes)
        return self._last[key]

    def transition(self, eta: Array, h: float) -> Transition:
        """Return the exact step over h at these coordinates, with its derivatives."""
        n, found = self.states, self.at(eta)
        readout = self.line.H * self.acting[:, None] * self.w_scale
        size = n + len(self.line.G)
        derivatives = np.zeros((len(eta), size, size))
        derivatives[:, :n, :n] = found.A_slopes
        derivatives[:, :n, n:] = found.B_slopes @ readout
        joint = joint_generator(found.A, found.B @ readout, self.line.G)
        E, dE = exponential_with_derivatives(joint, derivatives, h)
        return Transition(E[:n], dE[:, :n])

    def output(self, eta: Array) -> tuple[Array, Array]:
        """Return the output matrix (channels x n) and its derivatives (p x channels x n)."""
        found = self.at(eta)
        return found.C, found.C_slopes

    def direct(self, eta: Array) -> DirectTerm:
        """Return the direct effect of the loads on the channels."""
        found = self.at(eta)
        inputs = [self.line.inputs(order) * self.acting for order in range(len(found.D))]
        value = sum((u @ D.T for u, D in zip(inputs, found.D, strict=True)), np.zeros(()))
        if not found.D_slopes.any():
            return DirectTerm(value, None)
        each = zip(inputs, found.D_slopes.swapaxes(0, 1), strict=True)
        return DirectTerm(value, sum((u @ D.swapaxes(1, 2) for u, D in each), np.zeros(())))

    def rates(self, eta: Array, states: Array) -> Array:
        """Return the derivatives of the outputs by time (times x channels).

        Parameters
        ----------
        eta
            Coordinates of the parameters (p).
        states
            States at the sampling times (times x n), scaled.
        """
        found = self.at(eta)
        moving = states @ found.A.T + (self.line.inputs() * self.acting) @ found.B.T
        rate = moving @ found.C.T
        for order, D in enumerate(found.D, 1):
            rate = rate + (self.line.inputs(order) * self.acting) @ D.T
        return np.asarray(rate)

    def poles(self, eta: Array) -> NDArray[np.complex128]:
        """Return the poles at these coordinates (n), 1/s."""
        return np.asarray(np.linalg.eigvals(self.at(eta).A), dtype=complex)

    def driven_by(self, loads: Sequence[int]) -> ParametricModel:
        """Return the model driven by these loads alone (places, from 0)."""
        only = np.isin(np.arange(len(self.initials)), loads)
        return replace(self, acting=only, initials=self.initials * only[:, None], _last={})


def parametric_model(
    model: StructuralModel | SystemModel, loads: Sequence[Any], channels: Sequence[Any], times: Array
) -> ParametricModel:
    """Build the augmented model of a record (Yang, eqs 12–13).

    Parameters
    ----------
    model
        The model; its unknowns become parameter states.
    loads
        The loads as the estimator knows them.
    channels
        The measured quantities.
    times
        Sampling times, s.

    Raises
    ------
    UsageError
        If nothing is unknown, nothing is measured, a DOF does not exist, or the record is too large.
    """
    unknowns = unknowns_of(model)
    if not channels:
        raise UsageError("nothing is measured", remedy="Give at least one channel.")
    system = system_of(model, loads, channels)
    system.check()
    starts = {unknown.name: unknown.start for unknown in unknowns}
    started = system.at(starts)
    initials, known = system.prescribed(float(times[0]))
    d = balance(started.A)
    poles = np.linalg.eigvals(rescaled(started.A, d)).astype(complex)
    check_phase(poles, float(times[-1] - times[0]), [unknown.name for unknown in unknowns])
    line = timeline(system.signals, times, float(times[0]))
    _check_cost(len(line.nodes), len(d) * (1 + len(unknowns)), len(channels) * len(d) * len(times) * 2)
    length = max(float(np.ptp(line.nodes)), 1.0)
    state_root = system.prior(starts, length)
    state_root[known] = 0.0
    affine = system.affine
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
        known=known,
        channels=tuple(channels),
        gains=(tuple(load.gain_name for load in loads), tuple(channel.gain_name for channel in channels)),
        state_root=state_root / d[:, None],
        reach=system.reach(starts, length),
        affine=affine,
        acting=np.ones(len(loads), dtype=bool),
    )


def system_of(
    model: StructuralModel | SystemModel, loads: Sequence[Any], channels: Sequence[Any]
) -> LinearSystem:
    """Return a model with the loads and channels of a record.

    Raises
    ------
    UsageError
        If a load or channel makes no sense there.
    """
    if isinstance(model, StructuralModel):
        return StructureSystem(model, loads, channels)
    return model.system(loads, channels)


def unknowns_of(model: StructuralModel | SystemModel) -> tuple[Parameter, ...]:
    """Return the unknown parameters of a model, of which there must be at least one.

    Raises
    ------
    UsageError
        If there is none.
    """
    if not model.unknowns:
        raise UsageError(
            "no parameter is unknown",
            remedy="Give a parameter, or a joint's k or c, a `start`.",
        )
    return model.unknowns


def _scaled(found: Matrices, d: Array) -> Matrices:
    """Return matrices for states that are divided by d (n)."""
    return Matrices(
        rescaled(found.A, d),
        found.B / d[:, None],
        found.C * d,
        found.D,
        rescaled(found.A_slopes, d),
        found.B_slopes / d[:, None],
        found.C_slopes * d,
        found.D_slopes,
    )


def _check_cost(nodes: int, states: int, sensitivities: int) -> None:
    """Refuse a record that would not fit into memory, before any work on it."""
    numbers = nodes * states + _COPIES * sensitivities
    if numbers > _MOST_NUMBERS:
        raise UsageError(
            f"the record is too large: its sensitivities take {8e-9 * numbers:.2g} GB, "
            f"{8e-9 * _MOST_NUMBERS:.2g} GB is the most",
            remedy="Use fewer samples or channels, or a smaller model.",
            names=("samples",),
        )
