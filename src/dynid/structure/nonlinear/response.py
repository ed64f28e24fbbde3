"""Response in time of a structure with nonlinear joints: its linear rest, and the march through the loads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from dynid.arrays import Array, guarded
from dynid.errors import UsageError
from dynid.lti.exponential import balance, rescaled
from dynid.lti.generator import Signal
from dynid.lti.signals import Impulse, Random
from dynid.lti.time_response import TimeResponse, timeline
from dynid.lti.waveforms import sum_lines
from dynid.result import Result, common_unit
from dynid.structure.excitation import Excitation
from dynid.structure.law import BoundLaw
from dynid.structure.model import StructuralModel
from dynid.structure.model_laws import model_laws
from dynid.structure.nonlinear.accuracy import Accuracy, accurate_march
from dynid.structure.nonlinear.tables import Energy, LinearRest, Motion
from dynid.structure.state_space import massless_motion

# Units of what joints have over time, over deflections.
_UNITS = {"deflection": "m", "rate": "m/s", "force": "N", "work": "J"}


class _JointMotion(NamedTuple):
    """The joints with laws in a response, over its times.

    `deflection`, `rate`, `force`, `work` (times x joints): of all its laws; `regime` (times x laws); `names`
    (joints).
    """

    names: tuple[str, ...]
    laws: tuple[str, ...]
    deflection: Array
    rate: Array
    force: Array
    work: Array
    regime: Array
    accuracy: Accuracy
    events: int
    units: dict[str, str]  # of the arrays, where all joints have the same
    energy_residual: float  # of the balance of energy, relative to the largest term; NaN where not known


# Residual of the energy beyond which its balance is not confirmed: that of motions whose steps resolve the
# modes that take part in it is below 1e-7.
_ENERGY_TOL = 1e-4


@guarded("the time response")
def nonlinear_response(
    model: StructuralModel,
    driven: Excitation,
    signals: Sequence[Signal],
    times: Array,
    motion: Array,
    values: Mapping[str, float],
) -> tuple[TimeResponse, _JointMotion]:
    """Return the response at the channels of an excitation from t = 0 on, and the motion of the joints.

    `signals`: the acting signals, one a load; `times`: increasing times, s; `motion`: displacements and
    velocities at t = 0 (2 n); `values`: unknown parameters by name.

    Raises UsageError if the mass matrix is singular, NumericalError if the motion cannot be followed.
    """
    linear = model.without_laws()
    unknown = {parameter.name for parameter in model.law_unknowns}
    M, C, K = linear.dense({name: value for name, value in values.items() if name not in unknown})
    if some := massless_motion(driven.mass(M)):
        raise UsageError(
            f"the mass matrix is singular ({some}): a structure with nonlinear joints needs mass everywhere",
            remedy="Reduce to DOFs that have mass, or give the others mass.",
            names=("structure",),
        )
    system, n = driven.system(M, C, K), len(M)
    laws = model_laws(model.joints, values)
    bound = [law.bound for law in laws]
    rows = model.deflections()
    directions = np.concatenate(
        [np.zeros((n, len(rows))), -np.linalg.solve(driven.mass(M), driven.others(rows.T))]
    )
    d = balance(system.A)
    read = np.kron(np.eye(2), rows) * d
    rest = LinearRest(
        rescaled(system.A, d), np.concatenate([directions, system.B], axis=1) / d[:, None], read, len(rows),
        system.B.shape[1], _energy(driven.mass(M), system.A, system.B, d),
    )  # fmt: skip
    start = min(0.0, float(times[0]))
    generated = [Impulse(0.0) if isinstance(signal, Random) else signal for signal in signals]
    line = timeline(generated, times, start)
    spread = [
        (column, *signal.lines, signal.period)
        for column, signal in enumerate(signals)
        if isinstance(signal, Random)
    ]

    def added(at: Array) -> Array:
        out = np.zeros((len(at), len(signals)))
        for column, omega, c, period in spread:
            out[:, column] = sum_lines(omega, c[:, None], at, period)[:, 0]
        return out

    x0, z0 = motion / d, _first_hidden(bound, rows @ motion[:n])
    jump = system.B @ line.jumps / d if line.jump_node >= 0 else None
    followed, accuracy = accurate_march(
        rest, bound, line, x0, z0, added=added if spread else None, impulse=jump
    )
    inputs = line.inputs() + added(times)
    return _read(followed, driven, d, system.C, system.D, directions, inputs), _JointMotion(
        tuple(dict.fromkeys(law.joint.name for law in laws)),
        tuple(f"{law.joint.name}.{law.bound.law.kind}" for law in laws),
        followed.states @ read.T[:, : len(rows)],
        followed.states @ read.T[:, len(rows) :],
        followed.forces,
        followed.work[:, : len(rows)],
        followed.regimes.astype(np.int64),
        accuracy,
        followed.events,
        {name: common_unit(model.deflection_units(unit)) for name, unit in _UNITS.items()},
        _energy_residual(rest.energy, followed, x0, len(rows)),
    )


def _energy(M: Array, A: Array, B: Array, d: Array) -> Energy | None:
    """Return the energy of the linear rest in states scaled by d, or None if a damper is negative."""
    n = len(M)
    K, C = -M @ A[n:, :n], -M @ A[n:, n:]
    H = np.zeros_like(A)
    H[:n, :n], H[n:, n:] = (K + K.T) / 2, M
    damping, directions = np.linalg.eigh((C + C.T) / 2)
    size = float(np.abs(damping).max(initial=0.0))
    if damping.min(initial=0.0) < -n * np.finfo(float).eps * size:
        return None
    kept = damping > n * np.finfo(float).eps * size
    dampers = np.zeros((np.count_nonzero(kept), 2 * n))
    dampers[:, n:] = (directions[:, kept] * np.sqrt(damping[kept])).T
    return Energy(d[:, None] * H * d, np.concatenate([B.T @ H, dampers]) * d)


def _energy_residual(energy: Energy | None, motion: Motion, x0: Array, nf: int) -> float:
    """Return the residual of the balance of energy of a motion from a first state."""
    if energy is None:
        return float("nan")
    held = np.sum(motion.states @ energy.H * motion.states, axis=1) / 2
    held -= x0 @ energy.H @ x0 / 2
    laws, (loads, dampers) = motion.work[:, :nf].sum(axis=1), motion.work[:, nf:].T
    size = max(float(np.abs(term).max(initial=0.0)) for term in (held, laws, loads, dampers))
    return float(np.abs(held + laws + dampers - loads).max(initial=0.0)) / (size or 1.0)


def _read(
    motion: Motion, driven: Excitation, d: Array, C: Array, D: Array, directions: Array, inputs: Array
) -> TimeResponse:
    """Return what channels read of a motion; accelerations contain the joint forces."""
    states = motion.states * d
    n = states.shape[1] // 2
    through = np.where(np.array(driven.orders)[:, None] == 2, driven.rows @ directions[n:], 0.0)
    return TimeResponse(states @ C.T + inputs @ D.T + motion.forces @ through.T, states, inputs)


def _first_hidden(laws: Sequence[BoundLaw], deflections: Array) -> Array:
    """Return the hidden states that are nearest to zero among those with which a motion may start (laws).

    Hysteresis that builds up gradually is unloaded.
    """
    hidden = []
    for law in laws:
        centre, width = law.law.range_of_hidden(law.values, float(deflections[law.row]))
        nearest = centre if law.rate(0, 0.0, 0.0, 0.0) else np.clip(0.0, centre - width, centre + width)
        hidden.append(float(nearest) if law.law.hidden else 0.0)
    return np.array(hidden)


def add_joints(result: Result, motion: _JointMotion, times: Array) -> None:
    """Add the joints with laws: deflection, its rate, force, work, and regimes of the laws, over time.

    ``structure/joints/{time, joint, law, deflection, rate, force, work, regime}``; `force` resists the
    deflection and is that of the laws alone, ``work`` is done on them.
    """
    group = "structure/joints"
    result.add_axis(f"{group}/time", times, "s")
    result.add_axis(f"{group}/joint", list(motion.names))
    result.add_axis(f"{group}/law", list(motion.laws))
    for name, unit in motion.units.items():
        result.add(f"{group}/{name}", getattr(motion, name), ("time", "joint"), unit)
    result.add(f"{group}/regime", motion.regime, ("time", "law"))
    result.annotate(
        group,
        events=motion.events,
        steps=motion.accuracy.parts,
        change=motion.accuracy.error,
        energy_residual=motion.energy_residual,
    )
    if motion.energy_residual > _ENERGY_TOL:
        result.annotate(
            group,
            note=f"energy is balanced to {100 * motion.energy_residual:.2g} % only: modes take "
            "part in it that the steps do not resolve; shorten the time between samples",
        )
