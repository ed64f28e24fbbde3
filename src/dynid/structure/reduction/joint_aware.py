"""Joint-aware reduction: on modes of the structure with its joints at their current values.

A basis of the structure without joints (Yang, eq 2) predicts the frequencies of the jointed one badly,
because no combination of its modes bends as the joint demands. This one is exact where it is made, and
right to first order beside it; it is made anew as the values change. Residual vectors at the joints bend as
a change of the joint demands, and make it right farther off, for as many coordinates.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from dynid.errors import UsageError
from dynid.lti.floating import guarded
from dynid.structure.matrices import Label
from dynid.structure.model import StructuralModel
from dynid.structure.reduction.masters import Masters
from dynid.structure.reduction.modal import Residuals, on_modes_and_residuals
from dynid.structure.reduction.reduction import Reduction
from dynid.structure.reduction.selection import Interest, ModeRange
from dynid.structure.reduction.serep import on_modes


@dataclass(frozen=True)
class JointAware:
    """SEREP on modes of the structure with its joints; or these modes and residual vectors.

    Parameters
    ----------
    masters, modes, interest
        As of `Serep`; modes are those of the structure with joints.
    values
        Current values of the unknown joint parameters, by name; absent: their starts.
    residuals
        As of `Modal`, of the structure with its joints. Coordinates then are modal, and there are no masters.
    """

    masters: Sequence[Label] | Masters | None = None
    modes: Sequence[int] | ModeRange | None = None
    interest: Interest = field(default_factory=Interest)
    values: Mapping[str, float] | None = None
    residuals: Residuals = ()

    def __post_init__(self) -> None:
        if self.residuals and self.masters is not None:
            raise UsageError(
                "with residual vectors the coordinates are modal: there are no masters",
                remedy="Give `masters` or `residuals`.",
                names=("residuals",),
            )

    @guarded("the joint-aware reduction")
    def reduce(self, model: StructuralModel) -> Reduction:
        """Reduce a structure.

        Raises
        ------
        UsageError, Singular
            As of `Serep.reduce`.
        """
        values = {unknown.name: unknown.start for unknown in model.unknowns} | dict(self.values or {})
        if not self.residuals:
            return on_modes(model, values, self.masters, self.modes, self.interest)
        return on_modes_and_residuals(
            model, model.with_joints(values), self.modes, self.residuals, self.interest, retained=True
        )

    def at(self, values: Mapping[str, float]) -> JointAware:
        """Return the method for other values of the joints."""
        return replace(self, values=values)
