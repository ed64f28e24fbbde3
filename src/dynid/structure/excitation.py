"""Excitation of a structure: forces, prescribed motions of DOFs, and motion of the ground.

A DOF whose motion is prescribed stays in the model: its row reads x'' = a(t), its coupling to the others
acts as in the matrices, whatever joints are between. Of a ground that moves as a whole the motion is
eliminated: displacements are relative to it, and M (x'' + r a) + C x' + K x = 0, r the rigid translation.
A displacement or a velocity that is prescribed acts by its derivative, with the initial state known.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynid.arrays import Array
from dynid.errors import UsageError
from dynid.lti.frequency_response import QUANTITIES
from dynid.lti.signals import Derivative, Signal
from dynid.lti.state_space import StateSpace
from dynid.structure import labels
from dynid.structure.labels import Label
from dynid.structure.matrices import Matrix, as_array
from dynid.structure.model import StructuralModel
from dynid.structure.ports import Channel, Load, ports
from dynid.structure.state_space import massless_directions, massless_motion, state_space


@dataclass(frozen=True, eq=False)
class Excitation:
    """Directions of the loads and rows of the channels.

    `rows`, `orders`: displacement rows of the channels (channels x n) and their derivative orders; `held`:
    coordinate of each load that prescribes a motion, -1 for a force or the ground; `directions`: directions
    of forces, and of prescribed motions (n x loads); `base`: direct share of the ground's acceleration in
    each channel (channels x loads).
    """

    rows: Array
    orders: list[int]
    held: list[int]
    directions: Array
    base: Array

    @property
    def _coordinates(self) -> list[int]:
        return [coordinate for coordinate in self.held if coordinate >= 0]

    def mass(self, M: Array) -> Array:
        """Return the mass matrix with the prescribed DOFs uncoupled (n x n)."""
        uncoupled, places = self.free(M), self._coordinates
        uncoupled[places, places] = 1.0
        return uncoupled

    def free(self, matrix: Array) -> Array:
        """Return a change of the mass matrix (n x n) that leaves the prescribed DOFs as they are."""
        uncoupled, places = matrix.copy(), self._coordinates
        uncoupled[places], uncoupled[:, places] = 0.0, 0.0
        return uncoupled

    def inertia(self, M: Array) -> Array:
        """Return the forces (n x loads) by which prescribed motions of DOFs act through a mass matrix."""
        forces = np.zeros_like(self.directions)
        for load, coordinate in enumerate(self.held):
            if coordinate >= 0:
                forces[:, load] = -M[:, coordinate] * self.directions[coordinate, load]
        forces[self._coordinates] = 0.0
        return forces

    def others(self, matrix: Array) -> Array:
        """Return a stiffness or damping (n x n) that exerts nothing on the prescribed DOFs."""
        free = matrix.copy()
        free[self._coordinates] = 0.0
        return free

    def system(self, M: Array, C: Array, K: Array) -> StateSpace:
        """Return the state space from the signals to the channels."""
        forces = self.directions + self.inertia(M)
        system = state_space(self.mass(M), self.others(C), self.others(K), forces, self.rows, self.orders)
        return replace(system, D=system.D + self.base)

    def state(self, M: Array, C: Array, motion: Array) -> Array:
        """Return the state of `system` for displacements and velocities [x, x'] (2 n)."""
        if not massless_motion(mass := self.mass(M)):
            return motion
        return np.asarray(massless_directions(mass, self.others(C)).states @ motion)

    def check_initial(
        self,
        M: Array,
        C: Array,
        dofs: Sequence[Label],
        displacement: Mapping[Label, float] | None,
        velocity: Mapping[Label, float] | None,
    ) -> None:
        """Refuse initial values of DOFs (their labels: n) that follow from the motion of the others.

        Raises UsageError naming the DOF.
        """
        if not massless_motion(mass := self.mass(M)):
            return
        n, states = len(M), massless_directions(mass, self.others(C)).states
        free = np.any(states, axis=0)
        missing = "neither mass nor damping", "no mass"
        for name, first, values, lacks in zip(
            ("displacement", "velocity"), (0, n), (displacement, velocity), missing, strict=True
        ):
            for dof, value in (values or {}).items():
                if value and dof in dofs and not free[first + dofs.index(dof)]:
                    raise UsageError(
                        f"the initial {name} of DOF {dof} cannot be given: the DOF has {lacks}",
                        remedy="Leave it out: it follows from the motion of the others.",
                        names=("initial",),
                    )


def drive(
    model: StructuralModel,
    loads: Sequence[Load],
    channels: Sequence[Channel],
    values: Mapping[str, float] | None = None,
) -> Excitation:
    """Return the directions of the loads and the rows of the channels.

    `model`, `loads`, `channels`: the structure, its loads and its channels; `values`: unknown parameters by
    name, on which the mass moved by the ground may depend; default: the reference. Raises UsageError if a DOF
    or quantity does not exist, or a motion cannot be prescribed there.
    """
    _, rows, orders = ports(model, [], channels)
    directions = np.zeros((model.size, len(loads)))
    base = np.zeros((len(channels), len(loads)))
    held = [-1] * len(loads)
    for k, load in enumerate(loads):
        if load.dof is None:
            carried = _full(model)
            shake = _shaken(model, carried.mass(values))
            directions[:, k] = -shake
            for row, channel in enumerate(channels):
                if channel.absolute:
                    if channel.order != QUANTITIES["acceleration"] or channel.reference is not None:
                        raise UsageError(
                            f"{channel.name}: only the acceleration of one DOF is measured absolutely",
                            remedy="Displacements and velocities of a structure on a moving ground are "
                            "relative to it.",
                            names=("measurement",),
                        )
                    base[row, k] = float(np.asarray(channel.row(carried)) @ _translation(carried))
        else:
            directions[:, k] = model.row(load.dof)
            if load.order is not None:
                held[k], _ = _coordinate(model, load)
    if len({coordinate for coordinate in held if coordinate >= 0}) < sum(
        coordinate >= 0 for coordinate in held
    ):
        raise UsageError("the motion of a DOF is prescribed twice", names=("excitation",))
    if any(channel.absolute for channel in channels) and all(load.dof is not None for load in loads):
        raise UsageError(
            "an absolute channel differs from a relative one only where the ground moves",
            remedy="Leave out 'frame', or excite the base.",
            names=("measurement",),
        )
    return Excitation(rows, orders, held, directions, base)


def signals_of(loads: Sequence[Load]) -> list[Signal]:
    """Return the acting signals: of forces themselves, of motions the accelerations."""
    acting = []
    for load in loads:
        order = 0 if load.order is None else 2 - load.order
        acting.append(Derivative(load.signal, order) if order else load.signal)
    return acting


def inputs_of(loads: Sequence[Load], times: Array, acting: Array) -> Array:
    """Return the loads as they are given (times x loads), from the acting signals."""
    shown = acting.copy()
    for k, load in enumerate(loads):
        if load.motion is not None:
            shown[:, k] = load.signal.value(times)
    return shown


def prescribed_state(model: StructuralModel, loads: Sequence[Load], time: float) -> tuple[Array, np.ndarray]:
    """Return the state [x, x'] (2 n) as far as motions prescribe it at a time, and where they do (2 n).

    A prescribed displacement sets both, a prescribed velocity only itself, an acceleration neither.
    """
    n = model.size
    state, prescribed = np.zeros(2 * n), np.zeros(2 * n, dtype=bool)
    for load in loads:
        derivative = load.order
        if derivative is None or load.dof is None:
            continue
        coordinate, sign = _coordinate(model, load)
        for quantity in range(derivative, 2):
            order = quantity - derivative
            signal = Derivative(load.signal, order) if order else load.signal
            state[coordinate + n * quantity] = sign * float(signal.value(time))
            prescribed[coordinate + n * quantity] = True
    return state, prescribed


def starting_state(
    model: StructuralModel,
    loads: Sequence[Load],
    displacement: Mapping[Label, float] | None = None,
    velocity: Mapping[Label, float] | None = None,
) -> Array:
    """Return the state [x, x'] (2 n) at t = 0.

    `model`: the structure; of a reduced one the nearest motion, by kinetic energy; `loads`: prescribed
    motions start as they are prescribed; `displacement`, `velocity`: initial displacement, m, and velocity,
    m/s, by DOF; default: 0. Raises UsageError if a DOF does not exist.
    """
    initial = np.concatenate([_initial(model, displacement), _initial(model, velocity)])
    prescribed, is_prescribed = prescribed_state(model, loads, 0.0)
    return np.where(is_prescribed, prescribed, initial)


def _initial(model: StructuralModel, values: Mapping[Label, float] | None) -> Array:
    if model.basis is not None:
        M, full = as_array(model.M), _initial(model.basis.parent, values)
        momentum = model.basis.T.T @ np.asarray(model.basis.parent.M @ full)
        return np.asarray(np.linalg.lstsq(M, momentum, rcond=None)[0])
    start = np.zeros(model.size)
    for dof, value in (values or {}).items():
        start += value * model.row(dof)
    return start


def _coordinate(model: StructuralModel, load: Load) -> tuple[int, float]:
    """Return the coordinate that is the DOF of a prescribed motion, and the sign of its name."""
    assert load.dof is not None
    row = model.row(load.dof)
    coordinate = int(np.argmax(np.abs(row)))
    if np.count_nonzero(row) != 1 or abs(row[coordinate]) != 1.0:
        raise UsageError(
            f"the motion of DOF {load.dof} cannot be prescribed: it is no coordinate of the reduced model",
            remedy="Keep it as a master, or reduce by a method that keeps its masters.",
            names=("reduction",),
        )
    return coordinate, float(row[coordinate])


def base_slopes(model: StructuralModel, loads: Sequence[Load], values: Mapping[str, float]) -> Array:
    """Return the derivatives (p x n x loads) of the forces by which a moving ground acts."""
    slopes = np.zeros((len(model.unknowns), model.size, len(loads)))
    for k, change in enumerate(_full(model).slopes(values)):
        if "M" in change:
            grounded = [-float(load.dof is None) for load in loads]
            slopes[k] = np.outer(_shaken(model, change["M"]), grounded)
    return slopes


def _full(model: StructuralModel) -> StructuralModel:
    return model if model.basis is None else _full(model.basis.parent)


def _shaken(model: StructuralModel, M: Matrix) -> Array:
    """Return M r of the coordinates, r the unit translation of all that translates in the full model."""
    if model.basis is None:
        return np.asarray(M @ _translation(model))
    return np.asarray(model.basis.T.T @ _shaken(model.basis.parent, M))


def _translation(model: StructuralModel) -> Array:
    kinds = [labels.kind(label) for label in model.dofs]
    return np.array([float(kind != "rotation") for kind in kinds])
