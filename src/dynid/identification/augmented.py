"""The augmented model: physical states, and the logarithms of the unknown joint parameters.

Source: K. T. Yang 1997, eqs 12–13. Logarithms keep the parameters positive; joints that are known are
part of the physical model and add no state. For fixed parameters the physical part is linear and is
propagated exactly, with the signals' generators joined to it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.errors import UsageError
from dynid.lti.exponential import balance, exponential_with_derivatives, rescaled
from dynid.lti.propagate import check_phase, drive_scale, joint_generator
from dynid.lti.timeline import Timeline, timeline
from dynid.structure.joints import Unknown
from dynid.structure.matrices import as_array
from dynid.structure.model import StructuralModel
from dynid.structure.motion import Drive, drive, prescribed_state, signals_of
from dynid.structure.response import Channel, Load

if TYPE_CHECKING:
    from dynid.identification.kernels.steps import Tables

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
class AugmentedModel:
    """A structure with unknown joint parameters, its loads and channels, on the record's timeline.

    The physical states are displacements and velocities divided by `scale`, powers of two that balance
    the system matrix. Build it with `augmented`.

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
    feedthrough
        Direct terms of the loads on the channels, evaluated (times x channels).
    line
        The record's timeline.
    W
        Generator states at the nodes (nodes x q), scaled to `drive`.
    initial, known
        What prescribed motions tell of the first state (n), scaled, zero elsewhere; and where they do (n).
    """

    unknowns: tuple[Unknown, ...]
    scale: Array
    A: Array
    A_slopes: Array
    B: Array
    drive: Array
    C: Array
    C_slopes: Array
    feedthrough: Array
    line: Timeline
    W: Array
    initial: Array
    known: NDArray[np.bool_]

    @property
    def states(self) -> int:
        """Number of physical states."""
        return len(self.A)

    @property
    def parameters(self) -> int:
        """Number of parameter states."""
        return len(self.unknowns)

    @cached_property
    def tables(self) -> Tables:
        """What kernels need of the model."""
        from dynid.identification.kernels.steps import tables  # loads numba

        return tables(self)

    def transition(self, logs: Array, h: float) -> Transition:
        """Return the exact step over h at the parameters ``exp(logs)``, with its derivatives."""
        values = np.exp(logs)
        n = self.states
        change = values[:, None, None] * self.A_slopes
        size = n + len(self.line.G)
        derivatives = np.zeros((len(logs), size, size))
        derivatives[:, :n, :n] = change
        joint = joint_generator(self.A + change.sum(axis=0), self.drive, self.line.G)
        E, dE = exponential_with_derivatives(joint, derivatives, h)
        return Transition(E[:n], dE[:, :n])

    def output(self, logs: Array) -> tuple[Array, Array]:
        """Return the output matrix (channels x n) and its derivatives (p x channels x n)."""
        change = np.exp(logs)[:, None, None] * self.C_slopes
        return self.C + change.sum(axis=0), change


def augmented(
    model: StructuralModel, loads: Sequence[Load], channels: Sequence[Channel], times: Array
) -> AugmentedModel:
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
    system = driven.system(*fixed)
    A_slopes, C_slopes = _slopes(driven, driven.mass(fixed[0]), unknowns)
    initial, known = prescribed_state(model, loads, float(times[0]))
    started, d = _at_start(system.A, A_slopes, unknowns)
    poles = np.linalg.eigvals(started).astype(complex)
    check_phase(poles, float(times[-1] - times[0]), [unknown.name for unknown in unknowns])
    line = timeline(signals_of(loads), times, float(times[0]))
    _check_cost(len(line.nodes), len(d) * (1 + len(unknowns)), driven.rows.size * len(times) * 2)
    entering = system.B @ line.H / d[:, None]
    w_scale = drive_scale(started, entering)
    return AugmentedModel(
        unknowns=unknowns,
        scale=d,
        A=rescaled(system.A, d),
        A_slopes=rescaled(A_slopes, d),
        B=system.B / d[:, None],
        drive=entering * w_scale,
        C=system.C * d,
        C_slopes=C_slopes * d,
        feedthrough=line.inputs() @ system.D.T,
        line=line,
        W=line.W / w_scale,
        initial=initial / d,
        known=known,
    )


def _at_start(A: Array, slopes: Array, unknowns: Sequence[Unknown]) -> tuple[Array, Array]:
    """Return the system matrix where the unknowns start, balanced, and the units that balance it (n)."""
    started = A + np.einsum("p,pij->ij", [unknown.start for unknown in unknowns], slopes)
    d = balance(started)
    return rescaled(started, d), d


def unknowns_of(model: StructuralModel) -> tuple[Unknown, ...]:
    """Return the unknown parameters of a structure, of which there must be one.

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


def _slopes(driven: Drive, M: Array, unknowns: Sequence[Unknown]) -> tuple[Array, Array]:
    """Return the changes of system and output matrix by a unit of each unknown (p x …)."""
    by_A = np.stack(
        [_change(M, unknown.letter, driven.others(as_array(unknown.pattern))) for unknown in unknowns]
    )
    accelerations = np.array(driven.orders)[:, None] == 2
    return by_A, np.where(accelerations, driven.rows @ by_A[:, len(M) :], 0.0)


def _change(M: Array, letter: str, pattern: Array) -> Array:
    """Return the change of the system matrix by a unit of an unknown k or c of this pattern."""
    n = len(M)
    change = np.zeros((2 * n, 2 * n))
    here = slice(0, n) if letter == "k" else slice(n, 2 * n)
    change[n:, here] = -np.linalg.solve(M, pattern)
    return change
