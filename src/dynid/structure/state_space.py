"""First-order form of structures, and the elimination of massless DOFs.

A massless direction z is no second-order state. Where a damper acts on it, its displacement is a state of
first order, ``C_zz z' = f_z - …``; where none does, it follows the others and its force,
``K_zz z = f_z - …``, so that its velocity and acceleration contain derivatives of the force. For estimation
in time, massless DOFs between known springs are condensed statically, which is exact.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dynid.arrays import Array, guarded
from dynid.errors import Singular, UsageError
from dynid.lti.state_space import StateSpace
from dynid.structure.labels import Label, listed
from dynid.structure.matrices import Matrix, as_array
from dynid.structure.model import StructuralModel
from dynid.structure.modes.dense import condense_massless

_EPS = float(np.finfo(float).eps)
# An eigenvalue of a matrix scaled to a unit diagonal that is zero, and one that is not; relative to its size.
_NULL, _RANGE = 10 * _EPS, 1e3 * _EPS


class _MassDirections(NamedTuple):
    """A basis ``[inertial, damped, static]`` of all displacements (n x n in all), and its inverse by rows.

    `inertial` directions have mass, `damped` ones a damper and no mass, `static` ones neither.
    """

    inertial: Array
    damped: Array
    static: Array
    inverse: Array

    @property
    def states(self) -> Array:
        """The states (inertial and damped displacements, inertial velocities) of [x, x'] (states x 2 n)."""
        n, first = len(self.inverse), self.inertial.shape[1]
        slow = first + self.damped.shape[1]
        out = np.zeros((slow + first, 2 * n))
        out[:slow, :n], out[slow:, n:] = self.inverse[:slow], self.inverse[:first]
        return out


@guarded("the system matrix of the structure")
def state_space(M: Array, C: Array, K: Array, forces: Array, outputs: Array, orders: ArrayLike) -> StateSpace:
    """Return the state space of a second-order system.

    The states are [x, x'] where the mass is positive definite, else those of `_MassDirections.states`.

    `M`, `C`, `K`: mass (symmetric), damping and stiffness (n x n); `forces`: force directions (n x inputs);
    `outputs`: displacement rows (outputs x n); `orders`: derivative order of each output: 0 displacement, 1
    velocity, 2 acceleration. Raises Singular if a motion has no inertia, damping or stiffness, and UsageError
    if mass or damping is indefinite in a massless direction.
    """
    order = np.asarray(orders, dtype=int)[:, None]
    if massless_motion(M):
        return _with_massless(massless_directions(M, C), M, C, K, forces, outputs, order)
    n = len(M)
    flexibility = np.linalg.solve(M, np.concatenate([-K, -C, forces], axis=1))
    A = np.concatenate([np.eye(n, 2 * n, k=n), flexibility[:, : 2 * n]])
    B = np.concatenate([np.zeros_like(forces), flexibility[:, 2 * n :]])
    by_order = np.stack([np.eye(n, 2 * n), np.eye(n, 2 * n, k=n), A[n:]])
    rows = np.take_along_axis(outputs @ by_order, order[None, :, :], axis=0)[0]
    return StateSpace(A, B, rows, np.where(order == 2, outputs @ B[n:], 0.0))


def _with_massless(
    basis: _MassDirections,
    M: Array,
    C: Array,
    K: Array,
    forces: Array,
    outputs: Array,
    order: NDArray[np.int_],
) -> StateSpace:
    """Return the state space of a system with massless directions, by elimination of the static ones."""
    R, Z, S = basis.inertial, basis.damped, basis.static
    m, d, inputs = R.shape[1], Z.shape[1], forces.shape[1]
    # Static displacements G s + H u of the states s = [a, b, a'] and the forces u.
    KS = S.T @ K @ S
    scale = np.sqrt(np.where((size := np.abs(np.diag(KS))) > 0, size, 1.0))
    held = np.linalg.svd(KS / scale / scale[:, None], compute_uv=False)
    if held.min(initial=1.0) <= len(KS) * _NULL:
        raise Singular(
            "massless DOFs can move without strain: the structure has a motion with neither inertia, damping "
            "nor stiffness",
            remedy="Give them mass, or join them.",
        )
    follows = np.linalg.solve(KS, S.T @ np.concatenate([-K @ R, -K @ Z, forces], axis=1))
    G, H = np.concatenate([follows[:, : m + d], np.zeros((S.shape[1], m))], axis=1), follows[:, m + d :]
    X = np.concatenate([R, Z, np.zeros_like(R)], axis=1) + S @ G
    X0 = S @ H
    # Forces of stiffness and inertial velocities at the states, and of the inputs.
    V = np.concatenate([np.zeros((len(M), m + d)), R], axis=1)
    pull, push = K @ X + C @ V, forces - K @ X0
    damped = np.linalg.solve(Z.T @ C @ Z, Z.T @ np.concatenate([-pull, push], axis=1))
    states = m + d + m
    speed, kick = damped[:, :states], damped[:, states:]
    inertial = np.linalg.solve(
        R.T @ M @ R, R.T @ np.concatenate([-pull - C @ Z @ speed, push - C @ Z @ kick], axis=1)
    )
    A = np.concatenate([np.eye(m, states, k=m + d), speed, inertial[:, :states]])
    B = np.concatenate([np.zeros((m, inputs)), kick, inertial[:, states:]])
    rows = outputs @ X
    direct = outputs @ X0
    by_state = np.stack([rows, rows @ A, rows @ A @ A])
    none = np.zeros_like(direct)
    by_input = np.stack([[direct, rows @ B, rows @ A @ B], [none, direct, rows @ B], [none, none, direct]])
    read = np.take_along_axis(by_state, order[None, :, :], axis=0)[0]
    D, *higher = (np.take_along_axis(array, order[None, :, :], axis=0)[0] for array in by_input)
    while higher and not np.any(higher[-1]):
        higher.pop()
    return StateSpace(A, B, read, D, tuple(higher))


def massless_directions(M: Array, C: Array) -> _MassDirections:
    """Return the directions with mass, with a damper alone, and with neither.

    `M`, `C`: mass (n x n), symmetric, and damping, whose rows of DOFs with prescribed motion may be zero.
    Raises UsageError if mass or damping is indefinite in a massless direction.
    """
    R, N = _range_and_null(M, "mass")
    kept, empty = _range_and_null(N.T @ C @ N, "damping")
    Z, S = N @ kept, N @ empty
    if np.abs(S.T @ C).max(initial=0.0) > _RANGE * np.abs(C).max(initial=0.0):
        raise UsageError(
            "the damping is indefinite: it couples a massless motion that it does not damp",
            remedy="Check signs and units of the damping.",
        )
    joined = np.concatenate([R, Z, S], axis=1)
    return _MassDirections(R, Z, S, np.linalg.inv(joined))


def _range_and_null(matrix: Array, name: str) -> tuple[Array, Array]:
    """Return bases of range and null space of a semidefinite matrix; single DOFs wherever possible."""
    n, diagonal = len(matrix), np.diag(matrix)
    zero = ~(np.any(matrix, axis=0) | np.any(matrix, axis=1))
    R, N = np.eye(n)[:, ~zero], np.eye(n)[:, zero]
    if zero.all():
        return R, N
    if np.any(diagonal[~zero] <= 0):
        raise _indefinite(name)
    scale = np.sqrt(diagonal[~zero])
    values, vectors = np.linalg.eigh(matrix[np.ix_(~zero, ~zero)] / scale / scale[:, None])
    null = values <= n * _NULL
    if not null.any():
        return R, N
    if values[0] < -n * _RANGE:
        raise _indefinite(name)
    mixed = R @ (vectors / scale[:, None])
    return mixed[:, ~null], np.concatenate([N, mixed[:, null]], axis=1)


def massless_motion(M: Array) -> str:
    """Return the massless motion of a mass matrix (n x n) in words; empty where it is positive definite."""
    diagonal = np.diag(M)
    massless = int(np.count_nonzero(diagonal <= 0))
    if massless:
        return f"{massless} of its {len(M)} DOFs have no mass"
    scale = np.sqrt(diagonal)
    smallest = float(np.linalg.eigvalsh(M / scale / scale[:, None])[0])
    return "" if smallest > len(M) * _EPS else "some motion moves no mass"


def _indefinite(name: str) -> UsageError:
    return UsageError(
        f"the {name} matrix is indefinite, which shows in a massless direction",
        remedy=f"Check signs and units of the {name}.",
        names=(name,),
    )


def massless(M: Matrix) -> list[int]:
    """Return the DOFs, from 0, whose row of a mass matrix is zero."""
    return np.flatnonzero(np.asarray(M.__abs__().sum(axis=0)).ravel() == 0).tolist()


def without_massless(model: StructuralModel, dofs: Sequence[Label]) -> StructuralModel:
    """Return a structure without its massless DOFs, which follow the others statically.

    This is exact where only known springs act on them, and they are neither loaded nor measured.

    `model`: the structure; one without massless DOFs is returned as it is; `dofs`: DOFs of loads and sensors.
    Raises UsageError if a massless DOF is damped, loaded, measured, or an unknown parameter acts on it, and
    Singular if one can move without strain.
    """
    model.needs_causal("record of time")
    M, C, _ = model.with_known_joints()
    empty = massless(M)
    if not empty:
        return model
    acting = {label: "a force or a sensor is there" for dof in dofs for label in model.moved_by(dof)}
    acting |= {model.dofs[at]: "a damper acts on it" for at in np.setdiff1d(empty, massless(C))}
    for joint in model.joints:
        if any(term.product.terms for term in joint.terms):
            what = f"the unknown joint {joint.name} acts on it"
            acting |= {label: what for dof in joint.dofs for label in model.moved_by(dof)}
    for term in model.terms:
        named = ", ".join(sorted(term.coefficient.names))
        rows = np.setdiff1d(empty, massless(term.matrix))
        acting |= {model.dofs[at]: f"the unknown {named} acts on it" for at in rows}
    labels = [model.dofs[at] for at in empty]
    for label in labels:
        if label in acting:
            raise UsageError(
                f"DOF {label} has no mass, and {acting[label]}: it cannot be condensed for an "
                f"identification from time records (massless: {listed(labels)})",
                remedy=f"Give DOF {label} a mass, move what acts on it to a DOF with mass, or identify from "
                "frequency response functions.",
                names=("structure",),
            )
    ends = [dof for joint in model.joints for dof in joint.dofs]
    if any(isinstance(dof, int) and model.label(dof) != dof for dof in [*dofs, *ends]):
        raise UsageError(
            "DOFs are named by their numbers, which change as massless DOFs are condensed",
            remedy=f"Name them by their labels, such as {model.dofs[0]}.",
            names=("structure",),
        )
    there = [
        joint for joint in model.joints if any(set(model.moved_by(dof)) & set(labels) for dof in joint.dofs)
    ]
    M, C, K = (as_array(matrix) for matrix in model.joined(there).with_joints())
    _, stiffness, mass = condense_massless(K, M, np.array(empty))
    kept = np.setdiff1d(np.arange(model.size), empty)
    others = tuple(joint for joint in model.joints if joint not in there)
    terms = (term._replace(matrix=as_array(term.matrix)[np.ix_(kept, kept)]) for term in model.terms)
    modal = tuple(part.projected(np.eye(model.size)[:, kept]) for part in model.modal)
    return replace(
        model, M=mass, C=C[np.ix_(kept, kept)], K=stiffness, joints=others,
        dofs=tuple(model.dofs[at] for at in kept), terms=tuple(terms), modal=modal,
    )  # fmt: skip
