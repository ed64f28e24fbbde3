"""Parametric model of a record: a map from the unknown parameters to matrices and their exact derivatives.

Physical states and the logarithms of the unknown joint parameters form the augmented state of K. T. Yang
1997, eqs 12–13. Logarithms keep the parameters positive; joints that are known are part of the physical model
and add no state. For fixed parameters the physical part is linear and is propagated exactly, with the
signals' generators joined to it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.errors import UsageError
from dynid.identification.calibration import channel_gain, load_gain
from dynid.lti.exponential import balance, exponential_with_derivatives, rescaled
from dynid.lti.floating import finite
from dynid.lti.signals import Signal
from dynid.lti.time_response import check_phase, drive_scale, joint_generator
from dynid.lti.timeline import Timeline, timeline
from dynid.structure.excitation import Excitation, drive, prescribed_state, signals_of
from dynid.structure.joints import Unknown
from dynid.structure.matrices import as_array
from dynid.structure.model import StructuralModel
from dynid.structure.response import Channel, Load
from dynid.structure.state_space import massless_motion

Array = NDArray[np.float64]

# Most numbers that the sensitivities of a record may take, with the copies that their factorisation makes.
_MOST_NUMBERS = 250_000_000
_COPIES = 4


class Transition(NamedTuple):
    """One step: ``x+ = Phi x + Gamma w`` as ``step`` (n x (n + q)) on [x, w], and its derivatives.

    ``derivatives`` (parameters x n x (n + q)) are with respect to the logarithms of the parameters.
    """

    step: Array
    derivatives: Array


@dataclass(frozen=True, eq=False)
class ParametricModel:
    """A structure with unknown joint parameters, its loads and channels, on the record's timeline.

    The map from parameters to matrices is `system` and `output`, which return values and derivatives by the
    logarithms of the parameters; `transition` and the predictions follow from them. Only the kernels
    (`kernels.steps`) use that the matrices are affine in the parameters.

    The physical states are displacements and velocities divided by `scale`, powers of two that balance
    the system matrix. Build it with `parametric_model`.

    Attributes
    ----------
    unknowns
        The unknown parameters (p).
    scale
        Unit of each state (n), in SI.
    A, A_slopes
        System matrix without the unknowns (n x n), and its change by each unit unknown (p x n x n).
    B
        Input matrix (n x loads).
    drive
        Input matrix times the signals' read-out (n x q).
    C, C_slopes
        Output matrix without the unknowns (channels x n), and its change (p x channels x n).
    D
        Direct terms of the loads on the channels (channels x loads).
    line
        The record's timeline.
    W
        Generator states at the nodes (nodes x q), scaled to `drive`.
    initials, known
        First state that each load prescribes (loads x n), scaled, zero elsewhere; and where one does (n).
    signals
        The inputs, one signal a load.
    channels
        The measured quantities.
    gains
        Names of the gains of the loads, and of those of the channels.
    state_root
        Root (n x n) of the wide prior covariance of the state (scaled), up to a factor.
    reach
        Standard deviation of each channel under that prior (channels).
    """

    unknowns: tuple[Unknown, ...]
    scale: Array
    A: Array
    A_slopes: Array
    B: Array
    drive: Array
    C: Array
    C_slopes: Array
    D: Array
    line: Timeline
    W: Array
    initials: Array
    known: NDArray[np.bool_]
    signals: tuple[Signal, ...]
    channels: tuple[Channel, ...]
    gains: tuple[tuple[str, ...], tuple[str, ...]]
    state_root: Array
    reach: Array

    @property
    def initial(self) -> Array:
        """First state as far as it is prescribed (n), scaled, zero elsewhere."""
        return np.asarray(self.initials.sum(axis=0))

    @cached_property
    def feedthrough(self) -> Array:
        """Direct effect of the loads on the channels (times x channels)."""
        return np.asarray(self.line.inputs() @ self.D.T)

    @property
    def states(self) -> int:
        """Number of physical states."""
        return len(self.A)

    @property
    def parameters(self) -> int:
        """Number of parameter states."""
        return len(self.unknowns)

    def system(self, logs: Array) -> tuple[Array, Array]:
        """Return the system matrix (n x n) and its derivatives by the logarithms (p x n x n)."""
        change = np.exp(logs)[:, None, None] * self.A_slopes
        return self.A + change.sum(axis=0), change

    def transition(self, logs: Array, h: float) -> Transition:
        """Return the exact step over h at the parameters ``exp(logs)``, with its derivatives."""
        n, (A, change) = self.states, self.system(logs)
        size = n + len(self.line.G)
        derivatives = np.zeros((len(logs), size, size))
        derivatives[:, :n, :n] = change
        joint = joint_generator(A, self.drive, self.line.G)
        E, dE = exponential_with_derivatives(joint, derivatives, h)
        return Transition(E[:n], dE[:, :n])

    def poles(self, logs: Array) -> NDArray[np.complex128]:
        """Return the poles at the parameters ``exp(logs)`` (n), 1/s."""
        return np.asarray(np.linalg.eigvals(self.system(logs)[0]), dtype=complex)

    def driven_by(self, loads: Sequence[int]) -> ParametricModel:
        """Return the model driven by these loads alone (places, from 0)."""
        read = (self.line.H[loads] != 0).any(axis=0)  # each signal has generator states of its own
        only = np.isin(np.arange(len(self.initials)), loads)
        return replace(
            self,
            B=self.B * only,
            drive=self.drive * read,
            D=self.D * only,
            initials=self.initials * only[:, None],
        )

    def output(self, logs: Array) -> tuple[Array, Array]:
        """Return the output matrix (channels x n) and its derivatives (p x channels x n)."""
        change = np.exp(logs)[:, None, None] * self.C_slopes
        return self.C + change.sum(axis=0), change


def parametric_model(
    model: StructuralModel, loads: Sequence[Load], channels: Sequence[Channel], times: Array
) -> ParametricModel:
    """Build the augmented model of a structure (Yang, eqs 12–13).

    Parameters
    ----------
    model
        The structure; its joints' unknowns become parameter states.
    loads
        The forces as the estimator knows them.
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
    driven = drive(model, loads, channels)
    fixed = model.dense({unknown.name: 0.0 for unknown in unknowns})
    if some := massless_motion(driven.mass(fixed[0])):
        raise UsageError(
            f"the mass matrix is singular ({some}): what is estimated in time needs mass everywhere",
            remedy="Reduce to DOFs that have mass, give the others mass, or identify from frequency response "
            "functions.",
            names=("structure",),
        )
    system = driven.system(*fixed)
    A_slopes, C_slopes = _slopes(driven, driven.mass(fixed[0]), unknowns)
    prescribed = [prescribed_state(model, [load], float(times[0])) for load in loads]
    initials = np.array([state for state, _ in prescribed]).reshape(len(prescribed), 2 * model.size)
    known = np.any([where for _, where in prescribed], axis=0) | np.zeros(2 * model.size, dtype=bool)
    started = system.A + np.einsum("p,pij->ij", [unknown.start for unknown in unknowns], A_slopes)
    d = balance(started)
    started = rescaled(started, d)
    poles = np.linalg.eigvals(started).astype(complex)
    check_phase(poles, float(times[-1] - times[0]), [unknown.name for unknown in unknowns])
    signals = signals_of(loads)
    line = timeline(signals, times, float(times[0]))
    _check_cost(len(line.nodes), len(d) * (1 + len(unknowns)), driven.rows.size * len(times) * 2)
    entering = system.B @ line.H / d[:, None]
    w_scale = drive_scale(started, entering)
    state_root, reach = _wide_prior(model, unknowns, channels, line)
    state_root[known] = 0.0
    return ParametricModel(
        unknowns=unknowns,
        scale=d,
        A=rescaled(system.A, d),
        A_slopes=rescaled(A_slopes, d),
        B=system.B / d[:, None],
        drive=entering * w_scale,
        C=system.C * d,
        C_slopes=C_slopes * d,
        D=system.D,
        line=line,
        W=line.W / w_scale,
        initials=initials / d,
        known=known,
        signals=tuple(signals),
        channels=tuple(channels),
        gains=(tuple(load_gain(load.dof, load.motion) for load in loads), tuple(map(channel_gain, channels))),
        state_root=state_root / d[:, None],
        reach=reach,
    )


