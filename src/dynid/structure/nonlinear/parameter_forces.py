"""Derivatives of the forces on a structure in a periodic motion by its parameters, the motion as it is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from dynid.arrays import Array, ComplexArray
from dynid.structure.matrices import as_array
from dynid.structure.model import StructuralModel
from dynid.structure.model_laws import ModelLaw, model_laws
from dynid.structure.nonlinear.cycle import cycle_force
from dynid.structure.nonlinear.fourier import to_complex
from dynid.structure.nonlinear.harmonic_balance import Condensed, LawMemory


class ParameterForces:
    """Derivatives of the modal forces of elements and laws by parameters.

    Modes and tangents by which the structure is condensed stay as they are: any would do.

    `names`: the parameters (p).
    """

    def __init__(
        self,
        model: StructuralModel,
        values: Mapping[str, float],
        names: Sequence[str],
        structure: Condensed,
    ) -> None:
        self.structure, self.names = structure, names
        linear, shapes = model.without_laws(), structure.shapes
        known = {parameter.name for parameter in linear.unknowns}
        of_rest = {name: value for name, value in values.items() if name in known}
        self.matrices = [
            {letter: shapes.T @ as_array(matrix) @ shapes for letter, matrix in slopes.items()}
            for slopes in linear.slopes(of_rest, names)
        ]
        self.laws: Sequence[ModelLaw] = model_laws(model.joints, values)

    def of(
        self, q: Array, omega: float, modal: ComplexArray, memory: LawMemory, growth: float = 0.0
    ) -> ComplexArray:
        """Return the derivatives of the modal forces of each harmonic (H + 1 x n x p).

        `q`: deflections of the joints (joints x 2 H + 1); `modal`: amplitudes of the modes (H + 1 x n);
        `memory`: hidden states of the laws; `growth`: damping by the mass that is taken off, 1/s.
        """
        s, rate = self.structure, 1j * omega * np.arange(len(modal))[:, None]
        forces = np.zeros((*modal.shape, len(self.names)), dtype=complex)
        factor = {"K": np.ones_like(rate), "C": rate, "M": rate**2 - growth * rate}
        for k, matrices in enumerate(self.matrices):
            for letter, matrix in matrices.items():
                forces[:, :, k] += factor[letter] * (modal @ matrix.T)
        for index, law in enumerate(self.laws):
            if not any(law.slopes):
                continue
            row = law.bound.row
            cycle = cycle_force(law.bound, q[row], omega, memory.hidden[index], parameters=True)
            by = to_complex(cycle.by_parameters)
            for place, slopes in enumerate(law.slopes):
                for name, slope in slopes.items():
                    if name in self.names:
                        k = self.names.index(name)
                        forces[:, :, k] += slope * by[:, place, None] * s.deflections[row]
        return forces
