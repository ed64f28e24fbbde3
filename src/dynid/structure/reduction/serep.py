"""SEREP: the system equivalent reduction expansion process, without joints or with them (joint-aware).

A basis of the structure without joints (Yang, eq 2) predicts the frequencies of the jointed one badly,
because no combination of its modes bends as the joint demands. The joint-aware basis, of the modes with the
joints at their current values, is exact where it is made and right to first order beside it; it is made anew
as the values change. Residual vectors at the joints extend that range, for as many coordinates.

Sources: K. T. Yang 1997, eqs 4–9; J. O'Callahan, P. Avitabile & R. Riemer, IMAC 1989.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from dynid.arrays import Array, guarded
from dynid.defaults import MASTER_COORDINATES
from dynid.errors import UsageError
from dynid.structure.labels import Label
from dynid.structure.matrices import Matrix, as_array
from dynid.structure.model import StructuralModel
from dynid.structure.modes.pencil import scaled
from dynid.structure.reduction.masters import (
    Masters,
    checked_condition,
    indices_of,
    masters_for_modes,
    mode_count,
)
from dynid.structure.reduction.modal import Residuals, on_modes_and_residuals
from dynid.structure.reduction.mode_selection import (
    Interest,
    ModeRange,
    SelectedModes,
    mode_rule,
    selected,
    wanted_modes,
)
from dynid.structure.reduction.reduced_model import (
    StructuralReduction,
    cancellation,
    modal_rule,
    without_rounding,
)


@dataclass(frozen=True)
class Serep:
    """SEREP on modes of the structure without its joints (Yang, eqs 2, 4–9).

    With as many masters as modes the coordinates are the masters' displacements: ``T = U U_m^-1`` (eq 8).
    With more masters ``T = U U_m^+`` (eq 7) would have dependent columns, and eq 9 a singular mass: the
    coordinates are then the modal ones, ``T = U``, and the masters those displacements that determine them.
    So they are where the slow modes would be lost in the masters' displacements (`MASTER_COORDINATES`). Both
    span the same motions, so that the models agree.

    `masters`: labels, or a rule to choose by (`Masters`). Default: the DOFs of joints, sensors and loads,
    with others where these do not see all the modes. `modes`: numbers from 1, rigid-body modes included, or a
    range (`ModeRange`). Default: one a master; with no masters either, all of the band; without a band, one a
    DOF of joints, sensors and loads. `interest`: purpose of the model.
    """

    masters: Sequence[Label] | Masters | None = None
    modes: Sequence[int] | ModeRange | None = None
    interest: Interest = field(default_factory=Interest)

    def reduce(self, model: StructuralModel) -> StructuralReduction:
        """Reduce a structure.

        Raises UsageError if masters or modes do not exist, stand twice, or the modes are more than the
        masters, and Singular if a mode is invisible at the masters.
        """
        reduced: StructuralReduction = _on_modes(model, self, None)
        return reduced


@guarded("the reduction on modes")
def _on_modes(
    model: StructuralModel, method: Serep, values: Mapping[str, float] | None
) -> StructuralReduction:
    """Reduce a structure on modes without its joints; or with these, at `values` of the unknown ones."""
    masters, modes, interest = method.masters, method.modes, method.interest
    matrices = (model.M, model.C, model.K) if values is None else model.with_joints(values)
    retained = values is not None or not model.joints
    if masters is not None and not isinstance(masters, Masters):
        indices_of(model, masters)  # what is wrong with them is said before the modes are computed
    count = mode_count(model, masters, interest)
    basis = selected(matrices, wanted_modes(modes, interest, count))
    kept = masters_for_modes(model, masters, interest, basis.shapes, model.M.diagonal())
    labels = tuple(model.dofs[k] for k in kept)
    seen = basis.shapes[kept]
    unscaled = basis.shapes / scaled(matrices[2], matrices[0]).scale[:, None]
    share = unscaled[kept] / np.linalg.norm(unscaled, axis=0)
    condition = checked_condition(seen, share, basis.numbers, labels)
    alike = len(kept) == len(basis.numbers)
    inverse, lost = cancellation(seen, basis.omega**2) if alike else (seen, np.inf)
    in_masters = bool(lost <= MASTER_COORDINATES.value)
    # The basis, the modes in the coordinates, and the coordinates' names: the masters', else the modes'.
    T, names = basis.shapes, tuple[Label, ...](f"mode_{number}" for number in basis.numbers)
    if in_masters:
        T, names = basis.shapes @ inverse, labels
        T[kept] = np.eye(len(kept))
    else:
        inverse = np.eye(len(basis.numbers))
    rigid = basis.rigid if retained and not in_masters else ()
    reduced = _with_stiffness_of_modes(model.projected(T, names, rigid), values, matrices, basis, inverse)
    rule = mode_rule(modes, interest, count)
    if alike and not in_masters:
        rule = f"{rule}; {modal_rule(float(lost))}"
    return StructuralReduction(
        reduced, labels, basis.numbers, condition, retained=retained, rule=rule, doubt=basis.doubt
    )


def _with_stiffness_of_modes(
    reduced: StructuralModel,
    values: Mapping[str, float] | None,
    matrices: tuple[Matrix, Matrix, Matrix],
    basis: SelectedModes,
    inverse: Array,
) -> StructuralModel:
    """Return a reduced model with the stiffness (eq 9) from the modes: ``U^T K U = U^T M U Omega^2``.

    The product loses as many digits as the stiffness is worse conditioned than its low modes; the
    frequencies do not. Joints in the stiffness of the modes are subtracted again.
    """
    energy = basis.shapes.T @ np.asarray(matrices[0] @ basis.shapes) * basis.omega**2
    assert reduced.basis is not None
    K = without_rounding(inverse.T @ energy @ inverse, reduced.basis.T, matrices[2])
    if values is not None:
        joints = replace(reduced, K=np.zeros_like(reduced.K)).with_joints(values)[2]
        K = K - as_array(joints)
    return replace(reduced, K=(K + K.T) / 2)


@dataclass(frozen=True)
class JointAware(Serep):
    """SEREP on modes of the structure with its joints; or these modes and residual vectors.

    `masters`, `modes`, `interest`: as of `Serep`; modes are those of the structure with joints; `values`:
    current values of the unknown joint parameters, by name; default: their starts; `residuals`: as of
    `ModalTruncation`, of the structure with its joints. Coordinates then are modal, and there are no masters.
    """

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
    def reduce(self, model: StructuralModel) -> StructuralReduction:
        """Reduce a structure.

        Raises UsageError, Singular as of `Serep.reduce`.
        """
        values = {unknown.name: unknown.start for unknown in model.unknowns} | dict(self.values or {})
        if not self.residuals:
            reduced: StructuralReduction = _on_modes(model, self, values)
            return reduced
        return on_modes_and_residuals(
            model, model.with_joints(values), self.modes, self.residuals, self.interest, retained=True
        )

    def at(self, values: Mapping[str, float]) -> JointAware:
        """Return the method for other values of the joints."""
        return replace(self, values=values)
