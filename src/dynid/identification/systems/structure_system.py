"""A structure as a linear system: matrices, derivatives, prior and frequency responses.

The states are displacements and velocities, as of K. T. Yang 1997, eq 12.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array, ComplexArray, finite
from dynid.errors import Singular, UsageError
from dynid.identification.systems.linear_system import Affine, LinearSystem, Pairs, Responses, StateVariable
from dynid.lti.exponential import balance, rescaled
from dynid.lti.frequency_response import second_order_response
from dynid.lti.state_space import Matrices
from dynid.number_format import frequency_text
from dynid.structure.dynamic_condensation import ActiveCoordinates, CondensedLines, condensed_lines
from dynid.structure.excitation import base_slopes, drive, prescribed_state, signals_of
from dynid.structure.matrices import as_array
from dynid.structure.model import StructuralModel, Term
from dynid.structure.ports import Channel, Load
from dynid.structure.state_space import massless_motion


class JointPorts(NamedTuple):
    """The scalar joints of a structure: their `names`, and the forces that they exert.

    `motions`: rows of the relative displacements (joints x n), whose restoring forces are positive; `B`:
    derivatives of the states by the forces (2 n x joints); `direct`: those of the channels (channels x
    joints).
    """

    names: tuple[str, ...]
    motions: Array
    B: Array
    direct: Array


class StructureSystem(LinearSystem):
    """A structure with the loads and channels of one record.

    Parameters
    ----------
    model
        The structure, full or reduced.
    loads, channels
        Its loads and channels.
    """

    def __init__(self, model: StructuralModel, loads: Sequence[Load], channels: Sequence[Channel]) -> None:
        self.model, self.loads, self.channels = model, loads, channels
        self.unknowns = model.unknowns
        self.signals = signals_of(loads)
        self.states = tuple(
            StateVariable(state.name, state.unit)
            for quantity in ("displacement", "velocity")
            for state in (Channel(dof, quantity, kind=model.kind(dof)) for dof in model.dofs)
        )
        self._driven = drive(model, loads, channels)
        self._shaken = any(load.dof is None for load in loads)
        self._lines: tuple[Any, CondensedLines | None] | None = None
        self._last: tuple[Any, Responses] | None = None

    def check(self) -> None:
        """Refuse a structure in which a motion has no mass: its displacements are no states.

        Raises UsageError, with the remedies.
        """
        self.model.needs_causal("record of time")
        M = self.model.dense(_references(self.model))[0]
        if some := massless_motion(self._driven.mass(M)):
            raise UsageError(
                f"the mass matrix is singular ({some}): what is estimated in time needs mass everywhere",
                remedy="Reduce to DOFs that have mass, give the others mass, or identify from frequency "
                "response functions.",
                names=("structure",),
            )

    def at(self, values: Mapping[str, float]) -> Matrices:
        """Return the matrices; of M a = f - C v - K x the derivative is M da = df - dC v - dK x - dM a."""
        self.model.needs_causal("state equations")
        driven, n = self._driven, self.model.size
        if self._shaken:  # the force by which a moving ground acts depends on the masses
            driven = drive(self.model, self.loads, self.channels, values)
        M, C, K = self.model.dense(values)
        system = driven.system(M, C, K)
        mass = driven.mass(M)
        rows, accelerations = driven.rows, np.array(driven.orders)[:, None] == 2
        shape = (len(self.unknowns), n)
        right = np.zeros((*shape, 2 * n + system.B.shape[1]))
        flexibility = np.concatenate([system.A[n:], system.B[n:]], axis=1)
        for rows_of_parameter, slopes in zip(right, self.model.slopes(values), strict=True):
            if "K" in slopes:
                rows_of_parameter[:, :n] -= driven.others(as_array(slopes["K"]))
            if "C" in slopes:
                rows_of_parameter[:, n : 2 * n] -= driven.others(as_array(slopes["C"]))
            if "M" in slopes:
                change = as_array(slopes["M"])
                rows_of_parameter[:, 2 * n :] += driven.inertia(change)
                rows_of_parameter[:] -= driven.free(change) @ flexibility
        if self._shaken:
            right[:, :, 2 * n :] += base_slopes(self.model, self.loads, values)
        moved = np.linalg.solve(mass, right)
        A_slopes = np.zeros((len(right), 2 * n, 2 * n))
        A_slopes[:, n:] = moved[:, :, : 2 * n]
        B_slopes = np.zeros((len(right), *system.B.shape))
        B_slopes[:, n:] = moved[:, :, 2 * n :]
        C_slopes = np.where(accelerations, rows @ A_slopes[:, n:], 0.0)
        D_slopes = np.where(accelerations, rows @ B_slopes[:, n:], 0.0)
        return Matrices(
            system.A, system.B, system.C, system.D[None], A_slopes, B_slopes, C_slopes, D_slopes[:, None]
        )

    def joint_ports(self, values: Mapping[str, float]) -> JointPorts:
        """Return the motions of the scalar joints, and how forces that they exert act."""
        scalar = [
            joint
            for joint in self.model.joints
            if any(term.letter != "m" for term in joint.terms)
            and all(term.parameter.matrix is None for term in joint.terms)
        ]
        names = [f"{joint.name}{f'.{joint.component}' if joint.component else ''}" for joint in scalar]
        ends = [[self.model.row(dof) for dof in joint.dofs] for joint in scalar]
        motions = np.array([rows[0] - sum(rows[1:]) for rows in ends]).reshape(len(scalar), self.model.size)
        driven = self._driven
        forces = -motions.T
        forces[[coordinate for coordinate in driven.held if coordinate >= 0]] = (
            0.0  # their motion is prescribed
        )
        accelerations = np.linalg.solve(driven.mass(self.model.dense(values)[0]), forces)
        direct = np.where(np.array(driven.orders)[:, None] == 2, driven.rows @ accelerations, 0.0)
        return JointPorts(
            tuple(names), motions, np.concatenate([np.zeros_like(forces), accelerations]), direct
        )

    @cached_property
    def affine(self) -> Affine | None:
        """The matrices where every unknown is the factor of a stiffness or damping; else None."""
        if (
            self.model.hysteretic  # it has no state equations
            or self.model.rotor is not None
            or not self.model.affine
            or not all(unknown.logarithmic for unknown in self.unknowns)
        ):
            return None
        matrices = self.at(dict.fromkeys((unknown.name for unknown in self.unknowns), 0.0))
        return Affine(matrices.A, matrices.B, matrices.C, matrices.D, matrices.A_slopes, matrices.C_slopes)

    def prior(self, values: Mapping[str, float], length: float) -> Array:
        """Return the root of a prior in which displacements and velocities have equal energy in every mode.

        Their covariances are ``(K + M / T^2)^-1`` and ``M^-1``, up to a common factor. T, the record's
        length, bounds rigid-body drift. The roots of both come from the modes, so that no stiffness is too
        large.
        """
        compliance, mobility, _ = self._energies(values, length)
        n = len(mobility)
        root = np.zeros((2 * n, 2 * n))
        root[:n, :n], root[n:, n:] = compliance, mobility
        return root

    def reach(self, values: Mapping[str, float], length: float) -> Array:
        """Return the standard deviation of each channel; of an acceleration, that of the slowest motion."""
        compliance, mobility, omega = self._energies(values, length)
        reach = []
        for row, order in zip(self._driven.rows, self._driven.orders, strict=True):
            spread = np.linalg.norm(row @ (compliance if order == 0 else mobility))
            reach.append(spread * (omega[0] if order == 2 else 1.0))
        return np.array(reach)

    def _energies(self, values: Mapping[str, float], length: float) -> tuple[Array, Array, Array]:
        """Return roots of the covariances of displacements and velocities, and the frequencies (modes)."""
        M, _, K = self.model.dense(values)
        scale = np.sqrt(np.diag(M))
        lower = np.linalg.cholesky(M / scale / scale[:, None])
        mobility = np.asarray(np.linalg.solve(lower.T, np.eye(len(M))) / scale[:, None])  # root of M^-1
        stiffness = mobility.T @ K @ mobility
        finite("the stiffness beside the mass", stiffness)
        square, shapes = np.linalg.eigh((stiffness + stiffness.T) / 2)
        omega = np.sqrt(np.maximum(square, 0.0) + 1 / length**2)  # below 0: round-off of rigid-body modes
        mobility = mobility @ shapes
        return mobility / omega, mobility, omega

    def prescribed(self, time: float) -> tuple[Array, NDArray[np.bool_]]:
        """Return displacements and velocities as far as motions prescribe them."""
        n = 2 * self.model.size
        states = [prescribed_state(self.model, [load], time) for load in self.loads]
        prescribed = np.any([where for _, where in states], axis=0) | np.zeros(n, dtype=bool)
        return np.array([state for state, _ in states]).reshape(len(states), n), prescribed

    def poles(self, values: Mapping[str, float]) -> ComplexArray:
        """Return the poles at values of the parameters, 1/s; with structural damping and their conjugates."""
        M, C, K = self.model.dense(values, loss=True, rotating=True)
        n = len(M)
        A = np.zeros((2 * n, 2 * n), dtype=K.dtype)
        A[:n, n:] = np.eye(n)
        A[n:] = -np.linalg.solve(M, np.concatenate([K, C], axis=1))
        poles = np.asarray(np.linalg.eigvals(rescaled(A, balance(A))), dtype=complex)
        if self.model.hysteretic:  # those at positive frequencies, and as a real system would have them
            poles = poles[poles.imag > 0]
            poles = np.concatenate([poles, poles.conj()])
        return poles

    def paired_response(
        self, values: Mapping[str, float], omega: Array, pairs: Pairs, *, slopes: bool = True
    ) -> Responses:
        """Return the responses of pairs of a channel and a load, dH = -H dZ H on the dynamic stiffness Z.

        Raises Singular if a line lies on an undamped pole, to rounding.
        """
        key = tuple(values.items()), omega.tobytes(), tuple(pairs), slopes
        if self._last is None or self._last[0] != key:  # a noise model is renewed at the same values
            self._last = key, self._evaluated(values, omega, pairs, slopes=slopes)
        return self._last[1]

    def _evaluated(
        self, values: Mapping[str, float], omega: Array, pairs: Pairs, *, slopes: bool
    ) -> Responses:
        """Return the responses and derivatives of `paired_response`."""
        self.model.needs_positive(omega)
        # One evaluation alone, without slopes as of a simulation, is not worth condensing for.
        condensed = self._condensed(omega, pairs) if slopes or self._lines is not None else None
        if condensed is None:
            return self._whole_response(values, omega, pairs, slopes=slopes)
        receptance, motion, right = condensed.solve(*self.model.dense(values, loss=True))
        factor = self._factors(omega, pairs)
        H, moved = factor * receptance, np.zeros((*factor.shape, 0), dtype=complex)
        if slopes:
            moved = self._moved(values, omega, factor, (motion, condensed.pairs), condensed.coordinates.block)
        if not right.all():
            H[~right], moved[~right] = self._whole_response(values, omega[~right], pairs, slopes=slopes)
        return H, moved

    def _whole_response(
        self, values: Mapping[str, float], omega: Array, pairs: Pairs, *, slopes: bool
    ) -> Responses:
        """Return the responses and derivatives of `paired_response` from solutions with all DOFs."""
        M, C, K = self.model.dense(values, loss=True, rotating=True)
        ends, where = self._ends(pairs)
        n = len(M)
        motions = ends.T, np.eye(n), np.zeros(n, dtype=int), omega
        solved = second_order_response(M, C, K, *motions)
        infinite = ~np.isfinite(solved).all(axis=(1, 2))
        if infinite.any():
            raise Singular(
                f"at {frequency_text(float(omega[np.argmax(infinite)]), 6)} a frequency response is "
                "infinite: that line lies on an undamped pole",
                remedy="Leave that line out, or give the structure some damping.",
                names=("measurement.frf", "measurement"),
            )
        factor = self._factors(omega, pairs)
        H = factor * np.einsum("cn,lnc->lc", ends[where[1]], solved[:, :, where[0]])
        if not slopes:
            return H, np.zeros((*H.shape, 0), dtype=complex)
        read = solved if self.model.rotor is None else second_order_response(M, C.T, K.T, *motions)
        return H, self._moved(values, omega, factor, (solved, where), read=read)

    def _ends(self, pairs: Pairs) -> tuple[Array, NDArray[np.intp]]:
        """Return the distinct directions (e x n), and the places of each pair's force and read-out there."""
        forces = self._driven.directions.T[[load for _, load in pairs]]
        rows = self._driven.rows[[channel for channel, _ in pairs]]
        ends, where = np.unique(np.concatenate([forces, rows]), axis=0, return_inverse=True)
        return ends, where.reshape(2, len(pairs))

    def _factors(self, omega: Array, pairs: Pairs) -> ComplexArray:
        """Return what makes responses of receptances (L x pairs)."""
        return np.asarray((1j * omega[:, None]) ** [self._driven.orders[channel] for channel, _ in pairs])

    def _moved(
        self,
        values: Mapping[str, float],
        omega: Array,
        factor: ComplexArray,
        motions: tuple[ComplexArray, NDArray[np.intp]],
        within: Callable[[Array], Array] = lambda matrix: matrix,
        read: ComplexArray | None = None,
    ) -> ComplexArray:
        """Return the derivatives of responses (L x pairs x p) by the values of the parameters."""
        # `motions`: those by forces in some directions, in some coordinates (L x a x e), and the places of
        # each pair's force and read-out among the directions; `within` returns a matrix in these
        # coordinates; `read`: the motions of the transposed system; default: those of a symmetric one.
        motion, (force, end) = motions
        forces, of_pair = np.unique(force, return_inverse=True)
        moved = np.zeros((*factor.shape, len(self.unknowns)), dtype=complex)
        powers = {"K": np.ones(len(omega)), "C": 1j * omega, "M": -(omega**2), "H": np.full(len(omega), 1j)}
        for k, changes in enumerate(self.model.slopes(values)):
            for letter, matrix in changes.items():
                change = within(as_array(matrix))
                here = np.flatnonzero(change.any(axis=0))
                active_motion = motion[:, here]
                active_read = active_motion if read is None else read[:, here]
                bent = np.tensordot(
                    active_motion[:, :, forces], change[np.ix_(here, here)], (1, 0)
                )  # L x forces x here
                products = np.einsum("lhp,lph->lp", active_read[:, :, end], bent[:, of_pair])
                moved[..., k] -= factor * powers[letter][:, None] * products
        return moved

    def solved_size(self, omega: Array, pairs: Pairs) -> int:
        """Return the number of equations that an evaluation of responses solves at each line."""
        condensed = self._condensed(omega, pairs)
        return self.model.size if condensed is None else condensed.coordinates.count

    def _acting(self, terms: Sequence[Term]) -> list[Array]:
        """Return the matrices of the terms that depend on unknown parameters."""
        names = {unknown.name for unknown in self.unknowns}
        return [as_array(term.matrix) for term in terms if not names.isdisjoint(term.coefficient.names)]

    def _condensed(self, omega: Array, pairs: Pairs) -> CondensedLines | None:
        """Return the lines condensed to what unknown parameters act on; None where that does not pay."""
        key = omega.tobytes(), tuple(pairs)
        if self._lines is None or self._lines[0] != key:
            unknown_names, lines = {unknown.name for unknown in self.unknowns}, None
            symmetric = self.model.rotor is None
            if symmetric and all(unknown_names.isdisjoint(part.names) for part in self.model.modal):
                matrices = self.model.dense(_references(self.model), loss=True)
                acting = self._acting((*self.model.joint_terms, *self.model.terms))
                if any(matrix.any() for matrix in acting):
                    coordinates = ActiveCoordinates.of(acting)
                    lines = condensed_lines(matrices, coordinates, *self._ends(pairs), omega)
            self._lines = key, lines
        return self._lines[1]


def _references(model: StructuralModel) -> dict[str, float]:
    return {unknown.name: unknown.start for unknown in model.unknowns}
