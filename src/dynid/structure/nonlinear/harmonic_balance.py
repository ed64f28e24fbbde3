"""Steady states under a sine by harmonic balance, condensed to the deflections of the joints with laws.

In modal coordinates of the structure with the tangents of its laws at rest, the deflections of harmonic h
are ``D_h = B_h P - A_h F_h``: the compliance ``A_h = R Z_h^-1 R^T``, the dynamic stiffness
``Z_h = Lambda + i h omega C - (h omega)^2``, and what the laws' forces have beyond their tangents, F_h
(`dynid.structure.nonlinear.cycle`). The unknowns are the deflections' Fourier coefficients; all derivatives
are exact.

Source: M. Krack, J. Gross, Harmonic Balance for Nonlinear Vibration Problems, Springer (2019).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, NamedTuple

import numpy as np

from dynid.arrays import Array, ComplexArray
from dynid.errors import NumericalError, UsageError
from dynid.structure.law import BoundLaw
from dynid.structure.model import StructuralModel
from dynid.structure.model_laws import model_laws
from dynid.structure.nonlinear.continuation import Point, solve_at
from dynid.structure.nonlinear.cycle import CycleForce, cycle_force
from dynid.structure.nonlinear.fourier import further_harmonics, to_complex, to_real
from dynid.structure.state_space import massless_motion

# Coupling of modes by dampers, relative to their own damping, that is round-off.
_CLASSICAL_TOL = 1e-12
# An eigenvalue of the stiffness, relative to the largest, that is round-off: its mode is of the rigid body.
_RIGID_TOL = 1e-12
# What harmonics that are left out would deflect, relative to the deflection: of smooth laws, and of others,
# whose harmonics decay by powers.
_SMOOTH_TAIL, _KINKED_TAIL = 1e-10, 1e-6
# Part of that below which the highest harmonics are dropped again, and how many of them.
_NEEDED, _SPARE = 0.3, 4
# Largest change of the deflection, relative to it, with which a state continues that of other parameters, or
# of a frequency or amplitude nearby: states of other branches are farther away.
_CLOSE = 0.3
# Smallest part of the amplitude by which the first steady state grows.
_MIN_AMPLITUDE_STEP = 1e-3
# Fewest and most harmonics.
MIN_HARMONICS, MAX_HARMONICS = 3, 101


class Condensed(NamedTuple):
    """A structure in the modes of its stiffness with the laws' tangents at rest.

    `eigenvalues` (n), `damping` (n, or n x n where dampers couple modes), `shapes` (N x n), `deflections`
    (joints x n), `k`, `c` (joints): the tangents; `laws`, and the law's `tail` of harmonics.
    """

    eigenvalues: Array
    damping: Array
    shapes: Array
    deflections: Array
    k: Array
    c: Array
    laws: tuple[BoundLaw, ...]
    tail: float

    def stiffness(
        self, omega: float, harmonics: int, growth: float = 0.0
    ) -> tuple[ComplexArray, ComplexArray]:
        """Return the modal dynamic stiffness of each harmonic and its derivative by the frequency.

        (H + 1 x n, or x n x n); `growth`: damping by the mass that is taken off, 1/s.
        """
        h = np.arange(harmonics + 1.0).reshape(-1, *[1] * self.damping.ndim)
        eye = 1.0 if self.damping.ndim == 1 else np.eye(len(self.eigenvalues))
        damping = self.damping - growth * eye
        Z = self.eigenvalues * eye - (h * omega) ** 2 * eye + 1j * h * omega * damping
        return Z, -2 * h**2 * omega * eye + 1j * h * damping

    def free(self, Z: ComplexArray) -> ComplexArray:
        """Return the stiffness with rigid-body modes that deflect no joint held at the harmonic 0."""
        rigid = np.abs(self.eigenvalues) <= _RIGID_TOL * np.abs(self.eigenvalues).max()
        Z = Z.copy()
        if self.damping.ndim == 1:
            Z[0, rigid] = np.inf
        else:
            Z[0, rigid, rigid] = 1e300
        return Z


def condensed(model: StructuralModel, values: Mapping[str, float], omega: float) -> Condensed:
    """Return a structure in its modes; `omega`: a frequency of its motion, rad/s.

    Raises UsageError if it has structural damping or massless DOFs.
    """
    from scipy.linalg import eigh

    model.needs_causal("steady state by harmonic balance")
    unknown = {parameter.name for parameter in model.law_unknowns}
    linear = model.without_laws()
    M, C, K = linear.dense({name: value for name, value in values.items() if name not in unknown})
    if some := massless_motion(M):
        raise UsageError(
            f"the mass matrix is singular ({some}): a steady state by harmonic balance needs mass everywhere",
            remedy="Reduce to DOFs that have mass, or give the others mass.",
            names=("structure",),
        )
    laws = tuple(law.bound for law in model_laws(model.joints, values))
    rows = model.deflections()
    k, c = np.zeros((2, len(rows)))
    for law in laws:
        stiffness, damping = law.at_rest
        k[law.row] += stiffness
        c[law.row] += damping
    eigenvalues, shapes = eigh(K + rows.T @ (k[:, None] * rows), M)
    rigid = np.abs(eigenvalues) <= _RIGID_TOL * np.abs(eigenvalues).max()
    if np.any(np.abs(rows @ shapes[:, rigid]) > 1e-9 * np.abs(rows @ shapes).max(initial=0.0)):
        # Only the laws hold the structure: any stiffness does in their place, and is taken off their forces.
        mobility = np.einsum("jn,nj->j", rows, np.linalg.solve(M, rows.T))
        k = k + omega**2 / mobility
        eigenvalues, shapes = eigh(K + rows.T @ (k[:, None] * rows), M)
    modal = shapes.T @ (C + rows.T @ (c[:, None] * rows)) @ shapes
    # Dampers at the joints that uncouple the modes, if there are such, are taken off the forces of laws.
    apart = ~np.eye(len(modal), dtype=bool)
    deflected = np.einsum("jm,jn->mnj", rows @ shapes, rows @ shapes)
    dampers = -np.linalg.lstsq(deflected[apart], modal[apart], rcond=None)[0]
    uncoupled = modal + deflected @ dampers
    if np.abs(uncoupled[apart]).max(initial=0.0) <= _CLASSICAL_TOL * np.abs(np.diag(uncoupled)).max(
        initial=0.0
    ):
        modal, c = np.diag(uncoupled).copy(), c + dampers
    smooth = all(not (law.law.hidden or law.guards(law.regime(0.0, 0.0, 0.0), 0.0, 0.0, 0.0)) for law in laws)
    return Condensed(
        eigenvalues, modal, shapes, rows @ shapes, k, c, laws, _SMOOTH_TAIL if smooth else _KINKED_TAIL
    )


class JointForces(NamedTuple):
    """What laws exert beyond their tangents: coefficients (joints x 2 J + 1) and derivatives.

    `by_motion` (joints x 2 H + 1 x 2 H + 1), `by_omega` (joints x 2 H + 1).
    """

    coefficients: Array
    by_motion: Array
    by_omega: Array


class LawMemory:
    """The forces of laws over cycles; hidden states of the last cycle are those of the next one's start."""

    def __init__(self, structure: Condensed) -> None:
        self.structure = structure
        self.hidden: list[tuple[float, int] | None] = [None] * len(structure.laws)

    def forces(self, q: Array, omega: float) -> JointForces:
        """Return the forces of deflections (joints x 2 H + 1)."""
        s, (joints, size) = self.structure, q.shape
        harmonics = size // 2
        h = np.arange(1, harmonics + 1)
        turn = np.zeros((size, size))  # of coefficients to those of the derivative
        turn[2 * h - 1, 2 * h], turn[2 * h, 2 * h - 1] = h, -h
        forces = np.zeros((joints, 2 * further_harmonics(harmonics) + 1))
        by_omega = -s.c[:, None] * (q @ turn.T)
        by_motion = -s.k[:, None, None] * np.eye(size) - omega * s.c[:, None, None] * turn
        forces[:, :size] = -s.k[:, None] * q + omega * by_omega
        for index, law in enumerate(s.laws):
            cycle: CycleForce = cycle_force(law, q[law.row], omega, self.hidden[index])
            self.hidden[index] = cycle.hidden
            forces[law.row] += cycle.coefficients
            by_motion[law.row] += cycle.by_motion
            by_omega[law.row] += cycle.by_omega
        return JointForces(forces, by_motion, by_omega)


