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
from dynid.structure.joint_laws import BoundLaw
from dynid.structure.model import StructuralModel
from dynid.structure.model_laws import model_laws
from dynid.structure.nonlinear.march import Accuracy, accurate_march
from dynid.structure.nonlinear.tables import LinearRest, Motion
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
        system.B.shape[1],
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
    )


def _read(
    motion: Motion, driven: Excitation, d: Array, C: Array, D: Array, directions: Array, inputs: Array
) -> TimeResponse:
    """Return what channels read of a motion; accelerations contain the joint forces."""
    states = motion.states * d
    n = states.shape[1] // 2
    through = np.where(np.array(driven.orders)[:, None] == 2, driven.rows @ directions[n:], 0.0)
    return TimeResponse(states @ C.T + inputs @ D.T + motion.forces @ through.T, states, inputs)


def _first_hidden(laws: Sequence[BoundLaw], deflections: Array) -> Array:
    """Return the hidden states that are nearest to zero among those with which a motion may start (laws)."""
    hidden = []
    for law in laws:
        centre, width = law.law.range_of_hidden(law.values, float(deflections[law.row]))
        hidden.append(float(np.clip(0.0, centre - width, centre + width)) if law.law.hidden else 0.0)
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
    )
