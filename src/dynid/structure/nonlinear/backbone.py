"""Backbone of a mode of a structure with nonlinear joints: frequency and damping over the amplitude.

The periodic motion of the structure whose dampers are relieved of ``growth M``, by which they lose no energy
over a period: the damping ratio is ``growth / (2 omega)``. Of a linear structure these are the mode's.

Source: M. Krack, Computers & Structures 154 (2015) 59–71 (extended periodic motion concept).
"""

from __future__ import annotations

import numpy as np

from dynid.arrays import Array, ComplexArray
from dynid.structure.nonlinear.fourier import further_harmonics, to_complex, to_real
from dynid.structure.nonlinear.harmonic_balance import Condensed, ForcedResponse, turned


class BackboneCurve(ForcedResponse):
    """The equations of periodic motions along a mode; the last unknowns are omega, growth and amplitude.

    The amplitude is that of the mode's first harmonic, whose phase is 0.
    """

    extra = 3

    def __init__(self, structure: Condensed, mode: int, max_harmonics: int) -> None:
        super().__init__(structure, np.zeros(len(structure.eigenvalues)), 0.0, max_harmonics)
        self.mode = mode
        self.modal = np.zeros((1, len(structure.eigenvalues)), dtype=complex)  # of the last evaluation

    def near(self, q: Array, omega: float, modal: ComplexArray) -> Array:
        """Return the unknowns near a resonance: deflections, frequency, and amplitudes of all modes there."""
        s, r = self.structure, self.mode
        amplitudes = to_complex(q.T)
        turn = np.exp(-1j * np.arange(len(amplitudes)) * np.angle(modal[1, r]))
        growth = s.damping[r] if s.damping.ndim == 1 else s.damping[r, r]
        self.harmonics = self.order(q)
        return np.append(to_real(amplitudes * turn[:, None]).T.ravel(), [omega, growth, abs(modal[1, r])])

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
        Z, by_omega = s.stiffness(omega, further_harmonics(self.order(q)), growth)
        Z, n = s.free(Z), len(s.eigenvalues)
        first = np.diag(Z[1]) if Z.ndim == 2 else Z[1].copy()
        first_by_omega = np.diag(by_omega[1]) if Z.ndim == 2 else by_omega[1]
        # The first harmonic of the mode is an unknown: the others answer its motion and the forces.
        right = np.broadcast_to(s.deflections.T, (len(Z), n, self.joints)).copy()
        others, coupling = first.copy(), first[:, r].copy()
        right[1, r], coupling[r] = 0.0, 0.0
        others[r], others[:, r], others[r, r] = 0.0, 0.0, 1.0
        if Z.ndim == 2:
            Z[1, r] = 1.0
        else:
            Z[1] = others
        shape = -np.linalg.solve(others, coupling)
        shape[r] = 1.0
        X, A = self.compliance(Z, right, q, forces)
        F, F_omega = (to_complex(f[:, : q.shape[1]].T) for f in (forces.coefficients, forces.by_omega))
        deflection, stiffness = s.deflections @ shape, shape @ first @ shape
        self.modal = -np.einsum("hnj,hj->hn", X, F)
        self.modal[1] += amplitude * shape
        residual = to_complex(q.T) + np.einsum("hij,hj->hi", A, F)
        residual[1] -= deflection * amplitude
        own = stiffness * amplitude + deflection @ F[1]
        columns, own_columns = [], []
        by_growth = np.asarray(-1j * omega * np.arange(len(X))[:, None] * np.ones(n))
        for by, by_first in (
            (by_omega[: len(X)], first_by_omega),
            (by_growth, np.diag(by_growth[1])),
        ):
            column = -np.einsum("hni,hnj,hj->hi", X, turned(by, X), F)
            moved = -X[1].T @ (by_first @ shape)  # of the deflection
            column[1] -= moved * amplitude
            columns.append(column)
            own_columns.append(shape @ by_first @ shape * amplitude + moved @ F[1])
        columns[0] += np.einsum("hij,hj->hi", A, F_omega)
        own_columns[0] += deflection @ F_omega[1]
        by_amplitude = np.zeros_like(residual)
        by_amplitude[1] = -deflection
        columns.append(by_amplitude)
        own_columns.append(stiffness)
        by_motion = to_complex(forces.by_motion.transpose(1, 0, 2))[1] * deflection[:, None]
        rows = np.append(by_motion.ravel(), own_columns)
        J = np.column_stack([self.by_motion(A, forces), *(to_real(column).T.ravel() for column in columns)])
        return (
            np.concatenate([to_real(residual).T.ravel(), [own.real, own.imag]]),
            np.concatenate([J, rows.real[None], rows.imag[None]]),
        )

    def modal_motion(self, u: Array) -> ComplexArray:
        """Return the amplitudes of all modes at a solution (H + 1 x n)."""
        self.evaluate(u)
        return self.modal