def _wide_prior(
    model: StructuralModel, unknowns: Sequence[Unknown], channels: Sequence[Channel], line: Timeline
) -> tuple[Array, Array]:
    """Return the root of a prior covariance of the state (2 n x 2 n), and the channels' reach.

    Displacements and velocities have the covariance ``(K + M / T^2)^-1`` and ``M^-1``, equal energy in every
    mode, up to a common factor. T, the record's length, bounds rigid-body drift. The roots of both come from
    the modes, so that no stiffness is too large.
    """
    M, _, K = model.dense({unknown.name: unknown.start for unknown in unknowns})
    length = max(float(np.ptp(line.nodes)), 1.0)
    scale = np.sqrt(np.diag(M))
    lower = np.linalg.cholesky(M / scale / scale[:, None])
    mobility = np.asarray(np.linalg.solve(lower.T, np.eye(len(M))) / scale[:, None])  # root of M^-1
    stiffness = mobility.T @ K @ mobility
    finite("the stiffness beside the mass", stiffness)
    square, shapes = np.linalg.eigh((stiffness + stiffness.T) / 2)
    omega = np.sqrt(np.maximum(square, 0.0) + 1 / length**2)  # below 0: round-off of rigid-body modes
    mobility = mobility @ shapes
    compliance = mobility / omega
    reach = []
    for channel in channels:
        row = channel.row(model)
        spread = np.linalg.norm(row @ (compliance if channel.order == 0 else mobility))
        # An acceleration is taken for the slowest motion it can be: the widest prior.
        reach.append(spread * (omega[0] if channel.order == 2 else 1.0))
    n = len(M)
    root = np.zeros((2 * n, 2 * n))
    root[:n, :n], root[n:, n:] = compliance, mobility
    return root, np.array(reach)


def unknowns_of(model: StructuralModel) -> tuple[Unknown, ...]:
    """Return the unknown parameters of a structure, of which there must be at least one.

    Raises
    ------
    UsageError
        If there is none.
    """
    if not model.unknowns:
        raise UsageError("no joint parameter is unknown", remedy="Give a joint's k or c a `start`.")
    return model.unknowns


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


def _slopes(driven: Excitation, M: Array, unknowns: Sequence[Unknown]) -> tuple[Array, Array]:
    """Return the changes of system and output matrix by a unit of each unknown (p x …)."""
    n = len(M)
    by_A = np.zeros((len(unknowns), 2 * n, 2 * n))
    for change, unknown in zip(by_A, unknowns, strict=True):
        here = slice(0, n) if unknown.letter == "k" else slice(n, 2 * n)
        change[n:, here] = -np.linalg.solve(M, driven.others(as_array(unknown.pattern)))
    accelerations = np.array(driven.orders)[:, None] == 2
    return by_A, np.where(accelerations, driven.rows @ by_A[:, n:], 0.0)
