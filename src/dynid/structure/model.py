"""Structures as mass, damping and stiffness matrices with joints between labelled DOFs.

Source: K. T. Yang 1997, eq 1: the joints' matrices C_s, K_s are added to those of the rest.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dynid.errors import UsageError
from dynid.lti.floating import guarded
from dynid.lti.model import StateSpace

Array = NDArray[np.float64]


@dataclass(frozen=True)
class JointParameter:
    """Stiffness or damping of a joint: known (`value`), or unknown (`start`, and `true` for simulation).

    Parameters
    ----------
    value
        The known value, N/m or N·s/m (N·m/rad, N·m·s/rad for rotations).
    start
        Initial guess of an unknown value, positive.
    true
        The unknown's true value where it is known, positive: what simulated records are made with.
    """

    value: float | None = None
    start: float | None = None
    true: float | None = None

    def __post_init__(self) -> None:
        if (self.value is None) == (self.start is None):
            raise UsageError("a joint parameter takes either a value (known) or a start (unknown)")
        if self.value is not None and self.true is not None:
            raise UsageError("a known joint parameter has no true value beside its value")
        if self.value is not None and not (math.isfinite(self.value) and self.value >= 0):
            raise UsageError("a joint parameter's value must be finite and not negative")
        for number in (self.start, self.true):
            if number is not None and not (math.isfinite(number) and number > 0):
                raise UsageError(
                    "start and true value of an unknown joint parameter must be finite and positive",
                    remedy="Its logarithm is estimated. Leave k or c out where a joint has none.",
                )


@dataclass(frozen=True)
class Joint:
    """A spring and a damper in parallel, between two DOFs or from one DOF to ground.

    Parameters
    ----------
    name
        Its name; its parameters are called ``<name>.k`` and ``<name>.c``.
    dofs
        One DOF (joint to ground) or two.
    k, c
        Stiffness and damping; a number is a known value, absent means zero.
    """

    name: str
    dofs: tuple[int, ...]
    k: JointParameter | float | None = None
    c: JointParameter | float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "dofs", tuple(self.dofs))
        if len(self.dofs) not in (1, 2) or len(set(self.dofs)) != len(self.dofs):
            raise UsageError(
                f"joint {self.name} must name one DOF (to ground) or two different ones", names=(self.name,)
            )

    @property
    def parameters(self) -> dict[str, JointParameter]:
        """The parameters present, by letter (``k``, ``c``)."""
        given = {"k": self.k, "c": self.c}
        return {
            letter: part if isinstance(part, JointParameter) else JointParameter(value=part)
            for letter, part in given.items()
            if part is not None
        }


class Unknown(NamedTuple):
    """An unknown joint parameter: its name, letter, unit pattern (n x n), start and true value."""

    name: str
    letter: str
    pattern: Array
    start: float
    true: float | None


@dataclass(frozen=True, eq=False)
class StructuralModel:
    """``M x'' + (C + C_s) x' + (K + K_s) x = f`` (Yang, eq 1), the joints' C_s and K_s kept apart.

    Parameters
    ----------
    M, C, K
        Mass, damping and stiffness without the joints (n x n), symmetric; M positive definite.
    joints
        The joints.
    dofs
        Labels of the DOFs; absent: 1 … n.

    Raises
    ------
    UsageError
        If shapes, symmetry or labels make no sense, or the mass matrix is not positive definite.
    """

    M: Array
    C: Array
    K: Array
    joints: tuple[Joint, ...] = ()
    dofs: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "joints", tuple(self.joints))
        n = len(np.atleast_1d(self.M))
        for name in ("M", "C", "K"):
            object.__setattr__(self, name, _symmetric(name, getattr(self, name), n))
        object.__setattr__(self, "dofs", tuple(self.dofs) or tuple(range(1, n + 1)))
        if len(self.dofs) != n or len(set(self.dofs)) != n:
            raise UsageError(f"the number of different DOF labels must be {n}, not {len(set(self.dofs))}")
        _check_mass(self.M)
        names = [joint.name for joint in self.joints]
        for name in names:
            if names.count(name) > 1:
                raise UsageError(f"there are two joints named {name}", names=(name,))
        for joint in self.joints:
            self._direction(joint)

    @property
    def size(self) -> int:
        """Number of DOFs."""
        return len(self.M)

    def row(self, dof: int) -> Array:
        """Return the row (n) that reads the displacement of a DOF; also the direction of a force on it."""
        if dof not in self.dofs:
            raise UsageError(
                f"there is no DOF {dof}",
                remedy=f"The structure has {_span(self.dofs)}.",
                names=(str(dof),),
            )
        row = np.zeros(self.size)
        row[self.dofs.index(dof)] = 1.0
        return row

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        """The unknown joint parameters, joint by joint, stiffness before damping."""
        return tuple(
            Unknown(f"{joint.name}.{letter}", letter, self._pattern(joint), part.start, part.true)
            for joint in self.joints
            for letter, part in joint.parameters.items()
            if part.start is not None
        )

    @guarded("the sum of stiffness or damping at a DOF", UsageError)
    def with_joints(self, values: Mapping[str, float] | None = None) -> tuple[Array, Array, Array]:
        """Return M, C + C_s and K + K_s (Yang, eq 1).

        Parameters
        ----------
        values
            The unknown parameters by name (``<joint>.k``, ``<joint>.c``).

        Raises
        ------
        UsageError
            If an unknown parameter has no value, or a name is no unknown parameter.
        """
        given = dict(values or {})
        C, K = self.C.copy(), self.K.copy()
        for joint in self.joints:
            for letter, part in joint.parameters.items():
                name = f"{joint.name}.{letter}"
                value = part.value if part.value is not None else given.pop(name, None)
                if value is None:
                    raise UsageError(f"the joint parameter {name} has no value", names=(name,))
                target = K if letter == "k" else C
                target += value * self._pattern(joint)
        if given:
            this = "this name" if len(given) == 1 else "these names"
            raise UsageError(f"{', '.join(given)}: no unknown joint parameter has {this}", names=given)
        return self.M, C, K

    def true_values(self) -> dict[str, float]:
        """Return the true values of the unknown parameters.

        Raises
        ------
        UsageError
            If one has no true value.
        """
        missing = [unknown.name for unknown in self.unknowns if unknown.true is None]
        if missing:
            raise UsageError(
                f"no true value is known of {', '.join(missing)}",
                remedy="Give `true` beside `start`: records are simulated with it.",
                names=missing,
            )
        return {unknown.name: unknown.true for unknown in self.unknowns if unknown.true is not None}

    def _direction(self, joint: Joint) -> Array:
        try:
            rows = [self.row(dof) for dof in joint.dofs]
        except UsageError as error:
            raise UsageError(
                f"joint {joint.name}: {error.problem}", remedy=error.remedy, names=(joint.name,)
            ) from None
        return rows[0] if len(rows) == 1 else rows[0] - rows[1]

    def _pattern(self, joint: Joint) -> Array:
        direction = self._direction(joint)
        return np.outer(direction, direction)


@guarded("the system matrix of the structure")
def state_space(M: Array, C: Array, K: Array, forces: Array, outputs: Array, orders: ArrayLike) -> StateSpace:
    """Return the state space, states [x, x'], of a second-order system.

    Parameters
    ----------
    M, C, K
        Mass, damping and stiffness (n x n).
    forces
        Force directions (n x inputs).
    outputs
        Displacement rows (outputs x n).
    orders
        Derivative order of each output: 0 displacement, 1 velocity, 2 acceleration.
    """
    n = len(M)
    flexibility = np.linalg.solve(M, np.concatenate([-K, -C, forces], axis=1))
    A = np.concatenate([np.eye(n, 2 * n, k=n), flexibility[:, : 2 * n]])
    B = np.concatenate([np.zeros_like(forces), flexibility[:, 2 * n :]])
    order = np.asarray(orders, dtype=int)[:, None]
    by_order = np.stack([np.eye(n, 2 * n), np.eye(n, 2 * n, k=n), A[n:]])
    rows = np.take_along_axis(outputs @ by_order, order[None, :, :], axis=0)[0]
    return StateSpace(A, B, rows, np.where(order == 2, outputs @ B[n:], 0.0))


def _symmetric(name: str, values: ArrayLike, n: int) -> Array:
    matrix = np.array(values, dtype=float)
    if matrix.shape != (n, n) or n == 0:
        raise UsageError(f"{name} is {matrix.shape}, but must be a square matrix, the same size as M")
    if not np.all(np.isfinite(matrix)):
        raise UsageError(f"{name} has entries that are not finite numbers")
    if not np.allclose(matrix, matrix.T, rtol=0, atol=1e-10 * float(np.abs(matrix).max())):
        raise UsageError(f"{name} is not symmetric")
    matrix.setflags(write=False)
    return matrix


def _check_mass(M: Array) -> None:
    scale = np.sqrt(np.abs(np.diag(M)))
    if np.all(np.diag(M) > 0):
        smallest = float(np.linalg.eigvalsh(M / scale / scale[:, None])[0])
        if smallest > len(M) * np.finfo(float).eps:
            return
    raise UsageError(
        "the mass matrix is not positive definite",
        remedy="Give every DOF mass, or condense the massless ones.",
    )


def _span(dofs: tuple[int, ...]) -> str:
    if len(dofs) == 1:
        return f"DOF {dofs[0]} only"
    if dofs == tuple(range(dofs[0], dofs[-1] + 1)):
        return f"the DOFs {dofs[0]} to {dofs[-1]}"
    return f"the DOFs {', '.join(map(str, dofs))}"