class ForcedResponse:
    """The equations of steady states under a force ``amplitude cos(omega t)``; the last unknown is omega.

    `load`: modal force of a unit load (n).
    """

    extra: ClassVar[int] = 1  # unknowns beside the deflections

    def __init__(self, structure: Condensed, load: Array, amplitude: float, max_harmonics: int) -> None:
        self.structure, self.load, self.amplitude = structure, load, amplitude
        self.max_harmonics, self.harmonics = max_harmonics, min(MIN_HARMONICS, max_harmonics)
        self.memory = LawMemory(structure)
        #: What harmonics beyond the last would deflect at the last solution, relative to the deflection.
        self.left_out = 0.0
        self._needed = self._sufficient = MIN_HARMONICS
        self._last: tuple[Array, JointForces]

    @property
    def joints(self) -> int:
        """Number of joints with laws."""
        return len(self.structure.deflections)

    @property
    def forces(self) -> JointForces:
        """The forces of the laws at the unknowns that were evaluated last."""
        return self._last[1]

    def motion(self, u: Array) -> Array:
        """Return the deflections of unknowns (joints x 2 H + 1)."""
        return u[: -self.extra].reshape(self.joints, -1)

    def linear(self, omega: float) -> Array:
        """Return the unknowns of small motions at a frequency."""
        q = np.zeros((2 * self.harmonics + 1, self.joints))
        Z, _ = self.structure.stiffness(omega, 1)
        X = solved(self.structure.free(Z), self.structure.deflections.T)
        q[:3] = to_real(X.transpose(0, 2, 1) @ self.load) * self.amplitude
        q[0] = 0.0
        return np.append(q.T.ravel(), omega)

    def first(self, omega: float) -> Point:
        """Return the steady state at a frequency that grows out of rest with the amplitude.

        Raises NumericalError if it cannot be followed from there.
        """
        amplitude, reached, step = self.amplitude, 0.0, 1.0
        u = np.append(np.zeros(self.joints * (2 * self.harmonics + 1)), omega)
        while step >= _MIN_AMPLITUDE_STEP:
            part = min(1.0, reached + step)
            self.amplitude = amplitude * part
            grown = self.linear(omega) if reached == 0.0 else np.append(u[:-1] * (part / reached), omega)
            point = solve_at(self, grown)
            if point is None:
                step /= 2
                continue
            if part == 1.0:
                return point
            u, reached, step = point.u, part, 1.5 * step
        raise NumericalError(
            f"the steady state at {omega:.6g} rad/s cannot be followed from small amplitudes",
            remedy="Start at a frequency farther from resonances.",
        )

    def evaluate(self, u: Array) -> tuple[Array, Array]:
        """Return the residuals of deflections and their derivatives."""
        s, omega, q = self.structure, float(u[-1]), self.motion(u)
        forces = self.memory.forces(q, omega)
        self._last = u, forces
        Z, dZ = s.stiffness(omega, further_harmonics(self.order(q)))
        Z = s.free(Z)
        X, A = self.compliance(Z, s.deflections.T, q, forces)
        by_turned = turned(dZ[: len(X)], X)
        F, F_omega = (to_complex(f[:, : q.shape[1]].T) for f in (forces.coefficients, forces.by_omega))
        residual = to_complex(q.T) + np.einsum("hij,hj->hi", A, F)
        by_omega = np.einsum("hij,hj->hi", A, F_omega)
        by_omega -= np.einsum("hni,hnj,hj->hi", X, by_turned, F)
        residual[1] -= X[1].T @ self.load * self.amplitude
        by_omega[1] += by_turned[1].T @ solved(Z[1:2], self.load[:, None])[0, :, 0] * self.amplitude
        matrix = self.by_motion(A, forces)
        return to_real(residual).T.ravel(), np.column_stack([matrix, to_real(by_omega).T.ravel()])

    @staticmethod
    def order(q: Array) -> int:
        """Return the number of harmonics of deflections."""
        return int(q.shape[1] // 2)

    def compliance(
        self, Z: ComplexArray, right: Array | ComplexArray, q: Array, forces: JointForces
    ) -> tuple[ComplexArray, ComplexArray]:
        """Return motions to unit joint forces: of modes (H + 1 x n x joints), and of the joints.

        Notes what harmonics beyond H would deflect, and the highest harmonic that is needed.
        """
        s, harmonics = self.structure, self.order(q)
        X = solved(Z, right)
        A = s.deflections @ X
        further = np.einsum("hij,hj->hi", A, to_complex(forces.coefficients.T))[harmonics + 1 :]
        size = np.abs(q).sum(axis=1).max() or 1.0
        self.left_out = float(np.abs(further).max(initial=0.0)) / size
        parts = np.abs(to_complex(q.T)).max(axis=1) > _NEEDED * s.tail * size
        self._needed = int(np.flatnonzero(parts).max(initial=0))
        return X[: harmonics + 1], A[: harmonics + 1]

    def by_motion(self, A: ComplexArray, forces: JointForces) -> Array:
        """Return the derivatives of the residuals of deflections by these."""
        by_motion = to_complex(forces.by_motion.transpose(1, 0, 2))  # harmonics x joints x size
        coupled = to_real(A[:, :, :, None] * by_motion[:, None]).transpose(1, 0, 2, 3)
        unknowns = coupled.shape[0] * coupled.shape[1]
        matrix: Array = coupled.reshape(unknowns, unknowns)
        matrix[np.diag_indices(unknowns)] += 1.0
        return matrix

    def law_forces(self, slopes: Array) -> ComplexArray:
        """Return changes of the laws' modal forces (H + 1 x n x p) by those of the deflections.

        `slopes`: changes of the unknowns of the deflections, where last evaluated (joints (2 H + 1) x p).
        """
        changes = slopes.reshape(self.joints, -1, slopes.shape[1])
        forces = np.einsum("jik,jkp->ijp", self.forces.by_motion, changes)
        return np.asarray(self.structure.deflections.T @ to_complex(forces))

    def scale(self, u: Array) -> Array:
        """Return the sizes of the unknowns."""
        size = float(np.abs(self.motion(u)).sum(axis=1).max()) or 1.0
        return np.append(np.full(len(u) - 1, size), abs(u[-1]))

    def resized(self, u: Array) -> Array | None:
        """Return the unknowns with more harmonics, if those left out would move the joints, else None."""
        if self.left_out <= self.structure.tail or self.harmonics >= self.max_harmonics:
            self._sufficient = self.harmonics
            if self._needed < self.harmonics - _SPARE:
                self.harmonics = max(MIN_HARMONICS, self._needed + 2, 2 * self.harmonics // 3)
            return None
        grown = max(self.harmonics + 2 + self.harmonics // 3, self._sufficient)
        self.harmonics = min(self.max_harmonics, grown)
        return self.padded(u)

    def padded(self, v: Array) -> Array:
        """Return a vector of unknowns with as many harmonics as the equations have now."""
        q, size = self.motion(v), 2 * self.harmonics + 1
        out = np.zeros((self.joints, size))
        kept = min(size, q.shape[1])
        out[:, :kept] = q[:, :kept]
        return np.append(out.ravel(), v[-self.extra :])

    def is_close(self, u: Array, other: Array) -> bool:
        """Return whether unknowns are so close to others that they are of the same branch."""
        size = float(np.abs(self.motion(u)).sum(axis=1).max())
        return bool(np.abs(self.motion(other) - self.motion(u)).max() <= _CLOSE * size)

    def modal_motion(self, u: Array) -> ComplexArray:
        """Return the amplitudes of all modes at the last solution (H + 1 x n)."""
        s, omega, (at, forces) = self.structure, float(u[-1]), self._last
        change = self.motion(u) - self.motion(at)  # of the last step of Newton's iteration
        f = forces.coefficients[:, : change.shape[1]] + forces.by_omega * (omega - at[-1])
        f = f + np.einsum("jik,jk->ji", forces.by_motion, change)
        modal = -(to_complex(f.T) @ s.deflections)
        modal[1] += self.amplitude * self.load
        Z, _ = s.stiffness(omega, len(modal) - 1)
        return np.asarray(solved(s.free(Z), modal[:, :, None])[:, :, 0])


def turned(Z: Array | ComplexArray, X: ComplexArray) -> ComplexArray:
    """Return ``Z X`` of each harmonic, Z diagonal or full."""
    return np.asarray(Z[:, :, None] * X if Z.ndim == 2 else Z @ X)


def solved(Z: ComplexArray, right: Array | ComplexArray) -> ComplexArray:
    """Return ``Z^-1 right`` of each harmonic (H + 1 x n x columns), Z diagonal or full."""
    if Z.ndim == 2:
        return np.asarray(right / Z[:, :, None])
    shape = np.broadcast_shapes(right.shape[:-2], (len(Z),))
    return np.asarray(np.linalg.solve(Z, np.broadcast_to(right, (*shape, *right.shape[-2:]))))
