"""Joint-aware reduction: on modes of the structure with its joints at their current values.

A basis of the structure without joints (Yang, eq 2) predicts the frequencies of the jointed one badly,
because no combination of its modes bends as the joint demands. This one is exact where it is made, and
right to first order beside it; it is made anew as the values change.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from dynid.structure.matrices import Label
from dynid.structure.model import StructuralModel
from dynid.structure.reduction.masters import Masters
from dynid.structure.reduction.reduction import Reduction
from dynid.structure.reduction.selection import Interest, ModeRange
from dynid.structure.reduction.serep import on_modes


@dataclass(frozen=True)
class JointAware:
    """SEREP on modes of the structure with its joints.

    Parameters
    ----------
    masters, modes, interest
        As of `Serep`; modes are those of the structure with joints.
    values
        Current values of the unknown joint parameters, by name; absent: their starts.
    """

    masters: Sequence[Label] | Masters | None = None
    modes: Sequence[int] | ModeRange | None = None
    interest: Interest = field(default_factory=Interest)
    values: Mapping[str, float] | None = None

    def reduce(self, model: StructuralModel) -> Reduction:
        """Reduce a structure.

        Raises
        ------
        UsageError, Singular
            As of `Serep.reduce`.
        """
        values = {unknown.name: unknown.start for unknown in model.unknowns} | dict(self.values or {})
        matrices = model.with_joints(values)
        return on_modes(model, matrices, self.masters, self.modes, self.interest)

    def at(self, values: Mapping[str, float]) -> JointAware:
        """Return the method for other values of the joints."""
        return replace(self, values=values)
