"""Component mode synthesis with fixed interfaces.

Source: R. R. Craig & M. C. C. Bampton, AIAA J. 6 (1968) 1313–1319.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from dynid.errors import UsageError
from dynid.lti.floating import guarded
from dynid.structure.matrices import Label
from dynid.structure.model import StructuralModel
from dynid.structure.reduction.condensation import SLAVES, Partition, constraint_modes, partition
from dynid.structure.reduction.masters import Masters, masters_alone
from dynid.structure.reduction.mode_selection import (
    Interest,
    ModeRange,
    SelectedModes,
    mode_rule,
    selected,
    wanted_modes,
)
from dynid.structure.reduction.reduction import StructuralReduction, projected


@dataclass(frozen=True)
class CraigBampton:
    """Static condensation on the boundary, with modes of the structure whose boundary is held.

    Exact for any joint between boundary DOFs as all modes are taken. Coordinates are the boundary's
    displacements, then the modal ones of the fixed-interface modes.

    Parameters
    ----------
    masters
        The boundary: labels, or a rule to choose by. Absent: the DOFs of joints, sensors and loads.
    modes
        Fixed-interface modes: numbers or a range; a count of 0 is static condensation. Absent: those of
        the band.
    interest
        Purpose of the model.
    """

    masters: Sequence[Label] | Masters | None = None
    modes: Sequence[int] | ModeRange | None = None
    interest: Interest = field(default_factory=Interest)

    @guarded("the Craig–Bampton reduction")
    def reduce(self, model: StructuralModel) -> StructuralReduction:
        """Reduce a structure.

        Raises
        ------
        UsageError
            If masters or modes do not exist or stand twice.
        Singular
            If the inside is not held by the boundary.
        """
        cut = partition(model, masters_alone(model, self.masters, self.interest))
        static, condition = constraint_modes(cut)
        wanted = wanted_modes(self.modes, self.interest, None)
        fixed = None if wanted == ModeRange(count=0) else self._fixed_modes(cut, model, wanted)
        if fixed is None:
            small = projected(model, cut.basis(static), cut.labels)
            return StructuralReduction(small, cut.labels, condition=condition, inverted=SLAVES)
        names = (*cut.labels, *(f"fixed_mode_{number}" for number in fixed.numbers))
        # Of unit size at their largest, like the boundary's coordinates.
        shapes = fixed.shapes / np.abs(fixed.shapes).max(axis=0)
        rule = f"fixed-interface modes: {mode_rule(self.modes, self.interest, None)}"
        small = projected(model, cut.basis(static, shapes), names)
        return StructuralReduction(
            small, cut.labels, fixed.numbers, condition, rule=rule, doubt=fixed.doubt, inverted=SLAVES
        )

    def _fixed_modes(
        self, cut: Partition, model: StructuralModel, wanted: Sequence[int] | ModeRange
    ) -> SelectedModes | None:
        """Return the modes with the boundary held; None where none is in the band."""
        if not len(cut.slaves):
            return None
        M, C, K = (cut.inner(matrix) for matrix in model.with_known_joints())
        try:
            return selected((M, C, K), wanted)
        except UsageError:
            if self.modes is not None:
                raise
            return None
