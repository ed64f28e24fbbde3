"""Backbone of a mode of a structure with nonlinear joints: frequency and damping over the amplitude.

The periodic motion of the structure whose dampers are relieved of ``growth M``, by which they lose no energy
over a period: the damping ratio is ``growth / (2 omega)``. Of a linear structure these are the mode's.

Source: M. Krack, Computers & Structures 154 (2015) 59–71 (extended periodic motion concept).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dynid.arrays import Array, ComplexArray
from dynid.structure.nonlinear.fourier import further_harmonics, to_complex, to_real
from dynid.structure.nonlinear.harmonic_balance import Condensed, ForcedResponse, solved, turned


class _Evaluated(NamedTuple):
    """What an evaluation computes beside the residuals.

    `stiffness`: of each harmonic, the mode's first one held (H + 1 x n, or x n x n), and `motions` to unit
    joint forces there (H + 1 x n x joints); `shape`: first harmonics of the modes to a unit of it
    (n); `modal`: amplitudes of the modes (H + 1 x n); `by_omega_growth`: derivatives of the modal forces, the
    motion as it is, by frequency and growth (H + 1 x n x 2).
    """

    stiffness: ComplexArray
    motions: ComplexArray
    shape: ComplexArray
    modal: ComplexArray
    by_omega_growth: ComplexArray


class BackboneCurve(ForcedResponse):
    """The equations of periodic motions along a mode; the last unknowns are omega, growth and amplitude.

    The amplitude is that of the mode's first harmonic, whose phase is 0.
    """

    extra = 3

    def __init__(self, structure: Condensed, mode: int, max_harmonics: int) -> None:
        super().__init__(structure, np.zeros(len(structure.eigenvalues)), 0.0, max_harmonics)
        self.mode = mode
        self._beside: _Evaluated

    @property
    def growth(self) -> float:
        """Damping by the mass that is taken off small motions, 1/s."""
        s, r = self.structure, self.mode
        return float(s.damping[r] if s.damping.ndim == 1 else s.damping[r, r])

    def linear(self, amplitude: float) -> Array:
        """Return the unknowns of small motions with an amplitude of the mode."""
        s, r = self.structure, self.mode
        q = np.zeros((self.joints, 2 * self.harmonics + 1))
        q[:, 1] = amplitude * s.deflections[:, r]
        return np.append(q.ravel(), [np.sqrt(s.eigenvalues[r]), self.growth, amplitude])

    def near(self, q: Array, omega: float, modal: ComplexArray) -> Array:
        """Return the unknowns near a resonance: deflections, frequency, and amplitudes of all modes there."""
        first, amplitudes = modal[1, self.mode], to_complex(q.T)
        turn = np.exp(-1j * np.arange(len(amplitudes)) * np.angle(first))
        self.harmonics = self.order(q)
        turned_q = to_real(amplitudes * turn[:, None]).T.ravel()
        return np.append(turned_q, [omega, self.growth, abs(first)])

    def scale(self, u: Array) -> Array:
        """Return the sizes of the unknowns."""
        scale = super().scale(u)
        scale[-3:] = u[-3], 0.1 * u[-3], u[-1]
        return scale

    def evaluate(self, u: Array) -> tuple[Array, Array]:
        """Return the residuals of deflections, and of the mode's own equation, and their derivatives."""
        s, r, q = self.structure, self.mode, self.motion(u)
        omega, growth, amplitude = (float(value) for value in u[-3:])
        forces = self.memory.forces(q, omega)
        self._last = u, forces
        Z, dZ = s.stiffness(omega, further_harmonics(self.order(q)), growth)
        Z = s.free(Z)
        first = np.diag(Z[1]) if Z.ndim == 2 else Z[1].copy()
        # The first harmonic of the mode is an unknown: the others answer its motion and the forces.
        right = np.broadcast_to(s.deflections.T, (len(Z), *s.deflections.T.shape)).copy()
        others, coupling = first.copy(), first[:, r].copy()
        right[1, r], coupling[r] = 0.0, 0.0
        others[r], others[:, r], others[r, r] = 0.0, 0.0, 1.0
        Z[1] = np.diag(others) if Z.ndim == 2 else others
        shape = -np.linalg.solve(others, coupling)
        shape[r] = 1.0
        X, A = self.compliance(Z, right, q, forces)
        F, F_omega = (to_complex(f[:, : q.shape[1]].T) for f in (forces.coefficients, forces.by_omega))
        modal = -np.einsum("hnj,hj->hn", X, F)
        modal[1] += amplitude * shape
        by_omega = turned(dZ[: len(X)], modal[:, :, None])[:, :, 0] + F_omega @ s.deflections
        by_growth = -1j * omega * np.arange(len(X))[:, None] * modal
        beside = np.stack([by_omega, by_growth], axis=2)
        self._beside = _Evaluated(Z[: len(X)], X, shape, modal, beside)
        residual = to_complex(q.T) - modal @ s.deflections.T
        own = first[r] @ modal[1] + F[1] @ s.deflections[:, r]
        deflection = s.deflections @ shape
        by_amplitude = np.zeros_like(residual)
        by_amplitude[1] = -deflection
        by_motion = to_complex(forces.by_motion.transpose(1, 0, 2))[1] * deflection[:, None]
        J = np.column_stack(
            [
                np.concatenate([self.by_motion(A, forces), *_parts(by_motion.ravel()[None])]),
                self.by_forces(beside),
                np.concatenate([to_real(by_amplitude).T.ravel(), *_parts(np.array([first[r] @ shape]))]),
            ]
        )
        return np.concatenate([to_real(residual).T.ravel(), *_parts(np.array([own]))]), J

    def by_forces(self, forces: ComplexArray) -> Array:
        """Return the change of the residuals by forces on the modes (H + 1 x n x p), where last evaluated."""
        at = self._beside
        residual = to_real(np.einsum("hnj,hnp->hjp", at.motions, forces)).transpose(1, 0, 2)
        return np.concatenate([residual.reshape(-1, forces.shape[2]), *_parts(at.shape[None] @ forces[1])])

    def derivatives(self, J: Array, by_parameter: ComplexArray) -> tuple[Array, ComplexArray]:
        """Return the derivatives of a solution by parameters, and by the amplitude, which stands last.

        `J`: of the residuals, where last evaluated; `by_parameter`: of the modal forces, the motion as it is
        (H + 1 x n x p). Returned are those of the unknowns before the amplitude (N x p + 1), and of the
        amplitudes of the modes (H + 1 x n x p + 1).
        """
        at, size = self._beside, len(J) - 2
        right = np.column_stack([self.by_forces(by_parameter), J[:, -1]])
        slopes = np.asarray(-np.linalg.solve(J[:, :-1], right))
        forces = self.law_forces(slopes[:size]) + at.by_omega_growth @ slopes[size:]
        forces[:, :, :-1] += by_parameter
        forces[1, self.mode] = 0.0
        moved = -solved(at.stiffness, forces)
        moved[1, :, -1] += at.shape
        return slopes, moved

    def modal_motion(self, u: Array) -> ComplexArray:
        """Return the amplitudes of all modes at a solution (H + 1 x n)."""
        if self._last[0] is not u:
            self.evaluate(u)
        return self._beside.modal


def _parts(values: ComplexArray) -> tuple[Array, Array]:
    return values.real, values.imag
